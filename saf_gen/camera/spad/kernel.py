"""Compiled inner loops of a single-photon array, over eight frames, which fill a byte of bits per pixel.

A pixel that is never blind detects a number of photons with a Poisson law, so that a frame in which it expects H holds
one or more with the probability p = 1 - exp(-H). With a clocked recharge that is the law of its bit. All arithmetic is
in IEEE float32 in a fixed order (no fastmath), so the bits are the same on every machine; the loops over the 64 lanes
have no branch. Terms that are switched off are passed as None, and cost nothing.
"""

from typing import Any

import numpy as np
from numba import njit

from saf_gen.camera.encoder_kernel import L2, LANES, L, store_eight
from saf_gen.core.compiled import compiled_unchecked

U, W, F = np.uint64, np.uint32, np.float32
ZERO, ONE, EIGHT = U(0), U(1), U(8)
BEFORE, PHOTONS = L, L2  # starts of the rows of lanes, after the dark counts
OWN_TOO, BYTE = L, L2  # and after the first random word
MOST_PHOTONS = F(16.0)  # beyond, a bit of ten million frames is 0
PART, DOUBLINGS = F(1 / 16), 4  # the polynomial is that of a 16th of the photons
A0, A1, A2 = F(0.9999999403953552), F(-0.4999951720237732), F(0.16660967469215393)
A3, A4, A5 = F(-0.04141876474022865), F(0.00783736351877451), F(-0.0009125453652814031)
UNIT = F(2.0**-31)


@njit(inline="always")
def _detected(photons: Any) -> Any:
    """Return 1 - exp(-photons) to a relative 5e-7, from sums and products alone.

    It is that of a 16th of the photons, by a polynomial (through the Chebyshev nodes of 0 to 1), and then four times
    p(2x) = p(x)·(2 - p(x)), in which nothing cancels.
    """
    x = min(photons, MOST_PHOTONS) * PART
    x2 = x * x
    p = x * (((A0 + A1 * x) + x2 * (A2 + A3 * x)) + (x2 * x2) * (A4 + A5 * x))
    for _ in range(DOUBLINGS):
        p = p * (F(2.0) - p)
    return p


@njit(inline="always")
def _turned(word: Any, shift: Any, factor: Any) -> Any:
    """Return a word shifted onto itself and multiplied, in 32 bits, to which numba must be held at every step."""
    return W(W(W(word) ^ (W(word) >> shift)) * factor)


@njit(inline="always")
def _drawn(pixel: Any, pixel_too: Any, frame: Any, frame_too: Any) -> Any:
    """Return a number of 0 to 1 from the two words of a pixel and of a frame: a mixer of M. O'Neill's kind, of 32 bits.

    Two words each, because one alone would give the same number again to some other pixel in some other frame.
    """
    word = _turned(pixel ^ frame, W(16), W(0x7FEB352D))
    word = _turned(word ^ pixel_too ^ frame_too, W(15), W(0x846CA68B))
    word = _turned(word, W(16), W(0x9E3779B1))
    return F(np.int32(W(word ^ (word >> W(15))) >> W(1))) * UNIT


@compiled_unchecked
def expose_clocked(
    first: Any, stop: Any, stack: Any, index: Any, low_weight: Any, high_weight: Any, pixel_words: Any,
    frame_words: Any, response: Any, dark: Any, afterpulse: Any, fired: Any, out: Any
) -> Any:  # fmt: skip
    """Expose the pixel blocks ``first <= block < stop``, which the clock recharges, to all frames of one call.

    Parameters
    ----------
    first, stop : int
        First block of 64 pixels, and the block after the last.
    stack : ndarray of float32, shape (G, K, P)
        Light of each group at each knot, in P pixels: photons that it detects while the gate is open, at gain 1.
    index : ndarray of int64, shape (T,)
        Knot before each frame.
    low_weight, high_weight : ndarray of float32, shape (T, G)
        Weights of the knots ``index`` and ``index + 1``, gain included.
    pixel_words, frame_words : ndarray of uint32, shapes (2, P) and (2, T)
        Random words of the pixels and of the frames.
    response, dark : ndarray of float32, shape (P,)
        Relative detection probability, and dark counts per frame.
    afterpulse : float32 or None
        Probability that an avalanche causes another in the next frame.
    fired : ndarray of float32, shape (P,)
        1 for each pixel that had an avalanche in the last frame, else 0; changed in place.
    out : ndarray of uint8, shape (P, ceil(T / 8))
        Receives the packed bits.
    """
    groups, knots = U(stack.shape[0]), stack.shape[1]
    pixels, frames = U(stack.shape[2]), U(index.size)
    bytes_of_frames = (frames + U(7)) // EIGHT
    low, high = np.zeros(stack.shape[0] * LANES, np.float32), np.zeros(stack.shape[0] * LANES, np.float32)
    lane, words = np.zeros(3 * LANES, np.float32), np.zeros(3 * LANES, np.uint32)
    tile = np.zeros(8 * LANES, np.uint8)
    for block in range(U(first), U(stop)):
        start = block * L
        width = min(L, pixels - start)
        for i in range(width):
            words[i], words[OWN_TOO + i] = pixel_words[0, start + i], pixel_words[1, start + i]
            lane[i], lane[BEFORE + i] = dark[start + i], fired[start + i]
        knot = np.int64(-1)
        for group in range(bytes_of_frames):
            for i in range(L):
                words[BYTE + i] = W(0)
            for s in range(min(EIGHT, frames - group * EIGHT)):
                t = group * EIGHT + s
                if index[t] != knot:
                    knot = index[t]
                    after = min(knot + 1, knots - 1)
                    for g in range(groups):
                        for i in range(width):
                            low[g * L + i] = stack[g, knot, start + i] * response[start + i]
                            high[g * L + i] = stack[g, after, start + i] * response[start + i]
                a, b = low_weight[t, ZERO], high_weight[t, ZERO]
                for i in range(L):
                    lane[PHOTONS + i] = lane[i] + (a * low[i] + b * high[i])
                for g in range(ONE, groups):
                    a, b = low_weight[t, g], high_weight[t, g]
                    row = g * L
                    for i in range(L):
                        lane[PHOTONS + i] += a * low[row + i] + b * high[row + i]
                word, word_too = frame_words[0, t], frame_words[1, t]
                shift = W(s)
                # Short loops: in a long one, each lane would wait for the products of the one before.
                for i in range(L):
                    lane[PHOTONS + i] = _detected(lane[PHOTONS + i])
                if afterpulse is not None:
                    for i in range(L):
                        lane[PHOTONS + i] += lane[BEFORE + i] * (afterpulse * (F(1.0) - lane[PHOTONS + i]))
                for i in range(L):
                    bit = W(_drawn(words[i], words[OWN_TOO + i], word, word_too) < lane[PHOTONS + i])
                    if afterpulse is not None:
                        lane[BEFORE + i] = F(np.int32(bit))
                    words[BYTE + i] = W(words[BYTE + i] | W(bit << shift))
            row = group & U(7)
            for i in range(L):
                tile[row * L + i] = np.uint8(words[BYTE + i])
            if row == U(7):
                store_eight(out, start, width, group - row, tile)
            elif group + ONE == bytes_of_frames:
                for i in range(width):
                    for j in range(row + ONE):
                        out[start + i, group - row + j] = tile[j * L + i]
        for i in range(width):
            fired[start + i] = lane[BEFORE + i]


@compiled_unchecked
def expose_passive(
    first: Any, stop: Any, stack: Any, index: Any, low_weight: Any, high_weight: Any, pixel_words: Any,
    frame_words: Any, response: Any, dark: Any, afterpulse: Any, blind: Any, out: Any, waits: Any, gate: Any, dead: Any
) -> Any:  # fmt: skip
    """Expose pixels that recharge themselves, avalanche by avalanche.

    Parameters
    ----------
    first, stop, stack, index, low_weight, high_weight, pixel_words, frame_words, response, dark, out : int or ndarray
        As in :func:`expose_clocked`; ``out`` begins with zeros.
    afterpulse : float
        Probability that an avalanche causes another at the end of the dead time.
    blind : ndarray of float64, shape (2, P)
        When the last dead time of each pixel ends, in frames from the beginning of the next one, and whether an
        afterpulse follows it; changed in place.
    waits : ndarray of float64
        Quantiles of the exponential law, a power of two of them.
    gate, dead : float
        Share of a frame in which the gate is open, and the dead time in frames.
    """
    groups, knots, mask = stack.shape[0], stack.shape[1], W(waits.size - 1)
    pixels = stack.shape[2]
    for pixel in range(first * LANES, min(stop * LANES, pixels)):
        ready, follows = blind[0, pixel], blind[1, pixel]
        for t in range(index.size):
            knot = index[t]
            after = min(knot + 1, knots - 1)
            photons = 0.0
            for g in range(groups):
                photons += low_weight[t, g] * stack[g, knot, pixel] + high_weight[t, g] * stack[g, after, pixel]
            rate = (photons * response[pixel] + dark[pixel]) / gate
            follows = follows if ready >= 0.0 else 0.0  # what follows while the gate is closed is not seen
            now, word, hit = max(ready, 0.0), frame_words[0, t], False
            while now < gate:
                if follows == 0.0:
                    if rate <= 0.0:
                        break
                    word = _next(W(word ^ pixel_words[0, pixel]))
                    now += waits[(word ^ pixel_words[1, pixel] ^ frame_words[1, t]) & mask] / rate
                    if now >= gate:
                        break
                hit = True
                word = _next(W(word ^ pixel_words[0, pixel]))
                follows = 1.0 if F(word >> W(8)) * F(2.0**-24) < afterpulse else 0.0
                now += dead
                ready = now
            ready -= 1.0
            if hit:
                out[pixel, t >> 3] |= np.uint8(1 << (t & 7))
        blind[0, pixel], blind[1, pixel] = ready, follows


@njit(inline="always")
def _next(word: Any) -> Any:
    """Return the next word of a pixel's frame."""
    word = _turned(_turned(word, W(16), W(0x7FEB352D)), W(15), W(0x846CA68B))
    return W(word ^ (word >> W(16)))
