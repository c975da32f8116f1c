"""The grain of stored focal stacks, measured by comparing each stack with a second, cheaper render.

The second render is made like the first, with the same code, lens and light. It differs in its number of samples. This
number is part of a stack's key, from which the seeds of its paths are derived, so the noise is independent.

A stack of a still scene is rendered again with an eighth of its samples. For a moving scene, a few time slices spread
evenly over the recording are rendered again with half of their samples, together with the slice whose lens is nearest
to the focus of its target.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from saf_gen.core.files import temporary_folder
from saf_gen.render import render_missing
from saf_gen.scene.scene_folder import Scene
from saf_gen.stack.focal_stack import StackSpec, StackStore
from saf_gen.stack.stack_grain import measure_pictures, read_grain, write_grain

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
            store = StackStore(root, spec)
            depth, target = store.load_geometry()
            grain = measure_pictures(
                store.load_planes(0, spec.rendered_count),
                StackStore(folder, second).load_planes(0, spec.rendered_count),
                target=target,
                samples=(spec.samples, second.samples),
                indices=_choose_positions(spec, spec.drive.true_focus(depth[target])),
            )
            write_grain(root, spec, grain=grain)


def stacks_to_repeat(specs: Sequence[StackSpec], root: Path) -> list[StackSpec]:
    """Return the stored stacks whose grain is measured; for a moving scene, a few slices that see the target."""
    seen = []
    for spec in specs:
        depth, target = StackStore(root, spec).load_geometry()
        if target.any():
            seen.append((spec, abs(float(spec.focus.mean()) - spec.drive.true_focus(depth[target]))))
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
