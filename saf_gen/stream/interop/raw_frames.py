"""Raw frames without a header, in the layouts `dense`, `416` and `sps1000` of other software.

All three store a frame as bits, least significant first, and differ only in which bit of the frame belongs to
which pixel. In ``dense`` (SpikeCV, Spike-Zoo), rows follow each other without gaps, usually from the bottom row. In
``416`` (recordings of SAF and RSIR), each row has 50 bytes of pixels and 2 bytes that are ignored. In ``sps1000`` (the
1000 × 1000 camera), each row has two halves of 500 pixels, each followed by 12 service bits.
"""

import operator
import os
from collections.abc import Callable
from dataclasses import dataclass
from json import dumps
from pathlib import Path
from typing import Any

import numpy as np

from saf_gen.core import bits
from saf_gen.core.files import atomic_file, name_as_text
from saf_gen.errors import BadInput, unknown
from saf_gen.stream.metadata import metadata_from_options
from saf_gen.stream.stream_file import open_stream
from saf_gen.stream.stream_writer import StreamWriter

_FRAMES = 2_000  # frames converted at a time: 250 bytes along time


@dataclass(frozen=True)
class RawLayout:
    """A layout of raw frames.

    Attributes
    ----------
    rows, columns : int
        Size of a frame in pixels.
    frame_bytes : int
        Size of a frame in bytes.
    flip : bool
        True if the bottom row usually comes first.
    bit_index : callable
        ``bit_index(y, x)`` returns the index of the bit that holds the pixel in row y of the file and column x.
    """

    rows: int
    columns: int
    frame_bytes: int
    flip: bool
    bit_index: Callable[[np.ndarray, np.ndarray], np.ndarray]

    def bit_indices(self, flip: bool) -> np.ndarray:
        """Return the index of the bit of each pixel, int (H·W,), with row 0 at the top."""
        y, x = np.divmod(np.arange(self.rows * self.columns), self.columns)
        return self.bit_index(self.rows - 1 - y if flip else y, x)


RAW_LAYOUTS = {
    "416": RawLayout(250, 400, 13_000, False, lambda y, x: 416 * y + x),
    "dense": RawLayout(250, 400, 12_500, True, lambda y, x: 400 * y + x),
    "sps1000": RawLayout(1000, 1000, 128_000, False, lambda y, x: 1024 * y + x + 12 * (x >= 500)),
}


READERS = {"saf": "416", "rsir": "416", "spikecv": "dense", "spike-zoo": "dense"}
"""Layout that each program reads, by the name of the program; ``flip`` of the layout is as in these programs."""

_SNIFFED_FRAMES = 200  # frames that are examined to recognise a layout


def sniff_layout(source: str | os.PathLike[str]) -> str:
    """Return the layout of a file of raw frames, found from its size and from bytes that one layout leaves 0.

    Raises BadInput if the size fits no layout, or if two layouts fit and cannot be distinguished.
    """
    path = Path(source)
    size = _file_size(path)
    fitting = [name for name, of in RAW_LAYOUTS.items() if size % of.frame_bytes == 0]
    if "416" in fitting and (len(fitting) == 1 or _has_empty_gaps(path)):
        return "416"
    left = [name for name in fitting if name != "416"] or fitting
    if len(left) != 1:
        raise BadInput(
            f"its {size} bytes fit {' and '.join(left) or 'no known layout'}",
            where=str(source),
            allowed=f"whole frames of {', '.join(f'{of.frame_bytes} bytes ({n})' for n, of in RAW_LAYOUTS.items())}",
            hint="name one with --layout" if left else "the file is truncated",
        )
    return left[0]


def _has_empty_gaps(path: Path) -> bool:
    """Return whether all bytes that layout 416 ignores are 0 in the first frames, but not all bytes are."""
    of = RAW_LAYOUTS["416"]
    raw = np.fromfile(path, np.uint8, _SNIFFED_FRAMES * of.frame_bytes)
    rows = raw[: raw.size // of.frame_bytes * of.frame_bytes].reshape(-1, 52)
    return bool(rows.any()) and not rows[:, 50:].any()


def _layout(name: str) -> RawLayout:
    if name not in RAW_LAYOUTS:
        raise unknown("layout", name, allowed=RAW_LAYOUTS)
    return RAW_LAYOUTS[name]


def _check_apart(source: str | os.PathLike[str], out: str | os.PathLike[str]) -> None:
    if Path(out).exists() and Path(out).samefile(source):
        raise BadInput("would be written over itself", where=str(source), hint="choose another output file")


def _file_size(source: Path) -> int:
    try:
        size = source.stat().st_size
    except OSError as error:
        raise BadInput(f"cannot be read: {os.strerror(error.errno or 0)}", where=str(source)) from error
    if source.is_dir():
        raise BadInput("this is a folder", where=str(source), allowed="a file of raw frames")
    if size == 0:
        raise BadInput("is empty", where=str(source), allowed="at least one frame")
    return size


def count_raw_frames(source: str | os.PathLike[str], layout: str, *, frames: int | None = None) -> int:
    """Return the number of frames to read from a file: ``frames``, or all if that is None.

    Raises BadInput if the layout is unknown, if the file cannot be read or does not hold a whole number of frames, or
    if it has fewer than ``frames`` frames.
    """
    _layout(layout)
    return _frame_count(Path(source), layout, frames=frames)


def _frame_count(source: Path, layout: str, *, frames: int | None) -> int:
    size = _file_size(source)
    each = RAW_LAYOUTS[layout].frame_bytes
    if size % each:
        fitting = [
            f"{n} ({size // of.frame_bytes} frames)" for n, of in RAW_LAYOUTS.items() if size % of.frame_bytes == 0
        ]
        raise BadInput(
            f"its {size} bytes are {size // each} frames of {each} bytes and {size % each} more bytes",
            where=str(source),
            allowed=f"a multiple of {each} bytes for layout {layout}",
            hint=f"layouts that fit: {', '.join(fitting)}"
            if fitting
            else "no known layout fits: the file is truncated",
        )
    if frames is None:
        return size // each
    if not 1 <= operator.index(frames) <= size // each:
        raise BadInput(f"{frames} frames were requested", where=str(source), allowed=f"1 to {size // each}")
    return operator.index(frames)


def import_raw_frames(
    source: str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    layout: str = "416",
    frames: int | None = None,
    readout_hz: float = 20_000,
    flip: bool | None = None,
    **optional: Any,
) -> str:
    """Write the raw frames in ``source`` as the stream file ``out`` and return its ``content_sha256``.

    The use of memory does not grow with the file.

    Parameters
    ----------
    source : str or Path
        File of raw frames.
    out : str or Path
        Stream file to write.
    layout : str, default "416"
        A key of RAW_LAYOUTS.
    frames : int, optional
        Number of frames to import, from the first; by default all.
    readout_hz : float, default 20000
        Readouts per second, which the raw file does not state.
    flip : bool, optional
        Whether the bottom row comes first; by default as is usual for the layout.
    **optional
        Fields of :class:`Metadata`, such as ``focus_position`` and ``truth``. Texts in ``provenance`` are added to the
        text that describes the import.

    Returns
    -------
    str
        The ``content_sha256`` of the stream.

    Raises
    ------
    BadInput
        If the size is not a whole number of frames, in which case the message names layouts that would fit; if the file
        has fewer frames than requested; or if ``out`` is ``source``.
    """
    kind, path = _layout(layout), Path(source)
    total = _frame_count(path, layout, frames=frames)
    _check_apart(path, out)
    flipped = kind.flip if flip is None else bool(flip)
    bit = kind.bit_indices(flipped)
    settings = {"file": name_as_text(path.name), "layout": layout, "flip": flipped, "frames": total}
    provenance = {"import": dumps(settings, ensure_ascii=False), **optional.pop("provenance", {})}
    metadata = metadata_from_options({**optional, "provenance": provenance})
    shape = (total, kind.rows, kind.columns)
    with path.open("rb") as file, StreamWriter(out, shape=shape, readout_hz=readout_hz, metadata=metadata) as writer:
        for first in range(0, total, _FRAMES):
            count = min(_FRAMES, total - first)
            raw = np.fromfile(file, np.uint8, count * kind.frame_bytes)
            if raw.size != count * kind.frame_bytes:
                raise BadInput("was truncated while it was read", where=str(source), hint="import it again")
            trains = bits.to_trains(raw.reshape(count, kind.frame_bytes))
            writer.write(trains[bit].reshape(kind.rows, kind.columns, -1))
    return writer.content_sha256


def export_raw_frames(
    source: str | os.PathLike[str], out: str | os.PathLike[str], *, layout: str = "416", flip: bool | None = None
) -> int:
    """Write the stream file ``source`` as raw frames, in which ignored bits are 0, and return the number of bytes.

    This is the inverse of :func:`import_raw_frames`, but the layouts cannot hold focus, light and truth. Raises
    BadInput if the frames of the stream have another size, or if ``out`` cannot be written or is ``source``.
    """
    kind = _layout(layout)
    bit = kind.bit_indices(kind.flip if flip is None else bool(flip))
    with open_stream(source) as stream:
        _check_apart(source, out)
        total, rows, columns = stream.shape
        if (rows, columns) != (kind.rows, kind.columns):
            fitting = [n for n, of in RAW_LAYOUTS.items() if (of.rows, of.columns) == (rows, columns)]
            raise BadInput(
                f"the stream has {rows} x {columns} pixels",
                where=str(source),
                allowed=f"{kind.rows} x {kind.columns} for layout {layout}",
                hint=f"layouts that fit: {', '.join(fitting)}" if fitting else "no known layout has this size",
            )
        with atomic_file(out) as part, part.open("wb") as file:
            for first in range(0, total, _FRAMES):
                count = min(_FRAMES, total - first)
                packed = stream.packed(first // 8, first // 8 + -(-count // 8))
                trains = np.zeros((8 * kind.frame_bytes, packed.shape[2]), np.uint8)
                trains[bit] = packed.reshape(-1, packed.shape[2])
                file.write(bits.to_frames(trains, count).data)
    return total * kind.frame_bytes
