"""One pass in steps chosen by rules: the steps depend on how the score changes."""

import math
from dataclasses import dataclass
from itertools import pairwise

from saf_gen.errors import BadInput
from saf_gen.plugins.searches._lens_commanding import (
    FocusSampler,
    LensCommandingSearch,
    check_fraction,
    divide_interval,
)


@dataclass(frozen=True)
class RuleBased(LensCommandingSearch):
    """Passes through the travel from the nearer end, in steps chosen by rules, and answers with the best position.

    After each sample, the slope is the relative change of the score divided by the change of position, a fraction of
    the travel. A slope of at least ``steep`` selects the ``fine`` step, a slope of at least ``gentle`` the ``middle``
    step, and any other slope the ``coarse`` step. After the first slope of at least ``steep``, the step is not
    enlarged once it is ``fine``, and the pass ends at the first score below the fraction ``drop`` of the range from the
    lowest to the highest score so far. If the samples next to the best one are more than a fine step away from it, fine
    steps fill these gaps at the end.

    The lens moves in one direction nearly all the time, so backlash matters little. The thresholds are relative, so a
    score that has a large constant part (er_count) or changes its sign misleads them. The search takes about 1/coarse +
    4·w/fine samples for a peak of half width w. The rules are modelled on the reference, whose constants belong to
    another camera.

    References
    ----------
    Kehtarnavaz and Oh, Real-Time Imaging 9(3), 2003, doi:10.1016/S1077-2014(03)00037-8.
    """

    coarse: float = 0.08
    middle: float = 0.03
    fine: float = 0.01
    gentle: float = 1.0
    steep: float = 4.0
    drop: float = 0.5

    def __post_init__(self) -> None:
        super().__post_init__()
        for key in ("coarse", "middle", "fine", "drop"):
            check_fraction(key, getattr(self, key))
        if not self.fine <= self.middle <= self.coarse:
            raise BadInput(
                f"steps are {self.coarse!r}, {self.middle!r}, {self.fine!r}", allowed="coarse >= middle >= fine"
            )
        if not 0 < self.gentle <= self.steep:
            raise BadInput(
                f"gentle is {self.gentle!r}, steep {self.steep!r}",
                allowed="relative change over the whole travel, 0 < gentle <= steep",
            )

    def seek_focus(self, sample: FocusSampler) -> str:
        begin = 0.0 if sample.read_start() <= 0.5 else 1.0
        direction = 1 - 2 * begin
        seen = [(0.0, sample(begin))]  # distance from the beginning of the pass, and score
        step, climbed = self.coarse, False
        while seen[-1][0] < 1:
            distance, before = seen[-1]
            ahead = min(distance + step, 1.0)
            score = sample(begin + direction * ahead)
            seen.append((ahead, score))
            slope = _relative_change(before, score) / (ahead - distance)
            low, high = min(s for _, s in seen), max(s for _, s in seen)
            above = score - low >= self.drop * (high - low)
            climbed = climbed or slope >= self.steep
            if climbed and not above:
                break
            if slope >= self.steep or (climbed and step == self.fine):
                step = self.fine
            else:
                step = self.middle if slope >= self.gentle else self.coarse
        for distance in self._gaps(seen):
            sample(begin + direction * distance)
        return "" if climbed else "no steep climb"

    def _gaps(self, seen: list[tuple[float, float]]) -> list[float]:
        """Return the distances, in fine steps, that fill the gaps next to the best sample, the farthest first."""
        best = max(range(len(seen)), key=lambda i: seen[i][1])
        beside = [distance for distance, _ in seen[max(best - 1, 0) : best + 2]]
        gaps = [divide_interval(near, far, step=self.fine)[1:-1] for near, far in pairwise(beside)]
        return [distance for gap in gaps for distance in gap][::-1]


def _relative_change(before: float, after: float) -> float:
    if before == 0:
        return math.copysign(math.inf, after) if after else 0.0
    return (after - before) / abs(before)
