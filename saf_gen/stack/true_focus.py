"""The true focus of a recording: the position at which the target is sharp, and when the lens is there."""

from dataclasses import replace
from typing import Any

import numpy as np

from saf_gen.core.region import Region, inside_box
from saf_gen.errors import BadInput
from saf_gen.optics import FittedRays, FocusCriterion
from saf_gen.optics.focus_crossings import focus_crossings
from saf_gen.optics.texture_contrast import Blend
from saf_gen.stack.colour import Blends
from saf_gen.stack.focal_stack import StackSpec
from saf_gen.stack.time_resolved import PlaneSource, TimeResolvedStack
from saf_gen.stream.metadata import Truth

FEW_DEPTHS = 256
NEAR_DOF = 3.0
"""Distance of the lens from the true focus, in depths of focus, up to which it is near it."""


def find_true_focus(
    plane_source: PlaneSource, position: np.ndarray, *, blends: Blends | None = None
) -> tuple[Truth, float]:
    """Return the true focus for a lens at these positions, without the sharpness, and the frame of its target mask.

    In a moving scene the best focus may move too. ``track`` then follows it, linearly between the rendered moments that
    see the target, and stays constant while the target is out of sight. All other fields hold at the moment when the
    lens first meets the focus of a visible target, or comes nearest to it; the mask is that of the rendered moment
    nearest to it that sees the target.

    So it may in a still scene if the mix of its lamps changes and the lens has axial colour: ``track`` then follows the
    focus of the mix in each readout. In a moving scene the two add up.

    Parameters
    ----------
    plane_source : PlaneSource
        Focal stacks of the recording.
    position : ndarray, shape (T,)
        Position of the lens in each readout, 0 to 1.
    blends : Blends, optional
        The mixes of light on the target; by default light of one wavelength.

    Returns
    -------
    truth : Truth
        The true focus.
    frame : float
        Frame in whose picture the target is where the mask has it: ``truth.frame``, or if the lens never meets the
        focus, the beginning of the rendered moment of the mask, -0.5 for the first. NaN if a static scene is never in
        focus, because its picture is the same at every frame.

    Raises
    ------
    BadInput
        If the target is seen at no moment.
    """
    time_stack = plane_source.time_stack
    if not time_stack.is_moving:
        depth, target = plane_source.load_geometry(0)
        if blends is not None and len(blends.blends) > 1:
            return _truth_of_changing_light(plane_source, position, blends=blends)
        blend = blends.blends[0] if blends else ()
        best = _in_focus(time_stack.specs[0], blend).true_focus(depth, target)
        frame = _first(focus_crossings(position, best))
        return _truth_at(plane_source, 0, position=best, frame=frame, blend=blend), frame
    usual = _usual(blends)
    seen_frames, best_positions, seen = [], [], []
    for j, (begin, spec) in enumerate(zip(time_stack.slice_frames, time_stack.specs, strict=True)):
        depth, target = plane_source.load_geometry(j)
        seen.append(bool(target.any()))
        if seen[-1]:
            seen_frames.append(begin)
            best_positions.append(_in_focus(spec, usual).true_focus(depth, target))
    if not seen_frames:
        raise BadInput(
            f"the target of {time_stack.specs[0].scene} is never seen in {position.size} frames",
            hint="check its motion, the camera and the target in scene.yaml",
        )
    track = np.interp(np.arange(position.size) + 0.5, seen_frames, best_positions)
    if blends is not None:
        track = track + _offsets(time_stack.specs[0], blends, position=float(np.median(best_positions)))
    in_sight = _in_sight(time_stack, np.array(seen), frames=position.size)
    off = position - track
    crossings = focus_crossings(off, 0.0)
    frame = _first(crossings[in_sight[np.clip(np.rint(crossings).astype(int), 0, position.size - 1)]])
    met = frame if np.isfinite(frame) else float(np.argmin(np.where(in_sight, np.abs(off), np.inf)))
    nearest = seen_frames[int(np.argmin(np.abs(np.asarray(seen_frames) - met - 0.5)))]
    best = float(np.interp(met, np.arange(position.size), track))
    blend = usual if blends is None else blends.blends[blends.number[int(np.clip(round(met), 0, position.size - 1))]]
    truth = _truth_at(plane_source, time_stack.slice_frames.index(nearest), position=best, frame=frame, blend=blend)
    return replace(truth, track=track.astype(np.float32)), frame if np.isfinite(frame) else nearest - 0.5


def find_inside(plane_source: PlaneSource, truth: Truth, *, position: np.ndarray) -> Region | None:
    """Return the largest rectangle inside the target, by :func:`saf_gen.core.region.inside_box`; None if there is none.

    In a moving scene it is inside the target's mask in ``truth`` and in all rendered moments that make up the pictures
    while the lens is within NEAR_DOF depths of focus of the truth; there is none if the lens never is.

    Parameters
    ----------
    plane_source : PlaneSource
        Focal stacks of the recording.
    truth : Truth
        True focus, with the target mask.
    position : ndarray, shape (T,)
        Position of the lens in each readout, 0 to 1.
    """
    mask, time_stack = np.asarray(truth.target, dtype=bool), plane_source.time_stack
    if time_stack.is_moving:
        dof = abs(truth.depth_of_focus[1] - truth.depth_of_focus[0])
        near = np.flatnonzero(np.abs(position - np.asarray(truth.track)) <= NEAR_DOF * dof)
        if not near.size:
            return None
        before = np.searchsorted(time_stack.slice_frames, near, side="right") - 1
        for j in np.unique([before, np.minimum(before + 1, len(time_stack.specs) - 1)]).tolist():
            mask = mask & plane_source.load_geometry(j)[1]
    return inside_box(mask)


def _truth_of_changing_light(plane_source: PlaneSource, position: np.ndarray, *, blends: Blends) -> tuple[Truth, float]:
    """Return the truth of a still scene under lamps whose mix changes; see :func:`find_true_focus`."""
    spec, (depth, target) = plane_source.time_stack.specs[0], plane_source.load_geometry(0)
    few, seen = _few_depths(spec, depth, target=target)
    best = np.array([_in_focus(spec, blend).true_focus(few, seen) for blend in blends.blends])
    track = best[blends.number]
    off = position - track
    frame = _first(focus_crossings(off, 0.0))
    met = int(np.rint(frame)) if np.isfinite(frame) else int(np.abs(off).argmin())
    at = int(np.clip(met, 0, position.size - 1))
    blend = blends.blends[blends.number[at]]
    truth = _truth_at(plane_source, 0, position=float(track[at]), frame=frame, blend=blend)
    return replace(truth, track=track.astype(np.float32)), frame


def _few_depths(spec: StackSpec, depth: np.ndarray, *, target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return depths and mask of few pixels with the distribution of a target's depths, for many mixes of light.

    Where the focus also depends on the place in the picture, these are all pixels.
    """
    wavefront = spec.drive.wavefront
    varies = wavefront is not None and (isinstance(wavefront, FittedRays) or wavefront.varies_over_field)
    if varies or np.count_nonzero(target) <= FEW_DEPTHS:
        return depth, target
    few = np.quantile(depth[target], (np.arange(FEW_DEPTHS) + 0.5) / FEW_DEPTHS, method="nearest")
    return few[None], np.ones((1, FEW_DEPTHS), dtype=bool)


def _in_focus(spec: StackSpec, blend: Blend) -> FocusCriterion:
    """Return what counts as in focus in front of a stack, in a mix of light."""
    return replace(spec.in_focus, blend=blend)


def _usual(blends: Blends | None) -> Blend:
    """Return the mix of light that is there in most readouts; empty for light of one wavelength."""
    return () if blends is None else blends.blends[int(np.bincount(blends.number).argmax())]


def _offsets(spec: StackSpec, blends: Blends, *, position: float) -> np.ndarray:
    """Return by how much the mix of light moves the focus from that of the usual mix in each readout, float64 (T,).

    It is found for a flat target in focus at ``position``.
    """
    depth = np.full((1, 1), float(spec.drive.focus_depth(position)))
    flat = np.ones((1, 1), dtype=bool)
    usual = _in_focus(spec, _usual(blends)).true_focus(depth, flat)
    moved = [_in_focus(spec, blend).true_focus(depth, flat) - usual for blend in blends.blends]
    return np.array(moved)[blends.number]


def _in_sight(time_stack: TimeResolvedStack, seen: np.ndarray, *, frames: int) -> np.ndarray:
    """Return which readouts are between two moments that see the target, bool (T,).

    If there are none, the readouts next to a moment that sees it are returned.
    """
    after = np.searchsorted(time_stack.slice_frames, np.arange(frames), side="right")
    after = np.minimum(after, len(seen) - 1)
    both = seen[after - 1] & seen[after]
    return both if both.any() else seen[after - 1] | seen[after]


def _first(crossings: np.ndarray) -> float:
    return float(crossings[0]) if crossings.size else float("nan")


def _truth_at(plane_source: PlaneSource, j: int, *, position: float, frame: float, blend: Blend = ()) -> Truth:
    """Return the truth at the moment of stack j, in a mix of light."""
    in_focus = _in_focus(plane_source.time_stack.specs[j], blend)
    depth, target = plane_source.load_geometry(j)
    return Truth(
        position=position,
        depth_of_focus=in_focus.depth_of_focus(depth, target),
        frame=frame,
        depth=depth,
        target=target,
        best_position=in_focus.best_position(depth).astype(np.float32),
        **({} if in_focus.is_perfect else _of_imperfect_lens(in_focus, depth, target=target)),
    )


def _of_imperfect_lens(in_focus: FocusCriterion, depth: np.ndarray, *, target: np.ndarray) -> dict[str, Any]:
    """Return the fields of a truth that follow from the others for a perfect lens, whose files do not repeat them."""
    return {
        "least_blur": in_focus.least_blur(depth, target),
        "in_focus": in_focus.in_focus(depth, target),
        "least_blur_in_focus": in_focus.in_focus(depth, target, by_blur=True),
    }
