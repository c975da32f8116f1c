"""The reach of the lens: is the target in focus well inside the travel, for every member of the family?"""

import math
from collections.abc import Iterator

import numpy as np

from saf_gen.authoring.checks._scene_finding import SceneFinding, error, ok, warning
from saf_gen.authoring.checks.scene_under_test import SceneUnderTest
from saf_gen.authoring.checks.scene_units import suggest_unit
from saf_gen.core.config.ranges import is_range
from saf_gen.errors import BadInput

__all__ = ["check_family", "check_reach", "unseen_target_finding"]

INSIDE = 0.1  # of the travel at either end
BLURRED = 4.0  # pixels: less at both ends of the travel, and there is nothing to search for
MEMBERS = 3


def unseen_target_finding(subject: SceneUnderTest, problem: BadInput) -> SceneFinding:
    """The finding for a target that is out of sight or reach, with the unit that would explain it."""
    unit = suggest_unit(subject)
    return error("reach", f"{problem}; {unit}" if unit else str(problem))


def check_reach(subject: SceneUnderTest) -> Iterator[SceneFinding]:
    """The truth within the travel, and how much of it is in focus."""
    truth, half = subject.true_focus, subject.half_depth_of_focus
    low, high = subject.depth_of_focus
    ends = [
        float(np.sqrt(np.mean(subject.drive.blur_diameter(p, subject.target_depths_m) ** 2)))
        / subject.sensor.pitch_m
        for p in (0.0, 1.0)
    ]
    text = (
        f"in focus at {truth:.3f} of the travel, within a pixel from {low:.3f} to {high:.3f}; "
        f"blurred over {ends[0]:.0f} and {ends[1]:.0f} pixels at its ends"
    )
    if not INSIDE <= truth <= 1 - INSIDE:
        yield warning(
            "reach", f"{text}: widen {subject.drive.travel_key}, the focus lies at the end of the travel"
        )
    elif max(ends) < BLURRED:
        yield warning(
            "reach", f"{text}: never much blurred, open the lens or widen {subject.drive.travel_key}"
        )
    else:
        yield ok("reach", f"{text}; focus.positions: {_enough(half)} or more in recipes")


def _enough(half: float) -> int:
    """Rendered positions that are no farther apart than half the depth of focus; 2^n + 1, as recipes have."""
    return 2 ** math.ceil(math.log2(1 / half)) + 1


def check_family(subject: SceneUnderTest) -> Iterator[SceneFinding]:
    """A few drawn members of the family: each can be built, and its target is in reach."""
    scene = subject.scene
    if not any(is_range(value) for value in scene.card.params.values()):
        return
    found = []
    for n in range(MEMBERS):
        member = SceneUnderTest(scene.draw_member("check", n), subject.sensor, subject.backend)
        drawn = ", ".join(
            f"{k} {v}" for k, v in member.scene.params.items() if is_range(scene.card.params[k])
        )
        try:
            found.append(member.true_focus)
        except BadInput as problem:
            yield error("family", f"with {drawn}: {problem}; narrow the ranges of params")
            continue
        if not INSIDE / 2 <= member.true_focus <= 1 - INSIDE / 2:
            yield warning(
                "family",
                f"with {drawn} the focus lies at {member.true_focus:.3f} of the travel, almost at its end",
            )
    if found:
        yield ok("family", f"{len(found)} members drawn, in focus at {', '.join(f'{p:.3f}' for p in found)}")
