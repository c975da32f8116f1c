"""One pass for all focus positions against Mitsuba's thin lens, position after position.

Both see the same scene, film and samples; the thin lens has a box filter and its focus distance in a
variable, so that nothing is compiled twice. The error of both is taken against one reference, the mean of
many thin-lens renders with other seeds; the reference's own noise, known from their scatter, is taken off.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from saf_gen.camera import get_sensor
from saf_gen.core import seeds
from saf_gen.errors import BadInput
from saf_gen.generate.executor import ReportProgress
from saf_gen.scene.scene_folder import find_scene
from saf_gen.speed.bench_figure import BenchFigure, BenchSize, format_shape
from saf_gen.speed.fresh_process import time_call

__all__ = [
    "POSITIONS",
    "ReferenceRender",
    "nearest_positions",
    "render_one_pass",
    "render_reference",
    "render_thin_lens",
    "run_bench",
    "set_up_scene",
]

POSITIONS = (0.0, 0.25, 0.5, 0.75, 1.0)
SCENE = "usaf_target"  # cheap to trace, so the hard case for the ratio
TARGETS = (45.0, 150.0)
MAX_ERROR_DB = 0.2
MIN_ERROR = 1e-9  # of the mean radiance: an error that cannot be told from the reference's noise


@dataclass(frozen=True)
class ReferenceRender:
    """radiance : mean of renders, float64 (row, col). noise : mean over pixels of that mean's variance."""

    radiance: np.ndarray
    noise: float

    def relative_rms_error(self, image: np.ndarray) -> float:
        """Root mean square error of an image as a share of the mean radiance; 0 where it is below noise."""
        square = float(np.mean((image - self.radiance) ** 2)) - self.noise
        return math.sqrt(max(square, 0.0)) / float(self.radiance.mean())


def set_up_scene(sensor: str, scene: str = SCENE) -> tuple[Any, str]:
    """The scene before the lens with every lamp burning, and the variant in use: (RenderSetup, 'llvm' or
    'cuda').

    Raises BadInput where this machine has no JIT variant.
    """
    from saf_gen.render import backend, mitsuba_scene
    from saf_gen.render.render_setup import RenderSetup

    chosen = backend.choose_backend("auto")
    if chosen == "scalar":
        raise BadInput("the focal stack in one pass needs a JIT variant", hint=backend.ADVICE)
    backend.activate_backend(chosen)
    found, camera = find_scene(scene), get_sensor(sensor)
    lamps = tuple(emitter for group in found.card.lights.values() for emitter in group)
    described = mitsuba_scene.build_scene_dict(found)
    loaded, integrator = mitsuba_scene.load_lit_scene(described, lamps, max_depth=6)
    pose, unit_m = mitsuba_scene.camera_to_world(found), found.card.unit_m
    return RenderSetup(loaded, integrator, pose, found.build_drive(), camera, unit_m), chosen


def nearest_positions(positions: int) -> list[float]:
    """The positions of a stack nearest to POSITIONS."""
    return [round(position * (positions - 1)) / (positions - 1) for position in POSITIONS]


def render_one_pass(setup: Any, positions: int, samples: int) -> np.ndarray:
    """The focal stack, float32 (focus, row, col)."""
    from saf_gen.render import one_pass

    return one_pass.render_stack(setup, positions=positions, samples=samples, seed=1)[0]


def render_thin_lens(setup: Any, position: float, samples: int, seed: int) -> np.ndarray:
    """Mitsuba's own picture with the lens at ``position`` (0 ... 1 of the travel), float32 (row, col)."""
    from saf_gen.render import thin_lens

    word = seeds.derive_seed("bench", "thin lens", seed)
    return thin_lens.render_position(setup, position=position, samples=samples, seed=word)


def render_reference(
    setup: Any, position: float, *, samples: int, batch: int
) -> tuple[ReferenceRender, list[float]]:
    """The mean of renders of ``batch`` samples, at least two, that hold ``samples`` together; and the time
    (s) of each. One render of them all would need many times the memory."""
    done = [
        time_call(render_thin_lens, setup, position, batch, 1 + n) for n in range(max(2, samples // batch))
    ]
    renders = np.stack([image for image, _ in done]).astype(np.float64)
    noise = float(renders.var(axis=0, ddof=1).mean()) / len(renders)
    return ReferenceRender(renders.mean(axis=0), noise), [took for _, took in done]


def run_bench(size: BenchSize, report: ReportProgress) -> Iterator[BenchFigure | str]:
    """Time of one pass and of as many renders, and the error of both at equal samples."""
    setup, chosen = set_up_scene(size.sensor)
    render_thin_lens(setup, 0.5, size.samples, 0)  # compiles
    usual, _ = size.positions
    apart: list[float] = []
    references: list[ReferenceRender] = []
    for done, position in enumerate(nearest_positions(usual)):
        report(f"reference of {size.reference} samples", done / len(POSITIONS))
        found, times = render_reference(setup, position, samples=size.reference, batch=size.samples)
        references.append(found)
        apart += times
    report(f"reference of {size.reference} samples", 1.0)
    a_render = float(np.median(apart))
    workload = (
        f"{format_shape((setup.grid.rows, setup.grid.columns))}, {size.samples} samples a pixel, {chosen}"
    )
    yield BenchFigure("stack", f"one thin-lens render, {workload}", a_render, "s")
    for positions, target in zip(size.positions, TARGETS, strict=True):
        report(f"one pass, {positions} positions", 0.0)
        render_one_pass(setup, positions, size.samples)  # compiles: both numbers are constants of its kernel
        report(f"one pass, {positions} positions", 0.5)
        stack, together = time_call(render_one_pass, setup, positions, size.samples)
        report(f"one pass, {positions} positions", 1.0)
        yield BenchFigure("stack", f"one pass, {positions} positions, {workload}", together, "s")
        times_faster = positions * a_render / together
        yield BenchFigure(
            "stack", f"times faster than {positions} thin-lens renders", times_faster, "×", target
        )
        if positions == usual:
            rate = setup.grid.rows * setup.grid.columns * size.samples / together / 1e6
            yield BenchFigure("stack", f"light paths, each at {positions} positions", rate, "10⁶ samples/s")
            yield from _errors(size, setup, references, stack)


def _errors(
    size: BenchSize, setup: Any, references: list[ReferenceRender], stack: np.ndarray
) -> Iterator[BenchFigure]:
    ours, theirs = [], []
    for position, found in zip(nearest_positions(len(stack)), references, strict=True):
        ours.append(found.relative_rms_error(stack[round(position * (len(stack) - 1))]))
        theirs.append(found.relative_rms_error(render_thin_lens(setup, position, size.samples, 0)))
    at = f"at {size.samples} samples, {len(POSITIONS)} positions"
    yield BenchFigure("stack", f"error of one pass {at}", 100 * float(np.mean(ours)), "% of mean radiance")
    yield BenchFigure(
        "stack", f"error of the thin lens {at}", 100 * float(np.mean(theirs)), "% of mean radiance"
    )
    worst = max(
        20 * math.log10(max(a, MIN_ERROR) / max(b, MIN_ERROR)) for a, b in zip(ours, theirs, strict=True)
    )
    what = "error of one pass over the thin lens's at equal samples, worst position"
    yield BenchFigure("stack", what, worst, "dB", MAX_ERROR_DB, at_most=True)
