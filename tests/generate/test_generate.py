"""Generating a dataset: complete, independent of the workers, resumed after a kill, refused before anything is made."""

import errno
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections import namedtuple
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from capture_dataset import VARIANT
from refusals import assert_says, refusal
from small_dataset import SCENES, SMALL_RECIPE

import saf_gen
from saf_gen.core.execution import SchedulerLost
from saf_gen.core.exr import read_planes
from saf_gen.errors import SafGenError
from saf_gen.generate import run
from saf_gen.generate.resolve import resolve_recipe
from saf_gen.generate.run import generate
from saf_gen.stack.focal_stack import StackStore
from saf_gen.stream.description import describe_content
from saf_gen.stream.manifest import read_manifest
from saf_gen.stream.recorded_grain import grain_of_stream


def digests(folder):
    return {e.id: e.content_sha256 for e in read_manifest(folder).sequences}


FILES_WHEN_DONE: dict[str, set[str]] = {}
"""Names of the files that existed when each job of the small dataset was first reported as done."""


@pytest.fixture(scope="module")
def first(tmp_path_factory):
    """The small dataset, generated once; tests get copies of it."""
    folder = tmp_path_factory.mktemp("first")
    recipe = folder / "small.yaml"
    recipe.write_text(SMALL_RECIPE)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SAF_GEN_SCENES", str(SCENES))

        def report(name: str, done: float) -> None:
            if done >= 1:
                FILES_WHEN_DONE.setdefault(name, {path.name for path in folder.rglob("*")})

        return generate(resolve_recipe(recipe), folder / "made", variant=VARIANT, report=report)


@pytest.fixture
def work(test_scenes, small_recipe):
    return resolve_recipe(small_recipe)


@pytest.fixture
def made(first, test_scenes, tmp_path):
    """A copy of the small dataset that a test may change."""
    assert first.failed == {}
    shutil.copytree(first.folder, tmp_path / "made")
    return replace(first, folder=tmp_path / "made")


@pytest.mark.slow
def test_a_recipe_becomes_streams_with_truth(made):
    assert made.rendered == ["plane · geometry", "plane · lamp", "plane · room"]
    assert made.recorded == ["plane-constant-00", "plane-continuous-00", "plane-lamp_only-00"]
    with saf_gen.open_stream(made.folder / "test" / "plane-constant-00.h5") as stream:
        assert stream.shape == (400, 40, 64)
        assert stream.truth.position == pytest.approx(0.46199, abs=1e-4)
        assert stream.truth.frame == pytest.approx(0.46199 * 400 - 0.5, abs=0.1)
        assert stream.focus_position[0] == pytest.approx(0.5 / 400, abs=1e-7)  # on a grid of 2⁻²⁴
        assert stream.truth.target.all()
        assert stream.truth.sharpness.shape == (9,)
        counts = stream.counts(0, 400)
    # The mean rate is 0.2 in the target at best focus. Over 1.02 million pixel readouts sampling noise is below
    # 0.1 %; the light varies by 1 % over the sweep (bellows).
    assert counts.mean() / 400 == pytest.approx(0.2, rel=0.02)


@pytest.mark.slow
def test_a_still_stack_has_a_contact_sheet_that_is_drawn_once(made, small_recipe):
    (sheet,) = (made.folder / "preview").iterdir()
    sheet.unlink()
    command = [sys.executable, "-m", "saf_gen", "generate", str(small_recipe), "--out", str(made.folder)]
    subprocess.run(command, check=True, capture_output=True)
    drawn = sheet.read_bytes()
    assert drawn.startswith(b"\x89PNG")
    assert len(drawn) > 20_000
    sheet.write_bytes(b"already drawn")
    subprocess.run(command, check=True, capture_output=True)
    assert sheet.read_bytes() == b"already drawn"


def test_a_job_is_reported_as_done_once_its_files_have_their_names(first):
    assert first.failed == {}
    expected = {f"record {name}": {f"{name}.h5"} for name in first.recorded}
    expected |= {"render plane · geometry": {"geometry.exr", "geometry.json"}, "render plane · light": {"lamp.json"}}
    assert FILES_WHEN_DONE.keys() >= expected.keys()
    assert {name: FILES_WHEN_DONE[name] & files for name, files in expected.items()} == expected
    assert not any(name.endswith(".part") for files in FILES_WHEN_DONE.values() for name in files)


def test_every_recording_says_how_much_grain_its_pictures_have(made):
    with saf_gen.open_stream(made.folder / "test" / "plane-constant-00.h5") as stream:
        grain = grain_of_stream(stream.metadata.provenance)
        described = describe_content(stream)["grain"]
        assert abs(grain.moments[grain.focus].frame - stream.truth.frame) <= 0.5
    assert grain.samples == (16, 2)
    assert 0.01 < grain.rms_in_focus < 0.3
    assert described.startswith(f"{grain.rms_in_focus:.2%} of the mean in focus")


@pytest.mark.slow
def test_grain_that_is_missing_is_measured_and_moves_no_spike(made, work):
    """A run may stop between a stack and its grain: then only the second pictures, for the grain, are rendered."""
    before = digests(made.folder)
    (note,) = made.folder.rglob("stack.grain.json")
    note.unlink()
    again = generate(work, made.folder, variant=VARIANT)
    assert not note.exists(), "every recording exists, so no grain is needed"
    (made.folder / "test" / "plane-constant-00.h5").unlink()
    again = generate(work, made.folder, variant=VARIANT)
    assert note.exists()
    assert again.rendered == []
    assert again.recorded == ["plane-constant-00"]
    assert digests(made.folder) == before


def test_a_recording_says_how_it_was_made_and_holds_its_sensor_as_a_sensor_file_without_its_kind(work, made, tmp_path):
    with saf_gen.open_stream(made.folder / "test" / "plane-constant-00.h5") as stream:
        provenance = stream.metadata.provenance
    assert "name: small" in provenance["recipe"]
    assert provenance["variant"] == VARIANT
    assert json.loads(provenance["versions"])["mitsuba"] == "3.9.1"
    (tmp_path / "again.yaml").write_text("kind: spikes\n" + provenance["sensor"])
    assert saf_gen.get_sensor(tmp_path / "again.yaml") == work.sensor


@pytest.mark.slow
def test_one_and_two_workers_give_the_same_digests(work, made, tmp_path, worker_processes):
    shutil.copytree(made.folder / "stacks", tmp_path / "other/stacks")
    other = generate(work, tmp_path / "other", workers=2, variant=VARIANT)
    assert other.rendered == []
    assert digests(other.folder) == digests(made.folder)


@pytest.mark.slow
def test_a_script_on_standard_input_without_a_guard_makes_a_dataset(work, made, small_recipe, tmp_path):
    shutil.copytree(made.folder / "stacks", tmp_path / "other/stacks")
    script = f"""
from saf_gen.generate.resolve import resolve_recipe
from saf_gen.generate.run import generate
print(generate(resolve_recipe({str(small_recipe)!r}), "other").exit_code)
"""
    ran = subprocess.run([sys.executable], input=script, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert (ran.stdout, ran.stderr) == ("0\n", "")
    assert digests(tmp_path / "other") == digests(made.folder)


def test_a_damaged_sequence_is_made_again_alone(work, made):
    before = digests(made.folder)
    path = made.folder / "test" / "plane-constant-00.h5"
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    again = generate(work, made.folder, variant=VARIANT)
    assert again.recorded == ["plane-constant-00"]
    assert again.rendered == []
    assert digests(again.folder) == before


@pytest.mark.slow
def test_another_seed_records_again_and_lists_nothing_of_the_old_recipe(small_recipe, made):
    small_recipe.write_text(small_recipe.read_text().replace("seed: 3", "seed: 4"))
    work = resolve_recipe(small_recipe)
    part = generate(replace(work, sequences=work.sequences[::3]), made.folder, variant=VARIANT)
    assert part.rendered == []
    assert [e.id for e in part.manifest.sequences] == part.recorded == ["plane-constant-00"]


def stack_spec(work):
    """The only stack of the small dataset."""
    ((spec,),) = {s.time_stack.specs for s in work.sequences}
    return spec


@pytest.mark.slow
def test_a_changed_stack_is_recorded_again(small_recipe, work, made):
    for path in made.folder.glob("stacks/*/lamp.*"):
        path.unlink()
    store = StackStore(made.folder / "stacks", stack_spec(work))
    store.write_group("lamp", room_radiance(made.folder, work) * 2, backend=VARIANT)
    again = generate(work, made.folder, variant=VARIANT)
    assert again.rendered == []
    assert len(again.recorded) == 3


def room_radiance(folder, work):
    """The room's radiance, which here serves as another lamp's."""
    planes, _ = read_planes(next(folder.glob("stacks/*/room.exr")))
    return np.array([planes[f"focus.{k:04d}"] for k in range(stack_spec(work).positions)])


@pytest.mark.slow
def test_a_killed_generation_goes_on_where_it_was(work, small_recipe, made, tmp_path):
    """After SIGKILL to the process group in the midst of a stack, the same run ends with the same digests."""
    folder = tmp_path / "killed"
    command = [sys.executable, "-m", "saf_gen", "generate", str(small_recipe), "--out", str(folder)]
    command += ["--variant", VARIANT]
    run = subprocess.Popen(command, start_new_session=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 60
    while not list(folder.glob("stacks/*/lamp.exr")) and run.poll() is None and time.monotonic() < deadline:
        time.sleep(0.001)
    os.killpg(run.pid, signal.SIGKILL)
    run.wait()
    done = {p.relative_to(folder): p.read_bytes() for p in folder.glob("stacks/*/*.exr")}
    assert done, "killed before anything was made"
    assert generate(work, folder, variant=VARIANT).failed == {}
    assert digests(folder) == digests(made.folder)
    for name, content in done.items():
        assert (folder / name).read_bytes() == content


def test_a_stopped_run_lists_the_complete_sequences(work, made, monkeypatch):
    """Two of three sequences are missing: one is recorded before the run stops, the other by the next run.

    tests/cli/test_cli.py stops one with Ctrl-C.
    """
    complete, run_all = digests(made.folder), run.run_jobs
    first, second, third = (entry.file for entry in read_manifest(made.folder).sequences)
    for file in (second, third):
        (made.folder / file).unlink()

    def run_two(jobs, **how):
        yield from islice(run_all(jobs, **how), 2)
        raise SchedulerLost("the Dask scheduler at tcp://there:1 is gone")

    lost = "2 of 3 sequences complete and listed; start a scheduler and run the same"
    with monkeypatch.context() as patch:
        patch.setattr(run, "run_jobs", run_two)
        with pytest.raises(SafGenError, match=lost):
            generate(work, made.folder, variant=VARIANT)
    listed = read_manifest(made.folder)
    assert [entry.file for entry in listed.sequences] == [first, second]
    assert listed.count_unmade(listed.splits) == 1
    assert digests(generate(work, made.folder, variant=VARIANT).folder) == complete
    assert read_manifest(made.folder).count_unmade(listed.splits) == 0


def test_a_folder_that_cannot_be_written_is_refused(work, tmp_path):
    (tmp_path / "file").write_text("in the way")
    assert_says(refusal(generate, work, tmp_path / "file" / "ds", variant=VARIANT), "file/ds cannot be written")


def test_the_folder_of_another_dataset_is_not_touched(work, made, small_recipe):
    small_recipe.write_text(small_recipe.read_text().replace("name: small", "name: other"))
    before = sorted(made.folder.rglob("*"))
    assert_says(refusal(generate, resolve_recipe(small_recipe), made.folder, variant=VARIANT), "'small' | 'other'")
    assert sorted(made.folder.rglob("*")) == before


def test_a_full_disk_is_refused_before_anything_is_made(work, tmp_path, monkeypatch):
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr("shutil.disk_usage", lambda path: usage(1, 1, 0))
    assert_says(refusal(generate, work, tmp_path / "ds", variant=VARIANT), "needs about | 0 MB are free")
    assert not (tmp_path / "ds").exists()


@pytest.fixture
def fill_disk(monkeypatch):
    """Return a function after which the disk is full once so many recordings have been written."""

    def fill(fits):
        sync, written = os.fsync, []

        def sync_few(file):
            if ".h5." in Path(f"/proc/self/fd/{file}").readlink().name:
                if len(written) >= fits:
                    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
                written.append(file)
            sync(file)

        monkeypatch.setattr(os, "fsync", sync_few)

    return fill


@pytest.mark.parametrize("fits", [0, 1, 2])
def test_a_disk_that_fills_stops_the_run_in_one_line_and_lists_what_is_finished(
    small_recipe, made, call, fill_disk, fits
):
    for path in (made.folder / "test").iterdir():
        path.unlink()
    fill_disk(fits)
    code, out, err = call("generate", small_recipe, "--out", made.folder, "--variant", VARIANT)
    (line,) = (line for line in err.splitlines() if not line.startswith("done: "))
    unmade = made.folder / f"test/{made.recorded[fits]}.h5"
    hint = "free disk space and run the same command again to go on"
    assert line == f"saf-gen: {unmade} cannot be written: No space left on device; {hint}"
    assert (code, out) == (2, "")
    assert list(digests(made.folder)) == made.recorded[:fits]
    assert len(list(made.folder.rglob("*.part"))) == 0


@pytest.mark.parametrize("fits", [0, 1])
def test_a_disk_that_fills_while_another_camera_records_is_one_line(made, call, fill_disk, fits):
    fill_disk(fits)
    code, _, err = call("recapture", made.folder, "--sensor", "evk4")
    assert (code, err.count("\n")) == (2, 1)
    assert f"{made.recorded[fits]}.h5 cannot be written: No space left on device; free disk space" in err


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root may mount a small disk")
@pytest.mark.parametrize("workers", [1, 2])
def test_a_small_disk_that_fills_is_one_line(small_recipe, made, tmp_path, workers):
    """Three recordings and their stacks take 600 kB."""
    disk = tmp_path / "disk"
    disk.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=500k", "tmpfs", disk], check=False).returncode:
        pytest.skip("a container may not mount a small disk")
    try:
        for name in ("stacks", "preview"):
            shutil.copytree(made.folder / name, disk / "made" / name)
        command = ["generate", small_recipe, "--out", disk / "made", "--workers", str(workers), "--variant", VARIANT]
        ran = subprocess.run([sys.executable, "-m", "saf_gen", *command], capture_output=True, text=True, check=False)
        (line,) = (line for line in ran.stderr.splitlines() if not line.startswith("done: "))
        assert (ran.returncode, ran.stdout) == (2, "")
        assert "cannot be written: No space left on device; free disk space" in line
        assert list(disk.rglob("*.part")) == []
    finally:
        subprocess.run(["umount", "--lazy", disk], check=True)


def test_a_scene_that_fails_is_named_and_leaves_no_recording(small_recipe, tmp_path, monkeypatch, test_scenes):
    shutil.copytree(test_scenes / "plane", tmp_path / "scenes" / "plane")
    script = tmp_path / "scenes" / "plane" / "scene.py"
    script.write_text(script.read_text().replace("return {", "return 1/0, {"))
    monkeypatch.setenv("SAF_GEN_SCENES", str(tmp_path / "scenes"))
    outcome = generate(resolve_recipe(small_recipe), tmp_path / "ds", variant=VARIANT)
    assert list(outcome.failed) == ["render plane"]
    assert "ZeroDivisionError: division by zero" in str(outcome.failed["render plane"])
    assert outcome.exit_code == 2
    assert outcome.manifest.sequences == ()
    assert not list((tmp_path / "ds").rglob("*.h5"))


@pytest.mark.slow
def test_scalar_renders_geometric_stacks_and_says_so(work, small_recipe, tmp_path, call):
    """The file states that diffraction is off, has the geometric depth of focus, and is kept by the next run."""
    code, out, _ = call("generate", small_recipe, "--out", tmp_path / "ds", "--variant", "scalar")
    assert code == 0
    assert "rendered without diffraction: only the variants llvm and cuda support it" in out
    (spec,) = work.without_diffraction().sequences[0].time_stack.specs
    assert StackStore(tmp_path / "ds" / "stacks", spec).missing_pieces() == []
    with saf_gen.open_stream(tmp_path / "ds" / "test" / "plane-constant-00.h5") as stream:
        depths = stream.truth.depth[stream.truth.target]
        assert stream.truth.depth_of_focus == spec.drive.depth_of_focus(spec.drive.least_blur(depths), spec.pitch_m)
        assert "diffraction: false" in stream.metadata.provenance["recipe"]
    again = generate(work, tmp_path / "ds", variant="scalar")
    assert (len(again.kept), again.recorded, again.rendered) == (3, [], [])


def test_scalar_refuses_a_recipe_that_asks_for_diffraction(small_recipe, test_scenes, tmp_path):
    small_recipe.write_text(small_recipe.read_text().replace("max_depth: 3", "max_depth: 3, diffraction: true"))
    problem = refusal(generate, resolve_recipe(small_recipe), tmp_path / "ds", variant="scalar")
    assert_says(problem, "variant scalar cannot render diffraction | llvm, cuda | diffraction: false")
    assert not (tmp_path / "ds").exists()
