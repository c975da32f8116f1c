"""A sequence filmed again from its stacks: the same lens sees the same spikes."""

import json
import shutil

import h5py
import numpy as np
import pytest
import take_dataset

import saf_gen
from saf_gen.actuators import get_actuator
from saf_gen.contest.terms import Terms
from saf_gen.errors import BadInput
from saf_gen.motions import readout_positions
from saf_gen.rig import Counts
from saf_gen.rig.film import Film, rows_of
from saf_gen.take import Take


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        yield take_dataset.make(tmp_path_factory.mktemp("take"), patch)


@pytest.mark.parametrize("name", ["plane-constant-00", "plane-lamp_only-00", "plane-dynamic-lamp_only-00"])
@pytest.mark.parametrize("region", [(slice(0, 40), slice(0, 64)), (slice(7, 22), slice(5, 60))])
def test_the_same_lens_sees_the_same_spikes(dataset, name, region):
    with saf_gen.open_stream(dataset / "test" / f"{name}.h5") as stream:
        take = Take.of(stream, dataset / "stacks")
        motion = json.loads(stream.metadata.provenance["sequence"])["motion"]
        position = readout_positions(motion, take.frames, stream.readout_hz)
        film = Film(take, take.exposed(rows_of(take, region)), region)
        for stop in (8, 96, 800):  # whatever the pieces
            film.develop(stop, position)
        for first, last in ((0, 800), (3, 5), (90, 210)):
            assert np.array_equal(film.window(first, last), stream.counts(first, last, region))


def test_another_lens_sees_other_spikes(dataset):
    with saf_gen.open_stream(dataset / "test" / "plane-constant-00.h5") as stream:
        take = Take.of(stream, dataset / "stacks")
        film = Film(take, take.exposed(), (slice(0, 40), slice(0, 64)))
        film.develop(800, np.full(800, 0.9))
        assert not np.array_equal(film.window(0, 100), stream.counts(0, 100))


def test_a_stream_that_somebody_wrote_cannot_be_filmed_again(tmp_path):
    path = tmp_path / "own.h5"
    saf_gen.write_stream(path, np.zeros((16, 8, 8), np.uint8))
    with (
        saf_gen.open_stream(path) as stream,
        pytest.raises(BadInput, match=r"does not tell how to film it again.*use --track recorded"),
    ):
        Take.of(stream, tmp_path)


def test_without_its_stacks_it_cannot_be_filmed_again(dataset, tmp_path):
    with (
        saf_gen.open_stream(dataset / "test" / "plane-constant-00.h5") as stream,
        pytest.raises(BadInput, match=r"there is no focal stack plane-.*keep stacks/ beside the streams"),
    ):
        Take.of(stream, tmp_path)


def test_other_stacks_are_refused(dataset, tmp_path):
    shutil.copytree(dataset, tmp_path / "copy")
    path = tmp_path / "copy" / "test" / "plane-constant-00.h5"
    with h5py.File(path, "r+") as file:
        del file["provenance/stack_digest"]
        file["provenance/stack_digest"] = "0" * 64
    with (
        saf_gen.open_stream(path) as stream,
        pytest.raises(BadInput, match="are not those it was made from"),
    ):
        Take.of(stream, tmp_path / "copy" / "stacks")


def test_a_note_that_tells_of_another_stack_is_refused(dataset, tmp_path):
    shutil.copytree(dataset / "stacks", tmp_path / "stacks")
    with saf_gen.open_stream(dataset / "test" / "plane-constant-00.h5") as stream:
        note = tmp_path / "stacks" / stream.metadata.provenance["stack"] / "geometry.json"
        said = json.loads(note.read_text())
        said["spec"]["samples"] += 1
        note.write_text(json.dumps(said))
        with pytest.raises(BadInput, match="tells of another stack"):
            Take.of(stream, tmp_path / "stacks")


def test_slices_of_the_passed_positions_alone_are_refused(tmp_path, monkeypatch):
    recipe = take_dataset.RECIPE.replace(", whole_slices: true", "").replace("lamp_only]", "constant]", 1)
    recipe = recipe.replace(
        "[constant, constant], scene_motion: [static, dynamic]", "[constant], scene_motion: [dynamic]"
    )
    folder = take_dataset.make(tmp_path, monkeypatch, recipe)
    with (
        saf_gen.open_stream(folder / "test" / "plane-dynamic-constant-00.h5") as stream,
        pytest.raises(
            BadInput, match=r"only the positions that the recorded sweep passed.*whole_slices: SECONDS"
        ),
    ):
        Take.of(stream, folder / "stacks")


def test_whole_slices_in_the_beginning_can_be_filmed_so_long(tmp_path, monkeypatch):
    """20 of 40 ms; the sweep sees the spikes of the recording until then."""
    recipe = take_dataset.RECIPE.replace("whole_slices: true", "whole_slices: 0.02")
    recipe = recipe.replace(
        "[constant, lamp_only], scene_motion: [static, dynamic]", "[lamp_only], scene_motion: [dynamic]"
    )
    folder = take_dataset.make(tmp_path, monkeypatch, recipe)
    with saf_gen.open_stream(folder / "test" / "plane-dynamic-lamp_only-00.h5") as stream:
        take = Take.of(stream, folder / "stacks")
        assert (take.frames, len(take.gain)) == (400, 800)
        held = [spec.rendered for spec in take.footage.reel.specs]
        assert held[:6] == [9] * 6
        assert max(held[6:]) < 9
        region = slice(0, 40), slice(0, 64)
        film = Film(take, take.exposed(), region)
        motion = json.loads(stream.metadata.provenance["sequence"])["motion"]
        film.develop(400, readout_positions(motion, 800, stream.readout_hz))
        assert np.array_equal(film.window(0, 400), stream.counts(0, 400, region))
        assert Terms(get_actuator("voice_coil")).frames(take)[0] == 400
        with pytest.raises(
            BadInput,
            match=r"a budget of 30 ms.*0\.8 to 20 ms, as long as its time slices hold all focus positions",
        ):
            Terms(get_actuator("voice_coil"), budget_s=0.03).frames(take)


@pytest.mark.parametrize(
    ("whole_s", "frames"),
    [(0.0399, 800), (9.0, 800), (1e-4, 80)],  # slices every 80 frames
)
def test_no_more_is_filmed_than_was_recorded(tmp_path, monkeypatch, whole_s, frames):
    recipe = take_dataset.RECIPE.replace("whole_slices: true", f"whole_slices: {whole_s}")
    recipe = recipe.replace("lights: [constant, lamp_only]", "lights: [constant]")
    recipe = recipe.replace("[static, dynamic]", "[dynamic]").replace("slice_samples: 16", "slice_samples: 1")
    folder = take_dataset.make(tmp_path, monkeypatch, recipe)
    with saf_gen.open_stream(folder / "test" / "plane-dynamic-constant-00.h5") as stream:
        assert Take.of(stream, folder / "stacks").frames == frames


def test_halves_and_intervals_are_those_of_a_recording(dataset):
    with saf_gen.open_stream(dataset / "test" / "plane-constant-00.h5") as stream:
        take = Take.of(stream, dataset / "stacks")
        motion = json.loads(stream.metadata.provenance["sequence"])["motion"]
        film = Film(take, take.exposed(), (slice(0, 40), slice(0, 64)))
        film.develop(800, readout_positions(motion, take.frames, stream.readout_hz))
        counts = Counts(stream)
        for first, last in ((0, 800), (3, 61)):
            assert np.array_equal(film.halves(first, last), counts.halves(first, last))
            assert np.array_equal(film.intervals(first, last), counts.intervals(first, last))
        with pytest.raises(BadInput, match="has no halves"):
            film.halves(5, 6)
