"""Checks of a search that commands the lens: it stays in travel and budget with every actuator.

The measure is ``sd``, unless the search names other measures.
"""

from functools import partial

import numpy as np

from saf_gen.benchmark.conformance._answer_checks import UNIT_HINT, check_same_answers
from saf_gen.benchmark.conformance._check_result import CheckFailure, CheckWarning
from saf_gen.benchmark.conformance._check_runner import Check, CheckLimits
from saf_gen.benchmark.conformance._checked_runs import (
    BUDGET_FRAMES,
    LIGHT_FACTORS,
    Runner,
    describe_run,
    run_on_scene,
    run_twice,
)
from saf_gen.benchmark.conformance._declaration_checks import check_docs
from saf_gen.benchmark.conformance._synthetic_recording import SyntheticRecording
from saf_gen.benchmark.conformance.estimating_search_checks import UNIT, check_statements
from saf_gen.benchmark.method_spec import Method
from saf_gen.errors import BadInput
from saf_gen.optics.actuators import actuator_names
from saf_gen.parts import Search
from saf_gen.plugins.measures import get_measure

STEADY = "voice_coil_hall"  # its sensor sees the lens, and it rings little
SMALL_BUDGETS = 32, 64, 160, 1000, 3000
BEST_POSITIONS = 0.0, 0.4, 1.0
TOLERANCE = 0.1  # fraction of the travel


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
