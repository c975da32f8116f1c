"""One pass over all focus positions, compared with Mitsuba's thin lens rendered at each position.

Plain paths are compared at equal samples, and shared shading at equal error: to reach it, the thin lens needs more
samples by the ratio of the squared errors.

Both renderers use the same scene, sensor grid and number of samples, and geometric optics, because the thin lens has no
waves. The thin lens has a box filter, and its focus distance is a variable, so that it is compiled once. Both errors
are measured against the mean of many thin-lens renders with other seeds; the noise of this reference, known from the
scatter of the renders, is subtracted.
"""

import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from saf_gen.camera import get_sensor
from saf_gen.core import seeds
from saf_gen.errors import BadInput
from saf_gen.scene.scene_folder import find_scene
from studies.speed.bench import Figure, Size, main, shape_text, timed

POSITIONS = (0.0, 0.25, 0.5, 0.75, 1.0)
SCENE = "usaf_target"  # cheap to trace, so the ratio is at its lowest
TARGETS = (45.0, 150.0)
EQUAL_ERROR_TARGET = 100.0
MAX_ERROR_DB = 0.2
MIN_ERROR = 1e-9  # of the mean radiance; a smaller error cannot be distinguished from the noise of the reference


@dataclass(frozen=True)
class Reference:
    """A reference: the mean of renders, float64 (row, col), and the variance of that mean, averaged over pixels."""

    radiance: np.ndarray
    noise: float

    def relative_rms_error(self, image: np.ndarray) -> float:
        """Return the rms error of an image as a fraction of the mean radiance; 0 if it is below the noise."""
        square = float(np.mean((image - self.radiance) ** 2)) - self.noise
        return math.sqrt(max(square, 0.0)) / float(self.radiance.mean())


def set_up_scene(sensor: str, scene: str = SCENE) -> tuple[Any, str]:
    """Return the RenderSetup of a scene with all lamps on, and the active backend, 'llvm' or 'cuda'.

    Raises BadInput if this machine has neither.
    """
    from saf_gen.render import backend, mitsuba_scene
    from saf_gen.render.render_setup import RenderSetup

    chosen = backend.choose_backend("auto")
    if chosen == "scalar":
        raise BadInput("the focal stack in one pass needs the variant llvm or cuda", hint=backend.ADVICE)
    backend.activate_backend(chosen)
    found, camera = find_scene(scene), get_sensor(sensor)
    lamps = tuple(emitter for group in found.card.lights.values() for emitter in group)
    loaded, integrator = mitsuba_scene.load_lit_scene(mitsuba_scene.scene_dict(found), lamps, max_depth=6)
    pose, unit_m = mitsuba_scene.camera_to_world(found), found.card.unit_m
    return RenderSetup(loaded, integrator, pose, found.build_drive(), camera, unit_m), chosen


def nearest_positions(positions: int) -> list[float]:
    """Return the positions nearest to POSITIONS in a stack of this many positions."""
    return [round(position * (positions - 1)) / (positions - 1) for position in POSITIONS]


def render_one_pass(setup: Any, positions: int, *, samples: int) -> np.ndarray:
    """Return the focal stack rendered in one pass with plain paths, float32 (focus, row, col)."""
    from saf_gen.render import one_pass

    return one_pass.render_stack(setup, positions=positions, samples=samples, seed=1)[0]


def render_filtered(setup: Any, positions: int, *, samples: int) -> np.ndarray:
    """Return the focal stack rendered in one pass with shared shading, float32 (focus, row, col)."""
    from saf_gen.render import filtered_pass

    lamps = [shape.id() for shape in setup.mitsuba_scene.shapes() if shape.is_emitter()]
    shading = filtered_pass.gather_shading({"all": setup}, samples=samples, seed=1, emitting=lamps)
    field = filtered_pass.estimate_shading([shading])
    found = filtered_pass.render_with_shading(
        {"all": setup}, field, positions=positions, samples=samples, seed=2, emitting=lamps
    )
    return found["all"][0]


def render_thin_lens(setup: Any, position: float, *, samples: int, seed: int) -> np.ndarray:
    """Return one position (0 to 1) rendered with Mitsuba's thin lens, float32 (row, col)."""
    from saf_gen.render import thin_lens

    derived = seeds.derive_seed("bench", "thin lens", seed)
    return thin_lens.render_position(setup, position=position, samples=samples, seed=derived)


def render_reference(setup: Any, position: float, *, samples: int, batch: int) -> tuple[Reference, list[float]]:
    """Return a reference of ``samples`` samples per pixel, and the seconds of each of its renders.

    The reference is the mean of at least two renders of ``batch`` samples, which need less memory than a single render.
    """
    rendered = [
        timed(render_thin_lens, setup, position, samples=batch, seed=1 + n) for n in range(max(2, samples // batch))
    ]
    renders = np.stack([image for image, _ in rendered]).astype(np.float64)
    noise = float(renders.var(axis=0, ddof=1).mean()) / len(renders)
    return Reference(renders.mean(axis=0), noise), [seconds for _, seconds in rendered]


def run(size: Size) -> Iterator[Figure | str]:
    """Yield the times of one pass and of thin-lens renders at as many positions, and compare their errors and times."""
    setup, chosen = set_up_scene(size.sensor)
    render_thin_lens(setup, 0.5, samples=size.samples, seed=0)  # compiles
    usual, _ = size.positions
    render_seconds: list[float] = []
    references: list[Reference] = []
    for position in nearest_positions(usual):
        found, seconds = render_reference(setup, position, samples=size.reference, batch=size.samples)
        references.append(found)
        render_seconds += seconds
    one_render = float(np.median(render_seconds))
    workload = f"{shape_text((setup.grid.rows, setup.grid.columns))}, {size.samples} samples per pixel, {chosen}"
    yield Figure(f"one thin-lens render, {workload}", one_render, "s")
    for positions, target in zip(size.positions, TARGETS, strict=True):
        render_one_pass(setup, positions, samples=size.samples)  # compiles a kernel for these two numbers
        stack, one_pass_seconds = timed(render_one_pass, setup, positions, samples=size.samples)
        yield Figure(f"one pass, {positions} positions, {workload}", one_pass_seconds, "s")
        times_faster = positions * one_render / one_pass_seconds
        yield Figure(f"times faster than {positions} thin-lens renders", times_faster, "×", target)
        if positions == usual:
            rate = setup.grid.rows * setup.grid.columns * size.samples / one_pass_seconds / 1e6
            yield Figure(f"light paths, each at {positions} positions", rate, "10⁶ samples/s")
            yield from _compare_errors(size, setup, references=references, stack=stack)
            yield from _compare_at_equal_error(size, setup, references=references, one_render=one_render)


def _compare_errors(size: Size, setup: Any, *, references: list[Reference], stack: np.ndarray) -> Iterator[Figure]:
    ours, theirs = [], []
    for position, found in zip(nearest_positions(len(stack)), references, strict=True):
        ours.append(found.relative_rms_error(stack[round(position * (len(stack) - 1))]))
        theirs.append(found.relative_rms_error(render_thin_lens(setup, position, samples=size.samples, seed=0)))
    at = f"at {size.samples} samples, {len(POSITIONS)} positions"
    yield Figure(f"error of one pass {at}", 100 * float(np.mean(ours)), "% of mean radiance")
    yield Figure(f"error of the thin lens {at}", 100 * float(np.mean(theirs)), "% of mean radiance")
    worst = max(20 * math.log10(max(a, MIN_ERROR) / max(b, MIN_ERROR)) for a, b in zip(ours, theirs, strict=True))
    what = "error of one pass, relative to the thin lens at equal samples, worst position"
    yield Figure(what, worst, "dB", MAX_ERROR_DB, at_most=True)


def _compare_at_equal_error(
    size: Size, setup: Any, *, references: list[Reference], one_render: float
) -> Iterator[Figure]:
    """Yield time and error of shared shading, and its speed relative to thin-lens renders of the same error."""
    samples, (positions, _) = size.still_samples, size.positions
    render_filtered(setup, positions, samples=samples)  # compiles
    stack, seconds = timed(render_filtered, setup, positions, samples=samples)
    squares = []
    for position, found in zip(nearest_positions(positions), references, strict=True):
        ours = found.relative_rms_error(stack[round(position * (positions - 1))])
        theirs = found.relative_rms_error(render_thin_lens(setup, position, samples=samples, seed=0))
        squares.append((ours**2, theirs**2))
    ours_squared, theirs_squared = np.mean(squares, axis=0)
    at = f"at {samples} samples, {len(POSITIONS)} positions"
    yield Figure(f"one pass with shared shading {at}", seconds, "s")
    error = 100 * math.sqrt(ours_squared)
    yield Figure(f"error of shared shading {at}", error, "% of mean radiance")
    thin_lens_seconds = positions * one_render * samples / size.samples
    faster = thin_lens_seconds / seconds * theirs_squared / max(ours_squared, MIN_ERROR**2)
    what = f"times faster than {positions} thin-lens renders of equal error"
    yield Figure(what, faster, "×", EQUAL_ERROR_TARGET)


if __name__ == "__main__":
    sys.exit(main(run))
