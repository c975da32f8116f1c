"""Averages over scenes, and the outcomes of all methods on all sequences as arrays.

Every scene has the same weight, and so has every light within a scene.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, TypeVar

import numpy as np

from saf_gen.benchmark.records import Record

T = TypeVar("T")
RecordValue = Callable[[Record], float | None]


def group_by(items: Iterable[T], *names: str) -> dict[Any, list[T]]:
    """Return the items by the value of an attribute, or by the values of several, in order of appearance."""
    groups: dict[Any, list[T]] = {}
    for item in items:
        groups.setdefault(attrgetter(*names)(item), []).append(item)
    return groups


def mean_by_scene(records: Sequence[Record], value: RecordValue) -> dict[str, float]:
    """Return the mean value of each scene.

    Known values are averaged over the sequences of each light, then over the lights of the scene. A scene without any
    known value is left out.
    """
    scenes: dict[str, dict[str | None, list[float]]] = {}
    for record in records:
        if (number := value(record)) is not None:
            scenes.setdefault(record.scene, {}).setdefault(record.light, []).append(float(number))
    return {
        scene: float(np.mean([np.mean(numbers) for numbers in lights.values()])) for scene, lights in scenes.items()
    }


def mean_over_scenes(records: Sequence[Record], value: RecordValue) -> float | None:
    """Return the mean of the scene means of mean_by_scene, or None if every value is unknown."""
    scenes = mean_by_scene(records, value)
    return float(np.mean(list(scenes.values()))) if scenes else None


def median_magnitude(numbers: Iterable[float | None]) -> float | None:
    """Return the median of the known absolute values, or None if all values are unknown."""
    known = [abs(number) for number in numbers if number is not None]
    return float(np.median(known)) if known else None


@dataclass(frozen=True)
class Outcomes:
    """Outcomes of M methods on the N sequences, in S scenes, for which the success of every method is known.

    Attributes
    ----------
    methods, scenes : tuple of str
        Names.
    sequences : tuple of Record
        One record of each sequence, which describes the sequence.
    scene_of : ndarray of int, shape (N,)
        Number of the scene of each sequence.
    weights : ndarray of float, shape (N,)
        Weight of each sequence within its scene. The lights of a scene have equal weight, and the weights of a scene
        sum to 1.
    success : ndarray of bool, shape (M, N)
        Whether the answer is a success within one depth of focus.
    errors : ndarray of float, shape (M, N)
        Absolute error of the answer in depths of focus; NaN if there is no error.
    abstained : ndarray of bool, shape (M, N)
        Whether the search abstained.
    times : ndarray of float, shape (M, N)
        Time to focus in seconds; NaN if unknown.
    """

    methods: tuple[str, ...]
    scenes: tuple[str, ...]
    sequences: tuple[Record, ...]
    scene_of: np.ndarray
    weights: np.ndarray
    success: np.ndarray
    errors: np.ndarray
    abstained: np.ndarray
    times: np.ndarray

    @property
    def counts(self) -> np.ndarray:
        """Number of sequences in each scene, int (S,)."""
        return np.bincount(self.scene_of, minlength=len(self.scenes))

    def average_by_scene(self, values: np.ndarray) -> np.ndarray:
        """Return the weighted mean in each scene, float (..., S), of values by sequence (..., N)."""
        weights = np.zeros((len(self.scene_of), len(self.scenes)))
        weights[np.arange(len(self.scene_of)), self.scene_of] = self.weights
        return np.asarray(values @ weights)

    def select(self, methods: Mapping[str, str], sequences: Sequence[bool] | None = None) -> "Outcomes":
        """Return the outcomes of some methods on some sequences, with new weights.

        ``methods`` maps the name of each selected method to its new name; ``sequences`` flags the sequences to keep, by
        default all.
        """
        rows = [self.methods.index(name) for name in methods]
        kept = np.ones(len(self.sequences), bool) if sequences is None else np.asarray(sequences, bool)
        judged = [record for record, is_kept in zip(self.sequences, kept, strict=True) if is_kept]
        values = {name: getattr(self, name)[rows][:, kept] for name in ("success", "errors", "abstained", "times")}
        return _weigh(tuple(methods.values()), judged, **values)

    def answers_within(self, limit_dof: float) -> np.ndarray:
        """Return which answers are right within ``limit_dof`` depths of focus, bool (M, N).

        An answer is right if its error is at most the limit; an abstention is right if no answer could be that near.
        At a limit of 1, the result equals ``success``.
        """
        off = np.array([np.nan if r.focus_off_dof is None else r.focus_off_dof for r in self.sequences])
        is_unreachable = np.where(np.isnan(off), self.success & (limit_dof <= 1), off > limit_dof)
        with np.errstate(invalid="ignore"):
            return np.asarray((self.errors <= limit_dof) | (self.abstained & is_unreachable))

    def find_wins(self) -> np.ndarray:
        """Return the weighted fraction of sequences that method j solves and k does not, by scene, float (M, M, S)."""
        wins = np.zeros((len(self.methods), len(self.methods), len(self.scenes)))
        for scene in range(len(self.scenes)):
            in_scene = self.scene_of == scene
            solved = self.success[:, in_scene].astype(np.float64)
            wins[:, :, scene] = (solved * self.weights[in_scene]) @ (1 - solved).T
        return wins


def collect_outcomes(by_method: Mapping[str, Sequence[Record]]) -> Outcomes:
    """Return the outcomes of the methods for which any success is known, with scenes sorted by name.

    Sequences for which the success of one of these methods is unknown are left out. Every method must have a record of
    every sequence (see merge_records).
    """
    known = {name: group for name, group in by_method.items() if any(r.success_1dof is not None for r in group)}
    unknown = {r.sequence for group in known.values() for r in group if r.success_1dof is None}
    first = next(iter(known.values()), ())
    judged = [record for record in first if record.sequence not in unknown]
    columns = {record.sequence: number for number, record in enumerate(judged)}
    success = np.zeros((len(known), len(judged)), dtype=bool)
    abstained = np.zeros_like(success)
    errors, times = np.full((2, len(known), len(judged)), np.nan)
    for row, group in enumerate(known.values()):
        for record in group:
            if (column := columns.get(record.sequence)) is not None:
                success[row, column] = record.success_1dof
                abstained[row, column] = record.status == "abstained"
                if record.error_dof is not None:
                    errors[row, column] = abs(record.error_dof)
                if record.time_to_focus_s is not None:
                    times[row, column] = record.time_to_focus_s
    return _weigh(tuple(known), judged, success=success, errors=errors, abstained=abstained, times=times)


def _weigh(methods: tuple[str, ...], sequences: Sequence[Record], **values: np.ndarray) -> Outcomes:
    """Return the outcomes, with weights computed from these sequences."""
    scenes = sorted({record.scene for record in sequences})
    numbers = {scene: number for number, scene in enumerate(scenes)}
    of_light = Counter((record.scene, record.light) for record in sequences)
    lights = Counter(scene for scene, _ in of_light)
    return Outcomes(
        methods,
        tuple(scenes),
        tuple(sequences),
        np.array([numbers[r.scene] for r in sequences], dtype=np.intp),
        np.array([1 / (lights[r.scene] * of_light[r.scene, r.light]) for r in sequences]),
        **values,
    )
