import csv
import json

import pytest
from handmade_evaluations import board_of, write_board
from handmade_records import change, failed, record

from saf_gen.leaderboard import rank_methods
from saf_gen.leaderboard.ranking import ERROR_LIMITS_DOF


def board(errors, *, scenes=12, sequences=4, **more):
    """Records of methods; ``errors[name](scene, sequence)`` is an error in depths of focus, or None for no answer."""
    made = []
    for name, error in errors.items():
        for scene in range(scenes):
            for i in range(sequences):
                one = {"scene": f"scene{scene:02d}", **more}
                e = error(scene, i)
                if e is None:
                    made.append(failed(name, f"{scene}-{i}", "abstained", **one))
                else:
                    made.append(record(name, f"{scene}-{i}", e, **one))
    return made


def compare(records):
    return board_of(records).comparison


NEAR_AND_FAR = {
    "exact+s": lambda scene, i: 0.01 if scene else 3.0,
    "coarse+s": lambda scene, i: 0.6 if scene else 0.02,
    "lost+s": lambda scene, i: 4.0,
}


def test_a_profile_is_the_success_rate_where_success_is_counted_and_has_its_intervals():
    records = board(NEAR_AND_FAR)
    rows = {row.method: row for row in rank_methods(records)}
    for profile in compare(records).profiles:
        row = rows[profile.method]
        within = dict(zip(profile.limits, zip(profile.fractions, profile.low, profile.high, strict=True), strict=True))
        assert profile.limits == ERROR_LIMITS_DOF
        assert within[0.5][0] == pytest.approx(row.answerable_half_dof)
        assert within[2.0][0] == pytest.approx(row.answerable_2dof)
        assert within[1.0] == pytest.approx(
            (row.answerable_1dof, row.answerable_1dof_low, row.answerable_1dof_high), abs=2e-3
        )
        assert list(profile.fractions) == sorted(profile.fractions)


def test_an_abstention_is_within_no_limit_where_there_is_an_answer():
    records = [change(r, focus_off_dof=0.8) for r in board({"silent+s": lambda s, i: None})]
    (profile,) = compare([*records]).profiles
    assert set(profile.fractions) == {0}


def test_the_probability_of_improvement_compares_sequence_by_sequence_and_halves_ties():
    first, second = compare(board(NEAR_AND_FAR)).neighbours
    assert (first.first, first.second) == ("coarse+s", "exact+s")
    assert first.difference == pytest.approx(1 / 12)
    assert first.improvement == pytest.approx(1 / 12)  # it ranks first, but is rarely nearer
    assert first.improvement_low < 1 / 12 < first.improvement_high < 0.5
    assert not first.told_apart
    assert second.improvement == 1 == second.improvement_high
    assert second.told_apart
    (same,) = compare(board({"a+s": lambda s, i: 0.3, "b+s": lambda s, i: -0.3})).neighbours
    assert (same.difference, same.improvement) == (0, 0.5)
    assert same.improvement_low < 0.5 < same.improvement_high


def test_no_answer_is_farther_than_any_and_sequences_without_one_compare_nobody():
    records = board({"a+s": lambda s, i: 50.0, "b+s": lambda s, i: None})
    without = [change(r, sequence=f"{r.what.sequence}-out", focus_off_dof=2.0) for r in records]
    for some in (records, [*records, *without]):
        (pair,) = compare(some).neighbours
        assert (pair.first, pair.second, pair.improvement) == ("a+s", "b+s", 1)
    assert compare(without).neighbours == ()


def test_times_have_a_profile_in_the_closed_loop_alone():
    quick = [
        change(r, time_to_focus_s=0.1 + 0.01 * int(r.what.scene[-2:])) for r in board({"a+s": lambda s, i: 0.1 * i})
    ]
    assert {p.quantity for p in compare(quick).profiles} == {"error_dof"}
    loop = [change(r, track="closed_loop") for r in quick]
    (profile,) = (p for p in compare(loop).profiles if p.quantity == "time_s")
    assert profile.limits[-1] == pytest.approx(0.21)
    assert profile.fractions[-1] == 1
    assert profile.fractions[0] == 0
    assert profile.fractions[5] == pytest.approx(1 / 12)  # within 0.105 s


def test_with_two_scenes_there_are_fractions_without_intervals_and_alone_no_neighbours():
    few = compare(board(NEAR_AND_FAR, scenes=2))
    assert {(p.low, p.high) for p in few.profiles} == {(None, None)}
    assert {(n.difference_low, n.improvement_high, n.told_apart) for n in few.neighbours} == {(None, None, False)}
    alone = compare(board({"a+s": lambda s, i: 0.1}))
    assert (len(alone.profiles), alone.neighbours) == (1, ())
    unknown = board({"a+s": lambda s, i: 0.1})
    assert compare([record("a+s", r.what.sequence, None) for r in unknown]).profiles == ()


def test_the_files_hold_profiles_and_neighbours(tmp_path):
    records = board(NEAR_AND_FAR)
    write_board(tmp_path, records)
    document = json.loads((tmp_path / "leaderboard.json").read_text())
    assert [p["method"] for p in document["profiles"]] == ["coarse+s", "exact+s", "lost+s"]
    with (tmp_path / "profiles.csv").open(newline="") as file:
        assert len(list(csv.DictReader(file))) == 3 * len(ERROR_LIMITS_DOF)
    with (tmp_path / "neighbours.csv").open(newline="") as file:
        first, _ = csv.DictReader(file)
    assert (first["first"], first["told_apart"]) == ("coarse+s", "False")
    text = (tmp_path / "leaderboard.md").read_text()
    assert "## Neighbours in rank" in text
    assert "| coarse+s | exact+s | +8 |" in text
    assert "## Within depths of focus" in text
