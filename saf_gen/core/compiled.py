"""Compilation of inner loops by numba."""

from collections.abc import Callable
from typing import Any

from numba import njit


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function so that it runs without Python's global interpreter lock; cache it on disk."""
    return njit(nogil=True, cache=True)(function)
