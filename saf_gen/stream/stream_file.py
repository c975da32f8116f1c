"""The stream file, layout version 1: one HDF5 file per sequence, written by generation and read by the benchmark.

Spikes are packed along time, uint8 (H, W, ceil(T/8)): frame t is bit t mod 8, least significant first, of
byte t div 8; unused bits of the last byte are 0. A chunk holds a band of rows, all columns and 250 bytes (2,000
frames), so that reading a window or a band of rows does not decompress the rest of the file. isa-l compresses chunks
with deflate on threads, outside HDF5's lock; every HDF5 library reads the result without a plug-in.
:mod:`saf_gen.stream.time_blocks` decompresses and transposes chunks. :mod:`saf_gen.stream.metadata` defines the other
datasets and ``content_sha256`` (over names, dtypes, shapes and values, not over the file).
"""

import errno
import hashlib
import itertools
import math
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, Self

import h5py
import numpy as np

from saf_gen.core import bits
from saf_gen.core.files import HDF5_SIGNATURE, check_on_disk, refuse_link
from saf_gen.core.plain_text import plural
from saf_gen.core.region import Region, region_shape, validate_region, validate_window
from saf_gen.errors import BadInput, closest
from saf_gen.stream import time_blocks
from saf_gen.stream.checked_file import holds, open_spikes, read_attribute, read_small_datasets
from saf_gen.stream.count_cache import count_windows
from saf_gen.stream.interval_texture import window_texture
from saf_gen.stream.metadata import FORMAT, LAYOUT, metadata_from_datasets, stream_digests
from saf_gen.stream.pixel_mask import Filling, PixelMask
from saf_gen.stream.time_blocks import DamagedChunk, chunk_shape, inflate_chunk


def open_stream(path: str | os.PathLike[str], *, threads: int | None = None) -> "SpikeStream":
    """Open a stream file for reading, preferably in a ``with`` statement.

    Parameters
    ----------
    path : str or Path
        Stream file (.h5).
    threads : int, optional
        Number of threads that decompress this stream. By default all open streams share a pool of one thread
        per core, at most eight.

    Returns
    -------
    SpikeStream
        The open stream.

    Raises
    ------
    BadInput
        If the file is missing, truncated, damaged, not HDF5, not a stream, or of another layout version; if it refers
        to other files, contains anything that a stream does not, or does not contain the small datasets that it was
        made with.
    """
    where = Path(path)
    if not where.is_file():
        check_on_disk(where)
        if where.exists():
            what = "a folder" if where.is_dir() else "not a file on a disk"
            inside = next((str(path) for pattern in ("*.h5", "*/*.h5") for path in sorted(where.glob(pattern))), "")
            raise BadInput(f"this is {what}", where=str(where), allowed="a stream file (.h5)", nearest=inside)
        others = [p.name for p in where.parent.iterdir()] if where.parent.is_dir() else []
        missing = "there is no such file" if where.parent.is_dir() else f"there is no folder {str(where.parent)!r}"
        raise BadInput(missing, where=str(where), nearest=closest(where.name, others))
    try:
        with where.open("rb") as raw:
            start = raw.read(8)
        if start != HDF5_SIGNATURE:
            problem = "is empty" if not start else "is not an HDF5 file"
            raise BadInput(
                problem, where=str(where), allowed="a saf-gen stream", hint="use saf-gen import for other files"
            )
        with ExitStack() as undo:
            stream = SpikeStream(where, undo.enter_context(_open_unlocked(where)), threads=threads)
            undo.pop_all()
            return stream
    except _DAMAGE as error:
        raise _damaged(where, error) from error


def check_replaceable(path: Path) -> None:
    """Raise BadInput if a stream that is written to this path would replace a link, or a file that is no stream."""
    refuse_link(path)
    if path.is_file():
        try:
            open_stream(path).close()
        except BadInput as error:
            problem = f"{path} exists, and is no saf-gen stream that can be read"
            raise BadInput(problem, hint="choose another name, or move it away") from error


def _open_unlocked(path: Path) -> h5py.File:
    """Return the open file, without HDF5's lock if that is refused: a finished stream never changes in place.

    Another program may hold a lock, and some shared disks grant none. The first try leaves a file that is already open
    in this process with its own locking, which HDF5 does not mix.
    """
    try:
        return h5py.File(path, "r")
    except OSError as error:
        if "lock" not in str(error):
            raise
        return h5py.File(path, "r", locking=False)


UNREADABLE = frozenset(
    {errno.EACCES, errno.EPERM, errno.EMFILE, errno.ENFILE, errno.EIO, errno.ESTALE, errno.EAGAIN, errno.ETIMEDOUT}
)
"""Error numbers that speak of the disk or of permissions; the stream may well be sound."""
_DAMAGE = (DamagedChunk, OSError, RuntimeError, KeyError, ValueError, TypeError, AttributeError)
"""Exceptions that h5py raises for damaged files, depending on where the damage is."""


def _damaged(path: Path, error: Exception) -> BadInput:
    if isinstance(error, OSError) and error.errno in UNREADABLE:
        return BadInput(f"cannot be read: {os.strerror(error.errno)}", where=str(path))
    reason = os.strerror(error.errno) if isinstance(error, OSError) and error.errno else str(error)
    return BadInput(f"is truncated, damaged or cannot be read: {reason}", where=str(path), hint="make it again")


class SpikeStream:
    """An open stream file, as :func:`open_stream` returns it; only one thread at a time may use it.

    Frame t is the readout [t, t+1)/readout_hz, unless ``metadata.readout`` says that readouts were lost. If the stream
    has a mask of bad pixels, :meth:`counts`, :meth:`counts_of_windows` and :meth:`texture` fill them from their nearest
    valid pixels; :meth:`frames` and :meth:`packed` return what was recorded. A region is a pair of slices (rows,
    columns) of step 1 within the frame. Spikes that were read stay in memory, up to 512 MiB for all open streams
    together.

    A stream can be passed to other processes: it is pickled as its path, which is opened again on unpickling. In a
    forked process, a stream opens its file again when it is first used.

    Attributes
    ----------
    path : Path
        The file.
    shape : tuple of int
        (T, H, W): frames, rows and columns.
    readout_hz : float
        Readouts per second.
    content_sha256 : str
        Digest of the content as stored; :meth:`verify` compares it with the content.
    metadata : Metadata
        Everything in the file except the spikes.
    truth : Truth
        The true focus, from ``metadata``.
    focus_position : ndarray of float32, shape (T,), or None
        Position of the lens in each frame, from ``metadata``.
    gain : ndarray of float32, shape (T, G), or None
        Gain of each light group in each frame, from ``metadata``.
    light_names : tuple of str
        Names of the light groups, from ``metadata``.
    form : str
        ``bits``.
    counted : str
        What a 1 stands for: ``spikes``, ``photons``, or another kind, from ``metadata``.
    """

    form: ClassVar[str] = "bits"

    def __init__(self, path: Path, file: h5py.File, *, threads: int | None = None) -> None:
        self.path, self._file, self._threads, self._process = path, file, threads, os.getpid()
        where = str(path)
        foreign = BadInput("is HDF5, but not a saf-gen stream", where=where, allowed=f"attribute format = {FORMAT!r}")
        if "format" not in file.attrs:
            raise foreign
        for kind in ("events", "frames"):
            if holds(file, kind):
                raise BadInput(
                    f"holds {kind}, not spikes", where=where, allowed="a recording of spikes or photons",
                    hint=f"saf-gen inspect describes it, and saf_gen.open_{kind} reads it",
                )  # fmt: skip
        if (layout := read_attribute(file, "layout", number=True)) != LAYOUT:
            raise BadInput(f"has layout {layout}", where=where, allowed=f"layout {LAYOUT}", hint="update saf_gen")
        small = dict(read_small_datasets(file, where))  # checks all texts before any is read
        if read_attribute(file, "format") != FORMAT:
            raise foreign
        self._spikes = open_spikes(file, where)
        rows, columns, length = self._spikes.shape
        frames, hz = (read_attribute(self._spikes, name) for name in ("frames", "readout_hz"))
        if None in (frames, hz) or not (float(hz) > 0 and math.isfinite(hz)):
            raise BadInput("/spikes does not state frames and readout_hz", where=where, hint="make it again")
        frames, self.readout_hz = int(frames), float(hz)
        self.content_sha256 = str(read_attribute(file, "content_sha256"))
        self.metadata = metadata_from_datasets(small, (frames, rows, columns), form=self.form)
        if length != -(-frames // 8) or frames < 1:
            raise BadInput(
                f"/spikes is {self._spikes.dtype} {self._spikes.shape} for {frames} frames",
                where=where,
                allowed="uint8 (H, W, ceil(T/8))",
            )
        self.shape = (frames, rows, columns)
        if (spikes := read_attribute(file, "spikes_sha256")) is not None:  # older streams have no such attribute
            self._check_digests(small.items(), str(spikes))
        self.truth, self.focus_position = self.metadata.truth, self.metadata.focus_position
        self.counted = self.metadata.kind
        self.gain, self.light_names = self.metadata.gain, self.metadata.light_names
        self._mask = None if self.metadata.mask is None else PixelMask(self.metadata.mask)
        read = choose_chunk_reader(self._spikes)
        self._time_blocks = time_blocks.TimeBlocks(self._spikes.shape, read=read, count=threads)

    def __reduce__(self) -> tuple[Callable[[str], "SpikeStream"], tuple[str]]:
        return partial(open_stream, threads=self._threads), (str(self.path),)

    def _reopen_after_fork(self) -> None:
        """Open the file again after a fork, because the file and threads of the parent process cannot be used."""
        if self._process != os.getpid() and self._file:
            self.__dict__.update(open_stream(self.path, threads=self._threads).__dict__)

    def __repr__(self) -> str:
        frames, rows, columns = self.shape
        focus = f"true focus {self.truth.position:.3f}" if self.truth.known else "true focus unknown"
        state = "" if self._file else ", closed"
        size = f"{plural(frames, 'frame')} of {columns}×{rows} at {self.readout_hz:g} Hz"
        return f"<SpikeStream {self.path.name}: {size}, {focus}{state}>"

    def _repr_html_(self) -> str | None:
        """Return HTML with pictures and facts; None if the stream is closed, so that a notebook shows its repr."""
        from saf_gen.stream.pictures.image_strip import stream_html

        return stream_html(self) if self._file else None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file and free the memory of the spikes that were read."""
        self._time_blocks.close()
        self._file.close()

    def frames(self, first: int, stop: int, *, region: Region | None = None) -> np.ndarray:
        """Return frames ``first <= t < stop`` as they were recorded, in which 1 is a spike.

        Parameters
        ----------
        first, stop : int
            The window, in frames from 0.
        region : tuple of slice, optional
            Rows and columns to read; by default the whole frame.

        Returns
        -------
        ndarray of uint8, shape (stop - first, h, w)
            Values 0 and 1, for the h rows and w columns of the region.

        Raises
        ------
        BadInput
            If not 0 <= first < stop <= T, if the region is empty or leaves the frame, or if the file is damaged.
        """
        window, part = self._validated(first, stop, region=region)
        out = np.empty((len(window), *region_shape(part)), np.uint8)
        for start, low, high in self._time_blocks.split_frames(window.start, window.stop):
            begin = 8 * start + low - window.start
            bits.unpack_bits(self._planes(start, part), out[begin : begin + high - low], first=low)
        return out

    def counts(self, first: int, stop: int, *, region: Region | None = None, filled: bool = True) -> np.ndarray:
        """Return the number of spikes of each pixel in frames ``first <= t < stop``; masked pixels are filled.

        Parameters
        ----------
        first, stop : int
            The window, in frames from 0.
        region : tuple of slice, optional
            Rows and columns to count; by default the whole frame.
        filled : bool, default True
            Whether a masked pixel gets the mean of its nearest valid pixels instead of its own spikes.

        Returns
        -------
        ndarray of uint32, shape (h, w)
            Spikes per pixel, 0 to stop - first.

        Raises
        ------
        BadInput
            If not 0 <= first < stop <= T, if the region is empty or leaves the frame, or if the file is damaged.
        """
        window, part = self._validated(first, stop, region=region)
        filling = self.filling(part) if filled else Filling(None, part)
        out = np.zeros(region_shape(filling.region), np.uint32)
        for start, low, high in self._time_blocks.split_frames(window.start, window.stop):
            bits.sum_planes(self._planes(start, filling.region), out, first=low, stop=high)
        return filling.apply(out)

    def texture(self, first: int, stop: int, *, region: Region | None = None) -> np.ndarray:
        """Return the texture from intervals of frames ``first <= t < stop``; masked pixels are filled.

        Parameters
        ----------
        first, stop : int
            The window of n frames, in frames from 0.
        region : tuple of slice, optional
            Rows and columns; by default the whole frame.

        Returns
        -------
        ndarray of float64, shape (h, w)
            Spikes per window at the rate in its middle, 0 to n; see
            :func:`saf_gen.stream.interval_texture.window_texture`.

        Raises
        ------
        BadInput
            If not 0 <= first < stop <= T, if the region is empty or leaves the frame, or if the file is damaged.
        """
        window, part = self._validated(first, stop, region=region)
        filling = self.filling(part)
        read = partial(self.packed, region=filling.region)
        count = partial(self.counts, region=filling.region, filled=False)
        return filling.apply(window_texture(read, count, first=window.start, stop=window.stop))

    def filling(self, region: Region | None = None) -> Filling:
        """Return what fills the masked pixels of a region, for counts that are added up before they are filled."""
        part = validate_region(region, self.shape[1:], where=str(self.path))
        return Filling(None, part) if self._mask is None else self._mask.filling(part)

    def counts_of_windows(
        self, firsts: Sequence[int] | np.ndarray, window: int, *, region: Region | None = None
    ) -> Iterator[np.ndarray]:
        """Return an iterator over the spike counts of many windows, several at a time; masked pixels are filled.

        Each part of the stream is decompressed only once and does not stay in memory, so that each of many windows
        costs a fraction of a call of :meth:`counts`.

        Parameters
        ----------
        firsts : sequence of int
            First frame of each window, in ascending order.
        window : int
            Frames per window: window k is the frames ``firsts[k] <= t < firsts[k] + window``.
        region : tuple of slice, optional
            Rows and columns to count; by default the whole frame.

        Yields
        ------
        ndarray of unsigned int, shape (n, h, w)
            Spikes per pixel of the next n windows, in the smallest type that can hold ``window``.

        Raises
        ------
        BadInput
            If ``firsts`` is empty, not of whole numbers or not in ascending order, if a window leaves the recording,
            if the region is empty or leaves the frame, or if the file is damaged.
        """
        begins = np.asarray(firsts)
        if begins.ndim != 1 or begins.dtype.kind not in "iu" or not begins.size or (begins[1:] < begins[:-1]).any():
            raise BadInput(
                f"windows begin at {firsts!r:.60}", where=str(self.path), allowed="whole numbers in ascending order"
            )
        _, part = self._validated(int(begins[0]), int(begins[0]) + window, region=region)
        self._validated(int(begins[-1]), int(begins[-1]) + window, region=region)
        return self._count_windows(begins.astype(np.int64), window, region=part)

    def _count_windows(self, firsts: np.ndarray, window: int, *, region: Region) -> Iterator[np.ndarray]:
        filling = self.filling(region)
        with self._report_damage():
            for counts in count_windows(self._time_blocks, firsts, window=window, region=filling.region):
                yield filling.apply(counts)

    def packed(self, first_byte: int, stop_byte: int, *, region: Region | None = None) -> np.ndarray:
        """Return packed spikes as they were recorded, bytes ``first_byte <= i < stop_byte`` along time.

        Parameters
        ----------
        first_byte, stop_byte : int
            The window, in bytes from 0. Frame t is bit t mod 8, least significant first, of byte t div 8.
        region : tuple of slice, optional
            Rows and columns to read; by default the whole frame.

        Returns
        -------
        ndarray of uint8, shape (h, w, stop_byte - first_byte)
            The packed spikes of the region.

        Raises
        ------
        BadInput
            If not 0 <= first_byte < stop_byte <= ceil(T/8), if the region is empty or leaves the frame, or if the file
            is damaged.
        """
        self._reopen_after_fork()
        total = self._spikes.shape[2]
        window = validate_window(first_byte, stop_byte, total=total, what="bytes", where=str(self.path))
        part = validate_region(region, self.shape[1:], where=str(self.path))
        with self._report_damage():
            return self._time_blocks.packed(window.start, window.stop, region=part)

    def blur(self, frame: int) -> np.ndarray:
        """Return the blur of every pixel at a frame, by the law of the thin lens, with its sign.

        It is the diameter of the circle of confusion of what the pixel shows, without aberrations and waves. It is
        positive where that lies behind the plane in focus, and negative in front of it.

        Parameters
        ----------
        frame : int
            The frame, from 0; the lens is where it is in the middle of its readout.

        Returns
        -------
        ndarray of float32, shape (H, W)
            Signed diameter in pixels; -inf at the lens and behind it.

        Raises
        ------
        BadInput
            If there is no such frame, if the stream lacks ``truth.depth``, the positions of its lens, or its aperture
            and pixel pitch, or if its scene moves, so that its depth is that of one moment.
        """
        from saf_gen.stream.defocus_blur import blur_at

        return blur_at(self, frame)

    def verify(self) -> None:
        """Read the whole file and compare it with its digests.

        Raises
        ------
        BadInput
            If the content does not match ``content_sha256``, if the provenance does not match its digest, or if the
            file is damaged.
        """
        self._reopen_after_fork()
        sha = hashlib.sha256()
        for start in range(0, self._spikes.shape[2], self._time_blocks.chunk[2]):
            with self._report_damage():
                for block in self._time_blocks.row_bands(start):
                    sha.update(block.data)
        self._check_digests(read_small_datasets(self._file, str(self.path)), sha.hexdigest())

    def _check_digests(self, datasets: Iterable[tuple[str, Any]], spikes: str) -> None:
        """Raise BadInput unless the small datasets, and spikes with this SHA-256, match the stored digests."""
        shape, hz, frames = self._spikes.shape, self.readout_hz, self.shape[0]
        found = stream_digests(datasets, shape, spikes=spikes, readout_hz=hz, frames=frames)
        stored = self.content_sha256, read_attribute(self._file, "provenance_sha256")
        for what, digest, stored_digest in zip(("content", "provenance"), found, stored, strict=True):
            if stored_digest not in (digest, None):
                raise BadInput(
                    f"the {what} has SHA-256 {digest[:12]}...",
                    where=str(self.path),
                    allowed=f"{stored_digest!s:.12}... as stored",
                    hint="the file was changed or damaged: make it again",
                )

    def _validated(self, first: int, stop: int, *, region: Region | None) -> tuple[range, Region]:
        self._reopen_after_fork()
        where = str(self.path)
        return validate_window(first, stop, total=self.shape[0], where=where), validate_region(
            region, self.shape[1:], where=where
        )

    def _planes(self, start: int, region: Region) -> np.ndarray:
        with self._report_damage():
            return self._time_blocks.planes(start, region[0])[:, region[0], region[1]]

    @contextmanager
    def _report_damage(self) -> Iterator[None]:
        try:
            yield
        except _DAMAGE as error:
            raise _damaged(self.path, error) from error


ChunkReader = Callable[[int, int], bytes | np.ndarray]


def choose_chunk_reader(spikes: h5py.Dataset) -> ChunkReader:
    """Return a function that reads the chunk of ``spikes`` at (row, byte): deflated bytes, or the inflated array."""
    read = _read_standard_chunk if _has_standard_chunks(spikes) else _read_any_chunk
    return lambda row, byte: read(spikes, (row, 0, byte))


def _has_standard_chunks(spikes: h5py.Dataset) -> bool:
    """Return whether chunks can be read as stored: of the standard shape, with deflate only, and none missing."""
    chunk = chunk_shape(spikes.shape)
    grid = math.prod(-(-n // c) for n, c in zip(spikes.shape, chunk, strict=True))
    filters = spikes.id.get_create_plist()
    return (
        spikes.chunks == chunk
        and filters.get_nfilters() == 1
        and filters.get_filter(0)[0] == h5py.h5z.FILTER_DEFLATE
        and spikes.id.get_num_chunks() == grid
    )


def _read_standard_chunk(spikes: h5py.Dataset, origin: tuple[int, int, int]) -> bytes | np.ndarray:
    skipped, data = spikes.id.read_direct_chunk(origin)
    # HDF5 itself skips the filter if deflate would make a chunk larger.
    return np.frombuffer(data, np.uint8).reshape(spikes.chunks) if skipped else data


def _read_any_chunk(spikes: h5py.Dataset, origin: tuple[int, int, int]) -> np.ndarray:
    """Return a chunk of the standard shape from a file of other software, which has chunks of any shape or none."""
    ends = zip(origin, chunk_shape(spikes.shape), spikes.shape, strict=True)
    window = [slice(first, min(first + size, total)) for first, size, total in ends]
    if (chunk := spikes.chunks) is None:
        return spikes[tuple(window)]
    out = np.full([part.stop - part.start for part in window], spikes.fillvalue, np.uint8)
    firsts = [range(part.start // size * size, part.stop, size) for part, size in zip(window, chunk, strict=True)]
    for stored in itertools.product(*firsts):
        block = _inflate_foreign_chunk(spikes, stored)
        if block is not None:
            pairs = list(zip(window, stored, chunk, strict=True))
            to = tuple(slice(max(o - w.start, 0), min(o + c, w.stop) - w.start) for w, o, c in pairs)
            of = tuple(slice(max(w.start - o, 0), min(w.stop - o, c)) for w, o, c in pairs)
            out[to] = block[of]
    return out


def _inflate_foreign_chunk(spikes: h5py.Dataset, origin: tuple[int, ...]) -> np.ndarray | None:
    """Return the stored chunk that begins at (row, column, byte), or None if it was never written."""
    stored, chunk = spikes.id.get_create_plist(), spikes.chunks
    if spikes.id.get_chunk_info_by_coord(origin).byte_offset is None:
        return None
    skipped, data = spikes.id.read_direct_chunk(origin)
    filters = [stored.get_filter(i)[0] for i in range(stored.get_nfilters())]
    deflate = h5py.h5z.FILTER_DEFLATE  # the shuffle filter leaves single bytes in their order
    if deflate in filters and not skipped >> filters.index(deflate) & 1:
        return inflate_chunk(data, chunk)
    return np.frombuffer(data, np.uint8).reshape(chunk)
