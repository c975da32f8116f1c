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
from saf_gen.core.plain_text import plural

T = TypeVar("T")
RecordValue = Callable[[Record], float | None]
RULE = "answerable_1dof"
"""The name of the rule by which methods are ranked: that of its column in files."""
FALSE_ABSTENTION_COST = 0.5
"""Cost of no answer where there is one; that of a wrong answer and of a failure is 1."""


def right_within(success: str = "success_1dof") -> RecordValue:
    """Return a function of a record: whether it answered within a limit, None if the recording has no answer.

    ``success`` is the name of the record's success within this limit.
    """

    def value(record: Record) -> float | None:
        return float(record.status == "answered" and getattr(record, success) is True) if record.answerable else None

    return value


def error_cost(record: Record) -> float | None:
    """Return the cost of a record: 1 for a wrong answer or a failure, FALSE_ABSTENTION_COST for a false abstention.

    An answer where there is none is wrong. The cost is None if the truth is unknown.
    """
    if record.answerable is None:
        return None
    if record.status == "abstained":
        return FALSE_ABSTENTION_COST if record.answerable else 0.0
    return 1 - (right_within()(record) or 0.0)


def describe_size(records: Iterable[Record]) -> str:
    """Return the number of sequences and, if some have no answer, of those that have one, as text."""
    known = {r.sequence: r.answerable for r in records}
    with_answer = f", {sum(map(bool, known.values()))} of them with an answer" if False in known.values() else ""
    return plural(len(known), "sequence") + with_answer


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
    """Outcomes of M methods on the N sequences, in S scenes, that have an answer and whose success is known for all.

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
        Whether the answer is within one depth of focus.
    errors : ndarray of float, shape (M, N)
        Absolute error of the answer in depths of focus; NaN if there is no error.
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
        values = {name: getattr(self, name)[rows][:, kept] for name in ("success", "errors", "times")}
        return _weigh(tuple(methods.values()), judged, **values)

    def answers_within(self, limit_dof: float) -> np.ndarray:
        """Return which answers are within ``limit_dof`` depths of focus, bool (M, N); ``success`` at a limit of 1."""
        with np.errstate(invalid="ignore"):
            return np.asarray(self.errors <= limit_dof)

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

    Sequences that have no answer, and those for which the success of one of these methods is unknown, are left out.
    Every method must have a record of every sequence (see merge_records).
    """
    is_right = right_within()
    known = {name: group for name, group in by_method.items() if any(r.answerable for r in group)}
    unknown = {r.sequence for group in known.values() for r in group if r.success_1dof is None}
    first = next(iter(known.values()), ())
    judged = [record for record in first if record.answerable and record.sequence not in unknown]
    columns = {record.sequence: number for number, record in enumerate(judged)}
    success = np.zeros((len(known), len(judged)), dtype=bool)
    errors, times = np.full((2, len(known), len(judged)), np.nan)
    for row, group in enumerate(known.values()):
        for record in group:
            if (column := columns.get(record.sequence)) is not None:
                success[row, column] = is_right(record)
                if record.error_dof is not None:
                    errors[row, column] = abs(record.error_dof)
                if record.time_to_focus_s is not None:
                    times[row, column] = record.time_to_focus_s
    return _weigh(tuple(known), judged, success=success, errors=errors, times=times)


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
