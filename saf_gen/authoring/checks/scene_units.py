"""Sizes against distances: geometry in millimetres or inches, by mistake, is told with its factor."""

from collections.abc import Iterator

import numpy as np

from saf_gen.authoring.checks._scene_finding import SceneFinding, ok, warning
from saf_gen.authoring.checks.scene_under_test import SceneUnderTest

__all__ = ["check_units", "suggest_unit"]

UNITS = {
    "millimetres": 1e-3,
    "centimetres": 1e-2,
    "inches": 0.0254,
    "feet": 0.3048,
    "metres": 1.0,
    "micrometres": 1e-6,
    "kilometres": 1e3,
}
FEW = 500  # pixels: less of a target is little to focus on
FIELDS = 3.0  # a target seen at most so many fields of view off the axis may be meant


def check_units(subject: SceneUnderTest) -> Iterator[SceneFinding]:
    """How large the target is, how far, how much of the frame."""
    seen = subject.depth_and_target
    share = seen.target.mean()
    size = np.ptp(subject.renderer.bounds(*subject.scene.card.target), axis=0)
    text = (
        f"target {_lengths(size)}, {np.median(subject.target_depths_m):.4g} m away, "
        f"{share:.0%} of the frame; "
        f"all there is {_lengths(np.ptp(subject.renderer.bounds(), axis=0))}"
    )
    if seen.target.sum() < FEW:
        yield warning(
            "units", f"{text}: {seen.target.sum()} pixels are little to focus on, move the camera nearer"
        )
    else:
        yield ok("units", text)


def suggest_unit(subject: SceneUnderTest) -> str:
    """What to write if another unit would bring the target into the lens's reach; '' where none would."""
    card = subject.scene.card
    box = subject.renderer.bounds(*card.target)
    if not box.size:
        return ""  # no shape has the target's name: its size is not known
    middle = box.mean(axis=0)
    origin = np.array(card.camera.origin_m)
    axis = np.array(card.camera.look_at_m) - origin
    axis /= np.linalg.norm(axis)
    near, far = subject.drive.focusing_range_m
    half = subject.sensor.columns * subject.sensor.pitch_m / 2 / float(subject.drive.image_distance(0.5))

    def fits(point: np.ndarray, camera: np.ndarray) -> bool:
        away = point - camera
        depth = float(away @ axis)
        aside = float(np.linalg.norm(away - depth * axis))
        return bool(near <= depth <= far and aside <= FIELDS * half * depth)

    for name, metres in UNITS.items():
        factor = metres / card.unit_m
        if factor == 1:
            continue
        if fits(middle * factor, origin):
            return f"if the geometry is in {name}, write unit_m: {metres:g} on the card"
        if fits(middle, origin * metres):
            return f"if camera.origin_m is in {name}, multiply it and look_at_m by {metres:g}"
    return ""


def _lengths(metres: np.ndarray) -> str:
    """Three lengths in the unit that suits the largest."""
    for unit, scale in (("m", 1.0), ("mm", 1e-3), ("µm", 1e-6)):
        if metres.max() >= scale or unit == "µm":
            return f"{' × '.join(f'{x / scale:.3g}' for x in metres)} {unit}"
    raise AssertionError
