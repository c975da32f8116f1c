"""Time that calls take, added up: what of a run is a method's, and what the rig's."""

from collections.abc import Callable
from time import perf_counter
from typing import Any, TypeVar

__all__ = ["Stopwatch"]

T = TypeVar("T")


class Stopwatch:
    """``seconds``: how long the calls made through it took in all, those that raised too."""

    def __init__(self) -> None:
        self.seconds = 0.0

    def time(self, call: Callable[..., T], *given: Any, **more: Any) -> T:
        """What a call returns or raises."""
        begin = perf_counter()
        try:
            return call(*given, **more)
        finally:
            self.seconds += perf_counter() - begin
