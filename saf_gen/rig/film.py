"""What a running camera has seen: encoded from the stacks, with the lens wherever it was.

Only the rows that a region needs are encoded, and only when somebody looks.
"""

import numpy as np

from saf_gen import bits
from saf_gen.errors import BadInput
from saf_gen.exposed import Exposed
from saf_gen.region import Region
from saf_gen.rig.intervals import timed_texture
from saf_gen.take import Take

__all__ = ["Film", "rows_of"]


class Film:
    """The spikes of a running camera so far, in a region. What :class:`Live` develops, a packet at a time.

    Parameters
    ----------
    take : what is filmed.
    exposed : of ``rows_of(take, region)``; shared by many films of one take.
    region : rows and columns, both ends filled in.
    threads : of the encoder.
    """

    def __init__(self, take: Take, exposed: Exposed, region: Region, *, threads: int | None = None) -> None:
        rows, columns = region
        self._take, self._exposed = take, exposed
        kept = rows_of(take, region)
        self._encoder = take.encoder(kept, threads=threads)
        self._inside = slice(rows.start - kept.start, rows.stop - kept.start), columns
        self.shape = rows.stop - rows.start, columns.stop - columns.start
        self._planes = np.zeros((-(-take.frames // 8), *self.shape), np.uint8)
        self.frames, self.textures_s = 0, 0.0

    def develop(self, stop: int, position: np.ndarray) -> None:
        """Encode all readouts before ``stop``, the lens having been at ``position`` (T,) of the travel."""
        begin = self.frames
        if stop <= begin:
            return
        for first, last, j in self._take.footage.reel.runs(begin, stop):
            lights = self._exposed.lights(first, last, j, position, self._take.gain)
            spikes = self._encoder.encode(*lights)[self._inside]
            self._planes[first // 8 : -(-last // 8)] = spikes.transpose(2, 0, 1)
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
        """Texture from intervals of a window: float64 (h, w); see :func:`saf_gen.rig.intervals.texture`."""

        def read(first_byte: int, stop_byte: int) -> np.ndarray:
            return self._planes[first_byte:stop_byte].transpose(1, 2, 0)

        image, seconds = timed_texture(read, self.window, first, stop=stop)
        self.textures_s += seconds
        return image


def rows_of(take: Take, region: Region) -> slice:
    """The rows that must be encoded for a region: from where a block of the encoder's noise begins."""
    step = take.rows_step
    return slice(region[0].start // step * step, region[0].stop)
