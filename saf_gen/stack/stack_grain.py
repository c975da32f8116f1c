"""The grain of a stored focal stack under any mix of its lights, and its file in the folder of the stack.

A stack is rendered a second time with fewer samples (:mod:`saf_gen.render.second_render`). Noise and signal are
quadratic in the picture, and a picture is the sum of its light groups times their gains g. For each position, an energy
at any gains is therefore given by two symmetric matrices N and S over the light groups: gᵀ·N·g and gᵀ·S·g.

``stack.grain.json`` in the folder of a stack is information about it, not part of it: no digest of the stack covers it,
and it is used only for the stack whose digest it states.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from saf_gen.core.config.json_document import load_plain_json
from saf_gen.core.files import write_text
from saf_gen.core.region import bounding_box
from saf_gen.errors import BadInput
from saf_gen.stack.focal_stack import StackSpec, StackStore
from saf_gen.stack.grain import ENERGIES, filter_grain

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
