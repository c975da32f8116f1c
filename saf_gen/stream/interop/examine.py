"""What is known of a recording besides its spikes: its bad pixels, and which readouts its frames are."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from saf_gen.stream.interop.bad_pixels import find_bad_pixels, find_wild_pixels, read_mask
from saf_gen.stream.interop.readouts import Readouts, check_copies, find_readouts, read_times, survey
from saf_gen.stream.interop.source import Source

FIND = "find"
"""The word that asks for a mask of the bad pixels that the recording itself shows."""


@dataclass(frozen=True, eq=False)
class Examination:
    """What was stated about a recording, or found in it.

    Attributes
    ----------
    mask : ndarray of bool, shape (H, W), or None
        The bad pixels; None if there are none.
    readouts : Readouts or None
        The readout that each frame is; None if none is lost or doubled.
    lines : tuple of str
        What a user should know of them, a line each.
    """

    mask: np.ndarray | None
    readouts: Readouts | None
    lines: tuple[str, ...]


def examine(source: Source, *, mask: str | None, times: Path | None, readout_hz: float) -> Examination:
    """Return the bad pixels and the readouts of a recording.

    Parameters
    ----------
    source : Source
        The recording, which is read once.
    mask : str, optional
        A mask, as :func:`read_mask` takes it, or FIND; by default no pixel is bad.
    times : Path, optional
        Table of :func:`read_times`; by default copies and losses are looked for in the spikes.
    readout_hz : float
        Readouts per second.

    Raises
    ------
    BadInput
        If the mask or the table cannot be read, or does not fit the recording.
    """
    named = None if mask in (None, FIND) else read_mask(str(mask), source.shape[1:])
    stated = None
    if times is not None:
        stated = read_times(times, frames=source.shape[0], total=source.total, readout_hz=readout_hz)
    seen = survey(source, with_pairs=mask == FIND)
    bad, lines = None, []
    if named is not None:
        bad, lines = named, [_describe(named, "")]
    elif mask == FIND:
        wild = find_wild_pixels(seen.pairs, seen.chance)
        dead, stuck = find_bad_pixels(seen.counts, source.shape[0], wild=wild)
        kinds = {"never fire": dead, "always fire": stuck, "fire wildly": wild}
        bad = np.logical_or.reduce(list(kinds.values()))
        words = ", ".join(f"{np.count_nonzero(found)} {kind}" for kind, found in kinds.items())
        lines = [_describe(bad, f" ({words})")]
    if stated is None or times is None:
        readouts = find_readouts(source, seen)
        lines += readouts.describe(about=True)
    else:
        readouts = stated
        lines += [*stated.describe(about=False), *check_copies(stated, seen, path=times)]
    return Examination(
        bad if bad is not None and bad.any() else None, None if readouts.are_usual else readouts, tuple(lines)
    )


def _describe(bad: np.ndarray, kinds: str) -> str:
    number = np.count_nonzero(bad)
    if not number:
        return "mask: no bad pixel"
    return f"mask: {number:,} bad {'pixel' if number == 1 else 'pixels'}{kinds}, filled in counts and pictures"
