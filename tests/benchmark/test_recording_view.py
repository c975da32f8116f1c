"""A method's view of a recording: counts, compared with sums of single frames, and their cost."""

import tracemalloc

import numpy as np
import pytest
from in_memory_stream import InMemory
from refusals import refusal

from saf_gen import get_measure, open_stream, write_stream
from saf_gen.benchmark.view.recording import RecordingView, WindowCounts
from saf_gen.core.seeds import make_generator


def list_windows(frames):
    """Return short, long, aligned and unaligned windows, and random ones."""
    drawn = make_generator("windows", frames).integers(0, frames, (40, 2)).tolist()
    edges = [(0, frames), (0, 1), (frames - 1, frames), (0, frames // 2), (frames // 3, frames)]
    eights = [(8 * (a // 8), 8 * (a // 8) + 8 * n) for a in (0, 63, 64, 65) for n in (1, 8, 9)]
    pairs = [*edges, *eights, *((min(a, b), max(a, b) + 1) for a, b in drawn)]
    return [(a, b) for a, b in pairs if a < b <= frames]


@pytest.mark.parametrize("frames", [1, 8, 63, 65, 2_040, 2_041, 4_099, 20_480])
@pytest.mark.parametrize("region", [None, (slice(1, 4), slice(2, 7))])
def test_counts_are_the_frames_added_up(frames, region):
    stream = InMemory(frames, 5, 8)
    counts = WindowCounts(stream, region)
    part = stream.spikes[:, *(region or (slice(None), slice(None)))]
    for first, stop in list_windows(frames):
        found = counts.window(first, stop)
        assert found.dtype == np.uint32
        np.testing.assert_array_equal(found, part[first:stop].sum(axis=0, dtype=np.uint32))


def test_long_windows_are_sums_of_knots_and_their_ends():
    stream = InMemory(20_480, 3, 4)
    counts = WindowCounts(stream)
    counts.window(0, 20_480)
    assert sum(stop - first for first, stop in stream.asked) >= 20_000  # sums at knots are counted once
    stream.asked.clear()
    for first, stop in list_windows(20_480):
        counts.window(first, stop)
        assert sum(b - a for a, b in stream.asked) < 200
        stream.asked.clear()


@pytest.mark.parametrize("kind", ["window", "intervals"])
def test_a_window_counted_before_is_not_counted_again_and_cannot_be_changed(kind):
    look = getattr(WindowCounts(InMemory(500, 3, 4)), kind)
    window = look(10, 300)
    assert look(10, 300) is window
    with pytest.raises(ValueError, match="read-only"):
        window += 1
    assert "400 to 501" in refusal(look, 400, 501).problem


class OneSpikeEach(InMemory):
    """A large sensor whose frames take no memory."""

    def __init__(self, frames, height, width):
        super().__init__(1, 1, 1)
        self.shape = (frames, height, width)

    def counts(self, first, stop, region, filled=True):
        return np.full(self.shape[1:], stop - first, np.uint32)


@pytest.mark.slow
def test_windows_kept_are_bounded_and_the_oldest_goes_first():
    """A window of this sensor takes 80 MiB, and three fit."""
    counts = WindowCounts(OneSpikeEach(40, 4096, 5120))
    windows = [counts.window(first, first + 10) for first in (0, 10, 20)]
    assert counts.window(0, 10) is windows[0]
    counts.window(30, 40)
    assert counts.window(0, 10) is windows[0]
    assert counts.window(10, 20) is not windows[1]


def test_sums_at_knots_stay_within_their_memory():
    """Sums of 128 MiB, and a few images of 4 MiB; 256 of them would take 1 GiB."""
    counts = WindowCounts(OneSpikeEach(20_480, 1024, 1024))
    tracemalloc.start()
    counts.window(0, 20_480)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert 100 << 20 < peak <= (128 + 5 * 4) << 20


def test_a_window_outside_the_recording_is_refused_and_costs_nothing():
    recording = RecordingView(WindowCounts(InMemory(100, 2, 2)), get_measure("sd"))
    error = refusal(recording.score, 0, 101)
    assert "0 to 101" in error.problem
    assert error.allowed.endswith("<= 100")
    assert (recording.scorer.windows, recording.now) == (0, 0)
    assert "rows" in refusal(WindowCounts, InMemory(10, 6, 9), (slice(5, 5), slice(None))).problem
    assert np.isnan(recording.position(3))  # nothing recorded the lens


@pytest.mark.parametrize("wrong", [float("nan"), float("inf")])
def test_a_score_that_is_no_number_is_refused(wrong):
    recording = RecordingView(WindowCounts(InMemory(10, 2, 2)), lambda counts: wrong)
    error = refusal(recording.score, 2, 7)
    assert f"frames 2 to 7 with {wrong}" in error.problem
    assert "finite number" in error.allowed


def test_a_recording_scores_what_its_measure_or_one_by_name_looks_at():
    stream = InMemory(300, 20, 30)
    recording = RecordingView(WindowCounts(stream), get_measure("sd"))
    counts, texture = stream.spikes[17:217].sum(axis=0), plain_texture(stream.spikes, 17, 217)
    assert recording.score(17, 217) == get_measure("sd")(counts)
    assert recording.score(17, 217, "tenengrad_n") == get_measure("tenengrad_n")(counts)
    assert recording.score(17, 217, "tenengrad_n_tfi") == get_measure("tenengrad_n")(texture)
    assert (recording.scorer.windows, recording.now, recording.frames) == (3, 217, 300)
    assert recording.scorer.seconds > 0
    assert refusal(recording.score, 17, 217, "tenengrat").nearest == "tenengrad"


def test_a_stream_file_gives_the_same_counts_and_textures(tmp_path):
    made = InMemory(2100, 12, 17, rate=0.05)
    write_stream(tmp_path / "made.h5", made.spikes)
    with open_stream(tmp_path / "made.h5") as stream:
        for region in (None, (slice(2, 9), slice(5, 17))):
            counts = WindowCounts(stream, region)
            for first, stop in list_windows(2100):
                part = made.spikes[first:stop, *(region or (slice(None), slice(None)))]
                np.testing.assert_array_equal(counts.window(first, stop), part.sum(axis=0))
        for first, stop in [(0, 2100), (990, 1010), (7, 8)]:
            part = made.spikes[:, 2:9, 5:17]
            np.testing.assert_array_equal(counts.intervals(first, stop), plain_texture(part, first, stop))


def test_a_recording_knows_its_time_and_the_lens_positions(tmp_path):
    path = tmp_path / "a.h5"
    frames = np.zeros((400, 8, 8), np.uint8)
    write_stream(path, frames, readout_hz=10_000, focus_position=np.linspace(0, 1, 400, dtype=np.float32))
    with open_stream(path) as stream:
        view = RecordingView(WindowCounts(stream), get_measure("er_count"))
        assert (view.frames, view.now, view.readout_hz) == (400, 0, 10_000)
        view.score(10, 40)
        view.score(0, 20)
        assert view.now == 40
        assert view.position(399) == 1.0
        for frame in (-1, 400):
            assert f"{frame} to {frame + 1}" in refusal(view.position, frame).problem
        for command, value in ((view.move, 0.5), (view.wait, 8)):
            error = refusal(command, value)
            assert str(value) in error.problem
            assert "closed_loop" in error.hint


# Texture from intervals.


def plain_texture(spikes, first, stop):
    """Return the texture from intervals pixel by pixel, by its definition."""
    middle, out = (first + stop - 1) // 2, np.zeros(spikes.shape[1:])
    for y, x in np.ndindex(out.shape):
        times = first + np.flatnonzero(spikes[first:stop, y, x])
        before, after = times[times <= middle], times[times > middle]
        if before.size and after.size:
            out[y, x] = (stop - first) / (after[0] - before[-1])
    return out


@pytest.mark.parametrize("frames", [1, 9, 65, 1000])
@pytest.mark.parametrize("rate", [0.02, 0.3])
def test_texture_from_intervals_follows_its_definition(frames, rate):
    stream = InMemory(frames, 5, 8, rate=rate)
    for region in (None, (slice(1, 4), slice(2, 7))):
        counts = WindowCounts(stream, region)
        part = stream.spikes[:, *(region or (slice(None), slice(None)))]
        for first, stop in list_windows(frames):
            found = counts.intervals(first, stop)
            assert found.dtype == np.float64
            np.testing.assert_array_equal(found, plain_texture(part, first, stop))


def test_a_regular_train_gives_its_rate_exactly_wherever_the_window_lies():
    """One spike every p readouts gives n/p spikes in n frames, at any phase; counts are off by up to one."""
    stream = InMemory(400, 4, 30)
    t, period = np.arange(400)[:, None, None], 1 + np.arange(30)
    stream.spikes = ((t + 3 * np.arange(4)[:, None]) % period == 0).astype(np.uint8)
    counts = WindowCounts(stream)
    for first, stop in [(0, 100), (13, 90), (100, 163), (37, 399), (335, 400)]:
        rate = np.broadcast_to((stop - first) / period, (4, 30))
        np.testing.assert_array_equal(counts.intervals(first, stop), rate)
        assert np.abs(counts.window(first, stop) - rate).max() < 1


def test_the_interval_between_two_lone_spikes_is_found_over_any_distance():
    stream = InMemory(20_000, 1, 3)
    stream.spikes = np.zeros((20_000, 1, 3), np.uint8)
    stream.spikes[[3, 19_990], 0, 0] = 1
    stream.spikes[[3, 9000], 0, 1] = 1  # no spike after the middle
    image = WindowCounts(stream).intervals(0, 20_000)
    np.testing.assert_array_equal(image, [[20_000 / 19_987, 0, 0]])


def test_no_more_is_read_than_the_intervals_need():
    stream = InMemory(4000, 6, 6, rate=0.3)
    stream.spikes[:, 0] = 0  # pixels that never fire must not prolong reading
    WindowCounts(stream).intervals(0, 4000)
    assert sum(stop - first for first, stop in stream.read) <= 2 * 24
    stream.read.clear()
    WindowCounts(stream).intervals(1003, 1017)
    assert all(1003 // 8 <= first < stop <= 1017 // 8 + 1 for first, stop in stream.read)


def test_a_search_may_look_at_the_counts_that_a_measure_would_score():
    counts = WindowCounts(InMemory(500, 3, 4))
    view = RecordingView(counts, get_measure("sd"))
    picture = view.counts(10, 60)
    np.testing.assert_array_equal(picture, counts.window(10, 60))
    assert (view.now, view.scorer.windows) == (60, 1)
    with pytest.raises(ValueError, match="read-only"):
        picture += 1
    assert "490 to 501" in refusal(view.counts, 490, 501).problem
