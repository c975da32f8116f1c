"""The event file, layout version 1: one HDF5 file per sequence and event camera, beside the truth of the sequence.

``/events/x`` and ``/events/y`` (uint16), ``/events/t`` (uint32, microseconds) and ``/events/p`` (uint8, 1 for a rise of
the light) are the columns of the events in the order in which they were read, all before the end of the recording.
``/ms_to_idx`` (uint64) holds, for each millisecond up to the first that is not before this end, the index of the first
event at or after it, so that it ends with the number of events, and ``/t_offset`` (int64) is 0: the layout of DSEC (M.
Gehrig et al., IEEE Robotics and Automation Letters 6, 2021, doi:10.1109/LRA.2021.3068942), whose readers take it.
Everything else is as in a stream file (:mod:`saf_gen.stream.stream_file`): focus, light, truth and provenance, with T
readouts of the spike camera as their frames.
"""

import hashlib
import os
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any, ClassVar, NamedTuple, Protocol, Self

import h5py
import numpy as np

from saf_gen.core.files import atomic_file, unwritable
from saf_gen.errors import BadInput
from saf_gen.stream.checked_file import (
    CheckedFile,
    check_deflated,
    check_stored,
    holds,
    open_dataset,
    read_attribute,
    report_damage,
)
from saf_gen.stream.full_disk import new_hdf5
from saf_gen.stream.metadata import MAX_PIXELS, Metadata, metadata_to_datasets, stream_digest_lines

FORMAT, LAYOUT = "saf-gen recapture", 1
COLUMNS = {"x": "uint16", "y": "uint16", "t": "uint32", "p": "uint8"}
CHUNK = 1 << 16
BLOCK = 16 * CHUNK  # events that are read at a time
TICKS_PER_MS = 1000
LONGEST_S = 4000.0  # what a time in microseconds can say in 32 bits
BUS_FULL = "bus_full_s"
"""Name of the text in the provenance that says for how many seconds events waited for the readout."""


class EventColumns(NamedTuple):
    """Events of a time in the order in which they were read: columns, rows, microseconds and polarities, (n,) each."""

    x: np.ndarray
    y: np.ndarray
    t: np.ndarray
    p: np.ndarray


class ColumnsOfEvents(Protocol):
    """What has the columns of events, such as :class:`EventColumns`, whatever their order."""

    @property
    def x(self) -> np.ndarray: ...

    @property
    def y(self) -> np.ndarray: ...

    @property
    def t(self) -> np.ndarray: ...

    @property
    def p(self) -> np.ndarray: ...


class EventWriter:
    """A context manager that writes an event file in pieces; its use of memory does not grow with the events.

    It writes to a temporary file next to ``path``, which takes its name on a clean exit, when ``content_sha256`` is
    set.

    Parameters
    ----------
    path : str or Path
        File to write.
    shape : tuple of int
        (T, H, W): readouts of the logs of lens and light, rows and columns.
    readout_hz : float
        Readouts per second of these logs.
    metadata : Metadata
        Everything that the file holds except the events.

    Attributes
    ----------
    notes : dict of str to str
        Texts by name that are known at the end, for the provenance; to be set before it.

    Raises
    ------
    BadInput
        If a field of the metadata is not allowed, the recording is longer than 4,000 s, or the folder cannot be
        written.
    """

    def __init__(
        self, path: str | os.PathLike[str], *, shape: tuple[int, int, int], readout_hz: float, metadata: Metadata
    ) -> None:
        self.path, self.shape, self.readout_hz = Path(path), shape, float(readout_hz)
        self.content_sha256, self.count = "", 0
        self.notes: dict[str, str] = {}
        if shape[0] / readout_hz > LONGEST_S:
            raise BadInput(f"the recording lasts {shape[0] / readout_hz:g} s", allowed=f"at most {LONGEST_S:,g} s")
        self._datasets = metadata_to_datasets(metadata, shape)
        self._hashes = {name: hashlib.sha256() for name in COLUMNS}
        self._index: list[np.ndarray] = []
        self._waiting: list[dict[str, np.ndarray]] = []
        self._end, self._milliseconds = _end(shape[0], self.readout_hz), _index_length(shape[0], self.readout_hz)
        self._next_ms = self._last = self._stored = 0

    def __enter__(self) -> Self:
        with ExitStack() as undo:
            part = undo.enter_context(atomic_file(self.path))
            self._file, self._disk = undo.enter_context(new_hdf5(part))
            self._columns = {
                name: self._file.create_dataset(
                    f"events/{name}", (0,), dtype, maxshape=(None,), chunks=(CHUNK,), compression="gzip",
                    compression_opts=1, shuffle=True,
                )
                for name, dtype in COLUMNS.items()
            }  # fmt: skip
            for name, value in self._datasets.items():
                text = isinstance(value, str | tuple)
                self._file.create_dataset(name, data=value, dtype=h5py.string_dtype() if text else None)
            self._disk.check()
            self._undo = undo.pop_all()
        return self

    @property
    def size(self) -> str:
        """How many events there are, in words."""
        return f"{self.count:,} events"

    def write(self, events: ColumnsOfEvents) -> None:
        """Append events, whose times do not fall and begin at or after the last one.

        Raises BadInput if they do not, if they are not before the end of the recording, or if the disk is full.
        """
        t = np.asarray(events.t)
        if t.size == 0:
            return
        if t[0] < self._last or (t[1:] < t[:-1]).any():
            raise BadInput(
                "the times of events fall", where=str(self.path), allowed="events in the order of their times"
            )
        if t[-1] >= self._end:
            raise BadInput(
                f"an event was read after {t[-1]:,} µs", where=str(self.path),
                allowed=f"events before the end of the recording, {self._end:,} µs",
            )  # fmt: skip
        until = int(t[-1]) // TICKS_PER_MS + 1
        starts = np.searchsorted(t, np.arange(self._next_ms, until) * TICKS_PER_MS) + self.count
        self._index.append(starts.astype(np.uint64))
        self._next_ms, self._last = until, int(t[-1])
        self._waiting.append({name: np.array(getattr(events, name), dtype) for name, dtype in COLUMNS.items()})
        self.count += t.size
        try:
            self._store(self.count // CHUNK * CHUNK)
            self._disk.check()
        except OSError as full:
            raise unwritable(self.path, full) from full

    def _store(self, stop: int) -> None:
        """Write the waiting events before number ``stop``.

        Before the end, only whole chunks are written: HDF5 reads a chunk to which something is added, and on a full
        disk it would read what was never written.
        """
        if stop == self._stored:
            return
        left = {}
        for name, column in self._columns.items():
            waiting = np.concatenate([part[name] for part in self._waiting])
            new, left[name] = np.split(waiting, [stop - self._stored])
            column.resize((stop,))
            column[self._stored :] = new
            self._hashes[name].update(new.tobytes())
        self._stored, self._waiting = stop, [left]

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is not None:
            self._undo.__exit__(kind, error, trace)
            return
        with self._undo:
            self._store(self.count)
            self._disk.check()
            rest = np.full(self._milliseconds - self._next_ms, self.count, np.uint64)
            self._file.create_dataset("ms_to_idx", data=np.concatenate([*self._index, rest]))
            self._file.create_dataset("t_offset", data=np.int64(0))
            for name, text in self.notes.items():
                self._file.create_dataset(f"provenance/{name}", data=text, dtype=h5py.string_dtype())
            digests = {name: digest.hexdigest() for name, digest in self._hashes.items()}
            self.content_sha256 = _content_digest(
                self._datasets, digests, count=self.count, shape=self.shape, readout_hz=self.readout_hz
            )
            self._file.attrs.update(
                format=FORMAT, layout=LAYOUT, content_sha256=self.content_sha256, readout_hz=self.readout_hz,
                frames=self.shape[0], rows=self.shape[1], columns=self.shape[2],
            )  # fmt: skip


def _end(frames: int, readout_hz: float) -> int:
    """Return the microsecond at which a recording ends."""
    return round(frames / readout_hz * 1e6)


def _index_length(frames: int, readout_hz: float) -> int:
    """Return the number of milliseconds of ``/ms_to_idx``, of which the last is not before the end."""
    return -(-_end(frames, readout_hz) // TICKS_PER_MS) + 1


def has_events(path: str | os.PathLike[str]) -> bool:
    """Return whether a file on a disk is HDF5 that holds events, ours or others'."""
    if not (Path(path).is_file() and h5py.is_hdf5(path)):
        return False
    try:
        with h5py.File(path, "r") as file:
            return holds(file, "events")
    except OSError:
        return False


def open_events(path: str | os.PathLike[str]) -> "EventFile":
    """Open an event file for reading, preferably in a ``with`` statement.

    Raises BadInput if the file is missing, damaged, not an event file, or of another layout version.
    """
    return EventFile(Path(path))


class EventFile(CheckedFile):
    """An open event file.

    Attributes
    ----------
    path : Path
        The file.
    shape : tuple of int
        (T, H, W): readouts of the logs of lens and light, rows and columns of the camera.
    readout_hz : float
        Readouts per second of these logs.
    seconds : float
        Length of the recording.
    count : int
        Number of events.
    metadata : Metadata
        Lens, light and truth, as in a stream file; ``truth``, ``focus_position``, ``gain`` and ``light_names`` are its.
    content_sha256 : str
        Digest of the content.
    bus_full_s : float or None
        For how many seconds events waited for the readout, by more than a microsecond, if the file says so.
    """

    form: ClassVar[str] = "events"
    path: Path

    def __init__(self, path: Path) -> None:
        with report_damage(path):
            names = *(f"events/{name}" for name in COLUMNS), "ms_to_idx", "t_offset"
            self._open(path, holding="events", form=(FORMAT, LAYOUT), bulk=names)
            if missing := [name for name in names if not holds(self._file, name)]:
                raise BadInput(f"has no /{missing[0]}", where=str(path), hint="record it again, or copy it again")
            self._read_size(str(path))
            self._read_columns(str(path))
            self._index = self._read_index(str(path))
            self._read_metadata()
        self.bus_full_s = self._read_bus(str(path))

    def _read_size(self, where: str) -> None:
        frames, rows, columns = (
            read_attribute(self._file, name, number=True) for name in ("frames", "rows", "columns")
        )
        hz = read_attribute(self._file, "readout_hz", number=True)
        if not (all(isinstance(n, np.integer) and n > 0 for n in (frames, rows, columns)) and hz and 0 < hz < np.inf):
            raise BadInput("it does not say its size", where=where, hint="make it again")
        self.shape, self.readout_hz = (int(frames), int(rows), int(columns)), float(hz)
        if (pixels := self.shape[1] * self.shape[2]) > MAX_PIXELS:
            raise BadInput(f"it has {pixels:,} pixels", where=where, allowed=f"at most {MAX_PIXELS:,}")
        self.seconds = self.shape[0] / self.readout_hz
        if self.seconds > LONGEST_S:
            raise BadInput(f"it lasts {self.seconds:g} s", where=where, allowed=f"at most {LONGEST_S:,g} s")

    def _read_columns(self, where: str) -> None:
        """Open the columns; their values are checked where they are read, so that a large file opens as fast."""
        self._columns = {name: open_dataset(self._file, f"events/{name}", where=where, bulk=True) for name in COLUMNS}
        self.count = self._columns["t"].size
        for name, dtype in COLUMNS.items():
            stored = self._columns[name]
            if stored.dtype != dtype or stored.shape != (self.count,) or stored.chunks != (CHUNK,):
                raise BadInput(
                    f"/events/{name} is {stored.dtype} {stored.shape} in chunks of {stored.chunks}", where=where,
                    allowed=f"{dtype} ({self.count},) in chunks of ({CHUNK},)", hint="make it again",
                )  # fmt: skip
            check_stored(stored, where=where)
            check_deflated(stored, where=where)

    def _read_index(self, where: str) -> np.ndarray:
        """Return the index of milliseconds."""
        offset = open_dataset(self._file, "t_offset", where=where)
        if offset.dtype.kind not in "iu" or offset.shape != () or offset[()] != 0:
            raise BadInput("/t_offset is not 0", where=where, allowed="a whole number, 0")
        stored = open_dataset(self._file, "ms_to_idx", where=where, bulk=True)
        shape = (_index_length(self.shape[0], self.readout_hz),)
        if stored.dtype != np.uint64 or stored.shape != shape or stored.chunks:
            raise BadInput(
                f"/ms_to_idx is {stored.dtype} {stored.shape}{' in chunks' if stored.chunks else ''}", where=where,
                allowed=f"uint64 {shape} in one piece, one for each millisecond", hint="make it again",
            )  # fmt: skip
        check_stored(stored, where=where)
        index = stored[:]
        if index[0] != 0 or index[-1] != self.count or (index[1:] < index[:-1]).any():
            raise BadInput(
                "/ms_to_idx falls or leaves the events", where=where, allowed=f"from 0 up to {self.count}",
                hint="make it again",
            )  # fmt: skip
        return index.astype(np.int64)

    def _read_bus(self, where: str) -> float | None:
        """Return for how long events waited for the readout; raise BadInput if it is no part of the recording."""
        text = self.metadata.provenance.get(BUS_FULL)
        if text is None:
            return None
        try:
            full = float(text)
        except ValueError:
            full = -1.0
        if not 0 <= full <= self.seconds + 1e-6:
            raise BadInput(f"/provenance/{BUS_FULL} is {text[:20]!r}", where=where, allowed=f"0 to {self.seconds:g}")
        return full

    def __repr__(self) -> str:
        _, rows, columns = self.shape
        return f"<EventFile {self.path.name}: {self.count:,} events of {columns}×{rows} in {self.seconds:g} s>"

    def events(self, first_s: float, stop_s: float) -> EventColumns:
        """Return the events ``first_s <= t < stop_s``, in seconds, in the order in which they were read.

        Raises BadInput if not 0 <= first_s < stop_s <= the length of the recording, to a millisecond.
        """
        low, high, span = self._find(first_s, stop_s)
        return _cut(self._read(low, high), span)

    def _find(self, first_s: float, stop_s: float) -> tuple[int, int, tuple[int, int]]:
        """Return the numbers of the events of all milliseconds of a time, and the time in microseconds."""
        if not 0 <= first_s < stop_s <= self.seconds + 1e-3:
            raise BadInput(
                f"events of {first_s:g} to {stop_s:g} s",
                where=str(self.path),
                allowed=f"0 <= first < stop <= {self.seconds:g}",
            )
        span = round(first_s * 1e6), round(stop_s * 1e6)
        low, high = span[0] // TICKS_PER_MS, -(-span[1] // TICKS_PER_MS)
        last = len(self._index) - 1
        return int(self._index[min(low, last)]), int(self._index[min(high, last)]), span

    def _read(self, low: int, high: int) -> EventColumns:
        """Return events ``low <= n < high``.

        Everything that is read of the columns comes from here, and is checked here. Raises BadInput if an event is not
        of this sensor or this recording, or they are not where the index has them.
        """
        with report_damage(self.path):
            held = EventColumns(*(self._columns[name][low:high] for name in EventColumns._fields))
        if low >= high:
            return held
        where, hint, t = str(self.path), "make it again", held.t
        _, rows, columns = self.shape
        for name, column, limit in (("x", held.x, columns), ("y", held.y, rows), ("p", held.p, 2)):
            if (largest := column.max()) >= limit:
                raise BadInput(f"/events/{name} holds {largest}", where=where, allowed=f"0 to {limit - 1}", hint=hint)
        if (t[1:] < t[:-1]).any():
            raise BadInput("the times of its events fall", where=where, allowed="times in order", hint=hint)
        first, last = int(t[0]) // TICKS_PER_MS, int(t[-1]) // TICKS_PER_MS
        if t[-1] >= (end := _end(self.shape[0], self.readout_hz)):
            raise BadInput(f"/events/t holds {t[-1]}", where=where, allowed=f"0 to {end - 1}", hint=hint)
        starts = low + np.searchsorted(t, np.arange(first, last + 2) * TICKS_PER_MS)
        if not np.array_equal(self._index[first : last + 2].clip(low, high), starts):
            raise BadInput("its index of milliseconds does not fit its events", where=where, hint=hint)
        return held

    def _blocks(self, low: int, high: int) -> Iterator[EventColumns]:
        """Yield events ``low <= n < high`` in pieces of one size, so that memory does not grow with them."""
        return (self._read(begin, min(begin + BLOCK, high)) for begin in range(low, high, BLOCK))

    def counts(self, first_s: float, stop_s: float) -> np.ndarray:
        """Return the number of events of each pixel in ``first_s <= t < stop_s``, uint32 (H, W)."""
        total: np.ndarray = self.polarities(first_s, stop_s).sum(axis=0, dtype=np.uint32)
        return total

    def polarities(self, first_s: float, stop_s: float) -> np.ndarray:
        """Return the events of each pixel in ``first_s <= t < stop_s``, uint32 (2, H, W): falls, then rises.

        Raises what :meth:`events` raises.
        """
        low, high, span = self._find(first_s, stop_s)
        _, rows, columns = self.shape
        total = np.zeros(2 * rows * columns, np.uint32)
        for block in self._blocks(low, high):
            held = _cut(block, span)
            cell = ((held.p > 0) * np.int64(rows) + held.y) * columns + held.x
            total += np.bincount(cell, minlength=total.size).astype(np.uint32)
        return total.reshape(2, rows, columns)

    def counts_of_ms(self) -> np.ndarray:
        """Return the number of events in each millisecond, int64 (n,)."""
        return np.diff(self._index)

    def rises(self) -> int:
        """Return the number of events that are rises of the light; raise BadInput if an event is not possible."""
        return sum(int(held.p.sum()) for held in self._blocks(0, self.count))

    def verify(self) -> None:
        """Read the whole file; raise BadInput if its content does not match its digest, or its index its times."""
        hashes = {name: hashlib.sha256() for name in COLUMNS}
        for held in self._blocks(0, self.count):
            for name, sha in hashes.items():
                sha.update(getattr(held, name).tobytes())
        digests = {name: sha.hexdigest() for name, sha in hashes.items()}
        found = _content_digest(self._small, digests, count=self.count, shape=self.shape, readout_hz=self.readout_hz)
        self._check_content(found)


def _cut(held: EventColumns, span: tuple[int, int]) -> EventColumns:
    """Return the events of a time in microseconds."""
    begin, end = np.searchsorted(held.t, span)
    return EventColumns(*(column[begin:end] for column in held))


def _content_digest(
    small: Mapping[str, Any], columns: Mapping[str, str], *, count: int, shape: tuple[int, int, int], readout_hz: float
) -> str:
    """Return ``content_sha256``: over the columns and all datasets but the provenance."""
    lines = [line for line in stream_digest_lines(small.items()) if not line.startswith("/provenance/")]
    lines += [f"/events/{name} {COLUMNS[name]} {count} {digest}" for name, digest in columns.items()]
    size = f"size {'x'.join(map(str, shape))}"
    return hashlib.sha256("\n".join([size, f"readout_hz {readout_hz!r}", *sorted(lines)]).encode()).hexdigest()
