"""Time slices are deleted once nothing needs them any more, and never before; their recordings are kept."""

import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import capture_dataset
import pytest
from capture_dataset import VARIANT
from refusals import assert_says, refusal

import saf_gen
from saf_gen.generate.plan import make_plan
from saf_gen.generate.resolve import resolve_recipe
from saf_gen.generate.run import generate
from saf_gen.stack.capture import Capture
from saf_gen.stream.dataset import verify_dataset
from saf_gen.stream.manifest import read_manifest

pytestmark = pytest.mark.slow

RECIPE = capture_dataset.RECIPE.replace("whole_slices: true", "whole_slices: 0.02")
"""Half of the 40 ms also have slices of all positions."""
MOVING = ["plane-dynamic-constant-00", "plane-dynamic-lamp_only-00"]
CHOICES = ["all", "closed-loop", "none"]


@pytest.fixture
def made(half_captured_dataset):
    """The dataset with all of its slices; tests get copies of it."""
    return half_captured_dataset


@pytest.fixture
def work(made, tmp_path, monkeypatch):
    monkeypatch.setenv("SAF_GEN_SCENES", str(made.parent / "scenes"))
    (tmp_path / "takes.yaml").write_text(RECIPE)
    return resolve_recipe(tmp_path / "takes.yaml")


@pytest.fixture
def copy(made, tmp_path):
    shutil.copytree(made, tmp_path / "takes")
    return tmp_path / "takes"


def digests(folder):
    return {e.id: e.content_sha256 for e in read_manifest(folder).sequences}


def pictures(folder, stack):
    """The existing picture files of a time-resolved stack."""
    return [path for spec in stack.specs for path in (folder / "stacks" / spec.key).glob("*.exr")]


def slices(work):
    """The time slices of the moving plane's recordings, and those of its closed loop."""
    moving = next(s for s in work.all_sequences if s.planned.scene_motion == "dynamic")
    return moving.time_stack, moving.closed_loop_slices


def put_slices(made, folder, stack):
    """Copy time slices of the dataset ``made`` to a folder, as if they had been rendered there."""
    for spec in stack.specs:
        shutil.copytree(made / "stacks" / spec.key, folder / "stacks" / spec.key, dirs_exist_ok=True)


def run_again(work, folder, choice):
    """Generate once more, without failures, and return the outcome."""
    again = generate(work, folder, variant=VARIANT, keep_slices=choice)
    assert again.failed == {}
    return again


@pytest.mark.parametrize("choice", CHOICES)
def test_each_choice_keeps_what_it_says_and_the_recordings(work, made, copy, choice):
    """11 slices of some positions and 6 of all, each with depth and two lights; the static scene keeps its stack."""
    recorded_from, for_closed_loop = slices(work)
    still = next(s.time_stack for s in work.all_sequences if s.planned.scene_motion == "static")
    before = {path: path.stat().st_size for path in copy.glob("stacks/*/*")}
    result = run_again(work, copy, choice)
    assert (result.rendered, result.recorded) == ([], [])
    assert len(result.kept) == 4
    here = [len(pictures(copy, stack)) for stack in (still, recorded_from, for_closed_loop)]
    assert here == {"all": [3, 33, 18], "closed-loop": [3, 0, 18], "none": [3, 0, 0]}[choice]
    assert result.freed_bytes == sum(size for path, size in before.items() if not path.exists())
    assert digests(copy) == digests(made)
    assert verify_dataset(copy) == (4, {})
    once_more = run_again(work, copy, choice)
    assert (once_more.rendered, once_more.recorded, once_more.freed_bytes) == ([], [], 0)


def test_with_no_slices_to_keep_none_are_rendered_for_the_closed_loop_alone(work, made, tmp_path):
    """Like the case ``none`` above, but the stacks of the recordings exist and are not rendered."""
    folder = tmp_path / "fresh"
    recorded_from, for_closed_loop = slices(work)
    still = next(s.time_stack for s in work.all_sequences if s.planned.scene_motion == "static")
    assert set(make_plan(work, folder, keep_slices="none").to_render) == {still, recorded_from}
    assert set(make_plan(work, folder, keep_slices="closed-loop").to_render) == {still, recorded_from, for_closed_loop}
    for stack in (still, recorded_from):
        put_slices(made, folder, stack)
    result = run_again(work, folder, "none")
    assert (result.rendered, len(result.recorded)) == ([], 4)
    assert result.freed_bytes > 0
    assert digests(folder) == digests(made)
    assert [len(pictures(folder, stack)) for stack in (still, recorded_from, for_closed_loop)] == [3, 0, 0]


def test_the_sizes_are_those_of_the_planes(work, tmp_path):
    """1.3 compressed bytes for each of 40 × 64 pixels and two lights, 3 for depth and target.

    The noise of plain paths is stronger, so that they take 1.5 bytes.
    """
    plane, geometry = 2 * 40 * 64 * 13 // 10, 40 * 64 * 3
    recorded_from, for_closed_loop = slices(work)
    some = plane * sum(spec.rendered_count for spec in recorded_from.specs) + 11 * geometry
    complete = plane * 9 * 6 + 6 * geometry
    assert {spec.rendered_count for spec in for_closed_loop.specs} == {9}
    assert [make_plan(work, tmp_path).kept_bytes(choice) for choice in CHOICES] == [some + complete, complete, 0]
    expected = [make_plan(work, tmp_path / "new", keep_slices=choice).disk_bytes for choice in CHOICES]
    assert [expected[0] - one for one in expected] == [0, 0, complete]
    (tmp_path / "takes.yaml").write_text(RECIPE.replace("samples: 16,", "samples: 16, estimator: plain,", 1))
    plain = make_plan(resolve_recipe(tmp_path / "takes.yaml"), tmp_path).kept_bytes("closed-loop") - 6 * geometry
    assert plain == pytest.approx(plane * 9 * 6 * 15 / 13)


def test_a_dry_run_says_what_each_choice_keeps(work, tmp_path, call):
    sizes = ", ".join(f"{choice} {make_plan(work, tmp_path).kept_bytes(choice) / 1e9:.2f} GB" for choice in CHOICES)
    recipe, folder = tmp_path / "takes.yaml", tmp_path / "dry"
    code, shown, _ = call("generate", recipe, "--out", folder, "--dry-run", "--keep-slices", "none")
    assert code == 0
    shown = " ".join(shown.split())
    assert f"time slices kept at the end: {sizes}; chosen: --keep-slices none" in shown
    assert "all positions" not in shown
    code, _, shown = call("generate", recipe, "--out", folder, "--keep-slices", "some")
    assert (code, "allowed: all, closed-loop, none" in " ".join(shown.split())) == (2, True)
    assert_says(refusal(generate, work, folder, keep_slices="closed_loop"), "'closed_loop' | 'closed-loop'")
    assert not folder.exists()


@pytest.mark.parametrize(("whole", "frames"), [("true", 800), ("0.02", 400)])
def test_the_closed_loop_says_what_to_do_where_no_slices_were_kept(
    made, captured_dataset, tmp_path, monkeypatch, whole, frames
):
    """The next run with another choice would render only the missing slices; here they are copied back."""
    monkeypatch.setenv("SAF_GEN_SCENES", str(made.parent / "scenes"))
    path, folder = tmp_path / "takes.yaml", tmp_path / "takes"
    path.write_text(RECIPE.replace("whole_slices: 0.02", f"whole_slices: {whole}"))
    dataset = {"true": captured_dataset, "0.02": made}[whole]
    shutil.copytree(dataset, folder)
    work = resolve_recipe(path)
    run_again(work, folder, "none")
    with saf_gen.open_stream(folder / "test" / f"{MOVING[0]}.h5") as stream:
        error = refusal(Capture.from_stream, stream, folder / "stacks")
    assert_says(error, "were not kept | generate again with --keep-slices closed-loop, or use --track recorded")
    assert make_plan(work, folder, keep_slices="none").to_render == {}
    (needed,) = make_plan(work, folder, keep_slices="closed-loop").to_render
    assert needed == slices(work)[1]
    assert {spec.rendered_count for spec in needed.specs} == {9}
    put_slices(dataset, folder, needed)
    again = run_again(work, folder, "closed-loop")
    assert (again.rendered, len(again.kept)) == ([], 4)
    with saf_gen.open_stream(folder / "test" / f"{MOVING[0]}.h5") as stream:
        here, there = (Capture.from_stream(stream, root / "stacks") for root in (folder, dataset))
    assert (here.frames, here.slices) == (frames, there.slices)
    assert here.plane_source.digest == there.plane_source.digest
    assert (here.plane_source.load_planes(3, 2, 4) == there.plane_source.load_planes(3, 2, 4)).all()


def test_no_shard_deletes_slices_and_the_closing_run_does(work, made, copy, tmp_path):
    """One of two shards records the moving scene, from existing slices, and the other the still one."""
    folder, recorded_from = copy, slices(work)[0]
    for file in (folder / "manifest.json", *folder.glob("test/*.h5")):
        file.unlink()
    for n in (1, 2):
        shard = run_again(resolve_recipe(tmp_path / "takes.yaml", part=(n, 2)), folder, "closed-loop")
        assert (shard.rendered, shard.freed_bytes, shard.manifest.sequences) == ([], 0, ())
        assert len(pictures(folder, recorded_from)) == 33
    closing = run_again(work, folder, "closed-loop")
    assert (closing.rendered, closing.recorded, len(closing.kept)) == ([], [], 4)
    assert closing.freed_bytes > 0
    assert pictures(folder, recorded_from) == []
    assert digests(folder) == digests(made)
    for n in (1, 2):
        again = run_again(resolve_recipe(tmp_path / "takes.yaml", part=(n, 2)), folder, "closed-loop")
        assert again.rendered == [], "a shard that runs after the closing run makes nothing again"
    assert digests(folder) == digests(made)


def test_slices_that_two_ways_of_the_lens_share_stay_until_both_are_recorded(made, tmp_path, monkeypatch):
    """One motion goes to the end of the travel, the other stops short of it: the first slices serve both.

    Those of the first motion exist, as if they had been rendered; the remaining ones of the second are rendered.
    """
    monkeypatch.setenv("SAF_GEN_SCENES", str(made.parent / "scenes"))
    table = tmp_path / "short.csv"
    table.write_text("time_s,position\n0,0\n0.03,0.75\n0.04,0.75\n")
    motion = "motion: {choice: [{kind: sweep}, {kind: from_csv, file: short.csv}]}"
    text = RECIPE.replace("positions: 9}", f"positions: 9, {motion}}}")
    path = tmp_path / "takes.yaml"
    path.write_text(text.replace("scene_motion: [static, dynamic]", "repeats: 4, scene_motion: [dynamic]"))
    work = resolve_recipe(path)
    stacks = {s.planned.motion["kind"]: s.time_stack for s in work.all_sequences}
    shared = set(stacks["sweep"].specs) & set(stacks["from_csv"].specs)
    assert 4 < len(shared) < 11
    one = replace(work, sequences=tuple(s for s in work.all_sequences if s.planned.motion["kind"] == "sweep"))
    other = replace(work, sequences=tuple(s for s in work.all_sequences if s.planned.motion["kind"] == "from_csv"))
    folder = tmp_path / "two"
    put_slices(made, folder, stacks["sweep"])
    first = run_again(one, folder, "none")
    assert first.rendered == []
    assert first.freed_bytes > 0
    left = {path.parent.name for path in pictures(folder, stacks["sweep"])}
    assert left == {spec.key for spec in shared}
    rest = run_again(other, folder, "none")
    assert len(rest.rendered) == 3 * (11 - len(shared))
    assert list(folder.glob("stacks/*/*.exr")) == []
    assert verify_dataset(folder) == (len(work.all_sequences), {})


def test_a_damaged_recording_needs_its_slices_again(work, made, copy):
    """They are copied back, and deleted again at the end; the other recordings are kept."""
    run_again(work, copy, "closed-loop")
    damaged = copy / "test" / f"{MOVING[0]}.h5"
    content = bytearray(damaged.read_bytes())
    middle = len(content) * 3 // 4
    content[middle : middle + 64] = bytes(64)
    damaged.write_bytes(content)
    needed = slices(work)[0]
    put_slices(made, copy, needed)
    again = run_again(work, copy, "closed-loop")
    assert (again.rendered, again.recorded, len(again.kept)) == ([], [MOVING[0]], 3)
    assert pictures(copy, needed) == []
    assert digests(copy) == digests(made)
    assert verify_dataset(copy) == (4, {})


def test_more_repeats_need_the_slices_again(work, made, copy, tmp_path):
    """The damaged recording above has them rendered; here they are copied back, and deleted again at the end."""
    run_again(work, copy, "closed-loop")
    (tmp_path / "takes.yaml").write_text(RECIPE.replace("scene_motion:", "repeats: 2, scene_motion:"))
    more = resolve_recipe(tmp_path / "takes.yaml")
    (needed,) = make_plan(more, copy, keep_slices="closed-loop").to_render
    assert needed == slices(work)[0]
    put_slices(made, copy, needed)
    again = run_again(more, copy, "closed-loop")
    assert again.rendered == []
    assert {"plane-dynamic-constant-01", "plane-dynamic-lamp_only-01"} <= set(again.recorded)
    assert pictures(copy, slices(more)[0]) == []
    assert verify_dataset(copy) == (8, {})


def test_a_recording_that_cannot_be_made_leaves_the_slices(work, copy):
    """A folder has the name of its file."""
    (copy / "test" / f"{MOVING[1]}.h5").unlink()
    (copy / "test" / f"{MOVING[1]}.h5").mkdir()
    again = generate(work, copy, variant=VARIANT, keep_slices="none")
    assert list(again.failed) == [f"record {MOVING[1]}"]
    recorded_from, for_closed_loop = slices(work)
    assert len(pictures(copy, recorded_from)) == 33
    assert pictures(copy, for_closed_loop) == []  # no recording needs them


def test_a_run_that_ends_amid_deleting_goes_on_there(work, made, copy, monkeypatch):
    delete, deleted = Path.unlink, []

    def interrupted(path, **how):
        deleted.extend([path] if path.suffix == ".exr" else [])
        if len(deleted) > 10:
            raise KeyboardInterrupt
        delete(path, **how)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "unlink", interrupted)
        with pytest.raises(KeyboardInterrupt):
            generate(work, copy, variant=VARIANT, keep_slices="closed-loop")
    recorded_from = slices(work)[0]
    assert 0 < len(pictures(copy, recorded_from)) < 33
    again = run_again(work, copy, "closed-loop")
    assert (again.rendered, again.recorded) == ([], [])
    assert pictures(copy, recorded_from) == []
    assert digests(copy) == digests(made)


IN_ONE_PROCESS = """
import sys
from inline_jobs import run_jobs_inline
from saf_gen.generate import run
from saf_gen.generate.resolve import resolve_recipe
run.run_jobs = run_jobs_inline
recipe, folder, variant = sys.argv[1:]
run.generate(resolve_recipe(recipe), folder, variant=variant, keep_slices="closed-loop")
"""


@pytest.mark.parametrize("file", ["test/*dynamic*.h5", pytest.param("stacks/*/lamp.exr", marks=pytest.mark.long)])
def test_a_killed_run_goes_on_and_renders_nothing_twice(work, made, tmp_path, file):
    """SIGKILL once this file exists, then the same run again. tests/generate/test_generate.py also kills workers.

    If it is killed after a recording, all slices existed.
    """
    folder = tmp_path / "killed"
    if file.startswith("test"):
        for stack in {slices(work)[1], *(s.time_stack for s in work.all_sequences)}:
            put_slices(made, folder, stack)
    command = [sys.executable, "-c", IN_ONE_PROCESS, str(tmp_path / "takes.yaml"), str(folder), VARIANT]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    run = subprocess.Popen(command, env=environment)
    deadline = time.monotonic() + 120
    while not list(folder.glob(file)) and run.poll() is None and time.monotonic() < deadline:
        time.sleep(0.001)
    run.kill()
    assert run.wait() == -signal.SIGKILL, "it ended before it was killed"
    recordings = {path: path.read_bytes() for path in folder.glob("test/*.h5")}
    there = [path for path in folder.glob("stacks/*/*.json") if path.stem in ("geometry", "lamp", "room")]
    again = run_again(work, folder, "closed-loop")
    assert digests(folder) == digests(made)
    assert len(again.rendered) <= 3 + 33 + 18 - len(there)
    for path, content in recordings.items():
        assert path.read_bytes() == content
    assert pictures(folder, slices(work)[0]) == []
    assert len(pictures(folder, slices(work)[1])) == 18
