"""Spoiled input of every kind, a few of each: the whole run is `python tools/fuzz`, the flips tools/fuzz/flips.py."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SEED = 41


def run(*arguments):
    """Run a script of tools/ with this checkout's package."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, *map(str, arguments)]
    return subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)


@pytest.mark.slow
def test_no_spoiled_input_ends_in_anything_but_one_line(tmp_path):
    done = run("tools/fuzz", "--inputs", 17 * 8, "--seed", SEED, "--folder", tmp_path)
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-2000:]
    assert f"{17 * 8} inputs of 17 kinds, seed {SEED}: 0 faults" in done.stdout


@pytest.mark.slow
def test_no_flipped_bit_is_read_in_silence():
    kinds = ["stream", "index of shards", "shard", "focal stack", "note of a focal stack"]
    done = run(
        "tools/fuzz/flips.py", "--flips", 40, "--seed", SEED, *(word for kind in kinds for word in ("--kind", kind))
    )
    found = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    assert [one["kind"] for one in found] == kinds, done.stderr[-2000:]
    assert all(one["told"] + one["harmless"] == 40 for one in found), found
    assert sum(one["told"] for one in found) > 150
