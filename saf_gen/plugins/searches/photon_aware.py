"""Windows of equal light, and a stop past the focus: the photon-aware search."""

from dataclasses import dataclass
from typing import ClassVar

from saf_gen.errors import BadInput
from saf_gen.parts import Answer, View
from saf_gen.plugins.searches._light_windows import equal_light_windows
from saf_gen.plugins.searches._score_curve import ScoreCurve
from saf_gen.plugins.searches._windows import check_frame_count, check_numbers

BROAD = "sd_calibrated"


@dataclass(frozen=True)
class PhotonAware:
    """Follows the sweep with trailing windows of equal light, and stops once the focus has been passed.

    Scores from few spikes are uncertain and biased. The number of spikes, not time, therefore sets the length of a
    window: after each of ``steps`` steps of a recording, the window that ends there is the shortest one with twice
    ``counts`` spikes per pixel, about ``counts`` in each half, but no longer than the fraction ``longest`` of the
    recording. Its score belongs to its centre. Scores are smoothed by a Gaussian of ``smooth`` steps, and the answer is
    the top of a parabola fitted to the scores around the largest.

    The sweep stops once the curve has been below its largest value, by ``until`` of its range and by ``least`` of that
    value, for longer than a window, and has both risen and fallen by ``until``/2 of its range. With ``far``, the curve
    of ``sd_calibrated`` in the same windows must do the same: a steep measure has small local maxima far from the
    focus, where contrast is still a broad hill. If the curve does not fall by ``fall`` of its range on both sides of
    its largest value, the focus is not in the sweep, and the search abstains.

    Each step takes two to four scores, one of them with the method's measure. The trace holds the frame of the largest
    value so far, whenever it changes, in frames from 0.

    References
    ----------
    This project; it stops as SGFS should: Algorithm 1 of Su et al., "Intensity-Robust Autofocus for Spike
    Camera", CVPR 2024, doi:10.1109/CVPR52733.2024.02363.
    """

    counts: float = 6.0
    steps: int = 200
    longest: float = 0.15
    smooth: float = 2.0
    until: float = 0.5
    least: float = 0.2
    fall: float = 0.03
    far: bool = True

    causal: ClassVar[bool] = True
    measures: ClassVar[tuple[str, ...]] = ("er_count", "er_count_n", BROAD)

    def __post_init__(self) -> None:
        check_frame_count("steps", self.steps)
        fractions = dict.fromkeys(("longest", "until", "least", "fall"), 1.0)
        check_numbers(self, {**fractions, "smooth": 100, "counts": 1e6})
        if not isinstance(self.far, bool):
            raise BadInput(f"far is {self.far!r}", allowed="true, false")

    def __call__(self, view: View) -> Answer:
        """Return the answer for a sweep; raise BadInput if it has fewer than two frames per step."""
        width = self.smooth * (view.frames // self.steps)
        curves = [ScoreCurve(width, self.steps + 1) for _ in range(2 if self.far else 1)]
        curve = curves[0]
        falling = 0
        trace: list[float] = []
        for first, stop, _, steps in equal_light_windows(view, 2 * self.counts, steps=self.steps, longest=self.longest):
            for each, measure in zip(curves, (None, BROAD), strict=False):
                each.add((first + stop) / 2 - 0.5, view.score(first, stop, measure))
            best = curve.best()
            if not trace or trace[-1] != best:
                trace.append(best)
            falling = falling + 1 if all(each.has_fallen(self.until, self.least) for each in curves) else 0
            if falling > max(2, steps) and all(each.is_peak(self.until / 2) for each in curves):
                break  # low for longer than a window, so the first and the last of these windows share no spike
        note = f"stopped after {view.now} of {view.frames} frames"
        if not trace:
            return Answer(None, (), "too dark")
        if not curve.is_peak(self.fall):
            return Answer(None, tuple(trace), f"{note}: no focus in it, the curve has no two sides")
        return Answer(curve.top(), tuple(trace), note)
