"""ESVA: a rate of events with two peaks and the focus between them, and the search for this valley."""

import numpy as np
import pytest
from lit_sweep import Sweep

from saf_gen import get_measure, get_search


def two_peaks(first, second, *, blocks=200, width=12.0, heights=(1.0, 0.8)):
    at = np.arange(blocks)
    peaks = zip((first, second), heights, strict=True)
    return sum(height * np.exp(-((at - peak) ** 2) / (2 * width**2)) for peak, height in peaks)


def test_the_answer_is_the_lowest_block_between_the_two_highest_peaks():
    scores = two_peaks(60, 120, heights=(1.0, 1.0)) + 0.1 * two_peaks(170, 190, width=4.0)
    answer = get_search("valley", window=10)(Sweep(np.repeat(scores, 10)))
    assert answer.frame == pytest.approx(904.5, abs=10)
    assert answer.trace == pytest.approx((604.5, 1204.5), abs=10)


def test_a_curve_with_one_peak_or_none_is_no_answer():
    for scores in (two_peaks(60, 60), np.ones(50), np.arange(50.0)):
        assert get_search("valley", window=10)(Sweep(np.repeat(scores, 10))).frame is None


def test_a_jump_goes_to_the_mean_of_its_neighbours_by_the_weight():
    """Without smoothing the third of 1 1 2 1 1 jumps by 1, more than 0.3, and keeps 0.4 of its value."""
    search = get_search("valley", window=10, smooth=0.0)
    assert search._regularise(np.array([1.0, 1.0, 2.0, 1.0, 1.0])) == pytest.approx([1, 1, 1.4, 1.3, 1])


def test_the_rate_counts_pixels_whose_logarithm_changed_by_the_contrast():
    halves = np.array([[[10, 10, 10, 0, 0]], [[10, 12, 13, 0, 1]]])
    assert get_measure("change_rate", contrast=0.2)(halves) == 2 / 5  # 13/10 > e^0.2 > 12/10; a first spike counts
    assert get_measure("change_rate", contrast=0.2)(halves[::-1]) == 2 / 5
    assert get_measure("change_rate")(7 * halves) == get_measure("change_rate")(halves)
    assert get_measure("change_rate")(np.zeros((2, 3, 4))) == 0.0


def test_the_rate_has_a_valley_where_blur_turns_round():
    """The blur of an edge falls to nothing and rises again: the fewest pixels change at the focus."""
    x = np.arange(-60, 61)[None, :]

    def edge(blur):
        return 1000 * (1.2 + np.tanh(x / (0.3 + abs(blur))))

    blurs = np.linspace(-20, 20, 81)
    rates = [get_measure("change_rate", contrast=0.05)(np.stack([edge(b - 0.4), edge(b + 0.4)])) for b in blurs]
    focus = len(blurs) // 2
    assert rates[focus] < 0.5 * max(rates[:focus])
    assert rates[focus] < 0.5 * max(rates[focus + 1 :])
    assert max(rates) > max(rates[0], rates[-1])
