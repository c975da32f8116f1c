"""The machine we run on, as far as work must know it."""

import os
import platform
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import numpy as np

__all__ = ["defer_interrupts", "describe_machine", "usable_cores"]


def usable_cores() -> int:
    """Cores that this process may use: fewer than the machine has in a container or under a scheduler."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1  # macOS has no affinity


@cache
def describe_machine() -> str:
    """The machine in a line: what seconds depend on. It names no host and nobody."""
    return (
        f"{_processor()}, {usable_cores()} cores, {platform.system()}, "
        f"Python {platform.python_version()}, numpy {np.__version__}"
    )


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:  # not Linux
        lines = []
    models = [" ".join(line.partition(":")[2].split()) for line in lines if line.startswith("model name")]
    return f"{platform.machine()} {models[0] if models else platform.processor()}".strip()


@contextmanager
def defer_interrupts() -> Iterator[None]:
    """Ctrl-C waits until the end of this block, and processes started in it never hear it.

    Dr.Jit and Mitsuba, interrupted while they load, raise errors of their own or abort.
    """
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
