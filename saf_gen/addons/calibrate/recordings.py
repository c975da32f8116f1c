"""Recordings whose statistics are measured: stream files, and raw files of other cameras.

Each yields packed spikes block by block in the order of time, so that memory does not grow with its length.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Protocol

import numpy as np

from saf_gen.errors import BadInput
from saf_gen.stream.interop import import_raw_frames, recognise
from saf_gen.stream.stream_file import SpikeStream, open_stream
from saf_gen.stream.time_blocks import TIME_BLOCK_BYTES

BLOCK_FRAMES = 8 * TIME_BLOCK_BYTES


class Recording(Protocol):
    """Spikes of one camera, read in blocks of time."""

    @property
    def name(self) -> str:
        """Name of the recording in messages and tables."""
        ...

    @property
    def shape(self) -> tuple[int, int, int]:
        """Frames, rows and columns."""
        ...

    @property
    def readout_hz(self) -> float:
        """Readouts per second."""
        ...

    def blocks(self) -> Iterator[np.ndarray]:
        """Yield packed spikes, uint8 (H, W, bytes), of ``BLOCK_FRAMES`` readouts each; the last may be shorter."""
        ...


@dataclass(frozen=True)
class StreamRecording:
    """An open stream file as a :class:`Recording`."""

    stream: SpikeStream
    name: str

    @property
    def shape(self) -> tuple[int, int, int]:
        """Frames, rows and columns."""
        return self.stream.shape

    @property
    def readout_hz(self) -> float:
        """Readouts per second."""
        return self.stream.readout_hz

    def blocks(self) -> Iterator[np.ndarray]:
        """Yield packed spikes, as :meth:`Recording.blocks` does."""
        length = -(-self.shape[0] // 8)
        for first in range(0, length, TIME_BLOCK_BYTES):
            yield self.stream.packed(first, min(first + TIME_BLOCK_BYTES, length))


@contextmanager
def open_recording(path: str | Path, *, layout: str = "auto", readout_hz: float = 20_000) -> Iterator[StreamRecording]:
    """Open a stream file (.h5 or .hdf5) or a file of raw frames of other software (any other ending) as a recording.

    Raw frames are first converted to a temporary stream.

    Parameters
    ----------
    path : str or Path
        The file.
    layout : str, default "auto"
        Layout of raw frames, a name of :data:`saf_gen.stream.interop.RAW_LAYOUTS`; ``auto`` derives it from the file.
    readout_hz : float, default 20000
        Readouts per second of raw frames, which do not record it.

    Yields
    ------
    StreamRecording
        The open recording.

    Raises
    ------
    BadInput
        If the file is missing, is neither a stream nor raw frames, or is a sensor file.
    """
    path = Path(path)
    if path.suffix in (".h5", ".hdf5"):
        with open_stream(path) as stream:
            yield StreamRecording(stream, path.name)
        return
    if path.suffix in (".yaml", ".yml"):
        raise BadInput("is a sensor file", where=str(path), allowed="a recording: a stream (.h5) or raw frames (.dat)")
    if not path.exists():
        raise BadInput("there is no such file", where=str(path), allowed="a stream (.h5) or raw frames (.dat)")
    with TemporaryDirectory(prefix="saf-gen-") as folder:
        converted = Path(folder) / "recording.h5"
        kind, order = recognise(path, layout=None if layout == "auto" else layout)
        import_raw_frames(path, converted, layout=kind.name, order=order, readout_hz=readout_hz)
        with open_stream(converted) as stream:
            yield StreamRecording(stream, path.name)
