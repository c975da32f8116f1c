"""Submissions: missing parts are listed, and no code in an untrusted folder is run."""

import json
from dataclasses import replace

import pytest
from handmade_records import record
from planted_sweeps import list_streams, write_sweep
from refusals import refusal

from saf_gen.benchmark.method_spec import TunedMethod, format_tuned
from saf_gen.benchmark.records import format_records, read_records
from saf_gen.leaderboard.submission import check_submission, create_submission

FILLED = {
    'title: ""': "title: Mean counts",
    "authors: []": "authors: [Ada Lovelace]",
    'licence: ""': "licence: Apache-2.0",
    'date: ""': 'date: "2026-11-22"',
    'method: ""': "method: method.py:Mine+argmax",
    "dataset: saf_bench-v3": "dataset: small",
    ": false": ": true",
}


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    """One sweep of the split test."""
    folder = tmp_path_factory.mktemp("data")
    write_sweep(folder / "test/board.h5", 300.0)
    return list_streams(folder, {"id": "board"})


@pytest.fixture
def folder(tmp_path):
    """A complete submission: a method in a file, and its answer to the one sequence."""
    folder = tmp_path / "my_method"
    card = create_submission(folder)
    text = card.read_text()
    for old, new in FILLED.items():
        assert old in text
        text = text.replace(old, new)
    card.write_text(text)
    code = "open('ran', 'w')\n\ndef Mine(window):\n    return float(window.counts.mean())\n"
    (folder / "method.py").write_text(code)
    (folder / "evaluation").mkdir()
    answers = [record("there/method.py:Mine+argmax", "board", 0.2), record("sd+argmax", "board", 0.1)]
    (folder / "evaluation/records.jsonl").write_text(format_records(answers))
    return folder


def edit(folder, old, new):
    card = folder / "submission.yaml"
    assert old in card.read_text()
    card.write_text(card.read_text().replace(old, new))


def errors(folder, **options):
    return {f.check: f.text for f in check_submission(folder, **options) if f.level == "error"}


def test_a_new_submission_says_all_that_is_missing(call, tmp_path):
    code, out, _ = call("submit", "new", tmp_path / "mine")
    assert code == 0
    assert out.startswith(f"{tmp_path / 'mine/submission.yaml'}\n")
    found = errors(tmp_path / "mine")
    assert set(found) == {"title", "authors", "licence", "date", "method", "answers", "statements"}
    assert found["method"] == "neither method nor predictions is given: name one of the two"
    code, out, _ = call("submit", "check", tmp_path / "mine")
    assert (code, out.splitlines()[-1]) == (1, "7 to do")
    assert "mine/submission.yaml exists already" in call("submit", "new", tmp_path / "mine")[2]


def test_a_complete_submission_is_complete_and_its_code_was_not_run(call, folder, dataset, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, _ = call("submit", "check", folder, "--on", dataset)
    assert (code, out.splitlines()[-1]) == (0, "complete")
    assert "1 of 1 that have an answer within 1 depth of focus, 0 false answers" in out
    assert "warning verified: nobody has run it again: saf-gen leaderboard verify" in out
    assert not (tmp_path / "ran").exists()
    found = json.loads(call("submit", "check", folder, "--json")[1])
    assert {one["check"] for one in found} == {"date", "method", "answers", "verified", "statements"}


@pytest.mark.parametrize(
    ("old", "new", "check", "message"),
    [
        ("method.py:Mine", "method.py:Nine", "method", "did you mean 'Mine'?"),
        ("method.py:Mine", "../method.py:Mine", "method", "is outside"),
        ("method.py:Mine", "os.path:join", "method", "'os.path:join' is code outside the folder"),
        ("method.py:Mine+argmax", "method.py:Mine_n_tfi+method.py:Mine_n", "method", "did you mean 'Mine'?"),
        ("method.py:Mine+argmax", "sd+argmaxx", "method", "did you mean 'argmax'?"),
        ("method.py:Mine+argmax", "sd", "method", "allowed: MEASURE+SEARCH"),
        ('predictions: ""', "predictions: answers.jsonl", "method", "method and predictions are both given"),
        ("track: recorded", "track: closed_loop", "answers", "their track is recorded, not closed_loop"),
        ("licence: Apache-2.0", "licence: mine, all mine", "licence", "is not an SPDX name"),
        ("2026-11-22", "22.11.2026", "date", "'22.11.2026' is not a date"),
        ('constants: ""', "constants: best.json", "constants", "best.json is not in"),
        ("test_was_run_once: true", "test_was_run_once: false", "statements", "not confirmed: test was run once"),
    ],
)
def test_a_field_that_does_not_fit_is_reported(folder, old, new, check, message):
    edit(folder, old, new)
    assert message in errors(folder)[check]


def test_a_measure_of_a_file_may_be_handed_in_divided_by_brightness_and_from_intervals(folder):
    edit(folder, "method.py:Mine+argmax", "method.py:Mine_n_tfi+argmax")
    assert "method" not in errors(folder)


def test_another_dataset_than_the_card_names_is_reported(folder, dataset):
    assert "dataset" not in errors(folder, dataset=dataset)
    edit(folder, "dataset: small", "dataset: saf_bench-v3")
    assert errors(folder, dataset=dataset)["dataset"] == f"the card names saf_bench-v3, but {dataset} is small"


def test_a_file_that_is_no_python_is_reported(folder):
    (folder / "method.py").write_text("def Mine(:\n")
    assert "is not Python" in errors(folder)["method"]


def test_answers_to_other_sequences_are_reported(folder, dataset):
    more = [record("method.py:Mine+argmax", name, 0.2) for name in ("board", "leaf")]
    (folder / "evaluation/records.jsonl").write_text(format_records(more))
    assert errors(folder, dataset=dataset)["answers"] == "2 sequences, but 1 in the dataset: leaf is not in both"
    (folder / "evaluation/records.jsonl").write_text(format_records([record("sd+argmax", "board", 0.1)]))
    assert "there is no row of method.py:Mine+argmax, only of sd+argmax" in errors(folder)["answers"]


@pytest.mark.parametrize(("split", "wrong"), [("test", True), ("train", False)])
def test_constants_are_tuned_on_other_splits(folder, split, wrong):
    tuned = TunedMethod("sd+argmax", "mine", split, "recorded", "", "target", 1, "d", "1", ())
    (folder / "best.json").write_text(format_tuned(tuned))
    edit(folder, 'constants: ""', "constants: best.json")
    assert ("constants" in errors(folder)) is wrong


def test_a_forged_answer_that_was_run_again_is_an_error(call, folder, dataset):
    edit(folder, "method.py:Mine+argmax", "sd+argmax")
    evaluation = folder / "evaluation"
    assert call("evaluate", dataset, "--method", "sd+argmax", "--out", evaluation)[0] == 0
    assert call("leaderboard", "verify", evaluation, "--on", dataset)[0] == 0
    assert {f.check: f.text for f in check_submission(folder, dataset=dataset)}["verified"] == "re-run here"
    (forged,) = (replace(one, frames_seen=one.frames_seen - 1) for one in read_records(evaluation))
    (evaluation / "records.jsonl").write_text(format_records([forged]))
    assert call("leaderboard", "verify", evaluation, "--on", dataset)[0] == 1
    assert "answers differ when the method is run again" in errors(folder, dataset=dataset)["verified"]


def test_answers_of_another_program_stay_a_claim(folder):
    edit(folder, "method: method.py:Mine+argmax", 'method: ""')
    edit(folder, 'predictions: ""', "predictions: answers.jsonl")
    (folder / "answers.jsonl").write_text('{"method": "my_method", "sequence": "board", "frame": 310.0}\n')
    (folder / "evaluation/records.jsonl").write_text(format_records([record("my_method", "board", 0.2)]))
    assert errors(folder) == {}


def test_a_card_that_cannot_be_read_is_one_line(call, tmp_path, folder):
    assert "there is no submission.yaml" in refusal(list, check_submission(tmp_path)).problem
    edit(folder, "track: recorded", "track: racing")
    code, _, err = call("submit", "check", folder)
    assert (code, err.count("\n")) == (2, 1)
    assert "submission.yaml:9: track is 'racing'; allowed: recorded, closed_loop" in err
    assert "cannot be called" in refusal(create_submission, tmp_path / "a b").problem
