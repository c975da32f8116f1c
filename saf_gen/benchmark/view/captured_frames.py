"""What a running camera has seen: encoded from the stacks, with the lens wherever it was.

Only the rows that a region needs are encoded, and only when somebody looks.
"""

import numpy as np

from saf_gen.benchmark.view.interval_texture import time_texture_from_intervals
from saf_gen.core import bits
from saf_gen.core.region import Region
from saf_gen.errors import BadInput
from saf_gen.stack.capture import Capture
from saf_gen.stack.charge_source import ChargeSource

__all__ = ["CapturedFrames", "rows_to_encode"]


class CapturedFrames:
    """The spikes of a running camera so far, in a region. What :class:`Live` develops, a packet at a time.

    Parameters
    ----------
    take : what is filmed.
    exposed : of ``rows_to_encode(take, region)``; shared by many films of one take.
    region : rows and columns, both ends filled in.
    threads : of the encoder.
    """

    def __init__(
        self, take: Capture, exposed: ChargeSource, region: Region, *, threads: int | None = None
    ) -> None:
        rows, columns = region
        self._take, self._exposed = take, exposed
        kept = rows_to_encode(take, region)
        self._encoder = take.create_encoder(kept, threads=threads)
        self._inside = slice(rows.start - kept.start, rows.stop - kept.start), columns
        self.shape = rows.stop - rows.start, columns.stop - columns.start
        self._planes = np.zeros((-(-take.frames // 8), *self.shape), np.uint8)
        self.frames, self.textures_s = 0, 0.0

    def encode_until(self, stop: int, position: np.ndarray) -> None:
        """Encode all readouts before ``stop``, the lens having been at ``position`` (T,) of the travel."""
        begin = self.frames
        if stop <= begin:
            return
        for run in self._take.plane_source.time_stack.split_at_slices(begin, stop):
            inputs = self._exposed.encoder_inputs(run, position=position, gain=self._take.gain)
            spikes = self._encoder.encode(**inputs)[self._inside]
            self._planes[run.begin // 8 : -(-run.end // 8)] = spikes.transpose(2, 0, 1)
        self.frames = stop

    def window(self, first: int, stop: int) -> np.ndarray:
        """Counts in frames ``first <= t < stop``, developed already: uint32 (h, w)."""
        counts = np.zeros(self.shape, np.uint32)
        bits.add_counts(self._planes, first, stop, counts)
        return counts

    def halves(self, first: int, stop: int) -> np.ndarray:
        """Counts in both halves of a window of n frames, n // 2 and the rest: uint32 (2, h, w).

        Raises BadInput for a single frame.
        """
        if stop - first < 2:
            raise BadInput(f"the window of frame {first} alone has no halves", allowed="2 frames or more")
        middle = first + (stop - first) // 2
        return np.stack([self.window(first, middle), self.window(middle, stop)])

    def intervals(self, first: int, stop: int) -> np.ndarray:
        """Texture from intervals of a window: float64 (h, w); see
        :func:`saf_gen.benchmark.view.interval_texture.texture`."""

        def read(first_byte: int, stop_byte: int) -> np.ndarray:
            return self._planes[first_byte:stop_byte].transpose(1, 2, 0)

        image, seconds = time_texture_from_intervals(read, self.window, first, stop=stop)
        self.textures_s += seconds
        return image


def rows_to_encode(take: Capture, region: Region) -> slice:
    """The rows that must be encoded for a region: from where a block of the encoder's noise begins."""
    step = take.row_alignment
    return slice(region[0].start // step * step, region[0].stop)
