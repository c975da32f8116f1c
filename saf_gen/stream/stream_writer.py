"""Writers of stream files, in pieces or from an array; :mod:`saf_gen.stream.stream_file` describes the layout."""

import hashlib
import math
import operator
import os
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import h5py
import numpy as np

from saf_gen.core import bits
from saf_gen.core.files import atomic_file, unwritable
from saf_gen.errors import BadInput
from saf_gen.stream import time_blocks
from saf_gen.stream.checked_file import read_small_datasets
from saf_gen.stream.full_disk import ErrorRecordingFile
from saf_gen.stream.metadata import (
    FORMAT,
    LAYOUT,
    Metadata,
    metadata_from_options,
    metadata_to_datasets,
    stream_digests,
)
from saf_gen.stream.time_blocks import TIME_BLOCK_BYTES, make_thread_pool


class _WriteAborted(Exception):
    """Makes a writer undo its work; the caller's exception is not used, as it may be an OSError of another file."""


class StreamWriter:
    """A context manager that writes a stream file in pieces; its use of memory does not grow with T.

    It writes to a temporary file next to ``path``. On a clean exit the file is closed, read back and compared
    with what was written (the small datasets by value, each chunk of spikes by the CRC-32 of its compressed
    bytes), and renamed; ``content_sha256`` is then set. On an exception the temporary file is removed.

    Parameters
    ----------
    path : str or Path
        File to write.
    shape : tuple of int
        (T, H, W): frames, rows and columns, each at least 1.
    readout_hz : float, default 20000
        Readouts per second.
    metadata : Metadata, optional
        Everything that the file holds except the spikes.
    threads : int, optional
        Number of threads that compress; by default one per core, at most eight.

    Attributes
    ----------
    notes : dict of str to str
        Texts by name that are known at the end, for the provenance; to be set before it.

    Raises
    ------
    BadInput
        If the shape, ``readout_hz`` or a field of the metadata is not allowed, or if the folder cannot be written.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        shape: tuple[int, int, int],
        readout_hz: float = 20_000,
        metadata: Metadata | None = None,
        threads: int | None = None,
    ) -> None:
        self.path, self._threads = Path(path), threads
        if len(shape) != 3 or min(shape) < 1:
            raise BadInput(f"shape is {tuple(shape)}", where=str(path), allowed="T, H, W, each at least 1")
        if not (math.isfinite(readout_hz) and readout_hz > 0):
            raise BadInput(f"readout_hz is {readout_hz}", where=str(path), allowed="a finite number above 0")
        frames, self._rows, self._columns = (operator.index(n) for n in shape)
        self.shape, self.readout_hz = (frames, self._rows, self._columns), float(readout_hz)
        self.content_sha256, self.notes = "", dict[str, str]()
        self._datasets = metadata_to_datasets(metadata or Metadata(), self.shape)
        self._length = -(-frames // 8)
        self._chunk = time_blocks.chunk_shape((self._rows, self._columns, self._length))
        self._sha, self._crcs = hashlib.sha256(), dict[tuple[int, int], int]()
        self._assembler = time_blocks.TimeBlockAssembler(self.shape, where=str(path))
        self._done = 0  # bytes along time in the file
        self._file: h5py.File | None = None

    def __enter__(self) -> Self:
        with ExitStack() as undo:
            self._part = undo.enter_context(atomic_file(self.path))
            self._recording_file = ErrorRecordingFile(self._part)
            undo.callback(self._recording_file.close)
            self._file = h5py.File(self._recording_file, "w", libver="v110")  # its structures carry checksums
            undo.callback(self._close)
            self._spikes = self._file.create_dataset(
                "spikes",
                (self._rows, self._columns, self._length),
                "uint8",
                chunks=self._chunk,
                compression="gzip",
                compression_opts=1,
            )
            self._spikes.attrs.update(frames=self.shape[0], readout_hz=self.readout_hz)
            for name, value in self._datasets.items():
                text = isinstance(value, str | tuple)
                self._file.create_dataset(name, data=value, dtype=h5py.string_dtype() if text else None)
            self._pool = undo.enter_context(make_thread_pool("deflate", self._threads))
            self._undo = undo.pop_all()
        return self

    @property
    def size(self) -> str:
        """How many frames there are, in words."""
        return f"{self.shape[0]:,} frames"

    def write(self, packed: np.ndarray) -> None:
        """Append packed spikes.

        Parameters
        ----------
        packed : ndarray of uint8, shape (H, W, n)
            Any number n of bytes along time. Frame t is bit t mod 8, least significant first, of byte t div 8.

        Raises
        ------
        BadInput
            If the writer is not open, if dtype or shape is wrong, if there are too many bytes or spikes after the last
            frame, or if the disk is full.
        """
        if self._file is None:
            raise BadInput("the writer is not open", where=str(self.path), hint="use it in a with statement")
        for time_block in self._assembler.add(packed):
            self._store(time_block)

    def _store(self, time_block: np.ndarray) -> None:
        height = self._chunk[0]
        starts = range(0, self._rows, height)

        def deflate(row: int) -> bytes:
            return time_blocks.deflate_chunk(time_block[row : row + height], self._chunk)

        def hash_block() -> None:
            for row in starts:
                self._sha.update(np.ascontiguousarray(time_block[row : row + height]).data)

        hashing = self._pool.submit(hash_block)
        try:
            for row, data in zip(starts, self._pool.map(deflate, starts), strict=True):
                self._crcs[row, self._done] = time_blocks.checksum(data)
                self._spikes.id.write_direct_chunk((row, 0, self._done), data)
                self._recording_file.check()
        except OSError as error:
            raise unwritable(self.path, error) from error
        finally:
            hashing.result()
        self._done += time_block.shape[2]

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with suppress(_WriteAborted), self._undo:
            if kind is not None:
                raise _WriteAborted
            sha256 = self._verify_written()
        if kind is None:
            self.content_sha256 = sha256

    def _verify_written(self) -> str:
        """Close the file, compare it with what was written, and return its ``content_sha256``."""
        self._assembler.check_complete()
        for name, text in self.notes.items():
            self._datasets[f"/provenance/{name}"] = text
            self._spikes.file.create_dataset(f"provenance/{name}", data=text, dtype=h5py.string_dtype())
        spikes, shape = self._sha.hexdigest(), self._spikes.shape
        digest = partial(stream_digests, spikes=spikes, readout_hz=self.readout_hz, frames=self.shape[0])
        sha256, provenance = written = digest(self._datasets.items(), shape)
        if self._file is not None:
            digests = {"content_sha256": sha256, "spikes_sha256": spikes, "provenance_sha256": provenance}
            self._file.attrs.update(format=FORMAT, layout=LAYOUT, **digests)
            self._file.close()
        self._recording_file.check()
        with h5py.File(self._part, "r") as file:
            stored = digest(read_small_datasets(file, str(self.path)), shape)
            chunks = file["spikes"].id
            same = all(
                time_blocks.checksum(chunks.read_direct_chunk((row, 0, at))[1]) == crc
                for (row, at), crc in self._crcs.items()
            )
        if not same or stored != written:
            raise BadInput(
                "the file that was read back differs from what was written", where=str(self.path), hint="check the disk"
            )
        return sha256

    def _close(self) -> None:
        if self._file is not None:
            self._file.close()
        self._file = None


def write_stream(path: str | os.PathLike[str], frames: Any, *, readout_hz: float = 20_000, **optional: Any) -> str:
    """Write frames from any source as a stream file.

    Parameters
    ----------
    path : str or Path
        File to write; its folder is created if it is missing.
    frames : array_like of 0 and 1, or of bool, shape (T, H, W)
        Any object with a shape whose slices along time are arrays will do, such as a memory map; 2,000 frames are
        read at a time.
    readout_hz : float, default 20000
        Readouts per second.
    **optional
        Fields of :class:`Metadata`; ``truth`` may be a mapping of fields of :class:`Truth`.

    Returns
    -------
    str
        The ``content_sha256`` of the file.

    Raises
    ------
    BadInput
        If the shape, dtype or values of a field are not allowed, in which case the message names the field, or if the
        file cannot be written.
    """
    if not hasattr(frames, "shape"):
        frames = np.asarray(frames)
    if len(frames.shape) != 3 or min(frames.shape) < 1:
        raise BadInput(f"frames have shape {tuple(frames.shape)}", where=str(path), allowed="(T, H, W), T at least 1")
    total = int(frames.shape[0])
    metadata = metadata_from_options(optional)
    with StreamWriter(path, shape=tuple(frames.shape), readout_hz=readout_hz, metadata=metadata) as writer:
        for first in range(0, total, 8 * TIME_BLOCK_BYTES):
            time_block = np.asarray(frames[first : first + 8 * TIME_BLOCK_BYTES])
            if time_block.dtype.kind not in "bu" or time_block.max() > 1:  # a single pass for ordinary frames
                wrong = time_block[(time_block != 0) & (time_block != 1)]
                if time_block.dtype.kind not in "buif" or wrong.size:
                    value = f"value {wrong[0]!s}" if wrong.size else f"dtype {time_block.dtype}"
                    raise BadInput(
                        f"frame {first} or a later one has the {value}", where=str(path), allowed="0 and 1, or bool"
                    )
            writer.write(bits.pack_bits(time_block))
    return writer.content_sha256
