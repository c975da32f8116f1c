"""Compiled inner loop of the encoder: 64 pixels at a time, over eight readouts, which fill a byte of spikes per pixel.

All arithmetic is in IEEE float32 in a fixed order, and nothing is fused or reordered (no fastmath), so the bits are the
same on every machine. Three properties, visible in the machine code, make it fast: the loops over the 64 lanes have no
branch; the state of a pixel stays in registers for eight readouts; and every index is unsigned, because numba checks
signed indices for negative values, which turns plain loads into gathers. Terms that are switched off are passed as
None: numba removes their branches at compile time, so they cost nothing and change no bit.
"""

from functools import cache
from math import sqrt
from typing import Any

import numpy as np
from numba import njit

from saf_gen.core import seeds
from saf_gen.core.compiled import compiled

# A table of normal noise with a flat spectrum, so that its entries are uncorrelated at every distance.
#
# The encoder takes the noise of 64 neighbouring pixels from 64 consecutive entries, and draws the first of them at
# random
# for each readout. The noise of one pixel is therefore independent from readout to readout. Two pixels of a block are
# correlated like two entries at a fixed distance, and in a sequence of N entries with a flat spectrum this
# correlation is
# exactly -1/(N - 1) at every distance [1]_. A table of independent normal draws would have correlations of 1/sqrt(N),
# which would be the same in every block of the array.
#
# References
# ----------
# .. [1] M. R. Schroeder, Synthesis of low-peak-factor signals and binary sequences with low autocorrelation,
#    IEEE Trans. Inf. Theory 16, 1970, doi:10.1109/TIT.1970.1054411.


LANES = 64  # pixels that the encoder advances together
NOISE_TABLE_SIZE = 1 << 16
_GRID = 2.0**12


@cache
def make_noise_table() -> np.ndarray:
    """Return standard normal noise, float32 (NOISE_TABLE_SIZE + LANES,), read-only.

    The last LANES entries repeat the first. Mean 0 and variance 1 are exact to 1e-6, and the largest absolute value is
    below 5. Values are rounded to multiples of 2⁻¹², far below what a threshold resolves, so that the table is
    identical on machines whose sine differs in the last digit.
    """
    phase = 2 * np.pi * seeds.make_generator("encoder", "noise table").random(NOISE_TABLE_SIZE // 2 - 1)
    spectrum = np.zeros(NOISE_TABLE_SIZE // 2 + 1, np.complex128)  # 0 at frequency 0, so that the mean is 0
    spectrum[1:-1] = np.exp(1j * phase)
    noise = np.fft.irfft(spectrum)
    noise = (np.round(noise / noise.std() * _GRID) / _GRID).astype(np.float32)
    table = np.concatenate([noise, noise[:LANES]])
    table.flags.writeable = False
    return table


BLOCK_KEY_STEP = 0xD1342543DE82EF95  # difference of the noise keys of consecutive blocks of pixels

U = np.uint64
ZERO, ONE, EIGHT, MASK = U(0), U(1), U(8), U(NOISE_TABLE_SIZE - 1)
_, L, L2, L3, L4, L5, L6, L7 = (U(i * LANES) for i in range(8))  # starts of the rows of lanes
HELD, THRESHOLD, WEIGHT, DARK, MEAN, SD, CAP = (U(i * LANES) for i in range(7))
STRIDE = U(BLOCK_KEY_STEP)
NOTHING = np.float32(-1e30)


@njit(inline="always")
def mixed_word(word: Any) -> Any:
    """Return a word mixed by the finaliser of SplitMix64 (Steele, Lea and Flood 2014, doi:10.1145/2660193.2660195)."""
    word = (word ^ (word >> U(30))) * U(0xBF58476D1CE4E5B9)
    word = (word ^ (word >> U(27))) * U(0x94D049BB133111EB)
    return word ^ (word >> U(31))


@njit(inline="always")
def _spread(sd: Any, charge: Any, jitter: Any) -> Any:
    """Return the standard deviation of the next threshold, including the effect of reset jitter if it is on."""
    return sd if jitter is None else np.float32(sqrt(sd * sd + (jitter * charge) * (jitter * charge)))


@njit(inline="always")
def _read(
    held: Any, threshold: Any, weight: Any, byte: Any, flag: Any, charge: Any, noise: Any, mean: Any,
    sd: Any, cap: Any, weight_after: Any, jitter: Any
) -> Any:  # fmt: skip
    """Return the state of a pixel after a readout: charge held, threshold, weight of the next readout, byte of spikes.

    ``flag`` is the bit of this readout in the byte.
    """
    filled = held + weight * charge
    excess = filled - threshold
    kept = excess if excess < cap else cap
    fresh = mean + _spread(sd, charge, jitter) * noise
    fired = filled >= threshold
    return (
        kept if fired else filled,
        fresh if fired else threshold,
        weight_after if fired else np.float32(1),
        byte | (np.uint32(flag) if fired else np.uint32(0)),
    )


@njit(inline="always")
def store_word(out: Any, p: Any, column: Any, word: Any) -> Any:
    """Store eight consecutive bytes of a pixel, the lowest first, in a form that the compiler merges into one store."""
    out[p, column] = np.uint8(word)
    out[p, column + ONE] = np.uint8(word >> U(8))
    out[p, column + U(2)] = np.uint8(word >> U(16))
    out[p, column + U(3)] = np.uint8(word >> U(24))
    out[p, column + U(4)] = np.uint8(word >> U(32))
    out[p, column + U(5)] = np.uint8(word >> U(40))
    out[p, column + U(6)] = np.uint8(word >> U(48))
    out[p, column + U(7)] = np.uint8(word >> U(56))


@njit(inline="always")
def store_eight(out: Any, start: Any, width: Any, column: Any, tile: Any) -> Any:
    """Store eight consecutive bytes of each pixel."""
    for i in range(width):
        word = U(tile[i])
        word |= U(tile[L + i]) << U(8)
        word |= U(tile[L2 + i]) << U(16)
        word |= U(tile[L3 + i]) << U(24)
        word |= U(tile[L4 + i]) << U(32)
        word |= U(tile[L5 + i]) << U(40)
        word |= U(tile[L6 + i]) << U(48)
        word |= U(tile[L7 + i]) << U(56)
        store_word(out, start + i, column, word)


@compiled
def advance_pixels(
    first: Any, stop: Any, stack: Any, index: Any, low_weight: Any, high_weight: Any, key: Any, done: Any,
    table: Any, response: Any, fixed: Any, weight_after: Any, jitter: Any, lead: Any, before: Any, state: Any, out: Any
) -> Any:  # fmt: skip
    """Advance the pixel blocks ``first <= block < stop`` by all readouts of one call, in place.

    Parameters
    ----------
    first, stop : int
        First block of 64 pixels, and the block after the last.
    stack : ndarray of float32, shape (G, K, P)
        Charge of each light group at each knot, in P pixels, electrons per readout at gain 1.
    index : ndarray of int64, shape (T,)
        Knot before each readout.
    low_weight, high_weight : ndarray of float32, shape (T, G)
        Weights of the knots ``index`` and ``index + 1``, gain included.
    key : uint64
        Key of the noise. With the block and the number of a readout it determines the entry of ``table`` at which the
        noise of that readout begins.
    done : int
        Readouts recorded in earlier calls.
    table : ndarray of float32, shape (NOISE_TABLE_SIZE + 64,)
        Table of normal noise.
    response : ndarray of float32, shape (P,)
        Relative response of each pixel.
    fixed : ndarray of float32, shape (4, P)
        Dark charge, mean threshold, its standard deviation, and the largest charge kept above the threshold.
    weight_after : float32
        Fraction of its charge that the readout after a spike collects.
    jitter : float32 or None
        Rms of the instant of a reset, readouts.
    lead : ndarray of float32, shape (P,), or None
        Readouts by which a pixel is read before the last row.
    before : ndarray of float32, shape (P,), or None
        Charge of the previous readout, if there is a ``lead``.
    state : ndarray of float32, shape (3, P)
        Charge held, threshold, and weight of the next readout's charge.
    out : ndarray of uint8, shape (P, ceil(T / 8))
        Receives the packed spikes.
    """
    groups, knots = U(stack.shape[0]), stack.shape[1]
    pixels, frames = U(stack.shape[2]), U(index.shape[0])
    groups_of_eight = (frames + U(7)) // EIGHT
    low = np.zeros(stack.shape[0] * LANES, np.float32)
    high = np.zeros(stack.shape[0] * LANES, np.float32)
    lane = np.zeros(7 * LANES, np.float32)
    charge = np.zeros(8 * LANES, np.float32)
    entry = np.zeros(8, np.uint64)
    byte = np.zeros(LANES, np.uint32)
    tile = np.zeros(8 * LANES, np.uint8)
    for block in range(U(first), U(stop)):
        start = block * L
        width = min(L, pixels - start)
        for i in range(width):
            for j in range(U(3)):
                lane[j * L + i] = state[j, start + i]
            for j in range(U(4)):
                lane[DARK + j * L + i] = fixed[j, start + i]
        block_key = mixed_word(U(key) + block * STRIDE)
        knot = np.int64(-1)
        for group in range(groups_of_eight):
            count = min(EIGHT, frames - group * EIGHT)
            for s in range(count):
                t = group * EIGHT + s
                if index[t] != knot:
                    knot = index[t]
                    after = min(knot + 1, knots - 1)
                    for g in range(groups):
                        for i in range(width):
                            low[g * L + i] = stack[g, knot, start + i] * response[start + i]
                            high[g * L + i] = stack[g, after, start + i] * response[start + i]
                at = s * L
                a, b = low_weight[t, ZERO], high_weight[t, ZERO]
                for i in range(L):
                    charge[at + i] = lane[DARK + i] + (a * low[i] + b * high[i])
                for g in range(ONE, groups):
                    a, b = low_weight[t, g], high_weight[t, g]
                    row_of_group = g * L
                    for i in range(L):
                        charge[at + i] += a * low[row_of_group + i] + b * high[row_of_group + i]
                if lead is not None:
                    for i in range(width):
                        now = charge[at + i]
                        last = now if U(done) + t == ZERO else before[start + i]
                        charge[at + i] = now + lead[start + i] * (last - now)
                        before[start + i] = now
                entry[s] = mixed_word(block_key + (U(done) + t) * U(0x9E3779B97F4A7C15)) & MASK
            for s in range(count, EIGHT):  # nothing may fire after the last readout
                for i in range(L):
                    charge[s * L + i] = NOTHING
            p0, p1, p2, p3 = entry[ZERO], entry[ONE], entry[U(2)], entry[U(3)]
            p4, p5, p6, p7 = entry[U(4)], entry[U(5)], entry[U(6)], entry[U(7)]
            for i in range(L):
                x, y, z = lane[HELD + i], lane[THRESHOLD + i], lane[WEIGHT + i]
                mean, sd, cap = lane[MEAN + i], lane[SD + i], lane[CAP + i]
                # Unrolled by hand, because numba does not unroll loops before it vectorises them.
                w = np.uint32(0)
                x, y, z, w = _read(x, y, z, w, 1, charge[i], table[p0 + i], mean, sd, cap, weight_after, jitter)
                x, y, z, w = _read(x, y, z, w, 2, charge[L + i], table[p1 + i], mean, sd, cap, weight_after, jitter)
                x, y, z, w = _read(x, y, z, w, 4, charge[L2 + i], table[p2 + i], mean, sd, cap, weight_after, jitter)
                x, y, z, w = _read(x, y, z, w, 8, charge[L3 + i], table[p3 + i], mean, sd, cap, weight_after, jitter)
                x, y, z, w = _read(x, y, z, w, 16, charge[L4 + i], table[p4 + i], mean, sd, cap, weight_after, jitter)
                x, y, z, w = _read(x, y, z, w, 32, charge[L5 + i], table[p5 + i], mean, sd, cap, weight_after, jitter)
                x, y, z, w = _read(x, y, z, w, 64, charge[L6 + i], table[p6 + i], mean, sd, cap, weight_after, jitter)
                x, y, z, w = _read(x, y, z, w, 128, charge[L7 + i], table[p7 + i], mean, sd, cap, weight_after, jitter)
                lane[HELD + i], lane[THRESHOLD + i], lane[WEIGHT + i], byte[i] = x, y, z, w
            row = group & U(7)
            for i in range(L):
                tile[row * L + i] = np.uint8(byte[i])
            if row == U(7):
                store_eight(out, start, width, group - row, tile)
            elif group + ONE == groups_of_eight:
                for i in range(width):
                    for j in range(row + ONE):
                        out[start + i, group - row + j] = tile[j * L + i]
        for i in range(width):
            for j in range(U(3)):
                state[j, start + i] = lane[j * L + i]
