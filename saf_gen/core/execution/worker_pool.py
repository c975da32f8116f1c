"""A pool of processes that runs jobs, and survives the death of its processes.

Each process has a pipe of its own, with one reader and one writer at each end. Thus the pool knows which job a process
ran when it died, and nothing is shared that a dead process could leave locked or behind: the semaphores of
``ProcessPoolExecutor`` stay in shared memory if all processes are killed together.
"""

import multiprocessing
import multiprocessing.connection
import os
import pickle
import signal
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from time import monotonic
from types import ModuleType
from typing import Any

from saf_gen.core.cores import defer_interrupts
from saf_gen.core.execution.job import Job, JobResult, ReportProgress, describe_job_error
from saf_gen.core.execution.silence import Silence
from saf_gen.core.user_code import user_code
from saf_gen.errors import SafGenError

MAX_DEATHS = 2
END_S = 10.0
"""Time that processes get to end once nothing is left to do; code of users may keep them from it."""
LOST_S = 1.0
"""Time that a process gets to end once its pipe is closed."""
LOST_PIPE = "its code closed the pipe to the run"
EXIT_LOST = 113


def _serve(pipe: Connection, first: bytes) -> None:
    """Run a job, and those that come through the pipe after it, one at a time, until the pipe or the parent ends."""
    sending = threading.Lock()

    def send(*message: Any) -> None:
        packed = pickle.dumps(message)
        try:
            with sending:
                pipe.send_bytes(packed)
        except OSError:  # code of users has closed it
            os._exit(EXIT_LOST)

    parent = multiprocessing.parent_process()
    if parent is not None:
        try:
            threading.Thread(target=_exit_after, args=(parent.sentinel,), daemon=True).start()
        except RuntimeError as refusal:  # there are too many threads
            send("ended", None, describe_job_error(refusal))
            return
    packed: bytes | None = first
    while packed is not None:
        send("begun")
        result, error = _run(packed, lambda name, done: send("progress", name, done))
        try:
            send("ended", result, error)
        except Exception as problem:  # noqa: BLE001  (results that cannot be pickled raise anything)
            send("ended", None, SafGenError(f"its result cannot be sent: {problem}"))
        packed = _receive(pipe)


def _receive(pipe: Connection) -> bytes | None:
    try:
        return pipe.recv_bytes()
    except EOFError:
        return None
    except OSError:
        os._exit(EXIT_LOST)


def _exit_after(sentinel: int) -> None:
    # Without this, a killed run would leave workers behind that wait for ever and keep their memory.
    multiprocessing.connection.wait([sentinel])
    os._exit(1)


def _run(packed: bytes, report: ReportProgress) -> tuple[Any, SafGenError | None]:
    try:
        with user_code():
            job: Job = pickle.loads(packed)
            return job.run(report), None
    except BaseException as error:  # noqa: BLE001  (whatever a job raises is its result; interrupts are deferred)
        return None, describe_job_error(error)


class _Attempt:
    """A job, the number of processes that have died while they ran it, and its latest report."""

    def __init__(self, job: Job, silence: Silence) -> None:
        self.job, self.deaths, self.piece, self.silence = job, 0, job.name, silence

    def hear(self, piece: str) -> None:
        self.piece = piece
        self.silence.end()


@dataclass(frozen=True)
class _Unsendable:
    """Takes the place of a job that cannot be pickled, and fails."""

    name: str
    problem: str

    def run(self, report: ReportProgress) -> Any:
        raise SafGenError(self.problem)


@contextmanager
def _without_script() -> Iterator[None]:
    """Hide the program that runs here from a process that is spawned.

    The process needs nothing of it, and would run it a second time: it would end there if the program does not guard
    its start by ``if __name__ == "__main__"``, or was read from standard input.
    """
    script, sys.modules["__main__"] = sys.modules["__main__"], ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = script


class _Worker:
    """A process, and this end of its pipe."""

    def __init__(self, attempt: _Attempt) -> None:
        # Processes are spawned, because Mitsuba's and numba's threads do not survive a fork.
        context = multiprocessing.get_context("spawn")
        self.has_begun = True  # or died at its job, which it got before it started
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=_serve, args=(theirs, self._take(attempt)))
        with defer_interrupts(), _without_script():  # a worker that is interrupted while it starts prints a traceback
            try:
                self.process.start()
            except BlockingIOError as error:  # there are too many processes
                raise describe_job_error(error) from error
        theirs.close()

    def begin(self, attempt: _Attempt) -> None:
        """Run another job in the process, which has ended its last one and waits."""
        packed, self.has_begun = self._take(attempt), False
        with suppress(OSError):  # it has died, which is noticed when it is listened to
            self.pipe.send_bytes(packed)

    def _take(self, attempt: _Attempt) -> bytes:
        self.attempt = attempt
        attempt.hear(attempt.job.name)
        try:
            return pickle.dumps(attempt.job)
        except Exception as error:  # noqa: BLE001  (plug-ins in a job may raise anything)
            return pickle.dumps(_Unsendable(attempt.job.name, f"it cannot be sent: {error}"))

    def listen(self, report: ReportProgress) -> tuple[Any, SafGenError | None] | None:
        """Pass on the progress of the job; return its result and error if it has ended, otherwise None.

        Raises EOFError if the process has died.
        """
        is_alive = self.is_alive()  # asked first, so that its last messages are read
        while self._has_message():
            try:
                packed = self.pipe.recv_bytes()
            except OSError as error:
                raise EOFError from error
            try:
                kind, *message = pickle.loads(packed)
            except Exception as error:  # noqa: BLE001  (code of users may define what is unpickled)
                return None, SafGenError(f"its result cannot be read: {type(error).__name__}: {error}")
            if kind == "ended":
                return message[0], message[1]
            if kind == "progress":
                self.attempt.hear(message[0])
                report(*message)
            self.has_begun = True
        if not is_alive:
            raise EOFError
        return None

    def _has_message(self) -> bool:
        try:
            return self.pipe.poll()
        except OSError:
            return False

    def is_alive(self) -> bool:
        # Asked of the system: a process that code of users has forked keeps the pipe open.
        return self.process.is_alive()

    def how_it_died(self) -> str:
        """Return in words how the process ended; one that has only lost its pipe is killed."""
        self.process.join(LOST_S)
        if self.is_alive():
            self.wait(0.0)
            return LOST_PIPE
        code = self.process.exitcode or 0
        if -code == getattr(signal, "SIGKILL", None):  # Windows has no such signal
            return "killed, or out of memory?"
        if code < 0:
            return signal.strsignal(-code) or f"signal {-code}"
        return LOST_PIPE if code == EXIT_LOST else f"it ended itself with exit code {code}"

    def end(self) -> None:
        """Let the process end; it does at once if it has no job."""
        self.pipe.close()

    def wait(self, until_s: float) -> None:
        """Wait until the process has ended, and kill it at a time on the monotonic clock."""
        while self.is_alive() and (left := until_s - monotonic()) > 0:
            self.process.join(min(left, 0.05))
        if self.is_alive():
            self.process.kill()
        self.process.join()


class WorkerPool:
    """A pool that runs at most ``size`` jobs at a time, each in its own process.

    ``notify`` is called with a line of text for each job that is run again because its process died, and for each that
    has been silent for long.
    """

    def __init__(self, size: int, *, notify: Callable[[str], None]) -> None:
        self._size, self._notify = size, notify
        self._waiting: deque[_Attempt] = deque()
        self._suspects: deque[_Attempt] = deque()  # they run alone, because memory may have run out
        self._busy: list[_Worker] = []
        self._idle: list[_Worker] = []

    @property
    def running(self) -> list[Connection]:
        """One pipe for each running job; it can be read when there is something to collect."""
        return [worker.pipe for worker in self._busy]

    def add(self, jobs: Iterable[Job]) -> None:
        """Add jobs, and start as many as may run now."""
        self._waiting += (_Attempt(job, Silence(self._notify)) for job in jobs)
        self._start()

    def _start(self) -> None:
        while queue := self._suspects or self._waiting:
            a_suspect_runs = any(worker.attempt.deaths for worker in self._busy)
            if a_suspect_runs or len(self._busy) >= (1 if self._suspects else self._size):
                return
            self._idle = [worker for worker in self._idle if worker.is_alive()]
            if self._idle:
                worker = self._idle.pop()
                worker.begin(queue.popleft())
            else:
                worker = _Worker(queue.popleft())
            self._busy.append(worker)

    def collect(self, report: ReportProgress) -> Iterator[JobResult]:
        """Pass on progress, yield the jobs that have ended, and start others.

        A job has ended when it has returned, raised an exception, or lost two processes.
        """
        for worker in list(self._busy):
            attempt = worker.attempt
            try:
                outcome = worker.listen(report)
            except EOFError:
                outcome = self._bury(worker, attempt)
            else:
                if outcome is None:
                    attempt.silence.tell(attempt.piece)
                    continue
                self._busy.remove(worker)
                self._idle.append(worker)
            if outcome is not None:
                yield attempt.job, *outcome
        self._start()

    def _bury(self, worker: _Worker, attempt: _Attempt) -> tuple[None, SafGenError] | None:
        """Give the job of a dead process to another one, or return the error of the job."""
        self._busy.remove(worker)
        worker.end()
        if not worker.has_begun:  # it died before, while it had no job
            self._waiting.appendleft(attempt)
            worker.wait(monotonic() + LOST_S)
            return None
        why, attempt.deaths = worker.how_it_died(), attempt.deaths + 1
        if attempt.deaths < MAX_DEATHS:
            self._suspects.append(attempt)
            self._notify(f"again: {attempt.job.name} (its process died: {why})")
            return None
        _, _, stage = attempt.piece.removeprefix(attempt.job.name).rpartition(" · ")
        during = f" during its {stage}" if stage else ""
        return None, SafGenError(f"its process died twice{during} ({why}); run the same command again to go on")

    def close(self, *, cancel: bool = False) -> None:
        """Wait until the processes have ended; with ``cancel``, drop all jobs and end the running ones."""
        workers = [*self._busy, *self._idle]
        for worker in workers:
            worker.end()
            if cancel:
                worker.process.terminate()
        until_s = monotonic() + END_S
        for worker in workers:
            worker.wait(until_s)
