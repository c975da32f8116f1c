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

from saf_gen import seeds
from saf_gen.bench.child import timed
from saf_gen.bench.figure import Figure, Size, array
from saf_gen.camera import get_sensor
from saf_gen.cluster import Tell
from saf_gen.errors import BadInput
from saf_gen.scene import find_scene

__all__ = ["PLACES", "Reference", "measure", "one_pass", "places", "reference", "set_up", "thin_lens"]

PLACES = (0.0, 0.25, 0.5, 0.75, 1.0)
SCENE = "usaf_target"  # cheap to trace, so the hard case for the ratio
TARGETS = (45.0, 150.0)
MOST_DB = 0.2
LEAST = 1e-9  # of the mean radiance: an error that cannot be told from the reference's noise


@dataclass(frozen=True)
class Reference:
    """radiance : mean of renders, float64 (row, col). noise : mean over pixels of that mean's variance."""

    radiance: np.ndarray
    noise: float

    def error(self, image: np.ndarray) -> float:
        """Root mean square error of an image as a share of the mean radiance; 0 where it is below noise."""
        square = float(np.mean((image - self.radiance) ** 2)) - self.noise
        return math.sqrt(max(square, 0.0)) / float(self.radiance.mean())


def set_up(sensor: str, scene: str = SCENE) -> tuple[Any, str]:
    """The scene before the lens with every lamp burning, and the variant in use: (Setup, 'llvm' or 'cuda').

    Raises BadInput where this machine has no JIT variant.
    """
    from saf_gen.render import variant, world
    from saf_gen.render.film import Film, Setup

    chosen = variant.choose("auto", variant.probe())
    if chosen == "scalar":
        raise BadInput("the focal stack in one pass needs a JIT variant", hint=variant.ADVICE)
    variant.use(chosen)
    found, camera = find_scene(scene), get_sensor(sensor)
    lamps = tuple(emitter for group in found.card.lights.values() for emitter in group)
    loaded, integrator = world.load(world.build(found), lamps, 6)
    film = Film(camera.rows, camera.columns, camera.pitch_m)
    pose, unit_m = world.camera_to_world(found), found.card.unit_m
    return Setup(loaded, integrator, pose, found.drive(), film, unit_m), chosen


def places(positions: int) -> list[float]:
    """The positions of a stack nearest to PLACES."""
    return [round(place * (positions - 1)) / (positions - 1) for place in PLACES]


def one_pass(setup: Any, positions: int, samples: int) -> np.ndarray:
    """The focal stack, float32 (focus, row, col)."""
    from saf_gen.render import one_pass as renderer

    return renderer.render_stack(setup, positions=positions, samples=samples, seed=1)[0]


def thin_lens(setup: Any, place: float, samples: int, seed: int) -> np.ndarray:
    """Mitsuba's own picture with the lens at ``place`` (0 ... 1 of the travel), float32 (row, col)."""
    from saf_gen.render import thinlens

    word = seeds.integer("bench", "thin lens", seed)
    return thinlens.render_at(setup, position=place, samples=samples, seed=word)


def reference(setup: Any, place: float, *, samples: int, batch: int) -> tuple[Reference, list[float]]:
    """The mean of renders of ``batch`` samples, at least two, that hold ``samples`` together; and the time
    (s) of each. One render of them all would need many times the memory."""
    done = [timed(thin_lens, setup, place, batch, 1 + n) for n in range(max(2, samples // batch))]
    renders = np.stack([image for image, _ in done]).astype(np.float64)
    noise = float(renders.var(axis=0, ddof=1).mean()) / len(renders)
    return Reference(renders.mean(axis=0), noise), [took for _, took in done]


def measure(size: Size, tell: Tell) -> Iterator[Figure | str]:
    """Time of one pass and of as many renders, and the error of both at equal samples."""
    setup, chosen = set_up(size.sensor)
    thin_lens(setup, 0.5, size.samples, 0)  # compiles
    usual, _ = size.positions
    apart: list[float] = []
    references: list[Reference] = []
    for done, place in enumerate(places(usual)):
        tell(f"reference of {size.reference} samples", done / len(PLACES))
        found, times = reference(setup, place, samples=size.reference, batch=size.samples)
        references.append(found)
        apart += times
    tell(f"reference of {size.reference} samples", 1.0)
    a_render = float(np.median(apart))
    workload = f"{array((setup.film.rows, setup.film.columns))}, {size.samples} samples a pixel, {chosen}"
    yield Figure("stack", f"one thin-lens render, {workload}", a_render, "s")
    for positions, target in zip(size.positions, TARGETS, strict=True):
        tell(f"one pass, {positions} positions", 0.0)
        one_pass(setup, positions, size.samples)  # compiles: both numbers are constants of its kernel
        tell(f"one pass, {positions} positions", 0.5)
        stack, together = timed(one_pass, setup, positions, size.samples)
        tell(f"one pass, {positions} positions", 1.0)
        yield Figure("stack", f"one pass, {positions} positions, {workload}", together, "s")
        times_faster = positions * a_render / together
        yield Figure("stack", f"times faster than {positions} thin-lens renders", times_faster, "×", target)
        if positions == usual:
            rate = setup.film.rows * setup.film.columns * size.samples / together / 1e6
            yield Figure("stack", f"light paths, each at {positions} positions", rate, "10⁶ samples/s")
            yield from _errors(size, setup, references, stack)


def _errors(size: Size, setup: Any, references: list[Reference], stack: np.ndarray) -> Iterator[Figure]:
    ours, theirs = [], []
    for place, found in zip(places(len(stack)), references, strict=True):
        ours.append(found.error(stack[round(place * (len(stack) - 1))]))
        theirs.append(found.error(thin_lens(setup, place, size.samples, 0)))
    at = f"at {size.samples} samples, {len(PLACES)} positions"
    yield Figure("stack", f"error of one pass {at}", 100 * float(np.mean(ours)), "% of mean radiance")
    yield Figure("stack", f"error of the thin lens {at}", 100 * float(np.mean(theirs)), "% of mean radiance")
    worst = max(20 * math.log10(max(a, LEAST) / max(b, LEAST)) for a, b in zip(ours, theirs, strict=True))
    what = "error of one pass over the thin lens's at equal samples, worst position"
    yield Figure("stack", what, worst, "dB", MOST_DB, at_most=True)
