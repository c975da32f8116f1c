"""Grain: the noise that the renderer leaves in pictures of each scene, at rest and moving, and the time of a slice.

Each scene is rendered twice with independent noise, as for recordings of the project's recipes; the difference between
the two is grain. :mod:`saf_gen.stack.grain` defines the figures and their intervals.
"""

import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from saf_gen.camera import Sensor, get_sensor
from saf_gen.errors import SafGenError
from saf_gen.scene.scene_folder import Scene, find_scene, scene_names
from saf_gen.stack.focal_stack import StackSpec
from saf_gen.stack.grain import GrainFigure, correlate_grain
from studies.speed.bench import Figure, Size, fresh, main, memory_figure, timed

MAX_SLICE_S = {"fan": 1.9, "crossroad": 2.9, "cardiac_muscle": 0.7}
TIMED_SLICES = 3
LATER_SLICES = (1, 8)  # after the slice whose grain is compared with theirs
ENERGY_NAMES = {
    "contrast": "C²",
    "brenner": "Brenner",
    "tenengrad": "Tenengrad",
    "variance_of_laplacian": "the variance of the Laplacian",
}


def run(size: Size) -> Iterator[Figure | str]:
    """Yield the grain of each scene at rest and, if the scene moves, in its time slices, and the worst figures.

    Each scene has a process of its own. A scene that cannot be rendered is left out, with a remark. Raises BadInput if
    a requested scene is unknown, and the error of the last scene if none can be rendered.
    """
    figures: list[Figure] = []
    problem: SafGenError | None = None
    for name in [find_scene(name).id for name in size.scenes] or scene_names():
        try:
            found = fresh(measure_scene, name, size)
        except SafGenError as error:
            problem = error
            yield f"{name} is left out: {problem}"
            continue
        figures += found
        yield from found
    if problem is not None and not figures:
        raise problem
    yield from worst_figures(figures)


def measure_scene(name: str, size: Size) -> list[Figure]:
    """Return the figures of one scene, and the peak memory of this process."""
    return [
        *_figures(find_scene(name), get_sensor(size.sensor), size),
        replace(memory_figure(), what=f"{name}: memory"),
    ]


def _figures(scene: Scene, sensor: Sensor, size: Size) -> Iterator[Figure]:
    """Yield the figures of one scene, for the default member of its family."""
    from saf_gen.authoring.checks import grain as goals
    from saf_gen.render.grain import measure_slices, measure_still
    from saf_gen.render.scene_renderer import SceneRenderer

    full_renderer = SceneRenderer(scene, sensor, backend_name="auto", wavelength_m=sensor.wavelength_m)
    # Pixels outside the target's box cost time and are not used.
    cropped = goals.crop_sensor(sensor, full_renderer.trace_geometry().target)
    renderer = SceneRenderer(scene, cropped, backend_name="auto", wavelength_m=sensor.wavelength_m)
    seen = renderer.trace_geometry()
    truth = scene.build_drive().least_blur(seen.depth[seen.target])
    measured_positions = goals.grain_positions(truth)
    positions = size.positions[0]
    still = measure_still(renderer, seen, at=measured_positions, positions=positions, samples=size.still_samples)
    max_contrast = dict.fromkeys(measured_positions, goals.MAX_STILL_CONTRAST)
    yield from _position_figures(scene.id, "still", found=still, max_rms=None, max_contrast=max_contrast)
    if not (renderer.motions and scene.card.slices_per_s):
        return
    found = measure_slices(
        renderer,
        seen,
        at=measured_positions,
        positions=positions,
        samples=size.slice_samples,
        step_s=1 / scene.card.slices_per_s,
        time_s=scene.card.still_s,
    )
    max_contrast = {name: goals.MAX_SLICE_CONTRAST for name in measured_positions if name != goals.BEST_FOCUS}
    max_rms = goals.MAX_SLICE_RMS
    yield from _position_figures(scene.id, "slice", found=found, max_rms=max_rms, max_contrast=max_contrast)
    correlations = _correlate_slices(
        renderer,
        seen,
        position=truth,
        positions=positions,
        samples=size.slice_samples,
        time_s=scene.card.still_s,
        step_s=1 / scene.card.slices_per_s,
    )
    for steps, figure in correlations:
        later = "the next slice" if steps == 1 else f"the slice {steps} on"
        what = f"{scene.id}, slice, {goals.BEST_FOCUS}: correlation of grain with {later}"
        yield _percent(what, figure)
    seconds = _time_slices(full_renderer, size=size, position=truth)
    what = f"{scene.id}, slice: loaded, rendered at two positions and stored"
    yield Figure(what, seconds, "s", MAX_SLICE_S.get(scene.id), at_most=True)


def _correlate_slices(
    renderer: Any, seen: Any, *, position: float, time_s: float, step_s: float, **size: int
) -> Iterator[tuple[int, GrainFigure]]:
    """Yield the correlation between the grain of the slice at ``time_s`` and the grain of later slices.

    Each item is the number of slices between the two, and the correlation. The pixels are those of the target's box at
    ``time_s``; ``size`` holds the positions and samples of a stack.
    """
    from saf_gen.render.grain import render_slice_twice

    earlier = render_slice_twice(renderer, seen, position=position, time_s=time_s, step_s=step_s, **size)
    for steps in LATER_SLICES:
        at_s = time_s + steps * step_s
        later = render_slice_twice(renderer, seen, position=position, time_s=at_s, step_s=step_s, **size)
        yield steps, correlate_grain(earlier, later)


def _position_figures(
    scene: str, picture: str, *, found: Mapping[str, Any], max_rms: float | None, max_contrast: Mapping[str, float]
) -> Iterator[Figure]:
    """Yield the rms and the energies of grain in a scene's stills or slices, by position, in per cent, with goals."""
    for position_name, grain in found.items():
        label = f"{scene}, {picture}, {position_name}"
        yield _percent(f"{label}: rms over mean", grain.box.rms, goal=max_rms)
        yield _percent(f"{label}: rms over mean on the target alone", grain.target.rms)
        for energy, name in ENERGY_NAMES.items():
            goal = max_contrast.get(position_name) if energy == "contrast" else None
            figure = grain.box.noise_over_signal[energy]
            yield _percent(f"{label}: noise over signal in {name}", figure, goal=goal)


def _percent(what: str, figure: Any, *, goal: float | None = None) -> Figure:
    target = None if goal is None else 100 * goal
    return Figure(
        what, 100 * figure.value, "%", target, at_most=goal is not None, low=100 * figure.low, high=100 * figure.high
    )


def _time_slices(renderer: Any, *, size: Size, position: float) -> float:
    """Return the rendering time (seconds) per time slice of a recording with the lens at rest at ``position``."""
    from saf_gen.render import render_missing

    first = min(int(position * (size.positions[0] - 1)), size.positions[0] - 2)
    scene = renderer.scene
    first_spec = StackSpec.from_scene(
        scene,
        renderer.grid,
        positions=size.positions[0],
        samples=size.slice_samples,
        max_depth=6,
        time_s=scene.card.still_s,
        wavelength_m=renderer.wavelength_m,
        window=(first, first + 1),
    )
    step_s = 1 / (scene.card.slices_per_s or 1.0)
    specs = [replace(first_spec, time_s=first_spec.time_s + n * step_s) for n in range(2 + TIMED_SLICES)]
    with TemporaryDirectory() as folder:
        options: dict[str, Any] = {"root": Path(folder), "backend_name": renderer.backend_name}
        render_missing(scene, specs[:1], **options)  # compiles
        # A recording builds its scene only once; this time cancels in the difference between several slices and one.
        _, one_s = timed(render_missing, scene, specs[1:2], **options)
        _, several_s = timed(render_missing, scene, specs[2:], **options)
    return max(several_s - one_s, 0.0) / (TIMED_SLICES - 1)


def worst_figures(figures: Sequence[Figure]) -> Iterator[Figure]:
    """Yield the worst figure of each kind that has a goal, with its scene and position."""
    kinds = {
        "worst slice: rms over mean": (", slice,", "rms over mean"),
        "worst slice away from focus: noise over signal in C²": (", slice,", "C²"),
        "worst still: noise over signal in C²": (", still,", "C²"),
    }
    for what, (kind, figure) in kinds.items():
        found = [f for f in figures if f.target is not None and kind in f.what and f.what.endswith(figure)]
        found = [f for f in found if not math.isnan(f.value)]
        if found:
            worst = max(found, key=lambda f: f.value)
            yield replace(worst, what=f"{what} ({worst.what.partition(':')[0]})")


if __name__ == "__main__":
    sys.exit(main(run))
