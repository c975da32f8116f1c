"""What a chart of a recording draws: axis, truth, curves and answers."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from saf_gen.benchmark.method_spec import split_halves
from saf_gen.benchmark.records import Record
from saf_gen.benchmark.results import SweepSummary
from saf_gen.optics.focus_crossings import focus_crossings

PREDICTIONS_LABEL = "predictions"
"""Label in place of a search, for answers of another program."""
AnswersBySearch = Mapping[str, Mapping[str, float]]
"""Frame of each answer, by search, then by measure."""


def split_method(method: str) -> tuple[str, str]:
    """Return the measure and the search of a method with their options, or the name and '' for predictions."""
    measure, *search = split_halves(method)
    return measure, search[0] if search else ""


def position_axis(sweep: SweepSummary) -> np.ndarray | None:
    """Return the focus position (T,) if it can be the axis, because the lens never turns back or rests; else None."""
    lens = sweep.focus_position
    if lens is None or len(lens) < 2:
        return None
    moves = np.sign(float(lens[-1]) - float(lens[0])) * np.diff(lens)
    centres = np.interp(sweep.frames, np.arange(len(lens)), lens)
    steps = np.abs(np.diff(centres)) if centres.size > 1 else np.abs(moves)
    return lens if moves.min() >= 0 and moves.any() and steps.min() > 0.02 * steps.mean() else None


def frames_to_axis(sweep: SweepSummary) -> Callable[[np.ndarray], np.ndarray]:
    """Return the function that maps frames to the axis: the focus position if it can be the axis, else the frame."""
    lens = position_axis(sweep)
    if lens is None:
        return lambda frames: frames
    return lambda frames: np.interp(frames, np.arange(len(lens)), lens)


def frames_in_focus(sweep: SweepSummary, lens: np.ndarray) -> np.ndarray:
    """Return whether the lens is within the depth of focus in each frame, bool (T,); False if that is unknown."""
    offset = _focus_offset(sweep, lens)
    near, far = sorted(sweep.depth_of_focus)
    return np.asarray((offset >= near - sweep.truth) & (offset <= far - sweep.truth))


def find_runs(where: np.ndarray) -> list[tuple[int, int]]:
    """Return the first and the stop index of each run of True in ``where``, bool (T,)."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], where.astype(int), [0]))))
    return [(int(first), int(stop)) for first, stop in edges.reshape(-1, 2)]


def truth_crossings(sweep: SweepSummary, lens: np.ndarray) -> np.ndarray:
    """Return the frames at which the lens crosses the truth."""
    return focus_crossings(_focus_offset(sweep, lens), 0.0)


def _focus_offset(sweep: SweepSummary, lens: np.ndarray) -> np.ndarray:
    """Return lens minus truth in each frame, float64 (T,), as a fraction of the travel."""
    return np.asarray(np.asarray(lens, dtype=np.float64) - (sweep.truth if sweep.track is None else sweep.track))


def normalise(scores: np.ndarray) -> np.ndarray:
    """Return scores (B,) scaled to the range 0 to 1; constant scores become 0, and NaN stays NaN."""
    values = np.asarray(scores, dtype=np.float64)
    finite = values[np.isfinite(values)]
    if finite.size == 0 or finite.max() == finite.min():
        return np.where(np.isfinite(values), 0.0, np.nan)
    return np.asarray((values - finite.min()) / (finite.max() - finite.min()))


def group_answers(records: Sequence[Record], measures: Sequence[str]) -> dict[str, dict[str, float]]:
    """Return the frame of each answer of these measures, in the order of ``records``."""
    answers: dict[str, dict[str, float]] = {}
    for record in records:
        measure, search = split_method(record.method)
        if measure in measures and record.frame is not None:
            answers.setdefault(search, {})[measure] = record.frame
    return answers


def group_coincident(sweep: SweepSummary, measures: Sequence[str]) -> list[list[str]]:
    """Return groups of measures with the same curve, in the order of ``measures``."""
    drawn = {c.measure: normalise(c.scores) for c in sweep.curves}
    groups: list[list[str]] = []
    for measure in (name for name in measures if name in drawn):
        for group in groups:
            a, b = drawn[measure], drawn[group[0]]
            if a.shape == b.shape and np.allclose(a, b, atol=1e-3, equal_nan=True):
                group.append(measure)
                break
        else:
            groups.append([measure])
    return groups


def choose_answers(answers: AnswersBySearch, shown: Sequence[str], *, most: int) -> dict[str, dict[str, float]]:
    """Return the answers of the measures in ``shown``, of the first ``most`` searches that have any."""
    chosen = {s: {m: f for m, f in frames.items() if m in shown} for s, frames in answers.items()}
    return dict([(search, frames) for search, frames in chosen.items() if frames][:most])
