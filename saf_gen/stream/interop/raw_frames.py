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
from pathlib import Path
from typing import Any

import numpy as np

from saf_gen.core import bits
from saf_gen.core.files import atomic_file, check_apart, name_as_text
from saf_gen.errors import BadInput, unknown
from saf_gen.stream.interop.source import write_source
from saf_gen.stream.metadata import MAX_PIXELS
from saf_gen.stream.stream_file import open_stream

_FRAMES = 2_000  # frames converted at a time: 250 bytes along time


@dataclass(frozen=True)
class RawLayout:
    """A layout of raw frames.

    Attributes
    ----------
    name : str
        Name of the layout.
    rows, columns : int
        Size of a frame in pixels.
    frame_bytes : int
        Size of a frame in bytes.
    flip : bool
        True if the bottom row usually comes first.
    bit_index : callable
        ``bit_index(y, x)`` returns the index of the bit that holds the pixel in row y of the file and column x.
    """

    name: str
    rows: int
    columns: int
    frame_bytes: int
    flip: bool
    bit_index: Callable[[np.ndarray, np.ndarray], np.ndarray]

    def bit_indices(self, flip: bool, *, order: str = "lsb") -> np.ndarray:
        """Return the index of the bit of each pixel, least significant bit first, int (H·W,), row 0 at the top."""
        y, x = np.divmod(np.arange(self.rows * self.columns), self.columns)
        index = self.bit_index(self.rows - 1 - y if flip else y, x)
        return index ^ 7 if order == "msb" else index


def dense_layout(rows: int, columns: int) -> RawLayout:
    """Return the layout of frames without gaps; raise BadInput if a frame does not fill its bytes or is too large."""
    pixels = rows * columns
    if not (1 <= pixels <= MAX_PIXELS and pixels % 8 == 0):
        raise BadInput(
            f"the size is {columns}x{rows}, {pixels} pixels",
            allowed=f"a multiple of 8 pixels, at most {MAX_PIXELS}, since frames fill their bytes",
        )
    return RawLayout("dense", rows, columns, pixels // 8, True, lambda y, x: columns * y + x)


RAW_LAYOUTS = {
    "416": RawLayout("416", 250, 400, 13_000, False, lambda y, x: 416 * y + x),
    "dense": dense_layout(250, 400),
    "sps1000": RawLayout("sps1000", 1000, 1000, 128_000, False, lambda y, x: 1024 * y + x + 12 * (x >= 500)),
}


READERS = {"saf": "416", "rsir": "416", "spikecv": "dense", "spike-zoo": "dense"}
"""Layout that each program reads, by the name of the program; ``flip`` of the layout is as in these programs."""
BIT_ORDERS = ("lsb", "msb")
"""Orders of the pixels in a byte: the first in the least or in the most significant bit."""

_CONTAINERS = {
    b"\x89HDF": "an HDF5 file", b"\x93NUMPY": "a .npy file", b"PK\x03\x04": "a zip or .npz file",
    b"MATLAB 5": "a .mat file", b"\x1f\x8b\x08": "a gzip file", b"\x89PNG": "a picture", b"\xff\xd8\xff": "a picture",
    b"GIF8": "a picture", b"II*\0": "a TIFF file", b"MM\0*": "a TIFF file", b"v/1\x01": "an OpenEXR file",
    b"RIFF": "a RIFF file", b"\x1aE\xdf\xa3": "a video", b"\xfd7zXZ": "an xz file", b"7z\xbc\xaf": "a 7z file",
}  # fmt: skip


def find_layout(name: str, *, size: tuple[int, int] | None = None) -> RawLayout:
    """Return the layout of this name, for frames of ``size`` (rows, columns); by default, the size of the camera.

    Raises BadInput if the name is unknown, or if the layout has another size.
    """
    if name not in RAW_LAYOUTS:
        raise unknown("layout", name, allowed=RAW_LAYOUTS)
    of = RAW_LAYOUTS[name]
    if size is None or size == (of.rows, of.columns):
        return of
    if name != "dense":
        raise BadInput(
            f"the size is {size[1]}x{size[0]}", allowed=f"{of.columns}x{of.rows} for layout {name}", hint="use dense"
        )
    return dense_layout(*size)


def fitting_layouts(source: str | os.PathLike[str]) -> list[RawLayout]:
    """Return the layouts of RAW_LAYOUTS of which a file holds whole frames, which many other layouts fit as well.

    Raises BadInput if the file is missing, is empty or is of another kind.
    """
    size = _file_size(Path(source))
    return [of for of in RAW_LAYOUTS.values() if size % of.frame_bytes == 0]


def state_layout(
    source: str | os.PathLike[str], *, layout: str | None, size: tuple[int, int] | None, order: str | None
) -> tuple[RawLayout, str]:
    """Return the layout and the order of bits of a file of raw frames, which says neither, from what a user states.

    A named layout has the least significant bit first, unless ``order`` says otherwise; a size alone states no order.

    Raises BadInput if the file is missing or is of another kind, if something is not stated, or if it does not fit.
    """
    if layout is None and size is None:
        named = [f"--layout {of.name} ({of.columns}x{of.rows})" for of in fitting_layouts(source)]
        raise BadInput(
            "raw frames do not say how they are stored", where=str(source),
            allowed="--layout 416, dense or sps1000, or --size and --bits, as in --size 600x400 --bits lsb",
            hint=f"layouts that fit the length, which proves nothing: {', '.join(named) or 'none'}",
        )  # fmt: skip
    if layout is None and order is None:
        raise BadInput(
            "a size does not say which bit of a byte is first", where=str(source), allowed="--bits lsb or --bits msb"
        )
    known = find_layout(layout or "dense", size=size)
    count_raw_frames(Path(source), known)
    return known, order or "lsb"


def _file_size(source: Path) -> int:
    try:
        size = source.stat().st_size
    except OSError as error:
        raise BadInput(f"cannot be read: {os.strerror(error.errno or 0)}", where=str(source)) from error
    if source.is_dir():
        raise BadInput("this is a folder", where=str(source), allowed="a file of raw frames")
    if size == 0:
        raise BadInput("is empty", where=str(source), allowed="at least one frame")
    try:
        with source.open("rb") as file:
            head = file.read(16)
    except OSError as error:
        raise BadInput(f"cannot be read: {os.strerror(error.errno or 0)}", where=str(source)) from error
    for magic, kind in _CONTAINERS.items():
        if head.startswith(magic) or head[4:8] == b"ftyp":
            raise BadInput(
                f"this is {'a video' if head[4:8] == b'ftyp' else kind}", where=str(source), allowed="raw frames",
                hint="saf-gen import reads arrays as .npy, .npz and .mat, and saf-gen encode reads pictures and video",
            )  # fmt: skip
    return size


def count_raw_frames(source: Path, layout: RawLayout, *, frames: int | None = None) -> int:
    """Return the number of frames to read from a file: ``frames``, or all if that is None.

    Raises BadInput if the file cannot be read, is of another kind, does not hold a whole number of frames, or has fewer
    than ``frames`` frames.
    """
    size = _file_size(source)
    each = layout.frame_bytes
    if size % each:
        fitting = [
            f"{of.name} ({size // of.frame_bytes} frames of {of.columns}x{of.rows})" for of in fitting_layouts(source)
        ]
        raise BadInput(
            f"its {size} bytes are {size // each} frames of {each} bytes and {size % each} more bytes",
            where=str(source),
            allowed=f"a multiple of {each} bytes for layout {layout.name} of {layout.columns}x{layout.rows}",
            hint=f"layouts that fit: {', '.join(fitting)}"
            if fitting
            else "state another size, as in --size 600x400, or look for a header or a lost end",
        )
    if frames is None:
        return size // each
    if not 1 <= operator.index(frames) <= size // each:
        raise BadInput(f"{frames} frames were requested", where=str(source), allowed=f"1 to {size // each}")
    return operator.index(frames)


class RawFrames:
    """The spikes in a file of raw frames, as a :class:`saf_gen.stream.interop.source.Source`.

    Raises BadInput if the order of bits is unknown, or if the file cannot be read, does not hold a whole number of
    frames, or has fewer than ``frames``.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        layout: RawLayout,
        *,
        order: str = "lsb",
        frames: int | None = None,
        flip: bool | None = None,
    ) -> None:
        if order not in BIT_ORDERS:
            raise unknown("order of bits", order, allowed=BIT_ORDERS)
        self.path, self.layout = Path(path), layout
        self.total = count_raw_frames(self.path, layout)
        self.shape = (count_raw_frames(self.path, layout, frames=frames), layout.rows, layout.columns)
        flipped = layout.flip if flip is None else bool(flip)
        self._bit = layout.bit_indices(flipped, order=order)
        usual = RAW_LAYOUTS[layout.name]
        self.origin: dict[str, Any] = {
            "file": name_as_text(self.path.name), "layout": layout.name, "flip": flipped, "frames": self.shape[0]
        }  # fmt: skip
        if order != "lsb" or (layout.rows, layout.columns) != (usual.rows, usual.columns):
            self.origin |= {"size": f"{layout.columns}x{layout.rows}", "bits": order}

    def packed(self, first: int, stop: int) -> np.ndarray:
        """Return packed spikes of frames ``first <= t < stop``, uint8 (H, W, bytes); ``first`` is a multiple of 8."""
        size = self.layout.frame_bytes
        raw = np.fromfile(self.path, np.uint8, (stop - first) * size, offset=first * size)
        if raw.size != (stop - first) * size:
            raise BadInput("was truncated while it was read", where=str(self.path), hint="import it again")
        trains = bits.to_trains(raw.reshape(stop - first, size))
        return trains[self._bit].reshape(*self.shape[1:], -1)


def import_raw_frames(
    source: str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    layout: str = "416",
    size: tuple[int, int] | None = None,
    order: str = "lsb",
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
    size : tuple of (int, int), optional
        Rows and columns of a frame of layout ``dense``; by default those of the camera.
    order : str, default "lsb"
        Whether the first pixel of a byte is its least (``lsb``) or most (``msb``) significant bit.
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
    recording = RawFrames(source, find_layout(layout, size=size), order=order, frames=frames, flip=flip)
    return write_source(recording, out, readout_hz=readout_hz, **optional)


def export_raw_frames(
    source: str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    layout: str = "416",
    order: str = "lsb",
    flip: bool | None = None,
) -> int:
    """Write the stream file ``source`` as raw frames, in which ignored bits are 0, and return the number of bytes.

    This is the inverse of :func:`import_raw_frames`, but the layouts cannot hold focus, light and truth. Layout
    ``dense`` takes any size of whole bytes. Raises BadInput if the frames of the stream have a size that the layout
    cannot hold, if the order of bits is unknown, or if ``out`` cannot be written or is ``source``.
    """
    if order not in BIT_ORDERS:
        raise unknown("order of bits", order, allowed=BIT_ORDERS)
    kind = find_layout(layout)
    with open_stream(source) as stream:
        check_apart(source, out)
        total, rows, columns = stream.shape
        if layout == "dense":
            kind = dense_layout(rows, columns)
        if (rows, columns) != (kind.rows, kind.columns):
            raise BadInput(
                f"the stream has {rows} x {columns} pixels",
                where=str(source),
                allowed=f"{kind.rows} x {kind.columns} for layout {layout}",
                hint="layout dense takes any size of whole bytes",
            )
        bit = kind.bit_indices(kind.flip if flip is None else bool(flip), order=order)
        with atomic_file(out) as part, part.open("wb") as file:
            for first in range(0, total, _FRAMES):
                count = min(_FRAMES, total - first)
                packed = stream.packed(first // 8, first // 8 + -(-count // 8))
                trains = np.zeros((8 * kind.frame_bytes, packed.shape[2]), np.uint8)
                trains[bit] = packed.reshape(-1, packed.shape[2])
                file.write(bits.to_frames(trains, count).data)
    return total * kind.frame_bytes
