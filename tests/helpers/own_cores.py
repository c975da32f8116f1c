"""Pins each of several test processes to separate cores on import, before any thread starts.

If processes share cores, their threads wait for each other, and rendering takes a fifth longer.
"""

import os


def keep_to_own_cores(name: str, count: int) -> None:
    """Restrict this process, named "gw0" and so on, of ``count``, and its children to some of the cores."""
    cores = sorted(os.sched_getaffinity(0))
    number = int(name.removeprefix("gw"))
    # Tests of threads need several of them even on one core.
    os.environ.setdefault("NUMBA_NUM_THREADS", str(len(cores)))
    os.sched_setaffinity(0, cores[number::count] or [cores[number % len(cores)]])


if "PYTEST_XDIST_WORKER" in os.environ and hasattr(os, "sched_setaffinity"):
    keep_to_own_cores(os.environ["PYTEST_XDIST_WORKER"], int(os.environ["PYTEST_XDIST_WORKER_COUNT"]))
