"""Loads Dr.Jit and Mitsuba. Imported before anything else of this room.

While it loads, Dr.Jit complains of a missing LLVM straight to stderr, in words that help nobody; what is
missing is told in ours by :mod:`saf_gen.render.backend`.
"""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def _stderr_closed() -> Iterator[None]:
    sys.stderr.flush()
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


with _stderr_closed():
    import drjit
    import mitsuba

    drjit.detail.llvm_version()

__all__ = ["drjit", "mitsuba"]
