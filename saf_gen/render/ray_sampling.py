"""The rays that a one-pass stack needs, and how samples are spread over them."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from saf_gen.optics import Drive
from saf_gen.stack.focal_stack import PixelGrid


@dataclass(frozen=True)
class RayCoverage:
    """The rays to sample at the middle position so that they include all rays of every position.

    Attributes
    ----------
    rows, columns : int
        Pixels to add to the sensor on each side.
    radius_m : float
        Radius of the disc of lens points.
    """

    rows: int
    columns: int
    radius_m: float


def ray_coverage(
    drive: Drive, grid: PixelGrid, *, ends: tuple[float, float] = (0.0, 1.0), bend_reach_m: float = 0.0
) -> RayCoverage:
    """Return the rays to sample evenly midway between two positions so that all positions in between are covered.

    The rays of a position (sensor × aperture) are traced back to the middle by the inverse of the drive's transfer
    matrix. Its entries are monotone in the position, so the two ends are the extremes. The lens disc is larger than the
    aperture if lens and scene move against each other: a ray then passes the aperture at some positions and misses it
    at others. ``bend_reach_m`` is the largest distance (m) by which waves move a path on the sensor.
    """
    middle = sum(ends) / 2
    back = np.linalg.inv(drive.ray_transfer(np.array([ends[0], middle, ends[1]]), middle))
    radius, pitch = drive.aperture_radius_m, grid.pitch_m
    guards = []
    for pixels in (grid.rows, grid.columns):
        half = pixels / 2
        seen = half + bend_reach_m / pitch  # light from here reaches the sensor
        reach = np.abs(back[:, 0, 0]) * seen + np.abs(back[:, 0, 1]) * radius / pitch
        guards.append(math.ceil(reach.max() - half) + 1)
    corner = math.hypot(grid.rows, grid.columns) / 2 * pitch + bend_reach_m
    lens = np.abs(back[:, 1, 0]) * corner + np.abs(back[:, 1, 1]) * radius
    return RayCoverage(guards[0], guards[1], float(lens.max()))


def place_samples(pixel: Any, sample: Any, *, samples: int, seed: int) -> tuple[Any, Any, Any]:
    """Return each ray's two offsets in its pixel (0 to 1), and its point on the unit square of the lens.

    The rays of a pixel follow Sobol's sequence in two dimensions over the pixel. Over the lens they follow the same
    sequence, but each group of ``samples`` rays in a different order. Every part of pixel and lens is thus sampled in
    proportion to its area. Each pixel flips the binary digits of the sequence by its own random words and has its own
    order.

    References
    ----------
    I. M. Sobol', USSR Comput. Math. Math. Phys. 7(4), 86 (1967), doi:10.1016/0041-5553(67)90144-9.
    T. Kollig and A. Keller, Comput. Graph. Forum 21, 557 (2002), doi:10.1111/1467-8659.00706, for the flipped digits.
    """
    words: list[Any] = []
    for j in range(3):
        word: Any = dr.opaque(mi.UInt32, (seed + j) & 0xFFFFFFFF)
        words += mi.sample_tea_32(pixel, word, 6)
    across, down, first, second, order, _ = words
    in_block = sample % dr.opaque(mi.UInt32, samples)
    other = permute_samples(in_block, samples, word=order) + (sample - in_block)
    return (
        _fraction(dr.brev(sample) ^ across),
        _fraction(_second_of_sobol(sample) ^ down),
        mi.Point2f(_fraction(dr.brev(other) ^ first), _fraction(_second_of_sobol(other) ^ second)),
    )


def permute_samples(index: Any, samples: int, *, word: Any) -> Any:
    """Return the image of ``index`` under the permutation of 0...``samples`` - 1 that ``word`` selects, uint32 (ray,).

    The result equals Mitsuba's ``permute_kensler`` bit for bit. There the number of samples is a constant of the
    kernel, which would be compiled for each number. A round permutes the numbers up to the next power of two; numbers
    that end at ``samples`` or above go through another round.

    References
    ----------
    A. Kensler, "Correlated Multi-Jittered Sampling", Pixar Technical Memo 13-01 (2013).
    """
    length, mask = (dr.opaque(mi.UInt32, n) for n in (samples, (1 << (samples - 1).bit_length()) - 1))

    def mix(i: Any) -> Any:
        i = (i ^ word) * 0xE170893D
        i ^= word >> 16
        i = (i ^ ((i & mask) >> 4) ^ (word >> 8)) * 0x0929EB3F
        i ^= word >> 23
        i = (i ^ ((i & mask) >> 1)) * (1 | word >> 27) * 0x6935FA69
        i = (i ^ ((i & mask) >> 11)) * 0x74DCB303
        i = (i ^ ((i & mask) >> 2)) * 0x9E501CC3
        i = ((i ^ ((i & mask) >> 2)) * 0xC860A3DF) & mask
        return i ^ (i >> 5)

    def go_round(unfinished: Any, i: Any) -> tuple[Any, Any]:
        i = mix(i)
        return i >= length, i

    _, index = dr.while_loop((mi.Bool(True), index), lambda unfinished, i: unfinished, go_round)
    return (index + word) % length


def _second_of_sobol(index: Any) -> Any:
    """Return the second dimension of Sobol's sequence in 0.32 fixed point; the first is the bit-reversed ``index``.

    Its matrix is Pascal's triangle modulo 2, the Kronecker product of five matrices (1 1; 0 1), which five steps apply.
    (Mitsuba's functions of this name keep the type of the variant that a process used first.)
    """
    for shift, mask in ((16, 0x0000FFFF), (8, 0x00FF00FF), (4, 0x0F0F0F0F), (2, 0x33333333), (1, 0x55555555)):
        index = index ^ ((index >> shift) & mask)
    return dr.brev(index)


def _fraction(fixed: Any) -> Any:
    """Return numbers in 0.32 fixed point as float32 below 1; 24 of their bits are kept."""
    return mi.Float(fixed >> 8) * 2.0**-24


def place_by_kronecker(pixel: Any, sample: Any, *, steps: Iterable[int], seed: int) -> Iterator[Any]:
    """Yield each sample's coordinate (0 to 1) for each step of a Kronecker sequence, shifted by an offset per pixel.

    ``steps`` are in 0.32 fixed point. The offsets of dimension j are drawn with the seed ``seed`` + j.
    """
    for j, step in enumerate(steps):
        word: Any = dr.opaque(mi.UInt32, (seed + j) & 0xFFFFFFFF)
        offset, _ = mi.sample_tea_32(pixel, word, 6)
        fixed = offset + sample * mi.UInt32(step)
        yield _fraction(fixed)
