import csv
import json
from dataclasses import replace

import numpy as np
import pytest
from handmade_records import record
from refusals import refusal
from scipy.stats import kendalltau

from saf_gen.core.seeds import make_generator
from saf_gen.leaderboard import rank_methods, write_leaderboard
from saf_gen.leaderboard.axes import by_axis
from saf_gen.leaderboard.merging import merge_records
from saf_gen.leaderboard.rank_agreement import compare_rankings, kendall_tau

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
    return own, [replace(r, data=f"noisy-{r.data}") for r in board(second, sensor=SENSORS[1], **more)]


def test_tau_is_that_of_scipy_with_ties():
    random = make_generator("test_rank_agreement")
    first, second = random.integers(0, 5, (2, 30, 9)) / 5
    plain = [kendalltau(a, b).statistic for a, b in zip(first, second, strict=True)]
    assert kendall_tau(first, second) == pytest.approx(plain)
    assert np.isnan(kendall_tau(np.ones((1, 4)), second[:1, :4])).all()


def test_datasets_that_differ_in_the_sensor_alone_stand_in_one_table_with_an_axis():
    nominal, noisy = two_sensors(by_skill, by_skill)
    both = merge_records({"nominal": nominal, "noisy": noisy})
    assert len({r.sequence for r in both}) == 2 * len({r.sequence for r in nominal})
    assert {r.sequence.partition("@")[2] for r in both} == set(SENSORS)
    (table,) = (t for t in by_axis(both, ["m0+s"]) if t.axis.name == "sensor")
    assert [(one.name, one.scenes, one.sequences) for one in table.bins] == [(name, 12, 48) for name in SENSORS]
    again = merge_records({"both": both, "nominal": nominal})
    assert [r.sequence for r in again] == [r.sequence for r in both]
    assert [row.answerable_1dof for row in rank_methods(both)] == pytest.approx(
        [row.answerable_1dof for row in rank_methods(nominal)]
    )


def test_a_record_that_does_not_state_its_sensor_has_that_of_the_same_data():
    nominal, noisy = two_sensors(by_skill, by_skill)
    earlier = [replace(r, method=f"early-{r.method}", sensor=None) for r in nominal]
    assert {r.sensor for r in merge_records({"now": nominal, "earlier": earlier})} == {SENSORS[0]}
    assert len({r.sequence for r in merge_records({"now": nominal, "earlier": earlier})}) == 48
    both = merge_records({"a": nominal, "b": noisy, "c": [replace(r, sensor=None) for r in nominal]})
    assert len({r.sequence for r in both}) == 96


def test_other_data_of_one_sensor_is_refused_as_before():
    nominal, _ = two_sensors(by_skill, by_skill)
    other = [replace(r, data="other") for r in nominal]
    assert "data digest" in str(refusal(merge_records, {"a": nominal, "b": other}))


def test_a_condition_that_changes_nothing_has_tau_1_and_no_method_that_moved():
    both = merge_records(dict(zip("ab", two_sensors(by_skill, by_skill), strict=True)))
    (found,) = [one for one in compare_rankings(both) if one.condition == "sensor"]
    assert (found.first, found.second, found.methods, found.scenes, found.shared) == (*SENSORS, 8, 12, 12)
    assert found.tau == found.low == found.high == 1
    assert 0.6 < found.by_chance < 1
    assert found.p_value == 1
    assert found.most_moved[1:] == (1, 1)


def test_a_condition_that_reverses_the_ranking_is_significant():
    both = merge_records(dict(zip("ab", two_sensors(by_skill, lambda m, s, i: by_skill(7 - m, s, i)), strict=True)))
    (found,) = [one for one in compare_rankings(both) if one.condition == "sensor"]
    assert found.tau < -0.9
    assert found.high < 0
    assert found.p_value < 0.05
    assert sorted(found.most_moved[1:]) == [1, 8]


def test_scenes_that_have_one_bin_alone_count_for_that_bin():
    records = board(by_skill)
    graded = [replace(r, grain_rms=0.005 if int(r.scene[-2:]) < 6 else 0.03) for r in records]
    (found,) = [one for one in compare_rankings(graded) if one.condition == "grain"]
    assert (found.first, found.second, found.scenes, found.shared) == ("below 1 %", "2 to 4 %", 12, 0)
    assert found.low <= found.tau <= found.high


def test_what_cannot_be_compared_is_left_out():
    assert compare_rankings(board(by_skill)) == []
    assert compare_rankings([replace(r, scene_motion="static") for r in board(by_skill, methods=2)]) == []
    two = [
        replace(r, light="constant" if r.sequence.endswith(("0", "1")) else "ramp") for r in board(by_skill, scenes=2)
    ]
    (found,) = compare_rankings(two)
    assert (found.low, found.by_chance, found.p_value) == (None, None, None)


def test_the_files_hold_the_agreement(tmp_path):
    both = merge_records(dict(zip("ab", two_sensors(by_skill, by_skill), strict=True)))
    write_leaderboard(tmp_path, rows=rank_methods(both), records=both)
    (agreement,) = json.loads((tmp_path / "leaderboard.json").read_text())["rank_agreement"]
    assert (agreement["condition"], agreement["tau"], agreement["most_moved"]) == ("sensor", 1, ["m0+s", 1, 1])
    with (tmp_path / "agreement.csv").open(newline="") as file:
        (line,) = csv.DictReader(file)
    assert (line["first"], line["tau"], line["rank_under_second"]) == (SENSORS[0], "1.0", "1")
    assert "## Agreement of ranks" in (tmp_path / "leaderboard.md").read_text()
