"""What is known of a recording besides its spikes: its bad pixels, and which readouts its frames are."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from saf_gen.stream.interop.bad_pixels import find_bad_pixels, read_mask
from saf_gen.stream.interop.readouts import Readouts, Survey, find_readouts, read_times, survey
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
        The recording, which is read once if anything has to be found.
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
    stated = None if mask in (None, FIND) else read_mask(str(mask), source.shape[1:])
    readouts = None
    if times is not None:
        readouts = read_times(times, frames=source.shape[0], total=source.total, readout_hz=readout_hz)
    seen = survey(source) if mask == FIND or times is None else None
    if readouts is None and seen is not None:
        readouts = find_readouts(source, seen)
    bad, lines = _name_pixels(mask, stated, seen, frames=source.shape[0])
    if readouts is not None:
        lines += readouts.describe(about=times is None)
    return Examination(bad, None if readouts is None or readouts.are_usual else readouts, tuple(lines))


def _name_pixels(
    mask: str | None, stated: np.ndarray | None, seen: Survey | None, *, frames: int
) -> tuple[np.ndarray | None, list[str]]:
    """Return the bad pixels, None without any, and a line on them if a mask was asked for."""
    if mask is None:
        return None, []
    if stated is None and seen is not None:
        dead, stuck = find_bad_pixels(seen.counts, frames)
        bad, kinds = dead | stuck, f" ({np.count_nonzero(dead)} never fire, {np.count_nonzero(stuck)} always fire)"
    else:
        bad, kinds = np.asarray(stated), ""
    number = np.count_nonzero(bad)
    if not number:
        return None, ["mask: no bad pixel" + (" found" if mask == FIND else "")]
    pixels = "bad pixel" if number == 1 else "bad pixels"
    return bad, [f"mask: {number:,} {pixels}{kinds}, filled in counts and pictures"]
