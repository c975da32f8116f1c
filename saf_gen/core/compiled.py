"""Compilation of inner loops by numba."""

from collections.abc import Callable
from typing import Any

from numba import njit


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function so that it runs without Python's global interpreter lock; cache it on disk if possible."""
    try:
        return njit(nogil=True, cache=True)(function)
    except RuntimeError:  # numba found no folder that it may write to: the installation is read-only
        return njit(nogil=True)(function)
