"""Evaluations read back in Python, and as a notebook shows them."""

import csv

import numpy as np
import pytest
from handmade_evaluations import write_board
from handmade_records import record
from refusals import assert_says, refusal

import saf_gen
from saf_gen.core.config import registry
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
    assert [line.split()[:2] for line in repr(board).splitlines()[2:4]] == [["1", "<b>+argmax"], ["2", "sd+argmax"]]


def test_the_text_of_a_leaderboard_is_the_table_of_the_terminal_in_80_columns(evaluation):
    lines = repr(read_leaderboard(evaluation)).splitlines()
    assert lines[4].startswith("Undecided: ")
    assert lines[0].split()[:3] == ["#", "method", "≤½"]
    assert max(map(len, lines)) <= 80


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


def blur(counts):
    return 1 - np.ptp(counts) / counts.max()


def half_way(view):
    return saf_gen.parts.Answer(view.frames / 2)


@pytest.mark.parametrize(
    ("methods", "expected"),
    [
        (["sd+argmax", blur], ["blur+argmax", "sd+argmax"]),
        ([half_way], ["sd+half_way"]),
        (["baselines", blur], ["blur+argmax", "cen+argmax"]),
    ],
)
def test_functions_are_ranked_beside_methods_and_baselines(tmp_path, monkeypatch, methods, expected):
    monkeypatch.setattr("saf_gen.benchmark.evaluate.DEFAULT_RECORDED_METHODS", ("cen+argmax",))
    monkeypatch.setattr(registry, "_registered_here", {kind: {} for kind in registry.PLUGIN_KINDS})
    saf_gen.write_stream(tmp_path / "s.h5", np.random.default_rng(1).random((160, 8, 12)) < 0.3)
    assert sorted(row.method for row in saf_gen.evaluate(tmp_path / "s.h5", methods)) == expected


@pytest.mark.parametrize(
    ("methods", "more", "words"),
    [
        ([lambda counts: 1.0], {}, "a focus measure cannot be called '<lambda>' | a Python identifier"),
        ([open], {}, "focus measure 'open' is not a plug-in | a function or a class"),
        (["sd+argmax"], {"track": "live"}, "unknown track 'live' | recorded"),
    ],
)
def test_what_cannot_be_run_is_refused(tmp_path, methods, more, words):
    assert_says(refusal(saf_gen.evaluate, tmp_path / "none.h5", methods, **more), words)


def test_reading_without_an_evaluation_is_refused():
    assert refusal(read_leaderboard).problem == "no evaluation is named"
