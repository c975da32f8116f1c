"""Gives each process of a run of the tests in several its own cores, when it is imported: before any thread starts.

Where processes share cores, the threads of each wait for those of the others, and rendering takes a fifth longer.
"""

import os


def keep_to_own_cores(name: str, count: int) -> None:
    """Keep this process, the ``name``-th ("gw0" and so on) of ``count``, and all that it starts to its cores."""
    cores = sorted(os.sched_getaffinity(0))
    number = int(name.removeprefix("gw"))
    # Tests of several threads have them on one core too.
    os.environ.setdefault("NUMBA_NUM_THREADS", str(len(cores)))
    os.sched_setaffinity(0, cores[number::count] or [cores[number % len(cores)]])


if "PYTEST_XDIST_WORKER" in os.environ and hasattr(os, "sched_setaffinity"):
    keep_to_own_cores(os.environ["PYTEST_XDIST_WORKER"], int(os.environ["PYTEST_XDIST_WORKER_COUNT"]))
