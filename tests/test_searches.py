"""Searches against planted peaks, and against slow twins that list every frame of every window."""

import math
from dataclasses import dataclass, field

import numpy as np
import pytest

from saf_gen import get_search
from saf_gen.errors import BadInput
from saf_gen.seeds import generator


@dataclass
class Peak:
    """A recording whose score falls with the distance of a window's centre from a peak (0-based frame)."""

    frames: int
    peak: float
    asked: list = field(default_factory=list)

    def score(self, first, stop):
        assert 0 <= first < stop <= self.frames
        self.asked.append((first, stop))
        return 1 / (1 + ((first + stop - 1) / 2 - self.peak) ** 2 / self.frames)


class Curve:
    """A recording whose score is the mean of a number a frame: any curve, ties and noise too."""

    def __init__(self, values):
        self.frames = len(values)
        self.sums = np.concatenate([[0.0], np.cumsum(values)])

    def score(self, first, stop):
        assert 0 <= first < stop <= self.frames
        return float(self.sums[stop] - self.sums[first]) / (stop - first)


def focus_curve(frames, peak, *, noise=0.0):
    """A bell over a slope, one number a frame; noise from a fixed stream."""
    at = (np.arange(frames) - peak * frames) / (0.15 * frames)
    return np.exp(-(at**2)) + 0.1 * at / frames + noise * generator("searches", frames).normal(size=frames)


# The released code's rules, said again frame by frame (1-based, inclusive).


def listed_score(view, a, b):
    listed = [math.floor(a + j + 0.5) for j in range(math.floor(b - a) + 1)]
    assert listed == list(range(listed[0], listed[-1] + 1))
    return view.score(listed[0] - 1, listed[-1])


def literal_egs(view, left, right, threshold=10, ratio=0.618):
    trace = [(left + right) // 2]
    while right - left > threshold:
        w = right - left
        first = listed_score(view, left, left + ratio * w)
        second = listed_score(view, right - ratio * w, right)
        if first > second:
            right = left + ratio * w
        else:
            left = right - ratio * w
        trace.append((left + right) // 2)
    return trace


def literal_sgfs(view, dt):
    n = view.frames // dt
    s = {}
    for k in range(1, n + 1):
        end = k * dt
        h = (end + 1) // 2
        s[k] = listed_score(view, h - 1, end) - listed_score(view, 1, h - 1) if k >= n / 4 else 0.0
    later = {k: s[k] for k in range(max(n // 4, 1), n + 1)}
    stop = next(k for k in later if later[k] == max(later.values()))
    right = stop * dt
    return literal_egs(view, math.floor(right - 0.618 * (right - 1)), right)


LENGTHS = [12, 64, 333, 1000, 1001, 2047, 5000, 20_000]
PEAKS = [0.03, 0.2, 0.5, 0.61, 0.97]


@pytest.mark.parametrize("frames", LENGTHS)
@pytest.mark.parametrize("peak", PEAKS)
@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_egs_code_takes_the_same_steps_as_its_literal_twin(frames, peak, noise):
    view = Curve(focus_curve(frames, peak, noise=noise))
    answer = get_search("egs_code")(view)
    assert list(answer.trace) == literal_egs(view, 1, frames)
    assert answer.frame == answer.trace[-1] - 1


@pytest.mark.parametrize(("threshold", "ratio"), [(1, 0.618), (2.5, 0.7), (50, 0.5), (10, 0.9)])
def test_egs_code_takes_the_same_steps_for_other_thresholds_and_ratios(threshold, ratio):
    for peak in PEAKS:
        view = Curve(focus_curve(1999, peak, noise=0.5))
        answer = get_search("egs_code", threshold=threshold, ratio=ratio)(view)
        assert list(answer.trace) == literal_egs(view, 1, 1999, threshold, ratio)


@pytest.mark.parametrize(
    ("frames", "dt"),
    [
        (333, 1),
        (1000, 7),
        (1001, 7),
        (1001, 50),
        (1001, 333),
        (4090, 50),
        (4090, 100),
        (4090, 333),
        (10_000, 100),
    ],
)
def test_sgfs_code_takes_the_same_steps_as_its_literal_twin(frames, dt):
    for peak in PEAKS:
        for noise in (0.0, 1.0):
            view = Curve(focus_curve(frames, peak, noise=noise))
            answer = get_search("sgfs_code", dt=dt)(view)
            assert list(answer.trace) == literal_sgfs(view, dt)
            assert answer.frame == answer.trace[-1] - 1


def test_sgfs_code_takes_the_same_steps_on_a_recording_of_the_paper_s_length():
    view = Curve(focus_curve(20_000, 0.5, noise=1.0))
    assert list(get_search("sgfs_code")(view).trace) == literal_sgfs(view, 100)


def test_a_window_with_fractional_ends_takes_the_frames_nearest_to_its_steps():
    view = Peak(1000, 700.0)
    get_search("egs_code")(view)
    # 1 ... 618.382 and 382.618 ... 1000; then 382.618 ... 764.13... and 618.48... ... 1000
    assert view.asked[:2] == [(0, 618), (382, 1000)]
    left = 1000 - 0.618 * 999
    width = 1000 - left
    assert view.asked[2] == (round(left) - 1, round(left) + math.floor(0.618 * width))


@pytest.mark.parametrize("search", ["argmax", "egs_code", "sgfs_code"])
@pytest.mark.parametrize("peak", [0.3, 0.45, 0.5, 0.7])
@pytest.mark.parametrize("frames", [3000, 20_000])
def test_a_planted_peak_is_found_within_the_promise_of_the_search(search, peak, frames):
    answer = get_search(search)(Peak(frames, peak * frames))
    promise = {"argmax": 50, "egs_code": 10, "sgfs_code": 10}[search]  # half a block; the threshold
    assert abs(answer.frame - peak * frames) <= promise


@pytest.mark.parametrize("peak", [0.001, 0.999])
def test_egs_code_and_argmax_find_a_peak_at_either_end(peak):
    assert abs(get_search("egs_code")(Peak(20_000, peak * 20_000)).frame - peak * 20_000) <= 20
    assert abs(get_search("argmax")(Peak(20_000, peak * 20_000)).frame - peak * 20_000) <= 50


def test_sgfs_code_cannot_answer_in_the_first_tenth_of_a_sweep():
    for frames in (2000, 20_000):
        view = Peak(frames, 0.03 * frames)
        answer = get_search("sgfs_code")(view)
        earliest = math.floor(frames / 4 - 0.618 * (frames / 4 - 1))
        assert answer.frame + 1 >= earliest
        assert earliest / frames == pytest.approx(0.0955, abs=1e-3)
        assert abs(get_search("egs_code")(view).frame - 0.03 * frames) <= 15


def test_sgfs_code_does_not_stop_where_the_later_half_never_scores_higher():
    falling = Curve(np.linspace(1, 0, 2300))  # 23 blocks: block 5 has no feedback, the later ones have less
    answer = get_search("sgfs_code")(falling)
    assert answer.note == "stopped after 500 of 2300 frames"
    assert list(answer.trace) == literal_sgfs(falling, 100)


def test_the_first_window_must_be_larger_to_be_kept():
    flat = Curve(np.ones(1000))
    answer = get_search("egs_code")(flat)
    assert all(later > earlier for earlier, later in zip(answer.trace, answer.trace[1:], strict=False))
    assert answer.frame > 985


def test_of_equal_blocks_the_first_wins():
    assert get_search("argmax")(Curve(np.ones(1000))).frame == 49.5
    assert get_search("sgfs_code")(Curve(np.ones(1000))).note == "stopped after 200 of 1000 frames"


def test_argmax_answers_with_the_centre_of_the_block():
    values = np.zeros(1000)
    values[310] = 1
    assert get_search("argmax")(Curve(values)).frame == 349.5
    assert get_search("argmax", window=11)(Curve(values)).frame == 308 + 5
    assert get_search("argmax", window=1)(Curve(values)).frame == 310


def test_argmax_leaves_out_a_partial_block():
    values = np.zeros(1050)
    values[1020:] = 1
    values[500] = 0.1
    assert get_search("argmax")(Curve(values)).frame == 549.5


def test_refinement_finds_the_top_of_a_parabola():
    frames, peak = 2000, 873.0
    view = Curve(-((np.arange(frames) - peak) ** 2))
    coarse, fine = get_search("argmax")(view), get_search("argmax", refine=True)(view)
    assert coarse.frame == 849.5
    assert fine.frame == pytest.approx(peak, abs=1e-6)
    assert fine.trace == (849.5,)


@pytest.mark.parametrize("peak", [0, 1999])
def test_refinement_leaves_the_first_and_the_last_block_alone(peak):
    view = Peak(2000, peak)
    assert get_search("argmax", refine=True)(view) == get_search("argmax")(view)


def test_refinement_of_a_plateau_stays_within_half_a_block():
    assert get_search("argmax", window=10, refine=True)(Curve(np.repeat([0, 1, 1, 0.0], 10))).frame == 19.5


@pytest.mark.parametrize(
    ("search", "frames", "message"),
    [
        ("argmax", 99, r"99 frames is shorter than one window of 100 frames; allowed: window of 1 \.\.\. 99"),
        (
            "egs_code",
            11,
            r"11 frames is too short for threshold 10; allowed: more than 11 frames; choose a sm",
        ),
        ("sgfs_code", 99, r"99 frames is too short for blocks of 100 frames; allowed: at least one block"),
    ],
)
def test_a_recording_too_short_for_the_option_is_refused(search, frames, message):
    with pytest.raises(BadInput, match=message):
        get_search(search)(Peak(frames, frames / 2))


def test_the_shortest_recordings_that_fit_are_searched():
    assert get_search("argmax")(Peak(100, 50)).frame == 49.5
    assert len(get_search("egs_code")(Peak(12, 3)).trace) == 2
    assert get_search("sgfs_code", dt=3)(Peak(3, 1)).frame == 1
    with pytest.raises(BadInput, match="three frames in the first quarter"):
        get_search("sgfs_code", dt=2)(Peak(3, 1))


@pytest.mark.parametrize(
    ("search", "options", "message"),
    [
        ("argmax", {"window": 0}, r"window is 0; allowed: a whole number of frames, at least 1"),
        ("argmax", {"window": 2.5}, r"window is 2\.5; allowed"),
        ("argmax", {"window": True}, r"window is True; allowed"),
        ("argmax", {"refine": "yes"}, r"refine is 'yes'; allowed: true, false"),
        ("sgfs_code", {"dt": -5}, r"dt is -5; allowed: a whole number of frames"),
        ("egs_code", {"threshold": 0.5}, r"threshold is 0\.5; allowed: frames, a number of at least 1"),
        ("egs_code", {"threshold": "ten"}, r"search 'egs_code': .*allowed: threshold, ratio"),
        ("egs_code", {"ratio": 1.0}, r"ratio is 1\.0; allowed: 0\.5 up to but not 1"),
        ("egs_code", {"dt": 5}, r"unknown key of search 'egs_code': 'dt'; allowed: ratio, threshold"),
        ("egs", {}, r"unknown search 'egs'; allowed: .*did you mean 'egs_code'\?"),
    ],
)
def test_wrong_options_of_a_search_are_refused(search, options, message):
    with pytest.raises(BadInput, match=message):
        get_search(search, **options)
