"""Spikes in array files: 0 or 1 for each pixel and frame, or eight frames per byte."""

import os
from dataclasses import dataclass
from json import dumps
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from saf_gen.core import bits
from saf_gen.core.files import name_as_text
from saf_gen.errors import BadInput, unknown
from saf_gen.stream.interop.array_files import SlicedArray, open_array
from saf_gen.stream.metadata import MAX_PIXELS, metadata_from_options
from saf_gen.stream.stream_writer import StreamWriter

ARRAY_LAYOUTS = ("frames", "packed")
SNIFFED_SLICES = 250
"""Slices that are examined to recognise the layout: packed frames soon have a byte above 1."""
BLOCK_BYTES = 64 << 20
"""Bytes that are read at a time."""


@dataclass(frozen=True)
class _PackedFrames:
    """Frames of an array (ceil(T/8), H, W): frame t is bit t mod 8, least significant first, of slice t div 8."""

    array: SlicedArray
    shape: tuple[int, int, int]

    def __getitem__(self, span: slice) -> np.ndarray:
        first, stop, _ = span.indices(self.shape[0])
        planes = np.ascontiguousarray(self.array[slice(first // 8, -(-stop // 8))])
        out = np.empty((stop - first, *self.shape[1:]), np.uint8)
        bits.unpack_bits(planes, out, first=first % 8)
        return out


@dataclass(frozen=True)
class _UnpackedFrames:
    array: SlicedArray
    shape: tuple[int, int, int]
    where: str

    def __getitem__(self, span: slice) -> np.ndarray:
        frames = self.array[slice(*span.indices(self.shape[0])[:2])]
        wrong = frames[(frames != 0) & (frames != 1)]
        if wrong.size:
            raise BadInput(
                f"holds {wrong[0]} in frame {span.start} or a later one", where=self.where, allowed="0 and 1, or bool",
                hint="add --layout packed if a byte holds eight frames",
            )  # fmt: skip
        return frames.astype(np.uint8)


class SpikeArray:
    """The spikes in an array file.

    Parameters
    ----------
    path : str or Path
        File .npy, .npz or .mat.
    key : str, optional
        Name of the array, if the file has several with three axes or more.
    layout : str, optional
        ``frames`` for one value per pixel and frame, ``packed`` for eight frames per byte; by default recognised from
        the values.
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
        If the array does not have three axes of numbers, its frames have too many pixels, the layout is unknown or is
        ``packed`` for values other than uint8, or the array has fewer frames than requested.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        key: str | None = None,
        layout: str | None = None,
        frames: int | None = None,
        flip: bool = False,
    ) -> None:
        if layout not in (None, *ARRAY_LAYOUTS):
            raise unknown("layout of an array", layout, allowed=ARRAY_LAYOUTS)
        array = open_array(path, key=key)
        if len(array.shape) != 3 or 0 in array.shape or array.dtype.kind not in "buif":
            raise BadInput(
                f"the array is {array.dtype} {array.shape}", where=str(path), allowed="numbers (frames, rows, columns)",
                hint="use saf-gen encode for pictures",
            )  # fmt: skip
        if prod(array.shape[1:]) > MAX_PIXELS:
            raise BadInput(
                f"the frames have {array.shape[1:]} pixels", where=str(path), allowed=f"at most {MAX_PIXELS} pixels"
            )
        sniffed = slice(0, max(min(SNIFFED_SLICES, BLOCK_BYTES // prod(array.shape[1:])), 1))
        sniffed_layout = "packed" if array.dtype == np.uint8 and array[sniffed].max() > 1 else "frames"
        self.path, self.layout, self.flip = Path(path), layout or sniffed_layout, flip
        if self.layout == "packed" and array.dtype != np.uint8:
            raise BadInput(f"the array is {array.dtype}", where=str(path), allowed="uint8 for layout packed")
        total = array.shape[0] * (8 if self.layout == "packed" else 1)
        if frames is not None and not 1 <= frames <= total:
            raise BadInput(f"{frames} frames were requested", where=str(path), allowed=f"1 to {total}")
        self.shape = (frames or total, array.shape[1], array.shape[2])
        spikes = (
            _PackedFrames(array, self.shape)
            if self.layout == "packed"
            else _UnpackedFrames(array, self.shape, where=str(path))
        )
        self._spikes, self._frame_bytes = spikes, prod(self.shape[1:]) * max(array.dtype.itemsize, 1)

    def frames(self, first: int, stop: int) -> np.ndarray:
        """Return frames ``first <= t < stop``, uint8 (n, H, W); raise BadInput if a value is not 0 or 1."""
        frames = self._spikes[slice(first, stop)]
        return frames[:, ::-1] if self.flip else frames

    def write(self, out: str | os.PathLike[str], *, readout_hz: float, **optional: Any) -> str:
        """Write the spikes as the stream file ``out`` and return its ``content_sha256``.

        Only a part is in memory at a time. ``optional`` are fields of :class:`Metadata` other than the provenance.
        """
        settings = {
            "file": name_as_text(self.path.name),
            "layout": self.layout,
            "flip": self.flip,
            "frames": self.shape[0],
        }
        provenance = {"import": dumps(settings, ensure_ascii=False)}
        metadata = metadata_from_options({**optional, "provenance": provenance})
        step = max(min(BLOCK_BYTES // self._frame_bytes, 2_000) // 8 * 8, 8)
        with StreamWriter(out, shape=self.shape, readout_hz=readout_hz, metadata=metadata) as writer:
            for first in range(0, self.shape[0], step):
                writer.write(bits.pack_bits(self.frames(first, min(first + step, self.shape[0]))))
        return writer.content_sha256
