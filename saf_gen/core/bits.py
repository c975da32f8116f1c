"""Spikes as bits along time: functions that pack and unpack frames, count spikes and transpose bit matrices.

Time-packed spikes are uint8 (H, W, ceil(T/8)): frame t is bit t mod 8, least significant first, of byte t div 8. This
order suits a disk, because the bytes of one pixel are alike and compress well. In memory the same bytes are stored as
*planes*, uint8 (bytes, H, W): a window of all pixels is then contiguous, and counting its spikes is five times faster.
The kernels release Python's global interpreter lock, run on one thread, and do not check their arguments; the modules
that receive arrays from users do.
"""

import numba
import numpy as np


@numba.njit(nogil=True, cache=True)
def _add_counts(planes, first, stop, counts):
    first_byte, last_byte = first >> 3, (stop - 1) >> 3
    for b in range(first_byte, last_byte + 1):
        mask = 255
        if b == first_byte:
            mask &= 255 << (first & 7)
        if b == last_byte:
            mask &= 255 >> (7 - ((stop - 1) & 7))
        for y in range(counts.shape[0]):
            for x in range(counts.shape[1]):
                # Add up 2, 4, then 8 neighbouring bits; LLVM vectorises this, because it needs no branches or tables.
                v = np.uint8(planes[b, y, x] & np.uint8(mask))
                v = np.uint8(v - ((v >> np.uint8(1)) & np.uint8(0x55)))
                v = np.uint8((v & np.uint8(0x33)) + ((v >> np.uint8(2)) & np.uint8(0x33)))
                counts[y, x] += np.uint32((v + (v >> np.uint8(4))) & np.uint8(0x0F))


def sum_planes(planes: np.ndarray, counts: np.ndarray, *, first: int, stop: int) -> None:
    """Add the spikes in frames ``first <= t < stop`` of ``planes`` (bytes, h, w) to ``counts``, uint32 (h, w)."""
    if stop > first:
        _add_counts(planes, first, stop, counts)


@numba.njit(nogil=True, cache=True)
def _add_train_counts(words, width, firsts, stops, counts):
    for y in range(counts.shape[1]):
        for x in range(counts.shape[2]):
            train = (y * counts.shape[2] + x) * width
            for k in range(counts.shape[0]):
                first, last = train + firsts[k], train + stops[k] - 1
                total = np.int64(0)
                for i in range(first >> 6, (last >> 6) + 1):
                    v = words[i]
                    if i == first >> 6:
                        v &= np.uint64(0xFFFFFFFFFFFFFFFF) << np.uint64(first & 63)
                    if i == last >> 6:
                        v &= np.uint64(0xFFFFFFFFFFFFFFFF) >> np.uint64(63 - (last & 63))
                    # Add up 2, 4, then 8 neighbouring bits, then all bytes; LLVM turns this into one instruction.
                    v -= (v >> np.uint64(1)) & np.uint64(0x5555555555555555)
                    v = (v & np.uint64(0x3333333333333333)) + ((v >> np.uint64(2)) & np.uint64(0x3333333333333333))
                    v = (v + (v >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
                    total += np.int64((v * np.uint64(0x0101010101010101)) >> np.uint64(56))
                counts[k, y, x] += total


def sum_trains(trains: np.ndarray, counts: np.ndarray, *, firsts: np.ndarray, stops: np.ndarray) -> None:
    """Add the spikes in windows of the time-packed ``trains``, uint8 (h, w, bytes), to ``counts`` (windows, h, w).

    Window k is ``firsts[k] <= t < stops[k]``, int64, and is not empty. All windows of a pixel are counted before the
    next pixel, while its spike train is in the cache.
    """
    flat = np.ascontiguousarray(trains).reshape(-1)
    if flat.size % 8:
        flat = np.concatenate([flat, np.zeros(-flat.size % 8, np.uint8)])
    _add_train_counts(flat.view("<u8"), 8 * trains.shape[2], firsts, stops, counts)


@numba.njit(nogil=True, cache=True)
def _pack(frames, planes):
    for b in range(planes.shape[0]):
        for y in range(planes.shape[1]):
            for x in range(planes.shape[2]):
                planes[b, y, x] = 0
            for t in range(8 * b, min(8 * b + 8, frames.shape[0])):
                bit = np.uint8(1 << (t - 8 * b))
                for x in range(planes.shape[2]):
                    planes[b, y, x] |= bit if frames[t, y, x] else np.uint8(0)


def pack_bits(frames: np.ndarray) -> np.ndarray:
    """Pack frames (n, h, w), nonzero for a spike, along time as uint8 (h, w, ceil(n/8)); unused last bits are 0."""
    planes = np.empty((-(-frames.shape[0] // 8), *frames.shape[1:]), np.uint8)
    _pack(frames, planes)
    return np.ascontiguousarray(planes.transpose(1, 2, 0))


@numba.njit(nogil=True, cache=True)
def _unpack(planes, first, frames):
    for t in range(frames.shape[0]):
        byte, bit = (first + t) >> 3, np.uint8((first + t) & 7)
        for y in range(frames.shape[1]):
            for x in range(frames.shape[2]):
                frames[t, y, x] = planes[byte, y, x] >> bit & np.uint8(1)


def unpack_bits(planes: np.ndarray, frames: np.ndarray, *, first: int) -> None:
    """Fill ``frames``, uint8 (n, h, w), with frames ``first <= t < first + n`` of ``planes``, uint8 (bytes, h, w)."""
    _unpack(planes, first, frames)


@numba.njit(nogil=True, cache=True)
def _transpose_word(word):
    # Transpose an 8x8 bit matrix held in 64 bits by swapping blocks of 1, 2 and 4 bits across the diagonal
    # (H. S. Warren, Hacker's Delight, 2nd ed., section 7-3).
    t = (word ^ (word >> np.uint64(7))) & np.uint64(0x00AA00AA00AA00AA)
    word = word ^ t ^ (t << np.uint64(7))
    t = (word ^ (word >> np.uint64(14))) & np.uint64(0x0000CCCC0000CCCC)
    word = word ^ t ^ (t << np.uint64(14))
    t = (word ^ (word >> np.uint64(28))) & np.uint64(0x00000000F0F0F0F0)
    return word ^ t ^ (t << np.uint64(28))


@numba.njit(nogil=True, cache=True)
def _transpose(rows, trains):
    count, width = rows.shape
    for c in range(width):
        for b in range(trains.shape[1]):
            word = np.uint64(0)
            for i in range(min(8, count - 8 * b)):
                word |= np.uint64(rows[8 * b + i, c]) << np.uint64(8 * i)
            word = _transpose_word(word)
            for i in range(8):
                trains[8 * c + i, b] = np.uint8(word >> np.uint64(8 * i) & np.uint64(255))


def to_trains(rows: np.ndarray) -> np.ndarray:
    """Return the transpose of a bit matrix uint8 (n, B) as uint8 (8 B, ceil(n/8)), least significant bit first.

    Row t of ``rows`` is one frame of a file of another program; row p of the result is bit p of all frames over time.
    """
    trains = np.empty((8 * rows.shape[1], -(-rows.shape[0] // 8)), np.uint8)
    _transpose(rows, trains)
    return trains


def to_frames(trains: np.ndarray, count: int) -> np.ndarray:
    """Return the first ``count`` frames, uint8 (count, B), of spike trains, uint8 (8 B, bytes).

    This is the inverse of :func:`to_trains`.
    """
    frames = np.empty((8 * trains.shape[1], trains.shape[0] // 8), np.uint8)
    _transpose(trains, frames)
    return frames[:count]
