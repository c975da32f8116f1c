"""The true focus of a recording: where the target is sharp, when the lens is there, and what is elsewhere."""

import numpy as np

from saf_gen.core.focus_crossings import find_crossings
from saf_gen.core.region import target_bounding_box
from saf_gen.errors import BadInput
from saf_gen.stack.charge_source import ChargeSource
from saf_gen.stack.time_resolved import PlaneSource, TimeResolvedStack
from saf_gen.stream.stream_file import Truth

__all__ = ["find_true_focus", "noise_free_sharpness"]


def find_true_focus(plane_source: PlaneSource, position: np.ndarray) -> Truth:
    """What is in focus where, and when a lens with these positions (T,) is first there.

    In a scene that moves the best focus may move too: ``track`` follows it, on straight lines between the
    moments that were rendered and see the target, and stays where it was while the target is out of sight.
    Everything else is of the moment at which the lens first meets a target in sight, or comes nearest.

    Raises BadInput where no moment sees the target.
    """
    time_stack = plane_source.time_stack
    if not time_stack.is_moving:
        depth, target = plane_source.load_geometry(0)
        place = time_stack.specs[0].drive.true_focus(depth[target])
        return _truth(plane_source, 0, place, _first(find_crossings(position, place)))
    at, best, seen = [], [], []
    for j, (begin, spec) in enumerate(zip(time_stack.slice_frames, time_stack.specs, strict=True)):
        depth, target = plane_source.load_geometry(j)
        seen.append(bool(target.any()))
        if seen[-1]:
            at.append(begin)
            best.append(spec.drive.true_focus(depth[target]))
    if not at:
        raise BadInput(
            f"the target of {time_stack.specs[0].scene} is never seen in {position.size} frames",
            hint="check its motion, the camera and the target in scene.yaml",
        )
    track = np.interp(np.arange(position.size) + 0.5, at, best)
    in_sight = _in_sight(time_stack, np.array(seen), position.size)
    off = position - track
    passed = find_crossings(off, 0.0)
    frame = _first(passed[in_sight[np.clip(np.rint(passed).astype(int), 0, position.size - 1)]])
    met = frame if np.isfinite(frame) else float(np.argmin(np.where(in_sight, np.abs(off), np.inf)))
    nearest = at[int(np.argmin(np.abs(np.asarray(at) - met - 0.5)))]
    place = float(np.interp(met, np.arange(position.size), track))
    truth = _truth(plane_source, time_stack.slice_frames.index(nearest), place, frame)
    return Truth(**{**vars(truth), "track": track.astype(np.float32)})


def _in_sight(time_stack: TimeResolvedStack, seen: np.ndarray, frames: int) -> np.ndarray:
    """Readouts between two moments that both see the target, bool (T,); where there are none, beside one."""
    after = np.minimum(
        np.searchsorted(time_stack.slice_frames, np.arange(frames), side="right"), len(seen) - 1
    )
    both = seen[after - 1] & seen[after]
    return both if both.any() else seen[after - 1] | seen[after]


def _first(passed: np.ndarray) -> float:
    return float(passed[0]) if passed.size else float("nan")


def _truth(plane_source: PlaneSource, j: int, position: float, frame: float) -> Truth:
    """The truth at stack j."""
    spec = plane_source.time_stack.specs[j]
    depth, target = plane_source.load_geometry(j)
    return Truth(
        position=position,
        depth_of_focus=spec.drive.depth_of_focus(depth[target], spec.pitch_m),
        frame=frame,
        depth=depth,
        target=target,
        best_position=spec.drive.best_position(depth).astype(np.float32),
    )


def noise_free_sharpness(exposed: ChargeSource, truth: Truth, *, position: np.ndarray) -> np.ndarray:
    """Noise-free SD (variance over squared mean) in the target's box at each of the evenly spaced positions.

    float64 (focus,), at gain 1. Where the scene moves, at the moment when the lens is first there; NaN at
    positions where it never is.
    """
    rows, columns = target_bounding_box(np.asarray(truth.target))
    positions = exposed.time_stack.specs[0].positions
    lowest, highest = float(position.min()), float(position.max())
    stride = float(np.abs(np.diff(position)).max(initial=0.0))  # readouts see the ends only to within that
    out = np.full(positions, np.nan)
    for k, place in enumerate(np.linspace(0, 1, positions)):
        passed = np.zeros(1)
        if exposed.time_stack.is_moving:
            there = float(np.clip(place, lowest, highest))
            passed = find_crossings(position, there) if abs(there - place) <= stride else passed[:0]
        if passed.size:
            seen = exposed.charge_image(float(passed[0]), float(place)).sum(axis=0)[rows, columns]
            out[k] = seen.var(dtype=np.float64) / seen.mean(dtype=np.float64) ** 2
    return out
