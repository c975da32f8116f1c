"""Commands that are stopped at a change of the disk lose nothing, at some of the points of tools/kill_points.py."""

import subprocess
import sys
from pathlib import Path

import pytest

TOOL = Path(__file__).parent.parent / "tools" / "kill_points.py"


@pytest.mark.slow
@pytest.mark.parametrize("every", [50, pytest.param(25, marks=pytest.mark.long)])
def test_a_writer_that_is_stopped_anywhere_loses_nothing_and_leaves_nothing(every):
    """One point in 50 of the commands that compute little, with the three signals in turn."""
    commands = ["--only", "import", "export", "tune", "pack"]
    command = [sys.executable, TOOL, *commands, "--every", str(every), "--first", "4"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=500)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.endswith("points, 0 wrong\n")
    assert len(done.stdout.splitlines()) == 5
