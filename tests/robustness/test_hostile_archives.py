"""No packed file of a stranger costs more than its reader states, ends in more than one line, or is read wrongly."""

import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.parametrize(
    ("count", "seed"), [pytest.param(5, 4, marks=pytest.mark.slow), pytest.param(200, 1, marks=pytest.mark.long)]
)
def test_hostile_files_are_refused_or_read_right_and_cheaply(count, seed):
    """They are drawn in a process of their own, which forks: this one has run compiled code on several threads."""
    tool = Path(__file__).with_name("hostile_archives.py")
    words = [sys.executable, str(tool), "--count", str(count), "--seed", str(seed)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert (done.returncode, "WRONG" in done.stdout, done.stderr) == (0, False, ""), done.stdout
