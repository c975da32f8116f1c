"""A Dask scheduler and workers as separate processes on the loopback interface, so that tests can kill them."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


def start_dask(program: str, *options: str, log: Path, **environment: str) -> subprocess.Popen[bytes]:
    """Start `dask scheduler` or `dask worker` in a new session."""
    with log.open("ab") as file:
        return subprocess.Popen(
            [sys.executable, "-m", f"distributed.cli.dask_{program}", *options],
            stdout=file,
            stderr=file,
            start_new_session=True,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)} | environment,
            cwd=log.parent,
        )


def wait_until(condition, seconds: float = 60.0) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "nothing happened for too long"
        time.sleep(0.05)


@contextmanager
def scheduler_process(folder: Path, *options: str) -> Iterator[tuple[subprocess.Popen[bytes], str]]:
    """Yield the process of a scheduler and its address."""
    log = folder / "scheduler.log"
    options = options or ("--host", "tcp://127.0.0.1:0")
    scheduler = start_dask("scheduler", *options, "--no-dashboard", "--dashboard-address", ":0", log=log)
    try:
        wait_until(lambda: "Scheduler at:" in log.read_text())
        yield scheduler, log.read_text().split("Scheduler at:")[1].split()[0]
    finally:
        end_session(scheduler)


@contextmanager
def worker_processes(
    folder: Path, address: str, *options: str, **environment: str
) -> Iterator[subprocess.Popen[bytes]]:
    """Yield the process of the nanny that runs the workers, by default two."""
    options = options or ("--nworkers", "2")
    log = folder / "workers.log"
    nanny = start_dask("worker", address, "--nthreads", "1", "--no-dashboard", *options, log=log, **environment)
    try:
        yield nanny
    finally:
        end_session(nanny)


def children(pid: int) -> list[int]:
    """Return the ids of the running children of a process."""
    listed = subprocess.run(["ps", "-o", "pid=,stat=,args=", "--ppid", str(pid)], capture_output=True, text=True).stdout
    found = [line.split(None, 2) for line in listed.splitlines()]
    return [int(number) for number, state, command in found if state[0] != "Z" and "resource_tracker" not in command]


def end_session(process: subprocess.Popen[bytes]) -> None:
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
