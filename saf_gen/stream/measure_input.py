"""The region that a focus measure scores, and its input from a window of frames."""

from typing import Protocol

import numpy as np

from saf_gen.core.region import Region, bounding_box
from saf_gen.errors import BadInput
from saf_gen.parts import wants_halves, wants_intervals
from saf_gen.stream.metadata import ReadableStream


class WindowSource(Protocol):
    """A source of windows of frames: a recording or a running camera."""

    def window(self, first: int, stop: int) -> np.ndarray: ...

    def intervals(self, first: int, stop: int) -> np.ndarray: ...


def measure_input(source: WindowSource, measure: object, *, first: int, stop: int) -> np.ndarray:
    """Return the input of a measure from a window of n frames.

    The input is counts (h, w); for a measure of intervals, interval texture (h, w); for a half-window measure, the
    counts (2, h, w) of the first n // 2 frames and of the rest. Raises BadInput if a half-window measure is called for
    a single frame.
    """
    if not wants_halves(measure):
        return source.intervals(first, stop) if wants_intervals(measure) else source.window(first, stop)
    if stop - first < 2:
        raise BadInput(
            f"a window of one frame (frame {first}) has no halves",
            allowed="windows of 2 frames or more for a measure that compares halves",
        )
    middle = first + (stop - first) // 2
    return np.stack([source.window(first, middle), source.window(middle, stop)])


def choose_region(stream: ReadableStream, region: str) -> tuple[Region | None, str]:
    """Return the box and the name of a region; (None, "frame") if ``region`` is "frame" or no target is known."""
    target = stream.truth.target
    if region == "target" and target is not None and np.any(target):
        return bounding_box(target), "target"
    return None, "frame"
