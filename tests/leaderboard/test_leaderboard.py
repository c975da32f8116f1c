import csv
import json

import pytest
from handmade_evaluations import write_board
from handmade_records import failed, record
from refusals import refusal

from saf_gen.benchmark.results import SequenceFailure
from saf_gen.leaderboard import rank_methods
from saf_gen.leaderboard.results import notes_on, rule_of, verdict_on, warnings_on
from saf_gen.leaderboard.tables import ranking


@pytest.fixture
def records():
    return [
        record("sd+argmax", "a", 0.2),
        record("sd+argmax", "b", -0.8, light="ramp"),
        record("er+argmax", "a", 0.3),
        record("er+argmax", "b", 6.0, light="ramp"),
        failed("odd+argmax", "a", "abstained"),
        failed("odd+argmax", "b", "failed", light="ramp"),
    ]


def test_success_ranks_and_a_row_averages_what_was_answered(records):
    rows = sd, er, odd = rank_methods(records)
    assert [(r.rank, r.method, r.answerable_1dof) for r in rows] == [
        (1, "sd+argmax", 1.0),
        (2, "er+argmax", 0.5),
        (3, "odd+argmax", 0.0),
    ]
    errors = (sd.median_error_dof, sd.median_error_travel, sd.median_error_frames, er.median_error_dof)
    assert errors == pytest.approx((0.5, 0.0625, 50, 3.15))
    assert odd.median_error_dof is None
    assert (odd.abstained, odd.failed, odd.sequences) == (1, 1, 2)
    assert dict(er.success_by_light) == {"constant": 1.0, "ramp": 0.0}


@pytest.mark.parametrize(
    ("errors", "success"),
    [
        ({("a", "constant"): [0.0] * 9, ("b", "constant"): [9.0]}, 0.5),
        ({("a", "constant"): [0.0] * 3, ("a", "ramp"): [9.0], ("b", "constant"): [0.0]}, (0.5 + 1) / 2),
    ],
    ids=["scenes", "lights"],
)
def test_scenes_weigh_the_same_and_so_do_lights_of_a_scene(errors, success):
    records = [
        record("m+s", f"{scene}-{light}-{i}", error, scene=scene, light=light)
        for (scene, light), repeats in errors.items()
        for i, error in enumerate(repeats)
    ]
    assert rank_methods(records)[0].answerable_1dof == pytest.approx(success)


def test_costs_weigh_scenes_and_lights_as_success_does():
    rows = rank_methods(
        [
            *(record("m+s", f"a{i}", 0.0, scene="a", seconds=1.0, frames_seen=200) for i in range(3)),
            record("m+s", "a9", 0.0, scene="a", light="ramp", seconds=3.0, frames_seen=400, lens_travel=0.5),
            record("m+s", "b0", 0.0, scene="b", seconds=6.0, frames_seen=800),
        ]
    )
    assert rows[0].seconds == pytest.approx(((1 + 3) / 2 + 6) / 2)
    assert rows[0].frames_seen == pytest.approx(((0.25 + 0.5) / 2 + 1) / 2)
    assert rows[0].lens_travel == pytest.approx(((1.5 + 0.5) / 2 + 1.5) / 2)


def test_ties_share_a_rank_are_named_and_the_next_rank_counts_them():
    rows = rank_methods(
        [record("a+s", "x", 0.9), record("b+s", "x", 0.1), record("c+s", "x", 0.4), record("d+s", "x", 5.0)]
    )
    assert [(r.rank, r.method) for r in rows] == [(1, "b+s"), (1, "c+s"), (1, "a+s"), (4, "d+s")]
    assert rows[0].tied == ("a+s", "c+s")
    assert rows[3].tied == ()
    rank = ranking(rows).shown[0]
    assert [rank.text(r) for r in rows] == ["1=", "1=", "1=", "4"]


def test_equal_fractions_tie_whatever_their_last_bit():
    def spread(method, errors):
        return [record(method, f"{i}", e, scene=f"s{i}") for i, e in enumerate(errors)]

    rows = rank_methods([*spread("a+s", [0, 0, 9, 9, 9, 0, 9]), *spread("b+s", [9, 9, 0, 9, 0, 9, 0])])
    assert [r.rank for r in rows] == [1, 1]


def test_without_truth_methods_are_not_ranked_but_have_costs():
    (row,) = rank_methods([record("a+s", "x", None)])
    assert (row.rank, row.answerable_1dof, row.median_error_dof) == (None, None, None)
    assert (row.frames_seen, row.lens_travel, row.seconds) == (1.0, 1.5, 0.25)
    assert ranking([row]).shown[0].text(row) == "–"
    rows = rank_methods([record("a+s", "x", None), record("b+s", "x", 9.0)])
    assert [r.method for r in rows] == ["b+s", "a+s"]


def test_no_record_gives_an_empty_table(tmp_path):
    assert rank_methods([]) == ()
    write_board(tmp_path, [], failures=[SequenceFailure("x", "cut short")])
    assert json.loads((tmp_path / "leaderboard.json").read_text())["failures"][0]["sequence"] == "x"


def test_the_files_agree(tmp_path, records):
    rows = rank_methods(records)
    paths = write_board(tmp_path, records, failures=[SequenceFailure("bad", "truncated")])
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(p.name for p in paths)
    document = json.loads((tmp_path / "leaderboard.json").read_text())
    with (tmp_path / "leaderboard.csv").open(newline="") as file:
        sheet = list(csv.DictReader(file))
    lines = [json.loads(line) for line in (tmp_path / "records.jsonl").read_text().splitlines()]
    text = (tmp_path / "leaderboard.md").read_text()
    assert [r["method"] for r in document["rows"]] == [r["method"] for r in sheet] == [r.method for r in rows]
    for one, other in zip(document["rows"], sheet, strict=True):
        assert set(other) == set(one) - {"tied"}
        for name, cell in other.items():
            assert cell == ("" if one[name] is None else str(one[name]))
    assert ranking(rows).to_markdown() in text
    assert "- bad: truncated" in text
    assert [(r["method"], r["sequence"]) for r in lines] == [(r.who.method, r.what.sequence) for r in records]
    assert document["data"] == {"a": "sha-a", "b": "sha-b"}


def test_nan_never_appears_in_a_file(tmp_path):
    strange = [record("a+s", "x", None, seconds=0.0, optimum=float("nan"), trace=(float("nan"),))]
    write_board(tmp_path, strange)
    for path in {*tmp_path.iterdir()} - {tmp_path / "index.html"}:
        assert "nan" not in path.read_text().lower()


def test_a_folder_that_cannot_be_is_bad_input(tmp_path, records):
    (tmp_path / "file").write_text("")
    error = refusal(write_board, tmp_path / "file/out", records)
    assert str(tmp_path / "file") in str(error)


def over(method, errors, **more):
    """One sequence of each scene."""
    return [record(method, f"s{i}", e, scene=f"scene{i:02d}", **more) for i, e in enumerate(errors)]


@pytest.fixture
def twelve():
    """Twelve scenes: a method that is always right, one that is wrong in one scene, and one that is never right."""
    good = [0.1 + i / 100 for i in range(12)]
    return [*over("good+s", good), *over("near+s", [*good[:11], 3.0]), *over("bad+s", [4.0] * 12)]


def test_rows_state_which_ranks_the_scenes_can_distinguish(twelve):
    good, near, bad = rank_methods(twelve)
    assert (good.rank, near.rank, bad.rank) == (1, 2, 3)
    assert (good.level_with_best, near.level_with_best, bad.level_with_best) == (True, True, False)
    assert (near.rank_best, near.rank_worst) == (1, 2)
    assert (bad.rank_best, bad.rank_worst) == (3, 3)
    assert good.answerable_1dof_low == pytest.approx(0.81, abs=0.01)
    assert good.answerable_1dof_high == 1
    assert near.answerable_1dof_low < 11 / 12 < near.answerable_1dof_high
    assert 0.7 < bad.behind_best_low < bad.behind_best_high == 1
    assert good.median_error_dof_low < good.median_error_dof == pytest.approx(0.155)
    by_name = {c.name: c for c in ranking([good, near, bad]).shown}
    assert [by_name["rank"].text(r) for r in (good, near, bad)] == ["1", "2~", "3"]
    assert by_name["rank_best"].text(near) == "1–2"


def test_with_two_scenes_the_table_has_no_interval_and_says_why(tmp_path):
    some = [*over("a+s", [0, 0]), *over("b+s", [9, 9])]
    rows = rank_methods(some)
    assert (rows[0].rank_best, rows[0].answerable_1dof_low, rows[0].level_with_best) == (None,) * 3
    assert rows[0].missing_reason == "2 of 3 required scenes"
    assert "rank_best" not in {c.name for c in ranking(rows).shown}
    assert verdict_on(rows, some) == (
        "Undecided: 2 scenes (intervals need 3) cannot tell these 2 methods apart.",
        "a+s is right on 100% of 2 sequences, averaged over scenes; no other method is right more often.",
    )
    write_board(tmp_path, some)
    document = json.loads((tmp_path / "leaderboard.json").read_text())
    assert document["intervals"]["unknown"] == "2 of 3 required scenes"
    assert document["rows"][0]["answerable_1dof_low"] is None
    assert "Undecided: 2 scenes (intervals need 3) cannot" in (tmp_path / "leaderboard.md").read_text()


def test_notes_mention_few_scenes_and_two_machines(twelve):
    assert any("over 12 scenes holds alone" in note for note in notes_on(twelve))
    few = [*over("a+s", [0, 0, 0]), *over("b+s", [0, 0, 9])]
    assert verdict_on(rank_methods(few), few) == (
        "Undecided: 3 scenes cannot tell these 2 methods apart.",
        "a+s is right on 100% of 3 sequences, averaged over scenes; no other method is right more often.",
    )
    mixed = [*over("a+s", [0, 0, 0], machine="x, 2 cores"), *over("b+s", [0, 0, 0], machine="y, 9 cores")]
    notes = warnings_on(rank_methods(mixed), mixed)
    assert "Seconds cannot be compared: they come from 2 machines: x, 2 cores; y, 9 cores." in notes


def test_a_single_recording_names_the_methods_that_are_right_and_shows_their_answers():
    one = [record("a+s", "x", 0.1), record("b+s", "x", 0.3), record("c+s", "x", 5.0)]
    rows = rank_methods(one)
    assert verdict_on(rows, one) == ("Right within 1 DoF: 2 of 3 methods.", "a+s, b+s.")
    assert verdict_on(rank_methods(one[2:]), one[2:]) == ("Right within 1 DoF: 0 of 1 method.", "")
    shown = {c.name: c for c in ranking(rows, answers={r.who.method: r for r in one}).shown}
    assert [shown["frame"].text(row) for row in rows] == ["410", "430", "800"]
    assert "frame" not in {c.name for c in ranking(rows).shown}


def test_a_truth_without_a_depth_of_focus_asks_for_it_and_shows_errors_of_the_travel():
    some = [record("a+s", "x", 0.1, depth_of_focus=None)]
    rows = rank_methods(some)
    assert verdict_on(rows, some)[1] == "State it to saf-gen import: --depth-of-focus NEAR FAR."
    shown = {c.name for c in ranking(rows).up_to(1).shown}
    assert "median_error_travel" in shown
    assert "median_error_dof" not in shown


def test_closed_loop_figures_have_a_column_only_in_the_closed_loop():
    known = {"track": "closed_loop", "time_to_focus_s": 0.2, "truth_frame": None}
    live = [record("a+s", "x", 0.1, reversals=2, **known), record("a+s", "y", 0.1, reversals=3, **known)]
    (row,) = rows = rank_methods(live)
    assert (row.reversals, row.hunting, row.time_to_focus_s) == (2.5, 0.5, 0.2)
    shown = {c.name: c.text(row) for c in ranking(rows).shown}
    assert (shown["reversals"], shown["hunting"], shown["time_to_focus_s"]) == ("2.5", "50%", "0.200")
    assert "median_error_frames" not in shown
    live_only = {"reversals", "hunting", "time_to_focus_s"}
    assert live_only & {c.name for c in ranking(rank_methods([record("a+s", "x", 0.1)])).shown} == set()


def test_no_two_keys_are_the_same_whatever_lights_are_called(tmp_path):
    """Lights may be named like the ends of an interval, or like the key of another light."""
    lights = ("low", "high", "constant", "light_low")
    records = [
        record("m+s", f"{scene}-{light}", 0.1 if light == "low" else 5.0, scene=scene, light=light)
        for scene in ("a", "b", "c")
        for light in lights
    ]
    rows = rank_methods(records)
    keys = [c.name for c in ranking(rows).columns]
    assert len(keys) == len(set(keys))
    assert {f"answerable_1dof_light_{light}" for light in lights} < set(keys)
    write_board(tmp_path, records)
    with (tmp_path / "leaderboard.csv").open(newline="") as file:
        header, line = csv.reader(file)
    assert header == keys
    cells = dict(zip(header, line, strict=True))
    document = json.loads((tmp_path / "leaderboard.json").read_text())
    (row,) = document["rows"]
    assert set(row) == {*keys, "tied"}
    assert list(document["columns"]) == keys
    assert (row["answerable_1dof_light_low"], row["answerable_1dof_light_high"]) == (1, 0)
    assert row["answerable_1dof_low"] < 0.25 < row["answerable_1dof_high"]  # a quarter in each scene
    assert (cells["answerable_1dof_light_low"], cells["answerable_1dof_low"]) == (
        "1.0",
        str(row["answerable_1dof_low"]),
    )


OFF = {"focus_off_dof": 3.0}


@pytest.mark.parametrize(
    ("inside", "outside", "expected"),
    [  # answerable success within ½ and 1 DoF, false answers, false abstentions, cost, median error
        ("right", "silent", (1, 1, 0, 0, 0, 0.2)),
        ("right", "answers", (1, 1, 1, 0, 0.5, 0.2)),
        ("near", "silent", (0, 1, 0, 0, 0, 0.8)),
        ("wrong", "silent", (0, 0, 0, 0, 0.5, 4.0)),
        ("wrong", "answers", (0, 0, 1, 0, 1, 4.0)),
        ("silent", "silent", (0, 0, 0, 1, 0.25, None)),
        ("silent", "answers", (0, 0, 1, 1, 0.75, None)),
        ("breaks", "breaks", (0, 0, 0, 0, 1, None)),
    ],
)
def test_answers_rank_where_there_is_one_and_both_errors_of_abstaining_stand_beside(inside, outside, expected):
    def one(what, sequence, **more):
        if what in ("silent", "breaks"):
            return failed("m+s", sequence, "abstained" if what == "silent" else "failed", **more)
        return record("m+s", sequence, {"right": 0.2, "near": 0.8, "wrong": 4.0, "answers": 5.0}[what], **more)

    records = [one(inside, "in"), one(outside, "out", **OFF)]
    (row,) = rank_methods(records)
    columns = ("answerable_half_dof", "answerable_1dof", "false_answers", "false_abstentions", "error_cost")
    found = (*(getattr(row, name) for name in columns), row.median_error_dof)
    assert found == tuple(pytest.approx(x) if x is not None else None for x in expected)
    assert (row.answerable, row.without_answer, row.rank) == (1, 1, 1)
    text = {c.name: c.text(row) for c in ranking([row]).shown}
    assert text["false_answers"] == f"{expected[2]} of 1"
    assert "on the 1 of 2 sequences with an answer; on the 1 without" in " ".join(rule_of(records))


def test_a_method_that_only_abstains_better_has_the_same_rank():
    """The right to abstain wins nothing where there is an answer: this was the lead of one method."""
    answers = [record("a+s", "in", 0.2), record("a+s", "out", 5.0, **OFF)]
    rows = rank_methods([*answers, record("b+s", "in", 0.2), failed("b+s", "out", "abstained", **OFF)])
    assert [(row.method, row.rank, row.false_answers) for row in rows] == [("a+s", 1, 1), ("b+s", 1, 0)]


def test_where_no_sequence_has_an_answer_nobody_ranks():
    rows = rank_methods([record("a+s", "out", 5.0, **OFF), record("b+s", "out", 0.2, **OFF)])
    assert {(row.rank, row.answerable_1dof, row.false_answers) for row in rows} == {(None, None, 1)}


def test_the_lost_sharpness_has_its_median_and_its_ninetieth_percentile():
    lost = [0.1, 0.2, 0.9, None]
    (row,) = rank_methods([record("m+s", f"{i}", 0.2, sharpness_lost=x) for i, x in enumerate(lost)])
    assert (row.median_sharpness_lost, row.p90_sharpness_lost) == pytest.approx((0.2, 0.76))
    assert "median_sharpness_lost" not in {c.name for c in ranking(rank_methods([record("m+s", "a", 0.2)])).shown}


def test_success_by_sharpness_is_over_the_sequences_that_state_it_and_an_abstention_is_no_success():
    lost = {"a": 0.05, "b": 0.0501, "moves": None}
    rows = rank_methods(
        [
            *(record("m+s", name, 3.0, scene=name, sharpness_lost=x) for name, x in lost.items()),
            *(record("none+s", name, 0.0, scene=name) for name in ["moves"]),
            *(failed("none+s", name, "abstained", scene=name) for name in ["a", "b"]),
        ]
    )
    assert {row.method: row.answerable_lost_5 for row in rows} == {"m+s": 0.5, "none+s": 0.0}
    assert [row.method for row in rows if row.rank == 1] == ["none+s"]  # the other unit ranks


def test_the_error_from_the_optimum_is_not_that_from_the_truth():
    answers = [record("m+s", f"{n}", error, optimum=0.5 / 8) for n, error in enumerate([0.5, 0.75, 2.5])]
    rows = rank_methods([*answers, record("m+s", "unknown", 9.0)])
    assert (rows[0].median_error_optimum_dof, rows[0].median_error_dof) == (0.25, 1.625)
    assert "median_error_optimum_dof" not in {c.name for c in ranking(rank_methods([record("m+s", "a", 0.2)])).shown}


def test_a_file_says_by_which_rule_it_ranks(tmp_path, records):
    write_board(tmp_path, records)
    document = json.loads((tmp_path / "leaderboard.json").read_text())
    assert document["ranked_by"] == "answerable_1dof"
    assert document["ranked_by"] in document["columns"]
