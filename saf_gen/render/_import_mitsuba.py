"""Loads Dr.Jit; imported before every other module of this package, and says in one line where there is no renderer.

While it loads, Dr.Jit writes a complaint about a missing LLVM straight to stderr. It is silenced here, and
:mod:`saf_gen.render.backend` says in plain words what is missing.

Numba's threads (OpenMP) would wait for their next work in a busy loop, on cores that Dr.Jit's threads and other
processes need: a picture of few pixels then takes twice the processor time. Here they are told to sleep, before the
first of them starts; whoever wants them awake sets OMP_WAIT_POLICY.
"""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from saf_gen.core.extras import RENDERER, require_extra


@contextmanager
def _silent_stderr() -> Iterator[None]:
    sys.stderr.flush()
    original, null = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(null, 2)
        yield
    finally:
        os.dup2(original, 2)
        os.close(original)
        os.close(null)


require_extra("render", *RENDERER, of="rendering")
os.environ.setdefault("OMP_WAIT_POLICY", "passive")

with _silent_stderr():
    import drjit

    drjit.detail.llvm_version()
