"""Golden section search, which moves the lens."""

import math
from dataclasses import dataclass

from saf_gen.plugins.searches._lens_commanding import BracketingSearch, FocusSampler

RATIO = (math.sqrt(5) - 1) / 2


@dataclass(frozen=True)
class GoldenSection(BracketingSearch):
    """Golden section: samples two positions in a bracket, and drops the end of the bracket next to the worse one.

    Each step leaves 0.618 of the bracket and takes one new sample, until the bracket is no wider than ``tolerance`` of
    the travel. This takes n = ⌈log(tolerance)/log(0.618)⌉ steps, and one more sample at the beginning. For a curve with
    a single peak, the error is at most 0.618 of the last bracket. The answer is inside the bracket, so a focus at the
    end of the travel is missed by up to that much. A step to the wrong side, because of noise on a flat part of the
    curve or of a second peak, is never undone. The lens moves back and forth. If two samples are equal, the larger
    position is dropped.

    References
    ----------
    Kiefer, Proc. American Mathematical Society 4(3), 1953, doi:10.1090/S0002-9939-1953-0055639-3.
    """

    def seek_focus(self, sample: FocusSampler) -> str:
        left, width = 0.0, 1.0
        lower, upper = sample(1 - RATIO), sample(RATIO)
        for _ in range(math.ceil(math.log(self.tolerance) / math.log(RATIO)) - 1):
            width *= RATIO
            if lower >= upper:
                lower, upper = sample(left + (1 - RATIO) * width), lower
            else:
                left += (1 - RATIO) / RATIO * width
                lower, upper = upper, sample(left + RATIO * width)
        return ""
