"""The tables of pages of results, which studies/ranking/result_tables.py makes from packed records."""

import re
from collections import Counter

import pytest
from handmade_records import failed, record

from studies.ranking import result_tables
from studies.ranking.packed_records import write_packed_records

GOOD, BAD = "fine_structure+bell_vote", "er_sumsq+argmax"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Records of two places: one method is right everywhere, the other is wrong under the darker light."""
    folder = tmp_path_factory.mktemp("page")
    for name, track in (("inside", "recorded"), ("loop_piezo", "closed_loop")):
        records = [
            record(
                method,
                f"{scene}-{light}",
                3.0 if (method, light) == (BAD, "darker") else 0.1,
                scene=f"scene{scene}",
                light=light,
                track=track,
                focus_off_dof=0.0,
                stratum="one depth" if scene else "relief",
                time_to_focus_s=0.25 if track == "closed_loop" else None,
            )
            for method in (GOOD, BAD)
            for scene in range(12)
            for light in ("constant", "darker")
        ]
        write_packed_records(folder / f"{name}-records.xz", records)
    return folder


def make(folder, kind, columns):
    page = f"before\n\n<!-- table: {kind} {columns} -->\nold\n<!-- end -->\n\nafter\n"
    made = result_tables.rewrite(page, folder)
    assert made.startswith(f"before\n\n<!-- table: {kind} {columns} -->\n\n|")
    assert made.endswith("|\n\n<!-- end -->\n\nafter\n")
    assert "old" not in made
    assert result_tables.rewrite(made, folder) == made, "made again, the page is the same"
    head, rule, *lines = re.findall(r"^\|(.*)\|$", made, re.MULTILINE)
    cells = [line.split("|") for line in (head, *lines)]
    assert {len(line) for line in cells} == {len(rule.split("|"))}
    return cells


def test_the_table_of_all_methods_has_success_with_its_interval_best_first(folder):
    head, first, second = make(folder, "all", "inside")
    assert head[:4] == ["#", "method", "inside: ≤ 1 DoF, %", "≤ ½"]
    assert (first[:2], first[3:]) == (["1", f"`{GOOD}`"], ["100", "0.10", "100"])
    assert first[2].startswith("100 [")
    assert (second[:2], second[3]) == (["2", f"`{BAD}`"], "50")


def test_a_column_may_be_a_bin_of_a_condition(folder):
    head, *lines = make(folder, "success", "inside inside[light=darker] inside[stratum=one depth]")
    assert head == ["method", "inside", "inside, darker", "inside, one depth"]
    assert lines == [[f"`{GOOD}`", "100 (100)", "100 (100)", "100 (100)"], [f"`{BAD}`", "50 (50)", "0 (0)", "50 (50)"]]


def test_the_closed_loop_has_the_time_to_focus_of_each_drive(folder):
    assert make(folder, "drives", "loop_piezo") == [
        ["method", "piezo"],
        [f"`{GOOD}`", "100, 0.25"],
        [f"`{BAD}`", "50, 0.25"],
    ]


def test_false_answers_are_counted_beside_false_abstentions(tmp_path):
    """Of three recordings without an answer one is answered; of twelve with one, two get none."""
    records = [record(BAD, f"{n}", 0.1, scene=f"s{n}", focus_off_dof=0.0) for n in range(10)]
    records += [failed(BAD, f"{n}", "abstained", scene=f"s{n}", focus_off_dof=0.0) for n in (10, 11)]
    records += [failed(BAD, f"{n}", "abstained", scene=f"s{n}", focus_off_dof=2.0) for n in (12, 13)]
    records += [record(BAD, "14", 2.5, scene="s14", focus_off_dof=2.0)]
    records += [record(GOOD, f"{n}", 0.1, scene=f"s{n}", focus_off_dof=2.0 if n > 11 else 0.0) for n in range(15)]
    write_packed_records(tmp_path / "box-records.xz", records)
    _, line = make(tmp_path, "abstention", "box")
    assert line == [f"`{BAD}`", "1", "2"], "a method that always answers has no row"


def test_wrong_answers_are_counted_and_those_that_are_far_off(tmp_path):
    errors = 0.1, 0.9, 1.5, 2.5, -7.0
    shown = result_tables.SHOWN[:3]
    records = [record(m, f"{n}", e, scene=f"s{n}", focus_off_dof=0.0) for m in shown for n, e in enumerate(errors)]
    records += [record(m, "9", 9.0, scene="s9", focus_off_dof=3.0) for m in shown]  # nothing could be right there
    write_packed_records(tmp_path / "inside-records.xz", records)
    _, *lines = make(tmp_path, "wrong", "inside")
    assert lines == [[f"`{method}`", "3 of 5 (2)"] for method in shown]


def test_methods_that_stop_early_are_listed_with_the_share_of_the_frames_that_they_saw(tmp_path):
    records = [
        record(method, f"{n}", 0.1, scene=f"s{n}", frames_seen=seen, frames=800)
        for method, seen in ((GOOD, 800), (BAD, 200))
        for n in range(4)
    ]
    write_packed_records(tmp_path / "inside-records.xz", records)
    assert make(tmp_path, "frames", "inside") == [["method", "inside"], [f"`{BAD}`", "25: 100"]]


def test_records_that_cannot_be_read_are_one_line(tmp_path, capsys):
    page = tmp_path / "page.md"
    page.write_text("<!-- table: all inside -->\n<!-- end -->\n")
    assert result_tables.main([str(page)]) == 2
    assert "inside-records.xz" in capsys.readouterr().err
    assert page.read_text() == "<!-- table: all inside -->\n<!-- end -->\n", "the page is as it was"


@pytest.mark.parametrize(
    ("table", "words"), [("al inside", "unknown table 'al'"), ("all inside[ligth=darker]", "unknown condition 'ligth'")]
)
def test_a_typo_in_a_page_is_one_line(folder, tmp_path, table, words, capsys):
    page = tmp_path / f"{folder.name}.md"
    page.write_text(f"<!-- table: {table} -->\n<!-- end -->\n")
    page.with_suffix("").symlink_to(folder)
    assert result_tables.main([str(page)]) == 2
    assert words in capsys.readouterr().err
    assert result_tables.main([str(tmp_path / "missing.md")]) == 2
    assert "missing.md" in capsys.readouterr().err


@pytest.mark.parametrize("page", ["saf_bench.md", "cameras.md"])
def test_a_page_names_files_that_are_beside_it_and_no_table_twice(page):
    page = result_tables.PAGE.with_name(page)
    asked = [found.group(2, 3) for found in result_tables.TABLE.finditer(page.read_text())]
    assert {kind for kind, _ in asked} <= set(result_tables.TABLES)
    assert max(Counter(asked).values()) == 1
    beside = {path.name.removesuffix("-records.xz") for path in page.with_suffix("").iterdir()}
    assert {file for _, names in asked for file, _, _ in result_tables.COLUMN.findall(names)} <= beside
