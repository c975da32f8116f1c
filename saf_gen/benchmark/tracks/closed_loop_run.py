"""A method in the closed loop: it moves the lens of a running camera, and has a budget of time.

All methods of a sequence begin with the lens at the same place, drawn by the sequence's seed. A search that
commands the lens is on its own. One that estimates on a recording is given a sweep: the lens goes to the
nearer end of its travel, then to the other one, and back to where the search says; the sweep ends with the
last window that the search looks at. Judged is where the lens is at the end, against the truth of then.
"""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from saf_gen.benchmark.method_spec import Method
from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol
from saf_gen.benchmark.tracks.search_run import run_search
from saf_gen.benchmark.view.captured_frames import CapturedFrames
from saf_gen.benchmark.view.running_camera import BudgetSpentError, RunningCamera
from saf_gen.benchmark.view.sweep_view import SweepView
from saf_gen.core import seeds
from saf_gen.core.region import Region
from saf_gen.parts import Answer, commands
from saf_gen.stack.capture import Capture
from saf_gen.stack.charge_source import ChargeSource

__all__ = ["ClosedLoopRun", "describe_spent_budget", "finish_run", "run_closed_loop_method", "start_camera"]

SETTLE_TOLERANCE = 1e-4  # of the travel: then the lens is said to rest


@dataclass(frozen=True, eq=False)
class ClosedLoopRun:
    """What came of a method on a running camera.

    ``path`` (n,) is where the lens truly was, to the end; ``answer_frame`` the frame at which the method was
    done; ``budget`` in frames; ``problem`` why it failed, '' where it did not; ``commanded_positions`` the
    places to which the lens was sent, in turn, the first of them where it stood.
    """

    answer: Answer
    problem: str
    answer_frame: int
    path: np.ndarray
    budget: int
    windows: int
    seconds: float
    commanded_positions: tuple[float, ...] = ()


def start_camera(
    take: Capture,
    exposed: ChargeSource,
    region: Region,
    measure: Callable[..., float],
    protocol: ClosedLoopProtocol,
    *,
    threads: int | None = None,
) -> RunningCamera:
    """A camera that begins to run, its lens where all methods of the sequence begin.

    ``exposed`` is of the rows that ``region`` needs, for all methods. Raises BadInput for protocol that the
    recording cannot keep.
    """
    return RunningCamera(
        CapturedFrames(take, exposed, region, threads=threads),
        measure,
        protocol.actuator,
        start=float(seeds.make_generator(take.seed, "closed loop", "start").uniform(0, 1)),
        seed=seeds.derive_seed(take.seed, "closed loop", "lens"),
        budget=protocol.count_frames(take)[0],
        readout_hz=take.sensor.readout_hz,
    )


def finish_run(
    live: RunningCamera, answer: Answer, to: float | None, *, budget: int, problem: str = ""
) -> ClosedLoopRun:
    """The run of a method that is done: the lens goes to its last place, where it says one, and settles.

    Raises what the camera met where the stacks cannot be filmed, whatever the method made of it.
    """
    if live.stack_error is not None:
        raise live.stack_error
    answered = live.now
    if to is not None:
        live.move(to)
        with suppress(BudgetSpentError):  # the lens is judged where it is then
            live.settle(SETTLE_TOLERANCE)
    return ClosedLoopRun(
        answer,
        problem,
        answered,
        live.path[: live.now].copy(),
        budget,
        live.windows,
        live.seconds,
        tuple(live.commanded_positions),
    )


def describe_spent_budget(budget: int) -> str:
    """What is said of a method that had no answer when its time was over."""
    return f"the budget of {budget} frames was spent"


def run_closed_loop_method(
    take: Capture,
    exposed: ChargeSource,
    region: Region,
    method: Method,
    protocol: ClosedLoopProtocol,
    *,
    threads: int | None = None,
) -> ClosedLoopRun:
    """Let a method find the focus. ``exposed`` is of the rows that ``region`` needs, for all methods.

    Whatever the method raises or answers becomes a run. Raises BadInput for protocol that the recording
    cannot keep, and what the stacks raise where they cannot be read.
    """
    budget, sweep = protocol.count_frames(take)
    live = start_camera(take, exposed, region, method.measure, protocol, threads=threads)
    try:
        done = _commanded(live, method) if commands(method.search) else _swept(live, method, sweep)
    except BudgetSpentError:
        return finish_run(live, Answer(), None, budget=budget, problem=describe_spent_budget(budget))
    answer, to, problem = done
    return finish_run(live, answer, to, budget=budget, problem=problem)


def _commanded(live: RunningCamera, method: Method) -> tuple[Answer, float | None, str]:
    """The answer, where the lens goes then, and what is wrong with it."""
    answer, problem = run_search(method.search, live, scorer=live.scorer)
    return answer, _inside(answer.position), problem


def _swept(live: RunningCamera, method: Method, frames: int) -> tuple[Answer, float | None, str]:
    """The same, of a search that is given a sweep."""
    begin, end = (0.0, 1.0) if live.commanded_positions[0] < 0.5 else (1.0, 0.0)
    live.move(begin)
    live.settle()
    view = SweepView(live, begin, end, frames=frames)
    answer, problem = run_search(method.search, view, scorer=live.scorer)
    live.commanded_trajectory = None
    if answer.frame is None:
        return answer, None, problem
    if not -0.5 <= answer.frame <= view.frames - 0.5:
        return Answer(), None, f"answered frame {answer.frame}, which is not of the sweep"
    return answer, _inside(view.position_at(answer.frame)), ""


def _inside(place: float | None) -> float | None:
    """A place that the lens can be sent to: a noisy position sensor may read a little outside the travel."""
    return None if place is None else min(max(float(place), 0.0), 1.0)
