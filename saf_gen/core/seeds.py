"""Random streams, named by purpose.

A stream's name is a list (recipe seed, sequence, stage), hashed as a list: ``("a", "bc")`` and
``("ab", "c")`` differ. Nothing about workers, time or order enters, so any part of a dataset can be made
again alone, anywhere, with the same numbers.
"""

import hashlib
import json

import numpy as np

__all__ = ["derive_seed", "make_generator"]


def _digest(name: tuple[str | int, ...]) -> bytes:
    return hashlib.sha256(json.dumps(list(name), ensure_ascii=True).encode()).digest()


def make_generator(*name: str | int) -> np.random.Generator:
    """A PCG64 generator for this purpose and no other."""
    words = np.frombuffer(_digest(name), dtype="<u4")
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([int(w) for w in words])))


def derive_seed(*name: str | int) -> int:
    """A 63-bit integer for this purpose: a seed to hand to a compiled kernel or to write in a file."""
    return int.from_bytes(_digest(name)[:8], "little") >> 1
