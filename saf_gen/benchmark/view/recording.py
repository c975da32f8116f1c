"""View of a recording for a method: its length, the lens positions, and the scores and counts of windows."""

from collections import OrderedDict
from collections.abc import Callable

import numpy as np

from saf_gen.benchmark.view.restricted_view import MeteredScorer, no_polarities
from saf_gen.core.region import Region, region_shape, validate_region, validate_window
from saf_gen.errors import BadInput
from saf_gen.stream.interval_texture import window_time_texture
from saf_gen.stream.measure_input import Form
from saf_gen.stream.recordings import EventRecording, Recording

KNOTS = 256
"""Maximum number of frames at which running sums are kept; there are fewer if they would exceed KNOT_BYTES."""
KNOT_BYTES = 128 << 20
"""Memory for running sums, in bytes."""
WINDOW_BYTES = 256 << 20
"""Memory for windows that are kept after they were counted, in bytes."""


class WindowCounts:
    """Spike counts of any window of a stream, in a region or in the whole frame; masked pixels are filled.

    A search looks at hundreds of windows, often half as long as the recording, and several methods look at the same
    windows. Long windows are therefore computed from running sums up to some frames (knots), and counted windows kept.

    It needs up to 128 MiB for running sums and 256 MiB for windows already counted, in addition to the memory of the
    stream. It must be used by one thread at a time, and the stream must stay open.

    Parameters
    ----------
    stream : SpikeStream or EventRecording
        Open stream.
    region : Region, optional
        Rows and columns; by default the whole frame.

    Raises
    ------
    BadInput
        If the region is empty or extends beyond the frame.
    """

    def __init__(self, stream: Recording, region: Region | None = None) -> None:
        self.frames, height, width = stream.shape
        part = validate_region(region, (height, width))
        self._stream, self._filling = stream, stream.filling(part)
        self._region = self._filling.region  # as recorded; what it holds is filled after it was added up
        self.shape = region_shape(part)
        self.readout_hz, self.lens_position = stream.readout_hz, stream.focus_position
        recorded = region_shape(self._region)
        image_bytes = 4 * recorded[0] * recorded[1]
        between = max(min(KNOTS, KNOT_BYTES // image_bytes) - 1, 1)
        self._step = 8 * -(-self.frames // (8 * between))
        self._sums: np.ndarray | None = None
        self._cache: OrderedDict[tuple[str, int, int], np.ndarray] = OrderedDict()
        self._cache_bytes = 0
        self._texture_seconds: dict[tuple[int, int], float] = {}  # computing time of each texture that is kept
        self.textures_s = 0.0

    def window(self, first: int, stop: int) -> np.ndarray:
        """Return the counts of frames ``first <= t < stop``, counted from 0: uint32 (h, w), read-only.

        Raises BadInput if the window is empty or extends beyond the recording.
        """
        window = validate_window(first, stop, total=self.frames)
        return self._compute_once("counts", lambda a, b: self._filling.apply(self._count(a, b)), window=window)

    def intervals(self, first: int, stop: int) -> np.ndarray:
        """Return the interval texture of a window of n frames: float64 (h, w), 0...n, read-only.

        See window_texture. Raises BadInput if the window is empty or extends beyond the recording.
        """
        window = validate_window(first, stop, total=self.frames)
        image = self._compute_once("intervals", self._compute_texture, window=window)
        self.textures_s += self._texture_seconds[window.start, window.stop]
        return image

    def polarities(self, first: int, stop: int) -> np.ndarray:
        """Return the events of a window, falls and then rises: uint32 (2, h, w), read-only.

        Raises BadInput if the window is empty or extends beyond the recording, or the recording holds no events.
        """
        events, window = self._stream, validate_window(first, stop, total=self.frames)
        if not isinstance(events, EventRecording):
            raise no_polarities()
        return self._compute_once(
            "polarities", lambda a, b: events.polarities(a, b, region=self._region), window=window
        )

    def _compute_once(self, kind: str, compute: Callable[[int, int], np.ndarray], *, window: range) -> np.ndarray:
        """Return the kept image of a window, or compute and keep it; beyond WINDOW_BYTES, drop the longest unused."""
        key = kind, window.start, window.stop
        if key in self._cache:
            self._cache.move_to_end(key)
            return self._cache[key]
        image = compute(window.start, window.stop)
        image.flags.writeable = False  # the next method gets the same array
        self._cache[key] = image
        self._cache_bytes += image.nbytes
        while self._cache_bytes > WINDOW_BYTES and len(self._cache) > 1:
            (dropped_kind, *dropped), dropped_image = self._cache.popitem(last=False)
            self._cache_bytes -= dropped_image.nbytes
            if dropped_kind == "intervals":
                del self._texture_seconds[dropped[0], dropped[1]]
        return image

    def _count(self, first: int, stop: int) -> np.ndarray:
        after, before = -(-first // self._step), stop // self._step  # the knots just inside the window
        if before - after < 2:
            return self._count_recorded(first, stop)
        if self._sums is None:
            self._sums = self._running_sums()
        counts = self._sums[before] - self._sums[after]
        for a, b in ((first, after * self._step), (before * self._step, stop)):
            if a < b:
                counts += self._count_recorded(a, b)
        return counts

    def _count_recorded(self, first: int, stop: int) -> np.ndarray:
        return self._stream.counts(first, stop, region=self._region, filled=False)

    def _compute_texture(self, first: int, stop: int) -> np.ndarray:
        def read(first_byte: int, stop_byte: int) -> np.ndarray:
            return self._stream.packed(first_byte, stop_byte, region=self._region)

        image, self._texture_seconds[first, stop] = window_time_texture(read, self._count, first=first, stop=stop)
        return self._filling.apply(image)

    def _running_sums(self) -> np.ndarray:
        """Return the number of spikes per pixel before each multiple of the step: uint32 (knots, h, w)."""
        full_steps = self.frames // self._step
        sums = np.zeros((full_steps + 1, *region_shape(self._region)), dtype=np.uint32)
        for knot in range(full_steps):
            first = self._step * knot
            sums[knot + 1] = sums[knot] + self._count_recorded(first, first + self._step)
        return sums


class RecordingView:
    """The view of a recording for one method's search; see :class:`saf_gen.parts.View`.

    Parameters
    ----------
    counts : WindowCounts
        Counts of any window of the recording.
    measure : callable, optional
        The method's own measure; None if the method scores the windows elsewhere.

    Attributes
    ----------
    now : int
        End of the latest window that was scored or looked at.
    scorer : MeteredScorer
        Scorer that measures the cost.
    """

    lag_s = 0.0  # a recording stores the positions of the lens itself

    def __init__(self, counts: WindowCounts, measure: Callable[..., float] | None) -> None:
        self._counts, self.scorer = counts, MeteredScorer(measure)
        self.frames, self.readout_hz = counts.frames, counts.readout_hz
        self.now = 0

    def position(self, frame: int) -> float:
        """Return the lens position, as a fraction of the travel, or NaN if it was not recorded.

        Raises BadInput if the frame is outside the recording.
        """
        window, lens = validate_window(frame, frame + 1, total=self.frames), self._counts.lens_position
        return float("nan") if lens is None else float(lens[window.start])

    def positions(self, first: int) -> np.ndarray:
        """Return the lens positions of all frames from ``first``, float64 (n,); NaN if they were not recorded."""
        lens = self._counts.lens_position
        return np.full(self.frames - first, np.nan) if lens is None else np.asarray(lens[first:], np.float64)

    def image(self, form: Form, *, first: int, stop: int) -> np.ndarray:
        """Return frames ``first <= t < stop`` as a measure is called with them, read-only.

        Raises BadInput if the window is empty or outside the recording.
        """
        window = validate_window(first, stop, total=self.frames)
        image = self.scorer.image(self._counts, form, first=window.start, stop=window.stop)
        self.now = max(self.now, window.stop)
        return image

    def move(self, to: float) -> None:
        """Raise BadInput, because the lens of a recording cannot be moved."""
        raise _refuse_lens_command(f"be moved to {to:g}")

    def wait(self, frames: int) -> None:
        """Raise BadInput, because no time passes on a recording."""
        raise _refuse_lens_command(f"wait for {frames} frames")

    def score(self, first: int, stop: int, measure: str | None = None) -> float:
        """Return the score of frames ``first <= t < stop`` by the method's measure, or by the one named ``measure``.

        Raises BadInput if the window is empty or outside the recording, if the score is not a finite number, or if the
        measure is unknown.
        """
        window = validate_window(first, stop, total=self.frames)
        first, stop = window.start, window.stop
        score = self.scorer.score(self._counts, first=first, stop=stop, measure=measure)
        self.now = max(self.now, stop)
        return score

    def counts(self, first: int, stop: int) -> np.ndarray:
        """Return the counts of frames ``first <= t < stop``: uint32 (h, w), read-only.

        Raises BadInput if the window is empty or outside the recording.
        """
        window = validate_window(first, stop, total=self.frames)
        self.now = max(self.now, window.stop)
        return self.scorer.look(self._counts, first=window.start, stop=window.stop)

    def polarities(self, first: int, stop: int) -> np.ndarray:
        """Return the events of frames ``first <= t < stop``, falls and then rises: uint32 (2, h, w), read-only.

        Raises BadInput if the window is empty or outside the recording, or the recording holds no events.
        """
        window = validate_window(first, stop, total=self.frames)
        events = self.scorer.look_at_polarities(self._counts, first=window.start, stop=window.stop)
        self.now = max(self.now, window.stop)
        return events


def _refuse_lens_command(what: str) -> BadInput:
    return BadInput(
        f"the lens of a recording cannot {what}",
        allowed="searches that estimate on a recording",
        hint="evaluate it with --track closed_loop",
    )
