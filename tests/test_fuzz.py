"""A few damaged inputs of every kind; the full runs are `python tools/fuzz` and tools/fuzz/flips.py."""

import json
import os
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

from saf_gen.leaderboard.report import evaluation_folder

ROOT = Path(__file__).parents[1]
SEED = 41


def run(*arguments):
    """Run a script of tools/ with this checkout's package."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, *map(str, arguments)]
    return subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)


@pytest.mark.slow
@pytest.mark.parametrize("of_each_kind", [2, pytest.param(8, marks=pytest.mark.long)])
def test_no_spoiled_input_ends_in_anything_but_one_line(tmp_path, of_each_kind):
    inputs = 17 * of_each_kind
    done = run("tools/fuzz", "--inputs", inputs, "--seed", SEED, "--folder", tmp_path)
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-2000:]
    assert f"{inputs} inputs of 17 kinds, seed {SEED}: 0 faults" in done.stdout


@pytest.mark.slow
@pytest.mark.parametrize("flips", [12, pytest.param(40, marks=pytest.mark.long)])
def test_no_flipped_bit_is_read_in_silence(flips, monkeypatch, tmp_path, capsys):
    """In this process, because starting another one takes longer than all flips."""
    kinds = ["stream", "index of shards", "shard", "focal stack", "note of a focal stack"]
    words = ["--flips", flips, "--seed", SEED, *(word for kind in kinds for word in ("--kind", kind))]
    monkeypatch.syspath_prepend(ROOT / "tools/fuzz")
    monkeypatch.chdir(tmp_path)  # restored afterwards: the tool changes the directory
    monkeypatch.setattr(evaluation_folder, "plot_report_figures", None)  # restored afterwards: the tool replaces it
    monkeypatch.setattr(sys, "argv", ["flips.py", *map(str, words)])
    assert import_module("flips").main() == 0
    found = [json.loads(line) for line in capsys.readouterr().out.splitlines() if line.startswith("{")]
    assert [one["kind"] for one in found] == kinds
    assert all(one["told"] + one["harmless"] == flips for one in found), found
    assert sum(one["told"] for one in found) > 0.75 * 5 * flips
