import numpy as np
import pytest
from handmade_records import change, record
from scipy.stats import kendalltau

from saf_gen.core.seeds import make_generator
from saf_gen.leaderboard.merging import merge_records
from studies.ranking.rank_agreement import compare_rankings, compare_tables, kendall_tau

SENSORS = ("vidar_400x250", "vidar_400x250_noisy")


def answer(method, sequence, *, right, **more):
    return record(method, sequence, 0.5 if right else 5.0, **more)


def board(right, *, scenes=12, methods=8, sequences=4, **more):
    """Records of methods; ``right(method, scene, sequence)`` returns whether an answer is right."""
    return [
        answer(f"m{m}+s", f"s{s}-{i}", right=right(m, s, i), scene=f"scene{s:02d}", **more)
        for m in range(methods)
        for s in range(scenes)
        for i in range(sequences)
    ]


def by_skill(m, s, i):
    """Methods with higher numbers solve fewer sequences, with some variation between scenes."""
    return (7 * m + 5 * s + 3 * i) % 16 > m


def two_sensors(first, second, **more):
    own = board(first, sensor=SENSORS[0], **more)
    return own, [change(r, data=f"noisy-{r.what.data}") for r in board(second, sensor=SENSORS[1], **more)]


def test_tau_is_that_of_scipy_with_ties():
    random = make_generator("test_rank_agreement")
    first, second = random.integers(0, 5, (2, 30, 9)) / 5
    plain = [kendalltau(a, b).statistic for a, b in zip(first, second, strict=True)]
    assert kendall_tau(first, second) == pytest.approx(plain)
    assert np.isnan(kendall_tau(np.ones((1, 4)), second[:1, :4])).all()


def test_a_condition_that_changes_nothing_has_tau_1_and_no_method_that_moved():
    both = merge_records(dict(zip("ab", two_sensors(by_skill, by_skill), strict=True)))
    (found,) = [one for one in compare_rankings(both) if one.condition == "sensor"]
    assert (found.first, found.second, found.methods, found.scenes, found.shared) == (*SENSORS, 8, 12, 12)
    assert found.tau == found.low == found.high == 1
    assert 0.6 < found.by_chance < 1
    assert found.p_value == 1
    assert found.most_moved[1:] == (1, 1)


@pytest.mark.slow
def test_a_condition_that_reverses_the_ranking_is_significant():
    both = merge_records(dict(zip("ab", two_sensors(by_skill, lambda m, s, i: by_skill(7 - m, s, i)), strict=True)))
    (found,) = [one for one in compare_rankings(both) if one.condition == "sensor"]
    assert found.tau < -0.9
    assert found.high < 0
    assert found.p_value < 0.05
    assert sorted(found.most_moved[1:]) == [1, 8]


def test_scenes_that_have_one_bin_alone_count_for_that_bin():
    records = board(by_skill)
    graded = [change(r, grain_rms=0.005 if int(r.what.scene[-2:]) < 6 else 0.03) for r in records]
    (found,) = [one for one in compare_rankings(graded) if one.condition == "grain"]
    assert (found.first, found.second, found.scenes, found.shared) == ("below 1 %", "2 to 4 %", 12, 0)
    assert found.low <= found.tau <= found.high


def test_what_cannot_be_compared_is_left_out():
    assert compare_rankings(board(by_skill)) == []
    assert compare_rankings([change(r, scene_motion="static") for r in board(by_skill, methods=2)]) == []
    two = [
        change(r, light="constant" if r.what.sequence.endswith(("0", "1")) else "ramp")
        for r in board(by_skill, scenes=2)
    ]
    (found,) = compare_rankings(two)
    assert (found.low, found.by_chance, found.p_value) == (None, None, None)


@pytest.mark.parametrize("methods", [3, 64])
def test_the_interval_of_tau_contains_it(methods):
    """10 pairs of rankings by 20 scenes: with many methods, most τ of samples are below τ."""
    random = make_generator("test_intervals", "tau", methods)
    for _ in range(10):
        rates = np.clip(random.random(methods) + random.normal(0, 0.2, (2, 20, methods)), 0, 1)
        tables = random.binomial(6, rates) / 6
        names = [f"m{number}" for number in range(methods)]
        found = compare_tables(tables, names, names=("light", "a", "b"), shared=20)
        assert found.low <= found.tau <= found.high
