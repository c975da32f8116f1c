"""Where a focus measure looks, and what it is given of a window of frames."""

from typing import Protocol

import numpy as np

from saf_gen.core.region import Region, mask_bounding_box
from saf_gen.errors import BadInput
from saf_gen.parts import wants_halves, wants_intervals
from saf_gen.stream.readable import ReadableStream


class WindowSource(Protocol):
    """Windows of frames that can be looked at, on a recording or on a running camera."""

    def window(self, first: int, stop: int) -> np.ndarray: ...

    def intervals(self, first: int, stop: int) -> np.ndarray: ...


def stream_input_for_measure(source: WindowSource, measure: object, *, first: int, stop: int) -> np.ndarray:
    """Return what a measure is given of a window of n frames.

    It is counts (h, w); or (2, h, w), the counts of the first n // 2 frames and of the rest; or interval texture (h,
    w). Raises BadInput for a single frame, which has no halves.
    """
    if not wants_halves(measure):
        return source.intervals(first, stop) if wants_intervals(measure) else source.window(first, stop)
    if stop - first < 2:
        raise BadInput(
            f"the window of frame {first} alone has no halves",
            allowed="windows of 2 frames or more for a measure that compares halves",
        )
    middle = first + (stop - first) // 2
    return np.stack([source.window(first, middle), source.window(middle, stop)])


def choose_stream_region(stream: ReadableStream, region: str) -> tuple[Region | None, str]:
    """Return the box of a region and its name; the box is None for the frame, also where there is no target."""
    target = stream.truth.target
    if region == "target" and target is not None and np.any(target):
        return mask_bounding_box(target), "target"
    return None, "frame"
