"""What README and the first tutorial show is what a reader gets: an answer in focus, and the table that is printed."""

import os
import re
import subprocess
import sys

import pytest
from small_dataset import HERE

ROOT = HERE.parent
README, TUTORIAL = "README.md", "docs/start.md"


def block(page, pattern):
    """The first block of code of a page that holds the pattern."""
    blocks = re.findall(r"^```\w*\n(.*?)^```$", (ROOT / page).read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    return next(text for text in blocks if re.search(pattern, text))


def test_the_python_code_of_readme_answers_within_the_depth_of_focus(capsys):
    exec(compile(block(README, "saf_gen.sample"), README, "exec"), {})
    sharpest, truth, near, far = map(float, re.findall(r"0\.\d{3}", capsys.readouterr().out))
    assert near < sharpest < far
    assert near < truth < far


@pytest.mark.slow
def test_the_leaderboards_of_the_pages_have_the_columns_that_are_printed(tmp_path):
    command = [sys.executable, "-m", "saf_gen", "evaluate", "sample", "--out", str(tmp_path / "made")]
    printed = subprocess.run(command, env={**os.environ, "COLUMNS": "120"}, capture_output=True, text=True, check=True)
    for page in (README, TUTORIAL):
        shown = block(page, "err DoF")
        assert headings(shown) == headings(printed.stdout), page
        methods = re.findall(r"\w+\+\w+", shown)
        assert len(methods) > 5
        assert all(f" {method} " in printed.stdout for method in methods)


def headings(text):
    return next(line for line in text.splitlines() if " method " in line).split()
