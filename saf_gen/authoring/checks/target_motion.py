"""Motion: does the target stay in the frame and in reach, and how fast is what moves?"""

from collections.abc import Iterator
from itertools import product

import numpy as np

from saf_gen.authoring.checks._scene_finding import SceneFinding, error, ok, warning
from saf_gen.authoring.checks.scene_under_test import SceneUnderTest

__all__ = ["check_motion", "find_fastest_shape", "last_motion_s"]

MOMENTS = 9
LATEST_S = 1.0  # a recording of 20,000 frames
COARSE, FINE = 2.0, 1.0  # pixels from one time slice to the next: too far, and what is proposed


def check_motion(subject: SceneUnderTest) -> Iterator[SceneFinding]:
    """The target at a few moments, and the speed of the fastest shape against the card's time slices."""
    renderer, card = subject.renderer, subject.scene.card
    if not renderer.motions:
        if card.slices_per_s is not None:
            yield warning(
                "motion", "slices_per_s is on the card, but nothing moves: remove it, or add motion"
            )
        return
    times = _times(subject)
    lost, places = [], []
    for time_s in times:
        seen = renderer.trace_depth_and_target(time_s=time_s, allow_unseen_target=True)
        if seen.target.any():
            places.append(subject.drive.true_focus(seen.depth[seen.target]))
        else:
            lost.append(time_s)
    if not places:
        yield error(
            "motion", "the target is never in the frame while it moves: check motion, camera and target"
        )
        return
    text = f"in focus from {min(places):.3f} to {max(places):.3f} of the travel"
    if lost:
        yield warning(
            "motion", f"the target has left the frame at {lost[0]:.3g} s: shorten its way, or turn back"
        )
    elif min(places) < 0 or max(places) > 1:
        yield warning("motion", f"{text}: out of the lens's reach for a while, shorten its way in depth")
    else:
        yield ok("motion", text)
    yield _slices(subject, find_fastest_shape(subject, times))


def _slices(subject: SceneUnderTest, speed: tuple[str, float]) -> SceneFinding:
    name, pixels_per_s = speed
    slices = subject.scene.card.slices_per_s
    if not name:
        moving = ", ".join(repr(name) for name in subject.renderer.motions)
        text = f"no shape goes anywhere, what moves is {moving}"
        if slices is None:
            how = "write slices_per_s, with which the check measures how well slices go over"
            return warning("motion", f"{text}, but recordings of it stand still: {how}")
        return ok("motion", f"{text}; slices_per_s: {slices:g}")
    write = f"slices_per_s: {max(1, round(pixels_per_s / FINE))} moves it a pixel from one to the next"
    text = f"{name!r} moves at up to {pixels_per_s:,.0f} pixels a second"
    if slices is None:
        return warning("motion", f"{text}, but recordings of it stand still: {write}")
    if pixels_per_s > COARSE * slices:
        return warning("motion", f"{text}, {pixels_per_s / slices:.2g} pixels a time slice: {write}")
    return ok("motion", f"{text}, {pixels_per_s / slices:.2g} pixels a time slice")


def _times(subject: SceneUnderTest) -> list[float]:
    """Moments (s) within a recording: keyframes, and others evenly between."""
    keys, last = _keys(subject), last_motion_s(subject)
    return sorted(
        {*np.linspace(0, last, MOMENTS).tolist(), *sorted(k for k in keys if 0 <= k <= last)[:MOMENTS]}
    )


def last_motion_s(subject: SceneUnderTest) -> float:
    """The last moment (s) of a recording at which something still moves."""
    last = max(_keys(subject))
    return min(last, LATEST_S) if last > 0 else LATEST_S


def _keys(subject: SceneUnderTest) -> set[float]:
    return {k.time_s for motion in subject.renderer.motions.values() for k in motion.keyframes}


def find_fastest_shape(subject: SceneUnderTest, times: list[float]) -> tuple[str, float]:
    """The moving shape whose picture is fastest, with its speed (pixels a second); ('', 0) where none moves.

    What has no shape, as a spot lamp, has no picture to be fast. By the corners of the box round each shape,
    seen through the middle of the lens where the target is in focus, over a thousandth of a second at each of
    these times.
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
