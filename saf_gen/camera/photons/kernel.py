"""Compiled inner loops of a single-photon array.

A pixel that is never blind detects a number of photons with a Poisson law, so that a frame in which it expects H holds
one or more with the probability p = 1 - exp(-H). With a clocked recharge that is the law of its bit: it is 1 if a
random number of 32 bits is below p. 64 frames of a pixel are drawn together. The upper eight bits of their numbers are
pairs of random words of 32 bits, a pair for each, which a few logical operations compare with the least and the largest
p of these frames, or of each eight of them where light changes fast. That decides all but a few frames in a thousand,
and these compare all 32 bits with their own p. Words belong to 64 frames that are counted from the beginning of the
recording, and no bound changes a bit, so the bits do not depend on how a recording is cut into calls.

Arithmetic is in IEEE float32 and float64 in a fixed order (no fastmath), so the bits are the same on every machine; the
loops over the 64 pixels of a block have no branch. Terms that are switched off are passed as None, and cost nothing.
"""

from typing import Any

import numpy as np
from numba import njit

from saf_gen.camera.encoder_kernel import LANES, L, mixed_word, store_word
from saf_gen.core.compiled import compiled_unchecked

U, W, F = np.uint64, np.uint32, np.float32
ZERO, ONE, EIGHT = U(0), U(1), U(8)
ALL = U(0xFFFFFFFFFFFFFFFF)
EACH_BYTE, ALL_HALF = W(0x01010101), W(0xFFFFFFFF)
HALF, QUARTER = U(2), U(4)
GOLDEN = U(0x9E3779B97F4A7C15)  # between two words of a pixel, as in SplitMix64
TAIL, PULSE = U(0xD1B54A32D192ED03), U(0x8CB92BA72F3D8DD7)  # for other random words of a pixel than those of its bits
MOST_PHOTONS = F(16.0)  # beyond, a bit of ten million frames is 0
PART, DOUBLINGS = F(1 / 16), 4  # the polynomial is that of a 16th of the photons
A0, A1, A2 = F(0.9999999403953552), F(-0.4999951720237732), F(0.16660967469215393)
A3, A4, A5 = F(-0.04141876474022865), F(0.00783736351877451), F(-0.0009125453652814031)
GUARD = F(2.0**-19)  # far above what rounding does to p
ALMOST_ONE = F(0.9999)
LITTLE, FEW = (
    F(2.0**-7),
    16,
)  # a change of the photons, and pixels: the bounds of eight frames then cost more than they spare
LOWEST_BIT = U(
    0x03F79D71B4CB0A89
)  # a de Bruijn sequence: its upper six bits tell by which power of two it was multiplied
PLACES = np.zeros(64, np.uint64)
for _place in range(64):
    PLACES[(int(LOWEST_BIT) << _place & 0xFFFFFFFFFFFFFFFF) >> 58] = _place


@njit(inline="always")
def _detected(photons: Any) -> Any:
    """Return 1 - exp(-photons) to a relative 5e-7, from sums and products alone.

    It is that of a 16th of the photons, by a polynomial (through the Chebyshev nodes of 0 to 1), and then four times
    p(2x) = p(x)·(2 - p(x)), in which nothing cancels.
    """
    x = (photons if photons < MOST_PHOTONS else MOST_PHOTONS) * PART
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
    """Return 32 random bits from the two words of a pixel and of some frames: a mixer of M. O'Neill's kind.

    Two words each, because one alone would give the same bits again to some other pixel in some other frames.
    """
    word = _turned(pixel ^ frame, W(16), W(0x7FEB352D))
    word = _turned(word ^ pixel_too ^ frame_too, W(15), W(0x846CA68B))
    word = _turned(word, W(16), W(0x9E3779B1))
    return W(word ^ (word >> W(15)))


@njit(inline="always")
def _replaced(below: Any, plane: Any, bound: Any, bit: Any) -> Any:
    """Return which of 32 numbers are below a bound, of whose lower bits ``below`` tells so, with one bit more of each.

    ``bound`` holds a byte for each eight of the numbers, from the lowest.
    """
    ones = W(W(bound >> bit) & EACH_BYTE)
    wanted = W(W(ones << W(8)) - ones)  # the bit, eight times
    return W(below ^ W(W(plane ^ wanted) & W(below ^ wanted)))


@njit(inline="always")
def _find_extremes(photons: Any, first: Any, stop: Any, fewest: Any, largest: Any) -> Any:
    """Set the fewest and the most photons of each eight frames, (8, 64), and return whether light hardly changes.

    The last row of each holds those of all frames. Light hardly changes if in few pixels p changes so much that many
    frames would have to be decided one by one.
    """
    for i in range(L):
        fewest[EIGHT * L + i], largest[EIGHT * L + i] = MOST_PHOTONS, F(0.0)
    for eighth in range(first, stop):
        row, into = eighth * EIGHT * L, eighth * L
        for i in range(L):
            low, high = MOST_PHOTONS, F(0.0)
            for s in range(EIGHT):
                here = photons[row + s * L + i]
                low, high = here if here < low else low, here if here > high else high
            high = high if high < MOST_PHOTONS else MOST_PHOTONS
            fewest[into + i], largest[into + i] = low, high
        for i in range(L):
            low, high = fewest[into + i], largest[into + i]
            below, above = fewest[EIGHT * L + i], largest[EIGHT * L + i]
            fewest[EIGHT * L + i] = low if low < below else below
            largest[EIGHT * L + i] = high if high > above else above
    changing = np.int32(0)
    for i in range(L):
        changing += np.int32(largest[EIGHT * L + i] - fewest[EIGHT * L + i] > LITTLE)
    return changing < np.int32(FEW)


@njit(inline="always")
def _bound_chances(row: Any, into: Any, factor: Any, fewest: Any, largest: Any, least: Any, most: Any) -> Any:
    """Add to the bounds of all pixels ``factor`` times 256 p, rounded down, of the fewest and the most photons.

    1 - exp(-H) is concave, so that it rises by less than its slope at the fewest photons. Short loops: a long one is
    not vectorised.
    """
    for i in range(L):
        low, high = fewest[row + i], largest[row + i]
        p = _detected(low)
        top, bottom = p + (high - low) * (F(1.0) - p) + GUARD, p - GUARD
        fewest[row + i] = (bottom if bottom > F(0.0) else F(0.0)) * F(256.0)
        largest[row + i] = (top if top < ALMOST_ONE else ALMOST_ONE) * F(256.0)
    for i in range(L):
        least[into + i] += W(W(np.int32(fewest[row + i])) * factor)
        most[into + i] += W(W(np.int32(largest[row + i])) * factor)


@njit(inline="always")
def _decide(word: Any, undecided: Any, known: Any, keys: Any, planes: Any, photons: Any, listed: Any, bits: Any) -> Any:
    """Set those bits of 64 frames of all pixels that their upper eight bits do not decide.

    They are listed first, because a processor that guesses wrong whether a pixel has one more loses less by it then.
    """
    count = ZERO
    for i in range(L):
        rest = (U(undecided[i]) | (U(undecided[L + i]) << U(32))) & known
        while rest != ZERO:
            lowest = rest & (ZERO - rest)
            rest ^= lowest
            listed[count] = np.uint16((PLACES[(lowest * LOWEST_BIT) >> U(58)] * L) | i)
            count += ONE
    for n in range(count):
        place = U(listed[n])
        lane, pixel = place // L, place & (L - ONE)
        drawn = mixed_word((keys[pixel] ^ TAIL) + (word * L + lane) * GOLDEN) >> U(40)
        row, bit = (lane >> U(5)) * L + pixel, lane & U(31)
        for k in range(EIGHT):
            drawn |= ((U(planes[k * HALF * L + row]) >> bit) & ONE) << (k + U(24))
        here = photons[place]
        below = np.float64(np.int64(drawn)) < np.float64(_detected(here)) * 2.0**32
        bits[pixel] |= U(below | (here > MOST_PHOTONS)) << lane


@njit(inline="always")
def _pulses(key: Any, word: Any, waits: Any) -> Any:
    """Return 64 independent bits that are 1 with the chance of an afterpulse, from the gaps between them."""
    bits, place, step = ZERO, ZERO, ZERO
    while True:
        drawn = np.float64(np.int64(mixed_word((key ^ PULSE) + (word * L + step) * GOLDEN) >> U(11))) * 2.0**-53
        if drawn >= waits[L]:
            return bits
        gap = ONE
        while drawn >= waits[gap]:
            gap += ONE
        place += gap
        if place > L:
            return bits
        bits |= ONE << (place - ONE)
        step += ONE


@njit(inline="always")
def _followed(bits: Any, pulses: Any, before: Any, skipped: Any, lanes: Any) -> Any:
    """Return the bits of a pixel with afterpulses: a bit is 1 of itself, or after a 1 if its pulse is.

    That is how an addition carries: out of a digit if both its bits are 1, or one of them and the carry into it.
    """
    bits >>= skipped
    either = bits | (pulses >> skipped)
    carries = (bits + either + before) ^ bits ^ either  # into each digit
    return ((bits | (either & carries)) << skipped) & (ALL >> (L - lanes))


@compiled_unchecked
def expose_clocked(
    first: Any, stop: Any, begin: Any, stack: Any, index: Any, low_weight: Any, high_weight: Any, pixel_words: Any,
    moments: Any, response: Any, dark: Any, waits: Any, fired: Any, out: Any
) -> Any:  # fmt: skip
    """Expose the pixel blocks ``first <= block < stop``, which the clock recharges, to all frames of one call.

    Parameters
    ----------
    first, stop : int
        First block of 64 pixels, and the block after the last.
    begin : int
        Number of the first frame, a multiple of 8.
    stack : ndarray of float32, shape (G, K, P)
        Light of each group at each knot, in P pixels: photons that it detects while the gate is open, at gain 1.
    index : ndarray of int64, shape (T,)
        Knot before each frame.
    low_weight, high_weight : ndarray of float32, shape (T, G)
        Weights of the knots ``index`` and ``index + 1``, gain included.
    pixel_words : ndarray of uint32, shape (2, P)
        Random words of the pixels.
    moments : ndarray of uint32, shape (2, 16 N)
        Random words of N times 64 frames, of which the first hold the first frame: eight of their first half, the
        lowest bit first, and eight of the other.
    response, dark : ndarray of float32, shape (P,)
        Relative detection probability, and dark counts per frame.
    waits : ndarray of float64, shape (65,), or None
        Probability 1 - (1 - q)^k that the first of k frames, or another, has an afterpulse if one can be, k from 0.
    fired : ndarray of uint64, shape (P,)
        1 for each pixel that had an avalanche in the last frame, else 0; changed in place.
    out : ndarray of uint8, shape (P, ceil(T / 8))
        Receives the packed bits.
    """
    groups, knots, pixels = U(stack.shape[0]), stack.shape[1], U(stack.shape[2])
    start_frame, end_frame = U(begin), U(begin) + U(index.size)
    low, high = np.zeros(stack.shape[0] * LANES, np.float32), np.zeros(stack.shape[0] * LANES, np.float32)
    photons, counts = np.zeros(LANES * LANES, np.float32), np.zeros(LANES, np.float32)
    keys, bits = np.zeros(LANES, np.uint64), np.zeros(LANES, np.uint64)
    words, planes = np.zeros(2 * LANES, np.uint32), np.zeros(16 * LANES, np.uint32)
    fewest, largest = np.zeros(9 * LANES, np.float32), np.zeros(9 * LANES, np.float32)
    least, most = np.zeros(2 * LANES, np.uint32), np.zeros(2 * LANES, np.uint32)
    ones, undecided = np.zeros(2 * LANES, np.uint32), np.zeros(2 * LANES, np.uint32)
    listed, firsts = np.zeros(LANES * LANES, np.uint16), np.zeros(LANES, np.uint64)
    some = ZERO if waits is None else U(np.ceil(waits[LANES] * 2.0**53))  # below it, a word has at least one pulse
    for block in range(U(first), U(stop)):
        start = block * L
        width = min(L, pixels - start)
        for i in range(width):
            keys[i] = (U(pixel_words[0, start + i]) << U(32)) | U(pixel_words[1, start + i])
            words[i], words[L + i] = pixel_words[0, start + i], pixel_words[1, start + i]
            counts[i] = dark[start + i]
        knot = np.int64(-1)
        for word in range(start_frame // L, (end_frame + L - ONE) // L):
            skipped = max(start_frame, word * L) - word * L  # frames of earlier calls
            lanes = min(end_frame - word * L, L)
            for lane in range(skipped, lanes):
                t = word * L + lane - start_frame
                if index[t] != knot:
                    knot = index[t]
                    after = min(knot + 1, knots - 1)
                    for g in range(groups):
                        for i in range(width):
                            low[g * L + i] = stack[g, knot, start + i] * response[start + i]
                            high[g * L + i] = stack[g, after, start + i] * response[start + i]
                a, b, row = low_weight[t, ZERO], high_weight[t, ZERO], lane * L
                for i in range(L):
                    photons[row + i] = counts[i] + (a * low[i] + b * high[i])
                for g in range(ONE, groups):
                    a, b = low_weight[t, g], high_weight[t, g]
                    light = g * L
                    for i in range(L):
                        photons[row + i] += a * low[light + i] + b * high[light + i]
            ends = (lanes + U(7)) // EIGHT
            for lane in range(
                lanes, ends * EIGHT
            ):  # the last frames of a recording, so that they have the bounds of eight
                for i in range(L):
                    photons[lane * L + i] = photons[(lanes - ONE) * L + i]
            for i in range(HALF * L):
                least[i] = most[i] = W(0)
            if _find_extremes(photons, skipped // EIGHT, ends, fewest, largest):
                _bound_chances(EIGHT * L, ZERO, EACH_BYTE, fewest, largest, least, most)
                for i in range(L):
                    least[L + i], most[L + i] = least[i], most[i]
            else:
                for eighth in range(skipped // EIGHT, ends):
                    factor = W(W(1) << W((eighth & U(3)) * EIGHT))
                    _bound_chances(eighth * L, eighth // QUARTER * L, factor, fewest, largest, least, most)
            known = (ALL >> (L - lanes)) & (ALL << skipped)
            for half in range(HALF):
                row, moment = half * L, (word - start_frame // L) * HALF * EIGHT + half * EIGHT
                for i in range(L):
                    one, maybe = W(0), ALL_HALF
                    for k in range(EIGHT):
                        plane = _drawn(words[i], words[L + i], moments[0, moment + k], moments[1, moment + k])
                        planes[k * HALF * L + row + i] = plane
                        one = _replaced(one, plane, least[row + i], W(k))
                        maybe = _replaced(maybe, plane, most[row + i], W(k))
                    ones[row + i], undecided[row + i] = one, W(maybe & W(~one))
            for i in range(L):
                bits[i] = (U(ones[i]) | (U(ones[L + i]) << U(32))) & known
            _decide(word, undecided, known, keys, planes, photons, listed, bits)
            if waits is not None:
                for i in range(L):
                    firsts[i] = mixed_word((keys[i] ^ PULSE) + word * L * GOLDEN) >> U(11)
                for i in range(width):
                    if firsts[i] < some:
                        pulses = _pulses(keys[i], word, waits)
                        bits[i] = _followed(bits[i], pulses, fired[start + i], skipped, lanes)
                for i in range(width):
                    fired[start + i] = bits[i] >> (lanes - ONE)
            column = (word * L + skipped - start_frame) // EIGHT
            if skipped == ZERO and ends == EIGHT:
                for i in range(width):
                    store_word(out, start + i, column, bits[i])
            else:
                for i in range(width):
                    for j in range(skipped // EIGHT, ends):
                        out[start + i, column + j - skipped // EIGHT] = np.uint8(bits[i] >> (j * EIGHT))


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
