"""Broad measure first, then the own one of the method: the first finds the neighbourhood of the focus."""

import math
from dataclasses import dataclass

from saf_gen.errors import BadInput
from saf_gen.plugins.searches._lens_commanding import FocusSampler, LensCommandingSearch, check_steps, divide_interval
from saf_gen.plugins.searches._windows import check_frame_count


@dataclass(frozen=True)
class CoarseToFine(LensCommandingSearch):
    """Samples positions ``coarse`` apart over the entire travel, then ``fine`` apart around the best of them.

    The first pass scores ``far_dt`` frames with the measure ``far``. Its curve should be broad, so that it rises even
    if the image is far out of focus. The second pass scores ``dt`` frames with the method's measure, from one coarse
    step before the best position to one after it; a gradient measure, with a narrow and steep curve, suits this pass.
    With ``far: own``, both passes use the method's measure. Each pass moves in one direction, so that backlash is the
    same for all its positions. The search takes at most 1/coarse + 2·coarse/fine + 2 samples for any curve. Only noise
    at the maximum misleads it.

    References
    ----------
    The two passes usual in cameras, with a second measure as in Gamadia and Kehtarnavaz, US 8049811, 2011,
    which widens its filter away from the focus.
    """

    coarse: float = 0.1
    fine: float = 0.02
    far: str = "sd"
    far_dt: int = 50

    def __post_init__(self) -> None:
        super().__post_init__()
        check_steps(self.coarse, self.fine)
        check_frame_count("far_dt", self.far_dt)
        if not (isinstance(self.far, str) and self.far):
            raise BadInput(f"far is {self.far!r}", allowed="the name of a focus measure, or own")

    @property
    def measures(self) -> tuple[str, ...]:
        """The measure of the first pass, unless it is the method's measure."""
        return () if self.far == "own" else (self.far,)

    def seek_focus(self, sample: FocusSampler) -> str:
        parts = math.ceil(1 / self.coarse)
        positions = [k / parts for k in range(parts + 1)]
        if sample.read_start() > 0.5:
            positions.reverse()
        sample.switch_measure(next(iter(self.measures), None), self.far_dt)
        scores = [sample(position) for position in positions]
        best = positions[scores.index(max(scores))]
        sample.switch_measure(None, self.dt)
        fine = divide_interval(max(best - 1 / parts, 0.0), min(best + 1 / parts, 1.0), step=self.fine)
        for position in fine if positions[-1] == 0.0 else fine[::-1]:
            sample(position)
        return ""
