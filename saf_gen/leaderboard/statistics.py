"""Confidence intervals of a ranking, from a paired bootstrap over scenes.

The scene is the unit, because all sequences of a scene show the same content. Each resample draws as many
scenes as there are, with replacement, and every method is judged on the same draw, so that what is hard for
all cancels in a difference. Intervals are percentile intervals (Efron and Tibshirani, An Introduction to the
Bootstrap, 1993, doi:10.1201/9780429246593, chapter 13). With few scenes they are too narrow, and where all
scenes agree they have no width: a bootstrap cannot show what no scene has shown.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from saf_gen.core.seeds import make_generator

CONFIDENCE = 0.95
RESAMPLES = 5000
MIN_SCENES = 3
"""Fewest scenes for an interval: two scenes have only three different draws."""
TIE_TOLERANCE = 1e-9
"""Largest difference between equal successes: averages of averages may differ in the last bit."""
_MAX_NUMBERS = 2_000_000
"""Most draws, or comparisons of methods, in memory at a time."""
_BLOCKS = 32

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
    values = np.array([[success[method][scene] for scene in scenes] for method in methods])
    ordered = [_order_errors(errors.get(method, ()), scenes) for method in methods]
    parts = []
    for draws in _draw_scenes(len(scenes), resamples, at_once=_MAX_NUMBERS // max(len(scenes), len(methods) ** 2)):
        resampled = draws @ values.T / len(scenes)  # (resamples, methods)
        ranks = 1 + (resampled[:, None, :] > resampled[:, :, None] + TIE_TOLERANCE).sum(axis=2)
        errors_drawn = [_find_medians(*one, draws=draws) if one else np.full(len(draws), np.nan) for one in ordered]
        parts.append((resampled, ranks, np.stack(errors_drawn, axis=1)))
    resampled, ranks, medians = (np.concatenate(part) for part in zip(*parts, strict=True))
    means = values.mean(axis=1)
    best = np.flatnonzero(means >= means.max() - TIE_TOLERANCE)
    intervals = {}
    for i, method in enumerate(methods):
        deficits = [_interval(resampled[:, b] - resampled[:, i], confidence) for b in best]
        nearest = min(deficits, key=lambda interval: interval[0])
        intervals[method] = BootstrapIntervals(
            success=_interval(resampled[:, i], confidence),
            error=_interval(medians[~np.isnan(medians[:, i]), i], confidence) if ordered[i] else None,
            rank=_rank_interval(ranks[:, i], confidence),
            deficit_to_best=nearest,
            level_with_best=i in best or nearest[0] <= TIE_TOLERANCE,
        )
    return intervals


def _draw_scenes(scenes: int, resamples: int, *, at_once: int) -> Iterator[np.ndarray]:
    """Yield how often each scene is drawn: float64 (resamples, scenes), whole numbers, each row sums to ``scenes``.

    The draws are the same however many are made at once.
    """
    random, shares = make_generator("statistics", "bootstrap", scenes), np.full(scenes, 1 / scenes)
    size = max(at_once, 1)
    for first in range(0, resamples, size):
        # Matrix products of whole numbers are exact, and as float64 they are fast.
        yield random.multinomial(scenes, shares, size=min(size, resamples - first)).astype(np.float64)


def _order_errors(errors: Sequence[tuple[str, float]], scenes: Sequence[str]) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the errors in rising order and the number of each one's scene; None for fewer than MIN_SCENES scenes."""
    columns = {scene: i for i, scene in enumerate(scenes)}
    known = sorted((error, columns[scene]) for scene, error in errors if scene in columns)
    if len({column for _, column in known}) < MIN_SCENES:
        return None
    return np.array([error for error, _ in known]), np.array([column for _, column in known])


def _find_medians(values: np.ndarray, columns: np.ndarray, *, draws: np.ndarray) -> np.ndarray:
    """Return the median of each resample (R,), NaN where it holds no value.

    ``values`` (N,) rise, and each counts as often as its scene, ``columns`` (N,), in ``draws`` (R, S). The block of
    values that holds a median is found first, so that R × N numbers are never in memory.
    """
    block = -(-len(values) // _BLOCKS)
    blocks = -(-len(values) // block)
    by_block = np.zeros((draws.shape[1], blocks))
    np.add.at(by_block, (columns, np.arange(len(values)) // block), 1)
    up_to = np.cumsum(draws @ by_block, axis=1)
    total, rows = up_to[:, -1], np.arange(len(draws))
    padded = np.pad(columns, (0, blocks * block - len(columns)))  # no median lies beyond the last value

    def value_at(rank: np.ndarray) -> np.ndarray:
        found = (up_to > rank[:, None]).argmax(axis=1)
        before = np.where(found > 0, up_to[rows, found - 1], 0)
        drawn = draws[rows[:, None], padded.reshape(blocks, block)[found]]
        at: np.ndarray = (np.cumsum(drawn, axis=1) > (rank - before)[:, None]).argmax(axis=1)
        return np.asarray(values[np.minimum(found * block + at, len(values) - 1)])

    medians = (value_at((total - 1) // 2) + value_at(total // 2)) / 2
    return np.where(total > 0, medians, np.nan)


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
