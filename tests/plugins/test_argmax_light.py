"""Exhaustive search over windows of equal light."""

import numpy as np
import pytest
from lit_sweep import Sweep
from refusals import refusal

from saf_gen import get_search

FRAMES = 8000
STEPS = np.where(np.arange(FRAMES) // 1000 % 2, 0.05, 0.5)


def bell(at, width=0.08, floor=0.3):
    return floor + np.exp(-(((np.arange(FRAMES) / FRAMES - at) / width) ** 2) / 2)


@pytest.mark.parametrize("light", [None, STEPS], ids=["constant", "sudden"])
@pytest.mark.parametrize("refine", ["no", "parabola", "centroid"])
@pytest.mark.parametrize("at", [0.3, 0.72])
def test_the_focus_is_found_within_a_quarter_of_the_width(at, refine, light):
    answer = get_search("argmax_light", refine=refine)(Sweep(bell(at), light))
    assert answer.frame == pytest.approx(at * FRAMES, abs=0.25 * 0.08 * FRAMES)


def test_windows_hold_equal_light_where_they_can():
    view = Sweep(bell(0.5), STEPS)
    get_search("argmax_light", counts=10, longest=0.1)(view)
    counts = np.array([count for *_, count in view.windows])
    lengths = np.array([stop - first for first, stop, _ in view.windows])
    assert (counts[lengths < 800] >= 10).all()
    assert (counts[lengths < 800] <= 10 + 40 * 0.5).all()  # one step of the recording more at most
    assert lengths.min() < 60
    assert lengths.max() > 120


def test_between_windows_the_parabola_is_exact():
    """A parabola of scores, averaged over windows of constant length, keeps its top."""
    at = 0.5017
    view = Sweep(1 - ((np.arange(FRAMES) - at * FRAMES) / FRAMES) ** 2)
    assert get_search("argmax_light", refine="parabola")(view).frame == pytest.approx(at * FRAMES, abs=0.6)
    assert get_search("argmax_light")(view).frame == pytest.approx(at * FRAMES, abs=20)


@pytest.mark.slow
def test_noise_moves_the_refined_answer_less():
    """Twenty noisy curves with fixed seeds: the parabola's rms error is below two thirds of the best window's."""

    def errors(refine):
        search = get_search("argmax_light", refine=refine)
        tries = (0.4 + 0.01 * number for number in range(20))
        return [search(Sweep(bell(at), noise=0.05)).frame - at * FRAMES for at in tries]

    assert np.std(errors("parabola")) < 2 / 3 * np.std(errors("no"))


def test_a_dark_recording_has_no_answer():
    assert get_search("argmax_light")(Sweep(bell(0.5), np.zeros(FRAMES))).frame is None


def test_a_flat_curve_has_the_first_window():
    answer = get_search("argmax_light", refine="centroid")(Sweep(np.ones(FRAMES)))
    assert answer.frame is not None


@pytest.mark.parametrize(
    ("options", "field", "fragment"),
    [
        ({"counts": 0}, "problem", "counts is 0"),
        ({"counts": -1.0}, "problem", "counts is -1.0"),
        ({"steps": 0}, "problem", "steps is 0"),
        ({"near": 0.0}, "problem", "near is 0.0"),
        ({"near": 2.0}, "problem", "near is 2.0"),
        ({"longest": 1.5}, "problem", "longest is 1.5"),
        ({"refine": "parabel"}, "nearest", "parabola"),
        ({"refin": "no"}, "nearest", "refine"),
    ],
)
def test_wrong_options_are_refused(options, field, fragment):
    assert fragment in getattr(refusal(get_search, "argmax_light", **options), field)
