"""Recordings whose statistics are measured: stream files, raw files of other cameras, and simulations.

Each yields packed spikes block by block in the order of time, so that memory does not grow with its length.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Protocol

import numpy as np

from saf_gen.camera import Encoder, Sensor
from saf_gen.errors import BadInput
from saf_gen.stream.interop import import_raw_frames, state_layout
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


@dataclass(frozen=True)
class EncodedRecording:
    """A simulated recording, which is encoded while it is read.

    Parameters
    ----------
    name : str
        Name of the recording in messages and tables.
    sensor : Sensor
        The sensor that records.
    charge : ndarray of float32, shape (K, H, W)
        Photo-electrons per readout at K knots of time.
    frames : int
        Readouts of the recording.
    seed : int
        Seed of the noise.
    knots : callable, optional
        Maps readout numbers to the knot before each readout and the fraction of the way to the next knot; by default
        the charge of the first knot holds throughout.
    before : int, default 0
        Readouts to encode and discard first, so that the pixels' phases no longer depend on their initial charge.
    device_seed : int, optional
        Seed of the fixed pattern; by default ``seed``.
    """

    name: str
    sensor: Sensor
    charge: np.ndarray
    frames: int
    seed: int
    knots: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]] | None = None
    before: int = 0
    device_seed: int | None = None

    @property
    def shape(self) -> tuple[int, int, int]:
        """Frames, rows and columns."""
        return self.frames, self.charge.shape[1], self.charge.shape[2]

    @property
    def readout_hz(self) -> float:
        """Readouts per second."""
        return self.sensor.readout_hz

    def blocks(self) -> Iterator[np.ndarray]:
        """Yield packed spikes, as :meth:`Recording.blocks` does; each call encodes the same spikes."""
        encoder = Encoder(self.sensor, self.shape[1:], seed=self.seed, device_seed=self.device_seed)
        stack = np.ascontiguousarray(self.charge[None], np.float32)
        if self.before:
            self._encode(encoder, stack, readout=np.zeros(self.before, np.int64))
        for first in range(0, self.frames, BLOCK_FRAMES):
            yield self._encode(encoder, stack, readout=np.arange(first, min(first + BLOCK_FRAMES, self.frames)))

    def _encode(self, encoder: Encoder, stack: np.ndarray, *, readout: np.ndarray) -> np.ndarray:
        still = np.zeros(readout.size, np.int64), np.zeros(readout.size)
        index, fraction = self.knots(readout) if self.knots is not None else still
        return encoder.encode(stack, index=index, fraction=fraction, gain=np.ones((readout.size, 1)))


@contextmanager
def open_recording(
    path: str | Path, *, layout: str | None = None, readout_hz: float = 20_000
) -> Iterator[StreamRecording]:
    """Open a stream file (.h5 or .hdf5) or a file of raw frames of other software (any other ending) as a recording.

    Raw frames are first converted to a temporary stream.

    Parameters
    ----------
    path : str or Path
        The file.
    layout : str, optional
        Layout of raw frames, a name of :data:`saf_gen.stream.interop.RAW_LAYOUTS`, which they do not state.
    readout_hz : float, default 20000
        Readouts per second of raw frames, which do not record it.

    Yields
    ------
    StreamRecording
        The open recording.

    Raises
    ------
    BadInput
        If the file is missing, is neither a stream nor raw frames, is a sensor file, or is raw without a layout.
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
        kind, order = state_layout(path, layout=layout, size=None, order=None)
        import_raw_frames(path, converted, layout=kind.name, order=order, readout_hz=readout_hz)
        with open_stream(converted) as stream:
            yield StreamRecording(stream, path.name)
