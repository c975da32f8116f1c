"""The machine that saf_gen runs on: its cores, its name, and the signals that stop a program."""

import os
import platform
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import numpy as np

from saf_gen.errors import BadInput


def usable_cores() -> int:
    """Return the cores that this process may use; a container or scheduler may allow fewer than there are."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1  # macOS has no affinity


def check_address_space(least: int) -> None:
    """Raise BadInput where this process may address fewer than ``least`` bytes of memory.

    Libraries that count and render then wait for ever, or end the process without a word.
    """
    try:
        import resource
    except ImportError:  # not a Unix
        return
    soft, _ = resource.getrlimit(resource.RLIMIT_AS)
    if resource.RLIM_INFINITY != soft < least:
        raise BadInput(
            f"this process may take {soft >> 20:,} MiB of memory (ulimit -v)",
            allowed=f"{least >> 20:,} MiB and more",
            hint="raise the limit, or ask your batch system for more",
        )


@cache
def describe_machine() -> str:
    """Return one line of what running times depend on; it names neither the host nor its user."""
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
    """Delay Ctrl-C until the end of the block; processes started in the block ignore it.

    Dr.Jit and Mitsuba, interrupted while they load, raise errors of their own or abort.
    """
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


@contextmanager
def defer_termination() -> Iterator[None]:
    """Delay Ctrl-C and SIGTERM until the end of the block, whichever thread they reach.

    For a block that starts no process. In another thread than the main one signals are not handled, nor delayed.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    before = {int(number): signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        for number in before:
            signal.signal(number, lambda number, frame: came.append(number))
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        for number in came[:1]:
            signal.raise_signal(number)
