"""Comparison of sizes with distances, which reveals geometry that is in millimetres or inches by mistake."""

from collections.abc import Iterator

import numpy as np

from saf_gen.authoring.checks._scene_finding import SceneFinding, scene_check_ok, scene_check_warning
from saf_gen.authoring.checks.scene_under_test import SceneUnderTest

UNITS = {
    "millimetres": 1e-3,
    "centimetres": 1e-2,
    "inches": 0.0254,
    "feet": 0.3048,
    "metres": 1.0,
    "micrometres": 1e-6,
    "kilometres": 1e3,
}
MIN_PIXELS = 500  # of a target
MAX_FIELDS = 3.0  # half fields of view; a unit that puts the target farther off the axis is not suggested


def check_units(subject: SceneUnderTest) -> Iterator[SceneFinding]:
    """Check how large the target is, how far away it is, and how much of the frame it fills."""
    seen = subject.depth_and_target
    size = np.ptp(subject.renderer.bounds(*subject.scene.card.target), axis=0)
    text = (
        f"target {_lengths(size)}, {np.median(subject.target_depths_m):.4g} m away, "
        f"{seen.target.mean():.0%} of the frame; "
        f"the whole scene {_lengths(np.ptp(subject.renderer.bounds(), axis=0))}"
    )
    if seen.target.sum() < MIN_PIXELS:
        yield scene_check_warning(
            "units", f"{text}: {seen.target.sum()} pixels are too few to focus on, move the camera nearer"
        )
    else:
        yield scene_check_ok("units", text)


def suggest_unit(subject: SceneUnderTest) -> str:
    """Return advice to change the unit if that brings the target into the reach of the lens, else ''."""
    card = subject.scene.card
    box = subject.renderer.bounds(*card.target)
    if not box.size:
        return ""  # no shape has the target's name, so its size is unknown
    middle = box.mean(axis=0)
    origin = np.array(card.camera.origin_m)
    axis = np.array(card.camera.look_at_m) - origin
    axis /= np.linalg.norm(axis)
    near, far = subject.drive.focusing_range_m
    half = subject.sensor.columns * subject.sensor.pitch_m / 2 / float(subject.drive.image_distance(0.5))

    def fits(point: np.ndarray, camera: np.ndarray) -> bool:
        displacement = point - camera
        depth = float(displacement @ axis)
        offset = float(np.linalg.norm(displacement - depth * axis))
        return bool(near <= depth <= far and offset <= MAX_FIELDS * half * depth)

    for name, metres in UNITS.items():
        if metres == card.unit_m:
            continue
        if fits(middle * (metres / card.unit_m), origin):
            return f"if the geometry is in {name}, write unit_m: {metres:g} on the card"
        if fits(middle, origin * metres):
            return f"if camera.origin_m is in {name}, multiply it and look_at_m by {metres:g}"
    return ""


def _lengths(metres: np.ndarray) -> str:
    """Return three lengths as text, in the unit that suits the largest."""
    unit, scale = ("m", 1.0) if metres.max() >= 1 else ("mm", 1e-3) if metres.max() >= 1e-3 else ("µm", 1e-6)
    return f"{' × '.join(f'{x / scale:.3g}' for x in metres)} {unit}"
