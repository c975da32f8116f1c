"""Motion: does the target stay in the frame and in reach, and how fast do shapes move?"""

from collections.abc import Iterator
from itertools import product

import numpy as np

from saf_gen.authoring.checks._scene_finding import SceneFinding, scene_check_error, scene_check_ok, scene_check_warning
from saf_gen.authoring.checks.scene_under_test import SceneUnderTest
from saf_gen.scene.keyframes import motion_end_s

MOMENTS = 9
RECORDING_S = 1.0  # 20,000 frames
MAX_STEP, PROPOSED_STEP = 2.0, 1.0  # pixels from one time slice to the next


def check_motion(subject: SceneUnderTest) -> Iterator[SceneFinding]:
    """Check the target at a few moments, and compare the speed of the fastest shape with the time slices."""
    renderer, card = subject.renderer, subject.scene.card
    if not renderer.motions:
        if card.slices_per_s is not None:
            yield scene_check_warning(
                "motion", "the card has slices_per_s, but nothing moves: remove it, or add motion"
            )
        return
    times = _times(subject)
    lost, positions = [], []
    for time_s in times:
        seen = renderer.trace_geometry(time_s=time_s, allow_unseen_target=True)
        if seen.target.any():
            positions.append(subject.drive.true_focus(seen.depth[seen.target]))
        else:
            lost.append(time_s)
    if not positions:
        yield scene_check_error(
            "motion", "the target is never in the frame while it moves: check motion, camera and target"
        )
        return
    text = f"in focus from {min(positions):.3f} to {max(positions):.3f} of the travel"
    if lost:
        yield scene_check_warning(
            "motion", f"the target has left the frame at {lost[0]:.3g} s: shorten its path, or let it turn back"
        )
    elif min(positions) < 0 or max(positions) > 1:
        yield scene_check_warning("motion", f"{text}: it leaves the lens's reach, shorten its path in depth")
    else:
        yield scene_check_ok("motion", text)
    name, pixels_per_s = _find_fastest_shape(subject, times)
    yield _check_speed(subject, name, pixels_per_s=pixels_per_s)


def _check_speed(subject: SceneUnderTest, name: str, *, pixels_per_s: float) -> SceneFinding:
    slices = subject.scene.card.slices_per_s
    if not name:
        moving = ", ".join(repr(name) for name in subject.renderer.motions)
        text = f"no shape moves, only {moving}"
        if slices is None:
            how = "write slices_per_s on the card, and the check measures the error of interpolation"
            return scene_check_warning("motion", f"{text}, but recordings show it at rest: {how}")
        return scene_check_ok("motion", f"{text}; slices_per_s: {slices:g}")
    write = f"with slices_per_s: {max(1, round(pixels_per_s / PROPOSED_STEP))} it moves a pixel per slice"
    text = f"{name!r} moves at up to {pixels_per_s:,.0f} pixels per second"
    if slices is None:
        return scene_check_warning("motion", f"{text}, but recordings show it at rest: {write}")
    text += f", {pixels_per_s / slices:.2g} pixels per time slice"
    return (
        scene_check_warning("motion", f"{text}: {write}")
        if pixels_per_s > MAX_STEP * slices
        else scene_check_ok("motion", text)
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
