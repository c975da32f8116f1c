"""Commands that are stopped at a change of the disk lose nothing, and workers that are killed are replaced.

kill_points.py and kill_workers.py here are also commands that try every point and many workers.
"""

import multiprocessing
from concurrent.futures import ProcessPoolExecutor

import kill_workers
import pytest
from kill_points import stop_writers


@pytest.mark.slow
@pytest.mark.parametrize("every", [100, pytest.param(25, marks=pytest.mark.long)])
def test_a_writer_that_is_stopped_anywhere_loses_nothing_and_leaves_nothing(every):
    """One point in 100 of the commands that compute little, with the three signals in turn.

    They are forked from a fresh process, because this one has run compiled code on several threads.
    """
    names = ["import", "export", "tune"]
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        found = pool.submit(stop_writers, names, every=every, first=4).result(timeout=500)
    assert [one["writer"] for one in found] == ["export", "import", "tune"]
    assert min(one["points"] for one in found) > 0
    assert [finding for one in found for finding in one["findings"]] == []


@pytest.mark.long
@pytest.mark.parametrize("trial", ["pool", "dask", "scheduler"])
def test_a_run_whose_workers_or_scheduler_are_killed_names_what_is_missing_and_makes_it_when_run_again(trial, capsys):
    kill_workers.main(["--kills", "5", "--repeats", "10", "--only", trial])
    assert "0 leftovers" in capsys.readouterr().out
