"""Tables in a terminal: nothing that is printed is cut; columns that do not fit are left out and named."""

import json
import os
import re
import subprocess
import sys
from operator import itemgetter

import numpy as np
import pytest
from handmade_evaluations import board_of
from handmade_records import record
from rich.console import Console

import saf_gen
from saf_gen.cli import _tables
from saf_gen.cli._tables import print_leaderboard, print_table
from saf_gen.cli._terminal import err, out, progress_bars, terminal_reporter
from saf_gen.core.config import registry
from saf_gen.core.table import Column, Table
from saf_gen.generate.recipe import recipe_names
from saf_gen.scene.scene_folder import scene_names

TABLE = Table(
    [
        Column("name", itemgetter(0)),
        Column("what it is", itemgetter(1), folds=True),
        Column("digits", itemgetter(2), kind="number", detail=2),
        Column("more", itemgetter(3), detail=1),
    ],
    [("a_name_that_one_must_type", "A line of prose that may be folded at its words.", "0.123456", "yes, and more")],
)


@pytest.fixture
def terminal(monkeypatch):
    """A function that makes the console a terminal of a width in characters."""

    def set_width(width):
        monkeypatch.setattr(out, "_force_terminal", True)
        monkeypatch.setattr(out, "_width", width)

    return set_width


def joined(text):
    return " ".join(text.split())


@pytest.mark.parametrize(("width", "left_out"), [(88, []), (80, ["digits"]), (24, ["digits", "more"])])
def test_a_table_fits_and_no_name_or_figure_is_cut(terminal, capsys, width, left_out):
    terminal(width)
    print_table(TABLE, where_to_find="in a file")
    shown = capsys.readouterr().out
    assert max(map(len, shown.splitlines())) <= width
    assert "…" not in shown
    assert ("0.123456" in shown) == ("digits" not in left_out)
    assert ("yes, and more" in shown) == ("more" not in left_out)
    if width > 24:
        assert "a_name_that_one_must_type" in shown
    assert (f"Columns that do not fit here: {', '.join(left_out)} (in a file)" in joined(shown)) == bool(left_out)


def test_a_table_in_a_pipe_fits_and_names_what_it_leaves_out(monkeypatch, capsys):
    monkeypatch.setattr(_tables, "out", Console(width=120, force_terminal=False))
    print_table(Table([Column(f"column_{i:02}", itemgetter(i), detail=i) for i in range(40)], [["0.123456"] * 40]))
    shown = capsys.readouterr().out
    columns = shown.count("0.123456")
    assert 5 < columns < 12
    assert max(map(len, shown.splitlines()[:4])) <= 120
    assert f"Columns that do not fit here: column_{columns:02}, column_{columns + 1:02}" in joined(shown)


@pytest.mark.slow
@pytest.mark.parametrize(("columns", "width"), [(None, 120), ("200", 200), ("60", 60)])
def test_a_pipe_is_as_wide_as_columns_says_or_120(columns, width):
    environment = {name: value for name, value in os.environ.items() if name != "COLUMNS"}
    environment |= {} if columns is None else {"COLUMNS": columns}
    command = [sys.executable, "-m", "saf_gen", "methods", "list"]
    shown = subprocess.run(command, capture_output=True, text=True, check=True, env=environment).stdout
    widest = max(map(len, shown.splitlines()))
    assert width * 0.75 < widest <= width


@pytest.mark.parametrize(
    ("command", "names"),
    [
        ("scenes list", scene_names()),
        ("recipes list", recipe_names()),
        ("sensors list", ["vidar_400x250_noisy"]),
        ("methods list", [*registry.names("measures"), *registry.names("searches")]),
        ("doctor", ["mitsuba"]),
        ("generate quickstart --dry-run", ["quickstart"]),
        ("methods show sd_code+sgfs_code:dt=50", ["sgfs_code"]),
        ("methods check argmax", ["argmax"]),
        ("inspect STREAM", []),
    ],
)
def test_every_list_fits_a_terminal_of_80_columns_and_no_name_is_cut(call, terminal, tmp_path, command, names):
    terminal(80)
    frames = np.zeros((8, 250, 400), np.uint8)
    saf_gen.write_stream(tmp_path / "a_sequence-continuous-00.h5", frames, provenance={"of": "0123456789" * 20})
    words = [str(tmp_path / "a_sequence-continuous-00.h5") if w == "STREAM" else w for w in command.split()]
    code, shown, _ = call(*words)
    assert code == 0
    assert "…" not in shown
    assert max(map(len, shown.splitlines())) <= 80
    assert set(names) <= set(re.findall(r"[\w-]+", shown))


@pytest.mark.parametrize("command", ["scenes list", "recipes list", "sensors list", "methods list"])
def test_every_list_is_there_for_programs(call, command):
    code, shown, err = call(*command.split(), "--json")
    assert (code, err) == (0, "")
    found = json.loads(shown)
    rows = found["measures"] + found["searches"] if command == "methods list" else found
    assert len(rows) >= 5
    assert all(row and all(isinstance(cell, str) for cell in row.values()) for row in rows)
    assert len({next(iter(row.values())) for row in rows}) == len(rows)


@pytest.mark.parametrize("width", [60, 240])
def test_the_leaderboard_keeps_rank_method_success_and_error(terminal, capsys, width):
    terminal(width)
    records = [
        record(method, f"{scene}-{light}", 0.3, scene=scene, light=light)
        for method in ("sd_code+argmax", "modified_laplacian_n+sgfs_code")
        for scene in ("a", "b")
        for light in ("constant", "continuously_varying")
    ]
    board = board_of(records)
    print_leaderboard(board.ranking, last_words=board.last_words)
    shown = capsys.readouterr().out
    assert max(map(len, shown.splitlines())) <= width
    assert "…" not in shown
    for word in ("#", "method", "≤1 DoF", "err DoF", "modified_laplacian_n+sgfs_code", "sd_code+argmax"):
        assert word in shown
    table, undecided, _ = shown.partition("Undecided: ")
    assert undecided
    assert ("constant" in table) == ("continuously_varying" in table) == (width == 240), "all lights, or none"


def test_columns_of_a_group_are_left_out_together_and_others_fill_the_space(terminal, capsys):
    terminal(40)
    pair = [Column(f"light_{i}_of_two", itemgetter(i), detail=1, together="lights") for i in (1, 2)]
    others = Column("errors", itemgetter(3), detail=1), Column("x", itemgetter(4), detail=2)
    columns = [Column("name", itemgetter(0)), *pair, *others]
    print_table(Table(columns, [["a_name_that_is_long", "1", "2", "0.5", "9"]]))
    shown = capsys.readouterr().out
    assert "errors" in shown.splitlines()[1]
    assert "Columns that do not fit here: light_1_of_two, light_2_of_two, x" in joined(shown)


def test_the_name_of_a_progress_bar_is_not_cut(monkeypatch, capsys):
    monkeypatch.setattr(err, "_force_terminal", True)
    monkeypatch.setattr(err, "_width", 80)
    name = "evaluate a_scene-continuously_varying-00 structure_calibrated+photon_aware:window=100"
    with progress_bars() as bars:
        bars.update(bars.add_task(name, total=1.0), completed=0.5)
    shown = capsys.readouterr().err
    assert "…" not in shown
    assert " 50 %" in shown
    assert all(word in shown for word in name.split())


def test_a_failed_check_is_a_mark_and_a_note_and_leaves_the_lights_in_120_columns(terminal, capsys):
    terminal(120)
    records = [
        record(method, f"{scene}-{light}", 0.3, scene=scene, light=light, failed_check=check)
        for method, check in (("mine.py:A+argmax", "measure, one value for a whole window"), ("sd_code+argmax", ""))
        for scene in ("a", "b")
        for light in ("constant", "continuous", "sudden")
    ]
    board = board_of(records)
    print_leaderboard(board.ranking, last_words=board.last_words)
    shown = joined(capsys.readouterr().out)
    table = shown.partition("Names:")[0]
    assert all(light in table.partition("Columns that")[0] for light in ("constant", "continuous", "sudden"))
    assert "1=! mine.py:A+argmax" in table
    assert "1= sd_code+argmax" in table
    note = "! marks what fails methods check, which says why: mine.py:A+argmax (measure, one value for a whole window)."
    assert shown.count(note) == 1


@pytest.mark.parametrize("is_terminal", [True, False])
def test_progress_stays_on_its_line_whatever_a_sequence_is_called(monkeypatch, capsys, is_terminal):
    monkeypatch.setattr(err, "_force_terminal", is_terminal)
    with progress_bars() as bars:
        report = terminal_reporter("evaluate", bars, parts=2)
        report(1, 2, "first\nsecond\x1b[2J\u202e")
        bars.refresh()
    shown = capsys.readouterr().err
    assert r"first\nsecond\x1b[2J\u202e" in shown
    assert "\nsecond" not in shown
