"""Loads Dr.Jit before any other module of this package does, or reports in one line why the renderer cannot be used.

While it loads, Dr.Jit writes a complaint about a missing LLVM straight to stderr. This complaint is silenced, and
:mod:`saf_gen.render.backend` reports what is missing in plain words.

Idle threads of Numba (OpenMP) would wait for work in a busy loop, on cores that Dr.Jit's threads and other processes
need: a picture with few pixels then takes twice the processor time. Before the first of these threads starts,
OMP_WAIT_POLICY is therefore set to ``passive``, unless the user has set it.
"""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from saf_gen.core.cores import check_threads, usable_cores
from saf_gen.core.extras import RENDERER, require_extra
from saf_gen.errors import BadInput


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
check_threads(usable_cores() + 2)
os.environ.setdefault("OMP_WAIT_POLICY", "passive")

with _silent_stderr():
    try:
        import drjit
    except (ImportError, NameError) as error:  # Dr.Jit 1.5 fails with a NameError while it reports a missing library
        raise BadInput(
            f"Dr.Jit is installed, but cannot be loaded: {error.__cause__ or error.__context__ or error}",
            hint="install the library that is missing (Debian, Ubuntu: apt install libatomic1), then: saf-gen doctor",
        ) from error

    drjit.detail.llvm_version()
