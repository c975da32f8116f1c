"""Where the focus of a sequence lies and whether the lens comes to it, whatever a method answers."""

import math
from dataclasses import replace

import numpy as np

from saf_gen.benchmark.judgement import SUCCESS_LIMITS_DOF, find_judged_focus_crossing, judged_depth_of_focus
from saf_gen.stream.metadata import Truth

REACH_LIMIT_DOF = SUCCESS_LIMITS_DOF[1]
"""Depths of focus within which the lens counts as having come to the focus: there an answer can be right."""


def judge_when_focus_is_met(truth: Truth, focus_position: np.ndarray | None) -> tuple[float | None, float | None]:
    """Return when the lens of a recording first meets the focus, and how near it comes at all.

    When: a fraction of the recording, 0...1. A lens that comes near without crossing the focus meets it where
    it is nearest; one that stays farther away than REACH_LIMIT_DOF does not meet it (None).

    How near: the least distance over all readouts ``focus_position`` (T,), in depths of focus; it decides whether an
    abstention is right (:func:`saf_gen.benchmark.judgement.judge_method_answer`). None means unknown.
    """
    best = _find_best_focus(truth)
    lens = np.asarray([] if focus_position is None else focus_position, dtype=np.float64)
    if best is None or not lens.size or not np.isfinite(lens).all():
        return None, None
    away = lens - best
    least = _to_depths_of_focus(float(np.abs(away).min()), truth)
    if least is not None and least > REACH_LIMIT_DOF:
        return None, least
    frame = find_judged_focus_crossing(None, away=away, truth_frame=truth.frame)
    if frame is None and least is not None:
        frame = float(np.abs(away).argmin())
    return None if frame is None else min(max((frame + 0.5) / lens.size, 0.0), 1.0), least


def judge_where_focus_lies(truth: Truth) -> tuple[float | None, float | None]:
    """Return where in the travel, 0...1, the focus lies, and how many depths of focus beyond its ends.

    This is for a lens that may go anywhere. In a moving scene the position is ``truth.position`` and the distance the
    smallest at any time. None means unknown, or out of reach.
    """
    best = _find_best_focus(truth)
    if best is None:
        return None, None
    least = _to_depths_of_focus(float(np.maximum(0.0, np.maximum(-best, best - 1)).min()), truth)
    reached = least is not None and least <= REACH_LIMIT_DOF
    return min(max(truth.position, 0.0), 1.0) if reached else None, least


def truncate_truth_to_judge(truth: Truth, frames: int) -> Truth:
    """Return the truth of a recording's first ``frames``.

    In a moving scene whose focus the recorded lens met later, the position is that of the last of these frames.
    """
    if truth.track is None or frames >= len(truth.track):
        return truth
    track = truth.track[:frames]
    return replace(truth, track=track, position=truth.position if truth.frame < frames else float(track[-1]))


def _find_best_focus(truth: Truth) -> np.ndarray | None:
    """Return the best focus, (T,) or (1,), or None unless it is known in every frame."""
    best = np.atleast_1d(np.float64(truth.position) if truth.track is None else truth.track)
    return best if math.isfinite(truth.position) and best.size and np.isfinite(best).all() else None


def _to_depths_of_focus(distance: float, truth: Truth) -> float | None:
    dof = judged_depth_of_focus(truth.depth_of_focus)
    return 0.0 if distance == 0 else None if dof is None else distance / dof
