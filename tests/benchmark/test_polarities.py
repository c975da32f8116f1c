"""Events by polarity in a method's view: of a recording, in the closed loop, by a guest, and where there are none."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from in_memory_stream import InMemory
from refusals import refusal

import saf_gen
from saf_gen import get_search
from saf_gen.benchmark.admission import admit_method, run_method
from saf_gen.benchmark.conformance import check_search
from saf_gen.benchmark.method_spec import parse_method
from saf_gen.benchmark.view.clock import Clock
from saf_gen.benchmark.view.held import HeldFrames, SpikePlanes
from saf_gen.benchmark.view.recording import RecordingView, WindowCounts
from saf_gen.benchmark.view.running_camera import RunningCamera, SweepView
from saf_gen.optics.actuators import get_actuator
from saf_gen.parts import wants_polarities
from saf_gen.stream.event_file import EventColumns, EventWriter
from saf_gen.stream.metadata import Metadata, Truth
from saf_gen.stream.recordings import open_recording

FRAMES, ROWS, COLUMNS, HZ = 4000, 6, 9, 20_000
FOCUS = 1432.0
"""Readout about which the polarities of the file mirror each other."""
IDEAL = get_actuator("ideal")


@pytest.fixture(scope="module")
def columns():
    """Events that rise before the focus as they fall after it, and leaks that all rise."""
    random = np.random.default_rng(5)
    away = np.abs(random.normal(0, 25e3, 9000))
    focus_us = (FOCUS + 0.5) / HZ * 1e6
    t = np.concatenate([focus_us - away, focus_us + away, random.uniform(0, 200e3, 2000)])
    p = np.repeat([1, 0, 1], [9000, 9000, 2000])
    inside = (t >= 0) & (t < 200e3)
    order = np.argsort(t[inside], kind="stable")
    n = len(order)
    return EventColumns(
        random.integers(0, COLUMNS, n).astype(np.uint16), random.integers(0, ROWS, n).astype(np.uint16),
        t[inside][order].astype(np.uint32), p[inside][order].astype(np.uint8),
    )  # fmt: skip


@pytest.fixture(scope="module")
def path(columns, tmp_path_factory):
    path = tmp_path_factory.mktemp("polarities") / "events.h5"
    lens = np.linspace(0, 1, FRAMES, dtype=np.float32)
    metadata = Metadata(focus_position=lens, truth=Truth(position=float(lens[int(FOCUS)])))
    with EventWriter(path, shape=(FRAMES, ROWS, COLUMNS), readout_hz=HZ, metadata=metadata) as writer:
        writer.write(columns)
    return path


@pytest.fixture(scope="module")
def recorded(path):
    with open_recording(path) as recording:
        yield recording


def by_event(columns, first, stop):
    """The events of readouts, one by one: (2, rows, columns)."""
    found = np.zeros((2, ROWS, COLUMNS), np.uint32)
    for x, y, t, p in zip(*columns, strict=True):
        if first * 50 <= t < stop * 50:
            found[p, y, x] += 1
    return found


@pytest.mark.parametrize(("first", "stop"), [(0, 4000), (0, 1), (1430, 1433), (37, 2111), (3999, 4000)])
@pytest.mark.parametrize("region", [None, (slice(1, 4), slice(2, 9))])
def test_polarities_are_the_events_one_by_one(recorded, columns, first, stop, region):
    wanted = by_event(columns, first, stop)[:, *(region or (slice(None), slice(None)))]
    found = recorded.polarities(first, stop, region=region)
    assert found.dtype == np.uint32
    np.testing.assert_array_equal(found, wanted)
    seen = RecordingView(WindowCounts(recorded, region), None).polarities(first, stop)
    np.testing.assert_array_equal(seen, wanted)
    assert not seen.flags.writeable
    np.testing.assert_array_equal(seen.sum(axis=0), recorded.counts(first, stop, region=region))


def test_polarities_cost_as_much_as_counts(recorded):
    looks = []
    for look in ("counts", "polarities"):
        view = RecordingView(WindowCounts(recorded), None)
        getattr(view, look)(10, 300)
        looks.append((view.now, view.scorer.windows, view.scorer.operations))
    assert looks[0] == looks[1]
    assert looks[0][:2] == (300, 1)


class EventsInMemory:
    """What a running camera captured: a fall in every readout of pixel 0, and a rise in every second one of pixel 1."""

    shape, textures_s = (1, 2), 0.0

    def encode_until(self, stop, position):
        self.stop = stop

    def window(self, first, stop):
        return self.polarities(first, stop).sum(axis=0, dtype=np.uint32)

    def polarities(self, first, stop):
        assert stop <= self.stop
        t = np.arange(first, stop)
        return np.array([[[len(t), 0]], [[0, (t % 2).sum()]]], np.uint32)


def test_a_running_camera_and_its_sweep_count_frames_each_for_themselves():
    camera = RunningCamera(EventsInMemory(), None, actuator=IDEAL, start=0.0, seed=1, budget=800, clock=Clock(HZ))
    assert camera.polarities(1, 10).tolist() == [[[9, 0]], [[0, 5]]]
    assert (camera.now, camera.scorer.windows) == (16, 1)
    sweep = SweepView(camera, begin=0.0, end=1.0, frames=400)
    assert sweep.polarities(0, 3).tolist() == [[[3, 0]], [[0, 1]]]
    assert (sweep.now, camera.now) == (8, 24)
    assert sweep.polarities(0, 3).sum() == sweep.counts(0, 3).sum()


@pytest.mark.parametrize(
    ("first", "stop"), [(0, 0), (-1, 5), (5, 4001), (7, 3), (4000, 4001), (0.5, 2), (True, 0), (0, 10**12)]
)
def test_windows_that_are_none_are_refused_as_those_of_counts(recorded, first, stop):
    view = RecordingView(WindowCounts(recorded), None)
    assert str(refusal(view.polarities, first, stop)) == str(refusal(view.counts, first, stop))


def test_what_has_no_polarity_says_so_in_a_line(tmp_path):
    stores = [
        WindowCounts(InMemory(100, 3, 4)), SpikePlanes(np.zeros((4, 3, 4), np.uint8)),
        HeldFrames(SimpleNamespace(sensor=None), (slice(0, 3), slice(0, 4))),
    ]  # fmt: skip
    for store in stores:
        assert "this camera has no events, and so no polarities" in str(refusal(store.polarities, 0, 8))
    view = RecordingView(stores[0], None)
    answer, problem = run_method(parse_method("sd+pbf_events:window=10"), view, scorer=view.scorer)
    assert answer.frame is None
    assert "so no polarities; allowed: polarities of an event camera" in problem
    assert view.scorer.windows == 0


GUEST = """
from saf_gen.parts import Answer

class Mirror:
    def __call__(self, view):
        falls, rises = view.polarities(1000, 1800)
        return Answer(float(rises.sum()), (float(falls[2, 3]), float(view.now)))
"""


@pytest.mark.slow
def test_a_guest_sees_what_a_method_of_ours_sees(recorded, columns, tmp_path):
    (tmp_path / "mine.py").write_text(GUEST)
    method = admit_method(f"er_count+{tmp_path}/mine.py:Mirror", None)
    try:
        view = RecordingView(WindowCounts(recorded), None)
        answer, problem = run_method(method, view, scorer=view.scorer)
        wanted = by_event(columns, 1000, 1800)
        assert problem == ""
        assert (answer.frame, *answer.trace) == (wanted[1].sum(), wanted[0, 2, 3], 1800)
        spikes = RecordingView(WindowCounts(InMemory(2000, 3, 4)), None)
        _, problem = run_method(method, spikes, scorer=spikes.scorer)
        assert "this camera has no events, and so no polarities" in problem
    finally:
        method.guest.close()


def pbf_one_by_one(columns, window):
    """The frame about which rates of both polarities in blocks mirror each other best, over all centres."""
    blocks = FRAMES // window
    rates = np.zeros((2, blocks))
    for t, p in zip(columns.t, columns.p, strict=True):
        if t // 50 < blocks * window:
            rates[p, t // 50 // window] += 1
    n, p = (rate - rate.mean() for rate in rates)
    sums = {}
    for twice in range(2 * blocks - 1):
        sums[twice / 2] = sum(p[i] * n[twice - i] for i in range(blocks) if 0 <= twice - i < blocks)
    return max(sums, key=sums.get) * window + (window - 1) / 2


@pytest.mark.parametrize("window", [100, 33, 250])
def test_pbf_answers_with_the_mirror_of_true_polarities(recorded, columns, window):
    view = RecordingView(WindowCounts(recorded), None)
    answer = get_search("pbf_events", window=window)(view)
    assert answer.frame == pbf_one_by_one(columns, window)
    assert answer.frame == pytest.approx(FOCUS, abs=window / 2 + 10)
    assert view.now == FRAMES // window * window


@pytest.mark.parametrize(("kept", "note"), [(1, "no events of both polarities"), (0, "no events of both polarities")])
def test_pbf_of_events_abstains_where_a_polarity_is_missing(columns, tmp_path, kept, note):
    of_one = EventColumns(*(column[columns.p == kept] for column in columns))
    with EventWriter(tmp_path / "e.h5", shape=(FRAMES, ROWS, COLUMNS), readout_hz=HZ, metadata=Metadata()) as writer:
        writer.write(of_one)
    with open_recording(tmp_path / "e.h5") as recording:
        answer = get_search("pbf_events")(RecordingView(WindowCounts(recording), None))
    assert (answer.frame, answer.note) == (None, note)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"window": 0}, "at least 1"), ({"window": -1}, "at least 1"), ({"window": 2.5}, "window is 2.5"),
        ({"window": True}, "at least 1"), ({"window": "100"}, "at least 1"), ({"window": float("nan")}, "at least 1"),
        ({"windows": 10}, "window"), ({"contrast": 0.2}, "window"),
    ],
)  # fmt: skip
def test_options_of_pbf_of_events_that_are_none_are_refused(options, words):
    assert words in str(refusal(get_search, "pbf_events", **options))


def test_it_says_what_it_needs_and_conforms():
    assert wants_polarities(get_search("pbf_events"))
    assert not wants_polarities(get_search("pbf"))
    assert [found for found in check_search(get_search("pbf_events")) if found.level == "error"] == []


def released_egs(t_s, threshold_s):
    """Event-based golden search over the times of events, seconds: the instant amid the last window that was better.

    Each step has the events of an interval, whose ends are events. Its rate over 0.618 of it from the beginning, and
    from 0.381 on, are compared; the better window goes on, up to the first event after it. A step is the last if its
    interval is no longer than the threshold.
    """
    begin, end = t_s[0], t_s[-1]
    while True:
        inside = [t for t in t_s if begin <= t <= end]
        width = inside[-1] - inside[0]
        kept = 0.618 * width
        found = []
        for start in (inside[0], inside[0] + 0.381 * width):
            rate = sum(start < t <= start + kept for t in inside) / kept
            found.append((rate, start + kept / 2, next(t for t in inside if t > start + kept)))
        _, answer, end = found[0] if found[0][0] >= found[1][0] else found[1]
        begin = end - kept
        if width <= threshold_s:
            return answer


@pytest.mark.parametrize("peak_s", [0.0513, 0.0777, 0.0901, 0.1012, 0.1333, 0.1479])
def test_egs_on_events_narrows_as_the_released_search_does(tmp_path, peak_s):
    """The released search steps from event to event and stops at 1 ms; ours cuts at readouts of 50 µs.

    It also takes 0.381 where ours takes 0.382, and begins at the first event. Together that moves the answer by no more
    than the last interval, 1 ms, where the events are as even as their rate; of random events, chance decides between
    the last windows.
    """
    random, at = np.random.default_rng(1), np.linspace(0, 0.2, 200_001)
    events_so_far = np.cumsum(0.02 + np.exp(-(((at - peak_s) / 0.02) ** 2)))
    share = (np.arange(40_000) + 0.5) / 40_000
    t = (np.interp(share, events_so_far / events_so_far[-1], at) * 1e6).astype(np.uint32)
    pixel = random.integers(0, ROWS * COLUMNS, len(t))
    events = EventColumns(pixel % COLUMNS, pixel // COLUMNS, t, random.integers(0, 2, len(t)))
    with EventWriter(tmp_path / "e.h5", shape=(FRAMES, ROWS, COLUMNS), readout_hz=HZ, metadata=Metadata()) as writer:
        writer.write(events)
    method = parse_method("er_count+egs_code:threshold=20")
    with open_recording(tmp_path / "e.h5") as recording:
        view = RecordingView(WindowCounts(recording), method.measure)
        answer = method.search(view)
    wanted = released_egs((t / 1e6).tolist(), 1e-3)
    assert abs((answer.frame + 0.5) / HZ - wanted) <= 1e-3
    assert abs(wanted - peak_s) < 1e-3


@pytest.mark.slow
def test_methods_that_need_what_the_camera_does_not_see_are_refused(captured_dataset, tmp_path, call):
    target = tmp_path / "events"
    assert call("recapture", captured_dataset, "--out", target, "--sequence", "plane-constant-00")[0] == 0
    for track in ("recorded", "closed_loop"):
        for method, words in (
            ("er_count+pbf", "makes events of spikes, and these recordings hold events"),
            ("er_count+pbf:window=50", "use pbf_events"),
            ("er_count+pbf:reject=true", "use pbf_events"),
            ("sd+elp", "makes events of spikes, and these recordings hold events"),
            ("er_count+elp@frame", "use elp_events"),
            ("change_rate+pbf_events", "makes events of spikes"),
        ):
            code, _, error = call("evaluate", target, "--track", track, "--method", method, "--out", tmp_path / "none")
            assert (code, words in error, error.count("\n")) == (2, True, 1), error
            assert not (tmp_path / "none").exists()
    for method in ("sd+pbf_events", "sd_debiased+pbf_events", "sd+pbf_events:window=50", "sd+pbf_events:reject=true"):
        code, _, error = call("evaluate", captured_dataset, "--method", method, "--out", tmp_path / "none")
        assert (code, "needs events with their polarities, and these recordings hold spikes" in error) == (2, True), (
            error
        )
        assert not (tmp_path / "none").exists()


@pytest.mark.slow
def test_polarities_are_judged_on_both_tracks(captured_dataset, tmp_path, call):
    target = tmp_path / "events"
    assert call("recapture", captured_dataset, "--out", target, "--sequence", "plane-constant-00")[0] == 0
    for track in ("recorded", "closed_loop"):
        out = tmp_path / track
        arguments = ("--track", track, "--method", "er_count+pbf_events:window=20", "--out", out)
        actuator = () if track == "recorded" else ("--actuator", "ideal")
        code, output, error = call("evaluate", target, *arguments, *actuator)
        assert code == 0, output + error
        (record,) = [json.loads(line) for line in (out / "records.jsonl").read_text().splitlines()]
        assert record["status"] == "answered", record["note"]
        assert abs(record["error_dof"]) < 4
    with saf_gen.open_events(target / "test/plane-constant-00.h5") as events:
        assert events.polarities(0, 0.04).sum() == events.count
