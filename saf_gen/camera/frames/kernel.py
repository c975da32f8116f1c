"""Compiled inner loops of a frame camera: light summed over an exposure, and the number that a pixel reads out of it.

Random numbers come from SplitMix64, which begins anew for each pixel of each frame, so that a pixel depends neither on
others nor on the order in which pixels are read. Poisson and normal numbers are drawn by methods that are exact: their
errors are those of float64.
"""

from math import erf, erfc, exp, lgamma, log, pi, sqrt
from typing import Any

import numpy as np
from numba import njit

from saf_gen.camera.encoder_kernel import mixed_word
from saf_gen.core.compiled import compiled_unchecked

U = np.uint64
GOLDEN = U(0x9E3779B97F4A7C15)
UNIT = 2.0**-53
MOST_MEAN = 1e9  # far beyond every well
FEW = 10.0  # mean below which numbers are counted up; the normal law is near enough from here on
MOST_COUNTED = 128  # beyond it, a number of mean 10 has the probability 1e-88
INVERSE = 1 / np.maximum(np.arange(MOST_COUNTED + 1.0), 1)
LOG_FACTORIALS = np.array([lgamma(k + 1.0) for k in range(int(FEW))])
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
def _fraction(word: Any) -> Any:
    """Return a number from 0 to 1, without 1, from the upper 53 bits of a word."""
    return np.float64(np.int64(word >> U(11))) * UNIT


@njit
def _beyond(layer: Any, x: Any, state: Any) -> Any:
    """Return whether a number beyond the core of its layer is accepted, the number, and the state after it."""
    if layer > U(0):
        state += GOLDEN
        height = DENSITY[layer] + _fraction(mixed_word(state)) * (DENSITY[layer + U(1)] - DENSITY[layer])
        return height < exp(-0.5 * x * x), x, state
    while True:  # G. Marsaglia's tail
        state += GOLDEN
        far = -log(1.0 - _fraction(mixed_word(state))) / TAIL
        state += GOLDEN
        if -2.0 * log(1.0 - _fraction(mixed_word(state))) >= far * far:
            return True, (TAIL + far if x > 0.0 else -TAIL - far), state


@njit(inline="always")
def draw_normal(state: Any) -> Any:
    """Return a number of the standard normal law, and the state of the generator after it.

    The ziggurat of G. Marsaglia and W. W. Tsang, J. Stat. Softw. 5, 2000, doi:10.18637/jss.v005.i08, with bits for the
    layer that the number does not share, after J. A. Doornik.
    """
    while True:
        state += GOLDEN
        word = mixed_word(state)
        layer = word & U(LAYERS - 1)
        x = (2.0 * _fraction(word) - 1.0 + UNIT) * ENDS[layer]
        if abs(x) < ENDS[layer + U(1)]:
            return x, state
        kept, x, state = _beyond(layer, x, state)
        if kept:
            return x, state


@njit
def _law(k: Any, mean: Any) -> Any:
    """Return the probability of k by Poisson's law. From 10 on, the factorial is Stirling's series, good to 1e-12."""
    if k < FEW:
        return exp(k * log(mean) - mean - LOG_FACTORIALS[int(k)]) if k >= 0.0 else 0.0
    part = 1.0 / k
    square = part * part
    rest = part * (1 / 12 - square * (1 / 360 - square * (1 / 1260 - square * (1 / 1680))))
    return exp(k * log(mean * part) + (k - mean) - rest) / sqrt(2 * pi * k)


@njit
def _rounded_normal(k: Any, mean: Any) -> Any:
    """Return the probability that a normal number of this mean and variance, rounded down, is k."""
    scale = sqrt(0.5 / mean)
    near, far = abs(k - mean) * scale, abs(k + 1.0 - mean) * scale
    if k <= mean <= k + 1.0:
        return 0.5 * (erf(near) + erf(far))
    return 0.5 * abs(erfc(near) - erfc(far))


@njit
def _corrected(normal: Any, share: Any, mean: Any, state: Any) -> Any:
    """Return what takes the place of a rounded normal number that was not accepted at once, and the state after it.

    It is still accepted with the ratio of both laws, and otherwise drawn where Poisson's law is the larger one, from
    a double exponential law that is above the difference.
    """
    if _rounded_normal(normal, mean) * (1.0 - share) <= _law(normal, mean) and normal >= 0.0:
        return normal, state
    while True:
        state += GOLDEN
        far = -log(1.0 - _fraction(mixed_word(state)))
        state += GOLDEN
        u = 2.0 * _fraction(mixed_word(state)) - 1.0
        t = 1.8 + (far if u >= 0.0 else -far)
        if t > -0.6744:
            k = np.floor(mean + sqrt(mean) * t)
            if 0.1069 / mean * abs(u) <= (_law(k, mean) - _rounded_normal(k, mean)) * exp(far):
                return k, state


@njit(inline="always")
def draw_poisson(mean: Any, state: Any) -> Any:
    """Return a number of Poisson's law, as a float, and the state of the generator after it.

    Few are counted up: the least number whose cumulative probability exceeds a random one. Many are a normal number,
    rounded down, unless it is one of the few that Poisson's law has less often: J. H. Ahrens and U. Dieter, algorithm
    PD, ACM Trans. Math. Softw. 8, 1982, doi:10.1145/355993.355997, here with both laws in full where they published
    approximations. The share of a normal number to leave out is below (mean - k)³/(6 mean²), and is none from
    k = mean - 1.1484 on, so that the laws themselves are seldom needed.
    """
    if mean < FEW:
        state += GOLDEN
        drawn, k, probability = _fraction(mixed_word(state)), 0, exp(-mean)
        while drawn >= probability and k < MOST_COUNTED:
            drawn -= probability
            k += 1
            probability *= mean * INVERSE[k]
        return np.float64(k), state
    normal, state = draw_normal(state)
    number = np.floor(mean + sqrt(mean) * normal)
    state += GOLDEN
    share = _fraction(mixed_word(state))
    less = mean - number
    if less * less * less > share * (6.0 * mean * mean):
        number, state = _corrected(number, share, mean, state)
    return number, state


@compiled_unchecked
def read_out(
    charge: Any, response: Any, dark: Any, key: Any, shot: Any, full_well: Any, read_noise: Any, per_level: Any,
    black: Any, levels: Any, out: Any
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
    black, levels : float
        Number of a pixel without charge, and the largest number.
    out : ndarray of uint16, shape (P,)
        Receives the numbers.
    """
    for pixel in range(U(charge.size)):
        state = mixed_word(U(key) + pixel * GOLDEN)
        electrons = min(charge[pixel] * response[pixel] + dark[pixel], MOST_MEAN)
        if shot:
            electrons, state = draw_poisson(electrons, state)
        electrons = min(electrons, full_well)
        if read_noise > 0.0:
            off, state = draw_normal(state)
            electrons += off * read_noise
        out[pixel] = np.uint16(min(max(np.rint(electrons / per_level) + black, 0.0), levels))


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
    groups, knots, rows, columns = U(stack.shape[0]), U(stack.shape[1]), U(stack.shape[2]), U(stack.shape[3])
    each = U(1) if weights.shape[0] > 1 else U(0)
    for row in range(rows):
        for g in range(groups):
            for k in range(knots):
                weight = weights[row * each, g, k]
                if weight != 0.0:
                    for column in range(columns):
                        out[row, column] += weight * stack[g, k, row, column]
