"""The outcomes of all methods as arrays: what each did on each sequence, and how sequences weigh within their scene."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from saf_gen.benchmark.records import Record


@dataclass(frozen=True)
class Outcomes:
    """M methods on the N sequences, of S scenes, whose success is known for all of them.

    Attributes
    ----------
    methods, scenes : names.
    sequences : a record of each sequence, for what it says of the sequence.
    scene_of : int (N,), the number of each sequence's scene.
    weights : float (N,), the weight of each sequence within its scene: its lights weigh the same, and sum to 1.
    success : bool (M, N), within one depth of focus.
    errors : float (M, N), absolute error of the answers in depths of focus; NaN where there is none.
    abstained : bool (M, N), where the search said that it cannot tell.
    times : float (M, N), seconds to focus; NaN where they are not known.
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
        """Sequences of each scene: int (S,)."""
        return np.bincount(self.scene_of, minlength=len(self.scenes))

    def average_by_scene(self, values: np.ndarray) -> np.ndarray:
        """Return the weighted means of values of sequences (..., N) in each scene: float (..., S)."""
        weights = np.zeros((len(self.scene_of), len(self.scenes)))
        weights[np.arange(len(self.scene_of)), self.scene_of] = self.weights
        return np.asarray(values @ weights)

    def select(self, methods: Mapping[str, str], sequences: Sequence[bool] | None = None) -> "Outcomes":
        """Return the outcomes of some methods, named anew, on some of the sequences, which are weighed again."""
        rows = [self.methods.index(name) for name in methods]
        kept = np.ones(len(self.sequences), bool) if sequences is None else np.asarray(sequences, bool)
        judged = [record for record, is_kept in zip(self.sequences, kept, strict=True) if is_kept]
        values = {name: getattr(self, name)[rows][:, kept] for name in ("success", "errors", "abstained", "times")}
        return _weigh(tuple(methods.values()), judged, **values)

    def find_answers_within(self, limit_dof: float) -> np.ndarray:
        """Return which answers lie within this limit, or abstain where none could: bool (M, N), at 1 as ``success``."""
        off = np.array([np.nan if r.focus_off_dof is None else r.focus_off_dof for r in self.sequences])
        is_unreachable = np.where(np.isnan(off), self.success & (limit_dof <= 1), off > limit_dof)
        with np.errstate(invalid="ignore"):
            return np.asarray((self.errors <= limit_dof) | (self.abstained & is_unreachable))

    def find_wins(self) -> np.ndarray:
        """Return the fraction of each scene's sequences that method j solves and method k does not: float (M, M, S)."""
        wins = np.zeros((len(self.methods), len(self.methods), len(self.scenes)))
        for scene in range(len(self.scenes)):
            own = self.scene_of == scene
            solved = self.success[:, own].astype(np.float64)
            wins[:, :, scene] = (solved * self.weights[own]) @ (1 - solved).T
        return wins


def collect_outcomes_to_rank(by_method: Mapping[str, Sequence[Record]]) -> Outcomes:
    """Return the outcomes of the methods for which any success is known, scenes in the order of their names.

    Every method has a record of every sequence (see merge_leaderboard_records).
    """
    known = {name: own for name, own in by_method.items() if any(r.success_1dof is not None for r in own)}
    unknown = {r.sequence for own in known.values() for r in own if r.success_1dof is None}
    first = next(iter(known.values()), ())
    judged = [record for record in first if record.sequence not in unknown]
    columns = {record.sequence: number for number, record in enumerate(judged)}
    success = np.zeros((len(known), len(judged)), dtype=bool)
    abstained = np.zeros_like(success)
    errors, times = np.full((2, len(known), len(judged)), np.nan)
    for row, own in enumerate(known.values()):
        for record in own:
            if (column := columns.get(record.sequence)) is not None:
                success[row, column] = record.success_1dof
                abstained[row, column] = record.status == "abstained"
                if record.error_dof is not None:
                    errors[row, column] = abs(record.error_dof)
                if record.time_to_focus_s is not None:
                    times[row, column] = record.time_to_focus_s
    return _weigh(tuple(known), judged, success=success, errors=errors, abstained=abstained, times=times)


def _weigh(methods: tuple[str, ...], sequences: Sequence[Record], **values: np.ndarray) -> Outcomes:
    """Return the outcomes with the weights that these sequences have within their scenes."""
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
