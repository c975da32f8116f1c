"""The reach of the lens: is the target in focus well inside the travel, for every member of the family?"""

import math
from collections.abc import Iterator

import numpy as np

from saf_gen.checks._finding import Finding, error, ok, warning
from saf_gen.checks.trial import Trial
from saf_gen.checks.units import mistaken_unit
from saf_gen.errors import BadInput
from saf_gen.ranges import is_range

__all__ = ["check_family", "check_reach", "unseen"]

INSIDE = 0.1  # of the travel at either end
BLURRED = 4.0  # pixels: less at both ends of the travel, and there is nothing to search for
MEMBERS = 3


def unseen(trial: Trial, problem: BadInput) -> Finding:
    """The finding for a target that is out of sight or reach, with the unit that would explain it."""
    unit = mistaken_unit(trial)
    return error("reach", f"{problem}; {unit}" if unit else str(problem))


def check_reach(trial: Trial) -> Iterator[Finding]:
    """The truth within the travel, and how much of it is in focus."""
    truth, half = trial.truth, trial.half_depth
    low, high = trial.depth_of_focus
    ends = [
        float(np.sqrt(np.mean(trial.drive.blur_diameter(p, trial.depths) ** 2))) / trial.sensor.pitch_m
        for p in (0.0, 1.0)
    ]
    text = (
        f"in focus at {truth:.3f} of the travel, within a pixel from {low:.3f} to {high:.3f}; "
        f"blurred over {ends[0]:.0f} and {ends[1]:.0f} pixels at its ends"
    )
    if not INSIDE <= truth <= 1 - INSIDE:
        yield warning(
            "reach", f"{text}: widen {trial.drive.travel_key}, the focus lies at the end of the travel"
        )
    elif max(ends) < BLURRED:
        yield warning("reach", f"{text}: never much blurred, open the lens or widen {trial.drive.travel_key}")
    else:
        yield ok("reach", f"{text}; focus.positions: {_enough(half)} or more in recipes")


def _enough(half: float) -> int:
    """Rendered positions that are no farther apart than half the depth of focus; 2^n + 1, as recipes have."""
    return 2 ** math.ceil(math.log2(1 / half)) + 1


def check_family(trial: Trial) -> Iterator[Finding]:
    """A few drawn members of the family: each can be built, and its target is in reach."""
    scene = trial.scene
    if not any(is_range(value) for value in scene.card.params.values()):
        return
    found = []
    for n in range(MEMBERS):
        member = Trial(scene.drawn("check", n), trial.sensor, trial.variant)
        drawn = ", ".join(
            f"{k} {v}" for k, v in member.scene.params.items() if is_range(scene.card.params[k])
        )
        try:
            found.append(member.truth)
        except BadInput as problem:
            yield error("family", f"with {drawn}: {problem}; narrow the ranges of params")
            continue
        if not INSIDE / 2 <= member.truth <= 1 - INSIDE / 2:
            yield warning(
                "family",
                f"with {drawn} the focus lies at {member.truth:.3f} of the travel, almost at its end",
            )
    if found:
        yield ok("family", f"{len(found)} members drawn, in focus at {', '.join(f'{p:.3f}' for p in found)}")
