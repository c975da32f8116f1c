"""Checks of a search that commands the lens: it ends within travel and budget, whatever moves the lens.

The measure is ``sd`` unless the search comes with one of its own.
"""

from functools import partial

import numpy as np

from saf_gen.benchmark.conformance._check_result import CheckFailure, CheckWarning
from saf_gen.benchmark.conformance._check_runner import Check, CheckLimits
from saf_gen.benchmark.conformance._closed_loop_trial import (
    BUDGET_FRAMES,
    LIGHT_FACTORS,
    describe_run,
    run_on_test_scene,
)
from saf_gen.benchmark.conformance._declaration_checks import described
from saf_gen.benchmark.conformance._synthetic_recording import SyntheticRecording
from saf_gen.benchmark.conformance.estimating_search_checks import UNIT, stated
from saf_gen.benchmark.method_spec import Method
from saf_gen.errors import BadInput
from saf_gen.measures import get_measure
from saf_gen.optics.actuators import actuator_names, get_actuator
from saf_gen.parts import Search

__all__ = ["commanding_checks"]

STEADY = "voice_coil_hall"  # its sensor sees the lens, it rings little
SCARCE = 32, 64, 160, 1000, 3000
PLACES = 0.0, 0.4, 1.0
TOLERANCE = 0.1  # of the travel


def commanding_checks(search: Search, limits: CheckLimits) -> dict[str, Check]:
    """The checks of one search, by name."""
    method = Method("sd+search", get_measure("sd"), search, code="")
    checks = (stays_in_travel_and_budget, little_time, lights, repeatable, any_unit, finds_the_focus)
    return {
        "described": partial(described, search),
        "stated": partial(stated, search),
        "not on a recording": partial(not_on_a_recording, search, limits),
        **{check.__name__.replace("_", " "): partial(check, method, limits) for check in checks},
    }


def not_on_a_recording(search: Search, limits: CheckLimits) -> str:
    """It hands on that the lens of a recording cannot be moved."""
    try:
        answer = search(SyntheticRecording(np.ones(2000), limits=limits))
    except BadInput as refusal:
        return f"refused: {refusal.problem}"
    raise CheckFailure(
        f"on a recording, whose lens cannot be moved, it answers {answer}",
        "move the lens before the first look, and let the BadInput of view.move pass",
    )


def stays_in_travel_and_budget(method: Method, limits: CheckLimits) -> str:
    """With every actuator that comes with saf_gen it ends in time, and answers with a place of the travel."""
    runs = [(name, run_on_test_scene(method, name, limits, best=0.4)) for name in actuator_names()]
    return "; ".join(f"{name}: {describe_run(run)}" for name, run in runs)


def little_time(method: Method, limits: CheckLimits) -> str:
    """It ends within a budget that is too small."""
    said = []
    for frames in SCARCE:
        place = run_on_test_scene(method, STEADY, limits, best=0.4, frames=frames).answer.position
        said.append(f"{frames:,} frames: {'none' if place is None else f'{place:.3f}'}")
    return "; ".join(said)


def lights(method: Method, limits: CheckLimits) -> str:
    """It ends without a spike, and with one at every readout."""
    said = []
    for name, light in LIGHT_FACTORS.items():
        said.append(
            f"{name}: {describe_run(run_on_test_scene(method, STEADY, limits, best=0.4, light=light))}"
        )
    return "; ".join(said)


def repeatable(method: Method, limits: CheckLimits) -> str:
    """The same way of the lens before the same camera."""
    first, again = (run_on_test_scene(method, STEADY, limits, best=0.4) for _ in range(2))
    if first.answer != again.answer or not np.array_equal(first.path, again.path):
        raise CheckFailure(
            f"the same camera gets another answer: {again.answer}, not {first.answer}",
            "draw nothing by chance, and keep nothing between calls",
        )
    return "the same answer, by the same way of the lens"


def any_unit(method: Method, limits: CheckLimits) -> str:
    """The same answer for scores in another unit: each measure has its own."""
    for best in (0.0, 0.7):
        plain, scaled = (
            run_on_test_scene(method, STEADY, limits, best=best, unit=unit) for unit in (1.0, UNIT)
        )
        if plain.answer != scaled.answer:
            raise CheckFailure(
                f"scores times {UNIT:g} change the answer: {scaled.answer}, not {plain.answer}",
                "the unit of the scores must not matter: compare them with each other, never with a number",
            )
    return f"scores times {UNIT:g} give the same answer"


def finds_the_focus(method: Method, limits: CheckLimits) -> str:
    """It finds the focus of a natural texture, wherever it is and wherever the lens stood."""
    found = []
    for seed, best in enumerate(PLACES):
        run = run_on_test_scene(method, get_actuator(STEADY), limits, best=best, seed=seed)
        found.append((best, run.answer.position, float(run.path[-1])))
    words = ", ".join(f"{best:g} as {'nothing' if at is None else f'{end:.3f}'}" for best, at, end in found)
    seen = f"the focus, shares of the travel: {words}"
    if any(at is None or abs(end - best) > TOLERANCE for best, at, end in found):
        expected = f"within {TOLERANCE:g} is what one expects in {BUDGET_FRAMES / 20_000:g} s with {STEADY}"
        raise CheckWarning(seen, f"{expected}; wait until the lens rests, and look longer where it is noisy")
    return seen
