"""The moments at which a moving scene is rendered: as dense as what moves in it is sharp.

Half way between two slices a recording shows the mean of both. If an edge that the lens blurs moves by d pixels from
one to the next, the mean square of the error, summed across the edge of unit step, is

    W(d) = ∫ |K(f)|²·(1 - cos πfd)² / (2πf)² df,

where K is the transfer of pixel and blur; without blur it is d³/24 for d up to a pixel. A disc as wide as c pixels
leaves less of it, so slices may be farther apart. W at 0.8 + 0.35·c times a step of up to 1.5 pixels is at most W of
that step in focus. Where waves spread a point in focus over more than a pixel, c is measured in the width that the lens
resolves.
"""

import numpy as np

from saf_gen.optics import FittedLensDrive
from saf_gen.stack.focal_stack import LAYERED_POSITIONS, StackSpec

FRAMES_PER_BYTE = 8  # a camera writes whole bytes, so the stacks that it is given can change only between two bytes
MAX_FACTOR = 3
"""Largest distance of two slices, divided by that in focus. Shadows and reflections of what moves, and what is seen
through glass, may be sharper than it is."""
FACTOR_AT_FOCUS, FACTOR_PER_WIDTH = 0.8, 0.35


def slice_step(readout_hz: float, slices_per_s: float) -> int:
    """Return the frames between evenly spaced slices: a multiple of 8, for that many per second or a few more."""
    return max(FRAMES_PER_BYTE, int(readout_hz / slices_per_s) // FRAMES_PER_BYTE * FRAMES_PER_BYTE)


def even_starts(frames: int, *, step: int) -> tuple[int, ...]:
    """Return the frames at which slices begin every ``step`` frames; the last is the first whole byte at the end."""
    return (*range(0, frames, step), _whole_bytes(frames))


def spaced_starts(*, step: int, factor: np.ndarray, knots: np.ndarray, reach: float) -> tuple[int, ...]:
    """Return the frames at which slices begin, up to ``factor`` times as far apart as evenly spaced ones.

    Parameters
    ----------
    step : int
        Frames between evenly spaced slices, a multiple of 8.
    factor : ndarray, shape (T,)
        By which slices may be farther apart, at each readout; 1 to MAX_FACTOR. The smallest of an interval counts.
    knots : ndarray, shape (T,)
        Position of the lens at each readout, in steps between focus positions.
    reach : float
        Positions that the lens may pass between two slices that are farther apart.

    Returns
    -------
    tuple of int
        Multiples of 8, from 0 to the first one at or after the end.
    """
    end, starts = _whole_bytes(factor.size), [0]
    counts = np.arange(1, MAX_FACTOR * step + 1)
    while starts[-1] < end:
        ahead = np.minimum(starts[-1] + counts - 1, factor.size - 1)
        travel = np.maximum.accumulate(knots[ahead]) - np.minimum.accumulate(knots[ahead])
        fits = (counts <= step * np.minimum.accumulate(factor[ahead])) & (travel <= reach)
        wide = int(fits.sum()) // FRAMES_PER_BYTE * FRAMES_PER_BYTE
        starts.append(min(starts[-1] + max(wide, step), end))
    return tuple(starts)


def _whole_bytes(frames: int) -> int:
    return -(-frames // FRAMES_PER_BYTE) * FRAMES_PER_BYTE


def spacing_factor(
    spec: StackSpec, position: np.ndarray, *, depths: tuple[float, float], wavelength_m: float
) -> np.ndarray:
    """Return by how much slices may be farther apart than in focus, float64 (T,), 1 to MAX_FACTOR.

    It is 1 for a lens with aberrations or a ring, whose blur is no disc.

    Parameters
    ----------
    spec : StackSpec
        A stack of the recording; its lens, pixels and margin are used.
    position : ndarray, shape (T,)
        Position of the lens in each readout, 0 to 1.
    depths : tuple of float
        Nearest and farthest depth (m) of what moves.
    wavelength_m : float
        Wavelength of the light, metres.
    """
    drive = spec.drive
    if isinstance(drive, FittedLensDrive) or not drive.fills_its_aperture_perfectly:
        return np.ones(position.size)
    before, after = (count / (spec.positions - 1) for count in spec.margin)
    drawn = position - before, position + after  # light of other wavelengths is drawn in at the positions between
    defocus = np.array([drive.defocus(p, depth) for p in drawn for depth in depths])
    least = np.maximum(np.maximum(defocus.min(axis=0), -defocus.max(axis=0)), 0.0)  # 0 if something is in focus
    image_m, radius_m = drive.image_distance(position), drive.aperture_radius_m
    resolved_m = np.sqrt(spec.pitch_m**2 + (wavelength_m * image_m / radius_m) ** 2)
    widths = 2 * radius_m * image_m * least / resolved_m
    return np.clip(FACTOR_AT_FOCUS + FACTOR_PER_WIDTH * widths, 1, MAX_FACTOR)


def layered_reach(spec: StackSpec) -> float:
    """Return how many positions the lens may pass between two slices whose paths can still be summed in layers.

    A slice holds what the lens passes on both sides of its moment.
    """
    return (LAYERED_POSITIONS - 2 - sum(spec.margin)) / 2
