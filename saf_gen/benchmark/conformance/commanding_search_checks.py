"""Checks of a search that commands the lens: it stays in travel and budget with every actuator.

The measure is ``sd``, unless the search names other measures. The runs of methods on a running camera in front of the
test scene are here, too. Import this module late, because it loads the reader of OpenEXR files.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from typing import Any

import numpy as np

from saf_gen.benchmark.conformance._check_runner import (
    STATE_HINT,
    UNIT_HINT,
    Check,
    CheckFailure,
    CheckLimits,
    CheckWarning,
    check_answer,
    check_docs,
    check_same_answers,
    describe_crash,
)
from saf_gen.benchmark.conformance._samples import BEST_FOCUS, OVEREXPOSURE, SyntheticRecording, make_scene
from saf_gen.benchmark.conformance.estimating_search_checks import UNIT, check_statements
from saf_gen.benchmark.judgement import Run
from saf_gen.benchmark.method_spec import Method
from saf_gen.benchmark.tracks.closed_loop_run import run_closed_loop
from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol
from saf_gen.benchmark.view.captured import CapturedReadouts
from saf_gen.benchmark.view.restricted_view import BudgetSpentError
from saf_gen.core.user_code import user_code
from saf_gen.errors import BadInput
from saf_gen.optics.actuators import actuator_names, get_actuator
from saf_gen.parts import Search, View, commands
from saf_gen.plugins.measures import get_measure
from saf_gen.stack.capture import Capture
from saf_gen.stack.focal_stack import FocalStack, StackSpec
from saf_gen.stack.light import SceneLight
from saf_gen.stack.time_resolved import PlaneSource
from saf_gen.stream.metadata import Truth

BUDGET_FRAMES = 40_000  # two seconds
STEADY = "voice_coil_hall"  # its sensor sees the lens, and it rings little
SMALL_BUDGETS = 32, 64, 160, 1000, 3000
BEST_POSITIONS = 0.0, 0.4, 1.0
TOLERANCE = 0.1  # fraction of the travel
LIGHT_FACTORS = {"a usual light": 1.0, "no light": 0.0, "50 times too much": OVEREXPOSURE}
"""Factors relative to the light for which the exposure is set."""
Runner = Callable[..., Run]
"""Runs one method by run_on_scene, given the name of an actuator and the conditions."""


@dataclass(frozen=True)
class LimitedMeasure:
    """A measure that multiplies its scores by ``unit`` and may be called only a limited number of times."""

    measure: Any
    unit: float
    limits: CheckLimits
    calls: list[int] = field(default_factory=lambda: [0])

    def __call__(self, counts: np.ndarray, **more: int) -> float:
        self.calls[0] += 1
        self.limits.check_scores(self.calls[0])
        return self.unit * self.measure(counts, **more)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.measure, name)


@dataclass(frozen=True)
class CheckedSearch:
    """A search that turns an exception into a CheckFailure, which names the camera and the line of the exception."""

    search: Search
    camera: str

    def __call__(self, view: View) -> Any:
        try:
            with user_code():
                answer = self.search(view)
        except BudgetSpentError as error:
            raise CheckFailure(
                f"it exceeds the budget, with {self.camera}",
                "compare view.now with view.frames before each wait and score; answer with the best so far",
            ) from error
        except Exception as error:  # a third-party search may raise anything
            raise CheckFailure(
                f"{describe_crash(error)}, with {self.camera}",
                "it must not raise with any camera: move only to 0 ... 1, and abstain if there is nothing to see",
            ) from error
        return check_answer(answer, commanding=commands(self.search))

    def __getattr__(self, name: str) -> Any:
        return getattr(self.search, name)


def run_on_scene(
    method: Method,
    actuator: str,
    *,
    limits: CheckLimits,
    best: float = BEST_FOCUS,
    light: float = 1.0,
    frames: int = BUDGET_FRAMES,
    unit: float = 1.0,
    seed: int = 1,
) -> Run:
    """Run a method on a running camera in front of the test scene, and check that its answer is valid.

    Parameters
    ----------
    method : Method
        The method.
    actuator : str
        Name of the actuator that moves the lens.
    limits : CheckLimits
        Limits after which the method is stopped.
    best : float, optional
        Position of best focus, as a fraction of the travel.
    light : float, optional
        Factor by which the light is multiplied.
    frames : int, optional
        Budget in frames.
    unit : float, optional
        Factor by which scores are multiplied.
    seed : int, optional
        Determines the noise and the initial position of the lens.

    Returns
    -------
    Run
        The run.

    Raises
    ------
    CheckFailure
        If the benchmark would count the run as failed, or if the answer of a search that commands the lens is outside
        the travel or was given without a score.
    """
    capture, lit = _make_capture(best, light, seed=seed)
    camera = f"{actuator} and {frames:,} frames"
    checked = replace(
        method, measure=LimitedMeasure(method.measure, unit, limits), search=CheckedSearch(method.search, camera)
    )
    protocol = ClosedLoopProtocol(get_actuator(actuator), budget_s=frames / capture.sensor.readout_hz)
    region = slice(0, capture.sensor.rows), slice(0, capture.sensor.columns)
    captured = CapturedReadouts(capture, lit, region=region, threads=1)
    run = run_closed_loop(captured, checked, protocol=protocol)
    if run.problem:
        raise CheckFailure(f"{run.problem}, with {camera}", "answer with a frame of the sweep, or abstain")
    if commands(method.search):
        _check_position(run)
    return run


def run_twice(run: Runner, actuator: str, *, light: float = 1.0, condition: str = "") -> Run:
    """Run a method twice and return the first run; raise CheckFailure if the two runs differ."""
    first, again = (run(actuator, light=light) for _ in range(2))
    if first.answer != again.answer or not np.array_equal(first.path, again.path):
        raise CheckFailure(
            f"{condition}the same camera gets another answer: {again.answer}, not {first.answer}", STATE_HINT
        )
    return first


def describe_run(run: Run) -> str:
    """Return the last position of the lens and the frame at which the method was done, in words."""
    return f"{run.path[-1]:.3f} after {run.frames_seen:,} of {BUDGET_FRAMES:,} frames"


def _check_position(run: Run) -> None:
    position = run.answer.position
    if position is None:
        return
    if not 0 <= position <= 1:
        raise CheckFailure(f"it answers position {position:g}", "the travel is 0 to 1: clip readings of a noisy sensor")
    if not run.windows:
        raise CheckFailure("it answers without a score", 'abstain if there is no score: Answer(note="no time")')


@lru_cache(maxsize=8)
def _make_capture(best: float, light: float, *, seed: int) -> tuple[Capture, SceneLight]:
    scene = make_scene(best)
    _, positions, rows, columns = scene.radiance.shape
    spec = StackSpec(
        scene="conformance",
        scene_digest="",
        groups=("lamp",),
        drive=scene.drive,
        rows=rows,
        columns=columns,
        pitch_m=scene.sensor.pitch_m,
        positions=positions,
        samples=1,
        max_depth=1,
    )
    depth = np.asarray(scene.drive.focus_depth(best), np.float32)
    stack = FocalStack(
        spec, scene.radiance, np.broadcast_to(depth, (rows, columns)), np.ones((rows, columns), bool), "none"
    )
    gain = np.full((BUDGET_FRAMES, 1), light, np.float32)
    capture = Capture(
        PlaneSource.from_stack(stack), scene.sensor, gain, scene.exposure, seed, 1, Truth(position=best), len(gain)
    )
    return capture, capture.open_light()


def commanding_checks(search: Search, limits: CheckLimits) -> dict[str, Check]:
    """Return the checks of a search that commands the lens, by name."""
    run = partial(run_on_scene, Method("sd+search", get_measure("sd"), search, code=""), limits=limits)
    return {
        "described": partial(check_docs, search),
        "stated": partial(check_statements, search),
        "not on a recording": partial(_check_refuses_recording, search, limits),
        "stays in travel and budget": partial(_check_actuators, run),
        "little time": partial(_check_small_budgets, run),
        "lights": partial(_check_lights, run),
        "repeatable": partial(_check_repeatable, run),
        "any unit": partial(_check_any_unit, run),
        "finds the focus": partial(_check_finds_focus, run),
    }


def _check_refuses_recording(search: Search, limits: CheckLimits) -> str:
    """Check that the search does not catch the error that it gets for moving the lens of a recording."""
    try:
        answer = search(SyntheticRecording(np.ones(2000), limits=limits))
    except BadInput as refusal:
        return f"refused: {refusal.problem}"
    raise CheckFailure(
        f"on a recording, whose lens cannot be moved, it answers {answer}",
        "move the lens before the first score, and do not catch the BadInput of view.move",
    )


def _check_actuators(run: Runner) -> str:
    """Check that the search ends in time with every actuator of saf_gen, and answers with a position in the travel."""
    return "; ".join(f"{name}: {describe_run(run(name))}" for name in actuator_names())


def _check_small_budgets(run: Runner) -> str:
    """Check that the search ends within a budget that is too small."""
    answers = []
    for frames in SMALL_BUDGETS:
        position = run(STEADY, frames=frames).answer.position
        answers.append(f"{frames:,} frames: {'none' if position is None else f'{position:.3f}'}")
    return "; ".join(answers)


def _check_lights(run: Runner) -> str:
    """Check that the search ends in usual light, without light, and in light that saturates the sensor."""
    return "; ".join(f"{name}: {describe_run(run(STEADY, light=light))}" for name, light in LIGHT_FACTORS.items())


def _check_repeatable(run: Runner) -> str:
    """Check that the search moves the lens along the same path if it runs again on the same camera."""
    run_twice(run, STEADY)
    return "the same answer along the same path of the lens"


def _check_any_unit(run: Runner) -> str:
    """Check that the search gives the same answer for scores in another unit, because each measure has its own unit."""
    for best in (0.0, 0.7):
        plain, scaled = (run(STEADY, best=best, unit=unit).answer for unit in (1.0, UNIT))
        check_same_answers(plain, scaled, cause=f"scores times {UNIT:g} change the answer", hint=UNIT_HINT)
    return f"scores times {UNIT:g} give the same answer"


def _check_finds_focus(run: Runner) -> str:
    """Check that the search finds the focus of a natural texture, for several foci and initial lens positions."""
    found = []
    for seed, best in enumerate(BEST_POSITIONS):
        end = run(STEADY, best=best, seed=seed)
        found.append((best, end.answer.position, float(end.path[-1])))
    words = ", ".join(f"{best:g} → {'no answer' if at is None else f'{end:.3f}'}" for best, at, end in found)
    seen = f"best focus → final position, as fractions of the travel: {words}"
    if any(at is None or abs(end - best) > TOLERANCE for best, at, end in found):
        expected = f"an error within {TOLERANCE:g} is expected in {BUDGET_FRAMES / 20_000:g} s with {STEADY}"
        raise CheckWarning(seen, f"{expected}; wait until the lens rests, and score longer windows if they are noisy")
    return seen
