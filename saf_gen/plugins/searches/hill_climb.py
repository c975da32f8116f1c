"""Hill climbing from coarse to fine steps, which moves the lens."""

from dataclasses import dataclass

from saf_gen.plugins.searches._lens_commanding import FocusSampler, LensCommandingSearch, check_steps
from saf_gen.plugins.searches._windows import check_frame_count


@dataclass(frozen=True)
class HillClimb(LensCommandingSearch):
    """Climbs from the initial lens position in steps of ``coarse``; at the top, it halves the step, down to ``fine``.

    The first climb goes towards the longer part of the travel, continues while the score rises, and ends after
    ``falls`` consecutive samples that are not better. If it finds nothing better, the other direction is tried. Finer
    climbs start from the best position, try both sides, and end with the first sample that is not better. Unlike the
    other searches that move the lens, this one need not cross the travel, so it is quick near the focus. On a flat and
    noisy curve it stays at a chance maximum, up to ``falls``·``coarse`` from its start. It takes up to 1/coarse +
    3·log2(coarse/fine) samples.

    References
    ----------
    The staged climb described in He et al., "Modified fast climbing search auto-focus algorithm with adaptive
    step size", IEEE Trans. Consumer Electronics 49(2), 2003, doi:10.1109/TCE.2003.1209511.
    """

    coarse: float = 0.1
    fine: float = 0.01
    falls: int = 2

    def __post_init__(self) -> None:
        super().__post_init__()
        check_steps(self.coarse, self.fine)
        check_frame_count("falls", self.falls)

    def seek_focus(self, sample: FocusSampler) -> str:
        here = sample.read_start()
        score = sample(here)
        direction, step, falls = (1 if here <= 0.5 else -1), self.coarse, self.falls
        while True:
            top, best = _climb(sample, here, score=score, step=direction * step, falls=falls)
            if top == here:
                top, best = _climb(sample, here, score=score, step=-direction * step, falls=falls)
            else:
                direction = -direction  # a still better position can only be behind
            here, score = top, best
            if step <= self.fine:
                return ""
            step, falls = max(step / 2, self.fine), 1


def _climb(sample: FocusSampler, start: float, *, score: float, step: float, falls: int) -> tuple[float, float]:
    """Return the best position from ``start`` on and its score; ``falls`` samples that are not better end the climb."""
    top, best, worse, position = start, score, 0, start
    while worse < falls:
        ahead = min(max(position + step, 0.0), 1.0)
        if ahead == position:  # the end of the travel
            break
        position = ahead
        found = sample(position)
        if found > best:
            top, best, worse = position, found, 0
        else:
            worse += 1
    return top, best
