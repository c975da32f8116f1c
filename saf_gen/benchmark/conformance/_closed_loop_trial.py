"""Methods on a running camera before the small scene. Imports what reads focal stacks: import it late."""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from saf_gen.benchmark.conformance._answer_checks import check_answer
from saf_gen.benchmark.conformance._check_result import CheckFailure
from saf_gen.benchmark.conformance._check_runner import CheckLimits, LimitExceededError, describe_crash
from saf_gen.benchmark.conformance._test_scene import OVEREXPOSURE, make_test_scene
from saf_gen.benchmark.method_spec import Method
from saf_gen.benchmark.tracks.closed_loop_run import ClosedLoopRun, run_closed_loop_method
from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol
from saf_gen.benchmark.view.running_camera import BudgetSpentError
from saf_gen.optics.actuators import Actuator, get_actuator
from saf_gen.parts import Search, View, commands
from saf_gen.stack.capture import Capture
from saf_gen.stack.charge_source import ChargeSource
from saf_gen.stack.focal_stack import FocalStack, StackSpec
from saf_gen.stack.time_resolved import PlaneSource
from saf_gen.stream.stream_file import Truth

__all__ = ["BUDGET_FRAMES", "LIGHT_FACTORS", "describe_run", "run_on_test_scene"]

BUDGET_FRAMES = 40_000  # two seconds
LIGHT_FACTORS = {"a usual light": 1.0, "no light": 0.0, "50 times too much": OVEREXPOSURE}
"""Factors on the light that the exposure is made for."""


@dataclass(frozen=True)
class LimitedMeasure:
    """A measure in a unit of its own, asked no more than a number of times; like it in all else."""

    measure: Any
    unit: float
    limits: CheckLimits
    asked: list[int]

    def __call__(self, counts: np.ndarray, **more: int) -> float:
        self.asked[0] += 1
        if self.asked[0] > self.limits.scores:
            raise LimitExceededError(f"did not end within {self.limits.scores:,} scores")
        return self.unit * self.measure(counts, **more)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.measure, name)


@dataclass(frozen=True)
class CheckedSearch:
    """A search that says where it failed: the contest keeps only why."""

    search: Search
    camera: str

    def __call__(self, view: View) -> Any:
        try:
            answer = self.search(view)
        except BudgetSpentError as error:
            raise CheckFailure(
                f"it runs over the budget, with {self.camera}",
                "compare view.now with view.frames before each wait and score; answer with the best so far",
            ) from error
        except Exception as error:
            raise CheckFailure(
                f"{describe_crash(error)}, with {self.camera}",
                "no camera may make it raise: move to 0 ... 1 alone, abstain where there is nothing to see",
            ) from error
        return check_answer(answer, commanding=commands(self.search))

    def __getattr__(self, name: str) -> Any:
        return getattr(self.search, name)


def run_on_test_scene(
    method: Method,
    actuator: Actuator | str,
    limits: CheckLimits,
    *,
    best: float,
    light: float = 1.0,
    frames: int = BUDGET_FRAMES,
    unit: float = 1.0,
    seed: int = 1,
) -> ClosedLoopRun:
    """The method on a running camera whose best focus is at ``best``, judged for what any answer must keep.

    ``light`` multiplies the light, ``unit`` the scores; ``frames`` is the budget, and ``seed`` names the
    noise and where the lens stands at first. Raises CheckFailure where the contest would count the run as
    failed.
    """
    take, exposed = _take(best, light, seed)
    moved = get_actuator(actuator) if isinstance(actuator, str) else actuator
    camera = f"{moved.name} and {frames:,} frames"
    watched = replace(
        method,
        measure=LimitedMeasure(method.measure, unit, limits, [0]),
        search=CheckedSearch(method.search, camera),
    )
    protocol = ClosedLoopProtocol(moved, budget_s=frames / take.sensor.readout_hz)
    region = slice(0, take.sensor.rows), slice(0, take.sensor.columns)
    run = run_closed_loop_method(
        take, watched, protocol=protocol, charge_source=exposed, region=region, threads=1
    )
    if run.problem:
        raise CheckFailure(f"{run.problem}, with {camera}", "answer with a frame of the sweep, or none")
    if commands(method.search):
        _check_place(run)
    return run


def describe_run(run: ClosedLoopRun) -> str:
    """Where the lens was at the end, and when the method had its answer."""
    return f"{run.path[-1]:.3f} after {run.answer_frame:,} of {run.budget:,} frames"


def _check_place(run: ClosedLoopRun) -> None:
    place = run.answer.position
    if place is None:
        return
    if not 0 <= place <= 1:
        raise CheckFailure(
            f"it answers place {place:g}", "the travel is 0 to 1: cut what a noisy sensor reads"
        )
    if not run.windows:
        raise CheckFailure("it answers without a look", 'abstain without one: Answer(note="no time to look")')


@lru_cache(maxsize=8)
def _take(best: float, light: float, seed: int) -> tuple[Capture, ChargeSource]:
    scene = make_test_scene(best)
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
    take = Capture(
        PlaneSource.from_stack(stack),
        scene.sensor,
        gain,
        scene.exposure,
        seed,
        1,
        Truth(position=best),
        len(gain),
    )
    return take, take.open_charge_source()
