"""Hill climbing with the lens, coarse to fine."""

from dataclasses import dataclass
from typing import ClassVar

from saf_gen.errors import BadInput
from saf_gen.searches._golden_narrowing import check_frame_count
from saf_gen.searches._lens_commanding import FocusSampler, LensCommandingSearch, check_fraction


@dataclass(frozen=True)
class HillClimb(LensCommandingSearch):
    """Climbs from where the lens stands in steps of ``coarse``; at the top halves them, down to ``fine``.

    It sets off towards the longer part of the travel, goes on while the score rises, and ends a climb after
    ``falls`` looks running that are not better; if it found nothing better it tries the other way. Finer
    climbs start from the best place, end with the first worse look, and try both sides. Of searches that
    command the lens it alone needs not cross the travel: near the focus it is quick. Where the curve is flat
    and noisy it stays at a chance top, up to ``falls``·``coarse`` from where it began. Up to 1/coarse +
    3·log2(coarse/fine) looks.
    """

    coarse: float = 0.1
    fine: float = 0.01
    falls: int = 2

    source: ClassVar[str] = (
        "the climb in stages as He et al. describe it, Modified fast climbing search auto-focus algorithm "
        "with adaptive step size, IEEE Trans. Consumer Electronics 49(2), 2003, doi:10.1109/TCE.2003.1209511"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        check_fraction("coarse", self.coarse)
        check_fraction("fine", self.fine)
        check_frame_count(self.falls, "falls")
        if self.fine > self.coarse:
            raise BadInput(f"fine is {self.fine!r}", allowed=f"no more than coarse, {self.coarse!r}")

    def seek_focus(self, look: FocusSampler) -> str:
        here = look.start()
        score = look(here)
        way, step, falls = (1 if here <= 0.5 else -1), self.coarse, self.falls
        while True:
            place, best = _climb(look, here, score, way * step, falls)
            if place == here:
                place, best = _climb(look, here, score, -way * step, falls)
            else:
                way = -way  # the top lies behind, if anywhere
            here, score = place, best
            if step <= self.fine:
                return ""
            step, falls = max(step / 2, self.fine), 1


def _climb(look: FocusSampler, here: float, score: float, step: float, falls: int) -> tuple[float, float]:
    """The best place on the way from ``here``, and its score; ``falls`` looks running that are not end it."""
    top, best, worse, place = here, score, 0, here
    while worse < falls:
        ahead = min(max(place + step, 0.0), 1.0)
        if ahead == place:  # the end of the travel
            break
        place = ahead
        found = look(place)
        if found > best:
            top, best, worse = place, found, 0
        else:
            worse += 1
    return top, best
