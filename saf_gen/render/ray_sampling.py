"""The rays that a one-pass stack needs, and the spread of samples over them."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from saf_gen.optics import Drive
from saf_gen.stack.focal_stack import PixelGrid

# Kronecker sequence over pixel and lens (4 dimensions): powers of the root of x^5 = x + 1, in 0.32 fixed
# point. Any number of samples is spread well, where orthogonal arrays need the square of a prime.
# M. Roberts, "The unreasonable effectiveness of quasirandom sequences" (2018).
GOLDEN = 1.1673039782614187
STEPS = tuple(round(GOLDEN ** -(j + 1) * 2**32) & 0xFFFFFFFF for j in range(4))


@dataclass(frozen=True)
class RayCoverage:
    """The rays to sample at the middle position so that they include all rays of every position.

    ``rows`` and ``columns`` are the pixels to add to the sensor on each side, ``radius_m`` the radius of the disc of
    lens points.
    """

    rows: int
    columns: int
    radius_m: float


def compute_ray_coverage(
    drive: Drive, grid: PixelGrid, *, ends: tuple[float, float] = (0.0, 1.0), bend_reach_m: float = 0.0
) -> RayCoverage:
    """Return what to sample evenly at the middle of two positions so that all positions between are covered.

    The rays of a position (sensor × aperture) are traced back to the middle by the inverse of the drive's
    transfer. Its entries are monotone in the position, so the two ends are the extremes. The lens disc is
    larger than the aperture where lens and scene move against each other: a ray then passes the aperture at
    some positions and misses it at others. ``bend_reach_m`` is how far (m) waves may move a path on the sensor.
    """
    middle = sum(ends) / 2
    back = np.linalg.inv(drive.ray_transfer(np.array([ends[0], middle, ends[1]]), middle))
    radius, pitch = drive.aperture_radius_m, grid.pitch_m
    guards = []
    for pixels in (grid.rows, grid.columns):
        half = pixels / 2
        seen = half + bend_reach_m / pitch  # from where light comes onto the sensor
        reach = np.abs(back[:, 0, 0]) * seen + np.abs(back[:, 0, 1]) * radius / pitch
        guards.append(math.ceil(reach.max() - half) + 1)
    corner = math.hypot(grid.rows, grid.columns) / 2 * pitch + bend_reach_m
    lens = np.abs(back[:, 1, 0]) * corner + np.abs(back[:, 1, 1]) * radius
    return RayCoverage(guards[0], guards[1], float(lens.max()))


def place_ray_samples(pixel: Any, sample: Any, *, seed: int) -> tuple[Any, Any, Any]:
    """Return each sample's offsets in its pixel (two, in 0...1) and its point on the unit square of the lens.

    Every pixel shifts the same sequence by offsets of its own.

    References
    ----------
    R. Cranley and T. N. L. Patterson, SIAM J. Numer. Anal. 13, 904 (1976), doi:10.1137/0713071.
    """
    across, down, first, second = place_on_kronecker_sequence(pixel, sample, steps=STEPS, seed=seed)
    return across, down, mi.Point2f(first, second)


def place_on_kronecker_sequence(pixel: Any, sample: Any, *, steps: Iterable[int], seed: int) -> Iterator[Any]:
    """Yield each sample's coordinate (0...1) for each step of a Kronecker sequence, shifted by an offset of its pixel.

    ``steps`` are in 0.32 fixed point. Dimension j takes its offsets from the seed ``seed`` + j.
    """
    for j, step in enumerate(steps):
        word: Any = dr.opaque(mi.UInt32, (seed + j) & 0xFFFFFFFF)
        offset, _ = mi.sample_tea_32(pixel, word, 6)
        fixed = offset + sample * mi.UInt32(step)
        yield mi.Float(fixed >> 8) * 2.0**-24  # 24 bits: what a float32 holds below 1
