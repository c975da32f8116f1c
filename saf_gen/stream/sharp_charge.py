"""The all-in-focus charge of a recording, ``/truth/sharp``: what its pixels would collect if everything were in focus.

It is stored in one piece, float32 (slice, light, row, col), in electrons per readout at gain 1, without noise, so that
one picture is read without the others. Slice j shows the scene at the beginning of the frame ``/truth/sharp_frame[j]``.
Between two slices the charge changes linearly, as that of the recording does, and before the first and after the last
it stays; a scene at rest has one slice. Under its light, readout t collects

    sum over lights g of gain[t, g] · ((1 - w)·sharp[j, g] + w·sharp[j + 1, g]),

where w is the fraction of the time from slice j to slice j + 1 at the middle of the readout.
"""

import hashlib
import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import h5py
import numpy as np

from saf_gen.core.plain_text import plural
from saf_gen.core.region import Region, region_shape
from saf_gen.errors import BadInput
from saf_gen.stream.checked_file import MAX_SMALL_BYTES, SHARP, holds, open_dataset, read_attribute
from saf_gen.stream.defocus_blur import check_frame
from saf_gen.stream.metadata import Metadata, Pictures, ReadableStream

DIGEST = "sharp_sha256"
"""Attribute of the file that holds the digest of the values."""
_FLOAT = np.dtype("<f4")


@dataclass(frozen=True)
class StoredPictures:
    """Pictures of a file, float32 (slice, light, row, col), that are read when they are asked for.

    The file is open only while it is read, so that thousands of recordings use neither file handles nor memory, in any
    number of processes.

    Attributes
    ----------
    path : Path
        The file.
    shape : tuple of int
        Slices, lights, rows and columns.
    offset : int
        Where the pictures begin in the file, in bytes.
    version : tuple of int
        Size and time of the last change of the file when it was opened.
    """

    path: Path
    shape: tuple[int, int, int, int]
    offset: int
    version: tuple[int, ...]

    @property
    def dtype(self) -> np.dtype:
        """The type of the numbers, float32."""
        return np.dtype(np.float32)

    @property
    def ndim(self) -> int:
        """The number of axes, 4."""
        return len(self.shape)

    def __len__(self) -> int:
        return self.shape[0]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return np.asarray(self.read(range(self.shape[0])), dtype=dtype)

    def __getitem__(self, key: Any) -> np.ndarray:
        """Return what NumPy's indexing gives; only the slices that the first index selects are read."""
        first, *others = key if isinstance(key, tuple) else (key,)
        if isinstance(first, slice):
            chosen, rest = range(*first.indices(len(self))), (slice(None), *others)
        elif isinstance(first, int | np.integer):
            j = range(len(self))[first]  # an IndexError if there is no such slice
            chosen, rest = range(j, j + 1), (0, *others)
        else:
            chosen, rest = range(len(self)), (first, *others)
        return np.asarray(self.read(chosen)[rest])

    def read(self, slices: range, *, region: Region | None = None) -> np.ndarray:
        """Return the pictures of some slices in a region, by default all of it, float32 (slice, light, h, w).

        Raises BadInput if the file is gone, has changed since it was opened, or ends before the pictures do.
        """
        _, lights, height, width = self.shape
        rows, columns = (slice(0, height), slice(0, width)) if region is None else region
        out = np.empty((len(slices), lights, rows.stop - rows.start, width), _FLOAT)
        try:
            with self.path.open("rb") as file:
                if _version(os.fstat(file.fileno())) != self.version:
                    raise BadInput("has changed since it was opened", where=str(self.path), hint="open it again")
                for n, j in enumerate(slices):
                    begin = self.offset + j * lights * height * width * _FLOAT.itemsize
                    if out.shape[2] == height:  # the lights of a slice follow each other
                        self._fill(out[n], file, begin=begin)
                        continue
                    for g in range(lights):
                        into = (g * height + rows.start) * width * _FLOAT.itemsize
                        self._fill(out[n, g], file, begin=begin + into)
        except OSError as error:
            raise BadInput(f"cannot be read: {error.strerror or error}", where=str(self.path)) from error
        return out[..., columns]

    def _fill(self, out: np.ndarray, file: Any, *, begin: int) -> None:
        """Read an array, which is contiguous in memory, from this place in the open file."""
        left = out.data.cast("B")
        file.seek(begin)
        while left:
            count = file.readinto(left)
            if not count:
                raise BadInput(f"ends within /{SHARP}", where=str(self.path), hint="copy it again")
            left = left[count:]


def _version(status: os.stat_result) -> tuple[int, ...]:
    return status.st_size, status.st_mtime_ns


@dataclass(frozen=True, eq=False)
class PartOfPictures:
    """The slices first <= j < stop of pictures in a region, read when they are asked for, for a part of a stream."""

    pictures: Pictures
    first: int
    stop: int
    region: Region

    @property
    def shape(self) -> tuple[int, ...]:
        """Slices, lights, rows and columns."""
        return self.stop - self.first, self.pictures.shape[1], *region_shape(self.region)

    @property
    def dtype(self) -> np.dtype:
        """The type of the numbers."""
        return self.pictures.dtype

    def __getitem__(self, j: int) -> np.ndarray:
        """Return the pictures of slice j, (light, h, w)."""
        return self.pictures[self.first + j][:, *self.region]


def check_pictures(metadata: Metadata, shape: tuple[int, int, int]) -> tuple[int, ...] | None:
    """Return the shape of the pictures that a file of (T, H, W) frames is to hold; None if it is to hold none.

    Raises BadInput if the type, the shape, the number of slices or that of the lights does not fit.
    """
    truth = metadata.truth
    if truth.sharp is None and truth.sharp_frame is None:
        return None
    if truth.sharp is None or truth.sharp_frame is None:
        held, lacking = ("sharp_frame", "sharp") if truth.sharp is None else ("sharp", "sharp_frame")
        raise BadInput(f"truth has {held}, but no {lacking}", allowed="both, or neither")
    found, slices = tuple(truth.sharp.shape), np.asarray(truth.sharp_frame).shape[0]
    lights = found[1] if metadata.gain is None and len(found) == 4 else np.asarray(metadata.gain).shape[-1]
    if found != (slices, lights, *shape[1:]) or 0 in found or truth.sharp.dtype.kind != "f":
        raise BadInput(
            f"sharp is {truth.sharp.dtype} {found}",
            allowed=f"float32 ({slices}, {lights}, {shape[1]}, {shape[2]}): slices of sharp_frame, lights of gain, "
            "rows and columns",
        )
    if math.prod(found[1:]) * _FLOAT.itemsize > MAX_SMALL_BYTES:
        raise BadInput(f"sharp has the shape {found}", allowed=f"at most {MAX_SMALL_BYTES:,} bytes for a slice")
    return found


def write_pictures(file: h5py.File, pictures: Pictures) -> str:
    """Write the pictures to ``/truth/sharp``, one slice after the other, and return the digest of their values.

    Raises BadInput if a charge is negative or not finite.
    """
    stored, sha = file.create_dataset(SHARP, tuple(pictures.shape), _FLOAT), hashlib.sha256()
    for j in range(pictures.shape[0]):
        picture = np.ascontiguousarray(pictures[j], _FLOAT)
        if not (np.isfinite(picture).all() and picture.min() >= 0):
            raise BadInput(f"sharp is negative or not finite in slice {j}", allowed="charge, at least 0")
        stored[j] = picture
        sha.update(picture.tobytes())
    return sha.hexdigest()


def open_pictures(file: h5py.File, path: Path) -> StoredPictures | None:
    """Return the pictures of an open stream file, which are not read; None if it has none.

    Raises BadInput if they are a link, are stored outside the file or in pieces, are of another type, or were not
    written to their end; ``check_pictures`` compares their shape with the rest.
    """
    if not (holds(file, "truth") and holds(file["truth"], "sharp")):
        return None
    where, item = str(path), open_dataset(file, SHARP, where=str(path), bulk=True)
    if item.dtype != _FLOAT or item.ndim != 4 or item.chunks is not None:
        pieces = "" if item.chunks is None else ", in pieces"
        raise BadInput(
            f"/{SHARP} is {item.dtype} {item.shape}{pieces}",
            where=where,
            allowed="float32 (slice, light, row, col), in one piece",
        )
    offset, size = item.id.get_offset(), math.prod(item.shape) * _FLOAT.itemsize
    if offset is None or item.id.get_storage_size() < size:
        raise BadInput(f"/{SHARP} was not written to its end", where=where, hint="write or copy the file again")
    return StoredPictures(path, item.shape, int(offset), _version(path.stat()))


def stated_digest(file: h5py.File, where: str) -> str:
    """Return the digest of the pictures as the file states it; raise BadInput if it states none."""
    found = read_attribute(file, DIGEST)
    if not isinstance(found, str):
        raise BadInput(f"does not state {DIGEST}", where=where, allowed=f"its digest if it has /{SHARP}")
    return found


def digest_of(pictures: StoredPictures) -> str:
    """Return the digest of the values of the pictures, all of which are read, one slice at a time."""
    sha = hashlib.sha256()
    for j in range(len(pictures)):
        sha.update(pictures[j].tobytes())
    return sha.hexdigest()


@dataclass(frozen=True, eq=False)
class SharpCharge:
    """The all-in-focus charge of the readouts of a recording, in a region.

    Attributes
    ----------
    pictures : StoredPictures
        The pictures of the file.
    frames : ndarray of int64, shape (S,)
        Frame of each slice.
    gain : ndarray of float32, shape (T, G)
        Gain of each light group in each readout.
    region : tuple of slice
        Rows and columns.
    """

    pictures: StoredPictures
    frames: np.ndarray
    gain: np.ndarray
    region: Region

    @classmethod
    def of_stream(cls, stream: ReadableStream, *, region: Region | None = None) -> Self:
        """Return the charge of the pixels of a region, by default of the whole frame.

        Raises BadInput if the stream does not hold it, or does not state its light.
        """
        truth, where = stream.truth, str(stream.path)
        if not isinstance(truth.sharp, StoredPictures) or truth.sharp_frame is None:
            raise BadInput(
                "does not hold its all-in-focus charge",
                where=where,
                allowed=f"streams with /{SHARP}",
                hint="generate it from a recipe with truth: {sharp: true}, which keeps its spikes",
            )
        if stream.gain is None:
            raise BadInput("does not state its light", where=where, allowed="streams with /light/gain")
        whole = slice(0, stream.shape[1]), slice(0, stream.shape[2])
        return cls(truth.sharp, truth.sharp_frame, stream.gain, whole if region is None else region)

    def total(self, first: int, stop: int) -> np.ndarray:
        """Return the charge of readouts ``first <= t < stop`` together, in electrons, float32 (h, w)."""
        low, weights = slice_weights(self.frames, range(first, stop))
        pictures = self.pictures.read(range(low, low + len(weights)), region=self.region)
        factors = (weights @ self.gain[first:stop]).astype(np.float32)
        # A matrix product would use many threads for little, and sum a pixel in an order that depends on the region.
        return np.asarray(np.einsum("sg,sgyx->yx", factors, pictures))


def slice_weights(frames: np.ndarray, window: range) -> tuple[int, np.ndarray]:
    """Return the number of the first slice that the readouts of a window need, and the weights from it on.

    The weights are float64 (slice, readout), and those of a readout add up to 1.
    """
    middle = np.arange(window.start, window.stop) + 0.5
    if len(frames) == 1:
        return 0, np.ones((1, len(middle)))
    before = np.clip(np.searchsorted(frames, middle, side="right") - 1, 0, len(frames) - 2)
    later = np.clip((middle - frames[before]) / (frames[before + 1] - frames[before]), 0, 1)
    slices = np.arange(before[0], before[-1] + 2)[:, None]
    weights = np.where(before == slices, 1 - later, 0) + np.where(before == slices - 1, later, 0)
    used = np.flatnonzero(weights.any(axis=1))
    return int(slices[used[0], 0]), weights[used[0] : used[-1] + 1]


def sharp_at(stream: ReadableStream, frame: int) -> np.ndarray:
    """Return the charge at a frame; see :meth:`saf_gen.stream.stream_file.SpikeStream.sharp`."""
    check_frame(stream, frame)
    return SharpCharge.of_stream(stream).total(frame, frame + 1)


def cut_pictures(metadata: Metadata, window: range, *, region: Region) -> dict[str, Any]:
    """Return the fields ``sharp`` and ``sharp_frame`` of the truth of a part of a recording, as metadata hold them.

    The slices around the frames of the part stay.
    """
    truth = metadata.truth
    if truth.sharp is None or truth.sharp_frame is None:
        return {"sharp": None, "sharp_frame": None}
    first, weights = slice_weights(truth.sharp_frame, window)
    stop = first + len(weights)
    frames = truth.sharp_frame[first:stop] - (window.start if len(truth.sharp_frame) > 1 else 0)
    return {"sharp": PartOfPictures(truth.sharp, first, stop, region), "sharp_frame": frames}


def describe_pictures(pictures: Pictures) -> str:
    """Return as text how many all-in-focus pictures there are."""
    return f"{plural(pictures.shape[0], 'picture')} under each of {plural(pictures.shape[1], 'light group')}"
