"""Compiled inner loops of a frame camera: light summed over an exposure, and the number that a pixel reads out of it.

Random numbers come from SplitMix64, which begins anew for each pixel of each frame, so that a pixel depends neither on
others nor on the order in which pixels are read. Poisson and normal numbers are drawn by methods that are exact: their
errors are those of float64.
"""

from math import erfc, exp, floor, lgamma, log, pi, sqrt
from typing import Any

import numpy as np
from numba import njit

from saf_gen.core.compiled import compiled_unchecked

U = np.uint64
GOLDEN = U(0x9E3779B97F4A7C15)
UNIT = 2.0**-53
FEW = 10.0  # mean below which numbers are counted up; W. Hörmann's method begins here
MOST_COUNTED = 128  # beyond it, a number of mean 10 has the probability 1e-88
INVERSE = 1 / np.maximum(np.arange(MOST_COUNTED + 1.0), 1)
TAIL = 3.6541528853610088  # where the tail of the normal law begins, with 256 layers of equal area
LAYERS = 256


def _layers() -> tuple[np.ndarray, np.ndarray]:
    """Return the right ends of the layers of the normal density, from the lowest, and the density there."""
    area = TAIL * exp(-(TAIL**2) / 2) + sqrt(pi / 2) * erfc(TAIL / sqrt(2))
    ends = [area / exp(-(TAIL**2) / 2), TAIL]
    while len(ends) < LAYERS:
        ends.append(sqrt(-2 * log(area / ends[-1] + exp(-(ends[-1] ** 2) / 2))))
    x = np.array([*ends, 0.0])
    return x, np.exp(-(x**2) / 2)


ENDS, DENSITY = _layers()


@njit(inline="always")
def _mixed(word: Any) -> Any:
    """Return a word mixed by the finaliser of SplitMix64 (Steele, Lea and Flood 2014, doi:10.1145/2660193.2660195)."""
    word = (word ^ (word >> U(30))) * U(0xBF58476D1CE4E5B9)
    word = (word ^ (word >> U(27))) * U(0x94D049BB133111EB)
    return word ^ (word >> U(31))


@njit(inline="always")
def _fraction(word: Any) -> Any:
    """Return a number from 0 to 1, without 1, from the upper 53 bits of a word."""
    return np.float64(np.int64(word >> U(11))) * UNIT


@njit
def _rejected(k: Any, mean: Any, height: Any, scale: Any) -> Any:
    """Return whether W. Hörmann's hat is above the density of Poisson's law at k, for a drawn height."""
    return log(height * scale) > k * log(mean) - mean - lgamma(k + 1.0)


@njit(inline="always")
def draw_poisson(mean: Any, state: Any) -> Any:
    """Return a number of Poisson's law, as a float, and the state of the generator after it.

    Few are counted up: the least number whose cumulative probability exceeds a random one. Many are drawn by
    transformed rejection, whose usual case needs neither a logarithm nor a factorial: W. Hörmann, algorithm PTRS,
    Insurance: Mathematics and Economics 12, 1993, doi:10.1016/0167-6687(93)90997-4.
    """
    if mean < FEW:
        state += GOLDEN
        drawn, k, probability = _fraction(_mixed(state)), 0, exp(-mean)
        while drawn >= probability and k < MOST_COUNTED:
            drawn -= probability
            k += 1
            probability *= mean * INVERSE[k]
        return np.float64(k), state
    b = 0.931 + 2.53 * sqrt(mean)
    a = -0.059 + 0.02483 * b
    accepted = 0.9277 - 3.6224 / (b - 2.0)
    while True:
        state += GOLDEN
        u = _fraction(_mixed(state)) - 0.5
        state += GOLDEN
        v = 1.0 - _fraction(_mixed(state))
        away = 0.5 - abs(u) + UNIT  # not 0
        number = floor((2.0 * a / away + b) * u + mean + 0.43)
        if away >= 0.07 and v <= accepted:
            return number, state
        if number < 0.0 or (away < 0.013 and v > away):
            continue
        if not _rejected(number, mean, v, (1.1239 + 1.1328 / (b - 3.4)) / (a / (away * away) + b)):
            return number, state


@njit
def _beyond(layer: Any, x: Any, state: Any) -> Any:
    """Return whether a number beyond the core of its layer is accepted, the number, and the state after it."""
    if layer > U(0):
        state += GOLDEN
        height = DENSITY[layer] + _fraction(_mixed(state)) * (DENSITY[layer + U(1)] - DENSITY[layer])
        return height < exp(-0.5 * x * x), x, state
    while True:  # G. Marsaglia's tail
        state += GOLDEN
        far = -log(1.0 - _fraction(_mixed(state))) / TAIL
        state += GOLDEN
        if -2.0 * log(1.0 - _fraction(_mixed(state))) >= far * far:
            return True, (TAIL + far if x > 0.0 else -TAIL - far), state


@njit(inline="always")
def draw_normal(state: Any) -> Any:
    """Return a number of the standard normal law, and the state of the generator after it.

    The ziggurat of G. Marsaglia and W. W. Tsang, J. Stat. Softw. 5, 2000, doi:10.18637/jss.v005.i08, with bits for the
    layer that the number does not share, after J. A. Doornik.
    """
    while True:
        state += GOLDEN
        word = _mixed(state)
        layer = word & U(LAYERS - 1)
        x = (2.0 * _fraction(word) - 1.0 + UNIT) * ENDS[layer]
        if abs(x) < ENDS[layer + U(1)]:
            return x, state
        kept, x, state = _beyond(layer, x, state)
        if kept:
            return x, state


@compiled_unchecked
def read_out(
    charge: Any, response: Any, dark: Any, key: Any, shot: Any, full_well: Any, read_noise: Any, per_level: Any,
    levels: Any, out: Any
) -> Any:  # fmt: skip
    """Read a frame.

    Parameters
    ----------
    charge, response, dark : ndarray of float64, shape (P,)
        Mean photo-electrons at a response of 1, relative response, and mean dark electrons of each pixel.
    key : int
        Where the random numbers of the frame begin.
    shot : bool
        Whether electrons come at random.
    full_well, read_noise, per_level : float
        Electrons that a pixel holds, rms of a reading, and electrons per level.
    levels : float
        Largest number.
    out : ndarray of uint16, shape (P,)
        Receives the numbers.
    """
    for pixel in range(U(charge.size)):
        state = _mixed(U(key) + pixel * GOLDEN)
        electrons = min(charge[pixel] * response[pixel] + dark[pixel], 1e9)
        if shot:
            electrons, state = draw_poisson(electrons, state)
        electrons = min(electrons, full_well)
        if read_noise > 0.0:
            off, state = draw_normal(state)
            electrons += off * read_noise
        out[pixel] = np.uint16(min(max(np.rint(electrons / per_level), 0.0), levels))


@compiled_unchecked
def add_planes(stack: Any, weights: Any, out: Any) -> Any:
    """Add planes of light.

    Parameters
    ----------
    stack : ndarray of float32, shape (G, K, H, W)
        Light of each group at each knot.
    weights : ndarray of float64, shape (H, G, K) or (1, G, K)
        Weight of each plane, in each row or in all.
    out : ndarray of float64, shape (H, W)
        Zeros; receives the sum.
    """
    groups, knots, rows, columns = (U(size) for size in stack.shape)
    each = U(1) if weights.shape[0] > 1 else U(0)
    for row in range(rows):
        for g in range(groups):
            for k in range(knots):
                weight = weights[row * each, g, k]
                if weight != 0.0:
                    for column in range(columns):
                        out[row, column] += weight * stack[g, k, row, column]
