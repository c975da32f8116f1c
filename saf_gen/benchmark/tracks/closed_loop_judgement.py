"""How a run of the closed loop is judged: where the lens is at the end, against the truth of then."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from saf_gen.benchmark.judgement import SUCCESS_LIMITS_DOF, depth_of_focus
from saf_gen.benchmark.tracks.closed_loop_run import ClosedLoopRun
from saf_gen.stream.metadata import Truth

__all__ = ["count_reversals", "judge_closed_loop_run"]

ARRIVAL_TOLERANCE_DOF = 0.25  # depths of focus from its last place: there the lens is said to have arrived


def judge_closed_loop_run(run: ClosedLoopRun, truth: Truth, readout_hz: float) -> dict[str, Any]:
    """The fields of a record that the lens decides; None is unknown.

    Errors in travels, depths of focus and blur are of the last place of the lens against the truth of that
    moment. An abstention is right where no place of the travel is within the limit.
    ``time_to_focus_s``: until the lens was in its last place, within a quarter of the depth of focus.
    """
    path = run.path
    answered = not run.problem and (run.answer.position is not None or run.answer.frame is not None)
    last = len(path) - 1
    track = truth.track
    best = float(track[min(last, len(track) - 1)]) if track is not None and last >= 0 else truth.position
    best_known = math.isfinite(best)
    dof = depth_of_focus(truth.depth_of_focus)
    out: dict[str, Any] = {
        "truth": best if best_known else None,
        "lens_travel": float(np.abs(np.diff(path)).sum()),
        "reversals": count_reversals(run.commanded_positions),
        "status": "failed" if run.problem else "answered" if answered else "abstained",
    }
    success: tuple[bool | None, ...] = (None,) * len(SUCCESS_LIMITS_DOF)
    if run.problem:
        success = (False,) * len(SUCCESS_LIMITS_DOF) if best_known and dof is not None else success
    elif not answered:
        if best_known and dof is not None:
            away = max(0.0, -best, best - 1) / dof
            success = tuple(away > limit for limit in SUCCESS_LIMITS_DOF)
    else:
        place = float(path[-1])
        out["position"] = place
        near = ARRIVAL_TOLERANCE_DOF * dof if dof is not None else ARRIVAL_TOLERANCE_DOF * 0.01
        off = np.flatnonzero(np.abs(path[run.answer_frame :] - place) > near)
        arrived = run.answer_frame + (int(off[-1]) + 1 if off.size else 0)
        out["time_to_focus_s"] = arrived / readout_hz
        if best_known:
            out["error"] = place - best
            if dof is not None:
                out["error_dof"] = out["error"] / dof
                out["blur_px"] = 2 * abs(out["error_dof"])
                success = tuple(abs(out["error_dof"]) <= limit for limit in SUCCESS_LIMITS_DOF)
    out["success_half_dof"], out["success_1dof"], out["success_2dof"] = success
    return out


def count_reversals(places: Sequence[float]) -> int:
    """How often a lens that is sent to these places, in turn, is sent back the way it came."""
    ways = np.sign(np.diff(places))
    ways = ways[ways != 0]
    return int((ways[1:] != ways[:-1]).sum())
