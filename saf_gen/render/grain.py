"""Grain, measured by rendering pictures twice with independent noise: stored focal stacks, and any scene.

**Stored stacks.** The second render is made like the first, with the same code, lens and light. It differs in its
number of samples. This number is part of a stack's key, from which the seeds of its paths are derived, so the noise is
independent. A stack of a still scene is rendered again with an eighth of its samples. For a moving scene, a few time
slices spread evenly over the recording are rendered again with half of their samples, together with the slice whose
lens is nearest to the focus of its target.

**Scenes.** Both renders have the same number of samples. All lights have gain 1, as on the card; the region is the box
around the target at best focus.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from saf_gen.core.files import temporary_folder
from saf_gen.core.region import bounding_box
from saf_gen.render import Renderer, render_missing
from saf_gen.render.depth_and_target import DepthAndTarget
from saf_gen.scene.scene_folder import Scene
from saf_gen.stack.focal_stack import FocalStack, StackSpec, StackStore
from saf_gen.stack.grain import Grain, estimate_grain, measure_pictures, read_grain, write_grain
from saf_gen.stack.time_resolved import SHADING_MOMENTS

# Samples of a stack divided by the samples of its second render. A second render of 8 samples takes 16 to 19 % of the
# processor time of a stack of 64. Noise falls faster than 1/samples, so noise over signal in C² comes out too large by
# a factor of 1.2 (usaf_target) to 1.5 (low_texture). A second render of 4 samples takes 10 to 12 %, and the factor is
# 1.3 to 2.1. Both scatter by 2 to 3 %.
STILL_DIVISOR, SLICE_DIVISOR = 8, 2
MEASURED_POSITIONS = 33  # number of evenly spaced positions that are measured per stack
MAX_SLICES, SLICE_STRIDE = 6, 12  # per recording: at most this many time slices, and at most one in this many


def measure_by_repeat(
    scene: Scene,
    specs: Sequence[StackSpec],
    *,
    root: Path,
    backend_name: str,
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
    root, backend_name, threads, progress
        See :func:`saf_gen.render.render_missing`.

    Raises
    ------
    BadInput
        If :func:`saf_gen.render.render_missing` raises it.
    """
    chosen = stacks_to_repeat(specs, root)
    todo = [spec for spec in chosen if read_grain(root, spec) is None]
    if not todo:
        return
    if scene.card.section is not None:  # nothing is random: a second run would give the same pictures
        for spec in todo:
            _compare_stored(spec, StackStore(root, spec).load_planes(0, spec.rendered_count), root=root, samples=1)
        return
    divisor = SLICE_DIVISOR if len(specs) > 1 else STILL_DIVISOR
    again = [replace(spec, samples=_fewer(spec.samples, divisor)) for spec in todo]
    with temporary_folder(root / "grain") as folder:
        render_missing(
            scene,
            again,
            root=folder,
            backend_name=backend_name,
            threads=threads,
            progress=lambda name, done: progress("grain", done),
        )
        for spec, second in zip(todo, again, strict=True):
            planes = StackStore(folder, second).load_planes(0, spec.rendered_count)
            _compare_stored(spec, planes, root=root, samples=second.samples)


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


def stacks_to_repeat(specs: Sequence[StackSpec], root: Path) -> list[StackSpec]:
    """Return the stored stacks whose grain is measured; for a moving scene, a few slices that see the target."""
    seen = []
    for spec in specs:
        depth, target = StackStore(root, spec).load_geometry()
        if target.any():
            seen.append((spec, abs(float(spec.focus.mean()) - spec.in_focus.true_focus(depth, target))))
    if not seen:
        return []
    count = min(MAX_SLICES, max(len(seen) // SLICE_STRIDE, 1))
    chosen = {round(n) for n in np.linspace(0, len(seen) - 1, count + 2)[1:-1]}
    chosen.add(min(range(len(seen)), key=lambda n: seen[n][1]))
    return [seen[n][0] for n in sorted(chosen)]


def _choose_positions(spec: StackSpec, true_focus: float) -> np.ndarray:
    """Return the indices of the rendered positions to measure: evenly spaced, and the nearest to the true focus."""
    evenly = (
        np.linspace(0, spec.rendered_count - 1, min(spec.rendered_count, MEASURED_POSITIONS)).round().astype(np.int64)
    )
    return np.union1d(evenly, np.abs(spec.focus - true_focus).argmin())


def _fewer(samples: int, divisor: int) -> int:
    """Return ``samples`` // ``divisor``, at least 1, but never ``samples`` itself, whose seeds would be the same."""
    fewer = max(samples // divisor, 1)
    return fewer if fewer != samples else samples + 1


@dataclass(frozen=True)
class TargetGrain:
    """The grain of a picture in the box around the target, and in the pixels of the target."""

    box: Grain
    target: Grain


def measure_still(
    renderer: Renderer, seen: DepthAndTarget, *, at: Mapping[str, float], positions: int, samples: int
) -> dict[str, TargetGrain]:
    """Return the grain at some positions, measured from two focal stacks over the whole travel of the scene at rest.

    Parameters
    ----------
    renderer : Renderer
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
    renderer: Renderer,
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
    renderer: Renderer,
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
