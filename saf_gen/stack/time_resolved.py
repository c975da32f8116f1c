"""Time-resolved focal stacks: one stack of a static scene, or one at each of many moments of a moving scene.

Between two moments the image changes linearly from one stack to the next. A readout at the fraction w of the time
between them sees, at its focus position, (1 - w) of the earlier and w of the later stack, each interpolated between the
two nearest positions. The encoder gets the two stacks as two sets of lights, so that this is exact at every readout.
"""

import hashlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, takewhile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from saf_gen.stack.focal_stack import FocalStack, StackSpec, StackStore
from saf_gen.stack.stack_grain import StackGrain, read_grain

SHADING_MOMENTS = 9  # number of moments whose light paths give the shading of a time slice, including its own
FRAMES_PER_BYTE = 8  # the encoder writes whole bytes, so a pair of stacks can change only between two bytes


class FrameRun(NamedTuple):
    """Frames ``begin <= t < end`` between two time slices; ``slice_index`` is the index of the earlier one."""

    begin: int
    end: int
    slice_index: int


@dataclass(frozen=True)
class TimeResolvedStack:
    """The focal stacks of a recording; each shows the scene at the beginning of a given frame.

    Attributes
    ----------
    slice_frames : tuple of int
        Frame of each stack. A static scene has one; in a moving scene they rise from 0 to at least the length of the
        recording.
    specs : tuple of StackSpec
        The stacks.
    """

    slice_frames: tuple[int, ...]
    specs: tuple[StackSpec, ...]

    @property
    def is_moving(self) -> bool:
        """Whether the scene moves."""
        return len(self.specs) > 1

    @property
    def holds_full_travel(self) -> bool:
        """Whether every stack holds all focus positions, as the closed loop needs."""
        return all(spec.rendered_count == spec.positions for spec in self.specs)

    def with_full_travel(self) -> "TimeResolvedStack":
        """Return the stacks of the same moments at all focus positions."""
        specs = tuple(replace(spec, window=(0, spec.positions - 1)) for spec in self.specs)
        return TimeResolvedStack(self.slice_frames, specs)

    def without_diffraction(self) -> "TimeResolvedStack":
        """Return the stacks of the same moments without diffraction."""
        return replace(self, specs=tuple(replace(spec, wavelength_m=0.0) for spec in self.specs))

    def truncated_to(self, frames: float) -> "TimeResolvedStack":
        """Return the stacks that the first ``frames`` readouts need, including the one after them."""
        count = 1 + sum(frame < frames for frame in self.slice_frames)
        return TimeResolvedStack(self.slice_frames[:count], self.specs[:count])

    def count_stored(self, root: Path) -> int:
        """Return how many stacks are stored under ``root`` before the first missing one, without reading them."""
        return sum(1 for _ in takewhile(lambda spec: StackStore(root, spec).has_all_pictures(), self.specs))

    def has_grain(self, root: Path) -> bool:
        """Return whether grain has been measured for any of the stacks under ``root``."""
        return any(read_grain(root, spec) is not None for spec in self.specs)

    def find_missing(self, root: Path) -> list[StackSpec]:
        """Return the stacks that are missing, incomplete or damaged under ``root``."""
        return [spec for spec in self.specs if StackStore(root, spec).missing_pieces()]

    def has_all_notes(self, root: Path) -> bool:
        """Return whether the notes of all stacks exist, even if their pictures have been deleted."""
        return all(StackStore(root, spec).has_all_notes() for spec in self.specs)

    def digest(self, root: Path) -> str:
        """Return a SHA-256 over the stacks as they are stored under ``root``."""
        digests = [StackStore(root, spec).digest() for spec in self.specs]
        return digests[0] if len(digests) == 1 else hashlib.sha256(" ".join(digests).encode()).hexdigest()

    def split_at_slices(self, begin: int, end: int) -> Iterator[FrameRun]:
        """Yield frames begin <= t < end in runs between the same two stacks; one run for a static scene."""
        if not self.is_moving:
            yield FrameRun(begin, end, 0)
            return
        for j, (first, last) in enumerate(pairwise(self.slice_frames)):
            if first < end and last > begin:
                yield FrameRun(max(first, begin), min(last, end), j)

    def interpolation_weight(self, run: FrameRun) -> np.ndarray:
        """Return the weight of the later stack in each readout of a run, float64, 0 to 1."""
        first, last = self.slice_frames[run.slice_index], self.slice_frames[run.slice_index + 1]
        return (np.arange(run.begin, run.end) + 0.5 - first) / (last - first)


@dataclass(frozen=True)
class PlaneSource:
    """Source from which the image planes of a time-resolved stack are read.

    Attributes
    ----------
    time_stack : TimeResolvedStack
        Focal stacks of the recording.
    load_planes : callable
        Called with (j, first, stop); returns the radiance of stack j at its rendered positions first <= k < stop,
        float32 (light, focus, row, col).
    load_geometry : callable
        Called with (j); returns the depth and the target mask of stack j.
    digest : str
        SHA-256 over all stacks.
    backend : str
        Backend that rendered the stacks.
    load_grain : callable
        Called with (j); returns the grain of stack j, or None if it was not measured.
    """

    time_stack: TimeResolvedStack
    load_planes: Callable[[int, int, int], np.ndarray]
    load_geometry: Callable[[int], tuple[np.ndarray, np.ndarray]]
    digest: str
    backend: str
    load_grain: Callable[[int], StackGrain | None] = lambda j: None

    @classmethod
    def from_folder(cls, time_stack: TimeResolvedStack, root: Path) -> "PlaneSource":
        """Return the stacks stored under ``root``; loading from an incomplete stack raises BadInput."""
        stores = [StackStore(root, spec) for spec in time_stack.specs]
        return cls(
            time_stack,
            lambda j, first, stop: stores[j].load_planes(first, stop),
            lambda j: stores[j].load_geometry(),
            time_stack.digest(root),
            ", ".join(sorted(set().union(*(store.backends() for store in stores)))),
            lambda j: read_grain(root, time_stack.specs[j]),
        )

    @classmethod
    def from_stack(cls, stack: FocalStack) -> "PlaneSource":
        """Return a source of one stack of a static scene, which is in memory."""
        return cls(
            TimeResolvedStack((0,), (stack.spec,)),
            lambda j, first, stop: stack.radiance[:, first:stop],
            lambda j: (stack.depth, stack.target),
            stack.digest,
            stack.backend,
        )


def slice_starts(frames: int, *, readout_hz: float, slices_per_s: float) -> tuple[int, ...]:
    """Return the frames at which a moving scene is rendered, from 0 to the first one at or after the end.

    They are multiples of 8 frames, and give ``slices_per_s`` slices per second or a few more.
    """
    step = max(FRAMES_PER_BYTE, int(readout_hz / slices_per_s) // FRAMES_PER_BYTE * FRAMES_PER_BYTE)
    return tuple(range(0, frames + step, step))


def slice_moments(times_s: Sequence[float]) -> list[tuple[float, ...]]:
    """Return, for each time slice, the moments (s) whose light paths give its shading: its own and those before it.

    The first slice replaces each moment before it, and contributes different paths each time.
    """
    return [tuple(times_s[max(n - back, 0)] for back in reversed(range(SHADING_MOMENTS))) for n in range(len(times_s))]


def slice_windows(position: np.ndarray, slice_frames: tuple[int, ...], *, positions: int) -> list[tuple[int, int]]:
    """Return the first and last focus position that a recording needs from each time slice, at least two each.

    ``position`` (T,) is the position of the lens, 0 to 1. A stack is used in the readouts from the previous slice's
    moment to the next slice's moment.
    """
    knots = np.clip(np.asarray(position, dtype=np.float64), 0, 1) * (positions - 1)
    windows = []
    for j in range(len(slice_frames)):
        begin = slice_frames[max(j - 1, 0)]
        end = min(slice_frames[min(j + 1, len(slice_frames) - 1)], knots.size)
        used = knots[min(begin, knots.size - 1) : max(end, begin + 1)]
        first = min(int(np.floor(used.min())), positions - 2)
        windows.append((first, max(int(np.ceil(used.max())), first + 1)))
    return windows
