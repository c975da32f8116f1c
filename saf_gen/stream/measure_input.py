"""The region that a focus measure scores, and its input from a window of frames."""

from typing import Literal, Protocol

import numpy as np

from saf_gen.core.region import MIN_SIDE, Region, bounding_box, inside_box, place_box
from saf_gen.errors import BadInput
from saf_gen.parts import wants_halves, wants_intervals
from saf_gen.stream.metadata import ReadableStream, Truth


class WindowSource(Protocol):
    """A source of windows of frames: a recording or a running camera."""

    def window(self, first: int, stop: int) -> np.ndarray: ...

    def intervals(self, first: int, stop: int) -> np.ndarray: ...


Form = Literal["counts", "halves", "intervals"]
"""What a measure is called with: the counts of a window, those of its two halves, or its interval texture."""


def wanted_form(measure: object) -> Form:
    """Return what a measure is called with."""
    return "halves" if wants_halves(measure) else "intervals" if wants_intervals(measure) else "counts"


def measure_input(source: WindowSource, form: Form, *, first: int, stop: int) -> np.ndarray:
    """Return a window of n frames as a measure is called with it.

    These are counts (h, w); interval texture (h, w); or, for halves, the counts (2, h, w) of the first n // 2 frames
    and of the rest. Raises BadInput if the halves of a single frame are asked for.
    """
    if form != "halves":
        return source.intervals(first, stop) if form == "intervals" else source.window(first, stop)
    if stop - first < 2:
        raise BadInput(
            f"a window of one frame (frame {first}) has no halves",
            allowed="windows of 2 frames or more for a measure that compares halves",
        )
    middle = first + (stop - first) // 2
    return np.stack([source.window(first, middle), source.window(middle, stop)])


def inside_of(truth: Truth) -> Region | None:
    """Return the largest rectangle inside the target, None if there is none.

    If the recording does not state it, it follows from the target mask of a scene at rest: of a target that moves, the
    mask of one moment says too little.
    """
    if truth.inside is not None:
        top, bottom, left, right = truth.inside
        return slice(top, bottom), slice(left, right)
    return None if truth.target is None or truth.track is not None else inside_box(truth.target)


def has_region(stream: ReadableStream, region: str) -> bool:
    """Return whether a recording has one of REGIONS, which all but ``inside`` always are."""
    return region != "inside" or inside_of(stream.truth) is not None


def choose_region(stream: ReadableStream, region: str) -> tuple[Region | None, str]:
    """Return the box and the name of one of REGIONS; (None, "frame") for "frame", or if it needs an unknown target.

    Raises BadInput for "inside" if the recording has no such region: another one would not be what it stands for.
    """
    if region == "inside":
        if (inside := inside_of(stream.truth)) is None:
            raise BadInput(
                "has no region 'inside'",
                where=str(stream.path),
                allowed=f"a target in which a rectangle of {MIN_SIDE} × {MIN_SIDE} pixels fits, away from its edge",
                hint="use another region, such as target",
            )
        return inside, region
    target, size = stream.truth.target, (int(stream.shape[1]), int(stream.shape[2]))
    if region == "centre":
        return place_box(region, (slice(0, size[0]), slice(0, size[1])), size=size), region
    if region != "frame" and target is not None and np.any(target):
        return place_box(region, bounding_box(target), size=size), region
    return None, "frame"
