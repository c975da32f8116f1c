"""``evaluate --failed`` repeats what failed, keeps the other rows, and gives what a new evaluation gives."""

import json

import pytest
from planted_sweeps import write_three_sweeps

from saf_gen.benchmark.guests import guest
from saf_gen.benchmark.records import read_records, record_to_json, write_records
from saf_gen.core.config import registry

METHODS = ("--method", "sd+argmax:window=100", "--method", "sd+mine.py:search")
SEARCH = """
import pathlib
from saf_gen.parts import Answer
RUNS = pathlib.Path(__file__).parent / "runs"

def search(view):
    with RUNS.open("a") as file:
        file.write("run\\n")
    score = view.score(0, 100)
    if STATE in ("broken",) and view.score(300, 400) > score:
        raise RuntimeError("a busy machine")
    return Answer(100.0)
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_three_sweeps(tmp_path / "data")
    (tmp_path / "mine.py").write_text(SEARCH.replace("STATE", "'sound'"))
    yield tmp_path
    for one in list(guest._ALIVE):
        one.close()


def rows(folder):
    return [
        {k: v for k, v in record_to_json(r).items() if k not in ("seconds", "reference_rate")}
        for r in read_records(folder)
    ]


def fail(folder, *, method="sd+mine.py:search", sequences=("two",)):
    """Let some rows of an evaluation look as if the machine had been busy."""
    cleared = ("position", "frame", "error", "error_frames", "error_dof", "blur_px", "time_to_focus_s")
    records = []
    for record in read_records(folder):
        if record.method == method and record.sequence in sequences:
            new = dict.fromkeys(cleared) | {"status": "failed", "note": "over a limit: it did not answer within 60 s"}
            new |= dict.fromkeys(("success_half_dof", "success_1dof", "success_2dof"), False)
            record = type(record)(**{**{f: getattr(record, f) for f in record.__slots__}, **new})
        records.append(record)
    write_records(folder / "records.jsonl", records)


def runs(folder):
    return (folder / "runs").read_text().count("run") if (folder / "runs").exists() else 0


def test_failed_pairs_are_repeated_and_the_result_is_that_of_a_new_evaluation(folder, call):
    assert call("evaluate", "data", *METHODS, "--out", "out")[0] == 0
    fresh, before = rows(folder / "out"), runs(folder)
    fail(folder / "out")
    code, _, err = call("evaluate", "data", *METHODS, "--out", "out", "--failed")
    assert (code, err) == (0, "1 failed pair repeated; 5 pairs of method and sequence kept\n")
    assert rows(folder / "out") == fresh
    assert runs(folder) == before + 1
    assert call("evaluate", "data", *METHODS, "--out", "out", "--failed")[1:] == (
        "split train: 3 sequences of 3 scenes\n",
        "no pair of method and sequence failed, so nothing is repeated\n",
    )


def test_methods_are_those_of_the_evaluation_unless_others_are_named(folder, call):
    assert call("evaluate", "data", "--method", "sd+argmax:window=100", "--out", "out")[0] == 0
    fresh = rows(folder / "out")
    fail(folder / "out", method="sd+argmax:window=100", sequences=("one", "three"))
    code, _, err = call("evaluate", "data", "--out", "out", "--failed")
    assert (code, err) == (0, "2 failed pairs repeated; 1 pair of method and sequence kept\n")
    assert rows(folder / "out") == fresh


def other_code(folder):
    (folder / "mine.py").write_text(SEARCH.replace("STATE", "'sound'").replace("Answer(100.0)", "Answer(101.0)"))


def other_limit(folder):
    return "--limit-s", "50"


def read_late(folder):
    text = SEARCH.replace("STATE", "'sound'").replace("Answer(100.0)", "Answer(float(pathlib.Path(LATE).read_text()))")
    (folder / "mine.py").write_text(text.replace("LATE", repr(str(folder / "late.txt"))))
    (folder / "late.txt").write_text("150")


@pytest.mark.parametrize("change", [other_code, other_limit, read_late])
def test_rows_that_a_new_run_might_answer_otherwise_are_repeated_too(folder, call, change):
    if change is read_late:
        read_late(folder)
    assert call("evaluate", "data", *METHODS, "--out", "out")[0] == 0
    fail(folder / "out")
    options = change(folder) or ()
    if change is read_late:
        (folder / "late.txt").write_text("160")
    code, _, err = call("evaluate", "data", *METHODS, *options, "--out", "out", "--failed")
    assert code == 0
    assert err.startswith(
        "1 failed pair repeated, and 2 pairs whose code, limits or data may not be what they were; 3 "
    )
    for one in list(guest._ALIVE):
        one.close()
    assert call("evaluate", "data", *METHODS, *options, "--out", "new")[0] == 0
    assert rows(folder / "out") == rows(folder / "new")


def test_a_sequence_that_could_not_be_read_counts_as_failed(folder, call):
    (folder / "data/train/two.h5").rename(folder / "two.h5")
    assert call("evaluate", "data", *METHODS, "--out", "out")[0] == 1
    (folder / "two.h5").rename(folder / "data/train/two.h5")
    code, _, err = call("evaluate", "data", *METHODS, "--out", "out", "--failed")
    assert (code, err) == (0, "2 failed pairs repeated; 4 pairs of method and sequence kept\n")
    assert call("evaluate", "data", *METHODS, "--out", "new")[0] == 0
    assert rows(folder / "out") == rows(folder / "new")
    assert json.loads((folder / "out" / "leaderboard.json").read_text())["failures"] == []


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--method", "sd+argmax"), "other methods: sd+argmax:window=100 and 1 more is only in the"),
        ((*METHODS, "--method", "sd+egs_code"), "other methods: sd+egs_code is not in the evaluation"),
        ((*METHODS, "--predictions", "p.jsonl"), "--failed is given with predictions"),
        ((*METHODS, "--cluster", "tcp://127.0.0.1:1"), "--failed is given with a cluster"),
        ((*METHODS, "--track", "closed_loop"), "--failed is given with a closed loop"),
        ((*METHODS, "--split", "test"), "unknown split 'test'"),
        ((*METHODS, "--region", "both"), "sd+argmax:window=100@frame and 1 more is not in the evaluation"),
        ((*METHODS, "--out", "nowhere"), "there is no records.jsonl at 'nowhere'"),
        ((), "names the code 'mine.py:search'"),
    ],
)
def test_options_that_contradict_it_are_refused(folder, call, options, words):
    assert call("evaluate", "data", *METHODS, "--out", "out")[0] == 0
    (folder / "p.jsonl").write_text("".join(
        json.dumps({"method": "net", "sequence": name, "frame": 1}) + "\n" for name in ("one", "two", "three")
    ))  # fmt: skip
    before = rows(folder / "out")
    registry._ALLOWED.clear()
    code, _, err = call("evaluate", "data", *(() if "--out" in options else ("--out", "out")), *options, "--failed")
    assert (code, words in err) == (2, True), (words, err)
    assert len(err.splitlines()) == 1
    assert rows(folder / "out") == before
    assert not (folder / "nowhere").exists()
