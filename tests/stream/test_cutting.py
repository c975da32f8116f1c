"""Parts of a stream hold the same spikes, and a truth that counts from their beginning."""

import json

import numpy as np
import pytest
from planted_sweeps import make_spikes
from refusals import refusal

from saf_gen.benchmark.evaluate import evaluate
from saf_gen.stream.cutting import cut_stream
from saf_gen.stream.metadata import Truth
from saf_gen.stream.stream_file import open_stream
from saf_gen.stream.stream_writer import write_stream

FRAMES, PEAK = 800, 300
SPIKES = make_spikes(PEAK, shape=(FRAMES, 12, 20))
LENS = np.linspace(0, 1, FRAMES, dtype=np.float32)
TARGET = np.zeros((12, 20), bool)
TARGET[2:8, 5:15] = True


def write(path, **more):
    truth = Truth(PEAK / (FRAMES - 1), (0.3, 0.45), float(PEAK), target=TARGET, sharpness=np.ones(5), **more)
    gain = np.linspace(1, 2, FRAMES, dtype=np.float32)[:, None]
    provenance = {"sensor": "name: ideal", "recipe": "x", "benchmark": "y"}
    write_stream(
        path, SPIKES, focus_position=LENS, gain=gain, light_names=("lamp",), truth=truth, provenance=provenance
    )
    return path


def test_a_part_that_is_the_whole_has_the_same_content(tmp_path):
    source = write(tmp_path / "a.h5")
    with open_stream(source) as stream:
        assert cut_stream(source, tmp_path / "b.h5") == stream.content_sha256


@pytest.mark.parametrize(("first", "stop"), [(0, 8), (3, 411), (301, 800), (799, 800), (123, 124), (0, 800)])
def test_spikes_lens_and_light_are_those_of_the_part(tmp_path, first, stop):
    box = (slice(1, 9), slice(4, 17))
    cut_stream(write(tmp_path / "a.h5"), tmp_path / "b.h5", first=first, stop=stop, region=box)
    with open_stream(tmp_path / "b.h5") as part:
        assert np.array_equal(part.frames(0, stop - first), SPIKES[first:stop, 1:9, 4:17])
        assert np.array_equal(part.focus_position, LENS[first:stop])
        assert part.gain.shape == (stop - first, 1)
        assert np.array_equal(part.truth.target, TARGET[1:9, 4:17])
        assert part.truth.sharpness is None
        assert part.truth.frame == pytest.approx(PEAK - first) if first <= PEAK < stop else np.isnan(part.truth.frame)


@pytest.mark.parametrize(("first", "columns", "kept"), [(100, slice(0, 20), True), (0, slice(0, 19), False)])
def test_what_is_inside_the_target_stays_only_where_rows_and_columns_do(tmp_path, first, columns, kept):
    write(tmp_path / "a.h5", inside=(3, 7, 6, 14), sharpness_inside=np.arange(5.0))
    cut_stream(tmp_path / "a.h5", tmp_path / "b.h5", first=first, region=(slice(0, 12), columns))
    with open_stream(tmp_path / "b.h5") as part:
        assert part.truth.inside == ((3, 7, 6, 14) if kept else None)
        assert (part.truth.sharpness_inside is not None) == kept


def test_a_part_of_a_moving_scene_does_not_state_what_was_inside_its_target(tmp_path):
    write(tmp_path / "a.h5", inside=(3, 7, 6, 14), track=np.linspace(0.3, 0.4, FRAMES, dtype=np.float32))
    cut_stream(tmp_path / "a.h5", tmp_path / "b.h5", first=8)
    with open_stream(tmp_path / "b.h5") as part:
        assert part.truth.inside is None


def test_a_part_of_a_part_is_that_part(tmp_path):
    write(tmp_path / "a.h5")
    cut_stream(tmp_path / "a.h5", tmp_path / "b.h5", first=100, stop=700, region=(slice(1, 11), slice(2, 19)))
    twice = cut_stream(tmp_path / "b.h5", tmp_path / "c.h5", first=50, stop=400, region=(slice(1, 9), slice(0, 10)))
    once = cut_stream(tmp_path / "a.h5", tmp_path / "d.h5", first=150, stop=500, region=(slice(2, 10), slice(2, 12)))
    assert twice == once


def test_an_answer_in_a_part_has_the_error_of_the_whole(tmp_path):
    source = write(tmp_path / "a.h5")
    cut_stream(source, tmp_path / "b.h5", first=100, stop=700)
    (whole,), (part,) = (evaluate(tmp_path / f"{n}.h5", methods=["sd+argmax:window=100"]).records for n in "ab")
    assert part.judgement.frame == whole.judgement.frame - 100
    assert part.judgement.error == pytest.approx(whole.judgement.error, abs=1e-6)
    assert part.judgement.truth_frame == pytest.approx(whole.judgement.truth_frame - 100)


def test_the_truth_of_a_moving_target_is_that_of_its_first_passing_in_the_part(tmp_path):
    """The lens passes a drifting focus in frame 200, comes back and passes it again."""
    lens = np.concatenate([np.linspace(0, 0.8, 400), np.linspace(0.8, 0, 400)]).astype(np.float32)
    track = np.linspace(0.3, 0.5, FRAMES, dtype=np.float32)
    frame = float(np.flatnonzero(lens > track)[0]) - 0.5
    truth = Truth(float(np.interp(frame, np.arange(FRAMES), track)), (0.2, 0.6), frame, track=track)
    write_stream(tmp_path / "a.h5", SPIKES, focus_position=lens, truth=truth)
    cut_stream(tmp_path / "a.h5", tmp_path / "b.h5", first=400)
    with open_stream(tmp_path / "b.h5") as part:
        again = int(np.flatnonzero(lens[400:] < track[400:])[0])
        assert again - 1 <= part.truth.frame <= again
        assert part.truth.position == pytest.approx(
            np.interp(400 + part.truth.frame, np.arange(FRAMES), track), abs=1e-6
        )


def test_the_provenance_of_a_part_names_the_stream_and_not_its_recipe(tmp_path):
    source = write(tmp_path / "a.h5")
    cut_stream(source, tmp_path / "b.h5", first=8)
    with open_stream(source) as whole, open_stream(tmp_path / "b.h5") as part:
        assert set(part.metadata.provenance) == {"sensor", "cut"}
        assert json.loads(part.metadata.provenance["cut"])["stream"] == whole.content_sha256


def test_the_command_cuts(tmp_path, call):
    write(tmp_path / "a.h5")
    options = ("--from", 100, "--to", 500, "--rows", "2:10", "--columns", ":12")
    code, out, _ = call("cut", tmp_path / "a.h5", "--out", tmp_path / "b.h5", *options)
    assert code == 0
    assert "400 frames of 12×8" in out
    for bad in (["--to", 900], ["--from", 800], ["--rows", "5"], ["--rows", "9:2"], ["--columns", "0:21"]):
        assert call("cut", tmp_path / "a.h5", "--out", tmp_path / "c.h5", *bad)[0] == 2
    assert not (tmp_path / "c.h5").exists()
    assert refusal(cut_stream, tmp_path / "a.h5", tmp_path / "a.h5").hint == "choose another output file"
