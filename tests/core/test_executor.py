"""Jobs on the cores of this machine: results, failures, dead processes, and workers that end with their parent."""

import errno
import os
import random
import signal
import subprocess
import sys
import textwrap
import threading
import time
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
from dask_processes import wait_until
from pool_jobs import (
    ClosesAll,
    Dies,
    DiesOnce,
    EndedBy,
    Exits,
    Forks,
    Heavy,
    Naps,
    Raises,
    Returns,
    Sleeps,
    Square,
    Unsendable,
)

from saf_gen.core.child import wait_for_any
from saf_gen.core.execution import run_jobs, silence
from saf_gen.core.execution.worker_pool import WorkerPool
from saf_gen.errors import BadInput, SafGenError

DEATH = "its process "


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


@pytest.mark.slow
def test_all_progress_of_jobs_is_reported_in_order():
    """This includes the last report of the last job."""
    heard = []
    done([Square(n) for n in range(6)], workers=2, report=lambda name, done: heard.append((name, done)))
    for n in range(6):
        assert [fraction for name, fraction in heard if name == f"square {n}"] == [0.5, 1.0]


def collect_all(pool, report=lambda name, done: None):
    """Return what a pool yields until it is empty."""
    ended = []
    while pool.running:
        wait_for_any(pool.running, 0.2)
        ended += pool.collect(report)
    return ended


@pytest.mark.slow
def test_a_process_that_dies_between_two_jobs_costs_neither():
    pool = WorkerPool(1, notify=pytest.fail)
    results = []
    for number in (2, 3):
        pool.add([Square(number)])
        results += [result for _, result, _ in collect_all(pool)]
        os.kill(results[-1][1], signal.SIGKILL)
        assert ended_within(10, [results[-1][1]])
    pool.close()
    assert [square for square, _ in results] == [4, 9]


@pytest.mark.slow
def test_a_job_that_says_nothing_for_long_is_told_again_and_again(monkeypatch, tmp_path):
    monkeypatch.setattr(silence, "TELL_AFTER_S", 0.1)
    lines = []

    def notify(line):
        lines.append(line)
        if len(lines) == 3:
            (tmp_path / "mark").touch()

    done([Heavy(tmp_path / "mark", name="silent")], notify=notify)
    assert len(lines) >= 3
    assert all(line.startswith("waiting: silent has said nothing for ") for line in lines)


@pytest.mark.slow
def test_jobs_and_results_that_cannot_be_sent_or_read_are_errors_of_their_jobs():
    results = done([Returns("a lambda"), Returns("an error of two arguments"), Unsendable(lambda: None), Square(2)])
    assert "its result cannot be sent: " in results["returns a lambda"][1]
    assert "its result cannot be read: TypeError" in results["returns an error of two arguments"][1]
    assert "it cannot be sent: " in results["unsendable"][1]
    assert results["square 2"][0][0] == 4


@pytest.mark.slow
@pytest.mark.parametrize(
    ("job", "why"),
    [
        (Dies(), "ended with exit code 9"),
        (EndedBy(signal.SIGSEGV), "was ended by signal 11 (SIGSEGV)"),
        (EndedBy(signal.SIGKILL), "was ended by signal 9 (SIGKILL, as where memory runs out)"),
        (ClosesAll(), "closed its line"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_job_whose_process_dies_twice_says_how(job, why):
    again = []
    results = done([job, Square(3)], notify=again.append)
    assert results[job.name] == (None, f"its process died twice (it {why}); run the same command again to go on")
    assert again == [f"again: {job.name} (its process {why})"]
    assert results["square 3"][0][0] == 9


@pytest.mark.parametrize("left", [0, 1, 6])
def test_too_few_threads_are_refused_before_a_process_starts(monkeypatch, left):
    """The limit is that of Python's own threads here; tests/cli/test_few_processes.py sets that of the system."""
    start, started = threading._start_new_thread, []

    def start_few(*arguments):
        if len(started) >= left:
            raise RuntimeError("can't start new thread")
        started.append(arguments)
        return start(*arguments)

    monkeypatch.setattr(threading, "_start_new_thread", start_few)
    monkeypatch.setattr("saf_gen.core.child.subprocess.Popen", lambda *_, **__: pytest.fail("a process started"))
    with pytest.raises(BadInput, match=f"the limit of threads and processes leaves {left} "):
        done([Square(2)])


def test_a_process_that_cannot_be_started_is_one_line(monkeypatch):
    def refuse(*_, **__):
        raise BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN))

    monkeypatch.setattr("saf_gen.core.child.subprocess.Popen", refuse)
    with pytest.raises(SafGenError, match="^the system cannot start more threads and processes; "):
        done([Square(2), Square(3)], workers=2)


SCRIPT = """
from saf_gen.core.execution import run_jobs
from pool_jobs import Exits, Square
print("started")
for job, result, error in run_jobs([Square(3), Exits()], workers=2, report=lambda name, done: None):
    print(job.name, error or result[0])
"""


@pytest.mark.slow
@pytest.mark.daily(3)
@pytest.mark.parametrize(
    ("files", "words", "standard_input"),
    [
        ({}, ["-"], SCRIPT),
        ({}, [], SCRIPT),
        ({}, ["-c", SCRIPT], ""),
        ({"plain.py": SCRIPT}, ["plain.py"], ""),
        ({"plain": SCRIPT}, ["plain"], ""),
        ({"guarded.py": "if __name__ == '__main__':" + textwrap.indent(SCRIPT, "    ")}, ["guarded.py"], ""),
        ({"package/__init__.py": "", "package/tool.py": SCRIPT}, ["-m", "package.tool"], ""),
        ({"folder/__main__.py": SCRIPT}, ["folder"], ""),
        ({"moves.py": f"import os; os.mkdir('elsewhere'); os.chdir('elsewhere')\n{SCRIPT}"}, ["moves.py"], ""),
        ({"gone.py": f"import os; os.remove('gone.py')\n{SCRIPT}"}, ["gone.py"], ""),
    ],
)
def test_workers_do_not_run_the_script_again_wherever_it_comes_from(tmp_path, files, words, standard_input):
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, *words]
    ran = subprocess.run(
        command, input=standard_input, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert (ran.returncode, ran.stderr) == (0, "")
    assert sorted(ran.stdout.splitlines()) == ["exits CodeStopped: its code called exit(0)", "square 3 9", "started"]


@pytest.mark.slow
def test_a_copy_that_a_job_forks_does_not_go_on_with_it(tmp_path):
    assert done([Forks(tmp_path)])["forks"] == ("done", "")
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.slow
def test_jobs_that_fail_are_named_with_the_cause_and_the_others_go_on():
    raised = [
        BadInput("gain -1", where="a.yaml:3", allowed="0 or more"),
        PermissionError(13, "Permission denied", "/there/a.h5"),
        MemoryError(),
        KeyboardInterrupt(),  # raised by OpenBLAS, which cannot start threads
        RuntimeError("can't start new thread"),
        BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN)),
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
    assert problems["raises KeyboardInterrupt"].startswith("KeyboardInterrupt, as where the system cannot start")
    for name in ("RuntimeError", "BlockingIOError"):
        assert problems[f"raises {name}"] == (
            "the system cannot start more threads and processes; run with fewer --workers"
        )
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
    assert sum(line.startswith(f"again: dies once ({DEATH}") for line in again) == 1
    for name in ("dies", "dies too"):
        assert results[name][0] is None
        assert "its process died twice" in results[name][1]
        assert "run the same command again" in results[name][1]
        assert sum(line.startswith(f"again: {name} ({DEATH}") for line in again) == 1
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


@pytest.mark.slow
def test_workers_end_when_the_caller_stops_listening(tmp_path):
    note = tmp_path / "pid"
    jobs = run_jobs([Square(1), Sleeps(note)], workers=2, report=lambda name, done: None)
    next(jobs)
    wait_until(note.exists, 30)
    worker = int(note.read_text())
    assert alive(worker)
    jobs.close()
    assert ended_within(10, [worker])


@contextmanager
def run_of_two_workers(folder):
    """Start a program whose two workers are busy; yield its process and their process ids."""
    script = folder / "script.py"
    script.write_text(
        textwrap.dedent(
            """
            import sys
            from pathlib import Path
            from saf_gen.core.execution import run_jobs
            from pool_jobs import Heavy, Sleeps
            if __name__ == "__main__":
                notes = [Path(n) for n in sys.argv[1:]]
                jobs = [*(Sleeps(note, name=note.name) for note in notes), Heavy(notes[0].with_name("never"))]
                list(run_jobs(jobs, workers=len(notes), report=lambda name, done: None))
            """
        )
    )
    notes = [folder / "one", folder / "two"]
    run = subprocess.Popen(
        [sys.executable, str(script), *map(str, notes)],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        start_new_session=True,
        stderr=subprocess.DEVNULL,
    )
    try:
        wait_until(lambda: all(note.exists() for note in notes), 30)
        yield run, [int(note.read_text()) for note in notes]
    finally:
        with suppress(ProcessLookupError):
            os.killpg(run.pid, signal.SIGKILL)
        run.wait()


@pytest.mark.slow
def test_workers_end_when_their_parent_is_killed(tmp_path):
    """Otherwise a killed run would leave a process that occupies memory and writes to the dataset."""
    with run_of_two_workers(tmp_path) as (run, workers):
        assert all(map(alive, workers))
        run.kill()
        run.wait()
        assert ended_within(10, workers)


@pytest.mark.slow
def test_a_run_whose_whole_group_is_killed_leaves_nothing_in_shared_memory(tmp_path):
    """Nobody is left then who could clean up. Other programs of this machine make semaphores, too."""
    with run_of_two_workers(tmp_path) as (run, workers):
        shared = {name for process in (run.pid, *workers) for name in shared_memory_of(Path(f"/proc/{process}"))}
        os.killpg(run.pid, signal.SIGKILL)
        run.wait()
        assert ended_within(10, workers)
        assert [name for name in shared if name.exists()] == []


def shared_memory_of(process):
    with suppress(OSError):
        lines = (process / "maps").read_text().splitlines()
        return [Path(line.split(None, 5)[5]) for line in lines if "/dev/shm/" in line]
    return []
