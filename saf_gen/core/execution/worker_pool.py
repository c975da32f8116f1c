"""A pool of processes that runs jobs, and survives the death of one of its processes.

If one of its processes is killed (by a user, or by the kernel for its memory), a ``ProcessPoolExecutor`` breaks and
loses all its jobs. This pool runs each of them again alone, in a new executor, so that a second death shows which job
caused it, and the other jobs succeed.
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
from saf_gen.core.user_code import user_code

MAX_DEATHS = 2


_queue: Any = None


def _start_worker(queue: Any) -> None:
    """Set up a worker, which reports to the queue and ends when its parent ends."""
    global _queue
    _queue = queue
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_exit_after, args=(parent.sentinel,), daemon=True).start()


def _exit_after(sentinel: int) -> None:
    # Without this, a killed run would leave workers behind that wait for ever and keep their memory.
    multiprocessing.connection.wait([sentinel])
    os._exit(1)


def _run(job: Job) -> Any:
    with user_code():
        return job.run(lambda name, done: _queue.put((name, done)))


@dataclass(eq=False)
class _Attempt:
    """A job, and the number of processes that have died while they ran it."""

    job: Job
    deaths: int = 0


class WorkerPool:
    """A pool that runs at most ``size`` jobs at a time, each in its own process.

    ``notify`` is called with a line of text for each job that is run again because its process died.
    """

    def __init__(self, size: int, *, notify: Callable[[str], None]) -> None:
        self._size, self._notify = size, notify
        self._waiting: deque[_Attempt] = deque()
        self._suspects: deque[_Attempt] = deque()  # one of them may have killed its process
        self._running: dict[Future[Any], _Attempt] = {}
        self._open()

    def _open(self) -> None:
        # Processes are spawned, because Mitsuba's and numba's threads do not survive a fork. Each executor has its own
        # queue, because a process may have died while it held the lock of the old queue.
        context = multiprocessing.get_context("spawn")
        self._queue = context.SimpleQueue()
        self._pool = ProcessPoolExecutor(
            self._size, mp_context=context, initializer=_start_worker, initargs=(self._queue,)
        )

    @property
    def futures(self) -> list[Future[Any]]:
        """One future for each running job."""
        return list(self._running)

    def add(self, jobs: Iterable[Job]) -> None:
        """Add jobs, and start as many as may run now."""
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
                except BrokenProcessPool:  # a process has died; jobs that were running are still to be collected
                    if self._running:
                        return
                    self._reopen()
                else:
                    self._running[future] = queue.popleft()

    def _reopen(self) -> None:
        self._pool.shutdown(wait=False)
        self._open()

    def collect(self, report: ReportProgress) -> Iterator[tuple[Job, Future[Any]]]:
        """Pass on progress, yield the jobs that have ended, and start others.

        A job has ended when it has returned, raised an exception, or lost two processes.
        """
        ended = [future for future in self._running if future.done()]
        died = any(isinstance(future.exception(), BrokenProcessPool) for future in ended)
        if died:
            wait(self._running)  # every job ends now, by itself or with the executor
            ended = list(self._running)
        while not self._queue.empty():  # read only now, so that it holds all reports of the jobs that have ended
            report(*self._queue.get())
        if died:
            self._reopen()
        for future in ended:
            attempt = self._running.pop(future)
            if isinstance(future.exception(), BrokenProcessPool):
                attempt.deaths += 1
                if attempt.deaths < MAX_DEATHS:
                    self._suspects.append(attempt)
                    self._notify(f"again: {attempt.job.name} (its process died: killed, or out of memory?)")
                    continue
            yield attempt.job, future
        self._start()

    def close(self, *, cancel: bool = False) -> None:
        """Wait until the processes have ended; with ``cancel``, drop the jobs that have not begun."""
        self._pool.shutdown(wait=True, cancel_futures=cancel)
