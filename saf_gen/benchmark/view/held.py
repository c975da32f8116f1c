"""What a running camera has read out, kept in memory: bits, events, or frames."""

from bisect import bisect_left
from collections.abc import Callable
from typing import Any, NamedTuple, NoReturn, Protocol

import numpy as np

from saf_gen.benchmark.view.restricted_view import TimedWindowSource, no_polarities
from saf_gen.camera.camera import Span
from saf_gen.core import bits
from saf_gen.core.region import Region, region_shape
from saf_gen.errors import BadInput
from saf_gen.stack.capture import Capture
from saf_gen.stream.frame_file import above_black
from saf_gen.stream.interval_texture import window_time_texture


class Held(TimedWindowSource, Protocol):
    """What was read out so far in a region."""

    def keep(self, span: Span, piece: Any) -> None:
        """Keep a piece of a span, as :meth:`saf_gen.camera.camera.Camera.expose` yields it."""
        ...

    def forget(self, begin: int) -> None:
        """Forget the readouts from ``begin`` on."""
        ...


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


class HeldBits(SpikePlanes):
    """The bits of a region, whose readouts are written over when they are captured again."""

    def __init__(self, capture: Capture, inside: Region) -> None:
        super().__init__(np.zeros((-(-capture.frames // 8), *region_shape(inside)), np.uint8))
        self._inside = inside

    def keep(self, span: Span, piece: np.ndarray) -> None:
        """Keep the bits of a span, uint8 (H, W, bytes)."""
        self._planes[span.begin // 8 : -(-span.end // 8)] = piece[self._inside].transpose(2, 0, 1)

    def forget(self, begin: int) -> None:
        """Do nothing."""


class _Events(NamedTuple):
    """Events of a region in the order in which they were read: microseconds, pixels and rises of the light."""

    t: np.ndarray
    pixel: np.ndarray
    p: np.ndarray


class HeldEvents:
    """The events of a region.

    Attributes
    ----------
    parts : list of tuple of ndarray
        Microseconds, pixels of the region, and rises of the light, in the order in which events were read.
    """

    textures_s = 0.0

    def __init__(self, capture: Capture, inside: Region) -> None:
        self.shape, self._inside, self._hz = region_shape(inside), inside, capture.sensor.readout_hz
        self.parts: list[_Events] = []

    def keep(self, span: Span, piece: Any) -> None:
        """Keep events: columns ``t``, ``x``, ``y`` and ``p``."""
        rows, columns = self._inside
        x, y = piece.x.astype(np.int64), piece.y.astype(np.int64)
        inside = (y >= rows.start) & (y < rows.stop) & (x >= columns.start) & (x < columns.stop)
        if inside.any():
            pixel = (y[inside] - rows.start) * self.shape[1] + x[inside] - columns.start
            self.parts.append(_Events(piece.t[inside], pixel, piece.p[inside]))

    def forget(self, begin: int) -> None:
        """Forget all events, because pixels keep their state."""
        self.parts = []

    def window(self, first: int, stop: int) -> np.ndarray:
        """Return the events of each pixel in readouts ``first <= t < stop``, captured already: uint32 (h, w)."""
        total: np.ndarray = self.polarities(first, stop).sum(axis=0, dtype=np.uint32)
        return total

    def polarities(self, first: int, stop: int) -> np.ndarray:
        """Return the falls and then the rises of each pixel in a window that is captured: uint32 (2, h, w)."""
        pixels = self.shape[0] * self.shape[1]
        begin_us, end_us = self._microseconds(first), self._microseconds(stop)
        counts = np.zeros(2 * pixels, np.uint32)
        for part in self.parts[bisect_left(self.parts, begin_us, key=lambda part: part.t[-1]) :]:
            if part.t[0] >= end_us:
                break
            within = slice(*np.searchsorted(part.t, [begin_us, end_us]))
            index = part.pixel[within] + pixels * part.p[within]
            counts += np.bincount(index, minlength=2 * pixels).astype(np.uint32)
        return counts.reshape(2, *self.shape)

    def intervals(self, first: int, stop: int) -> NoReturn:
        """Raise BadInput, because an event camera has no intervals between spikes."""
        raise BadInput("an event camera has no intervals between spikes", allowed="counts of events")

    def _microseconds(self, frame: int) -> int:
        """Return the beginning of a readout, rounded down, so that no later packet adds events to a window."""
        return int(frame * 1e6 / self._hz + 1e-6)


class HeldFrames:
    """The frames of a region."""

    textures_s = 0.0

    def __init__(self, capture: Capture, inside: Region) -> None:
        self.shape, self._inside = region_shape(inside), inside
        self._black = int(getattr(capture.sensor, "black_level_dn", 0))
        self._numbers: list[np.ndarray] = []

    def keep(self, span: Span, piece: np.ndarray) -> None:
        """Keep the next frame, uint16 (H, W)."""
        self._numbers.append(piece[self._inside].copy())

    def forget(self, begin: int) -> None:
        """Forget the frames from ``begin`` on."""
        del self._numbers[begin:]

    def window(self, first: int, stop: int) -> np.ndarray:
        """Return the sum of the light of frames ``first <= t < stop``, which must be there already: uint32 (h, w).

        It is that of :meth:`saf_gen.stream.frame_file.FrameFile.counts`, levels above the black level.
        """
        light = above_black(np.stack(self._numbers[first:stop]), self._black)
        total: np.ndarray = light.sum(axis=0, dtype=np.uint32)
        return total

    def intervals(self, first: int, stop: int) -> NoReturn:
        """Raise BadInput, because a frame camera has no intervals between spikes."""
        raise BadInput("a frame camera has no intervals between spikes", allowed="sums of frames")

    def polarities(self, first: int, stop: int) -> NoReturn:
        """Raise BadInput, because frames have no polarity."""
        raise no_polarities()


HELD: dict[str, Callable[[Capture, Region], Held]] = {"bits": HeldBits, "events": HeldEvents, "frames": HeldFrames}
"""What keeps the readouts of a camera, by the form of its recordings."""
