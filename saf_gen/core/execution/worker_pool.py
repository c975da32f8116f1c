"""A pool of processes that runs jobs, and survives the death of its processes.

Each process has a line of its own. Thus the pool knows which job a process ran when it died, and nothing is shared that
a dead process could leave locked or behind.
"""

import pickle
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from time import monotonic
from typing import Any

from saf_gen.core.child import Child, ChildLost, Line
from saf_gen.core.cores import defer_interrupts
from saf_gen.core.execution.job import Job, JobResult, ReportProgress, describe_job_error
from saf_gen.core.execution.silence import Silence
from saf_gen.core.user_code import user_code
from saf_gen.errors import SafGenError

MAX_DEATHS = 2
MAX_BYTES = (1 << 32) - 1
"""Largest job and result."""
READ_S = 60.0
"""Time within which a process reads its job; it first imports this package."""
END_S = 10.0
"""Time that processes get to end once nothing is left to do; code of users may keep them from it."""


def serve() -> None:
    """Run the jobs that come through the line, one at a time, until it ends."""
    line = Line(MAX_BYTES)

    def send(*message: Any) -> None:
        line.send(pickle.dumps(message))

    while (packed := line.receive()) is not None:
        send("begun")
        result, error = _run(packed, lambda name, done: send("progress", name, done))
        try:
            send("ended", result, error)
        except Exception as problem:  # noqa: BLE001  (results that cannot be pickled raise anything)
            send("ended", None, SafGenError(f"its result cannot be sent: {problem}"))


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

    def note(self, piece: str) -> None:
        self.piece = piece
        self.silence.end()


@dataclass(frozen=True)
class _Unsendable:
    """Takes the place of a job that cannot be pickled, and fails."""

    name: str
    problem: str

    def run(self, report: ReportProgress) -> Any:
        raise SafGenError(self.problem)


class _Worker:
    """A process, and the job that it runs."""

    def __init__(self, attempt: _Attempt) -> None:
        with defer_interrupts():  # they would end the libraries that the process loads
            try:
                self.child = Child(f"{__name__}:serve", max_bytes=MAX_BYTES)
            except BlockingIOError as error:  # there are too many processes
                raise describe_job_error(error) from error
        self.begin(attempt)
        self.has_begun = True  # or died at its job, which it got when it started

    def begin(self, attempt: _Attempt) -> None:
        """Run a job in the process, which waits."""
        self.attempt, self.has_begun = attempt, False
        attempt.note(attempt.job.name)
        try:
            packed = pickle.dumps(attempt.job)
        except Exception as error:  # noqa: BLE001  (plug-ins in a job may raise anything)
            packed = pickle.dumps(_Unsendable(attempt.job.name, f"it cannot be sent: {error}"))
        with suppress(ChildLost):  # which is noticed when it is waited for
            self.child.send(packed, seconds=READ_S)

    def collect(self, report: ReportProgress) -> tuple[Any, SafGenError | None] | None:
        """Pass on the progress of the job; return its result and error if it has ended, otherwise None.

        Raises ChildLost if the process has died.
        """
        while (packed := self.child.receive(0.0)) is not None:
            try:
                kind, *message = pickle.loads(packed)
            except Exception as error:  # noqa: BLE001  (code of users may define what is unpickled)
                return None, SafGenError(f"its result cannot be read: {type(error).__name__}: {error}")
            if kind == "ended":
                return message[0], message[1]
            if kind == "progress":
                self.attempt.note(message[0])
                report(*message)
            self.has_begun = True
        return None


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
    def running(self) -> list[Child]:
        """The process of each running job."""
        return [worker.child for worker in self._busy]

    def add(self, jobs: Iterable[Job]) -> None:
        """Add jobs, and start as many as may run now."""
        self._waiting += (_Attempt(job, Silence(self._notify)) for job in jobs)
        self._start()

    def _start(self) -> None:
        while queue := self._suspects or self._waiting:
            a_suspect_runs = any(worker.attempt.deaths for worker in self._busy)
            if a_suspect_runs or len(self._busy) >= (1 if self._suspects else self._size):
                return
            while self._idle and not self._idle[-1].child.alive:
                self._idle.pop().child.close()
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
                outcome = worker.collect(report)
            except ChildLost as lost:
                outcome = self._bury(worker, attempt, why=str(lost))
            else:
                if outcome is None:
                    attempt.silence.tell(attempt.piece)
                    continue
                self._busy.remove(worker)
                self._idle.append(worker)
            if outcome is not None:
                yield attempt.job, *outcome
        self._start()

    def _bury(self, worker: _Worker, attempt: _Attempt, *, why: str) -> tuple[None, SafGenError] | None:
        """Give the job of a dead process to another one, or return the error of the job."""
        self._busy.remove(worker)
        worker.child.close()
        if not worker.has_begun:  # it died before, while it had no job
            self._waiting.appendleft(attempt)
            return None
        attempt.deaths += 1
        if attempt.deaths < MAX_DEATHS:
            self._suspects.append(attempt)
            self._notify(f"again: {attempt.job.name} (its process {why})")
            return None
        _, _, stage = attempt.piece.removeprefix(attempt.job.name).rpartition(" · ")
        during = f" during its {stage}" if stage else ""
        return None, SafGenError(f"its process died twice{during} (it {why}); run the same command again to go on")

    def close(self, *, cancel: bool = False) -> None:
        """Wait until the processes have ended; with ``cancel``, drop all jobs and end the running ones."""
        children, until_s = [worker.child for worker in (*self._busy, *self._idle)], monotonic() + END_S
        for child in children:
            child.let_end()
        for child in children:
            if not cancel:
                child.wait(max(until_s - monotonic(), 0.0))
            child.close()
