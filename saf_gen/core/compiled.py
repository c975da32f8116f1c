"""Compilation of inner loops by numba."""

from collections.abc import Callable
from typing import Any

from numba import njit


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function so that it runs without Python's global interpreter lock; cache it on disk."""
    return njit(nogil=True, cache=True)(function)


def compiled_unchecked(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile as :func:`compiled`, without checks of divisors, which keep loops from being vectorised: x/0 is inf."""
    return njit(nogil=True, cache=True, error_model="numpy")(function)
