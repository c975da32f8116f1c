"""Where the focus of a sequence lies, and whether the lens comes to it: whatever a method answers."""

import math
from dataclasses import replace

import numpy as np

from saf_gen.benchmark.judgement import SUCCESS_LIMITS_DOF, depth_of_focus, find_nearest_focus_crossing
from saf_gen.stream.metadata import Truth

__all__ = ["locate_focus_in_recording", "locate_focus_in_travel", "truncate_truth"]

REACH_LIMIT_DOF = SUCCESS_LIMITS_DOF[1]
"""Depths of focus: the lens comes to the focus where it comes as near, and there an answer can be right."""


def locate_focus_in_recording(
    truth: Truth, focus_position: np.ndarray | None
) -> tuple[float | None, float | None]:
    """The share of a recording, 0...1, at which the lens first meets the focus, and how near it comes.

    How near, in depths of focus: the least distance of all readouts ``focus_position`` (T,), by which an
    abstention is right or not (:func:`saf_gen.benchmark.judgement.judge`). A lens that comes near and never
    passes the
    focus meets it where it is nearest; one that stays away by more than REACH_LIMIT_DOF does not, and has no
    share. None is unknown, or not there.
    """
    best = _best(truth)
    lens = np.asarray([] if focus_position is None else focus_position, dtype=np.float64)
    if best is None or not lens.size or not np.isfinite(lens).all():
        return None, None
    away = lens - best
    least = _in_dof(float(np.abs(away).min()), truth)
    if least is not None and least > REACH_LIMIT_DOF:
        return None, least
    frame = find_nearest_focus_crossing(None, away=away, truth_frame=truth.frame)
    if frame is None and least is not None:
        frame = float(np.abs(away).argmin())
    return None if frame is None else min(max((frame + 0.5) / lens.size, 0.0), 1.0), least


def locate_focus_in_travel(truth: Truth) -> tuple[float | None, float | None]:
    """The same for a lens that may go anywhere: where in the travel, and how far beyond its ends.

    Where the scene moves, the place is ``truth.position``, and how far the least of all times.
    """
    best = _best(truth)
    if best is None:
        return None, None
    least = _in_dof(float(np.maximum(0.0, np.maximum(-best, best - 1)).min()), truth)
    place = None if least is None or least > REACH_LIMIT_DOF else min(max(truth.position, 0.0), 1.0)
    return place, least


def truncate_truth(truth: Truth, frames: int) -> Truth:
    """The truth of a recording's first ``frames``.

    Where the scene moves and the recorded lens met the focus later, the position is that of the last of them.
    """
    if truth.track is None or frames >= len(truth.track):
        return truth
    track = truth.track[:frames]
    return replace(truth, track=track, position=truth.position if truth.frame < frames else float(track[-1]))


def _best(truth: Truth) -> np.ndarray | None:
    """The best focus, (T,) or (1,); None where it is unknown, or not known in every frame."""
    best = np.atleast_1d(np.float64(truth.position) if truth.track is None else truth.track)
    return best if math.isfinite(truth.position) and best.size and np.isfinite(best).all() else None


def _in_dof(distance: float, truth: Truth) -> float | None:
    dof = depth_of_focus(truth.depth_of_focus)
    return 0.0 if distance == 0 else None if dof is None else distance / dof
