"""Spikes as arrays in files of others, in the order of axes and of bits that a user states."""

import os
from itertools import permutations
from math import prod
from pathlib import Path
from tempfile import TemporaryFile, gettempdir
from typing import Any

import numpy as np

from saf_gen.core import bits
from saf_gen.core.files import free_disk_bytes, name_as_text
from saf_gen.errors import BadInput, unknown
from saf_gen.stream.interop.array_files import SlicedArray, open_array
from saf_gen.stream.interop.raw_frames import BIT_ORDERS
from saf_gen.stream.interop.source import BLOCK, write_source
from saf_gen.stream.metadata import MAX_PIXELS

AXES = tuple("".join(letters) for letters in permutations("TYX"))
"""Orders of time, rows and columns in an array."""
BLOCK_BYTES = 64 << 20
"""Bytes that are read at a time."""
_REVERSED = np.packbits(np.unpackbits(np.arange(256, dtype=np.uint8)[:, None], axis=1), axis=1, bitorder="little")[:, 0]
"""Each byte with its bits in the other order."""


class SpikeArray:
    """The spikes in an array file, as a :class:`saf_gen.stream.interop.source.Source`.

    Parameters
    ----------
    path : str or Path
        File .npy, .npz or .mat.
    axes : str or None
        Order of time, rows and columns, as the program that wrote the file sees them: ``TYX``, or ``YXT`` as is usual
        in MATLAB. No array states it, so None is refused.
    order : str, optional
        ``lsb`` or ``msb`` if a byte holds eight readouts of a pixel, the first in its least or most significant bit; by
        default a value is one readout.
    key : str, optional
        Name of the array, if the file has several with three axes or more.
    frames : int, optional
        Number of frames to read, from the first; by default all.
    flip : bool, default False
        Whether the bottom row comes first.

    Attributes
    ----------
    shape : tuple of int
        (T, H, W).

    Raises
    ------
    BadInput
        If the array does not have three axes of numbers, its axes are not stated, an option is unknown or does not fit,
        its frames have too many pixels, it has fewer frames than requested, or its values may be readouts or bytes.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        axes: str | None,
        order: str | None = None,
        key: str | None = None,
        frames: int | None = None,
        flip: bool = False,
    ) -> None:
        for what, value, allowed in (("order of axes", axes, AXES), ("order of bits", order, BIT_ORDERS)):
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
        if axes is None:
            shape = (*array.shape[1:], array.shape[0]) if is_matlab else array.shape
            raise BadInput(
                f"an array of the shape {shape} does not say which axis is time", where=str(path),
                allowed="--axes, time T, rows Y and columns X in their order",
                hint="add --axes YXT if time comes last" if is_matlab else "add --axes TYX if time comes first",
            )  # fmt: skip
        _check_values(array, order, where=str(path))
        self._array, self._order = _in_time(array, axes[2] + axes[:2] if is_matlab else axes), order
        steps, height, width = self._array.shape
        total = steps if order is None else 8 * steps
        if height * width > MAX_PIXELS:
            raise BadInput(
                f"the frames have {(height, width)} pixels", where=str(path), allowed=f"at most {MAX_PIXELS} pixels"
            )
        if frames is not None and not 1 <= frames <= total:
            raise BadInput(f"{frames} frames were requested", where=str(path), allowed=f"1 to {total}")
        self.total, self.shape = total, (frames or total, height, width)
        self._step = max(min(BLOCK_BYTES // (height * width * max(array.dtype.itemsize, 1)), BLOCK) // 8 * 8, 8)
        self.origin: dict[str, Any] = {
            "file": name_as_text(self.path.name), "axes": axes, "flip": flip, "frames": self.shape[0]
        }  # fmt: skip
        if order is not None:
            self.origin["bits"] = order

    def frames(self, first: int, stop: int) -> np.ndarray:
        """Return frames ``first <= t < stop``, uint8 (n, H, W); raise BadInput if a value is not allowed."""
        if self._order is None:
            values = self._array[slice(first, stop)]
            wrong = values[(values != 0) & (values != 1)]
            if wrong.size:
                raise BadInput(
                    f"holds {wrong[0]} in frame {first} or a later one", where=str(self.path), allowed="0 and 1",
                    hint="add --bits lsb or --bits msb if a byte holds eight frames",
                )  # fmt: skip
            frames = (values != 0).astype(np.uint8)
        else:
            planes = np.ascontiguousarray(self._array[slice(first // 8, -(-stop // 8))])
            frames = np.empty((stop - first, *self.shape[1:]), np.uint8)
            bits.unpack_bits(_REVERSED[planes] if self._order == "msb" else planes, frames, first=first % 8)
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


def _check_values(array: SlicedArray, order: str | None, *, where: str) -> None:
    """Raise BadInput if ``order`` is given for other values than bytes, or if bytes without a spike may be either."""
    if order is not None and array.dtype != np.uint8:
        raise BadInput(
            f"--bits {order} is given for an array of {array.dtype}", where=where, allowed="uint8",
            hint="leave it out if a value is one readout",
        )  # fmt: skip
    if order is None and array.dtype == np.uint8:
        step = _slices(array)
        if not any(array[slice(at, at + step)].any() for at in range(0, array.shape[0], step)):
            raise BadInput(
                "has no spike, so that a byte may be one readout or eight", where=where,
                allowed="--bits lsb or --bits msb for eight", hint="store it as bool if a value is one readout",
            )  # fmt: skip


def _slices(array: SlicedArray) -> int:
    """Return the number of slices that are read at a time."""
    return max(BLOCK_BYTES // max(prod(array.shape[1:]) * array.dtype.itemsize, 1), 1)


def _in_time(array: SlicedArray, axes: str) -> SlicedArray:
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
        step = _slices(array)
        for first in range(0, array.shape[0], step):
            copy[first : first + step] = array[slice(first, first + step)]
        array = copy
    ordered: np.ndarray = np.transpose(array, [axes.index(letter) for letter in "TYX"])
    return ordered
