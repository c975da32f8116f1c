import numpy as np
import pytest
from handmade_records import failed, record
from scipy import stats

from saf_gen.core.seeds import make_generator
from saf_gen.leaderboard.intervals import (
    MIN_SCENES,
    adjust_p_values,
    difference_intervals,
    mean_interval,
    median_interval,
    rate_intervals,
)
from saf_gen.leaderboard.ranking import MethodIntervals, collect_outcomes, method_intervals, rank_intervals


def solved(method, shares, *, sequences=4):
    """Records of a method that solves these fractions of the sequences of the scenes."""
    return [
        record(method, f"{scene}-{i}", 0.5 if i < round(share * sequences) else 5.0, scene=f"scene{scene:03d}")
        for scene, share in enumerate(shares)
        for i in range(sequences)
    ]


def intervals(**shares):
    by_method = {name: solved(name, own) for name, own in shares.items()}
    return method_intervals(by_method, collect_outcomes(by_method))


def test_an_interval_of_scenes_with_one_sequence_each_is_that_of_a_proportion():
    """The correlation is then unknown and does not matter: the interval is Jeffreys', in closed form."""
    for successes in (3, 12, 29):
        shares = np.r_[np.ones(successes), np.zeros(30 - successes)]
        found = rate_intervals(shares[None], np.ones(30, int))[0]
        expected = stats.beta.ppf([0.025, 0.975], successes + 0.5, 30 - successes + 0.5)
        assert found == pytest.approx(expected, abs=0.002)


def test_scenes_that_differ_widen_the_interval_and_many_like_ones_narrow_it_to_that_of_independent_sequences():
    counts = np.full(20, 24)
    alike = rate_intervals(np.full((1, 20), 0.5), counts)[0]
    apart = rate_intervals(np.r_[np.ones(10), np.zeros(10)][None], counts)[0]
    assert np.ptp(alike) == pytest.approx(2 * 1.96 * np.sqrt(0.25 / 480), rel=0.06)
    assert np.ptp(apart) == pytest.approx(np.ptp(stats.beta.ppf([0.025, 0.975], 10.5, 10.5)), rel=0.06)


def test_a_rate_of_1_has_a_width_and_one_failure_more_never_raises_an_end():
    counts = np.full(20, 12)
    rates = np.stack([np.r_[np.ones(19), k / 12] for k in range(12, -1, -1)])
    found = rate_intervals(rates, counts)
    assert found[0] == pytest.approx([0.915, 1.0], abs=0.01)
    assert (np.diff(found, axis=0) < 0).all()
    assert rate_intervals(1 - rates, counts) == pytest.approx(1 - found[:, ::-1], abs=1e-9)


def test_an_interval_does_not_depend_on_the_order_of_scenes_other_rows_or_the_last_bit():
    random = make_generator("test_statistics", "order")
    shares, counts = random.integers(0, 13, (50, 20)) / 12, np.full(20, 12)
    whole = rate_intervals(shares, counts)
    assert rate_intervals(shares[7:8, ::-1] + 1e-12, counts)[0] == pytest.approx(whole[7], abs=1e-9)


def test_rates_of_more_sequences_than_the_steps_are_rounded_without_harm():
    random = make_generator("test_statistics", "many")
    shares = random.uniform(0.4, 0.9, (1, 20))
    assert rate_intervals(shares, np.full(20, 500))[0] == pytest.approx(
        rate_intervals(shares, np.full(20, 127))[0], abs=0.005
    )


def test_a_difference_is_as_wide_as_pairing_makes_it():
    """Two methods differ in 5 of 30 scenes: the interval is that of these scenes, not that of two samples."""
    counts, wins = np.full(30, 4), np.r_[np.ones(5), np.zeros(25)][None]
    low, high = difference_intervals(wins, 0 * wins, counts=counts)[0]
    alone = rate_intervals(wins, counts)[0]
    assert low < 1 / 6 < high == pytest.approx(alone[1])
    assert low > alone[0] - rate_intervals(0 * wins, counts)[0, 1]
    assert difference_intervals(0 * wins, wins, counts=counts)[0] == pytest.approx((-high, -low))


def test_two_that_agree_everywhere_have_a_difference_of_0_with_a_width():
    low, high = difference_intervals(np.zeros((1, 20)), np.zeros((1, 20)), counts=np.full(20, 12))[0]
    assert low == -high
    assert 0.05 < high < 0.12


def test_the_interval_of_a_mean_is_students():
    values = [0.1, 0.2, 0.2, 0.4, 0.7]
    expected = stats.t.interval(0.95, 4, np.mean(values), stats.sem(values))
    assert mean_interval(values) == pytest.approx(expected)
    assert mean_interval(values[: MIN_SCENES - 1]) is None


def test_the_interval_of_a_median_has_the_ranks_that_the_spread_over_scenes_gives():
    """Scenes of one value each are a plain sample: ranks n/2 ± t·√(n/4 · n/(n − 1))."""
    values = make_generator("test_statistics", "median").permutation(np.arange(40.0))
    half = stats.t.ppf(0.975, 39) * np.sqrt(40 / 39 * 40 / 4)
    assert median_interval(values, np.arange(40)) == (np.floor(20 - half), np.ceil(20 + half) - 1)


def test_a_median_that_the_scenes_do_not_bound_has_no_interval():
    assert median_interval(np.arange(3.0), np.arange(3)) is None
    assert median_interval(np.arange(40.0), np.arange(40) % 2) is None


def test_p_values_of_a_family_are_exact_where_all_turns_are_tried():
    """Of 2⁷ sign flips of equal differences two give the largest sum, whatever else is in the family."""
    one = np.full((1, 7), 0.3)
    assert adjust_p_values(one) == pytest.approx([2 / 2**7])
    both = adjust_p_values(np.concatenate([one, [[1, -1, 1, -1, 1, -1, 1]]]))
    assert 2 / 2**7 <= both[0] <= 4 / 2**7
    assert both[1] > 0.5
    assert adjust_p_values(np.zeros((2, 7))) == pytest.approx([1, 1])


def test_equal_methods_differ_significantly_in_at_most_one_trial_of_twenty():
    """150 trials of 20 pairs with 20 scenes and a named seed; 5 % are rejected, at a significance of 10⁻³."""
    random = make_generator("test_statistics", "family")
    found = sum(adjust_p_values(random.standard_normal((20, 20))).min() <= 0.05 for _ in range(150))
    assert 1 <= found <= stats.binom.ppf(1 - 1e-3, 150, 0.05)


def test_identical_methods_share_ranks_and_are_level():
    found = intervals(a=[1, 0.5, 0.75, 1, 0.25, 1, 1], b=[1, 0.5, 0.75, 1, 0.25, 1, 1])
    assert found["a"] == found["b"]
    assert (found["a"].rank, found["a"].deficit_to_best, found["a"].level_with_best) == ((1, 2), (0, 0), True)


def test_a_method_that_fails_on_all_scenes_differs_significantly_and_a_near_one_does_not():
    found = intervals(all=np.ones(12), none=np.zeros(12), near=np.r_[np.ones(11), 0.5])
    assert [found[m].level_with_best for m in ("all", "near", "none")] == [True, True, False]
    assert [found[m].rank for m in ("all", "near", "none")] == [(1, 2), (1, 2), (3, 3)]
    assert found["none"].deficit_to_best[0] > 0.8


def test_with_five_scenes_no_two_ranks_differ_significantly():
    assert intervals(all=np.ones(5), none=np.zeros(5))["none"].rank == (1, 2)
    assert intervals(all=np.ones(7), none=np.zeros(7))["none"].rank == (2, 2)


def test_a_method_that_loses_one_sequence_per_scene_is_not_significantly_behind():
    """One fails on a sequence in every scene, the other on none: sign flips alone would find a difference."""
    counts, wins = np.full(20, 24), np.zeros((2, 2, 20))
    wins[0, 1] = 1 / 24
    assert adjust_p_values(wins[0, 1:])[0] < 0.001
    assert rank_intervals(wins, counts).tolist() == [[1, 2], [1, 2]]


def test_among_several_best_the_nearest_counts():
    scene = np.arange(20)
    some = {"a": scene < 10, "b": scene >= 10, "c": scene < 5}
    both = intervals(**some)
    of_b = intervals(b=some["b"], c=some["c"])
    assert both["c"].deficit_to_best == of_b["c"].deficit_to_best
    assert both["a"].deficit_to_best == both["b"].deficit_to_best == (0, 0)


@pytest.mark.parametrize("scenes", range(MIN_SCENES))
def test_with_fewer_than_three_scenes_nothing_is_made_up(scenes):
    found = intervals(m=np.ones(scenes), n=np.zeros(scenes))
    assert all(one == MethodIntervals(missing_reason=f"{scenes} of 3 required scenes") for one in found.values())


def test_outcomes_weigh_the_lights_of_a_scene_alike_and_count_what_is_no_answer():
    own = [
        *(record("m", f"a{i}", 0.2, scene="a") for i in range(3)),
        record("m", "a3", 7.0, scene="a", light="ramp"),
        failed("m", "b0", "abstained", scene="b"),
        record("m", "c0", None, scene="c"),
    ]
    found = collect_outcomes({"m": own, "unknown": [record("unknown", r.what.sequence, None) for r in own]})
    assert (found.methods, found.scenes, found.counts.tolist()) == (("m",), ("a", "b"), [4, 1])
    assert found.average_by_scene(found.success)[0] == pytest.approx([0.5, 0])
    assert np.isnan(found.errors[0]).tolist() == [False] * 4 + [True]
