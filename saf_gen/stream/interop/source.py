"""Recordings of other programs as spikes that are read a block at a time, and written as streams."""

import os
from collections.abc import Iterator
from json import dumps
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from saf_gen.core import bits
from saf_gen.core.files import check_apart
from saf_gen.errors import BadInput
from saf_gen.stream.metadata import metadata_from_options
from saf_gen.stream.stream_writer import StreamWriter

BLOCK = 2_000
"""Frames that are read at a time: 250 bytes along time."""


class Source(Protocol):
    """A recording of another program.

    Attributes
    ----------
    path : Path
        The file.
    shape : tuple of int
        (T, H, W) of the frames to read.
    total : int
        Number of frames in the file.
    origin : dict
        What the provenance of a stream says about the file and how it was read.
    """

    path: Path
    shape: tuple[int, int, int]
    total: int
    origin: dict[str, Any]

    def packed(self, first: int, stop: int) -> np.ndarray:
        """Return packed spikes of frames ``first <= t < stop``, uint8 (H, W, ceil((stop - first)/8)); row 0 on top.

        ``first`` is a multiple of 8. Reading from start to end is cheapest.
        """
        ...


def blocks(source: Source) -> Iterator[np.ndarray]:
    """Yield the packed spikes of BLOCK frames each, uint8 (H, W, bytes); the last block may be shorter."""
    for first in range(0, source.shape[0], BLOCK):
        yield source.packed(first, min(first + BLOCK, source.shape[0]))


def write_source(
    source: Source, out: str | os.PathLike[str], *, readout_hz: float, kept: np.ndarray | None = None, **optional: Any
) -> str:
    """Write a recording as the stream file ``out`` and return its ``content_sha256``.

    Parameters
    ----------
    source : Source
        The recording.
    out : str or Path
        Stream file to write.
    readout_hz : float
        Readouts per second.
    kept : ndarray of bool, shape (T,), optional
        Frames to write; by default all.
    **optional
        Fields of :class:`Metadata`, for the frames that are written. Texts in ``provenance`` are added to the text that
        describes the import.

    Raises
    ------
    BadInput
        If the file cannot be read, a field is not allowed, or ``out`` is the file itself or cannot be written.
    """
    check_apart(source.path, out)
    frames, height, width = source.shape
    origin = source.origin
    if kept is not None and not kept.all():
        frames, origin = int(kept.sum()), {**origin, "left_out": np.flatnonzero(~kept).tolist()}
    provenance = {"import": dumps(origin, ensure_ascii=False), **optional.pop("provenance", {})}
    metadata = metadata_from_options({**optional, "provenance": provenance})
    with StreamWriter(out, shape=(frames, height, width), readout_hz=readout_hz, metadata=metadata) as writer:
        for packed in blocks(source) if frames == source.shape[0] else _chosen(source, np.asarray(kept)):
            writer.write(packed)
    return writer.content_sha256


def _chosen(source: Source, kept: np.ndarray) -> Iterator[np.ndarray]:
    """Yield the packed spikes of some frames, whole bytes at a time; raise BadInput if a frame left out is no copy."""
    waiting = last = np.empty((0, *source.shape[1:]), np.uint8)
    for number, packed in enumerate(blocks(source)):
        chosen = kept[number * BLOCK : (number + 1) * BLOCK]
        frames = _unpack(packed, chosen.size)
        for at in np.flatnonzero(~chosen).tolist():
            if not np.array_equal(frames[at], frames[at - 1] if at else last):
                frame = number * BLOCK + at
                raise BadInput(
                    f"frames {frame - 1} and {frame} have the same time, but differ", where=str(source.path),
                    allowed="a time for each readout", hint="give the times more digits",
                )  # fmt: skip
        waiting, last = np.concatenate([waiting, frames[chosen]]), frames[-1]
        whole = len(waiting) // 8 * 8
        if whole:
            yield bits.pack_bits(waiting[:whole])
        waiting = waiting[whole:]
    if len(waiting):
        yield bits.pack_bits(waiting)


def _unpack(packed: np.ndarray, frames: int) -> np.ndarray:
    """Return frames, uint8 (frames, h, w) of 0 and 1, of packed spikes, uint8 (h, w, bytes)."""
    out = np.empty((frames, *packed.shape[:2]), np.uint8)
    bits.unpack_bits(np.ascontiguousarray(packed.transpose(2, 0, 1)), out, first=0)
    return out
