"""The file of a frame camera, layout version 2: one HDF5 file per sequence, beside the truth of the sequence.

``/frames`` (uint16; T, H, W) holds the numbers that were read out, the camera's black level included; the attribute
``black_level_dn`` states it. Everything else is as in a stream file (:mod:`saf_gen.stream.stream_file`): focus, light,
truth and provenance, for the T frames.
"""

import hashlib
import os
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any, ClassVar, NoReturn, Self

import h5py
import numpy as np

from saf_gen.core.files import atomic_file
from saf_gen.core.region import Region, region_shape, validate_region, validate_window
from saf_gen.errors import BadInput
from saf_gen.stream.checked_file import CheckedFile, check_deflated, holds, open_dataset, read_attribute, report_damage
from saf_gen.stream.full_disk import new_hdf5
from saf_gen.stream.metadata import Metadata, metadata_to_datasets, stream_digest_lines
from saf_gen.stream.pixel_mask import Filling

FORMAT, LAYOUT = "saf-gen frames", 2


class FrameWriter:
    """A context manager that writes the file of a frame camera frame by frame, whole or not at all.

    It writes to a temporary file next to ``path``, which takes its name on a clean exit, when ``content_sha256`` is
    set.

    Parameters
    ----------
    path : str or Path
        File to write.
    shape : tuple of int
        (T, H, W).
    readout_hz : float
        Frames per second.
    black_level_dn : int
        Number that stands for no light, in every frame.
    metadata : Metadata
        Everything that the file holds except the frames.

    Attributes
    ----------
    notes : dict of str to str
        Texts by name that are known at the end, for the provenance; to be set before it.

    Raises
    ------
    BadInput
        If a field of the metadata is not allowed, or the folder cannot be written.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        shape: tuple[int, int, int],
        readout_hz: float,
        black_level_dn: int,
        metadata: Metadata,
    ) -> None:
        self.path, self.shape = Path(path), shape
        self.content_sha256, self.notes = "", dict[str, str]()
        self._stated = {"readout_hz": float(readout_hz), "black_level_dn": int(black_level_dn)}
        self._datasets = metadata_to_datasets(metadata, shape)
        self._sha, self._count = hashlib.sha256(), 0

    def __enter__(self) -> Self:
        with ExitStack() as undo:
            part = undo.enter_context(atomic_file(self.path))
            self._file, self._disk = undo.enter_context(new_hdf5(part))
            self._frames = self._file.create_dataset(
                "frames",
                self.shape,
                "uint16",
                chunks=(1, *self.shape[1:]),
                compression="gzip",
                compression_opts=1,
                shuffle=True,
            )
            self._undo = undo.pop_all()
        return self

    @property
    def size(self) -> str:
        """How many frames there are, in words."""
        return f"{self.shape[0]:,} frames"

    def write(self, frame: np.ndarray) -> None:
        """Append a frame, uint16 (H, W).

        Raises BadInput if it has another shape, or the recording is full.
        """
        if self._count == self.shape[0] or frame.shape != self.shape[1:]:
            raise BadInput(
                f"frame {self._count} has the shape {frame.shape}", allowed=f"{self.shape[0]} of {self.shape[1:]}"
            )
        self._frames[self._count] = frame
        self._disk.check()
        self._sha.update(np.ascontiguousarray(frame, "<u2").tobytes())
        self._count += 1

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is not None:
            self._undo.__exit__(kind, error, trace)
            return
        with self._undo:
            if self._count != self.shape[0]:
                raise BadInput(f"there are {self._count} frames", allowed=f"{self.shape[0]}")
            texts = {f"/provenance/{name}": text for name, text in self.notes.items()}
            for name, value in {**self._datasets, **texts}.items():
                text = isinstance(value, str | tuple)
                self._file.create_dataset(name, data=value, dtype=h5py.string_dtype() if text else None)
            content = _content_digest(self._datasets, self._sha.hexdigest(), shape=self.shape, stated=self._stated)
            self._file.attrs.update(format=FORMAT, layout=LAYOUT, content_sha256=content, **self._stated)
        self.content_sha256 = content


def _content_digest(
    small: Mapping[str, Any], frames: str, *, shape: tuple[int, int, int], stated: Mapping[str, float]
) -> str:
    """Return ``content_sha256``: over the frames, of this digest, the numbers stated, and all but the provenance."""
    lines = [line for line in stream_digest_lines(small.items()) if not line.startswith("/provenance/")]
    lines.append(f"/frames uint16 {'x'.join(map(str, shape))} {frames}")
    numbers = [f"{name} {value!r}" for name, value in stated.items()]
    return hashlib.sha256("\n".join([*numbers, *sorted(lines)]).encode()).hexdigest()


def has_frames(path: str | os.PathLike[str]) -> bool:
    """Return whether a file on a disk is HDF5 that holds frames, ours or others'."""
    if not (Path(path).is_file() and h5py.is_hdf5(path)):
        return False
    try:
        with h5py.File(path, "r") as file:
            return holds(file, "frames")
    except OSError:
        return False


def open_frames(path: str | os.PathLike[str]) -> "FrameFile":
    """Open the file of a frame camera; close it, or use it in a ``with`` block.

    Raises BadInput if it is missing, no such file, of another layout version, or not complete.
    """
    return FrameFile(Path(path))


class FrameFile(CheckedFile):
    """An open file of a frame camera, a recording that can be judged; files from untrusted sources are safe to open.

    Attributes
    ----------
    path : Path
        The file.
    shape : tuple of int
        (T, H, W): frames, rows and columns.
    readout_hz : float
        Frames per second.
    black_level_dn : int
        Number that stands for no light, in every frame.
    metadata : Metadata
        Lens, light and truth, as in a stream file; ``truth``, ``focus_position``, ``gain`` and ``light_names`` are its.
    content_sha256 : str
        Digest of the content.
    """

    form: ClassVar[str] = "frames"

    def __init__(self, path: Path) -> None:
        with report_damage(path):
            self._open(path, holding="frames", form=(FORMAT, LAYOUT), bulk=("frames",))
            self._read_frames(path)

    def _read_frames(self, path: Path) -> None:
        self._where, where = path, str(path)
        self._frames = open_dataset(self._file, "frames", where=where, bulk=True)
        if self._frames.dtype != np.uint16 or self._frames.ndim != 3 or 0 in self._frames.shape:
            raise BadInput(
                f"/frames is {self._frames.dtype} {self._frames.shape}", where=where, allowed="uint16 (T, H, W)"
            )
        hz = read_attribute(self._file, "readout_hz", number=True)
        if hz is None or not 0 < float(hz) < np.inf:
            raise BadInput("it does not say its frames per second", where=where, hint="make it again")
        self.shape = self._frames.shape
        self.readout_hz = float(hz)
        black = read_attribute(self._file, "black_level_dn", number=True)
        if black is None or not 0 <= black < 2**16 or black != int(black):  # also false for NaN
            raise BadInput("it does not say its black level", where=where, hint="make it again")
        self.black_level_dn = int(black)
        if self._frames.chunks != (1, *self.shape[1:]) or self._frames.id.get_num_chunks() < self.shape[0]:
            raise BadInput("/frames was not written to its end", where=where, hint="make it again")
        check_deflated(self._frames, where=where)
        self._read_metadata()

    def __repr__(self) -> str:
        frames, rows, columns = self.shape
        return f"<FrameFile {self._where.name}: {frames:,} frames of {columns}×{rows} at {self.readout_hz:g} Hz>"

    def frames(self, first: int, stop: int, *, region: Region | None = None) -> np.ndarray:
        """Return frames ``first <= t < stop`` as they were read out, with the black level: uint16 (stop - first, h, w).

        Raises BadInput if the window is empty or leaves the recording, the region leaves the frame, or the file is
        damaged.
        """
        window = validate_window(first, stop, total=self.shape[0], where=str(self.path))
        rows, columns = validate_region(region, self.shape[1:], where=str(self.path))
        with report_damage(self._where):
            found: np.ndarray = self._frames[window.start : window.stop, rows, columns]
        return found

    def counts(self, first: int, stop: int, *, region: Region | None = None, filled: bool = True) -> np.ndarray:
        """Return the sum of the light of frames ``first <= t < stop``, levels above the black level: uint32 (h, w).

        Measures that divide by the mean are then of the light alone, as with every other camera; all others are the
        same with the black level and without it. A number below the black level, which is noise in the dark, counts as
        0. Raises BadInput as :meth:`frames` does.
        """
        total = np.zeros(region_shape(validate_region(region, self.shape[1:], where=str(self.path))), np.uint32)
        window = validate_window(first, stop, total=self.shape[0], where=str(self.path))
        for frame in range(window.start, window.stop):  # one at a time, so that memory does not grow with the window
            total += above_black(self.frames(frame, frame + 1, region=region)[0], self.black_level_dn)
        return total

    def filling(self, region: Region | None = None) -> Filling:
        """Return what fills masked pixels, of which these files have none."""
        return Filling(None, validate_region(region, self.shape[1:], where=str(self.path)))

    def packed(self, first_byte: int, stop_byte: int, *, region: Region | None = None) -> NoReturn:
        """Raise BadInput, because a frame camera has no spikes."""
        raise BadInput("a frame camera has no spikes", where=str(self.path), allowed="sums of frames")

    def texture(self, first: int, stop: int, *, region: Region | None = None) -> NoReturn:
        """Raise BadInput, because a frame camera has no intervals between spikes."""
        raise BadInput("a frame camera has no intervals between spikes", where=str(self.path), allowed="sums of frames")

    def verify(self) -> None:
        """Read the whole file; raise BadInput if its content does not match its digest."""
        sha = hashlib.sha256()
        for frame in range(self.shape[0]):
            sha.update(self.frames(frame, frame + 1).astype("<u2").tobytes())
        stated = {"readout_hz": self.readout_hz, "black_level_dn": self.black_level_dn}
        found = _content_digest(self._small, sha.hexdigest(), shape=self.shape, stated=stated)
        self._check_content(found)


def above_black(frames: np.ndarray, black_level_dn: int) -> np.ndarray:
    """Return by how much the numbers of frames are above the black level, at least 0: uint16."""
    black = np.uint16(black_level_dn)
    return np.maximum(frames, black) - black
