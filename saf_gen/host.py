"""The machine we run on, as far as work must know it."""

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["cores", "uninterrupted"]


def cores() -> int:
    """Cores that this process may use: fewer than the machine has in a container or under a scheduler."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1  # macOS has no affinity


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Ctrl-C waits until the end of this block, and processes started in it never hear it.

    Dr.Jit and Mitsuba, interrupted while they load, raise errors of their own or abort.
    """
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
