"""Reach of the lens: is the target in focus well inside the travel, for every member of the family?"""

import math
from collections.abc import Iterator

import numpy as np

from saf_gen.authoring.checks._scene_finding import SceneFinding, scene_check_error, scene_check_ok, scene_check_warning
from saf_gen.authoring.checks.scene_under_test import SceneUnderTest
from saf_gen.authoring.checks.scene_units import suggest_unit
from saf_gen.core.config.ranges import is_range
from saf_gen.errors import BadInput

MARGIN = 0.1  # of the travel, at either end
MIN_BLUR = 4.0  # pixels; with less blur at both ends of the travel, a search has nothing to find
MEMBERS = 3


def out_of_reach(subject: SceneUnderTest, problem: BadInput) -> SceneFinding:
    """Return the finding for a target out of sight or reach, with advice on a wrong unit if that explains it."""
    unit = suggest_unit(subject)
    return scene_check_error("reach", f"{problem}; {unit}" if unit else str(problem))


def check_reach(subject: SceneUnderTest) -> Iterator[SceneFinding]:
    """Check where in the travel the target is in focus, and how much it is blurred at the ends of the travel."""
    truth, half = subject.true_focus, subject.half_depth_of_focus
    low, high = subject.depth_of_focus
    ends = [
        float(np.sqrt(np.mean(subject.drive.blur_diameter(p, subject.target_depths_m) ** 2))) / subject.sensor.pitch_m
        for p in (0.0, 1.0)
    ]
    text = (
        f"in focus at {truth:.3f} of the travel, depth of focus {low:.3f} to {high:.3f}; "
        f"blurred over {ends[0]:.0f} and {ends[1]:.0f} pixels at the ends of the travel"
    )
    if not MARGIN <= truth <= 1 - MARGIN:
        yield scene_check_warning(
            "reach", f"{text}: the focus is near an end of the travel, widen {subject.drive.travel_key}"
        )
    elif max(ends) < MIN_BLUR:
        yield scene_check_warning(
            "reach", f"{text}: the blur is too small, open the lens or widen {subject.drive.travel_key}"
        )
    else:
        positions = 2 ** math.ceil(math.log2(1 / half)) + 1  # spaced by at most half the depth of focus
        yield scene_check_ok("reach", f"{text}; recipes need focus.positions: {positions} or more")


def check_family(subject: SceneUnderTest) -> Iterator[SceneFinding]:
    """Check that a few random members of the family can be built, with a target that the lens can focus."""
    scene = subject.scene
    if not any(is_range(value) for value in scene.card.params.values()):
        return
    found = []
    for n in range(MEMBERS):
        member = SceneUnderTest(scene.draw_member("check", n), subject.sensor, backend=subject.backend)
        drawn = ", ".join(f"{k} {v}" for k, v in member.scene.params.items() if is_range(scene.card.params[k]))
        try:
            found.append(member.true_focus)
        except BadInput as problem:
            yield scene_check_error("family", f"with {drawn}: {problem}; narrow the ranges of params")
            continue
        if not MARGIN / 2 <= member.true_focus <= 1 - MARGIN / 2:
            yield scene_check_warning(
                "family", f"with {drawn} the focus is at {member.true_focus:.3f} of the travel, close to its end"
            )
    if found:
        yield scene_check_ok(
            "family", f"{len(found)} members drawn, in focus at {', '.join(f'{p:.3f}' for p in found)}"
        )
