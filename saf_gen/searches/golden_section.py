"""Golden section search with the lens."""

import math
from dataclasses import dataclass
from typing import ClassVar

from saf_gen.searches._lens_commanding import FocusSampler, LensCommandingSearch, check_fraction

RATIO = (math.sqrt(5) - 1) / 2


@dataclass(frozen=True)
class GoldenSection(LensCommandingSearch):
    """Golden section: looks at two places of the travel, drops the end beside the worse, keeps the other.

    Each step leaves 0.618 of the bracket and takes one new look, until the bracket is no wider than
    ``tolerance`` of the travel: n = ⌈log(tolerance)/log(0.618)⌉ steps of one look, and one look to begin
    with. A curve with one peak is answered within 0.618 of the last bracket; the place lies inside the
    bracket, so a focus at the end of the travel is answered up to that far from it. Noise or a second peak
    sends a step to the wrong side for good; noise does where the curve is flat. The lens goes back and forth.
    Of equal looks the later place is dropped.
    """

    tolerance: float = 0.01

    source: ClassVar[str] = (
        "Kiefer, Sequential minimax search for a maximum, Proc. American Mathematical Society 4(3), 1953, "
        "doi:10.1090/S0002-9939-1953-0055639-3"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        check_fraction("tolerance", self.tolerance)

    def seek_focus(self, look: FocusSampler) -> str:
        left, width = 0.0, 1.0
        lower, upper = look(1 - RATIO), look(RATIO)
        for _ in range(math.ceil(math.log(self.tolerance) / math.log(RATIO)) - 1):
            width *= RATIO
            if lower >= upper:
                lower, upper = look(left + (1 - RATIO) * width), lower
            else:
                left += (1 - RATIO) / RATIO * width
                lower, upper = upper, look(left + RATIO * width)
        return ""
