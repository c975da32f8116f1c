"""Spikes as arrays in files of others, in any order of axes and bits.

How the values lie is found from what they show (:mod:`saf_gen.stream.interop.evidence`), or stated by options. Values
that show nothing are read in the usual order if they are single readouts, and refused if they are packed bytes.
"""

import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from itertools import permutations
from math import prod
from pathlib import Path
from tempfile import TemporaryFile, gettempdir
from typing import Any, TypeVar

import numpy as np

from saf_gen.core import bits
from saf_gen.core.files import free_disk_bytes, name_as_text
from saf_gen.errors import BadInput, unknown
from saf_gen.stream.interop import evidence
from saf_gen.stream.interop.array_files import SlicedArray, open_array
from saf_gen.stream.interop.raw_frames import BIT_ORDERS, RAW_LAYOUTS
from saf_gen.stream.interop.source import BLOCK, write_source
from saf_gen.stream.metadata import MAX_PIXELS

AXES = tuple("".join(letters) for letters in permutations("TYX"))
"""Orders of time, rows and columns in an array."""
PACKED_AXIS = {"packed": "T", "packed-x": "X", "packed-y": "Y"}
"""Axis along which a byte holds eight values, by layout."""
ARRAY_LAYOUTS = ("frames", *PACKED_AXIS)
SAMPLE_BYTES = 24 << 20
"""Bytes of a block that is examined for evidence of the layout."""
SAMPLED_SLICES = 264
"""Most slices of such a block."""
BLOCK_BYTES = 64 << 20
"""Bytes that are read at a time."""
LONG = 4
"""Length of the first axis, in lengths of another, at which the first is time even if the other raises a doubt."""
RSIR_KEY = "seq"
"""Name of the array in which RSIR keeps eight frames per byte, the first in the lowest bit."""


@dataclass(frozen=True)
class Reading:
    """How the values of an array are read.

    Attributes
    ----------
    layout : str
        One of ARRAY_LAYOUTS.
    axes : str
        Order of the axes in the file: time T, rows Y and columns X.
    bits : str
        ``lsb`` or ``msb`` first in a byte; '' if a value is one readout of a pixel.
    high : int
        Value of a spike: 1, or 255 in arrays of 0 and 255.
    """

    layout: str
    axes: str
    bits: str = ""
    high: int = 1

    def __str__(self) -> str:
        order = {"": "", "lsb": ", least significant bit first", "msb": ", most significant bit first"}[self.bits]
        value = f", spikes are {self.high}" if self.high != 1 else ""
        return f"{self.layout}, axes {self.axes}{order}{value}"


class _Frames:
    """Frames of an array (T, Y, X) of any layout, with packed values unpacked as they are read."""

    def __init__(self, array: SlicedArray, reading: Reading, *, size: tuple[int, int] | None, where: str) -> None:
        self._array, self._reading, self._where = array, reading, where
        packed = PACKED_AXIS.get(reading.layout)
        total, *full = (n * (8 if packed == axis else 1) for n, axis in zip(array.shape, "TYX", strict=True))
        height, width = size or full
        for axis, asked, most in (("Y", height, full[0]), ("X", width, full[1])):
            if not most - 7 * (packed == axis) <= asked <= most:  # the last byte may not be full
                raise BadInput(
                    f"the size is {width}x{height}", where=where, allowed=f"{full[1]}x{full[0]}, as in the array",
                    hint="state --axes or --layout as well, if this is not how the array is read",
                )  # fmt: skip
        self.shape = (total, height, width)

    def __getitem__(self, span: slice) -> np.ndarray:
        first, stop, _ = span.indices(self.shape[0])
        reading = self._reading
        if reading.layout == "packed":
            planes = np.ascontiguousarray(self._array[slice(first // 8, -(-stop // 8))])
            if reading.bits == "msb":
                planes = _REVERSED[planes]
            out = np.empty((stop - first, *self.shape[1:]), np.uint8)
            bits.unpack_bits(planes, out, first=first % 8)
            return out
        values = self._array[slice(first, stop)]
        if reading.layout != "frames":
            axis = "TYX".index(PACKED_AXIS[reading.layout])
            order: Any = "little" if reading.bits == "lsb" else "big"
            return np.unpackbits(values, axis=axis, bitorder=order)[:, : self.shape[1], : self.shape[2]]
        wrong = values[(values != 0) & (values != reading.high)]
        if wrong.size:
            raise BadInput(
                f"holds {wrong[0]} in frame {first} or a later one", where=self._where,
                allowed="0 and 1, 0 and 255, or bool", hint="add --layout packed if a byte holds eight frames",
            )  # fmt: skip
        return (values != 0).astype(np.uint8)


_REVERSED = np.packbits(np.unpackbits(np.arange(256, dtype=np.uint8)[:, None], axis=1), axis=1, bitorder="little")[:, 0]
"""Each byte with its bits in the other order."""


def _find_reading(
    array: SlicedArray,
    *,
    layout: str | None,
    axes: str | None,
    order: str | None,
    by_definition: bool,
    name_axes: Callable[[int], str],
    where: str,
) -> Reading:
    """Return how an array is read, from what is given and what its values show; axes are those of ``array``.

    ``by_definition`` says that packed bytes are RSIR's, and ``name_axes`` returns the axes if one of them is time.
    Raises BadInput if an option is needed.
    """
    blocks = _sample(array)
    is_bytes = array.dtype == np.uint8
    values = {value for block in blocks for value in np.unique(block).tolist()} - {0}
    if layout is None and is_bytes and not values:
        raise BadInput(
            "has no spike, which does not show whether a byte is one readout", where=where, allowed="--layout",
            hint="add --layout frames (one value per readout) or --layout packed (eight frames per byte)",
        )  # fmt: skip
    if layout is None and (not is_bytes or values <= {1} or values == {255}):
        layout = "frames"
    if layout is None and len(values) == 1:
        raise BadInput(
            f"holds only 0 and {values.pop()}", where=where, allowed="0 and 1, 0 and 255, or bool",
            hint="add --layout packed --bits lsb if a byte holds eight frames",
        )  # fmt: skip
    if layout == "frames":
        high = 255 if values == {255} else 1
        return Reading("frames", axes or _find_axes(blocks, array.shape, name_axes=name_axes, where=where), high=high)
    if not is_bytes:
        raise BadInput(f"the array is {array.dtype}", where=where, allowed=f"uint8 for layout {layout}")
    shown = _shown_packing(blocks, name_axes)
    fits = [
        one for one in shown if layout in (None, one.layout) and axes in (None, one.axes) and order in (None, one.bits)
    ]
    if len(fits) == 1 and len({one.layout for one in shown}) == 1:
        return fits[0]
    if layout is not None and order is not None:
        return Reading(layout, axes or "TYX", order)
    if not shown and (layout == "packed" or (layout is None and by_definition)):
        return Reading("packed", axes or "TYX", order or "lsb")
    seen = "; ".join(map(str, shown)) or "neither the axis nor the order of the bits"
    raise BadInput(
        f"the array has bytes above 1, and shows {seen}", where=where, allowed="options that say how bytes are read",
        hint="add --layout packed (eight frames), packed-x or packed-y (eight pixels), --bits lsb or msb, --axes TYX",
    )  # fmt: skip


def _sample(array: SlicedArray) -> list[np.ndarray]:
    """Return blocks from the beginning and from the middle of an array, or the first block that has a spike."""
    slices = max(min(SAMPLED_SLICES, SAMPLE_BYTES // max(prod(array.shape[1:]) * array.dtype.itemsize, 1)), 1)
    starts = sorted({0, max((array.shape[0] - slices) // 2, 0)})
    blocks = [np.asarray(array[slice(first, first + slices)]) for first in starts]
    if any(block.any() for block in blocks):
        return blocks
    every = (np.asarray(array[slice(first, first + slices)]) for first in range(0, array.shape[0], slices))
    return [next((block for block in every if block.any()), blocks[0])]


def _find_axes(blocks: list[np.ndarray], shape: tuple[int, ...], *, name_axes: Callable[[int], str], where: str) -> str:
    """Return the order of the axes of an array of single values; TYX, unless its values show or suggest another."""
    spikes = [(block != 0).astype(np.uint8) for block in blocks]
    shown = _agreed(evidence.time_axes(block) for block in spikes)
    if len(shown) == 1:
        return name_axes(shown.pop())
    kept = {evidence.persistent_axis(block) for block in spikes}
    suspect = kept.pop() if len(kept) == 1 else None
    if suspect is None and shape[1:] not in KNOWN_SIZES and (shape[2] > 2 * shape[0] or shape[:2] in KNOWN_SIZES):
        suspect = 2
    if 0 in shown or not suspect or shape[0] >= LONG * shape[suspect]:
        return "TYX"
    raise BadInput(
        f"the array has shape {shape}, and its axis {suspect}, counted from 0, may be time", where=where,
        allowed="values that show which axis is time, or --axes", hint="add --axes TYX, YXT or another order",
    )  # fmt: skip


Way = TypeVar("Way")


def _agreed(shown: Iterable[Iterable[Way]]) -> set[Way]:
    """Return what all blocks that show anything show; a dark block shows nothing, and contradicts nothing."""
    sets = [ways for ways in map(set, shown) if ways]
    return set.intersection(*sets) if sets else set()


def _name_axes(time: int) -> str:
    return "YX"[:time] + "T" + "YX"[time:]


def _name_matlab_axes(time: int) -> str:
    """Return the axes of an array whose last axis in the file is the first here; rows come before columns there."""
    return _from_matlab(_name_axes((time + 2) % 3))


def _from_matlab(axes: str) -> str:
    return axes[2] + axes[:2]


def _shown_packing(blocks: list[np.ndarray], name_axes: Callable[[int], str]) -> list[Reading]:
    """Return the ways of packing that every block with spikes shows; one, if the evidence is clear."""
    return sorted(_agreed(_packing_of(block, name_axes) for block in blocks), key=str)


def _packing_of(block: np.ndarray, name_axes: Callable[[int], str]) -> list[Reading]:
    if ways := evidence.time_packing(block):
        return [Reading("packed", name_axes(axis), order) for axis, order in ways]
    if (way := evidence.row_packing(block)) is None:
        return []
    axes = name_axes(way[0])
    return [Reading("packed-x" if axes[way[1]] == "X" else "packed-y", axes, way[2])]


def _in_order(array: SlicedArray, axes: str) -> SlicedArray:
    """Return an array with its axes in the order TYX; where only slices can be read, by a copy in a temporary file."""
    if axes == "TYX":
        return array
    if not isinstance(array, np.ndarray):
        needed, free = prod(array.shape) * array.dtype.itemsize, free_disk_bytes(Path(gettempdir()))
        if needed > free:
            raise BadInput(
                f"the axes {axes} need a copy of {needed / 1e6:,.0f} MB in {gettempdir()}",
                allowed=f"{free / 1e6:,.0f} MB, which are free there",
                hint="store it with time on the first axis, or set TMPDIR to a larger disk",
            )  # fmt: skip
        with TemporaryFile(prefix="saf-gen-") as file:  # the map keeps it open
            copy = np.memmap(file, array.dtype, "w+", shape=array.shape)
        step = max(BLOCK_BYTES // max(prod(array.shape[1:]) * array.dtype.itemsize, 1), 1)
        for first in range(0, array.shape[0], step):
            copy[first : first + step] = array[slice(first, first + step)]
        array = copy
    ordered: np.ndarray = np.transpose(array, [axes.index(letter) for letter in "TYX"])
    return ordered


class SpikeArray:
    """The spikes in an array file.

    Parameters
    ----------
    path : str or Path
        File .npy, .npz or .mat.
    key : str, optional
        Name of the array, if the file has several with three axes or more.
    layout : str, optional
        ``frames`` for one value per pixel and frame; ``packed`` for eight frames per byte, ``packed-x`` and
        ``packed-y`` for eight pixels of a row or a column; by default recognised from the values.
    axes : str, optional
        Order of time, rows and columns in the file, such as ``TYX``, or ``YXT`` as is usual in MATLAB; by default
        recognised from the values, otherwise the usual order.
    order : str, optional
        Whether the first of eight values is the least (``lsb``) or most significant bit (``msb``); by default
        recognised from the values.
    size : tuple of int, optional
        Rows and columns, if the last byte of a row or column is not full.
    frames : int, optional
        Number of frames to read, from the first; by default all.
    flip : bool, default False
        Whether the bottom row comes first.

    Attributes
    ----------
    shape : tuple of int
        (T, H, W).
    reading : Reading
        How the values are read.

    Raises
    ------
    BadInput
        If the array does not have three axes of numbers, its frames have too many pixels, an option is unknown or does
        not fit, the values do not show what no option states, or the array has fewer frames than requested.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        key: str | None = None,
        layout: str | None = None,
        axes: str | None = None,
        order: str | None = None,
        size: tuple[int, int] | None = None,
        frames: int | None = None,
        flip: bool = False,
    ) -> None:
        for what, value, allowed in (
            ("layout of an array", layout, ARRAY_LAYOUTS),
            ("order of axes", axes, AXES),
            ("order of bits", order, BIT_ORDERS),
        ):
            if value not in (None, *allowed):
                raise unknown(what, value, allowed=allowed)
        array, self.path, self.flip = open_array(path, key=key), Path(path), flip
        if len(array.shape) != 3 or 0 in array.shape or array.dtype.kind not in "buif":
            raise BadInput(
                f"the array is {array.dtype} {array.shape}", where=str(path), allowed="numbers (frames, rows, columns)",
                hint="use saf-gen encode for pictures",
            )  # fmt: skip
        # The axes of a .mat file are permuted, so that its last axis is the first here.
        is_matlab = self.path.suffix.lower() == ".mat"
        here = _from_matlab(axes) if axes and is_matlab else axes
        reading = _find_reading(
            array,
            layout=layout,
            axes=here,
            order=order,
            by_definition=_is_rsir(array, key),
            name_axes=_name_matlab_axes if is_matlab else _name_axes,
            where=str(path),
        )
        self.reading = replace(reading, axes=reading.axes[1:] + reading.axes[0]) if is_matlab else reading
        self.layout = reading.layout
        if size is None and reading.layout in ("packed-x", "packed-y"):
            _check_last_byte(array, reading, where=str(path))
        self._spikes = _Frames(_in_order(array, reading.axes), reading, size=size, where=str(path))
        total, height, width = self._spikes.shape
        if height * width > MAX_PIXELS:
            raise BadInput(
                f"the frames have {(height, width)} pixels", where=str(path), allowed=f"at most {MAX_PIXELS} pixels"
            )
        if frames is not None and not 1 <= frames <= total:
            raise BadInput(f"{frames} frames were requested", where=str(path), allowed=f"1 to {total}")
        self.total, self.shape = total, (frames or total, height, width)
        self._step = max(min(BLOCK_BYTES // (height * width * max(array.dtype.itemsize, 1)), BLOCK) // 8 * 8, 8)
        self.origin: dict[str, Any] = {
            "file": name_as_text(self.path.name), "layout": self.layout, "flip": flip, "frames": self.shape[0]
        }  # fmt: skip
        if str(self.reading) not in USUAL:
            self.origin["read_as"] = str(self.reading)

    def frames(self, first: int, stop: int) -> np.ndarray:
        """Return frames ``first <= t < stop``, uint8 (n, H, W); raise BadInput if a value is not allowed."""
        frames = self._spikes[slice(first, stop)]
        return frames[:, ::-1] if self.flip else frames

    def packed(self, first: int, stop: int) -> np.ndarray:
        """Return packed spikes of frames ``first <= t < stop``, uint8 (H, W, bytes); ``first`` is a multiple of 8."""
        pieces = range(first, stop, self._step)
        return np.concatenate([bits.pack_bits(self.frames(at, min(at + self._step, stop))) for at in pieces], axis=2)

    def write(self, out: str | os.PathLike[str], *, readout_hz: float, **optional: Any) -> str:
        """Write the spikes as the stream file ``out`` and return its ``content_sha256``.

        Only a part is in memory at a time. ``optional`` are fields of :class:`Metadata`.
        """
        return write_source(self, out, readout_hz=readout_hz, **optional)


def _check_last_byte(array: SlicedArray, reading: Reading, *, where: str) -> None:
    """Raise BadInput if no pixel at the end of packed rows or columns has a spike: they may only fill a byte."""
    axis = reading.axes.index(PACKED_AXIS[reading.layout])
    seen = 0
    for block in _sample(array):
        seen |= int(np.bitwise_or.reduce(block.take(-1, axis=axis), axis=None))
    if seen and not seen & (0x80 if reading.bits == "lsb" else 0x01):
        what = "columns" if reading.layout == "packed-x" else "rows"
        raise BadInput(
            f"the last {what} of {8 * array.shape[axis]} have no spike", where=where,
            allowed="a size that says how many there are", hint="add --size, as in --size 400x250",
        )  # fmt: skip


KNOWN_SIZES = {(of.rows, of.columns) for of in RAW_LAYOUTS.values()}
USUAL = {
    str(Reading(layout, axes, bit)) for layout, bit in (("frames", ""), ("packed", "lsb")) for axes in ("TYX", "YXT")
}
"""Readings that need no mention in the provenance of a stream."""


def _is_rsir(array: SlicedArray, key: str | None) -> bool:
    return RSIR_KEY in (key, getattr(array, "name", None))
