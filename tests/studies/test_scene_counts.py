"""Smaller benchmarks drawn from the records of a large one."""

import pytest
from handmade_records import record

from studies.ranking.scene_counts import draw_tables, main, summarise


def make_records(scenes=40):
    """Two methods that are right everywhere and on a fifth of the scenes, under two lights."""
    return [
        record(method, f"s{scene}-{light}", 0.0 if right or scene % 5 == 0 else 9.0, scene=f"s{scene}", light=light)
        for method, right in (("good+s", True), ("bad+s", False))
        for scene in range(scenes)
        for light in ("dim", "bright")
    ]


def test_a_drawn_benchmark_has_so_many_scenes_with_all_their_lights_and_draws_differ():
    tables = draw_tables(make_records(), 6, draws=3)
    assert len(tables) == 3
    assert all(row.answerable == 12 for rows in tables for row in rows)
    assert len({rows[1].answerable_1dof for rows in draw_tables(make_records(), 6, draws=20)}) > 1
    assert len(draw_tables(make_records(), 40, draws=20)) == 1  # there is only one choice of all


def test_more_scenes_tell_more_apart():
    table = summarise(make_records(), (3, 40), draws=10)
    assert table.rows == ["bad+s"]
    method, behind, few, many = (column.text("bad+s") for column in table.shown)
    assert (method, behind) == ("bad+s", "80")
    assert int(few.partition("%")[0]) < int(many.partition("%")[0]) == 100


@pytest.mark.parametrize("name", ["missing.jsonl", "missing.xz", "text.jsonl", "text.xz"])
def test_what_holds_no_records_is_one_line(tmp_path, name, capsys):
    if name.startswith("text"):
        (tmp_path / name).write_text("text\n")
    assert main([str(tmp_path / name)]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert len(printed.err.splitlines()) == 1
