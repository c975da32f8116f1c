"""Golden section search with the lens."""

import math
from dataclasses import dataclass

from saf_gen.plugins.searches._lens_commanding import BracketingSearch, FocusSampler

RATIO = (math.sqrt(5) - 1) / 2


@dataclass(frozen=True)
class GoldenSection(BracketingSearch):
    """Golden section: samples two positions of the bracket, and drops the end beside the worse one.

    Each step leaves 0.618 of the bracket and takes one new sample, until the bracket is no wider than ``tolerance`` of
    the travel: n = ⌈log(tolerance)/log(0.618)⌉ steps, and one sample more to begin with. A curve with one peak is
    answered within 0.618 of the last bracket; the answer lies inside the bracket, so a focus at the end of the travel
    is missed by up to that much. Noise, where the curve is flat, or a second peak send a step to the wrong side for
    good. The lens moves back and forth. Of equal samples the later position is dropped.

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
