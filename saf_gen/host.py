"""The machine we run on, as far as work must know it."""

import os

__all__ = ["cores"]


def cores() -> int:
    """Cores that this process may use: fewer than the machine has in a container or under a scheduler."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1  # macOS has no affinity
