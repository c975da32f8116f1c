"""The project's own method: a contrast that does not depend on the light, and a photon-aware search."""

import numpy as np
import pytest
from lit_sweep import Sweep
from planted_counts import CONTRAST, halves_of

from saf_gen import get_measure, get_search
from saf_gen.core.seeds import make_generator


def test_by_hand():
    """Means 4 and 6, cov = 2·3 = 6, d dark counts per half: (6 + 1/12 − 0.25·d²)/((4 − d)·(6 − d))."""
    counts = np.array([[[2, 6]], [[3, 9]]])
    score = get_measure("sd_calibrated", dark=0.05, dark_rms=0.5)(counts, frames=30)
    assert get_measure("sd_calibrated", dark=0.05, dark_rms=0.5)(counts, frames=20) == pytest.approx(
        (6 + 1 / 12 - 0.25 * 0.5 * 0.5) / (3.5 * 5.5)
    )
    assert score == pytest.approx((6 + 1 / 12 - 0.25 * 0.75 * 0.75) / (3.25 * 5.25))


def test_without_the_length_of_the_window_it_is_the_debiased_dispersion():
    counts = make_generator("calibrated").poisson(5, (2, 20, 30)).astype(np.uint32)
    assert get_measure("sd_calibrated")(counts) == pytest.approx(get_measure("sd_debiased")(counts), rel=1e-12)


def test_the_score_is_the_contrast_of_the_light_whatever_the_light():
    """A twentieth of the light changes it by less than 6 %, and `sd` by more than a quarter.

    One device and one fixed seed; 6,144 pixels with at least 12 spikes each give a standard error of the score
    below 2 %. The response adds 5 %, mostly in the first column and row of this small array.
    """
    bright, dim = halves_of(0.2, 400), halves_of(0.01, 1600)
    calibrated, sd = get_measure("sd_calibrated"), get_measure("sd")
    assert calibrated(bright, frames=400) == pytest.approx(CONTRAST**2, rel=0.06)
    assert calibrated(dim, frames=1600) == pytest.approx(CONTRAST**2, rel=0.06)
    assert sd(dim.sum(axis=0)) < 0.75 * sd(bright.sum(axis=0))


def bell(at, *, width=0.08, floor=0.3, frames=20_000):
    return floor + np.exp(-(((np.arange(frames) / frames - at) / width) ** 2) / 2)


STEPS = np.where(np.arange(20_000) // 2_500 % 2, 0.02, 0.2)


@pytest.mark.parametrize("light", [None, STEPS], ids=["constant", "sudden"])
@pytest.mark.parametrize("at", [0.15, 0.82])
def test_it_finds_the_focus_and_stops_behind_it(at, light):
    view = Sweep(bell(at), light)
    answer = get_search("photon_aware")(view)
    assert answer.frame == pytest.approx(at * 20_000, abs=0.2 * 0.08 * 20_000)
    assert view.now < 20_000 * min(at + 0.3, 1.0)
    assert answer.note.startswith(f"stopped after {view.now} ")


@pytest.mark.parametrize(("far", "found"), [(True, 0.7), (False, 0.2)])
def test_a_small_top_of_a_steep_measure_does_not_end_the_sweep_while_contrast_still_rises(far, found):
    steep = bell(0.7, width=0.03, floor=0.02) + 0.1 * bell(0.2, width=0.03, floor=0.0)
    view = Sweep(steep, broad=bell(0.7, width=0.25))
    assert get_search("photon_aware", far=far)(view).frame == pytest.approx(found * 20_000, abs=150)


def test_windows_hold_the_spikes_asked_for_and_end_now():
    view = Sweep(bell(0.5), STEPS)
    get_search("photon_aware", until=1.0, counts=4.0)(view)
    full = [w for w in view.windows if w[1] - w[0] < 0.15 * 20_000]
    assert min(count for *_, count in full) >= 8.0
    longest = {round(stop / 100): stop - first for first, stop, _ in view.windows}
    assert longest[20] < longest[48]  # they grow as it gets darker


@pytest.mark.parametrize("at", [-0.1, 1.1])
def test_it_abstains_where_the_sweep_never_comes_down_again(at):
    answer = get_search("photon_aware")(Sweep(bell(at, width=0.4)))
    assert answer.frame is None
    assert "no focus in it" in answer.note


def test_without_light_it_abstains():
    answer = get_search("photon_aware")(Sweep(bell(0.5), np.full(20_000, 1e-5)))
    assert answer.frame is None or answer.note != ""
    assert get_search("photon_aware")(Sweep(bell(0.5), np.zeros(20_000))).frame is None


def test_noise_at_the_start_does_not_stop_it():
    """The curve is flat, except for noise of 2 %, until the focus at 0.7; noise is seeded by the window."""
    view = Sweep(bell(0.7, floor=1.0), noise=0.06)
    answer = get_search("photon_aware")(view)
    assert answer.frame == pytest.approx(0.7 * 20_000, abs=0.3 * 0.08 * 20_000)
