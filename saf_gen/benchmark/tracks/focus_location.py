"""Location of the focus of a sequence, and whether the lens reaches it, independent of any answer."""

import math
from dataclasses import replace

import numpy as np

from saf_gen.benchmark.judgement import SUCCESS_LIMITS_DOF, focus_crossing, judged_dof
from saf_gen.stream.metadata import Truth

REACH_LIMIT_DOF = SUCCESS_LIMITS_DOF[1]
"""Distance from the focus, in depths of focus, within which the lens has reached it, so that an answer can be right."""


def judge_crossing(truth: Truth, focus_position: np.ndarray | None) -> tuple[float | None, float | None]:
    """Return the time at which the lens of a recording first meets the focus, and its smallest distance from the focus.

    Parameters
    ----------
    truth : Truth
        Truth of the recording.
    focus_position : ndarray of float, shape (T,), or None
        Lens position at each readout, as fractions of the travel.

    Returns
    -------
    when : float or None
        Time of the first meeting, as a fraction of the recording, 0...1. A lens that comes near without crossing the
        focus meets it where it is nearest. None if the lens stays farther away than REACH_LIMIT_DOF, or if unknown.
    distance : float or None
        Smallest distance over all readouts, in depths of focus, by which
        :func:`saf_gen.benchmark.judgement.judge` judges abstentions. None if unknown.
    """
    best = _find_best_focus(truth)
    lens = np.asarray([] if focus_position is None else focus_position, dtype=np.float64)
    if best is None or not lens.size or not np.isfinite(lens).all():
        return None, None
    offset = lens - best
    min_distance = _to_depths_of_focus(float(np.abs(offset).min()), truth)
    if min_distance is not None and min_distance > REACH_LIMIT_DOF:
        return None, min_distance
    frame = focus_crossing(None, offset=offset, truth_frame=truth.frame)
    if frame is None and min_distance is not None:
        frame = float(np.abs(offset).argmin())
    return None if frame is None else min(max((frame + 0.5) / lens.size, 0.0), 1.0), min_distance


def judge_location(truth: Truth) -> tuple[float | None, float | None]:
    """Return the position of the focus in the travel, and its distance from the travel, if the lens may move freely.

    Parameters
    ----------
    truth : Truth
        Truth of the recording. In a moving scene the position is ``truth.position``.

    Returns
    -------
    position : float or None
        Fraction of the travel, clipped to 0...1. None if unknown, or if the distance exceeds REACH_LIMIT_DOF.
    distance : float or None
        Distance of the focus beyond the ends of the travel, in depths of focus; in a moving scene, the smallest
        distance at any time. None if unknown.
    """
    best = _find_best_focus(truth)
    if best is None:
        return None, None
    min_distance = _to_depths_of_focus(float(np.maximum(0.0, np.maximum(-best, best - 1)).min()), truth)
    reached = min_distance is not None and min_distance <= REACH_LIMIT_DOF
    return min(max(truth.position, 0.0), 1.0) if reached else None, min_distance


def truncate_truth(truth: Truth, frames: int) -> Truth:
    """Return the truth of the first ``frames`` frames of a recording.

    If the target moves and the recorded lens met the focus later, the position is the best focus in the last of these
    frames.
    """
    if truth.track is None or frames >= len(truth.track):
        return truth
    track = truth.track[:frames]
    return replace(truth, track=track, position=truth.position if truth.frame < frames else float(track[-1]))


def _find_best_focus(truth: Truth) -> np.ndarray | None:
    """Return the best focus, shape (T,) or (1,), or None if it is unknown in any frame."""
    best = np.atleast_1d(np.float64(truth.position) if truth.track is None else truth.track)
    return best if math.isfinite(truth.position) and best.size and np.isfinite(best).all() else None


def _to_depths_of_focus(distance: float, truth: Truth) -> float | None:
    dof = judged_dof(truth.depth_of_focus)
    return 0.0 if distance == 0 else None if dof is None else distance / dof
