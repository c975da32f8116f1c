"""Processes that run jobs, and outlive the death of one of them.

Whoever kills a process (the kernel that needs its memory, a person) ends a whole ``ProcessPoolExecutor``. Here its jobs
are put into a new one, each alone, so that a second death tells which job it was; the others are done.
"""

import multiprocessing
import multiprocessing.connection
import os
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import Any

from saf_gen.core.cores import defer_interrupts
from saf_gen.core.execution.job import Job, ReportProgress

MOST_DEATHS = 2


_queue: Any = None


def _start_worker(queue: Any) -> None:
    """Set up a worker: it reports to the queue, and ends when its parent ends."""
    global _queue
    _queue = queue
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_exit_after, args=(parent.sentinel,), daemon=True).start()


def _exit_after(sentinel: int) -> None:
    # Without this a killed run leaves workers behind, which wait for ever and keep their memory.
    multiprocessing.connection.wait([sentinel])
    os._exit(1)


def _run(job: Job) -> Any:
    return job.run(lambda name, done: _queue.put((name, done)))


@dataclass(eq=False)
class _Attempt:
    """A job, and how many processes have died while they had it."""

    job: Job
    deaths: int = 0


class WorkerPool:
    """At most ``size`` jobs at a time, each in a process of its own.

    ``tell`` is called with a line for each job that is run again because a process died that had it.
    """

    def __init__(self, size: int, *, tell: Callable[[str], None]) -> None:
        self._size, self._tell = size, tell
        self._waiting: deque[_Attempt] = deque()
        self._suspects: deque[_Attempt] = deque()  # one of them may have killed its process
        self._running: dict[Future[Any], _Attempt] = {}
        self._open()

    def _open(self) -> None:
        # Spawned, never forked: Mitsuba's and numba's threads do not survive a fork. A process may have died with the
        # queue's lock in its hand, so that each pool has a queue of its own.
        context = multiprocessing.get_context("spawn")
        self._queue = context.SimpleQueue()
        self._pool = ProcessPoolExecutor(
            self._size, mp_context=context, initializer=_start_worker, initargs=(self._queue,)
        )

    @property
    def futures(self) -> list[Future[Any]]:
        """One for each job that runs."""
        return list(self._running)

    def add(self, jobs: Iterable[Job]) -> None:
        """Take jobs, and start as many as there is room for."""
        self._waiting += map(_Attempt, jobs)
        self._start()

    def _start(self) -> None:
        with defer_interrupts():  # a worker that is interrupted while it starts prints a traceback
            while queue := self._suspects or self._waiting:
                a_suspect_runs = any(attempt.deaths for attempt in self._running.values())
                if a_suspect_runs or len(self._running) >= (1 if self._suspects else self._size):
                    return
                try:
                    future = self._pool.submit(_run, queue[0].job)
                except BrokenProcessPool:  # a process has died, and its jobs, if it had any, are still to be collected
                    if self._running:
                        return
                    self._reopen()
                else:
                    self._running[future] = queue.popleft()

    def _reopen(self) -> None:
        self._pool.shutdown(wait=False)
        self._open()

    def collect(self, report: ReportProgress) -> Iterator[tuple[Job, Future[Any]]]:
        """Pass on what jobs have told, yield those that have ended, well or with two processes, and start others."""
        ended = [future for future in self._running if future.done()]
        died = any(isinstance(future.exception(), BrokenProcessPool) for future in ended)
        if died:
            wait(self._running)  # all of them have ended, well or with the pool
            ended = list(self._running)
        while not self._queue.empty():  # after the look at what has ended: all that it told is in the queue
            report(*self._queue.get())
        if died:
            self._reopen()
        for future in ended:
            attempt = self._running.pop(future)
            if isinstance(future.exception(), BrokenProcessPool):
                attempt.deaths += 1
                if attempt.deaths < MOST_DEATHS:
                    self._suspects.append(attempt)
                    self._tell(f"again: {attempt.job.name} (its process died: killed, or out of memory?)")
                    continue
            yield attempt.job, future
        self._start()

    def close(self, *, cancel: bool = False) -> None:
        """Wait until the processes have ended; with ``cancel`` jobs that have not begun are dropped."""
        self._pool.shutdown(wait=True, cancel_futures=cancel)
