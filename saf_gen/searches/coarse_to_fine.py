"""Coarse to fine: a broad measure finds the neighbourhood, the method's own the place."""

import math
from dataclasses import dataclass
from typing import ClassVar

from saf_gen.errors import BadInput
from saf_gen.searches._golden_narrowing import check_frame_count
from saf_gen.searches._lens_commanding import FocusSampler, LensCommandingSearch, check_fraction


@dataclass(frozen=True)
class CoarseToFine(LensCommandingSearch):
    """Looks at places ``coarse`` apart all over the travel, then ``fine`` apart round the best of them.

    The first pass scores ``far_dt`` frames by the measure ``far``, whose curve is to be broad: it must rise
    where the image is far out of focus. The second scores ``dt`` frames by the method's own measure, from one
    coarse step before the best place to one after; a gradient, narrow and steep, suits it. ``far: own`` takes
    the method's measure for both. Either pass goes one way, so that backlash is the same for all its places.
    1/coarse + 2·coarse/fine + 2 looks at most, whatever the curve: nothing it sees misleads it but noise at
    the top.
    """

    coarse: float = 0.1
    fine: float = 0.02
    far: str = "sd"
    far_dt: int = 50

    source: ClassVar[str] = (
        "the two passes of cameras in general, with a second measure as in Gamadia and Kehtarnavaz, "
        "US 8049811, 2011, which widens its filter away from the focus"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        check_fraction("coarse", self.coarse)
        check_fraction("fine", self.fine)
        check_frame_count(self.far_dt, "far_dt")
        if self.fine > self.coarse:
            raise BadInput(f"fine is {self.fine!r}", allowed=f"no more than coarse, {self.coarse!r}")
        if not (isinstance(self.far, str) and self.far):
            raise BadInput(f"far is {self.far!r}", allowed="the name of a focus measure, or own")

    @property
    def measures(self) -> tuple[str, ...]:
        """The measure that it looks through beside the method's own."""
        return () if self.far == "own" else (self.far,)

    def seek_focus(self, look: FocusSampler) -> str:
        parts = math.ceil(1 / self.coarse)
        places = [k / parts for k in range(parts + 1)]
        if look.start() > 0.5:
            places.reverse()
        look.switch_measure(next(iter(self.measures), None), self.far_dt)
        scores = [look(place) for place in places]
        best = places[scores.index(max(scores))]
        look.switch_measure(None, self.dt)
        low, high = max(best - 1 / parts, 0.0), min(best + 1 / parts, 1.0)
        steps = math.ceil(round((high - low) / self.fine, 6))
        fine = [low + (high - low) * k / steps for k in range(steps + 1)]
        for place in fine if places[-1] == 0.0 else fine[::-1]:
            look(place)
        return ""
