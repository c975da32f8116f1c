"""The search that fits a bell to the focus curve while the lens passes the focus."""

import numpy as np
import pytest
from lit_sweep import Sweep

from saf_gen import get_search
from saf_gen.plugins.searches.peak_fit import MOST_DARK, block_contrast, dark_rate_of, fit_bell

FRAMES = 20_000
WIDTH = 0.06


def bell(lens, *, at, width=WIDTH, height=0.4):
    return height / (1 + ((lens - at) / width) ** 2)


def sweep(first, last, *, at, **options):
    lens = np.linspace(first, last, FRAMES)
    return Sweep(bell(lens, at=at), lens=lens, broad=bell(lens, at=at, width=0.3), **options)


def test_a_bell_is_found_again_from_one_side_of_it():
    x = np.linspace(0.2, 0.45, 40)
    found = fit_bell(x, bell(x, at=0.5), light=np.ones(40), above=0.0)
    assert found.focus == pytest.approx(0.5, abs=1e-9)
    assert found.width == pytest.approx(WIDTH, rel=1e-6)
    assert found.misfit < 1e-9


def test_only_scores_round_the_largest_are_fitted_in_whatever_order_they_came():
    x = np.linspace(0, 1, 200)[np.random.default_rng(4).permutation(200)]
    y = bell(x, at=0.3) + bell(x, at=0.8, height=0.25)
    found = fit_bell(x, y, light=np.ones(200), above=0.5)
    assert found.focus == pytest.approx(0.3, abs=0.02 * WIDTH)


@pytest.mark.parametrize(
    "curve",
    [np.full(50, 0.3), -np.ones(50), 1 + np.linspace(-1, 1, 50) ** 2, np.where(np.arange(50) == 20, 1.0, 0.1)],
    ids=["flat", "below zero", "a valley", "a single high score"],
)
def test_what_is_no_bell_is_not_fitted(curve):
    assert fit_bell(np.linspace(0, 1, 50), curve, light=np.ones(50), above=0.1) is None


@pytest.mark.parametrize(("first", "last"), [(0.0, 1.0), (1.0, 0.0)])
@pytest.mark.parametrize("at", [0.2, 0.85])
def test_it_finds_the_focus_and_stops_close_behind_it(at, first, last):
    """Noise of 2 % in windows of six spikes per pixel, seeded by the window."""
    view = sweep(first, last, at=at, noise=0.02)
    answer = get_search("peak_fit")(view)
    passed = abs(at - first) * FRAMES
    assert answer.frame == pytest.approx(passed, abs=0.1 * WIDTH * FRAMES)
    assert view.now == int(answer.note.split()[2])
    assert passed < view.now < passed + 1.2 * WIDTH * FRAMES


@pytest.mark.parametrize(("outside", "answered"), [(0.3, True), (0.9, False)])
@pytest.mark.parametrize("backwards", [False, True], ids=["at the end", "before the start"])
def test_the_end_of_the_sweep_is_the_answer_where_the_focus_lies_just_outside(outside, answered, backwards):
    lens = np.linspace(0, 0.6, FRAMES)
    curve = bell(lens, at=0.6 + outside * WIDTH)
    view = Sweep(curve[::-1] if backwards else curve, lens=lens[::-1] if backwards else lens)
    answer = get_search("peak_fit")(view)
    assert view.now == FRAMES
    if answered:
        assert answer.frame == pytest.approx(0 if backwards else FRAMES, abs=FRAMES / 200)
    else:
        assert answer.frame is None
        assert "no focus in it" in answer.note


def test_a_lens_that_rests_makes_no_bell():
    x = np.where(np.arange(50) < 25, 0.3, 0.4)
    assert fit_bell(x, bell(x, at=0.35) * np.linspace(1, 1.01, 50), light=np.ones(50), above=0.1) is None


def test_a_lens_that_turns_back_is_followed_by_its_position_and_not_by_time():
    time = np.linspace(0, 1, FRAMES)
    lens = 0.5 * time + 0.12 * np.sin(9 * np.pi * time)
    view = Sweep(bell(lens, at=0.3), lens=lens)
    answer = get_search("peak_fit")(view)
    assert lens[round(answer.frame)] == pytest.approx(0.3, abs=0.1 * WIDTH)


def test_where_positions_are_unknown_frames_stand_for_them():
    lens = np.linspace(0, 1, FRAMES)
    known, unknown = Sweep(bell(lens, at=0.4), lens=lens), Sweep(bell(lens, at=0.4))
    search = get_search("peak_fit")
    assert search(unknown).frame == pytest.approx(search(known).frame, abs=1)
    assert unknown.now == known.now


def test_a_curve_that_is_no_bell_ends_as_photon_aware_ends_it():
    lens = np.linspace(0, 1, FRAMES)
    flat = np.clip(0.5 - np.abs(lens - 0.5) * 4, 0.05, 0.2)
    view = Sweep(flat, lens=lens)
    assert get_search("peak_fit", rough=0.0)(view).frame == pytest.approx(FRAMES / 2, abs=0.08 * FRAMES)
    assert view.now < FRAMES


STEPS_OF_LIGHT = np.repeat([0.05, 0.02, 0.1] * 7, -(-FRAMES // 21))[:FRAMES]


@pytest.mark.parametrize("at", [0.3, 0.7])
def test_jumps_of_light_do_not_move_the_focus_although_dark_counts_reduce_contrast(at):
    """0.01 dark spikes per frame among 0.02 to 0.1 reduce scores to a quarter, or to 0.8, of those without."""
    found = {}
    for dark in (True, False):
        view = sweep(0, 1, at=at, light=STEPS_OF_LIGHT, dark=0.01)
        found[dark] = abs(get_search("peak_fit", dark=dark, near=0.0)(view).frame / FRAMES - at)
    assert found[True] < 0.01 * WIDTH < 0.05 * WIDTH < found[False]


def test_the_dark_rate_is_estimated_from_contrast_that_falls_with_the_light():
    rate = np.array([0.2, 0.05, 0.02, 0.1])
    assert dark_rate_of(rate, 0.3 * (1 - 0.015 / rate)) == pytest.approx(0.015)
    assert dark_rate_of(rate, 0.3 * (1 + 0.015 / rate)) == 0
    assert dark_rate_of(rate, np.zeros(4)) == 0
    assert dark_rate_of(rate, -0.3 + 0.01 * rate) == 0
    assert dark_rate_of(rate, 3 - 0.0599 / rate) == pytest.approx(MOST_DARK * 0.02)
    little = np.array([0.2, 0.18, 0.16])  # changes that come from noise rather than from dark counts
    assert dark_rate_of(little, 0.3 * (1 - 0.015 / little)) == 0


def test_the_contrast_of_blocks_is_that_of_their_means():
    fine = np.where(np.indices((40, 64)).sum(axis=0) % 2, 4.0, 0.0)
    assert block_contrast(fine) == 0
    halves = np.repeat([[1.0, 3.0]], 10, axis=0).repeat(8, axis=1)
    assert block_contrast(halves) == pytest.approx(0.5)
    assert block_contrast(np.zeros((40, 64))) == 0
    assert block_contrast(np.array([[1.0, 3.0]])) == pytest.approx(0.5)  # fewer pixels than blocks


def test_the_finest_differences_decide_near_the_top():
    """Other depths of a target shift a broad bell by half its width; the narrow bell is at the focus."""
    lens = np.linspace(0, 1, FRAMES)
    finest = bell(lens, at=0.5, width=WIDTH / 2)
    for near, expected in ((0.5, 0.5), (0.0, 0.5 + WIDTH / 2)):
        view = sweep(0, 1, at=0.5 + WIDTH / 2, finest=finest)
        answer = get_search("peak_fit", near=near)(view)
        assert answer.frame / FRAMES == pytest.approx(expected, abs=0.1 * WIDTH)


@pytest.mark.parametrize(
    "finest", [np.full(FRAMES, 0.3), bell(np.linspace(0, 1, FRAMES), at=0.72), -np.ones(FRAMES)],
    ids=["flat", "elsewhere", "below zero"],
)  # fmt: skip
def test_finest_differences_that_are_no_bell_there_change_nothing(finest):
    found = [get_search("peak_fit", near=near)(sweep(0, 1, at=0.5, finest=finest)).frame for near in (0.5, 0.0)]
    assert found[0] == found[1]


def test_without_light_it_abstains():
    answer = get_search("peak_fit")(sweep(0, 1, at=0.5, light=np.zeros(FRAMES)))
    assert (answer.frame, answer.note) == (None, "too dark")
