"""The machine that saf_gen runs on: its cores, memory and description, and the signals that stop a program."""

import math
import os
import platform
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

from saf_gen.errors import BadInput

IS_WINDOWS = sys.platform == "win32"
TRIED_ON_WINDOWS = ("encode", "inspect", "view", "evaluate")
"""Commands that a job of CI runs on Windows, without a renderer."""
WINDOWS_ADVICE = (
    f"on Windows, only {', '.join(TRIED_ON_WINDOWS[:-1])} and {TRIED_ON_WINDOWS[-1]} are tested; use WSL2, which is a "
    "Linux (docs/install.md#windows)"
)
STOPPING = [signal.SIGINT, signal.SIGTERM, *([signal.SIGHUP] if hasattr(signal, "SIGHUP") else [])]
"""Signals that stop a program: Ctrl-C, the end of a batch job, and a terminal that is closed."""


def usable_cores() -> int:
    """Return the number of cores that this process may use; a container or scheduler may allow fewer than exist."""
    return min(core_limits().values())


def core_limits() -> dict[str, int]:
    """Return the number of cores that each limit of this process allows: affinity, quota of its cgroups, and SLURM."""
    if hasattr(os, "sched_getaffinity"):
        limits = {"affinity": len(os.sched_getaffinity(0))}
    else:
        limits = {"processor": os.cpu_count() or 1}  # macOS has no affinity
    quota, per_task = cgroup_quota(Path("/")), os.environ.get("SLURM_CPUS_PER_TASK", "")
    if quota is not None:
        limits["cgroup quota"] = quota
    if per_task.isdecimal() and int(per_task):
        limits["SLURM_CPUS_PER_TASK"] = int(per_task)
    return limits


@cache
def cgroup_quota(root: Path) -> int | None:
    """Return the cores that the cgroups of this process and those around them allow, rounded up; None if any number.

    ``root`` is the folder with ``proc`` and ``sys``. Both versions of cgroups count.
    """
    quotas = []
    for group in _find_cgroups(root):
        for files in (("cpu.max",), ("cpu.cfs_quota_us", "cpu.cfs_period_us")):
            with suppress(OSError, ValueError):  # there is no such file, or it says "max"
                quota, period = map(int, " ".join((group / name).read_text() for name in files).split())
                quotas += [math.ceil(quota / period)] if quota > 0 else []
    return min(quotas, default=None)


def _find_cgroups(root: Path) -> list[Path]:
    """Return the folders of this process's cgroups that may have a CPU quota, and all folders around them."""
    folders = []
    try:
        groups, mounts = ((root / "proc/self" / name).read_text().splitlines() for name in ("cgroup", "mountinfo"))
        paths = {name: path for _, names, path in (line.split(":", 2) for line in groups) for name in names.split(",")}
        for mount in mounts:
            place, system = (part.split() for part in mount.split(" - ", 1))
            controller = {"cgroup2": "", "cgroup": "cpu"}.get(system[0])
            if controller in paths and controller in ("", *system[-1].split(",")):
                top, point = place[3:5]
                folder = root / point.lstrip("/") / paths[controller].removeprefix(top).lstrip("/")
                folders += [folder, *folder.parents]
    except (OSError, ValueError):  # not Linux
        return []
    return folders


def count_startable(threads: int) -> int:
    """Return how many of so many threads this process can start now, beside those that it has.

    Limits count the threads and processes of a user (``ulimit -u``) or of a container (``pids``) together. Only trying
    tells how many are left.
    """
    ended, started, stack_bytes = threading.Event(), list[threading.Thread](), threading.stack_size(1 << 18)
    try:
        with suppress(RuntimeError):
            for _ in range(threads):
                thread = threading.Thread(target=ended.wait)
                thread.start()
                started.append(thread)
    finally:
        threading.stack_size(stack_bytes)
        ended.set()
        for thread in started:
            thread.join()
    return len(started)


def check_threads(needed: int) -> None:
    """Raise BadInput if this process can start fewer than ``needed`` threads and processes.

    Libraries that render and compute print lines of their own, interrupt this process or end it if they cannot start
    their threads.
    """
    startable = count_startable(needed)
    if startable < needed:
        raise BadInput(
            f"the limit of threads and processes leaves {startable:,} (ulimit -u, or pids of the container)",
            allowed=f"{needed:,} or more",
            hint="stop other programs, use fewer workers, or ask for a higher limit",
        )


def check_address_space(min_bytes: int) -> None:
    """Raise BadInput if this process may address fewer than ``min_bytes`` bytes of memory.

    With less memory, the libraries that count and render hang, or end the process without a message.
    """
    try:
        import resource
    except ImportError:  # not a Unix
        return
    soft, _ = resource.getrlimit(resource.RLIMIT_AS)
    if resource.RLIM_INFINITY != soft < min_bytes:
        raise BadInput(
            f"this process may use only {soft >> 20:,} MiB of memory (ulimit -v)",
            allowed=f"{min_bytes >> 20:,} MiB or more",
            hint="raise the limit, or ask your batch system for more",
        )


@cache
def describe_machine() -> str:
    """Return one line on the hardware and software that affect running times, without names of host or user."""
    import numpy as np  # here, because it starts threads

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

    Dr.Jit and Mitsuba raise their own errors or abort if they are interrupted while they load.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


@contextmanager
def defer_termination() -> Iterator[None]:
    """Delay the signals of STOPPING until the end of the block, whichever thread receives them.

    Use this for a block that starts no process. In any thread but the main one, signals are neither handled nor
    delayed.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    received: list[int] = []
    before = {int(number): handler for number in STOPPING if (handler := signal.getsignal(number)) != signal.SIG_IGN}
    try:
        for number in before:
            signal.signal(number, lambda number, frame: received.append(number))
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        for number in received[:1]:
            signal.raise_signal(number)
