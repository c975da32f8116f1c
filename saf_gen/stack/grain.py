"""Grain: the noise that finitely many light paths leave in a picture, measured from two independent renders.

Let two renders of one picture be s + n and s + m. Their difference holds noise alone, and their product holds the
signal s² on average, because independent noise averages out. The same is true for every energy that a focus measure
computes, since each is a mean of squares of linear filters L:

    noise energy = mean L(first − second)² / (1 + ratio)          signal energy = mean L(first)·L(second)

where ``ratio`` is the samples of the first render divided by those of the second. The noise is that of the first
render, and its variance is assumed to be inversely proportional to the number of samples. The energies have the names
of focus measures: ``brenner``, ``tenengrad``, ``squared_gradient``, ``energy_of_laplacian``, ``variance_of_laplacian``,
and ``contrast``, which is the measure ``variance`` and, divided by the squared mean, ``sd``.

**Intervals** cover 95 %. The region is cut into square blocks, and grain is assumed to be independent between blocks,
but not within them. The scatter of the noise energy is that of its blocks around their mean, so blocks of uneven noise
widen the interval. The signal is regarded as fixed, so only the noise of the product scatters: its variance is
estimated by the sum over blocks of ((energy of first − energy of second)/2)². Half the difference scatters like the
product (s + n)(s + m): the variance is 2s²σ² + σ⁴ for each pixel of noise variance σ² (for the difference more, if the
renders differ in samples). A quotient of the two energies gets Fieller's interval, which has no upper end if the signal
cannot be distinguished from 0.

**Stored stacks.** Stacks are rendered a second time with fewer samples (:mod:`saf_gen.render.grain`). Noise and signal
are quadratic in the picture, and a picture is the sum of its light groups times their gains g. For each position, an
energy at any gains is therefore given by two symmetric matrices N and S over the light groups: gᵀ·N·g and gᵀ·S·g.
``stack.grain.json`` in the folder of a stack is information about it, not part of it: no digest of the stack covers it,
and it is used only for the stack whose digest it states.

References
----------
.. [1] Fieller, J. Royal Statistical Society B 16(2), 1954, doi:10.1111/j.2517-6161.1954.tb00159.x.
.. [2] Künsch, "The jackknife and the bootstrap for general stationary observations", Annals of Statistics 17(3), 1989,
   doi:10.1214/aos/1176347265: blocks as units.
"""

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.special import stdtrit

from saf_gen.core.config.json_document import load_plain_json
from saf_gen.core.files import write_text
from saf_gen.core.region import bounding_box
from saf_gen.errors import BadInput
from saf_gen.stack.focal_stack import StackSpec, StackStore

CONFIDENCE = 0.95
BLOCK, MIN_BLOCKS = 8, 16
"""Edge of a block in pixels, and the number of blocks below which a region gets smaller ones."""

_DIFFERENCE, _SMOOTH = np.array([[-1.0, 0.0, 1.0]]), np.array([[1.0], [2.0], [1.0]])
_FILTERS: Mapping[str, tuple[np.ndarray, ...]] = {
    "contrast": (np.ones((1, 1)),),
    "brenner": (_DIFFERENCE,),
    "tenengrad": (_SMOOTH * _DIFFERENCE, (_SMOOTH * _DIFFERENCE).T),
    "squared_gradient": (np.array([[-1.0, 1.0]]),),
    "energy_of_laplacian": (np.array([[-1.0, -4.0, -1.0], [-4.0, 20.0, -4.0], [-1.0, -4.0, -1.0]]),),
    "variance_of_laplacian": (np.array([[0.0, -1.0, 0.0], [-1.0, 4.0, -1.0], [0.0, -1.0, 0.0]]) / 6,),
}
_CENTRED_ENERGIES = ("contrast", "variance_of_laplacian")
"""Energies that are variances: the mean of the responses is subtracted."""
ENERGIES = tuple(_FILTERS)


@dataclass(frozen=True)
class GrainFigure:
    """A measured number with its 95 % interval.

    Attributes
    ----------
    value : float
        Measured number.
    low, high : float
        Ends of the interval.
    """

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Grain:
    """The grain of a picture in a region.

    In a black region every figure is NaN; so is the figure of an energy whose filter fits nowhere in the region.

    Attributes
    ----------
    mean : float
        Mean of the picture, in its unit.
    rms : GrainFigure
        Root mean square of the noise, divided by the mean.
    noise_over_signal : mapping of str to GrainFigure
        Noise energy divided by signal energy, for each of ENERGIES; above 1 if noise outweighs the signal.
    """

    mean: float
    rms: GrainFigure
    noise_over_signal: Mapping[str, GrainFigure]


def estimate_grain(
    first: np.ndarray, second: np.ndarray, *, mask: np.ndarray | None = None, ratio: float = 1.0
) -> Grain:
    """Estimate the grain of the first of two renders of one picture.

    Parameters
    ----------
    first, second : ndarray, shape (row, col)
        The region in two renders with independent noise, all lights mixed.
    mask : ndarray of bool, shape (row, col), optional
        Pixels of the region that count; by default all. A filter counts at positions at which all of its pixels count.
    ratio : float, default 1.0
        Samples of ``first`` divided by those of ``second``.

    Returns
    -------
    Grain
        The grain, with 95 % intervals.

    Raises
    ------
    BadInput
        If the shapes differ, the mask marks nothing, or the ratio is not above 0.
    """
    first, second, mask = _checked(first, second, mask=mask)
    if not 0 < ratio < math.inf:
        raise BadInput(
            f"ratio is {ratio!r}", allowed="samples of the first render divided by those of the second, above 0"
        )
    mean = float((first[mask].mean() + second[mask].mean()) / 2)
    nan = GrainFigure(math.nan, math.nan, math.nan)
    if not mean > 0:
        return Grain(mean, nan, dict.fromkeys(ENERGIES, nan))
    blocks = _block_numbers(mask)
    noise = _sum_blocks([((first - second) ** 2 / (1 + ratio), mask)], blocks)
    found = {}
    for energy in ENERGIES:
        responses = zip(filter_grain(first, energy, mask=mask), filter_grain(second, energy, mask=mask), strict=True)
        pairs = [(a, b, valid) for (a, valid), (b, _) in responses]
        noise_energy = _sum_blocks([((a - b) ** 2 / (1 + ratio), valid) for a, b, valid in pairs], blocks)
        signal = _sum_blocks([(a * b, valid) for a, b, valid in pairs], blocks)
        signal_noise = _sum_blocks([((a * a - b * b) / 2, valid) for a, b, valid in pairs], blocks)
        found[energy] = _quotient(
            noise_energy,
            float(signal.sums.sum()),
            signal_variance=float(np.square(signal_noise.sums).sum()),
            ratio=ratio,
        )
    return Grain(mean, _relative_rms(noise, mean), found)


def correlate_grain(
    earlier: tuple[np.ndarray, np.ndarray], later: tuple[np.ndarray, np.ndarray], *, mask: np.ndarray | None = None
) -> GrainFigure:
    """Return the correlation between the grain at two moments.

    The differences of the two renders of each moment are correlated pixel by pixel: 1 for grain that does not change, 0
    for independent grain. The interval comes from a jackknife over blocks, on Fisher's scale. All figures are NaN if a
    moment has no noise.

    Parameters
    ----------
    earlier, later : tuple of two ndarrays, shape (row, col)
        Two renders of each moment, with independent noise.
    mask : ndarray of bool, shape (row, col), optional
        Pixels that count; by default all.

    Raises
    ------
    BadInput
        If the shapes differ or the mask marks nothing.
    """
    first, second, inside = _checked(*earlier, mask=mask)
    one = first - second
    first, second, _ = _checked(*later, mask=mask)
    other = first - second
    if one.shape != other.shape:
        raise BadInput(f"the moments have the shapes {one.shape} and {other.shape}", allowed="one region for both")
    blocks = _block_numbers(inside)
    cross, square, square_of_other = (
        _sum_blocks([(product, inside)], blocks).sums for product in (one * other, one**2, other**2)
    )
    if not (square.sum() > 0 and square_of_other.sum() > 0):
        return GrainFigure(math.nan, math.nan, math.nan)

    def fisher(left_out: np.ndarray) -> np.ndarray:
        scale = np.sqrt((square.sum() - left_out * square) * (square_of_other.sum() - left_out * square_of_other))
        return np.arctanh(np.clip((cross.sum() - left_out * cross) / np.maximum(scale, 1e-300), -1 + 1e-12, 1 - 1e-12))

    value = float(fisher(np.zeros(1))[0])
    without = fisher(np.ones(cross.size))
    error = math.sqrt((cross.size - 1) / cross.size * float(np.square(without - without.mean()).sum()))
    reach = _quantile(cross.size) * error
    return GrainFigure(math.tanh(value), math.tanh(value - reach), math.tanh(value + reach))


@dataclass(frozen=True)
class _BlockSums:
    """Sums over the blocks of a region, float64 (block,), and the number of pixels in each."""

    sums: np.ndarray
    counts: np.ndarray

    @property
    def variance(self) -> float:
        """The variance of the total, from the scatter of blocks around the mean of their pixels."""
        n, mean = self.sums.size, self.sums.sum() / self.counts.sum()
        return float(n / (n - 1) * np.square(self.sums - mean * self.counts).sum()) if n > 1 else math.inf


def _relative_rms(noise: _BlockSums, mean: float) -> GrainFigure:
    """Return the root of the mean noise divided by the mean; its interval is symmetric in the logarithm."""
    total = float(noise.sums.sum())
    value = math.sqrt(total / float(noise.counts.sum())) / mean
    if not total > 0:
        return GrainFigure(0.0, 0.0, 0.0)
    reach = _quantile(noise.sums.size) * math.sqrt(noise.variance) / total / 2
    return GrainFigure(value, value * math.exp(-reach), value * math.exp(reach) if reach < 700 else math.inf)


def _quotient(noise: _BlockSums, signal: float, *, signal_variance: float, ratio: float) -> GrainFigure:
    """Return the sum of noise divided by the sum of signal, with Fieller's interval; NaN if there are no pixels.

    Both are sums over the same pixels.
    """
    if not noise.sums.size:
        return GrainFigure(math.nan, math.nan, math.nan)
    total, square = float(noise.sums.sum()), _quantile(noise.sums.size) ** 2
    if not total > 0:
        return GrainFigure(0.0, 0.0, 0.0)
    value = total / signal if signal > 0 else math.inf
    known = signal**2 - square * signal_variance
    if not (known > 0 and signal > 0):
        return GrainFigure(value, 0.0, math.inf)
    # If the difference happens to be large, the product is small: cov((n - m)^2, (s + n)(s + m)) = -2·var(n·m).
    middle = total * signal + square * noise.variance * ratio / (1 + ratio)
    root = math.sqrt(max(middle**2 - known * (total**2 - square * noise.variance), 0.0))
    return GrainFigure(value, max((middle - root) / known, 0.0), (middle + root) / known)


def _quantile(blocks: int) -> float:
    """Return how many standard errors the interval reaches to either side: Student's t for this number of blocks."""
    return float(stdtrit(max(blocks - 1, 1), (1 + CONFIDENCE) / 2))


def filter_grain(image: np.ndarray, energy: str, *, mask: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield each filter's response to an image (row, col), and whether all pixels under the filter are in the mask.

    An image smaller than the filter yields nothing.
    """
    for kernel in _FILTERS[energy]:
        rows, columns = (size - part + 1 for size, part in zip(image.shape, kernel.shape, strict=True))
        if min(rows, columns) < 1:
            return
        response, valid = np.zeros((rows, columns)), np.ones((rows, columns), bool)
        for (i, j), factor in np.ndenumerate(kernel):
            valid &= mask[i : i + rows, j : j + columns]
            if factor:
                response += factor * image[i : i + rows, j : j + columns]
        if energy in _CENTRED_ENERGIES and valid.any():
            response -= response[valid].mean()
        yield response, valid


def _checked(
    first: np.ndarray, second: np.ndarray, *, mask: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    first, second = np.asarray(first, np.float64), np.asarray(second, np.float64)
    if first.ndim != 2 or first.shape != second.shape:
        raise BadInput(
            f"the renders have the shapes {first.shape} and {second.shape}", allowed="(row, col), both the same"
        )
    inside = np.ones(first.shape, bool) if mask is None else np.asarray(mask, bool)
    if inside.shape != first.shape or not inside.any():
        raise BadInput(
            f"the mask has the shape {inside.shape} and marks {int(inside.sum())} pixels",
            allowed=f"{first.shape}, at least one pixel marked",
        )
    return first, second, inside


def _block_numbers(mask: np.ndarray) -> np.ndarray:
    """Return the number of each pixel's block, int64 (row, col)."""
    edge = int(min(max(math.sqrt(mask.sum() / MIN_BLOCKS), 1), BLOCK))
    rows, columns = (np.arange(size) // edge for size in mask.shape)
    return rows[:, None] * (columns[-1] + 1) + columns


def _sum_blocks(responses: list[tuple[np.ndarray, np.ndarray]], blocks: np.ndarray) -> _BlockSums:
    """Sum the valid responses in each block; a response belongs to the pixel at the middle of its filter.

    Blocks without any valid response are left out.
    """
    size = int(blocks.max()) + 1
    sums, counts = np.zeros(size), np.zeros(size)
    for response, valid in responses:
        top, left = ((full - part) // 2 for full, part in zip(blocks.shape, valid.shape, strict=True))
        numbers = blocks[top : top + valid.shape[0], left : left + valid.shape[1]][valid]
        sums += np.bincount(numbers, response[valid], minlength=size)
        counts += np.bincount(numbers, minlength=size)
    used = counts > 0
    return _BlockSums(sums[used], counts[used])


FILE, FORMAT = "stack.grain.json", "saf-gen grain 1"  # a light group may be called grain, but not stack.grain
DIGITS = 7


@dataclass(frozen=True, eq=False)
class StackGrain:
    """The grain of a stack in the box around its target, for any gains of its lights.

    Attributes
    ----------
    samples : tuple of int
        Samples per pixel of the stack, and of the second render.
    indices : ndarray of int64, shape (focus,)
        Indices of the measured positions among the rendered ones, in rising order.
    mean : ndarray of float64, shape (focus, light)
        Mean radiance in the box.
    square : ndarray of float64, shape (focus, light, light)
        Mean square of the noise.
    noise, signal : mapping of str to ndarray of float64, shape (focus, light, light)
        Energies of noise and signal, by name.
    """

    samples: tuple[int, int]
    indices: np.ndarray
    mean: np.ndarray
    square: np.ndarray
    noise: Mapping[str, np.ndarray]
    signal: Mapping[str, np.ndarray]

    def mix(self, index: int, gain: np.ndarray) -> tuple[float, dict[str, float], dict[str, float]]:
        """Return the grain at a measured position under given gains of the lights.

        All figures are NaN if the mix is black.

        Parameters
        ----------
        index : int
            Index of the position in ``indices``.
        gain : ndarray, shape (light,)
            Gains of the light groups.

        Returns
        -------
        rms : float
            Root mean square of the noise, divided by the mean.
        noise, signal : dict of str to float
            Energies by name, divided by the squared mean.
        """
        gain = np.asarray(gain, np.float64)
        mean = float(gain @ self.mean[index])
        if not mean > 0:
            return math.nan, dict.fromkeys(ENERGIES, math.nan), dict.fromkeys(ENERGIES, math.nan)

        def energy(matrix: np.ndarray) -> float:
            return float(gain @ matrix[index] @ gain) / mean**2

        noise, signal = ({name: energy(of[name]) for name in ENERGIES} for of in (self.noise, self.signal))
        return math.sqrt(max(energy(self.square), 0.0)), noise, signal


def measure_pictures(
    first: np.ndarray,
    second: np.ndarray,
    *,
    target: np.ndarray,
    samples: tuple[int, int],
    indices: np.ndarray | None = None,
) -> StackGrain:
    """Measure the grain of a stack from a second render with independent noise.

    The variance of noise is assumed to be inversely proportional to the number of samples. If the samples of a pixel
    are spread evenly, it falls faster; the second render, with fewer samples, then makes the figures too large, not too
    small.

    Parameters
    ----------
    first, second : ndarray, shape (light, focus, row, col)
        Radiance of the two renders.
    target : ndarray of bool, shape (row, col)
        Target mask; the grain in its bounding box is measured.
    samples : tuple of int
        Samples per pixel of ``first`` and of ``second``.
    indices : ndarray of int, optional
        Positions to measure, in rising order; by default all.

    Raises
    ------
    BadInput
        If the shapes differ or the target is empty.
    """
    if first.shape != second.shape or first.ndim != 4:
        raise BadInput(
            f"the renders have the shapes {first.shape} and {second.shape}",
            allowed="(light, focus, row, col), both the same",
        )
    rows, columns = bounding_box(target)
    indices = np.arange(first.shape[1]) if indices is None else np.asarray(indices)
    lights, positions = first.shape[0], indices.size
    mean, square = np.empty((positions, lights)), np.empty((positions, lights, lights))
    noise, signal = ({name: np.empty((positions, lights, lights)) for name in ENERGIES} for _ in "ab")
    ratio = samples[0] / samples[1]
    counts = {name: _count_positions((rows.stop - rows.start, columns.stop - columns.start), name) for name in ENERGIES}
    for k, index in enumerate(indices):
        one, other = (stack[:, index, rows, columns].astype(np.float64) for stack in (first, second))
        mean[k] = one.mean(axis=(1, 2))  # the second is noisier
        difference = (one - other).reshape(lights, -1)
        square[k] = difference @ difference.T / difference.shape[1] / (1 + ratio)
        for name in ENERGIES:
            a, b = _responses(one, name), _responses(other, name)
            noise[name][k] = (a - b) @ (a - b).T / (1 + ratio) / counts[name]
            product = a @ b.T / counts[name]
            signal[name][k] = (product + product.T) / 2
    return StackGrain(samples, indices, mean, square, noise, signal)


def _responses(images: np.ndarray, energy: str) -> np.ndarray:
    """Return the responses of all filters of an energy to images (light, row, col), as an array (light, response)."""
    full_image = np.ones(images.shape[1:], bool)
    found = [[r.ravel() for r, _ in filter_grain(image, energy, mask=full_image)] for image in images]
    return np.array([np.concatenate(one) if one else np.full(1, np.nan) for one in found])


def _count_positions(shape: tuple[int, int], energy: str) -> int:
    """Return the number of positions at which the filters of an energy fit into an image, at least 1."""
    full_image = np.ones(shape)
    return max((int(valid.sum()) for _, valid in filter_grain(full_image, energy, mask=full_image > 0)), default=1)


def write_grain(root: Path, spec: StackSpec, *, grain: StackGrain) -> None:
    """Store the grain of a stack in its folder. Raises BadInput if that fails."""
    document = {
        "format": FORMAT,
        "stack_digest": StackStore(root, spec).digest(),
        "samples": list(grain.samples),
        "light_groups": list(spec.groups),
        "indices": grain.indices.tolist(),
        "mean": _rounded(grain.mean),
        "square": _rounded(grain.square),
        "noise": {name: _rounded(array) for name, array in grain.noise.items()},
        "signal": {name: _rounded(array) for name, array in grain.signal.items()},
    }
    write_text(root / spec.key / FILE, json.dumps(document) + "\n")


def read_grain(root: Path, spec: StackSpec) -> StackGrain | None:
    """Return the stored grain of a stack, or None if it is missing, unreadable, or belongs to another digest."""
    try:
        document = load_plain_json(root / spec.key / FILE)
        if document["format"] != FORMAT or document["stack_digest"] != StackStore(root, spec).digest():
            return None
        first, second = document["samples"]
        indices = np.array(document["indices"], np.int64)
        mean, square = (np.array(document[key], np.float64) for key in ("mean", "square"))
        noise, signal = (
            {name: np.array(document[key][name], np.float64) for name in ENERGIES} for key in ("noise", "signal")
        )
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError):
        return None
    lights, positions = len(spec.groups), indices.size
    fits = mean.shape == (positions, lights) and square.shape == (positions, lights, lights) and indices.ndim == 1
    inside = positions > 0 and indices.min() >= 0 and indices.max() < spec.rendered_count
    if not (fits and inside) or any(array.shape != square.shape for of in (noise, signal) for array in of.values()):
        return None
    return StackGrain((int(first), int(second)), indices, mean, square, noise, signal)


def _rounded(array: np.ndarray) -> list[object]:
    """Return an array as nested lists of rounded numbers; None, which is read as NaN, replaces infinities and NaN."""
    flat = [float(f"{x:.{DIGITS}g}") if math.isfinite(x) else None for x in array.ravel().tolist()]
    nested: list[object] = np.array(flat, object).reshape(array.shape).tolist()
    return nested
