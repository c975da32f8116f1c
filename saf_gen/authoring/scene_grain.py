"""The grain in the pictures of a scene, rendered as for recordings: full stacks at rest, time slices in motion.

Grain is measured at best focus, a quarter of the travel away from it towards the farther end, and at both ends of the
travel. A scene at rest is rendered at all positions at once, and a time slice at the two positions around the lens. All
lights have gain 1, as on the card; the region is the box around the target at best focus.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from saf_gen.camera import Sensor
from saf_gen.core.region import Region, bounding_box
from saf_gen.render.depth_and_target import DepthAndTarget
from saf_gen.render.scene_renderer import SceneRenderer
from saf_gen.stack.focal_stack import FocalStack
from saf_gen.stack.grain import Grain, GrainFigure, correlate_grain, estimate_grain
from saf_gen.stack.time_resolved import SHADING_MOMENTS

BEST_FOCUS, QUARTER_AWAY = "best focus", "a quarter away"
QUARTER_TRAVEL = 0.25
STILL_SAMPLES, SLICE_SAMPLES, POSITIONS = 64, 16, 129  # as in the project's recipes
MAX_SLICE_RMS, MAX_SLICE_CONTRAST, MAX_STILL_CONTRAST = 0.04, 0.05, 0.01
"""Goals: relative rms noise in time slices, and noise over signal in the squared contrast of slices and stills."""


@dataclass(frozen=True)
class PositionGrain:
    """The grain at one position of the lens: in the box around the target, and in the pixels of the target."""

    position: float
    box: Grain
    target: Grain


def grain_positions(true_focus: float) -> dict[str, float]:
    """Return the positions (0 to 1) at which grain is measured, by name."""
    away = true_focus + QUARTER_TRAVEL if true_focus < 0.5 else true_focus - QUARTER_TRAVEL
    return {BEST_FOCUS: true_focus, QUARTER_AWAY: away, "position 0": 0.0, "position 1": 1.0}


def crop_sensor(sensor: Sensor, target: np.ndarray) -> Sensor:
    """Return the sensor cropped to a target, bool (row, col), by the same number of pixels on opposite sides.

    The optical axis remains in the middle of the sensor, so the remaining pixels see the same as before.
    """
    rows, columns = bounding_box(target)
    sizes = []
    for span, size in ((rows, sensor.rows), (columns, sensor.columns)):
        sizes.append(size - 2 * min(span.start, size - span.stop))
    return replace(sensor, rows=sizes[0], columns=sizes[1])


def measure_still(
    renderer: SceneRenderer,
    seen: DepthAndTarget,
    *,
    measured_positions: Mapping[str, float],
    positions: int,
    samples: int,
    progress: Callable[[float], None] = lambda done: None,
) -> dict[str, PositionGrain]:
    """Return the grain at each position, measured from two focal stacks over the whole travel of the scene at rest.

    Parameters
    ----------
    renderer : SceneRenderer
        Renderer of the scene.
    seen : DepthAndTarget
        Depth map and target of the scene.
    measured_positions : mapping of str to float
        Positions of the lens (0 to 1) by name.
    positions : int
        Number of positions of the focal stack.
    samples : int
        Samples per pixel.
    progress : callable, optional
        Called with the fraction done, 0 to 1.

    Returns
    -------
    dict of str to PositionGrain

    Raises
    ------
    BadInput
        If the scene cannot be rendered.
    """
    planes = {name: round(position * (positions - 1)) for name, position in measured_positions.items()}
    box, renders = bounding_box(seen.target), []
    for run in (1, 2):
        progress((run - 1) / 2)
        stack = renderer.render_stack(seen, positions=positions, samples=samples, run=run)
        renders.append({name: _mix_box(stack, k, box=box) for name, k in planes.items()})
    progress(1.0)
    return {
        name: _compare(renders[0][name], renders[1][name], position=measured_positions[name], mask=seen.target[box])
        for name in measured_positions
    }


def measure_slices(
    renderer: SceneRenderer,
    seen: DepthAndTarget,
    *,
    measured_positions: Mapping[str, float],
    positions: int,
    samples: int,
    time_s: float | None = None,
    step_s: float = 0.0,
    progress: Callable[[float], None] = lambda done: None,
) -> dict[str, PositionGrain]:
    """Return the grain at each position, measured from two renders of a time slice with two positions each.

    Parameters
    ----------
    renderer : SceneRenderer
        Renderer of the scene.
    seen : DepthAndTarget
        Depth map and target of the scene.
    measured_positions : mapping of str to float
        Positions of the lens (0 to 1) by name.
    positions : int
        Number of positions of the focal stack; only the two around each measured position are rendered.
    samples : int
        Samples per pixel.
    time_s : float, optional
        Time of the slice (seconds); by default the moment at which the scene is shown at rest.
    step_s : float, default 0
        Time between slices (seconds), 0 for a scene at rest; a slice shares the shading of the slices before it.
    progress : callable, optional
        Called with the fraction done, 0 to 1.

    Returns
    -------
    dict of str to PositionGrain

    Raises
    ------
    BadInput
        If the scene cannot be rendered.
    """
    box, found = bounding_box(seen.target), {}
    for done, (name, position) in enumerate(measured_positions.items()):
        progress(done / len(measured_positions))
        one, other = _render_slice_pair(
            renderer, seen, position=position, positions=positions, samples=samples, time_s=time_s, step_s=step_s
        )
        found[name] = _compare(one[box], other[box], position=position, mask=seen.target[box])
    progress(1.0)
    return found


def correlate_slices(
    renderer: SceneRenderer,
    seen: DepthAndTarget,
    *,
    position: float,
    positions: int,
    samples: int,
    time_s: float,
    step_s: float,
    steps: tuple[int, ...] = (1, 8),
) -> Iterator[tuple[int, GrainFigure]]:
    """Yield the correlation between the grain of the slice at ``time_s`` and the grain of later slices.

    Each item is the number of slices between the two, one of ``steps``, and the correlation. The pixels are those of
    the target's box at ``time_s``. Raises BadInput if the scene cannot be rendered.
    """
    box = bounding_box(seen.target)

    def render_box(at_s: float) -> tuple[np.ndarray, np.ndarray]:
        pair = _render_slice_pair(
            renderer, seen, position=position, positions=positions, samples=samples, time_s=at_s, step_s=step_s
        )
        return pair[0][box], pair[1][box]

    earlier = render_box(time_s)
    for step in steps:
        yield step, correlate_grain(earlier, render_box(time_s + step * step_s))


def _render_slice_pair(
    renderer: SceneRenderer,
    seen: DepthAndTarget,
    *,
    position: float,
    positions: int,
    samples: int,
    time_s: float | None,
    step_s: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Return two renders with independent noise of a moment, each float64 (row, col).

    The two positions around ``position`` are rendered, and the nearer one is returned.
    """
    knot = position * (positions - 1)
    first = min(int(knot), positions - 2)
    nearer = min(max(round(knot) - first, 0), 1)
    one, other = (
        renderer.render_stack(
            seen,
            positions=positions,
            samples=samples,
            window=(first, first + 1),
            time_s=time_s,
            run=run,
            moments=SHADING_MOMENTS,
            step_s=step_s,
        )
        for run in (1, 2)
    )
    full_frame = (slice(None), slice(None))
    return _mix_box(one, nearer, box=full_frame), _mix_box(other, nearer, box=full_frame)


def _mix_box(stack: FocalStack, plane: int, *, box: Region) -> np.ndarray:
    """Return a region of a focus plane with all lights on, float64 (row, col)."""
    return stack.radiance[:, plane, box[0], box[1]].sum(axis=0, dtype=np.float64)


def _compare(first: np.ndarray, second: np.ndarray, *, position: float, mask: np.ndarray) -> PositionGrain:
    return PositionGrain(position, estimate_grain(first, second), estimate_grain(first, second, mask=mask))
