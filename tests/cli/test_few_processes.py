"""Where the system lets a user start only a few processes and threads, commands end with one line."""

import os
import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

USER = 100_000 + os.getpid()
"""A user without processes, another one for each process of tests; the limit counts those of a user."""
pytestmark = pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() != 0 or shutil.which("setpriv") is None,
    reason="only root may run commands as a user without processes, by setpriv",
)


@pytest.fixture
def folder():
    """A folder that others may write to, unlike those of tests of root."""
    with TemporaryDirectory() as made:
        Path(made).chmod(0o777)
        yield Path(made)


def run_limited(processes, folder, *words):
    """Run a command as another user, who may read and write everything, and return what it did."""
    capabilities = "-all,+dac_override,+dac_read_search,+fowner"
    as_user = [
        "setpriv",
        f"--reuid={USER}",
        "--clear-groups",
        "--inh-caps",
        capabilities,
        "--ambient-caps",
        capabilities,
    ]
    limit = ["prlimit", f"--nproc={processes}:{processes}"]
    folders = {"HOME": str(folder), "MPLCONFIGDIR": str(folder), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [*as_user, *limit, sys.executable, "-m", "saf_gen", *map(str, words)]
    return subprocess.run(
        command, cwd=folder, env=os.environ | folders, capture_output=True, text=True, timeout=300, check=False
    )


def asked_and_left(refused):
    """Return how many threads and processes a run asks for, and how many the limit leaves, by its one line."""
    return tuple(int(refused.stderr.partition(before)[2].split()[0]) for before in ("allowed: ", "leaves "))


@pytest.mark.slow
@pytest.mark.parametrize("processes", [1, 2, 3])
def test_a_command_that_starts_no_process_needs_none(folder, processes):
    ran = run_limited(processes, folder, "sensors", "list")
    assert (ran.returncode, ran.stderr) == (0, "")
    assert "vidar_400x250" in ran.stdout


@pytest.mark.daily(3)
@pytest.mark.slow
@pytest.mark.parametrize(
    ("share", "workers"), [(0.0, 1), (0.05, 1), (0.1, 1), (0.2, 1), (0.6, 1), (1.0, 1), (0.1, 2), (1.0, 2)]
)
def test_generate_says_in_one_line_that_the_limit_is_low_and_makes_nothing(
    folder, small_recipe, test_scenes, share, workers
):
    """From a single process to all but one of those that the run needs."""
    options = ("generate", small_recipe, "--out", folder / "made", "--workers", workers)
    asked, left = asked_and_left(run_limited(1, folder, *options))
    ran = run_limited(1 + int(share * (asked - left - 1)), folder, *options)
    assert ran.returncode == 2
    assert ran.stderr.startswith("saf-gen: the limit of threads and processes leaves ")
    assert ran.stderr.count("\n") == 1
    assert ran.stdout == ""
    assert not list(folder.rglob("*.h5"))


@pytest.mark.daily(1)
@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 3])
def test_generate_runs_with_as_many_as_it_asks_for(folder, small_recipe, test_scenes, workers):
    options = ("generate", small_recipe, "--out", folder / "made", "--workers", workers)
    limit, ran = 1, run_limited(1, folder, *options)
    for _ in range(4):  # the first threads that a higher limit allows are those of linear algebra
        if ran.returncode != 2:
            break
        asked, left = asked_and_left(ran)
        limit += asked - left
        ran = run_limited(limit, folder, *options)
    assert ran.returncode == 0, ran.stderr
    assert "3 sequences recorded" in ran.stdout


@pytest.mark.slow
def test_evaluate_ends_without_a_traceback(folder):
    ran = run_limited(4, folder, "evaluate", "sample", "--method", "sd+argmax", "--out", folder / "ranked")
    assert ran.returncode in (0, 1)  # a machine of few cores needs no more
    assert "Traceback" not in ran.stderr
    assert "OpenBLAS" not in ran.stderr
    assert ("saf-gen: " in ran.stderr) == (ran.returncode == 1)
