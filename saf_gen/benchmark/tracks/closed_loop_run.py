"""The run of a method on a running camera, and how it is judged.

The lens starts at the same position for all methods on a sequence, drawn with its seed. A search that commands the lens
then moves it itself. A search that estimates on a recording is given a sweep: the lens goes to the nearer end of its
travel, then towards the other end until the last window that the search looks at, and back to the answer. The run is
judged by the final position of the lens.
"""

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from saf_gen.benchmark.admission import run_method
from saf_gen.benchmark.judgement import SUCCESS_LIMITS_DOF, judged_dof
from saf_gen.benchmark.method_spec import Method
from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol
from saf_gen.benchmark.view.captured import Captured
from saf_gen.benchmark.view.clock import clock_of
from saf_gen.benchmark.view.restricted_view import BudgetSpentError
from saf_gen.benchmark.view.running_camera import RunningCamera, SweepView
from saf_gen.core import seeds
from saf_gen.parts import Answer, commands
from saf_gen.stream.metadata import Truth

SETTLE_TOLERANCE = 1e-4
"""Distance from its last position, as a fraction of the travel, within which the lens counts as settled."""
ARRIVAL_TOLERANCE_DOF = 0.25
"""Distance from its last position, in depths of focus, within which the lens counts as arrived."""
DEFAULT_DEPTH_OF_FOCUS = 0.01
"""Depth of focus, as a fraction of the travel, that is assumed for ARRIVAL_TOLERANCE_DOF if it is unknown."""


@dataclass(frozen=True, eq=False)
class ClosedLoopRun:
    """The result of a method on a running camera.

    Attributes
    ----------
    answer : Answer
        Answer of the method.
    problem : str
        Why the method failed, or ''.
    answer_frame : int
        Frame at which the method was done.
    path : ndarray of float64, shape (n,)
        True lens position at each frame up to the end, as fractions of the travel.
    budget : int
        Budget in frames.
    windows : int
        Number of windows that the method scored or looked at.
    seconds : float
        Computing time of the method, in seconds.
    commanded_positions : tuple of float
        Initial position of the lens, followed by every position to which it was sent.
    operations : float
        Operations that the method declares, of all windows that it scored or looked at.
    """

    answer: Answer
    problem: str
    answer_frame: int
    path: np.ndarray
    budget: int
    windows: int
    seconds: float
    commanded_positions: tuple[float, ...] = ()
    operations: float = 0.0


def start_camera(
    captured: Captured,
    measure: Callable[..., float] | None,
    *,
    protocol: ClosedLoopProtocol,
    start: float | None = None,
) -> RunningCamera:
    """Return a camera before its first frame, with the lens at ``start``.

    By default, that is the start position of all methods on this sequence, which its seed draws. Raises BadInput if the
    protocol does not suit the recording.
    """
    capture = captured.capture
    if start is None:
        start = float(seeds.make_generator(capture.seed, "closed loop", "start").uniform(0, 1))
    return RunningCamera(
        captured,
        measure,
        actuator=protocol.actuator,
        start=start,
        seed=seeds.derive_seed(capture.seed, "closed loop", "lens"),
        budget=protocol.count_frames(capture)[0],
        clock=clock_of(capture),
        operations_per_s=protocol.operations_per_s,
    )


def finish_run(
    camera: RunningCamera, answer: Answer, *, to: float | None, budget: int, problem: str = ""
) -> ClosedLoopRun:
    """Let the lens settle at ``to`` (unless that is None), and return the run of a method that is done.

    If the focal stacks could not be read, the error of the camera is raised even if the method caught it.
    """
    if camera.stack_error is not None:
        raise camera.stack_error
    answer_frame = camera.now
    if to is not None:
        camera.move(to)
        with suppress(BudgetSpentError):  # the lens is then judged by its position at the end of the budget
            camera.settle(SETTLE_TOLERANCE)
    return ClosedLoopRun(
        answer=answer,
        problem=problem,
        answer_frame=answer_frame,
        path=camera.path[: camera.now].copy(),
        budget=budget,
        windows=camera.scorer.windows,
        seconds=camera.scorer.seconds,
        commanded_positions=tuple(camera.commanded_positions),
        operations=camera.scorer.operations,
    )


def explain_spent_budget(budget: int) -> str:
    """Return the reason for failure of a method that spent its budget, in frames, without an answer."""
    return f"the budget of {budget} frames was spent"


def run_closed_loop(
    captured: Captured, method: Method, *, protocol: ClosedLoopProtocol, start: float | None = None
) -> ClosedLoopRun:
    """Let a method search for the focus, and return the run, whatever the method raises or answers.

    ``captured`` may come from an earlier run, whose frames are reused as long as they are the same. ``start`` is that
    of :func:`start_camera`. Raises BadInput if the protocol does not suit the recording, and the error of the focal
    stacks if they cannot be read.
    """
    budget, sweep = protocol.count_frames(captured.capture)
    camera = start_camera(captured, None if method.guest else method.measure, protocol=protocol, start=start)
    try:
        if commands(method.search):
            answer, to, problem = _run_commanding_search(camera, method)
        else:
            answer, to, problem = _run_estimating_search(camera, method, sweep=sweep)
    except BudgetSpentError:
        return finish_run(camera, Answer(), to=None, budget=budget, problem=explain_spent_budget(budget))
    return finish_run(camera, answer, to=to, budget=budget, problem=problem)


def _run_commanding_search(camera: RunningCamera, method: Method) -> tuple[Answer, float | None, str]:
    """Run a search that moves the lens itself; return its answer, the final lens command, and the problem or ''."""
    answer, problem = run_method(method, camera, scorer=camera.scorer)
    return answer, _clip_to_travel(answer.position), problem


def _run_estimating_search(camera: RunningCamera, method: Method, *, sweep: int) -> tuple[Answer, float | None, str]:
    """Run a search on a sweep of ``sweep`` frames; return its answer, the final lens command, and the problem or ''."""
    begin, end = (0.0, 1.0) if camera.commanded_positions[0] < 0.5 else (1.0, 0.0)
    camera.move(begin)
    camera.settle()
    view = SweepView(camera, begin=begin, end=end, frames=sweep)
    answer, problem = run_method(method, view, scorer=camera.scorer)
    camera.commanded_trajectory = None
    if answer.frame is None:
        return answer, None, problem
    if not -0.5 <= answer.frame <= view.frames - 0.5:
        return Answer(), None, f"answered frame {answer.frame}, which is not in the sweep"
    return answer, _clip_to_travel(view.position_at(answer.frame)), ""


def _clip_to_travel(position: float | None) -> float | None:
    """Return a position clipped to 0...1, because a noisy position sensor may read a little outside the travel."""
    return None if position is None else min(max(float(position), 0.0), 1.0)


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
