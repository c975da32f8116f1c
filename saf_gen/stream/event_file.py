"""The event file, layout version 1: one HDF5 file per sequence and event camera, beside the truth of the sequence.

``/events/x`` and ``/events/y`` (uint16), ``/events/t`` (uint32, microseconds) and ``/events/p`` (uint8, 1 for a rise of
the light) are the columns of the events in the order in which they were read. ``/ms_to_idx`` (uint64) holds, for each
millisecond, the index of the first event at or after it, and ``/t_offset`` (int64) is 0: the layout of DSEC (M. Gehrig
et al., IEEE Robotics and Automation Letters 6, 2021, doi:10.1109/LRA.2021.3068942), whose readers take it. Everything
else is as in a stream file (:mod:`saf_gen.stream.stream_file`): focus, light, truth and provenance, with T readouts of
the spike camera as their frames.
"""

import hashlib
import os
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self

import h5py
import numpy as np

from saf_gen.core.files import atomic_file, refuse_link, unwritable
from saf_gen.errors import BadInput
from saf_gen.stream.checked_file import CheckedFile, holds, open_dataset, read_attribute, report_damage
from saf_gen.stream.full_disk import new_hdf5
from saf_gen.stream.metadata import Metadata, metadata_to_datasets, stream_digest_lines

FORMAT, LAYOUT = "saf-gen recapture", 1
COLUMNS = {"x": "uint16", "y": "uint16", "t": "uint32", "p": "uint8"}
CHUNK = 1 << 16
FINGERPRINT = "events_fingerprint"
"""Name of the text in the provenance that says from what the events were made."""
TICKS_PER_MS = 1000
LONGEST_S = 4000.0  # what a time in microseconds can say in 32 bits


class EventColumns(NamedTuple):
    """Events of a time in the order in which they were read: columns, rows, microseconds and polarities, (n,) each."""

    x: np.ndarray
    y: np.ndarray
    t: np.ndarray
    p: np.ndarray


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
        if shape[0] / readout_hz > LONGEST_S:
            raise BadInput(f"the recording lasts {shape[0] / readout_hz:g} s", allowed=f"at most {LONGEST_S:,g} s")
        self._datasets = metadata_to_datasets(metadata.without_sharp(), shape)
        self._hashes = {name: hashlib.sha256() for name in COLUMNS}
        self._index: list[np.ndarray] = []
        self._next_ms = self._last = 0

    def __enter__(self) -> Self:
        self._atomic = atomic_file(self.path)
        self._new = new_hdf5(self._atomic.__enter__())
        self._file, self._disk = self._new.__enter__()
        for name, dtype in COLUMNS.items():
            self._file.create_dataset(
                f"events/{name}", (0,), dtype, maxshape=(None,), chunks=(CHUNK,), compression="gzip",
                compression_opts=1, shuffle=True,
            )  # fmt: skip
        for name, value in self._datasets.items():
            text = isinstance(value, str | tuple)
            self._file.create_dataset(name, data=value, dtype=h5py.string_dtype() if text else None)
        return self

    def write(self, events: EventColumns) -> None:
        """Append events, whose times do not fall and begin at or after the last one.

        Raises BadInput if they do not, or if the disk is full.
        """
        t = np.asarray(events.t)
        if t.size == 0:
            return
        if (np.diff(t) < 0).any() or t[0] < self._last:
            raise BadInput(
                "the times of events fall", where=str(self.path), allowed="events in the order of their times"
            )
        until = int(t[-1]) // TICKS_PER_MS + 1
        starts = np.searchsorted(t, np.arange(self._next_ms, until) * TICKS_PER_MS) + self.count
        self._index.append(starts.astype(np.uint64))
        self._next_ms, self._last = until, int(t[-1])
        for name, dtype in COLUMNS.items():
            column = np.ascontiguousarray(getattr(events, name), dtype=dtype)
            stored = self._file[f"events/{name}"]
            stored.resize((self.count + t.size,))
            stored[self.count :] = column
            self._hashes[name].update(column.tobytes())
        self.count += t.size
        try:
            self._disk.check()
        except OSError as full:
            raise unwritable(self.path, full) from full

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            milliseconds = int(np.ceil(self.shape[0] / self.readout_hz * 1e3)) + 1
            rest = np.full(max(milliseconds - self._next_ms, 0), self.count, np.uint64)
            index = np.concatenate([*self._index, rest])
            self._file.create_dataset("ms_to_idx", data=index)
            self._file.create_dataset("t_offset", data=np.int64(0))
            digests = {name: digest.hexdigest() for name, digest in self._hashes.items()}
            self.content_sha256 = _content_digest(
                self._datasets, digests, count=self.count, shape=self.shape, readout_hz=self.readout_hz
            )
            self._file.attrs.update(
                format=FORMAT, layout=LAYOUT, content_sha256=self.content_sha256, readout_hz=self.readout_hz,
                frames=self.shape[0], rows=self.shape[1], columns=self.shape[2],
            )  # fmt: skip
        try:
            self._new.__exit__(kind, error, trace)
        except OSError as full:  # the last of it did not fit
            self._atomic.__exit__(type(full), full, full.__traceback__)
            raise
        self._atomic.__exit__(kind, error, trace)


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
    """

    path: Path

    def __init__(self, path: Path) -> None:
        with report_damage(path):
            self._open(path, holding="events", form=(FORMAT, LAYOUT), bulk=("events", "ms_to_idx", "t_offset"))
            self._read_events(str(path))

    def _read_events(self, where: str) -> None:
        for name in (*(f"events/{column}" for column in COLUMNS), "ms_to_idx", "t_offset"):
            if name not in self._file:
                raise BadInput(f"has no /{name}", where=where, hint="record it again, or copy it again")
        numbers = [
            read_attribute(self._file, name, number=True) for name in ("frames", "rows", "columns", "readout_hz")
        ]
        if not all(isinstance(n, np.integer | np.floating) and n > 0 for n in numbers):
            raise BadInput("it does not say its size", where=where, hint="make it again")
        frames, rows, columns, self.readout_hz = (*map(int, numbers[:3]), float(numbers[3]))
        self.shape = frames, rows, columns
        self.seconds = frames / self.readout_hz
        self._columns = {name: open_dataset(self._file, f"events/{name}", where=where, bulk=True) for name in COLUMNS}
        self.count = len(self._columns["t"])
        for name, dtype in COLUMNS.items():
            if self._columns[name].dtype != dtype or self._columns[name].shape != (self.count,):
                raise BadInput(f"/events/{name} is not {dtype} ({self.count},)", where=where, hint="make it again")
        if (offset := open_dataset(self._file, "t_offset", where=where)[()]) != 0:
            raise BadInput(f"/t_offset is {offset}", where=where, allowed="0")
        self._index = open_dataset(self._file, "ms_to_idx", where=where, bulk=True)[:]
        self._read_metadata()

    def __repr__(self) -> str:
        _, rows, columns = self.shape
        return f"<EventFile {self.path.name}: {self.count:,} events of {columns}×{rows} in {self.seconds:g} s>"

    def events(self, first_s: float, stop_s: float) -> EventColumns:
        """Return the events ``first_s <= t < stop_s``, in seconds, in the order in which they were read.

        Raises BadInput if not 0 <= first_s < stop_s <= the length of the recording, to a millisecond.
        """
        if not 0 <= first_s < stop_s <= self.seconds + 1e-3:
            raise BadInput(
                f"events of {first_s:g} to {stop_s:g} s",
                where=str(self.path),
                allowed=f"0 <= first < stop <= {self.seconds:g}",
            )
        first, stop = round(first_s * 1e6), round(stop_s * 1e6)
        low, high = self._near(first // TICKS_PER_MS), self._near(-(-stop // TICKS_PER_MS))
        with report_damage(self.path):
            t = self._columns["t"][low:high]
            begin, end = low + np.searchsorted(t, [first, stop])
            return EventColumns(*(self._columns[name][begin:end] for name in EventColumns._fields))

    def _near(self, ms: int) -> int:
        return int(self._index[ms]) if ms < len(self._index) else self.count

    def counts(self, first_s: float, stop_s: float) -> np.ndarray:
        """Return the number of events of each pixel in ``first_s <= t < stop_s``, uint32 (H, W)."""
        total: np.ndarray = self.polarities(first_s, stop_s).sum(axis=0, dtype=np.uint32)
        return total

    def polarities(self, first_s: float, stop_s: float) -> np.ndarray:
        """Return the events of each pixel in ``first_s <= t < stop_s``, uint32 (2, H, W): falls, then rises.

        Raises what :meth:`events` raises.
        """
        held = self.events(first_s, stop_s)
        _, rows, columns = self.shape
        cell = ((held.p > 0) * np.int64(rows) + held.y) * columns + held.x
        return np.bincount(cell, minlength=2 * rows * columns).astype(np.uint32).reshape(2, rows, columns)

    def counts_of_ms(self) -> np.ndarray:
        """Return the number of events in each millisecond, int64 (n,)."""
        return np.diff(np.append(self._index, np.uint64(self.count)).astype(np.int64))

    def rises(self) -> int:
        """Return the number of events that are rises of the light."""
        step = 16 * CHUNK
        return sum(int(self._columns["p"][k : k + step].sum()) for k in range(0, self.count, step))

    def verify(self) -> None:
        """Read the whole file; raise BadInput if its content does not match its digest, or its index its times."""
        hashes = {name: hashlib.sha256() for name in COLUMNS}
        with report_damage(self.path):
            for begin in range(0, self.count, CHUNK * 16):
                for name in COLUMNS:
                    hashes[name].update(self._columns[name][begin : begin + CHUNK * 16].tobytes())
        digests = {name: digest.hexdigest() for name, digest in hashes.items()}
        found = _content_digest(self._small, digests, count=self.count, shape=self.shape, readout_hz=self.readout_hz)
        self._check_content(found)
        t = self._columns["t"][:]
        if not np.array_equal(np.searchsorted(t, np.arange(len(self._index)) * TICKS_PER_MS), self._index):
            raise BadInput(
                "its index of milliseconds does not fit its events", where=str(self.path), hint="make it again"
            )


def _content_digest(
    small: Mapping[str, Any], columns: Mapping[str, str], *, count: int, shape: tuple[int, int, int], readout_hz: float
) -> str:
    """Return ``content_sha256``: over the columns and all datasets but the provenance."""
    lines = [line for line in stream_digest_lines(small.items()) if not line.startswith("/provenance/")]
    lines += [f"/events/{name} {COLUMNS[name]} {count} {digest}" for name, digest in columns.items()]
    size = f"size {'x'.join(map(str, shape))}"
    return hashlib.sha256("\n".join([size, f"readout_hz {readout_hz!r}", *sorted(lines)]).encode()).hexdigest()


def check_replaceable(path: Path) -> None:
    """Raise BadInput if an output would replace a link, or something that is not an event file."""
    refuse_link(path)
    if path.exists():
        with open_events(path):
            pass


def intact_digest(path: Path, fingerprint: str) -> str | None:
    """Return the digest of an event file if it was made from what has this fingerprint and is intact, else None."""
    try:
        with open_events(path) as events:
            if events.metadata.provenance.get(FINGERPRINT) != fingerprint:
                return None
            events.verify()
            return events.content_sha256
    except BadInput:
        return None
