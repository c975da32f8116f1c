"""The plan of a run, as `saf-gen generate --dry-run` states it, with simulated machines."""

import os
import re
import sys
from dataclasses import replace

import pytest
from capture_dataset import VARIANT

from saf_gen.generate.plan import MachineRates, make_plan, simulate_machines
from saf_gen.generate.resolve import resolve_recipe
from saf_gen.generate.run import generate
from saf_gen.render import backend
from saf_gen.render.backend import BackendProbe

RECIPE = """\
name: many
seed: 7
camera: {{sensor: vidar_400x250, frames: 400, exposure: {{mean_rate: 0.2}}}}
focus: {{positions: 4096{motion}}}
render: {{samples: 16}}
lights: {{constant: {{kind: constant}}, ramp: {{kind: ramp, from: 0.5, to: 2.0}}}}
splits:
  train: {{scenes: [fan, bottle], lights: [constant, ramp], repeats: 12{more}}}
  test: {{scenes: [usaf_target], lights: [constant], repeats: 12}}
"""
RANDOM_MOTION = ", motion: {kind: sweep, from: {uniform: [0, 0.2]}}"
NO_OVERHEAD = MachineRates(start_s=0, job_s=0, sequence_s=0)


@pytest.mark.parametrize(
    ("more", "motion", "stacks"),
    [
        ("", "", 3),
        (", variants: 12", "", 25),
        (", scene_motion: [static, dynamic]", "", 5),
        (", scene_motion: [static, dynamic]", RANDOM_MOTION, 3 + 2 * 12),
    ],
)
def test_a_stack_is_counted_once_and_a_recording_for_each_sequence(tmp_path, more, motion, stacks):
    path = tmp_path / "many.yaml"
    path.write_text(RECIPE.format(more=more, motion=motion))
    work = resolve_recipe(path)
    plan = make_plan(work, tmp_path / "new")
    left = plan.estimate()
    assert (len(plan.to_render), len(plan.unrecorded)) == (stacks, len(work.sequences))
    overhead = left.seconds - left.render_s - left.record_s - MachineRates().start_s
    jobs = (len(plan.to_render) + len(plan.unrecorded)) * MachineRates().job_s
    assert overhead == pytest.approx(jobs + len(plan.unrecorded) * MachineRates().sequence_s, rel=1e-6)
    many = plan.estimate(workers=2, machines=8)
    assert many.render_s == left.render_s
    assert many.record_s < left.record_s
    assert left.seconds / 8 < many.seconds < left.seconds


@pytest.mark.slow
def test_what_is_there_costs_nothing(small_recipe, test_scenes, tmp_path):
    work, folder = resolve_recipe(small_recipe), tmp_path / "ds"
    generate(work, folder)
    plan = make_plan(work, folder)
    left = plan.estimate()
    assert (len(plan.to_render), len(plan.unrecorded), left.seconds) == (0, 0, 0.0)
    (folder / work.sequences[0].planned.file).unlink()
    plan = make_plan(work, folder)
    left = plan.estimate()
    assert (len(plan.to_render), len(plan.unrecorded), left.render_s) == (0, 1, 0.0)
    assert left.seconds > MachineRates().start_s
    for grain in folder.glob("stacks/*/stack.grain.json"):
        grain.unlink()
    assert list(make_plan(work, folder).to_render.values()) == [()], (
        "its grain is to be measured, as after a stopped run"
    )
    assert make_plan(work, folder).labels == ["plane"]


def test_machines_wait_for_stacks_and_for_the_scheduler():
    """By hand: a stack of 10 s, 8 recordings of 1 s. One machine of two renders; both record 4 once it is there."""

    def seconds(*works, machines, rates=NO_OVERHEAD):
        return simulate_machines(works, record_s=1.0, machines=machines, rates=rates)

    assert [seconds((10.0, 8), machines=n) for n in (1, 2, 100)] == [18, 14, 11]
    assert seconds((10.0, 4), (10.0, 4), machines=2) == 14
    assert seconds((0.0, 8), machines=2) == 4, "the stack is there"
    slow = replace(NO_OVERHEAD, job_s=2.0)  # nine jobs are handed out, the last after 12 + 8 · 2 s
    assert seconds((10.0, 8), machines=100, rates=slow) == 12 + 16 + 1
    assert seconds(machines=3, rates=MachineRates()) == 0


def test_more_workers_record_faster_until_the_cores_are_busy():
    rates = MachineRates(cores=4, pixel_frames_per_s=3e8, pixel_frames_per_core_s=2e8)
    assert [rates.recorded_per_s(n) for n in (1, 2, 3, 9)] == pytest.approx([3e8, 6e8, 8e8, 8e8])


def test_a_dry_run_states_jobs_and_how_machines_share_them(call, tmp_path):
    def last_lines(*options):
        code, out, _ = call("generate", "quickstart", "--out", tmp_path / "new", "--dry-run", *options)
        assert code == 0
        lines = out.splitlines()
        return lines[next(n for n, line in enumerate(lines) if line.startswith("jobs: ")) :]

    jobs, alone, here = last_lines()
    assert jobs.startswith("jobs: 3 to render, about ")
    assert "; 9 to record, about " in jobs
    assert alone.endswith(" on two cores with LLVM")
    assert here.startswith("here: ")
    assert last_lines("--machines", "3")[0] == jobs
    assert last_lines("--machines", "3")[1].endswith(" on 3 machines of two cores with LLVM")
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(
    ("cores", "options", "probe", "here"),
    [
        ("1", [], BackendProbe((19, 1, 7), cuda=False), "1 core, variant llvm"),
        ("3", [], BackendProbe((19, 1, 7), cuda=False), "3 cores, variant llvm"),
        ("3", [], BackendProbe((19, 1, 7), cuda=True), "3 cores, variant cuda"),
        ("3", [], BackendProbe(None, cuda=False), "3 cores, variant scalar, which is many times slower"),
        ("3", [], BackendProbe((11, 0, 0), cuda=False), "3 cores, variant scalar, which is many times slower"),
        (
            "3",
            ["--variant", "scalar"],
            BackendProbe(None, cuda=True),
            "3 cores, variant scalar, which is many times slower",
        ),
        (
            "3",
            ["--variant", "llvm"],
            BackendProbe(None, cuda=False),
            "3 cores, but variant llvm cannot run here: no LLVM",
        ),
        ("3", ["--variant", "fast"], BackendProbe(None, cuda=False), "3 cores, but unknown variant 'fast'"),
        ("3", ["--machines", "2"], BackendProbe(None, cuda=False), None),
        ("3", ["--cluster", "tcp://nowhere:1"], BackendProbe(None, cuda=False), None),
    ],
)
def test_a_dry_run_says_what_its_time_rests_on_and_what_is_here(
    call, tmp_path, monkeypatch, cores, options, probe, here
):
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {0, 1, 2})
    monkeypatch.setenv("SLURM_CPUS_PER_TASK", cores)
    monkeypatch.setattr(backend, "probe_backends", lambda: probe)
    code, out, _ = call("generate", "quickstart", "--out", tmp_path / "new", "--dry-run", *options)
    assert code == 0
    stated = [line for line in out.splitlines() if line.startswith("here: ")]
    assert len(stated) == (here is not None)
    assert not here or stated[0].startswith(f"here: {here}")


@pytest.mark.slow
def test_a_dry_run_names_no_renderer_where_there_is_none_or_nothing_to_render(
    call, tmp_path, monkeypatch, small_recipe, test_scenes
):
    options = ["generate", small_recipe, "--out", tmp_path / "made"]
    with monkeypatch.context() as patch:
        for name in [m for m in sys.modules if m.startswith("saf_gen.render")]:
            patch.delitem(sys.modules, name)
        patch.setitem(sys.modules, "mitsuba", None)
        code, out, _ = call(*options, "--dry-run")
    assert code == 0
    assert re.search(r"\nhere: \d+ cores?, but rendering needs the package mitsuba$", out)
    assert call(*options, "--variant", VARIANT)[0] == 0
    (tmp_path / "made/test/plane-constant-00.h5").unlink()
    assert re.search(r"\nhere: \d+ cores?$", call(*options, "--dry-run")[1])


@pytest.mark.parametrize(
    ("options", "message"),
    [(("--machines", "3"), "--machines is 3; allowed: with --dry-run alone"), (("--shard", "3/2"), "--shard is '3/2'")],
)
def test_options_that_cannot_be_meant_are_refused_and_nothing_is_made(call, tmp_path, options, message):
    code, _, err = call("generate", "quickstart", "--out", tmp_path / "new", *options)
    assert (code, err.count("\n")) == (2, 1)
    assert message in err
    assert not (tmp_path / "new").exists()
