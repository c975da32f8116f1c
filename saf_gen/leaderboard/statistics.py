"""How far a ranking can be trusted: paired bootstrap over scenes.

The scene is the unit: sequences of one scene share its content and tell the same twice. Each resample draws
as many scenes as there are, with replacement, and every method is judged on the same draw, so that what is
hard for all cancels in a difference. Intervals are percentile intervals (Efron and Tibshirani, An
Introduction to the Bootstrap, 1993, doi:10.1201/9780429246593, chapter 13). With few scenes they are too
narrow, and where every scene says the same they have no width: a bootstrap cannot show what no scene has
shown.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from saf_gen.core.seeds import make_generator

__all__ = [
    "CONFIDENCE",
    "MIN_SCENES",
    "RESAMPLES",
    "TIE_TOLERANCE",
    "BootstrapIntervals",
    "Interval",
    "bootstrap_intervals",
]

CONFIDENCE = 0.95
RESAMPLES = 5000
MIN_SCENES = 3
"""With fewer there is no interval: two scenes can be drawn in three ways."""
TIE_TOLERANCE = 1e-9
"""Success is an average of averages: equal fractions may differ in the last bit."""

Interval = tuple[float, float]


@dataclass(frozen=True)
class BootstrapIntervals:
    """One method among the others. None is unknown; ``missing_reason`` then says the reason, else it is
    ''."""

    success: Interval | None = None
    error: Interval | None = None
    """Of the median of the errors."""
    rank: tuple[int, int] | None = None
    """Best and worst rank."""
    deficit_to_best: Interval | None = None
    """Success of the best method less one's own; of several best, of the one that comes nearest."""
    level_with_best: bool | None = None
    """Whether the scenes cannot tell it apart from a best method: ``deficit_to_best`` reaches down to 0."""
    missing_reason: str = ""


def bootstrap_intervals(
    success: Mapping[str, Mapping[str, float]],
    errors: Mapping[str, Sequence[tuple[str, float]]],
    *,
    resamples: int = RESAMPLES,
    confidence: float = CONFIDENCE,
) -> dict[str, BootstrapIntervals]:
    """Each method's intervals, by method.

    Parameters
    ----------
    success : by method, then by scene: the share of successes there, 0...1. Scenes that a method lacks are
        left out for all.
    errors : by method: (scene, \\|error\\|) of every answer, in any unit. A resample without any answer of a
        method is left out for it.
    resamples, confidence : draws, and the share of them between the ends of an interval.

    The draws depend on the number of scenes alone (random stream ``("statistics", "bootstrap", scenes)``),
    scenes are taken in the order of their names.
    """
    methods = list(success)
    common = set.intersection(*(set(cells) for cells in success.values())) if methods else set()
    scenes = sorted(common)
    if len(scenes) < MIN_SCENES:
        why = f"{len(scenes)} of at least {MIN_SCENES} scenes"
        return {method: BootstrapIntervals(missing_reason=why) for method in methods}
    drawn = _draws(len(scenes), resamples)
    cells = np.array([[success[method][scene] for scene in scenes] for method in methods])
    shares = drawn @ cells.T / len(scenes)  # (resamples, methods)
    ranks = 1 + (shares[:, None, :] > shares[:, :, None] + TIE_TOLERANCE).sum(axis=2)
    means = cells.mean(axis=1)
    best = np.flatnonzero(means >= means.max() - TIE_TOLERANCE)
    out = {}
    for i, method in enumerate(methods):
        ahead = [_interval(shares[:, b] - shares[:, i], confidence) for b in best]
        behind = min(ahead, key=lambda interval: interval[0])
        out[method] = BootstrapIntervals(
            success=_interval(shares[:, i], confidence),
            error=_error_interval(errors.get(method, ()), scenes, drawn, confidence),
            rank=_whole_interval(ranks[:, i], confidence),
            deficit_to_best=behind,
            level_with_best=i in best or behind[0] <= TIE_TOLERANCE,
        )
    return out


def _draws(scenes: int, resamples: int) -> np.ndarray:
    """How often each scene is drawn: int64 (resamples, scenes), each row sums to ``scenes``."""
    random = make_generator("statistics", "bootstrap", scenes)
    return random.multinomial(scenes, np.full(scenes, 1 / scenes), size=resamples)


def _error_interval(
    errors: Sequence[tuple[str, float]], scenes: Sequence[str], drawn: np.ndarray, confidence: float
) -> Interval | None:
    """Of the median; None where fewer than MIN_SCENES scenes have an answer."""
    at = {scene: i for i, scene in enumerate(scenes)}
    held = sorted((error, at[scene]) for scene, error in errors if scene in at)
    if len({scene for _, scene in held}) < MIN_SCENES:
        return None
    values = np.array([error for error, _ in held])
    upto = np.cumsum(drawn[:, [scene for _, scene in held]], axis=1)  # answers up to each, in order of size
    count = upto[:, -1]
    some = count > 0
    upto, count = upto[some], count[some]
    middle = [values[(upto > place[:, None]).argmax(axis=1)] for place in ((count - 1) // 2, count // 2)]
    return _interval((middle[0] + middle[1]) / 2, confidence)


def _interval(values: np.ndarray, confidence: float) -> Interval:
    tail = (1 - confidence) / 2
    low, high = np.quantile(values, [tail, 1 - tail])
    return float(low), float(high)


def _whole_interval(values: np.ndarray, confidence: float) -> tuple[int, int]:
    """As ``_interval``, rounded outwards: between two ranks there is none."""
    tail = (1 - confidence) / 2
    low = np.quantile(values, tail, method="lower")
    high = np.quantile(values, 1 - tail, method="higher")
    return int(low), int(high)
