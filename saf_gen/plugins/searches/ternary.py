"""Ternary search, which moves the lens."""

import math
from dataclasses import dataclass

from saf_gen.plugins.searches._lens_commanding import BracketingSearch, FocusSampler


@dataclass(frozen=True)
class Ternary(BracketingSearch):
    """Ternary search: samples a bracket at one and two thirds, and drops the outer third next to the worse sample.

    Each step takes two new samples, and ⌈log(tolerance)/log(2/3)⌉ steps make the bracket no wider than ``tolerance`` of
    the travel. This is more than twice the samples of golden section. No sample is used again, which helps if the light
    has changed since. For a curve with a single peak, the error is at most 2/3 of the last bracket. If two samples are
    equal, the larger position is dropped.

    References
    ----------
    The textbook search of a unimodal function, without reuse of samples; its bounds are in Kiefer, Proc.
    American Mathematical Society 4(3), 1953, doi:10.1090/S0002-9939-1953-0055639-3.
    """

    def seek_focus(self, sample: FocusSampler) -> str:
        left, width = 0.0, 1.0
        for _ in range(math.ceil(math.log(self.tolerance) / math.log(2 / 3))):
            lower, upper = sample(left + width / 3), sample(left + 2 * width / 3)
            if lower < upper:
                left += width / 3
            width *= 2 / 3
        return ""
