"""A method in the closed loop: it moves the lens of a running camera within a budget of time.

On a sequence all methods begin with the lens at the same position, drawn by the sequence's seed. A search that commands
the lens then moves it itself. A search that estimates on a recording is given a sweep: the lens goes to the nearer end
of its travel, then to the other end, and back to where the search says; the sweep ends with the last window that the
search looks at. What counts is where the lens is at the end, against the truth at that moment.
"""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from saf_gen.benchmark.method_spec import Method
from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol
from saf_gen.benchmark.tracks.search_run import run_search_of_method
from saf_gen.benchmark.view.captured_frames import CapturedFrames
from saf_gen.benchmark.view.running_camera import BudgetSpentError, RunningCamera
from saf_gen.benchmark.view.sweep_view import SweepView
from saf_gen.core import seeds
from saf_gen.parts import Answer, commands

SETTLE_TOLERANCE = 1e-4
"""Fraction of the travel within which the lens counts as settled at its last position."""


@dataclass(frozen=True, eq=False)
class ClosedLoopRun:
    """What came of a method on a running camera.

    ``path`` (n,) is the true lens position up to the end; ``answer_frame`` the frame at which the method was
    done; ``budget`` is in frames; ``problem`` says why the method failed, '' where it did not;
    ``commanded_positions`` begins with where the lens stood, then has every position it was sent to.
    """

    answer: Answer
    problem: str
    answer_frame: int
    path: np.ndarray
    budget: int
    windows: int
    seconds: float
    commanded_positions: tuple[float, ...] = ()


def start_closed_loop_camera(
    captured: CapturedFrames, measure: Callable[..., float], *, protocol: ClosedLoopProtocol
) -> RunningCamera:
    """Return a camera before its first frame, with the lens where every method of this sequence begins.

    Raises BadInput for a protocol that the recording cannot keep.
    """
    capture = captured.capture
    return RunningCamera(
        captured,
        measure,
        actuator=protocol.actuator,
        start=float(seeds.make_generator(capture.seed, "closed loop", "start").uniform(0, 1)),
        seed=seeds.derive_seed(capture.seed, "closed loop", "lens"),
        budget=protocol.count_frames(capture)[0],
        readout_hz=capture.sensor.readout_hz,
    )


def finish_closed_loop_run(
    camera: RunningCamera, answer: Answer, *, to: float | None, budget: int, problem: str = ""
) -> ClosedLoopRun:
    """Return the run of a method that is done, after the lens has settled at ``to``, unless that is None.

    Raises what the camera met where the focal stacks could not be read, whatever the method made of it.
    """
    if camera.stack_error is not None:
        raise camera.stack_error
    answer_frame = camera.now
    if to is not None:
        camera.move(to)
        with suppress(BudgetSpentError):  # the lens is judged by where it is then
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
    )


def explain_spent_method_budget(budget: int) -> str:
    """Return why a method failed that had no answer when its budget, in frames, was spent."""
    return f"the budget of {budget} frames was spent"


def run_closed_loop_method(captured: CapturedFrames, method: Method, *, protocol: ClosedLoopProtocol) -> ClosedLoopRun:
    """Let a method find the focus; ``captured`` may be of another run, whose frames are kept where they are the same.

    Whatever the method raises or answers becomes a run. Raises BadInput for a protocol that the recording
    cannot keep, and what the focal stacks raise where they cannot be read.
    """
    budget, sweep = protocol.count_frames(captured.capture)
    camera = start_closed_loop_camera(captured, method.measure, protocol=protocol)
    try:
        if commands(method.search):
            answer, to, problem = _run_commanding_search(camera, method)
        else:
            answer, to, problem = _run_estimating_search(camera, method, sweep=sweep)
    except BudgetSpentError:
        return finish_closed_loop_run(
            camera, Answer(), to=None, budget=budget, problem=explain_spent_method_budget(budget)
        )
    return finish_closed_loop_run(camera, answer, to=to, budget=budget, problem=problem)


def _run_commanding_search(camera: RunningCamera, method: Method) -> tuple[Answer, float | None, str]:
    """Return the answer, where the lens goes then, and why the method failed."""
    answer, problem = run_search_of_method(method.search, camera, scorer=camera.scorer)
    return answer, _clip_to_travel(answer.position), problem


def _run_estimating_search(camera: RunningCamera, method: Method, *, sweep: int) -> tuple[Answer, float | None, str]:
    """Run a search on a sweep of ``sweep`` frames; return its answer, where the lens goes then, and any failure."""
    begin, end = (0.0, 1.0) if camera.commanded_positions[0] < 0.5 else (1.0, 0.0)
    camera.move(begin)
    camera.settle()
    view = SweepView(camera, begin=begin, end=end, frames=sweep)
    answer, problem = run_search_of_method(method.search, view, scorer=camera.scorer)
    camera.commanded_trajectory = None
    if answer.frame is None:
        return answer, None, problem
    if not -0.5 <= answer.frame <= view.frames - 0.5:
        return Answer(), None, f"answered frame {answer.frame}, which is not of the sweep"
    return answer, _clip_to_travel(view.position_at(answer.frame)), ""


def _clip_to_travel(position: float | None) -> float | None:
    """Clip a position to 0...1: a noisy position sensor may read a little outside the travel."""
    return None if position is None else min(max(float(position), 0.0), 1.0)
