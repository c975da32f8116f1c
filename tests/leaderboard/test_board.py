"""Evaluations read back in Python, and as a notebook shows them."""

import csv

import pytest
from handmade_evaluations import write_board
from handmade_records import record
from refusals import refusal

import saf_gen
from saf_gen.leaderboard import read_leaderboard


@pytest.fixture
def evaluation(tmp_path):
    """The folder of an evaluation of two methods on two sequences: the first is right on one, the second on both."""
    records = [record("sd+argmax", "a", 0.0), record("sd+argmax", "b", 3.0)]
    records += [record("<b>+argmax", name, 0.0) for name in "ab"]
    write_board(tmp_path, records)
    return tmp_path


def test_a_leaderboard_is_a_sequence_of_rows_best_first(evaluation):
    board = saf_gen.read_leaderboard(evaluation)
    assert [row.method for row in board] == ["<b>+argmax", "sd+argmax"]
    assert (len(board), board[1].rank, len(board.records)) == (2, 2, 4)
    assert repr(board) == "<Leaderboard: 2 methods, 2 sequences; first: <b>+argmax>"


def test_dictionaries_have_the_keys_of_the_csv(evaluation):
    with (evaluation / "leaderboard.csv").open(newline="") as file:
        written = list(csv.DictReader(file))
    dicts = read_leaderboard(evaluation / "records.jsonl").to_dicts()
    assert [list(one) for one in dicts] == [list(one) for one in written]
    assert [str(one["rank"]) for one in dicts] == [one["rank"] for one in written]


def test_a_notebook_shows_a_table_that_no_name_can_break(evaluation):
    shown = read_leaderboard(evaluation)._repr_html_()
    assert shown.count("<tr>") == 3
    assert "&lt;b&gt;+argmax</td>" in shown
    assert "<b>" not in shown


def test_reading_without_an_evaluation_is_refused():
    assert refusal(read_leaderboard).problem == "no evaluation is named"
