"""Recordings that are judged, of any kind of camera; events are counted over readouts of the lens and light logs."""

from pathlib import Path
from types import TracebackType
from typing import ClassVar, NoReturn, Self

import numpy as np

from saf_gen.core.files import refuse_link
from saf_gen.core.region import Region, validate_region, validate_window
from saf_gen.errors import BadInput
from saf_gen.stream.event_file import EventFile, EventWriter, has_events, open_events
from saf_gen.stream.frame_file import FrameFile, FrameWriter, has_frames, open_frames
from saf_gen.stream.metadata import Metadata
from saf_gen.stream.pixel_mask import Filling
from saf_gen.stream.stream_file import SpikeStream, open_stream
from saf_gen.stream.stream_writer import StreamWriter

SENSOR = {"bits": "sensor", "frames": "sensor", "events": "event_sensor"}
"""Name of the text in the provenance that describes the camera, by the form of the file; ``sensor`` is always that on
whose grid the light was measured."""
METHODS_OF = {
    "frames": "--method sd+argmax:window=3",
    "events": "--method er_count+elp_events:window=20 --method er_count+pbf_events:window=20",
}
"""Options of ``saf-gen evaluate`` for recordings whose windows or forms do not suit the default methods, by form."""
FINGERPRINT, SPIKES_CONTENT, LIGHT_S = "fingerprint", "spikes_content", "light_s"
"""Names of texts in the provenance: from what a recording was made; content_sha256 of the spikes of the same moment;
and for how many seconds the schedules of the light run."""


class EventRecording:
    """The events of a sequence, counted over readouts of the spike camera, by which lens and truth are logged.

    Readout t lasts from t to t + 1 divided by ``readout_hz``, to a microsecond. Memory does not grow with the events:
    those of a window are read when it is counted. Attributes are those of :class:`SpikeStream`.

    Parameters
    ----------
    events : EventFile
        The open file, which this object closes.
    """

    form: ClassVar[str] = "events"

    def __init__(self, events: EventFile) -> None:
        self._events = events
        self.path: Path = events.path
        self.shape, self.readout_hz, self.content_sha256 = events.shape, events.readout_hz, events.content_sha256
        self.metadata, self.truth, self.counted = events.metadata, events.truth, events.counted
        self.focus_position, self.gain, self.light_names = events.focus_position, events.gain, events.light_names

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._events.close()

    def verify(self) -> None:
        """Read the whole file; raise BadInput if it does not match its digests."""
        self._events.verify()

    def filling(self, region: Region | None = None) -> Filling:
        """Return what fills masked pixels, of which an event file has none."""
        return Filling(None, validate_region(region, self.shape[1:], where=str(self.path)))

    def counts(self, first: int, stop: int, *, region: Region | None = None, filled: bool = True) -> np.ndarray:
        """Return the number of events of each pixel in readouts ``first <= t < stop``: uint32 (h, w).

        Raises BadInput if the window is empty or leaves the recording, or the region leaves the frame.
        """
        window = validate_window(first, stop, total=self.shape[0], where=str(self.path))
        part = validate_region(region, self.shape[1:], where=str(self.path))
        return self._events.counts(window.start / self.readout_hz, window.stop / self.readout_hz)[part]

    def polarities(self, first: int, stop: int, *, region: Region | None = None) -> np.ndarray:
        """Return the events of each pixel in readouts ``first <= t < stop``: uint32 (2, h, w), falls and then rises.

        Raises BadInput if the window is empty or leaves the recording, or the region leaves the frame.
        """
        window = validate_window(first, stop, total=self.shape[0], where=str(self.path))
        rows, columns = validate_region(region, self.shape[1:], where=str(self.path))
        return self._events.polarities(window.start / self.readout_hz, window.stop / self.readout_hz)[:, rows, columns]

    def frames(self, first: int, stop: int, *, region: Region | None = None) -> NoReturn:
        """Raise BadInput, because an event camera has no frames."""
        raise self._has_no("frames")

    def packed(self, first_byte: int, stop_byte: int, *, region: Region | None = None) -> NoReturn:
        """Raise BadInput, because an event camera has no spikes."""
        raise self._has_no("spikes")

    def texture(self, first: int, stop: int, *, region: Region | None = None) -> NoReturn:
        """Raise BadInput, because an event camera has no intervals between spikes."""
        raise self._has_no("intervals between spikes")

    def _has_no(self, what: str) -> BadInput:
        return BadInput(f"an event camera has no {what}", where=str(self.path), allowed="counts of events")


Recording = SpikeStream | EventRecording | FrameFile


def open_recording(path: Path | str) -> Recording:
    """Return the open recording in a file of a spike camera, of single photons, of events or of frames.

    Raises BadInput as :func:`open_stream`, :func:`open_events` and :func:`open_frames` do.
    """
    where = Path(path)
    if has_events(where):
        return EventRecording(open_events(where))
    if has_frames(where):
        return open_frames(where)
    return open_stream(where)


def write_recording(
    path: Path,
    *,
    form: str,
    shape: tuple[int, int, int],
    readout_hz: float,
    metadata: Metadata,
    black_level_dn: int = 0,
    threads: int | None = None,
) -> StreamWriter | EventWriter | FrameWriter:
    """Return the writer of a recording of this form, a context manager.

    Parameters
    ----------
    path : Path
        File to write.
    form : str
        ``bits``, ``events`` or ``frames``.
    shape : tuple of int
        (T, H, W).
    readout_hz : float
        Readouts per second.
    metadata : Metadata
        Everything that the file holds beside what was read out.
    black_level_dn : int, optional
        Number that stands for no light in frames.
    threads : int, optional
        Number of threads that compress bits.

    Raises
    ------
    BadInput
        If the shape or a field of the metadata is not allowed, or if the folder cannot be written.
    """
    if form == "events":
        return EventWriter(path, shape=shape, readout_hz=readout_hz, metadata=metadata)
    if form == "frames":
        return FrameWriter(path, shape=shape, readout_hz=readout_hz, metadata=metadata, black_level_dn=black_level_dn)
    return StreamWriter(path, shape=shape, readout_hz=readout_hz, metadata=metadata, threads=threads)


def recording_of(path: Path, fingerprint: str, *, verify: bool = False) -> tuple[int, str] | None:
    """Return frames and content_sha256 of a recording with this fingerprint; None if there is none, or it is damaged.

    All of it is read if ``verify`` is true.
    """
    try:
        with open_recording(path) as recording:
            if recording.metadata.provenance.get(FINGERPRINT) != fingerprint:
                return None
            if verify:
                recording.verify()
            return recording.shape[0], recording.content_sha256
    except BadInput:
        return None


def check_replaceable(path: Path) -> None:
    """Raise BadInput if an output would replace a link, or something that ``saf-gen recapture`` did not record."""
    refuse_link(path)
    if path.exists():
        with open_recording(path) as recording:
            if SPIKES_CONTENT not in recording.metadata.provenance:
                raise BadInput(
                    "saf-gen recapture did not record it", where=str(path), hint="choose another --out, or move it"
                )
