"""Other doors for code of others: the checks of methods, their place in a row, and measures of one stream."""

import json

import pytest
from planted_sweeps import write_sweep, write_three_sweeps

from saf_gen.benchmark.admission import admit_method
from saf_gen.benchmark.checking import first_failed_check
from saf_gen.benchmark.evaluate import evaluate, score_blocks
from saf_gen.benchmark.records import read_records, write_records
from saf_gen.leaderboard import rank_methods
from saf_gen.leaderboard.results import warnings_on
from saf_gen.leaderboard.tables import ranking
from saf_gen.stream.stream_file import open_stream

THEIRS = """
import ctypes, itertools, os, sys
from dataclasses import dataclass
from typing import ClassVar
import numpy as np
from saf_gen.parts import Answer

STEPS = itertools.count()

def good(counts):
    return float(np.var(counts))

def drifts(counts):
    return float(np.var(counts)) + next(STEPS)

def writes(counts):
    counts[:] = 0
    return 1.0

def raises(counts):
    raise ValueError("no\\nline")

def ends(counts):
    os._exit(0)

def leaves(counts):
    sys.exit()

def crashes(counts):
    ctypes.string_at(0)

def prints(counts):
    print("here", flush=True)
    return float(np.var(counts))

@dataclass(frozen=True)
class Halves:
    halves: ClassVar[bool] = True
    degree: ClassVar[int] = 0
    scale: float = 1.0

    def __call__(self, counts):
        return self.scale * float(np.mean((counts[0] - counts[1].astype(float)) ** 2))

class Answers0:
    causal = True

    def __call__(self, view):
        view.score(0, 10)
        return Answer(-1.0)
"""


@pytest.fixture(scope="module")
def theirs(tmp_path_factory):
    path = tmp_path_factory.mktemp("theirs") / "theirs.py"
    path.write_text(THEIRS)
    return path


@pytest.fixture(scope="module")
def stream(tmp_path_factory):
    path = tmp_path_factory.mktemp("stream") / "a.h5"
    write_sweep(path, 300.0)
    return path


@pytest.mark.slow
@pytest.mark.daily(2)
@pytest.mark.parametrize(
    ("method", "failed"),
    [
        ("{}:good+argmax", ""),
        ("{}:drifts+argmax", "measure, zero when empty"),
        ("{}:raises+argmax", "measure, finite"),
        ("{}:crashes+argmax", "method, process"),
        ("sd+{}:Answers0", "search, answers"),
        ("{}:good+{}:Answers0", "search, answers"),
    ],
)
def test_the_first_check_that_a_method_of_others_fails_is_named(theirs, method, failed):
    found = admit_method(method.replace("{}", str(theirs)))
    assert first_failed_check(found) == failed
    found.guest.close()


@pytest.mark.slow
def test_a_row_says_that_its_method_fails_a_check(theirs, tmp_path):
    good, bad = (f"{theirs}:{name}+argmax:window=50" for name in ("good", "drifts"))
    records = evaluate(write_three_sweeps(tmp_path / "three"), methods=["sd+argmax", good, bad], draw=False).records
    assert {r.who.method: r.who.failed_check for r in records} == {
        "sd+argmax": "",
        good: "",
        bad: "measure, zero when empty",
    }
    write_records(tmp_path / "records.jsonl", records)
    assert read_records(tmp_path) == list(records)
    rows = rank_methods(records)
    note = f"! marks what fails methods check, which says why: {bad} (measure, zero when empty)."
    assert note in warnings_on(rows, records)
    board = ranking(rows)
    assert [row.method for row in rows if board.columns[0].text(row).endswith("!")] == [bad]
    assert [row["failed_check"] for row in board.to_dicts() if row["failed_check"]] == ["measure, zero when empty"]
    assert "zero when empty" in board.to_csv()


@pytest.mark.slow
@pytest.mark.daily(4)
@pytest.mark.parametrize("door", ["score", "view"])
@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("raises", "fails: ValueError: no line; repair it"),
        ("ends", "its process ended with exit code 0"),
        ("leaves", "its code called exit"),
        ("crashes", "SIGSEGV"),
    ],
)
def test_a_measure_that_ends_or_crashes_is_one_line(call, theirs, stream, tmp_path, door, name, says):
    options = ["--window", 400] if door == "score" else ["--window", 100]
    out = tmp_path / f"out.{'csv' if door == 'score' else 'png'}"
    code, shown, err = call(door, stream, "--measure", f"{theirs}:{name}", "--out", out, *options)
    assert (code, shown, err.count("\n"), out.exists()) == (2, "", 1, False)
    assert says in err
    assert f"focus measure '{theirs}:{name}'" in err


@pytest.mark.slow
def test_measures_of_others_score_a_stream_as_in_this_process(call, theirs, stream):
    from saf_gen.plugins.measures import get_measure

    with open_stream(stream) as opened:
        for name in ("good", "good_n", "good_tfi", "Halves", "prints"):
            one = score_blocks(opened, f"{theirs}:{name}", window=100)[1]
            assert one.tolist() == score_blocks(opened, get_measure(f"{theirs}:{name}"), window=100)[1].tolist()
    code, shown, err = call("score", stream, "--measure", f"{theirs}:prints", "--window", 400)
    assert (code, shown.count("\n"), err) == (0, 3, "")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "code", "says"), [("good", 0, "pass"), ("ends", 1, "exit code 0"), ("drifts", 1, "fail")]
)
def test_methods_check_ends_well_whatever_it_checks(call, theirs, name, code, says):
    found = call("methods", "check", f"{theirs}:{name}", "--json")
    assert (found[0], found[2]) == (code, "")
    assert says in found[1]
    assert {one["name"] for one in json.loads(found[1])} == {f"{theirs}:{name}"}


@pytest.mark.slow
def test_methods_show_describes_code_of_others_without_loading_it_here(call, theirs):
    code, shown, _ = call("methods", "show", f"{theirs}:Halves:scale=2+{theirs}:Answers0")
    assert code == 0
    assert "scale=2 (default: 1.0)" in shown
    assert "search, estimates, causal" in shown
    assert call("methods", "show", f"{theirs}:ends")[0::2] == (
        2,
        f"saf-gen: '{theirs}:ends' cannot be loaded: its process ended with exit code 0; repair it\n",
    )
