"""Grain, measured by rendering pictures twice with independent noise: stored focal stacks, and any scene.

**Stored stacks.** The second render is made like the first, with the same code, lens and light. It differs in its
number of samples. This number is part of a stack's key, from which the seeds of its paths are derived, so the noise is
independent. A stack of a still scene is rendered again with an eighth of its samples. For a moving scene, a few time
slices spread evenly over the recording are rendered again with half of their samples, together with the slice whose
lens is nearest to the focus of its target.

**Scenes.** Both renders have the same number of samples. All lights have gain 1, as on the card; the region is the box
around the target at best focus.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from saf_gen.core.files import temporary_folder
from saf_gen.core.region import bounding_box
from saf_gen.render import render_missing
from saf_gen.render.depth_and_target import DepthAndTarget
from saf_gen.render.scene_renderer import SceneRenderer
from saf_gen.scene.scene_folder import Scene
from saf_gen.stack.focal_stack import FocalStack, StackSpec, StackStore
from saf_gen.stack.grain import Grain, estimate_grain, measure_pictures, read_grain, write_grain
from saf_gen.stack.same_scene import require_same_scene
from saf_gen.stack.second_render import second_render, stacks_to_repeat
from saf_gen.stack.time_resolved import SHADING_MOMENTS

MEASURED_POSITIONS = 33  # number of evenly spaced positions that are measured per stack


def measure_by_repeat(
    scene: Scene,
    specs: Sequence[StackSpec],
    *,
    root: Path,
    backend_name: str,
    wanted: Collection[StackSpec] | None = None,
    threads: int | None = None,
    progress: Callable[[str, float], None] = lambda name, done: None,
) -> None:
    """Measure the grain of a scene's stored stacks if it has not been measured, and store it next to them.

    Parameters
    ----------
    scene : Scene
        Member of the scene's family.
    specs : sequence of StackSpec
        One stack of a still scene, or one for each of many moments; stacks that see no target have no grain to measure.
        Depth and target of all of them must be stored.
    wanted : collection of StackSpec, optional
        Those among them whose grain is measured, if it is measured for all of them at all; by default all.
    root, backend_name, threads, progress
        See :func:`saf_gen.render.render_missing`.

    Raises
    ------
    BadInput
        If :func:`saf_gen.render.render_missing` raises it, or if the scene's script returned something else this time.
    """
    chosen = stacks_to_repeat(specs, root)
    again = {spec: second_render(spec, slices=len(specs)) for spec in chosen}
    todo = [s for s in chosen if (wanted is None or s in wanted) and read_grain(root, s) is None]
    if not todo:
        return
    with temporary_folder(root / "grain") as folder:
        for spec in todo:  # what the lens sees is not traced again
            depth, target = StackStore(root, spec).load_geometry()
            StackStore(folder, again[spec]).write_geometry(depth, target, backend=backend_name)
        render_missing(
            scene,
            list(again.values()),
            root=folder,
            backend_name=backend_name,
            wanted=[again[spec] for spec in todo],
            threads=threads,
            progress=lambda name, done: progress("grain", done),
        )
        for sums in StackStore(folder, again[todo[0]]).scene_sums()[:1]:
            require_same_scene(root, specs, sums=sums)
        for spec in todo:
            planes = StackStore(folder, again[spec]).load_planes(0, spec.rendered_count)
            _compare_stored(spec, planes, root=root, samples=again[spec].samples)


def _compare_stored(spec: StackSpec, again: np.ndarray, *, root: Path, samples: int) -> None:
    """Measure and store the grain of a stored stack, from its pictures rendered again with these samples."""
    store = StackStore(root, spec)
    depth, target = store.load_geometry()
    grain = measure_pictures(
        store.load_planes(0, spec.rendered_count),
        again,
        target=target,
        samples=(spec.samples, samples),
        indices=_choose_positions(spec, spec.in_focus.true_focus(depth, target)),
    )
    write_grain(root, spec, grain=grain)


def _choose_positions(spec: StackSpec, true_focus: float) -> np.ndarray:
    """Return the indices of the rendered positions to measure: evenly spaced, and the nearest to the true focus."""
    evenly = (
        np.linspace(0, spec.rendered_count - 1, min(spec.rendered_count, MEASURED_POSITIONS)).round().astype(np.int64)
    )
    return np.union1d(evenly, np.abs(spec.focus - true_focus).argmin())


@dataclass(frozen=True)
class TargetGrain:
    """The grain of a picture in the box around the target, and in the pixels of the target."""

    box: Grain
    target: Grain


def measure_still(
    renderer: SceneRenderer, seen: DepthAndTarget, *, at: Mapping[str, float], positions: int, samples: int
) -> dict[str, TargetGrain]:
    """Return the grain at some positions, measured from two focal stacks over the whole travel of the scene at rest.

    Parameters
    ----------
    renderer : SceneRenderer
        Renderer of the scene.
    seen : DepthAndTarget
        Depth map and target of the scene.
    at : mapping of str to float
        Positions of the lens (0 to 1) by name.
    positions : int
        Number of positions of the focal stack.
    samples : int
        Samples per pixel.

    Raises
    ------
    BadInput
        If the scene cannot be rendered.
    """

    def render(run: int) -> dict[str, np.ndarray]:
        stack = renderer.render_stack(seen, positions=positions, samples=samples, run=run)
        return {name: _mix(stack, round(position * (positions - 1)), seen=seen) for name, position in at.items()}

    first, second = render(1), render(2)
    return {name: _compare((first[name], second[name]), seen) for name in at}


def measure_slices(
    renderer: SceneRenderer,
    seen: DepthAndTarget,
    *,
    at: Mapping[str, float],
    positions: int,
    samples: int,
    time_s: float | None = None,
    step_s: float = 0.0,
) -> dict[str, TargetGrain]:
    """Return the grain at some positions, measured from two renders of a time slice with two positions each.

    Parameters
    ----------
    renderer, seen, at, samples
        See :func:`measure_still`.
    positions : int
        Number of positions of the focal stack; only the two around each measured position are rendered.
    time_s : float, optional
        Time of the slice (seconds); by default the moment at which the scene is shown at rest.
    step_s : float, default 0
        Time between slices (seconds), 0 for a scene at rest; a slice shares the shading of the slices before it.

    Raises
    ------
    BadInput
        If the scene cannot be rendered.
    """
    size = {"positions": positions, "samples": samples}
    return {
        name: _compare(render_slice_twice(renderer, seen, position=x, **size, time_s=time_s, step_s=step_s), seen)
        for name, x in at.items()
    }


def render_slice_twice(
    renderer: SceneRenderer,
    seen: DepthAndTarget,
    *,
    position: float,
    positions: int,
    samples: int,
    time_s: float | None = None,
    step_s: float = 0.0,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the target's box in two renders of a moment with independent noise, each float64 (row, col).

    The two positions around ``position`` are rendered, and the nearer one is returned. The parameters are those of
    :func:`measure_slices`.
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
    return _mix(one, nearer, seen=seen), _mix(other, nearer, seen=seen)


def _mix(stack: FocalStack, plane: int, *, seen: DepthAndTarget) -> np.ndarray:
    """Return the target's box in a focus plane with all lights on, float64 (row, col)."""
    rows, columns = bounding_box(seen.target)
    return stack.radiance[:, plane, rows, columns].sum(axis=0, dtype=np.float64)


def _compare(pair: tuple[np.ndarray, np.ndarray], seen: DepthAndTarget) -> TargetGrain:
    mask = seen.target[bounding_box(seen.target)]
    return TargetGrain(estimate_grain(*pair), estimate_grain(*pair, mask=mask))
