"""Times between which a light that repeats is smooth, for products of schedules."""

import numpy as np

from saf_gen.errors import BadInput

MAX_PIECES = 10_000_000
"""Pieces of a product over a recording: steps of a microsecond for ten seconds."""


def repeated_breaks(period_s: float, duration_s: float, *, first_s: float = 0.0) -> np.ndarray:
    """Return times from ``first_s`` to the end of a recording or just after it, ``period_s`` seconds apart.

    Raises BadInput if there are more than a product can have.
    """
    count = (duration_s - first_s) / period_s if period_s > 0 else np.inf
    if not count < MAX_PIECES:
        raise BadInput(
            f"a factor that changes every {period_s:.2g} s has {count:.2g} pieces in a recording of {duration_s:g} s",
            allowed=f"at most {MAX_PIECES:,} pieces in a product",
            hint="choose a lower frequency, or a shorter recording",
        )
    return first_s + period_s * np.arange(max(int(np.ceil(count)), 0) + 1)
