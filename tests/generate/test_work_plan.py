"""`saf-gen plan`: exact for small recipes, estimated from a few repeats for large ones, with simulated machines."""

import json
from dataclasses import asdict, fields, replace

import pytest
from refusals import assert_says, refusal
from typer.testing import CliRunner

from saf_gen.cli import app
from saf_gen.generate import work_plan
from saf_gen.generate.cost import MachineRates, read_rates_for_plan
from saf_gen.generate.resolve import resolve_recipe
from saf_gen.generate.work_plan import StackWork, plan_work, simulate_machines

RECIPE = """\
name: many
seed: 7
camera: {{sensor: vidar_400x250, frames: 400, exposure: {{mean_rate: 0.2}}}}
focus: {{positions: 4096{motion}}}
render: {{samples: 16}}
lights: {{constant: {{kind: constant}}, ramp: {{kind: ramp, from: 0.5, to: 2.0}}}}
splits:
  train: {{scenes: [fan, bottle], lights: [constant, ramp], repeats: {repeats}{more}}}
  test: {{scenes: [usaf_target], lights: [constant], repeats: {repeats}}}
"""
RANDOM_MOTION = ", motion: {kind: sweep, from: {uniform: [0, 0.2]}}"
NO_OVERHEAD = MachineRates(start_s=0, job_s=0, sequence_s=0)


@pytest.fixture
def write(tmp_path):
    def write_recipe(repeats, *, more="", motion=""):
        path = tmp_path / "many.yaml"
        path.write_text(RECIPE.format(repeats=repeats, more=more, motion=motion))
        return path

    return write_recipe


def test_a_plan_of_a_small_recipe_is_what_generate_would_do(write, tmp_path):
    recipe = write(3)
    plan, work = plan_work(recipe), resolve_recipe(recipe)
    assert (plan.sequences, plan.stacks, plan.jobs, plan.drawn) == (15, 3, 18, 15)
    assert plan.disk_bytes == pytest.approx(work.estimate_bytes(tmp_path / "new"), abs=1)
    assert plan.render_s + plan.record_s + MachineRates().start_s == pytest.approx(
        work.estimate_seconds(tmp_path / "new")
    )
    overhead = plan.seconds - plan.render_s - plan.record_s - MachineRates().start_s
    assert overhead == pytest.approx(plan.scheduler_s, rel=1e-6)


@pytest.mark.parametrize(
    ("more", "motion", "stacks"),
    [
        ("", "", 3),
        (", variants: 12", "", 25),
        (", scene_motion: [static, dynamic]", "", 5),
        (", scene_motion: [static, dynamic]", RANDOM_MOTION, 3 + 2 * 12),
    ],
)
def test_a_few_repeats_stand_for_all(write, monkeypatch, more, motion, stacks):
    """Counts are exact; the cost of slices is estimated from the 8 of 12 lens motions that were drawn."""
    recipe = write(12, more=more, motion=motion)
    every = plan_work(recipe)
    monkeypatch.setattr(work_plan, "MAX_DRAWN", 0)
    few = plan_work(recipe)
    assert few.drawn < every.drawn
    assert every.stacks == stacks
    assert (few.sequences, few.stacks, few.jobs) == (every.sequences, every.stacks, every.jobs)
    for name in ("render_s", "record_s", "peak_bytes", "disk_bytes"):
        assert getattr(few, name) == pytest.approx(getattr(every, name), rel=0.1 if motion else 1e-9), name


@pytest.mark.slow
def test_a_million_sequences_are_planned_from_a_few(write):
    scenes, lights = ["fan", "bottle", "camel", "speculars", "usaf_target"], [f"l{i}" for i in range(20)]
    recipe = write(10)
    data = {
        "name": "million",
        "seed": 1,
        "camera": {"sensor": "vidar_400x250", "frames": 400, "exposure": {"mean_rate": 0.2}},
        "focus": {"positions": 9},
        "render": {"samples": 16},
        "lights": {name: {"kind": "constant"} for name in lights},
        "splits": {"test": {"scenes": scenes, "lights": lights, "repeats": 10_000}},
    }
    recipe.write_text(json.dumps(data))
    plan = plan_work(recipe, machines=50)
    assert (plan.sequences, plan.stacks, plan.drawn) == (1_000_000, 5, 800)
    assert plan.scheduler_s == pytest.approx(1_000_005 * MachineRates().job_s + 1e6 * MachineRates().sequence_s)
    assert plan_work(recipe, part=(2, 8)).sequences == 125_000


def test_shards_have_the_sequences_together_and_each_its_stacks(write):
    recipe = write(4)
    parts = [plan_work(recipe, part=(i, 3)) for i in (1, 2, 3)]
    assert sum(part.sequences for part in parts) == plan_work(recipe).sequences
    assert all(part.stacks == 3 for part in parts)


def test_machines_wait_for_stacks_and_for_the_scheduler():
    """By hand: a stack of 10 s, 8 recordings of 1 s. One machine of two renders; both record 4 once it is there."""
    one = StackWork(1, 10.0, 0, 0, 8)
    assert simulate_machines([one], record_s=1.0, machines=1, rates=NO_OVERHEAD) == 18
    assert simulate_machines([one], record_s=1.0, machines=2, rates=NO_OVERHEAD) == 14
    assert simulate_machines([replace(one, stacks=2)], record_s=1.0, machines=2, rates=NO_OVERHEAD) == 14
    assert simulate_machines([one], record_s=1.0, machines=100, rates=NO_OVERHEAD) == 11
    slow = replace(NO_OVERHEAD, job_s=2.0)  # nine jobs are handed out, the last after 12 + 8 · 2 s
    assert simulate_machines([one], record_s=1.0, machines=100, rates=slow) == 12 + 16 + 1
    assert simulate_machines([], record_s=1.0, machines=3, rates=MachineRates()) == 0


def test_more_workers_record_faster_until_the_cores_are_busy():
    rates = MachineRates(cores=4, pixel_frames_per_s=3e8, pixel_frames_per_core_s=2e8)
    assert [rates.recorded_per_s(n) for n in (1, 2, 3, 9)] == pytest.approx([3e8, 6e8, 8e8, 8e8])


def test_rates_are_those_that_the_bench_printed(tmp_path):
    path = tmp_path / "rates.json"
    figures = [
        {"bench": "rates", "what": "job_s", "value": 0.5},
        {"bench": "rates", "what": "100 jobs", "value": 3},
        {"bench": "stack", "what": "cores", "value": 9},
    ]
    path.write_text(json.dumps(figures))
    assert read_rates_for_plan(path) == MachineRates(job_s=0.5)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[]", "holds no machine rates | cores, job_s | saf-gen bench rates --json"),
        ("{}", "holds no machine rates"),
        ('[{"bench": "rates", "what": "job_s", "value": 0}]', "job_s is 0 | a number above 0"),
        ('[{"bench": "rates", "what": "job_s", "value": "x"}]', "job_s is 'x'"),
        ('[{"bench": "rates", "what": "job_s", "value": true}]', "job_s is True"),
        ("[1", "this is not JSON"),
    ],
)
def test_a_file_that_holds_no_rates_is_refused(tmp_path, text, message):
    path = tmp_path / "rates.json"
    path.write_text(text)
    assert_says(refusal(read_rates_for_plan, path), message)


def test_the_command_adds_recipes_up_and_makes_nothing(write, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    recipe = str(write(3))
    shown = CliRunner().invoke(app, ["plan", recipe, "quickstart", "--machines", "2"], catch_exceptions=False)
    assert shown.exit_code == 0
    assert "together" in shown.output
    assert "2 machines under one scheduler, each with two cores" in shown.output
    shown = CliRunner().invoke(app, ["plan", recipe, "quickstart", "--json"], catch_exceptions=False)
    found = json.loads(shown.output)
    both = [asdict(plan_work(recipe)), asdict(plan_work("quickstart"))]
    assert found["recipes"] == both
    assert found["total"]["jobs"] == both[0]["jobs"] + both[1]["jobs"]
    assert set(found["rates"]) == {field.name for field in fields(MachineRates)}
    assert [path.name for path in tmp_path.iterdir()] == ["many.yaml"]


def test_a_shard_beyond_the_last_is_refused(write):
    shown = CliRunner().invoke(app, ["plan", str(write(1)), "--shard", "3/2"])
    assert "--shard is '3/2'" in str(shown.exception)
