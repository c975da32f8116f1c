"""The grain of a scene's pictures as recordings have them: whole stacks at rest, time slices while it moves.

Grain is measured where the lens matters: at best focus, a quarter of the travel away from it towards the farther end,
and at both ends. A still scene is rendered at all positions at once, a time slice at the two positions that a lens at
that place needs. All lights are at gain 1, as the card has them; the region is the box round the target at best focus.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from saf_gen.camera import Sensor
from saf_gen.core.region import Region, mask_bounding_box
from saf_gen.render.depth_and_target import DepthAndTarget
from saf_gen.render.scene_renderer import SceneRenderer
from saf_gen.stack.focal_stack import FocalStack
from saf_gen.stack.grain import Grain, GrainFigure, correlate_stack_grain, estimate_stack_grain
from saf_gen.stack.time_resolved import SHADING_MOMENTS

BEST_FOCUS, AWAY = "best focus", "a quarter away"
QUARTER = 0.25
STILL_SAMPLES, SLICE_SAMPLES, POSITIONS = 64, 16, 129  # of the project's recipes
MAX_SLICE_RMS, MAX_SLICE_CONTRAST, MAX_STILL_CONTRAST = 0.04, 0.05, 0.01
"""Goals: rms over the mean in time slices, and noise over signal in the squared contrast of slices and of stills."""


@dataclass(frozen=True)
class PlaceGrain:
    """The grain with the lens at one place: in the box round the target, and of the target's own pixels."""

    position: float
    box: Grain
    target: Grain


def list_scene_grain_places(true_focus: float) -> dict[str, float]:
    """Return the positions (0 to 1) at which grain is measured, by name."""
    away = true_focus + QUARTER if true_focus < 0.5 else true_focus - QUARTER
    return {BEST_FOCUS: true_focus, AWAY: away, "position 0": 0.0, "position 1": 1.0}


def crop_sensor_for_scene_grain(sensor: Sensor, target: np.ndarray) -> Sensor:
    """Return the sensor without the border that a target, bool (row, col), leaves free on both sides alike.

    The optical axis stays in its middle, so that each pixel that is left sees what it saw.
    """
    rows, columns = mask_bounding_box(target)
    kept = []
    for span, size in ((rows, sensor.rows), (columns, sensor.columns)):
        kept.append(size - 2 * min(span.start, size - span.stop))
    return replace(sensor, rows=kept[0], columns=kept[1])


def measure_still_scene_grain(
    renderer: SceneRenderer,
    seen: DepthAndTarget,
    *,
    places: Mapping[str, float],
    positions: int,
    samples: int,
    progress: Callable[[float], None] = lambda done: None,
) -> dict[str, PlaceGrain]:
    """Measure grain at each place, from two focal stacks of the scene at rest over the whole travel.

    Raises BadInput for a scene that cannot be rendered.
    """
    planes = {name: round(position * (positions - 1)) for name, position in places.items()}
    box, kept = mask_bounding_box(seen.target), []
    for run in (1, 2):
        progress((run - 1) / 2)
        stack = renderer.render_stack(seen, positions=positions, samples=samples, run=run)
        kept.append({name: _mix_box(stack, k, box=box) for name, k in planes.items()})
    progress(1.0)
    return {
        name: _compare(kept[0][name], kept[1][name], position=places[name], mask=seen.target[box]) for name in places
    }


def measure_scene_grain_of_slices(
    renderer: SceneRenderer,
    seen: DepthAndTarget,
    *,
    places: Mapping[str, float],
    positions: int,
    samples: int,
    time_s: float | None = None,
    step_s: float = 0.0,
    progress: Callable[[float], None] = lambda done: None,
) -> dict[str, PlaceGrain]:
    """Measure grain at each place, from two time slices of a moment with two positions each.

    The moment is by default that at which the scene is shown at rest. Slices follow each other by ``step_s``, 0 for a
    scene that stands still: each takes its shading from those before it too.

    Raises BadInput for a scene that cannot be rendered.
    """
    box, found = mask_bounding_box(seen.target), {}
    for done, (name, position) in enumerate(places.items()):
        progress(done / len(places))
        one, other = _render_slice_pair(
            renderer, seen, position=position, positions=positions, samples=samples, time_s=time_s, step_s=step_s
        )
        found[name] = _compare(one[box], other[box], position=position, mask=seen.target[box])
    progress(1.0)
    return found


def correlate_scene_grain_of_slices(
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
    """Yield how much the grain of later slices is that of the slice at ``time_s``: steps on, and their correlation.

    The pixels are those of the target's box at ``time_s``. Raises BadInput for a scene that cannot be rendered.
    """
    box = mask_bounding_box(seen.target)

    def render_box(at_s: float) -> tuple[np.ndarray, np.ndarray]:
        pair = _render_slice_pair(
            renderer, seen, position=position, positions=positions, samples=samples, time_s=at_s, step_s=step_s
        )
        return pair[0][box], pair[1][box]

    earlier = render_box(time_s)
    for step in steps:
        yield step, correlate_stack_grain(earlier, render_box(time_s + step * step_s))


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
    """Render a moment twice with independent noise at the two positions round one; the nearer one, (row, col) each."""
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
    whole = (slice(None), slice(None))
    return _mix_box(one, nearer, box=whole), _mix_box(other, nearer, box=whole)


def _mix_box(stack: FocalStack, plane: int, *, box: Region) -> np.ndarray:
    """Return a region of one plane with all lights on, float64 (row, col)."""
    return stack.radiance[:, plane, box[0], box[1]].sum(axis=0, dtype=np.float64)


def _compare(first: np.ndarray, second: np.ndarray, *, position: float, mask: np.ndarray) -> PlaceGrain:
    return PlaceGrain(position, estimate_stack_grain(first, second), estimate_stack_grain(first, second, mask=mask))
