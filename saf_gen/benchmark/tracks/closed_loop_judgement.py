"""Judgement of a closed-loop run: the position of the lens at the end is compared with the truth at that moment."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from saf_gen.benchmark.judgement import SUCCESS_LIMITS_DOF, judged_dof
from saf_gen.benchmark.tracks.closed_loop_run import ClosedLoopRun
from saf_gen.stream.metadata import Truth

ARRIVAL_TOLERANCE_DOF = 0.25
"""Distance from its last position, in depths of focus, within which the lens counts as arrived."""
DEFAULT_DEPTH_OF_FOCUS = 0.01
"""Depth of focus, as a fraction of the travel, that is assumed for ARRIVAL_TOLERANCE_DOF if it is unknown."""


def judge_run(run: ClosedLoopRun, truth: Truth, *, readout_hz: float) -> dict[str, Any]:
    """Return the fields of a record that depend on the lens; None means unknown.

    Errors (in travels and in depths of focus) and blur compare the last position of the lens with the truth at that
    moment. An abstention is a success if no position in the travel is within the limit. ``time_to_focus_s`` ends when
    the lens has arrived for good, that is, within a quarter of the depth of focus of its last position.
    """
    path = run.path
    answered = not run.problem and (run.answer.position is not None or run.answer.frame is not None)
    last = len(path) - 1
    track = truth.track
    best = float(track[min(last, len(track) - 1)]) if track is not None and last >= 0 else truth.position
    best_known = math.isfinite(best)
    dof = judged_dof(truth.depth_of_focus)
    fields: dict[str, Any] = {
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
            distance = max(0.0, -best, best - 1) / dof
            success = tuple(distance > limit for limit in SUCCESS_LIMITS_DOF)
    else:
        position = float(path[-1])
        fields["position"] = position
        near = ARRIVAL_TOLERANCE_DOF * (DEFAULT_DEPTH_OF_FOCUS if dof is None else dof)
        off = np.flatnonzero(np.abs(path[run.answer_frame :] - position) > near)
        arrived = run.answer_frame + (int(off[-1]) + 1 if off.size else 0)
        fields["time_to_focus_s"] = arrived / readout_hz
        if best_known:
            fields["error"] = position - best
            if dof is not None:
                fields["error_dof"] = fields["error"] / dof
                fields["blur_px"] = 2 * abs(fields["error_dof"])
                success = tuple(abs(fields["error_dof"]) <= limit for limit in SUCCESS_LIMITS_DOF)
    fields["success_half_dof"], fields["success_1dof"], fields["success_2dof"] = success
    return fields


def count_reversals(positions: Sequence[float]) -> int:
    """Return the number of times that a lens changes direction if it is sent to these positions in turn."""
    directions = np.sign(np.diff(positions))
    directions = directions[directions != 0]
    return int((directions[1:] != directions[:-1]).sum())
