"""The text of a user's file of plug-ins: a measure, a search, and a class that is neither."""

PARTS = '''\
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.parts import Answer


@dataclass(frozen=True)
class Range:
    """Largest less smallest count."""

    power: int = 1
    degree: ClassVar[int] = 1
    source: ClassVar[str] = "a test"

    def __call__(self, counts):
        return float(np.ptp(np.asarray(counts, float))) ** self.power


@dataclass(frozen=True)
class Middle:
    """Always the middle."""

    causal: ClassVar[bool] = True
    source: ClassVar[str] = "a test"

    def __call__(self, view):
        return Answer((view.frames - 1) / 2)


class NoPart:
    pass


power = 3
'''
