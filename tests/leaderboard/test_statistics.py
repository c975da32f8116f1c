import numpy as np
import pytest
from scipy import stats

from saf_gen.core.seeds import make_generator
from saf_gen.leaderboard import statistics
from saf_gen.leaderboard.statistics import CONFIDENCE, MIN_SCENES, RESAMPLES, BootstrapIntervals, bootstrap_intervals


def cells(values):
    """Success by scene, scenes named in their order."""
    return {f"scene{i:03d}": float(v) for i, v in enumerate(values)}


def bernoulli(n, p, *name):
    return (make_generator("test_statistics", *name).random(n) < p).astype(float)


def ends(successes, scenes):
    """The bootstrap interval of a Bernoulli share in closed form: quantiles of a binomial."""
    tail = (1 - CONFIDENCE) / 2
    return stats.binom.ppf([tail, 1 - tail], scenes, successes / scenes) / scenes


@pytest.mark.parametrize("successes", [3, 12, 20, 29])
def test_the_interval_of_a_share_is_that_of_the_binomial(successes):
    """Each end is a quantile of 5000 draws of binomial(30, k/30): its level has sd √(0.025·0.975/5000).

    Four of them, 0.0088, at either side; two ends and four cases: significance 5·10⁻⁴, one seed.
    """
    n, p = 30, successes / 30
    found = bootstrap_intervals({"m": cells([1.0] * successes + [0.0] * (n - successes))}, {})["m"].success
    slack = 4 * np.sqrt(0.025 * 0.975 / RESAMPLES)
    for end, level in zip(found, (0.025, 0.975), strict=True):
        lowest, highest = stats.binom.ppf([level - slack, level + slack], n, p) / n
        assert lowest - 1e-9 <= end <= highest + 1e-9


def test_intervals_of_bernoulli_scenes_cover_the_truth_as_often_as_they_must():
    """40 scenes of success 0.7, 400 times: coverage against its exact value, significance 10⁻³, one seed."""
    n, p, times = 40, 0.7, 400
    k = np.arange(n + 1)
    inside = [low - 1e-9 <= p <= high + 1e-9 for low, high in (ends(s, n) for s in k)]
    exact = float(stats.binom.pmf(k, n, p)[inside].sum())
    assert 0.9 < exact < 0.97
    random = make_generator("test_statistics", "coverage")
    hits = 0
    for _ in range(times):
        low, high = bootstrap_intervals({"m": cells(random.random(n) < p)}, {}, resamples=1000)["m"].success
        hits += low - 1e-9 <= p <= high + 1e-9
    # 1000 draws move an end by a step of 1/40 now and then, which costs or gives a few per cent of coverage.
    low, high = stats.binom.ppf([5e-4, 1 - 5e-4], times, exact) / times
    assert low - 0.03 <= hits / times <= high + 0.03


def test_a_difference_is_as_wide_as_pairing_makes_it():
    """Two methods that differ in 5 of 30 scenes: their difference has the spread of those scenes alone."""
    shared = bernoulli(30, 0.5, "shared")
    worse = shared.copy()
    lost = np.flatnonzero(shared)[:5]
    worse[lost] = 0
    out = bootstrap_intervals({"good": cells(shared), "worse": cells(worse)}, {})
    low, high = out["worse"].deficit_to_best
    assert (low, high) == pytest.approx(ends(5, 30), abs=1 / 30 + 1e-9)
    unpaired = 2 * 1.96 * np.sqrt(shared.var() / 30 + worse.var() / 30)
    assert high - low < unpaired


def test_identical_methods_always_tie():
    values = bernoulli(7, 0.6, "same") / 3
    out = bootstrap_intervals({"a": cells(values), "b": cells(values)}, {})
    assert out["a"] == out["b"]
    assert out["a"].rank == (1, 1)
    assert out["a"].deficit_to_best == (0, 0)
    assert out["a"].level_with_best is True


def test_a_dominated_method_never_outranks():
    """In every scene no better, in one worse: whatever is drawn, it is not before the other."""
    good = bernoulli(9, 0.7, "good")
    good[4] = 1.0
    bad = np.minimum(good, bernoulli(9, 0.7, "bad"))
    bad[4] = 0.5
    out = bootstrap_intervals({"good": cells(good), "bad": cells(bad)}, {})
    assert out["good"].rank == (1, 1)
    assert out["bad"].rank[1] == 2
    assert out["bad"].deficit_to_best[0] >= 0


def test_one_that_fails_where_the_other_succeeds_is_told_apart_and_a_near_one_is_not():
    everywhere, nowhere = np.ones(12), np.zeros(12)
    near = everywhere.copy()
    near[3] = 0.5
    out = bootstrap_intervals({"all": cells(everywhere), "none": cells(nowhere), "near": cells(near)}, {})
    assert [out[m].level_with_best for m in ("all", "near", "none")] == [True, True, False]
    assert out["none"].rank == (3, 3)
    assert out["near"].rank == (1, 2)
    assert out["none"].deficit_to_best == (1, 1)


def test_among_several_best_the_nearest_counts():
    """Half of a's scenes are c's too, and none of b's: c is behind a for sure, and perhaps not behind b."""
    scene = np.arange(20)
    some = {"a": cells(scene < 10), "b": cells(scene >= 10), "c": cells(scene < 5)}
    both = bootstrap_intervals(some, {})
    assert bootstrap_intervals({m: some[m] for m in "ac"}, {})["c"].level_with_best is False
    assert both["c"].level_with_best is True
    assert both["c"].deficit_to_best == bootstrap_intervals({m: some[m] for m in "bc"}, {})["c"].deficit_to_best
    assert both["a"].level_with_best is both["b"].level_with_best is True


@pytest.mark.parametrize("count", [5, 23, 64, 65, 331])
def test_the_median_of_a_resample_is_that_of_its_answers_each_as_often_as_its_scene_was_drawn(count):
    random = make_generator("test_statistics", "median")
    errors = [(f"scene{i % 5:03d}", float(e)) for i, e in enumerate(random.exponential(size=count))]
    scenes = sorted({scene for scene, _ in errors})
    (drawn,) = statistics._draw_scenes(len(scenes), 400, at_once=400)
    plain = []
    for row in drawn:
        often = dict(zip(scenes, row, strict=True))
        plain.append(np.median([e for scene, e in errors for _ in range(int(often[scene]))]))
    found = statistics._find_medians(*statistics._order_errors(errors, scenes), draws=drawn)
    assert found == pytest.approx(plain, rel=1e-12)


def test_intervals_do_not_depend_on_how_many_draws_are_in_memory(monkeypatch):
    random = make_generator("test_statistics", "memory")
    success = {method: cells(random.random(9)) for method in "abc"}
    errors = {m: [(f"scene{i % 9:03d}", float(e)) for i, e in enumerate(random.random(200))] for m in "abc"}
    whole = bootstrap_intervals(success, errors)
    monkeypatch.setattr(statistics, "_MAX_NUMBERS", 9 * 777)
    parts = bootstrap_intervals(success, errors)
    for method, found in parts.items():
        other = whole[method]
        assert (found.error, found.rank, found.level_with_best) == (other.error, other.rank, other.level_with_best)
        assert found.success == pytest.approx(other.success, rel=1e-12)


def test_answers_in_too_few_scenes_have_no_interval_of_error():
    some = {"m": cells(np.ones(5))}
    assert bootstrap_intervals(some, {"m": [("scene000", 0.2), ("scene001", 0.3)] * 4})["m"].error is None
    found = bootstrap_intervals(some, {"m": [(f"scene00{i}", 0.2 + i) for i in range(3)]})["m"].error
    assert found == pytest.approx((0.2, 2.2))


@pytest.mark.parametrize("scenes", range(MIN_SCENES))
def test_with_fewer_than_three_scenes_nothing_is_made_up(scenes):
    out = bootstrap_intervals({"m": cells(np.ones(scenes)), "n": cells(np.zeros(scenes))}, {"m": [("scene000", 1.0)]})
    assert out["m"] == out["n"] == BootstrapIntervals(missing_reason=f"{scenes} of at least 3 scenes")


def test_no_method_has_no_standing():
    assert bootstrap_intervals({}, {}) == {}


def test_a_scene_that_one_method_lacks_is_left_out_for_all():
    out = bootstrap_intervals({"a": cells([1, 1, 1, 0]), "b": cells([1, 1, 1])}, {})
    assert out["a"].success == out["b"].success == (1, 1)


def test_neither_order_of_methods_nor_of_scenes_matters_and_the_seed_is_named():
    one = {"a": cells([1, 0, 0.5, 1]), "b": cells([0, 1, 0.25, 0])}
    other = {m: dict(reversed(list(one[m].items()))) for m in ("b", "a")}
    assert bootstrap_intervals(one, {}) == bootstrap_intervals(other, {})
    drawn = make_generator("statistics", "bootstrap", 4).multinomial(4, [0.25] * 4, size=RESAMPLES)
    np.testing.assert_array_equal(np.concatenate(list(statistics._draw_scenes(4, RESAMPLES, at_once=999))), drawn)
