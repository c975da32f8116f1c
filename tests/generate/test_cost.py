"""The cost of a run, as `saf-gen generate --dry-run` states it, with simulated machines."""

from dataclasses import replace

import pytest

from saf_gen.generate.cost import MachineRates, simulate_machines
from saf_gen.generate.resolve import resolve_recipe
from saf_gen.generate.run import generate

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
    left = work.estimate_work(tmp_path / "new")
    assert (left.stacks, left.recordings) == (stacks, len(work.sequences))
    overhead = left.seconds - left.render_s - left.record_s - MachineRates().start_s
    jobs = (left.stacks + left.recordings) * MachineRates().job_s
    assert overhead == pytest.approx(jobs + left.recordings * MachineRates().sequence_s, rel=1e-6)
    many = work.estimate_work(tmp_path / "new", workers=2, machines=8)
    assert many.render_s == left.render_s
    assert many.record_s < left.record_s
    assert left.seconds / 8 < many.seconds < left.seconds


def test_what_is_there_costs_nothing(small_recipe, test_scenes, tmp_path):
    work, folder = resolve_recipe(small_recipe), tmp_path / "ds"
    generate(work, folder)
    left = work.estimate_work(folder)
    assert (left.stacks, left.recordings, left.seconds) == (0, 0, 0.0)
    (folder / work.sequences[0].planned.file).unlink()
    left = work.estimate_work(folder)
    assert (left.stacks, left.recordings, left.render_s) == (0, 1, 0.0)
    assert left.seconds > MachineRates().start_s


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
        return out.splitlines()[-2:]

    jobs, alone = last_lines()
    assert jobs.startswith("jobs: 3 to render, about ")
    assert "; 9 to record, about " in jobs
    assert alone.endswith(" on two cores with LLVM")
    assert last_lines("--machines", "3")[0] == jobs
    assert last_lines("--machines", "3")[1].endswith(" on 3 machines of two cores with LLVM")
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [(("--machines", "3"), "--machines is 3; allowed: with --dry-run alone"), (("--shard", "3/2"), "--shard is '3/2'")],
)
def test_options_that_cannot_be_meant_are_refused_and_nothing_is_made(call, tmp_path, options, message):
    code, _, err = call("generate", "quickstart", "--out", tmp_path / "new", *options)
    assert (code, err.count("\n")) == (2, 1)
    assert message in err
    assert not (tmp_path / "new").exists()
