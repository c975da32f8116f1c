"""Whether this system shuts guests in."""

import ctypes
import sys

from saf_gen.core import supervisor


def has_landlock() -> bool:
    """Return whether the system has Landlock with rules for signals (version 6)."""
    return sys.platform == "linux" and ctypes.CDLL(None).syscall(supervisor.CREATE_RULESET, None, 0, 1) >= 6
