"""The run of a method on a running camera.

The lens starts at the same position for all methods on a sequence, drawn with its seed. A search that commands the lens
then moves it itself. A search that estimates on a recording is given a sweep: the lens goes to the nearer end of its
travel, then towards the other end until the last window that the search looks at, and back to the answer. A drive with
hysteresis goes back to where the sweep began and on to the answer, because it takes the same positions only from there.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress

from saf_gen.benchmark.admission import run_method
from saf_gen.benchmark.judgement import Run
from saf_gen.benchmark.method_spec import Method
from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol
from saf_gen.benchmark.view.captured import Captured
from saf_gen.benchmark.view.clock import clock_of
from saf_gen.benchmark.view.restricted_view import BudgetSpentError
from saf_gen.benchmark.view.running_camera import REST_TOLERANCE, RunningCamera, SweepView
from saf_gen.core import seeds
from saf_gen.parts import Answer, commands

SETTLE_TOLERANCE = 1e-4
"""Distance from its last position, as a fraction of the travel, within which the lens counts as settled."""


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


def finish_run(camera: RunningCamera, answer: Answer, *, to: Sequence[float], problem: str = "") -> Run:
    """Let the lens go to each position of ``to`` in turn, settle at the last, and return the run of a method.

    If the focal stacks could not be read, the error of the camera is raised even if the method caught it.
    """
    if camera.stack_error is not None:
        raise camera.stack_error
    answer_frame = camera.now
    with suppress(BudgetSpentError):  # the lens is then judged by its position at the end of the budget
        for number, position in enumerate(to, start=1):
            camera.move(position)
            camera.settle(SETTLE_TOLERANCE if number == len(to) else REST_TOLERANCE)
    return Run(
        answer,
        problem,
        camera.path[: camera.now].copy(),
        frames_seen=answer_frame,
        windows=camera.scorer.windows,
        seconds=camera.scorer.seconds,
        operations=camera.scorer.operations if camera.scorer.windows else None,
        commands=tuple(camera.commanded_positions),
    )


def explain_spent_budget(budget: int) -> str:
    """Return the reason for failure of a method that spent its budget, in frames, without an answer."""
    return f"the budget of {budget} frames was spent"


def run_closed_loop(
    captured: Captured, method: Method, *, protocol: ClosedLoopProtocol, start: float | None = None
) -> Run:
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
            answer, to, problem = _run_estimating_search(camera, method, protocol=protocol, sweep=sweep)
    except BudgetSpentError:
        return finish_run(camera, Answer(), to=(), problem=explain_spent_budget(budget))
    return finish_run(camera, answer, to=to, problem=problem)


def _run_commanding_search(camera: RunningCamera, method: Method) -> tuple[Answer, tuple[float, ...], str]:
    """Run a search that moves the lens itself; return its answer, the last lens commands, and the problem or ''."""
    answer, problem = run_method(method, camera, scorer=camera.scorer)
    return answer, () if answer.position is None else (_clip_to_travel(answer.position),), problem


def _run_estimating_search(
    camera: RunningCamera, method: Method, *, protocol: ClosedLoopProtocol, sweep: int
) -> tuple[Answer, tuple[float, ...], str]:
    """Run a search on a sweep of ``sweep`` frames; return its answer, the last lens commands, and the problem or ''."""
    begin, end = (0.0, 1.0) if camera.commanded_positions[0] < 0.5 else (1.0, 0.0)
    camera.move(begin)
    camera.settle()
    view = SweepView(camera, begin=begin, end=end, frames=sweep)
    answer, problem = run_method(method, view, scorer=camera.scorer)
    camera.commanded_trajectory = None
    if answer.frame is None:
        return answer, (), problem
    if not -0.5 <= answer.frame <= view.frames - 0.5:
        return Answer(), (), f"answered frame {answer.frame}, which is not in the sweep"
    to = _clip_to_travel(view.position_at(answer.frame))
    return answer, (begin, to) if protocol.actuator.hysteresis else (to,), ""


def _clip_to_travel(position: float) -> float:
    """Return a position clipped to 0...1, because a noisy position sensor may read a little outside the travel."""
    return min(max(float(position), 0.0), 1.0)
