"""Dependence of the ranking of methods on a condition: Kendall's τ of the rankings under two of its bins.

τ is 1 if both rankings order all methods alike, 0 if they are unrelated, and −1 if one is the reverse of the other.
Rankings from a few scenes differ by chance even under conditions that change nothing, so each τ is reported together
with the τ that chance alone would give.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from saf_gen.benchmark.records import Record
from saf_gen.core.region import REGIONS
from saf_gen.core.seeds import make_generator
from saf_gen.leaderboard.intervals import CONFIDENCE, MIN_SCENES
from saf_gen.leaderboard.ranking import Outcomes, collect_outcomes, group_by
from saf_gen.leaderboard.results import AXES, Axis, group_by_bin, largest_bins

RESAMPLES = 500
MAX_BINS = 6
"""Largest number of bins of a condition that are compared; those with the most sequences are chosen."""
MIN_METHODS = 3
"""Smallest number of common methods for which two rankings are compared."""
REGION = Axis(
    "region",
    "Region",
    "Where methods look: in the box around the target or another one, or in the whole frame.",
    lambda r: r.who.region,
)
CONDITIONS = (*(axis for axis in AXES if axis.name != "scene"), REGION)
"""The conditions whose bins are compared."""
_TIE = 1e-9
_MAX_NUMBERS = 1_000_000


@dataclass(frozen=True)
class RankAgreement:
    """Agreement of two rankings of the same methods, by answerable success within 1 DoF, under two bins of a condition.

    Attributes
    ----------
    condition, first, second : str
        Names of the condition and of its two bins.
    methods, scenes, shared : int
        Numbers of methods, of scenes with sequences in at least one bin, and of scenes with sequences in both.
    tau : float or None
        Kendall's τ-b, which allows for ties, −1 to 1. None if all methods are equal under one of the bins.
    low, high : float or None
        95 % interval of ``tau`` by a bootstrap over scenes, each drawn with its sequences in both bins; it reaches at
        least to ``tau``. None if there are fewer than MIN_SCENES scenes or ``tau`` is None.
    by_chance : float or None
        Median τ to expect if the condition had no effect, found by drawing both bins of each scene from all its
        sequences. None if there are too few scenes or if this cannot be computed.
    p_value : float or None
        Probability, 0 to 1, of a τ as low as ``tau`` if the condition had no effect. It is not corrected for
        comparisons of other pairs.
    most_moved : tuple of (str, int, int)
        Method whose rank differs most, with its rank under the first and under the second bin.
    """

    condition: str
    first: str
    second: str
    methods: int
    scenes: int
    shared: int
    tau: float | None
    low: float | None
    high: float | None
    by_chance: float | None
    p_value: float | None
    most_moved: tuple[str, int, int]


def compare_rankings(records: Iterable[Record]) -> list[RankAgreement]:
    """Return the agreement of the rankings under each pair of bins of a condition.

    Conditions with a single bin, and pairs of bins with fewer than MIN_METHODS methods in common, are left out.

    Parameters
    ----------
    records : iterable of Record
        Records as merge_records returns them.

    Returns
    -------
    list of RankAgreement
        One for each pair of bins of each of CONDITIONS; empty if methods have no sequence of known success in common.
    """
    by_method = group_by(records, "who.method")
    outcomes = collect_outcomes(by_method)
    if not outcomes.scenes:
        return []
    regions = {method: group[0].who.region for method, group in by_method.items()}
    found = []
    for axis in CONDITIONS:
        for (first, one), (second, other) in combinations(_split(outcomes, axis, regions=regions), 2):
            if len(set(one.methods) & set(other.methods)) >= MIN_METHODS:
                found.append(_compare(one, other, condition=axis.name, first=first, second=second))
    return found


def kendall_tau(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return Kendall's τ-b between the corresponding rows of two tables of scores.

    Parameters
    ----------
    first, second : ndarray of float, shape (R, M)
        Scores of M methods in R rankings; scores that differ by at most 1e-9 are ties.

    Returns
    -------
    ndarray of float, shape (R,)
        τ-b of each row, −1 to 1; NaN if all scores of the row are equal in one of the tables.
    """
    pairs = np.triu_indices(first.shape[1], 1)
    one, other = (_sign(table[:, pairs[0]] - table[:, pairs[1]]) for table in (first, second))
    both = np.sqrt(np.abs(one).sum(axis=1, dtype=float) * np.abs(other).sum(axis=1, dtype=float))
    return np.divide((one * other).sum(axis=1, dtype=float), both, out=np.full(len(one), np.nan), where=both > 0)


def _sign(differences: np.ndarray) -> np.ndarray:
    return (differences > _TIE).astype(np.int8) - (differences < -_TIE).astype(np.int8)


def _split(outcomes: Outcomes, axis: Axis, *, regions: Mapping[str, str]) -> list[tuple[str, Outcomes]]:
    """Return the outcomes under at most MAX_BINS bins of a condition; ``regions`` gives the region of each method."""
    if axis is REGION:
        methods_by_region = {region: [m for m in outcomes.methods if regions[m] == region] for region in REGIONS}
        return [
            (region, outcomes.select({name: name.removesuffix(f"@{region}") for name in methods}))
            for region, methods in methods_by_region.items()
            if methods
        ]
    bins = group_by_bin(outcomes.sequences, axis)
    same = {name: name for name in outcomes.methods}
    return [
        (name, outcomes.select(same, [axis.bin_of(record) == name for record in outcomes.sequences]))
        for name in largest_bins({name: len(members) for name, members in bins.items()}, MAX_BINS)
    ]


def _compare(one: Outcomes, other: Outcomes, *, condition: str, first: str, second: str) -> RankAgreement:
    methods = [name for name in one.methods if name in other.methods]
    one, other = (side.select({name: name for name in methods}) for side in (one, other))
    scenes = sorted({*one.scenes, *other.scenes})
    tables = np.full((2, len(scenes), len(methods)), np.nan)
    for table, side in zip(tables, (one, other), strict=True):
        table[[scenes.index(scene) for scene in side.scenes]] = side.average_by_scene(side.success).T
    shared = len(set(one.scenes) & set(other.scenes))
    found = compare_tables(tables, methods, names=(condition, first, second), shared=shared)
    if found.tau is None or len(scenes) < MIN_SCENES:
        return found
    without = _draw_taus_by_chance(one, other, scenes=scenes)
    if not without.size:
        return found
    p_value = ((without <= found.tau + _TIE).sum() + 1) / (without.size + 1)
    return replace(found, by_chance=float(np.median(without)), p_value=float(p_value))


def compare_tables(
    tables: np.ndarray, methods: Sequence[str], *, names: tuple[str, str, str], shared: int
) -> RankAgreement:
    """Return the agreement of two tables of scores, (2, S, M); ``by_chance`` and ``p_value`` are None.

    The interval is computed only if there are at least MIN_SCENES scenes.
    """
    means = np.nanmean(tables, axis=1)
    ranks = 1 + (means[:, None, :] > means[:, :, None] + _TIE).sum(axis=2)
    largest_move = int(np.abs(ranks[0] - ranks[1]).argmax())
    tau = float(kendall_tau(*means[:, None])[0])
    drawn = _draw_taus(tables) if tables.shape[1] >= MIN_SCENES and not np.isnan(tau) else np.empty(0)
    tail = (1 - CONFIDENCE) / 2
    # Noise in ranks draws τ towards 0, and samples contain it twice: with many methods, τ itself is often larger than
    # nearly all τ of samples. That is no evidence against τ, so the interval reaches at least to it.
    low = min(float(np.quantile(drawn, tail)), tau) if drawn.size else None
    high = max(float(np.quantile(drawn, 1 - tail)), tau) if drawn.size else None
    return RankAgreement(
        *names,
        len(methods),
        tables.shape[1],
        shared,
        None if np.isnan(tau) else tau,
        low,
        high,
        None,
        None,
        (methods[largest_move], int(ranks[0, largest_move]), int(ranks[1, largest_move])),
    )


def _draw_taus(tables: np.ndarray) -> np.ndarray:
    """Return τ of up to RESAMPLES bootstrap samples of the scenes; samples in which τ is undefined are left out.

    ``tables`` holds success rates (2, S, M), NaN if a scene has no sequences in a bin. The random stream is
    ("statistics", "agreement", S).
    """
    scenes = tables.shape[1]
    random = make_generator("statistics", "agreement", scenes)
    draws = random.multinomial(scenes, np.full(scenes, 1 / scenes), size=RESAMPLES).astype(float)
    known = ~np.isnan(tables[:, :, 0])
    means = []
    for table, is_known in zip(np.nan_to_num(tables), known, strict=True):
        total = (draws @ is_known)[:, None]
        means.append(np.divide(draws @ table, total, out=np.full((RESAMPLES, table.shape[1]), np.nan), where=total > 0))
    taus = kendall_tau(*means)
    return np.asarray(taus[~np.isnan(taus)])


def _draw_taus_by_chance(one: Outcomes, other: Outcomes, *, scenes: Sequence[str]) -> np.ndarray:
    """Return τ of samples in which both bins of each scene are drawn from all its sequences, whatever their bin.

    Each bin of a scene keeps its number of sequences, drawn with replacement. Each scene with sequences in only one
    bin is also replaced by a random one of these scenes. The random stream is ("statistics", "mixed", sequences).
    """
    solved = np.concatenate([one.success, other.success], axis=1).astype(float)
    scene = np.array([scenes.index(side.scenes[n]) for side in (one, other) for n in side.scene_of])
    order = np.argsort(scene, kind="stable")
    solved, weights = solved[:, order], np.concatenate([one.weights, other.weights])[order]
    is_first, scene = (order < len(one.sequences)), scene[order]
    counts = np.bincount(scene)
    starts = np.cumsum(counts) - counts
    in_first = np.bincount(scene, is_first) / counts
    one_bin_scenes = np.flatnonzero((in_first == 0) | (in_first == 1))
    random = make_generator("statistics", "mixed", len(scene))
    times = int(np.clip(_MAX_NUMBERS // len(scene), 50, RESAMPLES))
    means = []
    for scene_of in (scene[is_first], scene[~is_first]):
        source = np.tile(np.arange(len(scenes)), (times, 1))
        if one_bin_scenes.size:
            source[:, one_bin_scenes] = random.choice(one_bin_scenes, (times, len(one_bin_scenes)))
        at = source[:, scene_of]
        at = starts[at] + (random.random(at.shape) * counts[at]).astype(np.intp)
        total = weights[at] @ np.eye(len(scenes))[scene_of]
        parts = weights[at] / (total[:, scene_of] * len(np.unique(scene_of)))
        indices = (np.arange(times)[:, None] * len(scene) + at).ravel()
        means.append(np.bincount(indices, parts.ravel(), times * len(scene)).reshape(times, -1) @ solved.T)
    taus = kendall_tau(*means)
    return np.asarray(taus[~np.isnan(taus)])
