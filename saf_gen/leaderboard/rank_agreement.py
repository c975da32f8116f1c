"""How far the ranking of methods hangs on a condition: Kendall's τ of the rankings under two of its bins.

τ is 1 where both rankings order all methods alike, 0 where they have nothing in common, −1 where one is the reverse of
the other. Rankings from a few scenes differ by chance, even under conditions that change nothing; so τ stands beside
what chance alone would give.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from saf_gen.benchmark.records import Record
from saf_gen.core.region import REGIONS
from saf_gen.core.seeds import make_generator
from saf_gen.errors import unknown
from saf_gen.leaderboard.axes import AXES, Axis, group_by_leaderboard_bin
from saf_gen.leaderboard.outcomes import Outcomes, collect_outcomes_to_rank
from saf_gen.leaderboard.scene_intervals import CONFIDENCE, MIN_SCENES

RESAMPLES = 500
MAX_BINS = 6
"""Most bins of a condition that are compared with each other, those of most sequences."""
MIN_METHODS = 3
"""Fewest methods that a ranking is compared of."""
REGION = Axis(
    "region", "Region", "Where methods look: at the box round the target, or at the frame.", lambda r: r.region
)
CONDITIONS = (*(axis for axis in AXES if axis.name != "scene"), REGION)
"""The conditions under whose bins rankings are compared."""
_TIE = 1e-9
_MAX_NUMBERS = 1_000_000


@dataclass(frozen=True)
class RankAgreement:
    """The rankings of the same methods by success within 1 DoF under two bins of a condition.

    condition, first, second : the name of the condition, and its bins.
    methods, scenes, shared : how many methods, scenes under either bin, and scenes that have both.
    tau : Kendall's τ (b, which allows for ties), −1...1; None where all methods are equal under a bin.
    low, high : its 95 % interval of a bootstrap over scenes, which are drawn with both bins.
    by_chance : the median τ were the condition without effect: both bins of a scene are drawn from all its sequences.
    p_value : how often τ is then as low as it is, 0–1; of this pair alone.
    most_moved : the method whose rank differs most, with its ranks under both.
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


def compare_rankings(records: Iterable[Record], *, by: str | None = None) -> list[RankAgreement]:
    """Return the agreement of rankings for each pair of bins of each condition, or of the one that is named.

    Conditions with one bin, and pairs with fewer than MIN_METHODS methods in common, are left out. The records are
    those of merge_leaderboard_records.

    Raises BadInput where there is no such condition.
    """
    names = [axis.name for axis in CONDITIONS]
    if by is not None and by not in names:
        raise unknown("condition", by, allowed=names)
    by_method: dict[str, list[Record]] = {}
    for record in records:
        by_method.setdefault(record.method, []).append(record)
    outcomes = collect_outcomes_to_rank(by_method)
    regions = {method: own[0].region for method, own in by_method.items()}
    found = []
    for axis in CONDITIONS:
        if by in (None, axis.name):
            for (first, one), (second, other) in combinations(_split(outcomes, axis, regions=regions), 2):
                if len(set(one.methods) & set(other.methods)) >= MIN_METHODS:
                    found.append(_compare(one, other, condition=axis.name, first=first, second=second))
    return found


def name_regions_to_rank(records: Sequence[Record]) -> list[Record]:
    """Return the records with ``@REGION`` after the name of each method that has none, if regions differ.

    Evaluations of one dataset with another ``--region`` are then methods of one table.
    """
    named = tuple(f"@{region}" for region in REGIONS)
    if len({r.region for r in records if not r.method.endswith(named)}) < 2:
        return list(records)
    return [r if r.method.endswith(named) else replace(r, method=f"{r.method}@{r.region}") for r in records]


AGREEMENT_MEANINGS = {
    "condition": "What differs.",
    "first": "One bin of the condition.",
    "second": "The other.",
    "methods": "Methods that have answers under both.",
    "scenes": "Scenes under either.",
    "shared": "Scenes that have sequences under both.",
    "tau": "Kendall's τ-b of the rankings by success within 1 DoF; 1 is the same order.",
    "low": "Its 95 % interval, of a bootstrap over scenes.",
    "high": "Upper end of the interval.",
    "by_chance": "The median τ of as many scenes if the condition changed nothing.",
    "p_value": "How often τ would then be as low; of this pair alone.",
    "most_moved": "The method whose rank differs most, with its rank under both.",
}


def compute_ranking_tau(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return Kendall's τ-b of the rows of two tables, NaN where all of a row are equal: float (R, M) each -> (R,)."""
    pairs = np.triu_indices(first.shape[1], 1)
    one, other = (_sign(table[:, pairs[0]] - table[:, pairs[1]]) for table in (first, second))
    both = np.sqrt(np.abs(one).sum(axis=1, dtype=float) * np.abs(other).sum(axis=1, dtype=float))
    return np.divide((one * other).sum(axis=1, dtype=float), both, out=np.full(len(one), np.nan), where=both > 0)


def _sign(differences: np.ndarray) -> np.ndarray:
    return (differences > _TIE).astype(np.int8) - (differences < -_TIE).astype(np.int8)


def _split(outcomes: Outcomes, axis: Axis, *, regions: Mapping[str, str]) -> list[tuple[str, Outcomes]]:
    """Return the outcomes under each bin of a condition, at most MAX_BINS; ``regions`` are by method."""
    if axis is REGION:
        own = {region: [m for m in outcomes.methods if regions[m] == region] for region in REGIONS}
        return [
            (region, outcomes.select({name: name.removesuffix(f"@{region}") for name in methods}))
            for region, methods in own.items()
            if methods
        ]
    bins = group_by_leaderboard_bin(outcomes.sequences, axis)
    largest = sorted(bins, key=lambda name: -len(bins[name]))[:MAX_BINS]
    same = {name: name for name in outcomes.methods}
    return [
        (name, outcomes.select(same, [axis.bin_of(record) == name for record in outcomes.sequences]))
        for name in bins
        if name in largest
    ]


def compare_ranked_scores(
    first: tuple[str, Mapping[str, Mapping[str, float]]],
    second: tuple[str, Mapping[str, Mapping[str, float]]],
    *,
    condition: str,
) -> RankAgreement | None:
    """Return the agreement of two rankings of the same methods by scores of any two kinds, larger for better.

    Each ranking is its name, and the score of each method in each scene. Methods that either lacks are left out; a
    scene of one name stands in both rankings. None for fewer than MIN_METHODS methods. What chance alone would give is
    not known, because scores of two kinds cannot be exchanged.
    """
    scored = [scores for _, scores in (first, second)]
    common = [set.intersection(*map(set, own.values())) if own else set() for own in scored]
    methods = sorted(common[0] & common[1])
    if len(methods) < MIN_METHODS:
        return None
    scenes = sorted({*scored[0], *scored[1]})
    tables = np.full((2, len(scenes), len(methods)), np.nan)
    for table, own in zip(tables, scored, strict=True):
        for scene, scores in own.items():
            table[scenes.index(scene)] = [scores[method] for method in methods]
    fewest, shared = min(map(len, scored)), len(set(scored[0]) & set(scored[1]))
    return _summarise(tables, methods, names=(condition, first[0], second[0]), fewest=fewest, shared=shared)


def _compare(one: Outcomes, other: Outcomes, *, condition: str, first: str, second: str) -> RankAgreement:
    methods = [name for name in one.methods if name in other.methods]
    one, other = (own.select({name: name for name in methods}) for own in (one, other))
    scenes = sorted({*one.scenes, *other.scenes})
    tables = np.full((2, len(scenes), len(methods)), np.nan)
    for table, own in zip(tables, (one, other), strict=True):
        table[[scenes.index(scene) for scene in own.scenes]] = own.average_by_scene(own.success).T
    shared = len(set(one.scenes) & set(other.scenes))
    found = _summarise(tables, methods, names=(condition, first, second), fewest=len(scenes), shared=shared)
    if found.tau is None or len(scenes) < MIN_SCENES:
        return found
    without = _draw_taus_by_chance(one, other, scenes=scenes)
    if not without.size:
        return found
    p_value = ((without <= found.tau + _TIE).sum() + 1) / (without.size + 1)
    return replace(found, by_chance=float(np.median(without)), p_value=float(p_value))


def _summarise(
    tables: np.ndarray, methods: Sequence[str], *, names: tuple[str, str, str], fewest: int, shared: int
) -> RankAgreement:
    """Return the agreement of two tables of scores (2, S, M), without what chance would give.

    The interval is known where ``fewest`` scenes are MIN_SCENES.
    """
    means = np.nanmean(tables, axis=1)
    ranks = 1 + (means[:, None, :] > means[:, :, None] + _TIE).sum(axis=2)
    most = int(np.abs(ranks[0] - ranks[1]).argmax())
    tau = float(compute_ranking_tau(*means[:, None])[0])
    drawn = _draw_taus(tables) if fewest >= MIN_SCENES and not np.isnan(tau) else np.empty(0)
    tail = (1 - CONFIDENCE) / 2
    low, high = (float(np.quantile(drawn, level)) if drawn.size else None for level in (tail, 1 - tail))
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
        (methods[most], int(ranks[0, most]), int(ranks[1, most])),
    )


def _draw_taus(tables: np.ndarray) -> np.ndarray:
    """Return τ of RESAMPLES draws of as many scenes, from success rates (2, S, M), NaN where a scene lacks a bin.

    The random stream is ("statistics", "agreement", S).
    """
    scenes = tables.shape[1]
    random = make_generator("statistics", "agreement", scenes)
    draws = random.multinomial(scenes, np.full(scenes, 1 / scenes), size=RESAMPLES).astype(float)
    known = ~np.isnan(tables[:, :, 0])
    means = []
    for own, is_known in zip(np.nan_to_num(tables), known, strict=True):
        total = (draws @ is_known)[:, None]
        means.append(np.divide(draws @ own, total, out=np.full((RESAMPLES, own.shape[1]), np.nan), where=total > 0))
    taus = compute_ranking_tau(*means)
    return np.asarray(taus[~np.isnan(taus)])


def _draw_taus_by_chance(one: Outcomes, other: Outcomes, *, scenes: Sequence[str]) -> np.ndarray:
    """Return τ with both bins of each scene drawn from all its sequences, so that what the bins mean is lost.

    As many are drawn, with replacement, as were there. A scene of one bin alone is drawn from all of its like. The
    random stream is ("statistics", "mixed", sequences).
    """
    solved = np.concatenate([one.success, other.success], axis=1).astype(float)
    scene = np.array([scenes.index(own.scenes[n]) for own in (one, other) for n in own.scene_of])
    order = np.argsort(scene, kind="stable")
    solved, weights = solved[:, order], np.concatenate([one.weights, other.weights])[order]
    is_first, scene = (order < len(one.sequences)), scene[order]
    counts = np.bincount(scene)
    starts = np.cumsum(counts) - counts
    in_first = np.bincount(scene, is_first) / counts
    alone = np.flatnonzero((in_first == 0) | (in_first == 1))
    random = make_generator("statistics", "mixed", len(scene))
    times = int(np.clip(_MAX_NUMBERS // len(scene), 50, RESAMPLES))
    means = []
    for own in (scene[is_first], scene[~is_first]):
        source = np.tile(np.arange(len(scenes)), (times, 1))
        if alone.size:
            source[:, alone] = random.choice(alone, (times, len(alone)))
        at = source[:, own]
        at = starts[at] + (random.random(at.shape) * counts[at]).astype(np.intp)
        total = weights[at] @ np.eye(len(scenes))[own]
        parts = weights[at] / (total[:, own] * len(np.unique(own)))
        places = (np.arange(times)[:, None] * len(scene) + at).ravel()
        means.append(np.bincount(places, parts.ravel(), times * len(scene)).reshape(times, -1) @ solved.T)
    taus = compute_ranking_tau(*means)
    return np.asarray(taus[~np.isnan(taus)])
