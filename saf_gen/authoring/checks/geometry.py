"""Checks of the geometry: sizes and units, the reach of the lens, and motion.

Comparison of sizes with distances reveals geometry that is in millimetres or inches by mistake.
"""

import math
from collections.abc import Iterator
from itertools import product

import numpy as np

from saf_gen.authoring.checks.subject import SceneUnderTest
from saf_gen.core.config.ranges import is_range
from saf_gen.core.finding import Finding
from saf_gen.errors import BadInput
from saf_gen.render.exported_camera import fitting_scale
from saf_gen.scene.keyframes import motion_end_s

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


def check_units(subject: SceneUnderTest) -> Iterator[Finding]:
    """Check how large the target is, how far away it is, and how much of the frame it fills."""
    seen = subject.depth_and_target
    size = np.ptp(subject.renderer.bounds(*subject.scene.card.target), axis=0)
    text = (
        f"target {_lengths(size)}, {np.median(subject.target_depths_m):.4g} m away, "
        f"{seen.target.mean():.0%} of the frame; "
        f"the whole scene {_lengths(np.ptp(subject.renderer.bounds(), axis=0))}"
    )
    if seen.target.sum() < MIN_PIXELS:
        yield Finding(
            "units", "warning", f"{text}: {seen.target.sum()} pixels are too few to focus on, move the camera nearer"
        )
    else:
        yield Finding("units", "ok", text)


def implausible_unit(subject: SceneUnderTest) -> Finding | None:
    """Return an error if the target is so far away that no lens blurs it, and a smaller unit would change that."""
    distance = float(np.median(subject.target_depths_m))
    fit = fitting_scale(distance, image_m=float(subject.drive.image_distance(0.5)))
    if fit is None or fit[0] == 1 or max(_blur_at_ends(subject)) >= 1:
        return None
    text = (
        f"the target is {distance:.4g} m away, and no position of the lens blurs it: write unit_m: "
        f"{fit[0] * subject.scene.card.unit_m:g} on the card, and multiply its lengths in metres by {fit[0]:g}"
    )
    return Finding("units", "error", text)


def _blur_at_ends(subject: SceneUnderTest) -> list[float]:
    """Return the rms blur (pixels) of the target at both ends of the travel."""
    return [
        float(np.sqrt(np.mean(subject.drive.blur_diameter(p, subject.target_depths_m) ** 2))) / subject.sensor.pitch_m
        for p in (0.0, 1.0)
    ]


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


MARGIN = 0.1  # of the travel, at either end
MIN_BLUR = 4.0  # pixels; with less blur at both ends of the travel, a search has nothing to find
MAX_RESIDUAL_BLUR = 1.0  # pixels
MAX_APART = 0.3  # half depths of focus between the largest contrast and the least blur
MEMBERS = 3


def out_of_reach(subject: SceneUnderTest, problem: BadInput) -> Finding:
    """Return the finding for a target out of sight or reach, with advice on a wrong unit if that explains it."""
    unit = suggest_unit(subject)
    return Finding("reach", "error", f"{problem}; {unit}" if unit else str(problem))


def check_reach(subject: SceneUnderTest) -> Iterator[Finding]:
    """Check where in the travel the target is in focus, and how much it is blurred at the ends of the travel."""
    truth, half = subject.true_focus, subject.half_depth_of_focus
    low, high = subject.depth_of_focus
    ends = _blur_at_ends(subject)
    text = (
        f"in focus at {truth:.3f} of the travel, depth of focus {low:.3f} to {high:.3f}; "
        f"blurred over {ends[0]:.0f} and {ends[1]:.0f} pixels at the ends of the travel"
    )
    left = subject.depth_and_target.residual_blur_px
    seen = subject.depth_and_target
    apart = abs(subject.in_focus.least_blur(seen.depth, seen.target) - truth)
    if apart > MAX_APART * half:
        yield Finding(
            "reach",
            "warning",
            f"the lens has aberrations: contrast is greatest {apart / half:.2f} half depths of focus from the least "
            "blur, so what is in focus depends on the texture; lower them, or stop the lens down",
        )
    if left > MAX_RESIDUAL_BLUR:
        yield Finding(
            "reach",
            "warning",
            f"{text}: the glass in front of the target leaves a blur of {left:.1f} pixels at any position, "
            "stop the lens down, or use flat glass",
        )
    elif not MARGIN <= truth <= 1 - MARGIN:
        yield Finding(
            "reach", "warning", f"{text}: the focus is near an end of the travel, widen {subject.drive.travel_key}"
        )
    elif max(ends) < MIN_BLUR:
        yield Finding(
            "reach", "warning", f"{text}: the blur is too small, open the lens or widen {subject.drive.travel_key}"
        )
    else:
        positions = 2 ** math.ceil(math.log2(1 / half)) + 1  # spaced by at most half the depth of focus
        yield Finding("reach", "ok", f"{text}; recipes need focus.positions: {positions} or more")


def check_family(subject: SceneUnderTest) -> Iterator[Finding]:
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
            yield Finding("family", "error", f"with {drawn}: {problem}; narrow the ranges of params")
            continue
        if not MARGIN / 2 <= member.true_focus <= 1 - MARGIN / 2:
            yield Finding(
                "family",
                "warning",
                f"with {drawn} the focus is at {member.true_focus:.3f} of the travel, close to its end",
            )
    if found:
        yield Finding("family", "ok", f"{len(found)} members drawn, in focus at {', '.join(f'{p:.3f}' for p in found)}")


MOMENTS = 9
RECORDING_S = 1.0  # 20,000 frames
MAX_STEP, PROPOSED_STEP = 2.0, 1.0  # pixels from one time slice to the next


def check_motion(subject: SceneUnderTest) -> Iterator[Finding]:
    """Check the target at a few moments, and compare the speed of the fastest shape with the time slices."""
    renderer, card = subject.renderer, subject.scene.card
    if not renderer.motions:
        if card.slices_per_s is not None:
            yield Finding("motion", "warning", "the card has slices_per_s, but nothing moves: remove it, or add motion")
        return
    times = _times(subject)
    lost, positions = [], []
    for time_s in times:
        seen = renderer.trace_geometry(time_s=time_s, allow_unseen_target=True)
        if seen.target.any():
            positions.append(subject.in_focus.true_focus(seen.depth, seen.target))
        else:
            lost.append(time_s)
    if not positions:
        yield Finding(
            "motion", "error", "the target is never in the frame while it moves: check motion, camera and target"
        )
        return
    text = f"in focus from {min(positions):.3f} to {max(positions):.3f} of the travel"
    if lost:
        yield Finding(
            "motion",
            "warning",
            f"the target has left the frame at {lost[0]:.3g} s: shorten its path, or let it turn back",
        )
    elif min(positions) < 0 or max(positions) > 1:
        yield Finding("motion", "warning", f"{text}: it leaves the lens's reach, shorten its path in depth")
    else:
        yield Finding("motion", "ok", text)
    name, pixels_per_s = _find_fastest_shape(subject, times)
    yield _check_speed(subject, name, pixels_per_s=pixels_per_s)


def _check_speed(subject: SceneUnderTest, name: str, *, pixels_per_s: float) -> Finding:
    slices = subject.scene.card.slices_per_s
    if not name:
        moving = ", ".join(repr(name) for name in subject.renderer.motions)
        text = f"no shape moves, only {moving}"
        if slices is None:
            how = "write slices_per_s on the card, and the check measures the error of interpolation"
            return Finding("motion", "warning", f"{text}, but recordings show it at rest: {how}")
        return Finding("motion", "ok", f"{text}; slices_per_s: {slices:g}")
    write = f"with slices_per_s: {max(1, round(pixels_per_s / PROPOSED_STEP))} it moves a pixel per slice"
    text = f"{name!r} moves at up to {pixels_per_s:,.0f} pixels per second"
    if slices is None:
        return Finding("motion", "warning", f"{text}, but recordings show it at rest: {write}")
    text += f", {pixels_per_s / slices:.2g} pixels per time slice"
    return (
        Finding("motion", "warning", f"{text}: {write}")
        if pixels_per_s > MAX_STEP * slices
        else Finding("motion", "ok", text)
    )


def _times(subject: SceneUnderTest) -> list[float]:
    """Return moments (seconds) within a recording: evenly spaced ones, and those of keyframes."""
    motions = subject.renderer.motions
    keys = {frame.time_s for motion in motions.values() for frame in motion.keyframes}
    last = motion_end_s(motions, recording_s=RECORDING_S)
    return sorted({*np.linspace(0, last, MOMENTS).tolist(), *sorted(k for k in keys if 0 <= k <= last)[:MOMENTS]})


def _find_fastest_shape(subject: SceneUnderTest, times: list[float]) -> tuple[str, float]:
    """Return the shape that moves fastest in the image, and its speed in pixels per second; ('', 0) if none moves.

    The speed is measured at the corners of the shape's bounding box over a millisecond at each of the times, seen
    through the middle of the lens at the true focus. Lamps without geometry do not count.
    """
    card, drive = subject.scene.card, subject.drive
    origin = np.array(card.camera.origin_m)
    ahead = np.array(card.camera.look_at_m) - origin
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, card.camera.up)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(right, ahead), ahead])
    lens = origin + float(drive.shift(subject.true_focus)) * ahead
    scale = float(drive.image_distance(subject.true_focus)) / subject.sensor.pitch_m
    step_s = 1e-3
    best = ("", 0.0)
    for name, motion in subject.renderer.motions.items():
        box = subject.renderer.rest_bounds(name)
        if not box.size:
            continue
        corners = np.array(list(product(*box.T)))
        for time_s in times:
            pixels = []
            for t in (time_s, time_s + step_s):
                pose = motion.pose_at(t)
                x, y, depth = axes @ (corners @ pose[:3, :3].T + pose[:3, 3] - lens).T
                pixels.append(scale * np.stack([x, y]) / np.where(depth > 0, depth, np.nan))
            moved = np.hypot(*(pixels[1] - pixels[0])) / step_s
            if np.isfinite(moved).any() and np.nanmax(moved) > best[1]:
                best = (name, float(np.nanmax(moved)))
    return best
