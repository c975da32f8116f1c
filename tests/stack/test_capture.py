"""A sequence that is captured again from its stacks: the same lens motion gives the same spikes."""

import json
import shutil

import capture_dataset
import h5py
import numpy as np
import pytest
from refusals import refusal

import saf_gen
from saf_gen.benchmark.tracks.closed_loop import ClosedLoopSequence
from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol
from saf_gen.benchmark.tracks.tasks import select_sequences_to_evaluate
from saf_gen.benchmark.view.captured import CapturedReadouts
from saf_gen.benchmark.view.recording import WindowCounts
from saf_gen.camera import Encoder
from saf_gen.generate.resolve import resolve_recipe
from saf_gen.generate.run import generate
from saf_gen.optics.actuators import get_actuator
from saf_gen.plugins.motions import lens_positions
from saf_gen.stack.capture import Capture
from saf_gen.stack.charge_source import ChargeSource
from saf_gen.stack.light import SceneLight

pytestmark = pytest.mark.slow

WHOLE = slice(0, 40), slice(0, 64)


@pytest.fixture(scope="module")
def dataset(captured_dataset):
    return captured_dataset


@pytest.mark.parametrize(
    ("name", "region"),
    [
        ("plane-constant-00", None),
        ("plane-lamp_only-00", (slice(7, 22), slice(5, 60))),
        ("plane-dynamic-lamp_only-00", (slice(7, 22), slice(5, 60))),
    ],
)
def test_the_same_lens_sees_the_same_spikes_and_intervals(dataset, name, region):
    region = region or WHOLE
    with saf_gen.open_stream(dataset / "test" / f"{name}.h5") as stream:
        capture = Capture.from_stream(stream, dataset / "stacks")
        motion = json.loads(stream.metadata.provenance["sequence"])["motion"]
        position = lens_positions(motion, capture.frames, readout_hz=stream.readout_hz)
        frames = CapturedReadouts(capture, capture.open_light(capture.rows_for(region)), region=region)
        for stop in (8, 96, 800):  # in any pieces
            frames.encode_until(stop, position)
        for first, last in ((0, 800), (3, 5), (90, 210)):
            assert np.array_equal(frames.window(first, last), stream.counts(first, last, region=region))
            if region == WHOLE:
                assert np.array_equal(frames.intervals(first, last), WindowCounts(stream).intervals(first, last))


def test_runs_share_what_was_encoded_as_far_as_their_lenses_went_the_same_way(dataset, monkeypatch):
    """In any order: the same path again, a part of it, a path that differs from a frame on, and the first one again."""
    with saf_gen.open_stream(dataset / "test" / "plane-dynamic-lamp_only-00.h5") as stream:
        capture = Capture.from_stream(stream, dataset / "stacks")
    first = np.linspace(0, 1, 800)
    other = np.where(np.arange(800) < 400, first, 0.5)
    encoded = []
    encode = Encoder.encode
    monkeypatch.setattr(
        Encoder, "encode", lambda self, **inputs: (encoded.append(len(inputs["index"])), encode(self, **inputs))[1]
    )
    shared = CapturedReadouts(capture, capture.open_light(), region=WHOLE)
    for position, stop, expected in (
        (first, 480, 480), (first, 240, 0), (first, 640, 160), (other, 400, 0), (other, 408, 408), (first, 640, 640),
    ):  # fmt: skip
        encoded.clear()
        shared.encode_until(stop, position)
        assert sum(encoded) == expected
        separate = CapturedReadouts(capture, capture.open_light(), region=WHOLE)
        separate.encode_until(stop, position)
        for window in ((0, stop), (stop - 60, stop - 3)):
            assert np.array_equal(shared.window(*window), separate.window(*window))
            assert np.array_equal(shared.intervals(*window), separate.intervals(*window))


def test_frames_go_on_after_a_stack_that_could_not_be_read(dataset, monkeypatch):
    """A run that failed leaves what it had encoded; the next one, on the same path, sees the same as without it."""
    position = np.linspace(0, 1, 800)
    with saf_gen.open_stream(dataset / "test" / "plane-dynamic-lamp_only-00.h5") as stream:
        capture = Capture.from_stream(stream, dataset / "stacks")
    shared, separate = (CapturedReadouts(capture, capture.open_light(), region=WHOLE) for _ in range(2))
    inputs = ChargeSource.encoder_inputs

    def fail_late(self, run, **options):
        if run.end > 320:
            raise OSError(5, "Input/output error")
        return inputs(self, run, **options)

    with monkeypatch.context() as patch:
        patch.setattr(ChargeSource, "encoder_inputs", fail_late)
        with pytest.raises(OSError, match="Input/output"):
            shared.encode_until(800, position)
    assert 0 < shared.frames <= 320
    for frames in (shared, separate):
        frames.encode_until(800, position)
    assert np.array_equal(shared.window(0, 800), separate.window(0, 800))


def test_another_path_whose_first_stack_cannot_be_read_begins_anew_the_next_time(dataset):
    with saf_gen.open_stream(dataset / "test" / "plane-constant-00.h5") as stream:
        capture = Capture.from_stream(stream, dataset / "stacks")

    class Torn(SceneLight):
        broken = False

        def weighted(self, span, lens):
            if Torn.broken:
                raise OSError(5, "Input/output error")
            return super().weighted(span, lens)

    light, there, back = capture.open_light(), np.linspace(0, 1, 800), np.linspace(1, 0, 800)
    torn = CapturedReadouts(capture, Torn(light.source, light.gain), region=WHOLE)
    alone = CapturedReadouts(capture, light, region=WHOLE)
    torn.encode_until(400, there)
    Torn.broken = True
    with pytest.raises(OSError, match="Input/output"):
        torn.encode_until(800, back)
    Torn.broken = False
    for captured in (torn, alone):
        captured.encode_until(800, back)
    assert np.array_equal(torn.window(0, 800), alone.window(0, 800))


def test_a_stream_that_somebody_wrote_cannot_be_captured_again(tmp_path):
    path = tmp_path / "own.h5"
    saf_gen.write_stream(path, np.zeros((16, 8, 8), np.uint8))
    with saf_gen.open_stream(path) as stream:
        error = refusal(Capture.from_stream, stream, tmp_path)
    assert error.where == str(path)
    assert "--track recorded" in error.hint


def test_without_its_stacks_it_cannot_be_captured_again(dataset, tmp_path):
    with saf_gen.open_stream(dataset / "test" / "plane-constant-00.h5") as stream:
        error = refusal(Capture.from_stream, stream, tmp_path)
    assert error.problem.startswith("there is no focal stack plane-")
    assert "keep stacks/" in error.hint


def test_other_stacks_are_refused(dataset, tmp_path):
    shutil.copytree(dataset, tmp_path / "copy")
    path = tmp_path / "copy" / "test" / "plane-constant-00.h5"
    with h5py.File(path, "r+") as file:
        del file["provenance/stack_digest"]
        file["provenance/stack_digest"] = "0" * 64
        del file.attrs["spikes_sha256"]  # otherwise opening would report the change
    with saf_gen.open_stream(path) as stream:
        error = refusal(Capture.from_stream, stream, tmp_path / "copy" / "stacks")
    assert str(tmp_path / "copy" / "stacks") in error.problem
    assert error.where == str(path)


def test_a_note_that_describes_another_stack_is_refused(dataset, tmp_path):
    shutil.copytree(dataset / "stacks", tmp_path / "stacks")
    with saf_gen.open_stream(dataset / "test" / "plane-constant-00.h5") as stream:
        note = tmp_path / "stacks" / stream.metadata.provenance["stack"] / "geometry.json"
        document = json.loads(note.read_text())
        document["spec"]["samples"] += 1
        note.write_text(json.dumps(document))
        assert str(note) in refusal(Capture.from_stream, stream, tmp_path / "stacks").problem


BEGINNING = capture_dataset.RECIPE.replace("[static, dynamic]", "[dynamic]").replace(
    "lights: [constant, lamp_only]", "lights: [lamp_only]"
)


@pytest.fixture(scope="module")
def without_whole_slices(tmp_path_factory):
    """A dataset of one moving sequence whose slices have only the visited positions. Do not change it."""
    with pytest.MonkeyPatch.context() as patch:
        recipe = BEGINNING.replace(", whole_slices: true", "")
        return capture_dataset.make_dataset(tmp_path_factory.mktemp("visited"), patch, recipe)


def test_slices_of_the_visited_positions_alone_are_refused(without_whole_slices):
    with saf_gen.open_stream(without_whole_slices / "test" / "plane-dynamic-lamp_only-00.h5") as stream:
        error = refusal(Capture.from_stream, stream, without_whole_slices / "stacks")
    assert "whole_slices: SECONDS" in error.hint


def test_slices_of_its_own_are_captured_from_the_beginning(without_whole_slices, tmp_path, monkeypatch):
    """For 20 of 40 ms. The recording is that of a recipe without them, so that they may be rendered later."""
    monkeypatch.setenv("SAF_GEN_SCENES", str(without_whole_slices.parent / "scenes"))
    folder = tmp_path / "takes"
    shutil.copytree(without_whole_slices, folder)
    path = folder / "test" / "plane-dynamic-lamp_only-00.h5"
    before = path.read_bytes()
    (tmp_path / "takes.yaml").write_text(BEGINNING.replace("whole_slices: true", "whole_slices: 0.02"))
    outcome = generate(resolve_recipe(tmp_path / "takes.yaml"), folder, variant=capture_dataset.VARIANT)
    assert (outcome.kept, outcome.recorded) == (["plane-dynamic-lamp_only-00"], [])
    assert len(outcome.rendered) == 6 * 3
    assert all("plane, dynamic, all positions" in piece for piece in outcome.rendered)
    assert path.read_bytes() == before
    with saf_gen.open_stream(path) as stream:
        capture = Capture.from_stream(stream, folder / "stacks")
        assert (capture.frames, len(capture.gain)) == (400, 800)
        assert [spec.rendered_count for spec in capture.plane_source.time_stack.specs] == [9] * 6
        frames = CapturedReadouts(capture, capture.open_light(), region=WHOLE)
        motion = json.loads(stream.metadata.provenance["sequence"])["motion"]
        frames.encode_until(400, lens_positions(motion, 800, readout_hz=stream.readout_hz))
        # The same light, through other paths: as many spikes, not the same ones.
        assert frames.window(0, 400).mean() == pytest.approx(stream.counts(0, 400, region=WHOLE).mean(), rel=0.01)
        assert ClosedLoopProtocol(get_actuator("voice_coil")).count_frames(capture)[0] == 400
        too_long = ClosedLoopProtocol(get_actuator("voice_coil"), budget_s=0.03)
        error = refusal(too_long.count_frames, capture)
        assert "30 ms" in error.problem
        assert error.allowed.startswith("0.8 to 20 ms")
        (task,) = select_sequences_to_evaluate(folder).tasks
        setting = ClosedLoopSequence.from_stream(task, stream, region="target")
        assert setting.data != stream.content_sha256
        note = next((folder / "stacks" / capture.plane_source.time_stack.specs[0].key).glob("lamp.json"))
        note.write_text(note.read_text().replace('"sha256": "', '"sha256": "0'))
        assert ClosedLoopSequence.from_stream(task, stream, region="target").data != setting.data
        shutil.rmtree(folder / "stacks" / capture.plane_source.time_stack.specs[3].key)
        assert Capture.from_stream(stream, folder / "stacks").frames == 160


@pytest.mark.parametrize(
    ("whole_s", "frames", "stacks"),
    [(9.0, 800, 11), (1e-4, 80, 13)],  # slices every 80 frames
)
def test_no_more_is_captured_than_was_recorded(tmp_path, monkeypatch, whole_s, frames, stacks):
    recipe = BEGINNING.replace("whole_slices: true", f"whole_slices: {whole_s}")
    folder = capture_dataset.make_dataset(
        tmp_path, monkeypatch, recipe.replace("slice_samples: 16", "slice_samples: 1")
    )
    assert len(list((folder / "stacks").iterdir())) == stacks
    with saf_gen.open_stream(folder / "test" / "plane-dynamic-lamp_only-00.h5") as stream:
        assert Capture.from_stream(stream, folder / "stacks").frames == frames
