"""Evidence for how spikes are laid out in a file that does not say so.

A guess needs evidence. In the right layout, the picture of spike counts agrees with itself: a pixel resembles the pixel
below it more than any other at that distance in the file, the picture comes again frame after frame, and neighbours
across the border of two bytes differ as little as others. A pixel of a spike camera fires at nearly equal intervals, so
it seldom fires in two readouts in a row: that tells time from rows and columns, and the first readout of a byte from
its last. Where nothing of this is seen, as in the dark, in uniform light or in random bits, there is no evidence.

Spikes are bits of bytes here, the least significant bit first; *msb* means that the file has the other order.
"""

from collections.abc import Iterable

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft

MIN_T = 6.0
"""Smallest ratio of a difference to its standard error that counts as evidence."""
BEFORE, AFTER = slice(None, -1), slice(1, None)
MIN_SIDE = 16
"""Smallest number of rows and of columns that can show the size of a picture."""
SIDE = 2
"""Distance, in pixels, up to which the best match of a row may lie beside the next row, as on slanted edges."""
CYCLE = 6
"""Frames are counted modulo this number, so that a frame of half or a third of the true size is noticed."""
MIN_FRAME_BITS = 256
"""Smallest frame that is looked for in a file that states no size."""
MIN_EXCLUSION = 50.0
"""Smallest exclusion of two readouts, in standard deviations, that shows the size of a frame."""
MAX_RATIO = 0.8
"""Largest frequency of two spikes in a row, relative to chance, that shows a row to be the train of one pixel."""
KEPT_RATIO = 0.98
"""Largest frequency of two spikes in a row of one axis, relative to another's, at which the other raises a doubt."""
MIN_Z = 8.0
"""Smallest distance of that frequency from chance, in standard deviations."""


def frame_bits(segments: Iterable[np.ndarray]) -> int | None:
    """Return the number of bits after which the trains of a file go on, the size of a frame; None if none is shown.

    Two readouts of a pixel in a row exclude each other more than any other two bits of the file.

    Parameters
    ----------
    segments : iterable of ndarray of uint8
        Pieces of the file of equal length, each of at least two frames.
    """
    total, weight = np.zeros(0), 0
    for segment in segments:
        bit = np.unpackbits(segment).astype(np.float32)
        bit -= bit.mean()
        if not bit.any():
            continue
        padded = next_fast_len(2 * bit.size, real=True)
        power = irfft(np.square(np.abs(rfft(bit, padded))), padded)[: bit.size // 2]
        match = power / power[0] / (1 - np.arange(power.size) / bit.size)
        total, weight = match if not weight else total + match, weight + bit.size
    if total.size <= MIN_FRAME_BITS:
        return None
    total /= weight / (2 * total.size)
    lowest = total[MIN_FRAME_BITS:].min()
    if lowest > -MIN_EXCLUSION / np.sqrt(weight):
        return None
    # A pixel that fires seldom excludes several readouts alike; the first of them is the next frame.
    return MIN_FRAME_BITS + int(np.argmax(total[MIN_FRAME_BITS:] < 0.7 * lowest))


def row_match(counts: np.ndarray) -> float:
    """Return how well neighbouring rows match, 0...1, if counts look like a picture of their size, and 0 if not.

    Parameters
    ----------
    counts : ndarray of number, shape (2, CYCLE, H, W)
        Counts of each pixel in a sample of frames: in its earlier and later half, by the number of the frame modulo
        CYCLE.

    Returns
    -------
    float
        Above 0 if the halves agree best where they lie on each other, and, among shifts by 0.6 to 1.4 rows along the
        file, best within SIDE pixels of one row, both beyond chance; and if the picture is in every frame.
    """
    height, width = counts.shape[2:]
    if height < MIN_SIDE or width < MIN_SIDE:
        return 0.0
    size = height * width
    match = _correlation(*counts.sum(axis=1))
    noise = MIN_T / np.sqrt(size)
    lags = np.arange(int(0.6 * width), min(int(1.4 * width) + 1, size // 2))
    near = np.abs(lags - width) <= SIDE
    row, others = match[lags[near]].max(initial=-1.0), match[lags[~near]]
    # The counts of one pixel in two halves exclude each other a little, so its neighbours in the row help.
    same = match[[-1, 0, 1]].max()
    if same < max(match.max() - noise, noise) or row < others.max() or row - np.median(others) < noise:
        return 0.0
    peaks = others[1:-1][(others[1:-1] > others[:-2]) & (others[1:-1] > others[2:])]
    if row - peaks.max(initial=-1.0) < noise / 2:  # another width would do nearly as well
        return 0.0
    beside = _covariance(*[counts.sum(axis=(0, 1))] * 2)[1]
    for parts in (2, 3):
        if match[size // parts] > 0.8 * same or _is_peak(match, round(width / parts), above=row):
            return 0.0  # the frame, or the row, holds the same several times: it is smaller
        by_frame = counts.reshape(2 * CYCLE // parts, parts, size).sum(axis=0)
        if _covariance(*by_frame[:2])[1] * parts**2 < 0.5 * beside:
            return 0.0  # frames in turn show different parts of a larger one
    return float(row)


def _covariance(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the circular covariance of two pictures at every shift along the file, float (n,)."""
    a, b = (x.ravel() - np.mean(x, dtype=np.float64) for x in (first, second))
    return np.asarray(np.fft.irfft(np.conj(np.fft.rfft(a)) * np.fft.rfft(b), a.size) / a.size)


def _correlation(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    scale = float(np.std(first) * np.std(second))
    return _covariance(first, second) / scale if scale else np.zeros(first.size)


def _is_peak(match: np.ndarray, lag: int, *, above: float) -> bool:
    window = match[max(lag - SIDE, 1) : lag + SIDE + 1].max()
    return bool(window >= above and window > max(match[max(lag - 3 * SIDE, 1)], match[lag + 3 * SIDE]))


def bit_order(counts: np.ndarray, pixel_bits: np.ndarray) -> str | None:
    """Return the order of the bits in a byte that holds eight pixels of a row, ``lsb`` or ``msb``, or None if unclear.

    In a byte, neighbours are neighbours in either order. Across the border of two bytes they are one pixel apart in the
    right order, and so differ as much as those in a byte; in the other order they are 15 pixels apart.

    Parameters
    ----------
    counts : ndarray of number, shape (bits of a frame,)
        Counts of each bit of a frame.
    pixel_bits : ndarray of int, shape (H, W)
        Number of the bit that holds each pixel, least significant bit first.
    """
    c = np.asarray(counts, np.float64)
    bit = pixel_bits[:, :-1]
    in_row = (pixel_bits[:, 1:] == bit + 1) & (bit + 8 < c.size)
    rows, columns = np.nonzero(in_row & (bit % 8 == 7))
    at = bit[rows, columns]
    rows_inside, columns_inside = np.nonzero(in_row & (bit % 8 != 7))
    inside = bit[rows_inside, columns_inside]
    group = max(len(pixel_bits) // 32, 2)
    return _nearer_order(
        lsb=_group_means((c[at] - c[at + 1]) ** 2, rows // group),
        msb=_group_means((c[at - 7] - c[at + 8]) ** 2, rows // group),
        inside=_group_means((c[inside] - c[inside + 1]) ** 2, rows_inside // group),
    )


def _group_means(values: np.ndarray, groups: np.ndarray) -> np.ndarray:
    sizes = np.bincount(groups)
    return np.asarray(np.bincount(groups, values) / np.maximum(sizes, 1))


def _nearer_order(*, lsb: np.ndarray, msb: np.ndarray, inside: np.ndarray) -> str | None:
    """Return the order whose differences across bytes are nearer to those in bytes, or None if chance explains it.

    Each array holds the mean squared difference of neighbours in some groups of rows.
    """
    if not len(lsb) == len(msb) == len(inside) >= 4:
        return None
    gain = np.abs(msb - inside) - np.abs(lsb - inside)
    mean, error = gain.mean(), gain.std(ddof=1) / np.sqrt(gain.size)
    return None if abs(mean) <= MIN_T * error else "lsb" if mean > 0 else "msb"


def time_axes(spikes: np.ndarray) -> list[int]:
    """Return the axes along which two spikes in a row are rarer than chance: time, if there is one such axis.

    Parameters
    ----------
    spikes : ndarray of uint8, shape (A, B, C) or (A, B, C, 8)
        0 and 1; the first three axes are examined.
    """
    sparse = _sparse(spikes)
    pairs = (_along(sparse, axis, span=BEFORE) & _along(sparse, axis, span=AFTER) for axis in range(3))
    return [axis for axis, both in enumerate(pairs) if _rarer(both, _chance(sparse, (axis,)))]


def persistent_axis(spikes: np.ndarray) -> int | None:
    """Return the axis along which a row of an array (A, B, C) keeps its rate best, as a pixel does in time, or None.

    This is weak evidence, since flickering light and stripes look alike: it raises a doubt, but does not decide.
    """
    sparse = _sparse(spikes)
    chances = [_chance(sparse, (axis,)) for axis in range(3)]
    best = int(np.argmax(chances))
    second = max(chance for axis, chance in enumerate(chances) if axis != best)
    return best if chances[best] * KEPT_RATIO > second and second * sparse.size > 1000 else None


def time_packing(planes: np.ndarray) -> list[tuple[int, str]]:
    """Return how bytes (A, B, C) hold eight readouts of a pixel: the axis of time, and ``lsb`` or ``msb`` first.

    In a byte, readouts are neighbours in either order. Across two bytes that follow each other in time, only the last
    readout of one and the first of the next are. The list has one item if the evidence is clear, and is empty if there
    is none.
    """
    bit = _sparse(_unpack(planes))
    pairs = bit[..., :-1] & bit[..., 1:]
    found = []
    for axis in range(3):
        chance = _chance(bit, (axis, 3))
        if not _rarer(pairs, chance):
            continue
        for order, (last, first) in {"lsb": (7, 0), "msb": (0, 7)}.items():
            before, after = _along(bit[..., last], axis, span=BEFORE), _along(bit[..., first], axis, span=AFTER)
            if _rarer(before & after, chance):
                found.append((axis, order))
    return found


def row_packing(planes: np.ndarray) -> tuple[int, int, str] | None:
    """Return how bytes (A, B, C) hold eight pixels of a row in one readout: axis of time, packed axis and bit order.

    None if there is no clear evidence: time must be the only axis along which spikes in a row are rare, and neighbours
    across the border of two bytes must resemble each other along one axis, in one order.
    """
    bit = _unpack(planes)
    times = time_axes(bit)
    if len(times) != 1:
        return None
    counts = bit.sum(axis=times[0], dtype=np.float64)
    found = []
    for side, axis in enumerate(axis for axis in range(3) if axis != times[0]):
        by_row = counts if side == 1 else counts.transpose(1, 0, 2)  # (rows, bytes of a row, 8)
        lsb = ((by_row[:, :-1, 7] - by_row[:, 1:, 0]) ** 2).mean(axis=1)
        msb = ((by_row[:, :-1, 0] - by_row[:, 1:, 7]) ** 2).mean(axis=1)
        inside = (np.diff(by_row, axis=2) ** 2).mean(axis=(1, 2))
        order = _nearer_order(lsb=lsb, msb=msb, inside=inside)
        if order is not None:
            found.append((float(np.mean(lsb if order == "lsb" else msb)), axis, order))
    if not found or (len(found) == 2 and min(found)[0] > MAX_RATIO * max(found)[0]):
        return None
    _, axis, order = min(found)
    return times[0], axis, order


def _unpack(planes: np.ndarray) -> np.ndarray:
    return np.unpackbits(planes[..., None], axis=-1, bitorder="little")


def _sparse(spikes: np.ndarray) -> np.ndarray:
    """Return the spikes, or their gaps if these are rarer: pairs of what is rare are what equal intervals exclude."""
    return spikes if 2 * np.count_nonzero(spikes) <= spikes.size else 1 - spikes


def _along(array: np.ndarray, axis: int, *, span: slice) -> np.ndarray:
    return array[(slice(None),) * axis + (span,)]


def _chance(spikes: np.ndarray, axes: tuple[int, ...]) -> float:
    """Return how often two different places of a row along ``axes`` are both 1: by chance, two neighbours are, too."""
    length = int(np.prod([spikes.shape[axis] for axis in axes]))
    sums = spikes.sum(axis=axes, dtype=np.float64)
    return float(np.mean(sums * (sums - 1))) / max(length * (length - 1), 1)


def _rarer(pairs: np.ndarray, chance: float) -> bool:
    expected, found = chance * pairs.size, float(np.count_nonzero(pairs))
    return found < MAX_RATIO * expected and (expected - found) > MIN_Z * np.sqrt(expected + found)
