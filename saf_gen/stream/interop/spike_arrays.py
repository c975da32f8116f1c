"""Spikes in arrays: a 0 or 1 for each pixel and frame, or eight frames to a byte."""

import os
from dataclasses import dataclass
from json import dumps
from pathlib import Path
from typing import Any

import numpy as np

from saf_gen.core import bits
from saf_gen.errors import BadInput, unknown
from saf_gen.stream.interop.array_files import SlicedArray, open_array_file
from saf_gen.stream.stream_writer import write_stream

ARRAY_LAYOUTS = ("frames", "packed")
LOOKED_AT = 250
"""Slices that tell the layout: a byte of packed frames is soon above 1."""


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
class _WholeFrames:
    array: SlicedArray
    shape: tuple[int, int, int]
    where: str

    def __getitem__(self, span: slice) -> np.ndarray:
        frames = self.array[slice(*span.indices(self.shape[0])[:2])]
        if frames.dtype == np.uint8 and frames.max() > 1:
            raise BadInput(
                f"holds {frames.max()} from frame {span.start} on", where=self.where, allowed="0 and 1",
                hint="--layout packed if a byte holds eight frames",
            )  # fmt: skip
        return np.asarray(frames)


@dataclass(frozen=True)
class _TurnedOver:
    frames: _PackedFrames | _WholeFrames

    @property
    def shape(self) -> tuple[int, int, int]:
        return self.frames.shape

    def __getitem__(self, span: slice) -> np.ndarray:
        return self.frames[span][:, ::-1]


class SpikeArray:
    """The spikes in an array file, and how they are read: ``layout`` is ``frames`` or ``packed``.

    ``frames`` limits them to the first; ``shape`` is (T, H, W).

    Raises BadInput for an array that is not (T, H, W) of numbers, an unknown layout, and frames that are not there.
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
        array = open_array_file(path, key=key)
        if len(array.shape) != 3 or 0 in array.shape or array.dtype.kind not in "buif":
            raise BadInput(
                f"the array is {array.dtype} {array.shape}", where=str(path), allowed="numbers (frames, rows, columns)",
                hint="pictures become spikes with saf-gen encode",
            )  # fmt: skip
        seems = "packed" if array.dtype == np.uint8 and array[slice(0, LOOKED_AT)].max() > 1 else "frames"
        self.path, self.layout, self.flip = Path(path), layout or seems, flip
        if self.layout == "packed" and array.dtype != np.uint8:
            raise BadInput(f"the array is {array.dtype}", where=str(path), allowed="uint8 for layout packed")
        total = array.shape[0] * (8 if self.layout == "packed" else 1)
        if frames is not None and not 1 <= frames <= total:
            raise BadInput(f"{frames} frames were requested", where=str(path), allowed=f"1 to {total}")
        self.shape = (frames or total, array.shape[1], array.shape[2])
        spikes = (
            _PackedFrames(array, self.shape)
            if self.layout == "packed"
            else _WholeFrames(array, self.shape, where=str(path))
        )
        self.frames = _TurnedOver(spikes) if flip else spikes

    def write(self, out: str | os.PathLike[str], *, readout_hz: float, **optional: Any) -> str:
        """Write the spikes as the stream file ``out`` and return its content_sha256; a part is in memory at a time."""
        settings = {"file": self.path.name, "layout": self.layout, "flip": self.flip, "frames": self.shape[0]}
        provenance = {"import": dumps(settings, ensure_ascii=False)}
        return write_stream(out, self.frames, readout_hz=readout_hz, provenance=provenance, **optional)
