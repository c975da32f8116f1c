"""What statistics are taken of: stream files, raw files of other cameras, and recordings encoded as they are read.

All of them give packed spikes block by block, in the order of time, so that memory does not grow with their length.
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
from saf_gen.stream.interop import import_raw_frames, sniff_imported_layout
from saf_gen.stream.stream_file import SpikeStream, open_stream
from saf_gen.stream.time_blocks import TIME_BLOCK_BYTES

BLOCK_FRAMES = 8 * TIME_BLOCK_BYTES


class Recording(Protocol):
    """Spikes of one camera, read in blocks of time."""

    @property
    def name(self) -> str:
        """What messages and tables call it."""
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
        """Yield the spikes, as :class:`Recording` says."""
        length = -(-self.shape[0] // 8)
        for first in range(0, length, TIME_BLOCK_BYTES):
            yield self.stream.packed(first, min(first + TIME_BLOCK_BYTES, length))


@dataclass(frozen=True)
class EncodedRecording:
    """A recording that a sensor makes while it is read.

    charge : float32 (K, H, W), photo-electrons per readout at K knots of light.
    knots : the knot before each readout of a block, and the fraction to the next, from the readouts' numbers.
    before : readouts encoded and left out first, so that phases are no longer those of the first charge.
    device_seed : determines the fixed pattern; ``seed``, that of the noise, by default.
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
        """Yield the spikes, as :class:`Recording` says; each call encodes the same ones."""
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
def open_calibration_recording(
    path: str | Path, *, layout: str = "auto", readout_hz: float = 20_000
) -> Iterator[StreamRecording]:
    """Yield the recording in a file: a stream (.h5), or raw frames (any other ending) in a layout of other software.

    Raw frames are converted to a temporary stream first. Raises BadInput for a file that is neither.

    Parameters
    ----------
    path : the file.
    layout : layout of raw frames, a name of :data:`saf_gen.stream.interop.RAW_LAYOUTS`, or ``auto``: as the file looks.
    readout_hz : readouts per second of raw frames, which do not record it.
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
        kind = sniff_imported_layout(path) if layout == "auto" else layout
        import_raw_frames(path, converted, layout=kind, readout_hz=readout_hz)
        with open_stream(converted) as stream:
            yield StreamRecording(stream, path.name)
