"""Searches on true events: golden search against the released algorithm, PBF and ELP against slow twins."""

import itertools

import numpy as np
import pytest
from refusals import refusal

from saf_gen import get_measure, get_search
from saf_gen.benchmark.view.recording import RecordingView, WindowCounts
from saf_gen.core.seeds import make_generator
from saf_gen.plugins.searches.elp_events import signed_product
from saf_gen.stream.event_file import EventColumns, EventWriter
from saf_gen.stream.metadata import Metadata, Truth
from saf_gen.stream.recordings import open_recording

HZ, READOUT_US, SHAPE = 20_000, 50, (8000, 12, 15)
FOCUS = 4900  # readouts


def write(path, x, y, t, p):
    order = np.argsort(t, kind="stable")
    metadata = Metadata(focus_position=np.linspace(0, 1, SHAPE[0], dtype=np.float32), truth=Truth(position=0.6))
    with EventWriter(path, shape=SHAPE, readout_hz=HZ, metadata=metadata) as writer:
        columns = (
            np.asarray(x, np.uint16),
            np.asarray(y, np.uint16),
            np.asarray(t, np.uint32),
            np.asarray(p, np.uint8),
        )
        writer.write(EventColumns(*(column[order] for column in columns)))
    return path


def bell(seed, *, step=1, number=4000, width=900):
    """Times of events about the focus and of noise, microseconds, in multiples of ``step``."""
    random = make_generator("test_searches_on_events", seed)
    about = random.normal(FOCUS, width, number) * READOUT_US
    t = np.concatenate([about, random.uniform(0, SHAPE[0] * READOUT_US, number // 4)])
    t = np.sort(t[(t >= 0) & (t < SHAPE[0] * READOUT_US)])
    return (t // step).astype(int) * step


def released_golden_search(t, threshold):
    """The algorithm of eaf_code, event by event; ``t`` rises. Returns the middles of the intervals, and the answer."""
    begin, end, middles = t[0], t[-1], []
    while True:
        held = [time for time in t if begin <= time <= end]
        start, length = held[0], held[-1] - held[0]
        middles.append((held[0] + held[-1]) / 2)
        delta = length * 0.618
        windows = [start, start + length * 0.381]
        rates, after, centres = [], [], []
        for first in windows:
            rates.append(sum(first < time <= first + delta for time in held) / delta)
            after.append(next(time for time in held if time > first + delta))
            centres.append(next(time for time in held if time >= first + delta / 2))
        best = rates.index(max(rates))
        if length <= threshold:
            return middles, centres[best]
        begin, end = after[best] - delta, after[best]


def run(path, name, **options):
    with open_recording(path) as recording:
        view = RecordingView(WindowCounts(recording), get_measure("er_count"))
        return get_search(name, **options)(view), view


@pytest.mark.parametrize("seed", ["a", "b", "c", "d"])
@pytest.mark.parametrize("threshold_s", [0.001, 0.01])
def test_golden_search_is_the_released_one_step_by_step(tmp_path, seed, threshold_s):
    t = bell(seed, step=READOUT_US)
    path = write(tmp_path / "events.h5", t % 15, t % 12, t, t % 2)
    answer, _ = run(path, "egs_events", threshold_s=threshold_s)
    middles, centre = released_golden_search((t // READOUT_US).tolist(), threshold_s * HZ)
    assert list(answer.trace) == middles
    assert answer.frame == centre
    assert len(middles) > 5
    assert abs(answer.frame - FOCUS) < 900


@pytest.mark.parametrize("seed", ["a", "b", "c", "d"])
def test_on_times_of_microseconds_the_narrowing_is_the_same_to_a_few_frames(tmp_path, seed):
    t = bell(seed)
    path = write(tmp_path / "events.h5", t % 15, t % 12, t, t % 2)
    answer, _ = run(path, "egs_events", threshold_s=0.05)  # thousands of frames down to a thousand: rates differ
    middles, centre = released_golden_search(t.tolist(), 0.05e6)
    assert len(answer.trace) == len(middles)
    np.testing.assert_allclose(answer.trace, np.array(middles) / READOUT_US - 0.5, atol=10)
    assert answer.frame == pytest.approx(centre / READOUT_US, abs=10)


def test_the_golden_search_of_spikes_differs_where_the_docstring_says(tmp_path):
    """Its interval is the recording, not the time from the first event to the last."""
    t = np.array([40, 41, 42, 43]) * 1000
    path = write(tmp_path / "events.h5", t % 15, t % 12, t, t % 2)
    assert run(path, "egs_code")[0].trace[0] == 4000
    assert run(path, "egs_events")[0].trace[0] == 830.0


def test_without_events_and_with_one_the_golden_search_ends(tmp_path):
    assert run(write(tmp_path / "none.h5", [], [], [], []), "egs_events")[0].frame is None
    assert run(write(tmp_path / "one.h5", [3], [4], [5025], [1]), "egs_events")[0].frame == 100.0


def test_mirrored_polarities_are_those_of_the_events(tmp_path):
    """Rises before the focus and falls as long after it: the sum over all centres is largest at the focus."""
    random = make_generator("test_searches_on_events", "pbf")
    away = np.abs(random.normal(0, 900, 3000)) + 200
    signs = random.integers(0, 2, 3000)
    readout = np.where(signs == 1, FOCUS - away, FOCUS + away)
    inside = (readout >= 0) & (readout < SHAPE[0])
    t, p = (readout[inside] * READOUT_US).astype(int), signs[inside]
    path = write(tmp_path / "events.h5", t % 15, t % 12, t, p)
    answer, view = run(path, "pbf_events")
    assert answer.frame == pytest.approx(FOCUS, abs=150)
    blocks = [np.histogram(t[p == sign] // READOUT_US, np.arange(0, 8001, 100))[0].astype(float) for sign in (1, 0)]
    rises, falls = (block - block.mean() for block in blocks)
    sums = {}
    for twice in range(2 * len(rises) - 1):
        inside = [i for i in range(len(rises)) if 0 <= twice - i < len(falls)]
        sums[twice / 2] = sum(rises[i] * falls[twice - i] for i in inside)
    assert answer.frame == max(sums, key=sums.get) * 100 + 49.5
    assert view.scorer.windows == 80
    flipped = write(tmp_path / "flipped.h5", t % 15, t % 12, t, 1 - p)
    assert run(flipped, "pbf_events")[0].frame == answer.frame  # the sum is symmetric


def stripes():
    """Events of 2-pixel stripes that gain contrast up to the focus, and then lose it."""
    rows, columns = np.indices(SHAPE[1:])
    pattern = np.where(columns % 4 < 2, 1, 0)
    x, y, t, p = [], [], [], []
    for k in range(40):
        before = 4000 / 40 * 2 * (k + 0.5) < FOCUS
        x.append(columns.ravel())
        y.append(rows.ravel())
        t.append(np.full(pattern.size, int(200 * (k + 0.5)) * READOUT_US))
        p.append((pattern if before else 1 - pattern).ravel())
    return (np.concatenate(column) for column in (x, y, t, p))


def test_elp_turns_at_the_focus_by_the_sum_of_the_events(tmp_path):
    path = write(tmp_path / "events.h5", *stripes())
    answer, view = run(path, "elp_events", window=200)
    assert abs(answer.frame - FOCUS) <= 400  # two windows
    assert view.now < view.frames
    assert "stopped after" in answer.note


def test_a_lamp_that_changes_adds_nothing_to_the_product():
    random = make_generator("test_searches_on_events", "lamp")
    picture, events = random.normal(0, 50, (9, 13)), random.integers(-3, 4, (9, 13)).astype(float)
    assert signed_product(picture + 1000, events) == pytest.approx(signed_product(picture, events), abs=1e-9)
    assert signed_product(picture, 0 * events) == 0.0


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        ("pbf_events", {"window": 0}, "at least 1"),
        ("pbf_events", {"window": 2.5}, "at least 1"),
        ("elp_events", {"contrast": 0}, "above 0"),
        ("elp_events", {"past": 0}, "at least 1"),
        ("elp_events", {"alpha": 1.5}, "0 to 1"),
        ("egs_events", {"threshold_s": -1}, "0 to 4000 seconds"),
        ("egs_events", {"threshold_s": float("nan")}, "0 to 4000 seconds"),
        ("egs_events", {"threshold_s": True}, "0 to 4000 seconds"),
    ],
)
def test_options_that_are_not_allowed_are_refused(name, options, words):
    assert words in str(refusal(get_search, name, **options))


def test_consecutive_windows_share_no_polarity_and_their_sum_is_the_count(tmp_path):
    t = bell("a")
    path = write(tmp_path / "events.h5", t % 15, t % 12, t, t % 2)
    with open_recording(path) as recording:
        total = np.zeros((2, *SHAPE[1:]), int)
        for first, stop in itertools.pairwise([0, 1, 37, 4900, 8000]):
            seen = recording.polarities(first, stop)
            np.testing.assert_array_equal(seen.sum(axis=0), recording.counts(first, stop))
            total += seen
        assert total[1].sum() == (t % 2).sum()
        part = slice(2, 9), slice(1, 15)
        view = RecordingView(WindowCounts(recording, part), None)
        np.testing.assert_array_equal(view.polarities(0, 8000), total[:, 2:9, 1:15])
        assert not view.polarities(0, 8000).flags.writeable
        for first, stop in ((0, 0), (5, 3), (-1, 4), (0, 8001)):
            refusal(view.polarities, first, stop)
            refusal(recording.polarities, first, stop)
        refusal(recording.polarities, 0, 5, region=(slice(0, 13), slice(0, 15)))
