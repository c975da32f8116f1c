"""The bits that a running spike camera or single-photon array has captured, while a method moves its lens."""

from functools import partial
from typing import NoReturn

import numpy as np

from saf_gen.benchmark.view.restricted_view import no_polarities
from saf_gen.core import bits
from saf_gen.core.region import Region, region_shape
from saf_gen.stack.capture import Capture
from saf_gen.stack.charge_source import ChargeSource
from saf_gen.stream.interval_texture import window_time_texture


class SpikePlanes:
    """Spikes in memory, whose windows are counted and turned into interval textures.

    Parameters
    ----------
    planes : ndarray of uint8, shape (bytes, h, w)
        Spikes of each pixel, packed along time (:mod:`saf_gen.core.bits`).

    Attributes
    ----------
    shape : tuple of int
        Rows and columns.
    textures_s : float
        Computing time of all interval textures so far, in seconds.
    """

    def __init__(self, planes: np.ndarray) -> None:
        self._planes, self.textures_s = planes, 0.0
        self.shape = int(planes.shape[1]), int(planes.shape[2])

    def window(self, first: int, stop: int) -> np.ndarray:
        """Return the counts of frames ``first <= t < stop``, which must be there already: uint32 (h, w)."""
        counts = np.zeros(self.shape, np.uint32)
        bits.sum_planes(self._planes, counts, first=first, stop=stop)
        return counts

    def intervals(self, first: int, stop: int) -> np.ndarray:
        """Return the interval texture of a window, float64 (h, w); see window_texture."""

        def read(first_byte: int, stop_byte: int) -> np.ndarray:
            return self._planes[first_byte:stop_byte].transpose(1, 2, 0)

        image, seconds = window_time_texture(read, self.window, first=first, stop=stop)
        self.textures_s += seconds
        return image

    def polarities(self, first: int, stop: int) -> NoReturn:
        """Raise BadInput, because spikes have no polarity."""
        raise no_polarities()


class CapturedSpikes(SpikePlanes):
    """The spikes that a running camera has captured so far, in a region of the sensor.

    Only the rows that a region needs are encoded, and only when a method looks at them. Successive runs of one capture
    share the frames as long as their lenses move along the same path, so all methods that are given a sweep see the
    same spikes.

    Parameters
    ----------
    capture : Capture
        The recording that is captured again.
    charge_source : ChargeSource
        Charge of ``capture.encoder_rows(region)``; runs of one capture may share it.
    region : Region
        Region of the sensor; both ends of its slices are numbers.
    threads : int, optional
        Number of threads that encode; by default one per core.

    Attributes
    ----------
    frames : int
        Number of frames that are encoded so far.
    """

    def __init__(
        self, capture: Capture, charge_source: ChargeSource, *, region: Region, threads: int | None = None
    ) -> None:
        rows, columns = region
        self.capture, self._charge_source = capture, charge_source
        encoded = capture.encoder_rows(region)
        self._create_encoder = partial(capture.create_encoder, encoded, threads=threads)
        self._encoder = self._create_encoder()
        self._inside = slice(rows.start - encoded.start, rows.stop - encoded.start), columns
        super().__init__(np.zeros((-(-capture.frames // 8), *region_shape(region)), np.uint8))
        self._position, self.frames = np.zeros(capture.frames), 0

    def encode_until(self, stop: int, position: np.ndarray) -> None:
        """Encode all readouts before ``stop``, a multiple of 8.

        Frames of an earlier run are kept if its lens was at the same positions in all of them. Otherwise encoding
        starts from the beginning, because the charge of a pixel depends on all earlier readouts.

        Parameters
        ----------
        stop : int
            Number of readouts, a multiple of 8.
        position : ndarray of float64
            Lens position at each readout, as fractions of the travel, 0...1.
        """
        known = min(self.frames, stop)
        if not np.array_equal(self._position[:known], position[:known]):
            self._encoder, self.frames = self._create_encoder(), 0
        begin = self.frames
        if stop <= begin:
            return
        self._position[begin:stop] = position[begin:stop]
        for run in self.capture.plane_source.time_stack.split_at_slices(begin, stop):
            inputs = self._charge_source.encoder_inputs(run, position=position, gain=self.capture.gain)
            spikes = self._encoder.encode(**inputs)[self._inside]
            self._planes[run.begin // 8 : -(-run.end // 8)] = spikes.transpose(2, 0, 1)
            self.frames = run.end
