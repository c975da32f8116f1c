"""Confidence intervals of a ranking, from a paired bootstrap over scenes.

The scene is the unit, because all sequences of a scene show the same content. Each resample draws as many
scenes as there are, with replacement, and every method is judged on the same draw, so that what is hard for
all cancels in a difference. Intervals are percentile intervals (Efron and Tibshirani, An Introduction to the
Bootstrap, 1993, doi:10.1201/9780429246593, chapter 13). With few scenes they are too narrow, and where all
scenes agree they have no width: a bootstrap cannot show what no scene has shown.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from saf_gen.core.seeds import make_generator

CONFIDENCE = 0.95
RESAMPLES = 5000
MIN_SCENES = 3
"""Fewest scenes for an interval: two scenes have only three different draws."""
TIE_TOLERANCE = 1e-9
"""Largest difference between equal successes: averages of averages may differ in the last bit."""

Interval = tuple[float, float]


@dataclass(frozen=True)
class BootstrapIntervals:
    """Intervals of one method among the others; None means unknown, and ``missing_reason`` says why."""

    success: Interval | None = None
    error: Interval | None = None
    """Interval of the median error."""
    rank: tuple[int, int] | None = None
    """Best and worst rank."""
    deficit_to_best: Interval | None = None
    """Success of the best method minus the method's own; of several best ones, the nearest counts."""
    level_with_best: bool | None = None
    """Whether the scenes cannot tell the method from a best one: ``deficit_to_best`` reaches down to 0."""
    missing_reason: str = ""


def bootstrap_intervals(
    success: Mapping[str, Mapping[str, float]],
    errors: Mapping[str, Sequence[tuple[str, float]]],
    *,
    resamples: int = RESAMPLES,
    confidence: float = CONFIDENCE,
) -> dict[str, BootstrapIntervals]:
    """Return the intervals of each method.

    ``success`` has by method and scene the success, 0–1; scenes that a method lacks are left out for all. ``errors``
    has by method (scene, \\|error\\|) of every answer, in any unit; for each method, resamples that hold none of its
    answers are left out. The draws depend only on the number of scenes (random stream ``("statistics", "bootstrap",
    scenes)``); scenes are ordered by name.
    """
    methods = list(success)
    scenes = sorted(set.intersection(*(set(by_scene) for by_scene in success.values())) if methods else set())
    if len(scenes) < MIN_SCENES:
        reason = f"{len(scenes)} of at least {MIN_SCENES} scenes"
        return {method: BootstrapIntervals(missing_reason=reason) for method in methods}
    draws = _draw_scenes(len(scenes), resamples)
    values = np.array([[success[method][scene] for scene in scenes] for method in methods])
    resampled = draws @ values.T / len(scenes)  # (resamples, methods)
    ranks = 1 + (resampled[:, None, :] > resampled[:, :, None] + TIE_TOLERANCE).sum(axis=2)
    means = values.mean(axis=1)
    best = np.flatnonzero(means >= means.max() - TIE_TOLERANCE)
    intervals = {}
    for i, method in enumerate(methods):
        deficits = [_interval(resampled[:, b] - resampled[:, i], confidence) for b in best]
        nearest = min(deficits, key=lambda interval: interval[0])
        intervals[method] = BootstrapIntervals(
            success=_interval(resampled[:, i], confidence),
            error=_error_interval(errors.get(method, ()), scenes, draws=draws, confidence=confidence),
            rank=_rank_interval(ranks[:, i], confidence),
            deficit_to_best=nearest,
            level_with_best=i in best or nearest[0] <= TIE_TOLERANCE,
        )
    return intervals


def _draw_scenes(scenes: int, resamples: int) -> np.ndarray:
    """Return how often each scene is drawn: int64 (resamples, scenes), each row sums to ``scenes``."""
    random = make_generator("statistics", "bootstrap", scenes)
    return random.multinomial(scenes, np.full(scenes, 1 / scenes), size=resamples)


def _error_interval(
    errors: Sequence[tuple[str, float]], scenes: Sequence[str], *, draws: np.ndarray, confidence: float
) -> Interval | None:
    """Return the interval of the median error; None where fewer than MIN_SCENES scenes have an answer."""
    columns = {scene: i for i, scene in enumerate(scenes)}
    known = sorted((error, columns[scene]) for scene, error in errors if scene in columns)
    if len({column for _, column in known}) < MIN_SCENES:
        return None
    values = np.array([error for error, _ in known])
    # For each resample, the number of drawn answers up to each error, in rising order; the last is their total.
    cumulative = np.cumsum(draws[:, [column for _, column in known]], axis=1)
    cumulative = cumulative[cumulative[:, -1] > 0]
    total = cumulative[:, -1]
    low, high = (values[(cumulative > rank[:, None]).argmax(axis=1)] for rank in ((total - 1) // 2, total // 2))
    return _interval((low + high) / 2, confidence)


def _interval(values: np.ndarray, confidence: float) -> Interval:
    tail = (1 - confidence) / 2
    low, high = np.quantile(values, [tail, 1 - tail])
    return float(low), float(high)


def _rank_interval(values: np.ndarray, confidence: float) -> tuple[int, int]:
    """Return the interval of a rank, rounded outwards to whole ranks."""
    tail = (1 - confidence) / 2
    low = np.quantile(values, tail, method="lower")
    high = np.quantile(values, 1 - tail, method="higher")
    return int(low), int(high)
