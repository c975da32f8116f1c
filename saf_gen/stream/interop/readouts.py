"""Readouts that a recording holds twice or has lost: from frame counters and time stamps, or from its spikes.

A recorder that is too slow stores a readout twice or leaves some out. Counters and time stamps show it. The spikes show
it too: no two readouts of a scene are alike, because a pixel that has just fired starts again; and where readouts are
missing, many pixels fire in two frames in a row that otherwise never do.
"""

from dataclasses import dataclass
from pathlib import Path
from zlib import crc32

import numpy as np
from scipy.ndimage import median_filter

from saf_gen.core import bits
from saf_gen.errors import BadInput
from saf_gen.stream.interop.bad_pixels import CHANCE_PAIRS, EXCESS_PAIRS, read_table
from saf_gen.stream.interop.source import BLOCK, Source, blocks, unpack

SECONDS = {"seconds": 1.0, "milliseconds": 1e-3, "microseconds": 1e-6}
NUMBERS = ("readout", "counter")
MAX_DRIFT = 0.02
"""Largest difference of the mean step of many time stamps from one readout."""
MAX_JITTER = 0.3
"""Largest distance of a step between two time stamps from whole readouts."""


@dataclass(frozen=True, eq=False)
class Readouts:
    """The readout that each frame of a file is.

    Attributes
    ----------
    number : ndarray of int64, shape (frames of the file,)
        Number of the camera's readout, from 0: equal to that of the frame before for a copy, and higher by more than 1
        after lost readouts.
    """

    number: np.ndarray

    @property
    def kept(self) -> np.ndarray:
        """The frames that are not copies, bool (frames of the file,)."""
        return np.diff(self.number, prepend=-1) > 0

    @property
    def of_kept(self) -> np.ndarray:
        """Number of the readout of each frame that is kept, int64."""
        return self.number[self.kept]

    @property
    def of_gaps(self) -> np.ndarray | None:
        """The same, or None if no readout is lost, so that they follow each other."""
        return None if (np.diff(self.of_kept) == 1).all() else self.of_kept

    @property
    def are_usual(self) -> bool:
        """True if no readout is lost or doubled."""
        return bool((np.diff(self.number) == 1).all())

    def at(self, frame: np.ndarray) -> np.ndarray:
        """Return the readout, possibly fractional, at a possibly fractional frame of the file."""
        inside = np.interp(frame, np.arange(self.number.size), self.number)
        return inside + np.minimum(frame, 0) + np.maximum(frame - (self.number.size - 1), 0)

    def kept_frame(self, frame: float) -> float:
        """Return the frame among those that are kept of a possibly fractional frame of the file."""
        return float(np.interp(frame, np.arange(self.number.size), np.cumsum(self.kept) - 1))

    def describe(self, *, about: bool) -> list[str]:
        """Return a line on copies and a line on lost readouts, where there are any."""
        steps = np.diff(self.number)
        copies, gaps = np.flatnonzero(steps == 0) + 1, np.flatnonzero(steps > 1) + 1
        lost = int((steps[steps > 1] - 1).sum())
        lines = []
        if copies.size:
            lines.append(f"doubled readouts: {copies.size:,}, left out ({_list_frames(copies)})")
        if gaps.size:
            many = f"{'about ' * about}{lost:,} in {gaps.size:,} {'gap' if gaps.size == 1 else 'gaps'}"
            lines.append(f"lost readouts: {many} (before {_list_frames(gaps)})")
        return lines


def _list_frames(frames: np.ndarray) -> str:
    shown = ", ".join(f"{frame:,}" for frame in frames[:5].tolist())
    return f"{'frame' if frames.size == 1 else 'frames'} {shown}{', …' * (frames.size > 5)}"


def read_times(path: Path, *, frames: int, total: int, readout_hz: float) -> Readouts:
    """Return the readouts that a CSV file states, for the first ``frames`` frames of a recording of ``total`` frames.

    The file has one row for each frame of the recording, with its time (``seconds``, ``milliseconds`` or
    ``microseconds``) or the camera's own number (``readout`` or ``counter``); a column ``frame`` may stand before it.

    Raises BadInput if the table cannot be read, has another number of rows, counts frames otherwise than from 0, or
    goes back; or if time stamps step by anything else than whole readouts.
    """
    kinds = (*NUMBERS, *SECONDS)
    table = read_table(path, (*kinds, *(f"frame,{kind}" for kind in kinds)))
    frame = table.pop("frame", None)
    ((kind, value),) = table.items()
    if value.size not in (frames, total):
        raise BadInput(
            f"has {value.size} rows", where=str(path), allowed=f"{total}, one for each frame of the recording"
        )
    if frame is not None and (wrong := np.flatnonzero(frame != np.arange(frame.size))).size:
        raise BadInput(f"frame is {frame[wrong[0]]:g} in row {wrong[0]}", where=str(path), allowed="0, 1, 2 and so on")
    if kind in NUMBERS and (wrong := np.flatnonzero(value % 1)).size:
        raise BadInput(f"{kind} is {value[wrong[0]]:g}", where=str(path), allowed="whole numbers")
    steps = np.diff(value[:frames])
    if (back := np.flatnonzero(steps < 0)).size:
        raise BadInput(
            f"{kind} goes from {value[back[0]]:g} to {value[back[0] + 1]:g}", where=str(path),
            allowed="a column that never falls", hint="add the size of the counter where it began again",
        )  # fmt: skip
    if kind in SECONDS:
        steps = _whole_steps(steps * SECONDS[kind] * readout_hz, path=path, readout_hz=readout_hz)
    return Readouts(np.concatenate([[0], np.cumsum(steps)]).astype(np.int64))


def _whole_steps(steps: np.ndarray, *, path: Path, readout_hz: float) -> np.ndarray:
    """Return steps between time stamps, in readouts, as whole numbers; raise BadInput if they are not nearly whole."""
    single = steps[np.abs(steps - 1) < 0.5]
    usual = float(single.mean()) if single.size else float(np.median(steps)) if steps.size else 1.0
    if abs(usual - 1) > MAX_DRIFT + MAX_JITTER / np.sqrt(max(single.size, 1)):
        raise BadInput(
            f"the usual step of the time stamps is {usual:.4g} readouts", where=str(path), allowed="about 1",
            hint=f"is the unit of time right, and --rate {readout_hz:g}?",
        )  # fmt: skip
    steps = steps / usual
    whole = np.rint(steps)
    if (uneven := np.flatnonzero(np.abs(steps - whole) > MAX_JITTER)).size:
        raise BadInput(
            f"the time stamps step by {steps[uneven[0]]:.2f} readouts after frame {uneven[0]}", where=str(path),
            allowed=f"whole readouts within {MAX_JITTER}", hint="a column `readout` says which readout a frame is",
        )  # fmt: skip
    return whole


@dataclass(frozen=True, eq=False)
class Survey:
    """What one pass over a recording shows.

    Attributes
    ----------
    counts : ndarray of int64, shape (H, W)
        Spikes of each pixel.
    spikes : ndarray of int64, shape (T,)
        Spikes in each frame.
    again : ndarray of int64, shape (T - 1,)
        Pixels that fire in a frame and in the next.
    content : ndarray of int64, shape (T,)
        A checksum, the same for frames that are alike.
    pairs, chance : ndarray of int64, shape (H, W)
        How irregularly each pixel fires, as :func:`find_wild_pixels` takes it; 0 if it was not asked for.
    """

    counts: np.ndarray
    spikes: np.ndarray
    again: np.ndarray
    content: np.ndarray
    pairs: np.ndarray
    chance: np.ndarray

    @property
    def repeats(self) -> np.ndarray:
        """The frames that are the same as the one before, bit for bit, bool (T,)."""
        return np.concatenate([[False], (self.again == self.spikes[1:]) & (self.again == self.spikes[:-1])])


SURVEY_BYTES = 32 << 20
"""Packed spikes that are surveyed at a time; up to five times as much is in memory."""


def survey(source: Source, *, with_pairs: bool = False) -> Survey:
    """Read a recording once; ``with_pairs`` also counts how irregularly each pixel fires."""
    frames, height, width = source.shape
    pixels = -(-height * width // 64) * 64
    counts, pairs, chance = (np.zeros((height, width), np.int64) for _ in range(3))
    spikes, again, content = (np.zeros(frames, np.int64) for _ in range(3))
    last = np.zeros((0, pixels // 64), np.uint64)
    step = max(min(BLOCK, 8 * SURVEY_BYTES // pixels // 8 * 8), 8)
    for number, packed in enumerate(blocks(source, step)):
        first, count = number * step, min(step, frames - number * step)
        counts += np.bitwise_count(packed).sum(axis=2, dtype=np.int64)
        if with_pairs:
            pairs += EXCESS_PAIRS[packed].sum(axis=2, dtype=np.int64)
            chance += CHANCE_PAIRS[packed].sum(axis=2, dtype=np.int64)
        trains = np.zeros((pixels, packed.shape[2]), np.uint8)
        trains[: height * width] = packed.reshape(height * width, -1)
        rows = np.concatenate([last, bits.to_frames(trains, count).view(np.uint64)])
        stop = first + count
        spikes[first:stop] = np.bitwise_count(rows[-count:]).sum(axis=1, dtype=np.int64)
        content[first:stop] = [crc32(row) for row in rows[-count:]]
        again[stop - len(rows) + 1 : stop] = np.bitwise_count(rows[1:] & rows[:-1]).sum(axis=1, dtype=np.int64)
        last = rows[-1:]
    return Survey(counts, spikes, again[1:], content, pairs, chance)


MIN_CHANGE = 32
"""Pixels that must begin and cease to fire before and after a frame for its repetition to mean anything."""
MIN_EXCESS = 32
"""Least number of pixels, beyond the usual, that fire in two frames in a row where readouts are lost."""
MAX_GAPS = 64
"""Most places at which lost readouts are looked for, the clearest first."""
MAX_LOST = 48
"""Longest gap, in readouts, whose length the phases of the pixels still show."""
SIDE = 96
"""Frames before and after a gap that show the intervals of the pixels."""
SAMPLED = 20_000
"""Pixels that are examined at a gap."""
MIN_PIXELS = 200
"""Least number of pixels with steady intervals on both sides of a gap."""
MIN_OWN, MIN_PHASE, MIN_GAIN, MIN_LEAD = 0.6, 0.6, 0.25, 0.1
"""Least agreement of the phases before a gap, which shows steady light; across it, relative to that before; above that
without a gap; and above that of other lengths."""


def find_readouts(source: Source, seen: Survey) -> Readouts:
    """Return the readouts that the frames of a recording are, as far as its spikes show copies and losses.

    A frame is a copy of the one before if they are the same, bit for bit, while before and after them at least
    MIN_CHANGE pixels begin to fire and as many cease, and if the same picture never comes back: then pixels fire twice
    in a row that otherwise take turns. For pixels that fire independently, the chance of that is below
    exp(-MIN_CHANGE) per frame. Frames that hold no spike, or saturated light only, are never copies.

    Readouts are lost where more pixels fire in two frames in a row than around, twice the usual and MIN_EXCESS more,
    in steady light, and where one length of the gap, and no other, brings the phases of at least MIN_PIXELS pixels,
    each with its own interval, into agreement: at random, their mean cosine would be 0.05. So a gap is seen only if it
    is about as long as the intervals of many pixels, and at most MAX_LOST readouts.
    """
    copies = _find_copies(seen)
    steps = np.where(copies[1:], 0, 1)
    kept = np.flatnonzero(~copies)
    for frame in _suspect_gaps(seen, kept):
        steps[frame - 1] += _lost_before(source, frame, kept=kept)
    return Readouts(np.concatenate([[0], np.cumsum(steps)]).astype(np.int64))


def check_copies(stated: Readouts, seen: Survey, *, path: Path) -> list[str]:
    """Return a line on the copies that the spikes show and a table does not state, if there are any.

    Raises BadInput if frames differ that are the same readout by the table.
    """
    if (wrong := np.flatnonzero(~stated.kept & ~seen.repeats)).size:
        raise BadInput(
            f"frames {wrong[0] - 1} and {wrong[0]} have the same time, but differ", where=str(path),
            allowed="a time for each readout", hint="leave --times out, or give it more digits",
        )  # fmt: skip
    repeated = np.flatnonzero(_find_copies(seen) & stated.kept)
    if not repeated.size:
        return []
    return [f"copies that the times do not state: {repeated.size:,}, kept ({_list_frames(repeated)})"]


def _find_copies(seen: Survey) -> np.ndarray:
    """Return which frames are copies of the one before, bool (T,)."""
    same = seen.repeats
    copies = np.zeros(same.size, bool)
    if not same.any():
        return copies
    begins = np.flatnonzero(~same)
    ends = np.append(begins[1:], same.size)  # runs of equal frames
    pictures, runs = np.unique(seen.content[begins], return_counts=True)
    once = set(pictures[runs == 1].tolist())
    changes = np.minimum(seen.spikes[1:], seen.spikes[:-1]) - seen.again  # pixels that begin, or cease, if fewer
    for begin, end in zip(begins.tolist(), ends.tolist(), strict=True):
        around = [changes[at] for at in (begin - 1, end - 1) if 0 <= at < changes.size]
        if end - begin > 1 and around and min(around) >= MIN_CHANGE and int(seen.content[begin]) in once:
            copies[begin + 1 : end] = True
    return copies


def _suspect_gaps(seen: Survey, kept: np.ndarray) -> list[int]:
    """Return the frames before which readouts may be lost, at most MAX_GAPS, in order."""
    if kept.size < 4:
        return []
    again, spikes = seen.again[kept[1:] - 1], seen.spikes[kept]
    usual, light = median_filter(again, 65, mode="mirror"), median_filter(spikes, 17, mode="mirror")
    steady = (spikes > 0.7 * light) & (spikes < 1.4 * light)
    excess = again - usual
    suspect = (excess >= np.maximum(MIN_EXCESS, 8 * np.sqrt(usual))) & (again >= 2 * usual) & steady[1:] & steady[:-1]
    places = np.flatnonzero(suspect)
    clearest = places[np.argsort(-excess[places], kind="stable")[:MAX_GAPS]]
    return sorted(kept[clearest + 1].tolist())


def _lost_before(source: Source, frame: int, *, kept: np.ndarray) -> int:
    """Return the number of readouts that are lost before a frame; 0 if the phases of the pixels show none."""
    at = int(np.searchsorted(kept, frame))
    used = kept[max(at - SIDE, 0) : at + SIDE]
    first = int(used[0]) // 8 * 8
    spikes = unpack(source.packed(first, int(used[-1]) + 1), int(used[-1]) + 1 - first)[used - first]
    trains = spikes.reshape(len(used), -1)
    trains = trains[:, :: max(trains.shape[1] // SAMPLED, 1)]
    middle = int(np.searchsorted(used, frame))
    before, after = _phases(trains[:middle][::-1]), _phases(trains[middle:])
    interval = (before[1] + after[1]) / 2
    steady = (interval >= 2.5) & (np.abs(before[1] - after[1]) <= 0.15 * interval)
    if np.count_nonzero(steady) < MIN_PIXELS:
        return 0
    turn = 2 * np.pi / interval[steady]
    own = float(np.mean(np.cos(turn * before[2][steady])))
    across = before[0][steady] + after[0][steady] + 1  # frames from the last spike before to the first after
    agreement = np.array([np.mean(np.cos(turn * (across + lost))) for lost in range(MAX_LOST + 1)])
    best = int(np.argmax(agreement))
    others = agreement[np.abs(np.arange(agreement.size) - best) > 1].max()
    lead = agreement[best] - np.maximum([others + MIN_LEAD, agreement[0] + MIN_GAIN], MIN_PHASE * own)
    return best if own >= MIN_OWN and lead.min() >= 0 else 0


def _phases(trains: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the first spike, the mean interval and the first interval of each pixel, in frames, of trains (n, P).

    The mean interval of a pixel with fewer than three spikes is NaN.
    """
    count = trains.sum(axis=0, dtype=np.int64)
    first, last = trains.argmax(axis=0), len(trains) - 1 - trains[::-1].argmax(axis=0)
    rest = trains.copy()
    rest[first, np.arange(first.size)] = 0
    with np.errstate(divide="ignore", invalid="ignore"):
        interval = np.where(count >= 3, (last - first) / (count - 1), np.nan)
    return first, interval, rest.argmax(axis=0) - first
