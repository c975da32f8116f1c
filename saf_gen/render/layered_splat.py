"""Adds traced paths to a few focus positions in layers of equal blur, each smoothed over a part of its blur.

Out of focus, a point of the scene spreads over a disc. The true picture therefore has no detail much finer than that
disc, but the noise of its paths has. The paths of a position are sorted by their blur into layers, from the nearest to
the farthest. Each layer is smoothed by a Gaussian that is narrow compared with its blur, and then the layers are
composited from front to back. Points in focus are not smoothed, and a sharp edge in front of a blurred wall stays
sharp. This is the filter of Vaidyanathan et al. (2015), without their frequency analysis.

A layer covers a fraction of the area that the layers in front of it leave free. This fraction and the radiance of the
layer are as smooth as its blur, and both are ratios of smoothed sums. For the radiance, paths are moved towards the
middle of their disc by as much as the Gaussian spreads them, so that disc and Gaussian together have the second moment
of the disc, and nearly the fourth: no edge within a layer becomes wider, and the truth does not move. Moved paths would
also move the outlines of what is in front of them, which is as sharp as *its* blur. The fraction that a layer covers is
therefore counted where paths land, and smoothed by a Gaussian so narrow that it needs no correction.

Behind an outline in focus, a part of the lens is covered. What is seen through the rest changes from pixel to pixel,
however blurred it is. Pixels of both, and those around them whose paths would be moved across, are not smoothed: they
are the plain mean of their paths, and no other pixel gets any of these. Bent light, whose blur is unknown, is in the
focused layer, but makes no pixel plain.

References
----------
K. Vaidyanathan, J. Munkberg, P. Clarberg and M. Salvi, "Layered light field reconstruction for defocus blur", ACM
Trans. Graph. 34(2), 23 (2015), doi:10.1145/2699647.
"""

import math
from dataclasses import dataclass

import numba as nb
import numpy as np

from saf_gen.optics import Drive
from saf_gen.render.host_splat import ACCUMULATOR_BYTES, COUNT_BITS, TracedPaths
from saf_gen.render.surface_hits import Distances
from saf_gen.stack.focal_stack import LAYERED_POSITIONS

SMOOTHING = 0.2  # standard deviation of the Gaussian divided by that of the smallest disc of a layer
COVERAGE_SMOOTHING = 0.1  # the same for the fraction that a layer covers; its edges become wider by 0.5 % at most
MIN_BLUR = 6.0  # pixels; paths with less blur are not smoothed
LAYERS_PER_OCTAVE = 2
OCTAVES = 4
SIDE_LAYERS = LAYERS_PER_OCTAVE * OCTAVES  # layers in front of the focused one, and as many behind it
LAYERS = 2 * SIDE_LAYERS + 1
SIGMAS = 3.0  # standard deviations at which the Gaussian is cut off


@dataclass(frozen=True)
class BlurScale:
    """Factors that give the blur of a lens at each of several positions.

    Attributes
    ----------
    diameter : ndarray of float64, shape (focus,)
        2R·v divided by the pixel pitch, in pixels times metres.
    inverse_distance : ndarray of float64, shape (focus,)
        1/u, in 1/m.
    shift : ndarray of float64, shape (focus,)
        Distance (m) by which the lens is nearer to the scene than the point from which depths are measured.
    """

    diameter: np.ndarray
    inverse_distance: np.ndarray
    shift: np.ndarray

    @classmethod
    def from_drive(cls, drive: Drive, focus: np.ndarray, *, pitch_m: float) -> "BlurScale":
        """Return the scale at these positions, for depths measured from the lens midway between the ends."""
        shift = drive.shift(focus) - drive.shift(float(focus[0] + focus[-1]) / 2)
        diameter = 2 * drive.aperture_radius_m * drive.image_distance(focus) / pitch_m
        return cls(diameter, 1 / drive.object_distance(focus), shift)


class LayeredSums:
    """Sums of paths in layers, for all light groups of a scene at a few positions.

    Parameters
    ----------
    shape : tuple of int
        (focus, row, col) of the stacks.
    blur : BlurScale
        Blur at each position.
    scale : ndarray of float64, shape (light,)
        Fixed-point units per unit of radiance.
    max_radiance : ndarray of float64, shape (light,)
        Radiance at which a sample is clipped.
    """

    def __init__(
        self, shape: tuple[int, int, int], *, blur: BlurScale, scale: np.ndarray, max_radiance: np.ndarray
    ) -> None:
        self._allocate(shape, max_radiance.size)
        self._scale, self._max_radiance = scale, max_radiance
        self._blur = tuple(
            np.asarray(array, dtype=np.float32) for array in (blur.diameter, blur.inverse_distance, blur.shift)
        )

    def _allocate(self, shape: tuple[int, int, int], groups: int) -> None:
        focus, rows, columns = shape
        workers = max(1, min(nb.get_num_threads(), ACCUMULATOR_BYTES // self.bytes_needed(shape, groups)))
        self._sums = np.zeros((workers, focus, LAYERS, rows, columns, groups), dtype=np.int64)
        # Where paths of known blur landed: their number in each layer, and the sums of those that were moved.
        self._landed = np.zeros(self._sums.shape[:-1], dtype=np.int32)
        self._unmoved = np.zeros((workers, focus, rows, columns, groups), dtype=np.int64)

    @staticmethod
    def bytes_needed(shape: tuple[int, int, int], groups: int) -> int:
        """Return the size of one worker's sums, in bytes."""
        return ((8 * groups + 4) * LAYERS + 8 * groups) * math.prod(shape)

    @classmethod
    def sums_in_layers(cls, shape: tuple[int, int, int], groups: int) -> bool:
        """Return whether stacks of this shape are summed in layers: at few positions, and if they fit in memory."""
        return shape[0] <= LAYERED_POSITIONS and cls.bytes_needed(shape, groups) <= ACCUMULATOR_BYTES

    def add(
        self, line: TracedPaths, radiance: np.ndarray, *, lens: tuple[np.ndarray, np.ndarray], distances: Distances
    ) -> None:
        """Add traced paths to the layers of all positions.

        Parameters
        ----------
        line : TracedPaths
            Points where the paths meet the sensor, as numpy arrays; ``radiance`` is not read.
        radiance : ndarray of float32, shape (light, path)
            Radiance of each path under each light group.
        lens : tuple of two ndarrays of float32, shape (path,)
            Points where the paths pass the lens, along x and y, divided by the radius of its aperture.
        distances : Distances
            Distances of the ends of the paths and of the clear surfaces that they pass. A path is as sharp as the
            sharpest of these; surfaces between the nearest and the farthest may be at any distance.
        """
        _add_paths(
            (self._sums, self._landed, self._unmoved),
            (line.first_x, line.first_y, line.step_x, line.step_y),
            radiance,
            (self._scale, self._max_radiance),
            *line.window_and_weight(),
            (distances.end, *lens),
            NOTHING_CLEAR if distances.nearest is None else distances.nearest,
            NOTHING_CLEAR if distances.farthest is None else distances.farthest,
            self._blur,
        )

    def mean_radiance(self) -> np.ndarray:
        """Return the mean radiance, float32 (light, focus, row, col); a pixel that no path met is 0."""
        _, focus, _, rows, columns, groups = self._sums.shape
        out = np.empty((groups, focus, rows, columns), dtype=np.float32)
        for k in range(focus):
            _compose((self._sums, self._landed, self._unmoved), self._scale, position=k, out=out)
        return out


NOTHING_CLEAR = np.empty(0, np.float32)
BLURS = MIN_BLUR * 2.0 ** (np.arange(SIDE_LAYERS) / LAYERS_PER_OCTAVE)
"""Smallest blur (pixels) of each layer on either side of the focused one, outwards from it."""
GAUSSIANS = np.concatenate([[0.0], SMOOTHING * BLURS / 4])
"""Standard deviation (pixels) of the Gaussian of the focused layer, then of the layers on either side."""
COVERAGE_GAUSSIANS = GAUSSIANS * (COVERAGE_SMOOTHING / SMOOTHING)
REACHES = np.ceil(0.75 * SMOOTHING * 4 * GAUSSIANS).astype(np.int64)
"""How far (pixels, rounded up) a path of the focused layer, then of the layers on either side, is moved."""


@nb.njit(inline="always")
def _find_step(size, step):
    """Return how many layers away from the focused one a blur (pixels) belongs; the search begins at ``step``."""
    while step < SIDE_LAYERS and size >= BLURS[step]:
        step += 1
    while step > 0 and size < BLURS[step - 1]:
        step -= 1
    return step


@nb.njit(inline="always")
def _smaller(one, other):
    return one if abs(one) < abs(other) else other


@nb.njit(inline="always")
def _inward(s2, r2):
    """Return by how much a path is moved towards the middle of its disc, divided by its distance from there.

    A path from the radius r of a disc of radius 1 is moved to κr(1 + 3/2·s² - 3s²r²), where s is the standard deviation
    of the Gaussian divided by that of the disc, 1/2. To the order of s², the fourth moment then is that of the disc;
    κ makes the second moment so exactly. If all paths kept κ = √(1 - s²) of their radius, a disc fitted to an edge
    would be narrower by 0.7 % at s = 0.2, not by 0.1 %.

    Parameters
    ----------
    s2, r2 : float32
        The squares of s and r.
    """
    p, q = np.float32(1) + np.float32(1.5) * s2, np.float32(3) * s2
    mean_square = p * p - np.float32(4 / 3) * p * q + np.float32(0.5) * q * q  # twice that of r(p - qr²) over the disc
    return np.float32(1) - math.sqrt((np.float32(1) - s2) / mean_square) * (p - q * r2)


@nb.njit(nogil=True, cache=True)
def _add_some(sums, landed, unmoved, a, b, line, values, units, begin, end, weight, points, nearest, farthest, blurs):
    first_x, first_y, step_x, step_y = line
    scale, max_radiance = units
    end_at, lens_x, lens_y = points
    diameter, inverse_distance, shift = blurs
    focus, _, rows, columns, groups = sums.shape
    words = np.empty(groups, dtype=np.int64)
    step = 0
    for i in range(a, b):
        times = np.int64(weight[i]) if weight.size else np.int64(1)
        if times == 0:
            continue
        for g in range(groups):
            radiance = min(np.float64(values[g, i]), max_radiance[g])
            words[g] = ((np.int64(radiance * scale[g] + 0.5) << COUNT_BITS) + 1) * times
        k, stop = 0, focus
        if begin.size:
            k, stop = begin[i], min(end[i], focus)
        while k < stop:
            x, y = first_x[i] + np.float32(k) * step_x[i], first_y[i] + np.float32(k) * step_y[i]
            column, row = math.floor(x), math.floor(y)
            layer = SIDE_LAYERS
            if end_at[i] > 0:
                blur = np.float32(1) / (end_at[i] - shift[k]) - inverse_distance[k]
                if farthest.size and farthest[i] > 0:
                    near = np.float32(1) / (nearest[i] - shift[k]) - inverse_distance[k]
                    far = np.float32(1) / (farthest[i] - shift[k]) - inverse_distance[k]
                    blur = _smaller(blur, np.float32(0) if near > 0 > far else _smaller(near, far))
                blur *= diameter[k]
                step = _find_step(abs(blur), step)  # mostly the same as for the previous path
                if step:
                    layer = SIDE_LAYERS - step if blur > 0 else SIDE_LAYERS + step
                if 0 <= row < rows and 0 <= column < columns:
                    landed[k, layer, row, column] += times
                    for g in range(groups):
                        unmoved[k, row, column, g] += words[g] if step else np.int64(0)
                if step:
                    ratio, r2 = np.float32(4 * GAUSSIANS[step]) / blur, lens_x[i] * lens_x[i] + lens_y[i] * lens_y[i]
                    inward = np.float32(0.5) * blur * _inward(ratio * ratio, r2)
                    column, row = math.floor(x - inward * lens_x[i]), math.floor(y - inward * lens_y[i])
            if 0 <= row < rows and 0 <= column < columns:
                for g in range(groups):
                    sums[k, layer, row, column, g] += words[g]
            k += 1


@nb.njit(parallel=True, cache=True)
def _add_paths(all_sums, line, values, units, begin, end, weight, points, nearest, farthest, blurs):
    sums, landed, unmoved = all_sums
    workers, paths = sums.shape[0], values.shape[1]
    for worker in nb.prange(workers):
        a, b = paths * worker // workers, paths * (worker + 1) // workers
        here = sums[worker], landed[worker], unmoved[worker]
        _add_some(*here, a, b, line, values, units, begin, end, weight, points, nearest, farthest, blurs)


def gaussian_taps(sigma: float) -> np.ndarray:
    """Return the weights of a Gaussian over pixels, from the middle outwards; both sides together add up to 1.

    Each weight is the integral over its pixel, because samples are spread over their pixels. The integral adds the
    variance of a pixel, which is therefore subtracted first. If the standard deviation is below half a pixel, the
    weights are those of three points with the right variance.
    """
    if sigma == 0:
        return np.ones(1)
    if sigma < 0.5:
        return np.array([1 - sigma**2, sigma**2 / 2])
    edges = np.arange(math.ceil(SIGMAS * sigma) + 1) - 0.5
    inner = math.sqrt(max(sigma**2 - 1 / 12, 1e-9))  # the integral over a pixel adds its variance
    mass = np.array([0.5 * (1 + math.erf(e / inner / math.sqrt(2))) for e in (*edges, edges[-1] + 1)])
    taps = np.diff(mass)
    return taps / (taps[0] + 2 * taps[1:].sum())


def _compose(all_sums: tuple[np.ndarray, ...], scale: np.ndarray, *, position: int, out: np.ndarray) -> None:
    """Fill in the image of one position in ``out``, float32 (light, focus, row, col), from the sums of all positions.

    Kernels get complete arrays: slices have various memory layouts, each of which would need a separate compilation.
    """
    sums, landed, unmoved = all_sums
    planes, here, is_sharp, plain, samples = _split_layers(sums, landed, unmoved, position, scale)
    layers = np.flatnonzero(samples)
    planes, here, steps = planes[layers], here[layers], np.abs(layers - SIDE_LAYERS)
    mixed = _find_mixed(here, is_sharp, layers, REACHES[steps])
    planes *= ~mixed[:, None]
    rest = np.cumsum(here[::-1], axis=0)[::-1]  # samples of a layer and of all behind it
    coverage = np.stack([here, rest], axis=1)
    is_plain = (mixed & (here > 0)).any(axis=0)
    _smooth(planes, *_stack_taps(GAUSSIANS[steps]))
    _smooth(coverage, *_stack_taps(COVERAGE_GAUSSIANS[steps]))
    _composite_layers(planes, coverage, (plain, is_plain), position, out)


def _stack_taps(sigmas: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the taps of some Gaussians, float32 (layer, tap), and how many there are of each, int64 (layer,)."""
    kernels = [gaussian_taps(sigma) for sigma in sigmas]
    sizes = np.array([kernel.size for kernel in kernels], dtype=np.int64)
    taps = np.zeros((len(kernels), sizes.max(initial=1)), np.float32)
    for n, kernel in enumerate(kernels):
        taps[n, : kernel.size] = kernel
    return taps, sizes


@nb.njit(parallel=True, cache=True)
def _split_layers(sums, landed, unmoved, k, scale):
    """Return what the paths left at position ``k``: sums, samples that landed, focus, plain mean, samples per layer.

    The first planes of a layer, float32 (layer, light + 1, row, col), hold the radiance of each light group; the last
    one holds the number of samples where they were moved to. Samples that landed are float32 (layer, row, col). Pixels
    with something in focus are bool (row, col), the plain mean of all paths is float32 (light, row, col), and the
    samples per layer are float64 (layer,).
    """
    workers, _, layers, rows, columns, groups = sums.shape
    mask = (np.int64(1) << COUNT_BITS) - 1
    planes = np.empty((layers, groups + 1, rows, columns), np.float32)
    here = np.empty((layers, rows, columns), np.float32)
    is_sharp = np.zeros((rows, columns), np.bool_)
    plain = np.empty((groups, rows, columns), np.float32)
    samples = np.zeros((rows, layers))
    for row in nb.prange(rows):
        for layer in range(layers):
            for column in range(columns):
                count, all_landed = np.int64(0), np.int64(0)
                for g in range(groups):
                    total = np.int64(0)
                    for worker in range(workers):
                        total += sums[worker, k, layer, row, column, g]
                    planes[layer, g, row, column] = (total >> COUNT_BITS) / scale[g]
                    count = total & mask
                for worker in range(workers):
                    all_landed += landed[worker, k, layer, row, column]
                planes[layer, groups, row, column] = count
                here[layer, row, column] = count if layer == SIDE_LAYERS else all_landed
                is_sharp[row, column] |= layer == SIDE_LAYERS and all_landed > 0
                samples[row, layer] += count
        for column in range(columns):
            for g in range(groups):
                total = np.int64(0)
                for worker in range(workers):
                    total += unmoved[worker, k, row, column, g] + sums[worker, k, SIDE_LAYERS, row, column, g]
                plain[g, row, column] = (total >> COUNT_BITS) / (scale[g] * max(total & mask, 1))
    return planes, here, is_sharp, plain, samples.sum(axis=0)


@nb.njit(cache=True)
def _find_mixed(here, is_sharp, numbers, reaches):
    """Return which pixels of a layer are not smoothed, bool (layer, row, col).

    These are the pixels that a layer behind the focus shares with something in focus, and those within ``reaches`` of
    them, int64 (layer,). ``numbers`` are those of the layers, int64 (layer,).
    """
    layers, rows, columns = here.shape
    mixed = np.zeros(here.shape, np.bool_)
    for layer in range(layers):
        if numbers[layer] > SIDE_LAYERS:
            reach = reaches[layer]
            for row in range(rows):
                for column in range(columns):
                    if is_sharp[row, column] and here[layer, row, column] > 0:
                        top, left = max(row - reach, 0), max(column - reach, 0)
                        mixed[layer, top : row + reach + 1, left : column + reach + 1] = True
    return mixed


@nb.njit(parallel=True, cache=True)
def _smooth(planes, taps, sizes):
    """Convolve planes (layer, plane, row, col) in place with the kernel of their layer, given from its middle outwards.

    Beyond the border, values are 0.
    """
    layers, count, rows, columns = planes.shape
    for n in nb.prange(layers * count):
        layer, reach = n // count, sizes[n // count] - 1
        if reach == 0:
            continue
        plane, kernel = planes[layer, n % count], taps[layer]
        across = np.zeros((rows + 2 * reach, columns), planes.dtype)
        padded = np.zeros(columns + 2 * reach, planes.dtype)
        for row in range(rows):
            padded[reach : reach + columns] = plane[row]
            out = across[row + reach]
            for column in range(columns):
                out[column] = kernel[0] * padded[column + reach]
            for t in range(1, reach + 1):
                for column in range(columns):
                    out[column] += kernel[t] * (padded[column + reach - t] + padded[column + reach + t])
        for row in range(rows):
            middle = row + reach
            for column in range(columns):
                plane[row, column] = kernel[0] * across[middle, column]
            for t in range(1, reach + 1):
                for column in range(columns):
                    plane[row, column] += kernel[t] * (across[middle - t, column] + across[middle + t, column])


@nb.njit(parallel=True, cache=True)
def _composite_layers(planes, coverage, plain_pixels, k, out):
    """Composite layers from front to back: each covers a part of the area that those in front of it leave free."""
    plain, is_plain = plain_pixels
    layers, groups = planes.shape[0], planes.shape[1] - 1
    for row in nb.prange(planes.shape[2]):
        for column in range(planes.shape[3]):
            free = np.float32(1)
            for g in range(groups):
                out[g, k, row, column] = plain[g, row, column] if is_plain[row, column] else np.float32(0)
            if is_plain[row, column]:
                continue
            for layer in range(layers):
                count, here = planes[layer, groups, row, column], coverage[layer, 0, row, column]
                if count > 0 and here > 0:
                    weight = free * min(here / coverage[layer, 1, row, column], np.float32(1))
                    for g in range(groups):
                        out[g, k, row, column] += weight * (planes[layer, g, row, column] / count)
                    free -= weight
            if free < 1:
                for g in range(groups):
                    out[g, k, row, column] /= 1 - free
