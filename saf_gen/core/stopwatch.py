"""A stopwatch for calls, which separates the time of a method from the time of the evaluator."""

import time
from collections.abc import Callable
from typing import Any, TypeVar

T = TypeVar("T")


class Stopwatch:
    """Adds up, in ``seconds``, the durations of the calls made through it, including those that raised."""

    def __init__(self) -> None:
        self.seconds = 0.0

    def time(self, call: Callable[..., T], *args: Any, **kwargs: Any) -> T:
        """Call ``call`` with the arguments, and return what it returns or raise what it raises."""
        begin = time.perf_counter()
        try:
            return call(*args, **kwargs)
        finally:
            self.seconds += time.perf_counter() - begin
