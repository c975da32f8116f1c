"""Random streams that are named by their purpose.

A name is a list such as (recipe seed, sequence, stage) and is hashed as a list, so ``("a", "bc")`` and ``("ab", "c")``
differ. A stream does not depend on workers, time or order, so each sequence of a dataset can be reproduced alone, on
any machine.
"""

import hashlib
import json

import numpy as np


def _digest(name: tuple[str | int, ...]) -> bytes:
    return hashlib.sha256(json.dumps(list(name), ensure_ascii=True).encode()).digest()


def make_generator(*name: str | int) -> np.random.Generator:
    """Return the PCG64 generator with this name."""
    words = np.frombuffer(_digest(name), dtype="<u4")
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([int(w) for w in words])))


def derive_seed(*name: str | int) -> int:
    """Return the 63-bit integer that belongs to this name, as a seed for a compiled kernel or a file."""
    return int.from_bytes(_digest(name)[:8], "little") >> 1
