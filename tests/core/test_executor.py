"""Jobs on the cores of this machine: results, failures, dead processes, and workers that end with their parent."""

import os
import random
import signal
import subprocess
import sys
import textwrap
import threading
import time
from concurrent.futures import wait
from contextlib import suppress
from pathlib import Path

import pytest
from dask_processes import wait_until
from pool_jobs import Dies, DiesOnce, Exits, Heavy, Naps, Raises, Sleeps, Square

from saf_gen.core.execution import run_jobs
from saf_gen.core.execution.worker_pool import WorkerPool
from saf_gen.errors import BadInput

DEATH = "its process died: killed, or out of memory?"


def done(jobs, **options):
    options = {"workers": 1, "report": lambda name, done: None} | options
    ended = run_jobs(jobs, **options)
    return {job.name: (result, "" if error is None else str(error)) for job, result, error in ended}


def alive(pid):
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"  # a zombie has ended; in a container possibly nobody waits for it


def ended_within(seconds, pids):
    deadline = time.monotonic() + seconds
    while any(map(alive, pids)) and time.monotonic() < deadline:
        time.sleep(0.05)
    return not any(map(alive, pids))


def test_all_progress_of_jobs_is_reported_in_order():
    """This includes the last report of the last job."""
    heard = []
    done([Square(n) for n in range(6)], workers=2, report=lambda name, done: heard.append((name, done)))
    for n in range(6):
        assert [fraction for name, fraction in heard if name == f"square {n}"] == [0.5, 1.0]


def test_progress_of_a_job_is_reported_before_its_end():
    pool, heard = WorkerPool(1, notify=lambda line: None), []
    pool.add([Square(3)])
    wait(pool.futures)
    ended = [job.name for job, _ in pool.collect(lambda name, done: heard.append(done))]
    pool.close()
    assert (ended, heard) == (["square 3"], [0.5, 1.0])


def test_a_process_that_dies_between_two_jobs_costs_neither():
    pool = WorkerPool(1, notify=pytest.fail)
    results = []
    for number in (2, 3):
        pool.add([Square(number)])
        wait(pool.futures)
        results += [future.result() for _, future in pool.collect(lambda name, done: None)]
        os.kill(results[-1][1], signal.SIGKILL)
        assert ended_within(10, [results[-1][1]])
        time.sleep(0.5)  # until the pool has noticed
    pool.close()
    assert [square for square, _ in results] == [4, 9]


def test_jobs_that_fail_are_named_with_the_cause_and_the_others_go_on():
    raised = [
        BadInput("gain -1", where="a.yaml:3", allowed="0 or more"),
        PermissionError(13, "Permission denied", "/there/a.h5"),
        MemoryError(),
        ZeroDivisionError("division by zero"),
        GeneratorExit(),
    ]
    jobs = [*map(Raises, raised), Exits(), Square(3)]
    ended = {job.name: (result, error) for job, result, error in run_jobs(jobs, workers=1, report=print)}
    problems = {name: str(error) for name, (_, error) in ended.items()}
    assert problems["raises BadInput"] == "a.yaml:3: gain -1; allowed: 0 or more"
    assert "Permission denied" in problems["raises PermissionError"]
    assert "/there/a.h5" in problems["raises PermissionError"]
    assert problems["raises MemoryError"] == "out of memory; run with fewer --workers"
    assert "division by zero" in problems["raises ZeroDivisionError"]
    assert problems["exits"] == "CodeStopped: its code called exit(0)"
    assert "its code raised GeneratorExit" in problems["raises GeneratorExit"]
    assert (ended["raises BadInput"][1].exit_code, ended["raises ZeroDivisionError"][1].exit_code) == (2, 1)
    result, error = ended["square 3"]
    assert (result[0], error) == (9, None)
    assert result[1] != os.getpid()
    assert done([]) == {}


@pytest.mark.slow
def test_a_job_that_takes_all_cores_runs_with_light_jobs_but_not_with_another(tmp_path):
    """The light job ends while the heavy ones, which wait for its end and run one after the other, are running."""
    heavy = [Heavy(tmp_path / "mark", 0.5, name=name) for name in ("one", "two")]
    ended = []
    for job, result, _ in run_jobs([*heavy, Square(1)], workers=1, report=lambda name, done: None):
        ended.append((job.name, result))
        (tmp_path / "mark").touch()
    assert ended[0][0] == "square 1"
    first, second = sorted(result for _, result in ended[1:])
    assert first[1] <= second[0]


@pytest.mark.slow
def test_what_follows_runs_although_a_process_has_died_before(tmp_path):
    """The heavy job ends after the other has died twice."""
    results = {}
    for job, _, error in run_jobs(
        [Heavy(tmp_path / "mark"), Dies()],
        workers=1,
        report=lambda name, done: None,
        follow_up=lambda job, result: [Square(2)] if job.name == "heavy" else [],
    ):
        results[job.name] = error
        (tmp_path / "mark").touch()
    assert list(results) == ["dies", "heavy", "square 2"]
    assert results["heavy"] is results["square 2"] is None
    assert "its process died twice" in str(results["dies"])


@pytest.mark.slow
def test_a_job_whose_process_dies_twice_is_named_and_all_others_are_done(tmp_path):
    """Jobs that ran in the pool when it died are run again, one at a time."""
    jobs = [Square(1), Dies(), *(Square(n) for n in range(2, 8)), DiesOnce(tmp_path / "mark"), Dies("dies too")]
    again = []
    results = done(jobs, workers=3, notify=again.append)
    assert set(results) == {job.name for job in jobs}
    for n in range(1, 8):
        assert results[f"square {n}"][0][0] == n * n
    assert results["dies once"] == ("done", "")
    assert again.count(f"again: dies once ({DEATH})") == 1
    for name in ("dies", "dies too"):
        assert results[name][0] is None
        assert "its process died twice" in results[name][1]
        assert "run the same command again" in results[name][1]
        assert again.count(f"again: {name} ({DEATH})") == 1
    assert len(again) <= 3 * 3


@pytest.mark.slow
def test_processes_killed_at_random_lose_no_job(tmp_path):
    """Three processes are killed, one after the other (seed 3); jobs that die twice are named, the others succeed."""
    rng, killed, over = random.Random(3), [], threading.Event()

    def kill():
        while len(killed) < 3 and not over.wait(rng.uniform(0.2, 0.4)):
            alive_now = [int(note.name) for note in tmp_path.iterdir() if alive(int(note.name))]
            if alive_now:
                killed.append(rng.choice(alive_now))
                with suppress(ProcessLookupError):
                    os.kill(killed[-1], signal.SIGKILL)

    killer = threading.Thread(target=kill)
    killer.start()
    results = done([Naps(tmp_path, n) for n in range(10)], workers=3)
    over.set()
    killer.join()
    assert len(results) == 10
    assert len(killed) >= 2
    for n in range(10):
        result, error = results[f"naps {n}"]
        assert result == n or "died twice" in error
    assert sum(bool(error) for _, error in results.values()) < len(killed)  # a job fails only by its second death


def test_workers_end_when_the_caller_stops_listening(tmp_path):
    note = tmp_path / "pid"
    jobs = run_jobs([Square(1), Sleeps(note)], workers=2, report=lambda name, done: None)
    next(jobs)
    wait_until(note.exists, 30)
    worker = int(note.read_text())
    assert alive(worker)
    jobs.close()
    assert ended_within(10, [worker])


@pytest.mark.slow
def test_workers_end_when_their_parent_is_killed(tmp_path):
    """Otherwise a killed run would leave a process that occupies memory and writes to the dataset."""
    script = tmp_path / "script.py"
    script.write_text(
        textwrap.dedent(
            """
            import sys
            from pathlib import Path
            from saf_gen.core.execution import run_jobs
            from pool_jobs import Sleeps
            if __name__ == "__main__":
                notes = [Path(n) for n in sys.argv[1:]]
                jobs = [Sleeps(note, name=note.name) for note in notes]
                list(run_jobs(jobs, workers=len(jobs), report=lambda name, done: None))
            """
        )
    )
    notes = [tmp_path / "one", tmp_path / "two"]
    path = os.pathsep.join(sys.path)
    run = subprocess.Popen(
        [sys.executable, str(script), *map(str, notes)],
        env=os.environ | {"PYTHONPATH": path},
        start_new_session=True,
        stderr=subprocess.DEVNULL,
    )
    try:
        wait_until(lambda: all(note.exists() for note in notes), 30)
        workers = [int(note.read_text()) for note in notes]
        assert all(map(alive, workers))
        run.kill()
        run.wait()
        assert ended_within(10, workers)
    finally:
        with suppress(ProcessLookupError):
            os.killpg(run.pid, signal.SIGKILL)
