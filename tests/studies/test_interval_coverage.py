"""A small simulation of studies/ranking/interval_coverage.py: intervals contain the truth as often as they claim.

Each case has 400 trials (for ranks, 12 leaderboards of 12 methods) and its own named seed. The coverage found must be
one that a true coverage of 0.93 to 0.97 gives, at a significance of 10⁻³ on each side; if the true one is known to be
larger, only the lower bound applies.
"""

import pytest
from scipy import stats

from studies.ranking import interval_coverage

TRIALS = 400
LOWEST, HIGHEST = stats.binom.ppf([1e-3, 1 - 1e-3], TRIALS, [0.93, 0.97]) / TRIALS


def simulate(kind, *, scenes=20, trials=TRIALS, earlier=False, **case):
    return list(getattr(interval_coverage, f"simulate_{kind}")(scenes, trials, earlier=earlier, **case))


@pytest.mark.parametrize(
    ("law", "rate"), [("beta 0.02", 0.97), ("beta 0.1", 0.9), ("beta 0.3", 0.5), ("logit-normal", 0.9)]
)
def test_the_interval_of_a_success_rate_holds_at_twenty_scenes(law, rate):
    (found,) = simulate("rates", law=law, rate=rate)
    assert LOWEST <= found.held <= HIGHEST


def test_scenes_without_any_success_never_make_the_interval_too_narrow():
    assert all(simulate("rates", law="two kinds", rate=rate)[0].held >= LOWEST for rate in (0.5, 0.9, 0.97, 1.0))


def test_the_simulation_shows_that_the_earlier_intervals_held_too_rarely():
    now, before = simulate("rates", law="beta 0.3", rate=0.97, earlier=True)
    assert before.held < 0.85 < LOWEST <= now.held


@pytest.mark.parametrize(
    ("law", "scenes"), [("alike", 20), ("scenes differ sevenfold", 7), ("one scene in seven fails", 20)]
)
def test_the_interval_of_a_median_error_holds_at_seven_and_at_twenty_scenes(law, scenes):
    (found,) = simulate("medians", law=law, scenes=scenes)
    assert LOWEST <= found.held <= HIGHEST


def test_the_interval_of_a_mean_time_holds_where_times_are_not_very_skewed():
    assert all(LOWEST <= simulate("times", law=law)[0].held <= HIGHEST for law in ("normal", "skewed"))


def test_the_interval_of_a_difference_holds_and_is_too_wide_where_both_are_nearly_perfect():
    for world in ("shared difficulty", "rare failures"):
        assert LOWEST <= simulate("differences", world=world, rates=(0.6, 0.5))[0].held <= HIGHEST
        assert simulate("differences", world=world, rates=(0.99, 0.97))[0].held >= LOWEST


@pytest.mark.slow
@pytest.mark.parametrize("world", ["shared difficulty", "rare failures"])
def test_intervals_of_ranks_hold_where_all_methods_are_alike_and_resampled_ranks_do_not(world):
    """Ranks of one leaderboard depend on each other; over 12 of them a coverage of 0.95 is rarely found below 0.8."""
    now, before = simulate("ranks", world=world, board="12, all alike", trials=12, earlier=True)
    assert before.held < 0.8 < now.held
