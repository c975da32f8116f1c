"""Ternary search with the lens."""

import math
from dataclasses import dataclass
from typing import ClassVar

from saf_gen.searches._lens_commanding import FocusSampler, LensCommandingSearch, check_fraction


@dataclass(frozen=True)
class Ternary(LensCommandingSearch):
    """Ternary search: looks at the two thirds of the bracket, and drops the third beside the worse.

    Two new looks a step, ⌈log(tolerance)/log(2/3)⌉ steps until the bracket is no wider than ``tolerance`` of
    the travel: twice the looks of golden section and more. Nothing seen before is used again, which helps
    where the light has changed since. A curve with one peak is answered within 2/3 of the last bracket. Of
    equal looks the later place is dropped.
    """

    tolerance: float = 0.01

    source: ClassVar[str] = (
        "textbook search of a unimodal function, without reuse of looks; its bounds: Kiefer, Proc. American "
        "Mathematical Society 4(3), 1953, doi:10.1090/S0002-9939-1953-0055639-3"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        check_fraction("tolerance", self.tolerance)

    def seek_focus(self, look: FocusSampler) -> str:
        left, width = 0.0, 1.0
        for _ in range(math.ceil(math.log(self.tolerance) / math.log(2 / 3))):
            lower, upper = look(left + width / 3), look(left + 2 * width / 3)
            if lower < upper:
                left += width / 3
            width *= 2 / 3
        return ""
