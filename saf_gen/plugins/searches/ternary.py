"""Ternary search with the lens."""

import math
from dataclasses import dataclass

from saf_gen.plugins.searches._lens_commanding import BracketingSearch, FocusSampler


@dataclass(frozen=True)
class Ternary(BracketingSearch):
    """Ternary search: samples the bracket at its two thirds, and drops the third beside the worse one.

    Two new samples per step, ⌈log(tolerance)/log(2/3)⌉ steps until the bracket is no wider than ``tolerance``
    of the travel: more than twice the samples of golden section. No sample is used again, which helps where
    the light has changed since. A curve with one peak is answered within 2/3 of the last bracket. Of equal
    samples the later position is dropped.

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
