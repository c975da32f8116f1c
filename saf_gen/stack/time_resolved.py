"""What a recording films: one focal stack, or for a scene that moves a focal stack at each of many moments.

Between two moments the picture goes over from one stack to the other in a straight line. A readout at the
share w of the way, at its own focus position, sees (1 - w) of the stack before and w of the one after, each
interpolated between its own two nearest positions. The encoder takes the two as two sets of lights, so that
this is exact at every readout.
"""

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise, takewhile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from saf_gen.stack.focal_stack import FocalStack, StackSpec, StackStore

__all__ = ["FrameRun", "PlaneSource", "TimeResolvedStack", "needed_focus_windows", "time_slice_frames"]

FRAMES_PER_BYTE = (
    8  # frames: the encoder records whole bytes, and goes over to the next pair of stacks between two
)


class FrameRun(NamedTuple):
    """Frames ``begin <= t < end`` between two time slices; ``slice_index`` counts the earlier one."""

    begin: int
    end: int
    slice_index: int


@dataclass(frozen=True)
class TimeResolvedStack:
    """The stacks of a recording, and at the beginning of which frame each is what is seen.

    One stack: nothing moves. More: rising frames from 0 to at least the length of the recording.
    """

    slice_frames: tuple[int, ...]
    specs: tuple[StackSpec, ...]

    @property
    def is_moving(self) -> bool:
        """Whether the scene moves."""
        return len(self.specs) > 1

    def with_full_travel(self) -> "TimeResolvedStack":
        """The same moments at all focus positions."""
        return TimeResolvedStack(
            self.slice_frames, tuple(replace(s, window=(0, s.positions - 1)) for s in self.specs)
        )

    def truncated_to(self, frames: float) -> "TimeResolvedStack":
        """The stacks of the first ``frames`` readouts, the one after them too: pictures go over to it."""
        count = 1 + sum(frame < frames for frame in self.slice_frames)
        return TimeResolvedStack(self.slice_frames[:count], self.specs[:count])

    def count_stored(self, root: Path) -> int:
        """How many of the first stacks lie under ``root``, to its notes."""
        return sum(1 for _ in takewhile(lambda spec: StackStore(root, spec).has_all_notes(), self.specs))

    def find_missing(self, root: Path) -> list[StackSpec]:
        """The stacks that are not whole under ``root``."""
        return [spec for spec in self.specs if StackStore(root, spec).missing_pieces()]

    def digest(self, root: Path) -> str:
        """What is made from these very stacks, as they lie under ``root``, is made from this."""
        digests = [StackStore(root, spec).digest() for spec in self.specs]
        return digests[0] if len(digests) == 1 else hashlib.sha256(" ".join(digests).encode()).hexdigest()

    def split_at_slices(self, begin: int, end: int) -> Iterator[FrameRun]:
        """The stretches of frames begin <= t < end that lie between the same two stacks.

        Yields first frame, end, and the number of the stack before; all in one where nothing moves.
        """
        if not self.is_moving:
            yield FrameRun(begin, end, 0)
            return
        for j, (first, last) in enumerate(pairwise(self.slice_frames)):
            if first < end and last > begin:
                yield FrameRun(max(first, begin), min(last, end), j)

    def interpolation_weight(self, run: FrameRun) -> np.ndarray:
        """How far each readout begin <= t < end is on the way from stack j to the next: float64, 0...1."""
        first, last = self.slice_frames[run.slice_index], self.slice_frames[run.slice_index + 1]
        return (np.arange(run.begin, run.end) + 0.5 - first) / (last - first)


@dataclass(frozen=True)
class PlaneSource:
    """A time_stack and where its stacks come from.

    ``load_planes(j, first, stop)`` is the radiance of stack j at its rendered positions first <= k < stop,
    float32 (light, focus, row, col); ``load_geometry(j)`` its depth and target. ``digest`` is over all
    stacks, ``variant`` what rendered them.
    """

    time_stack: TimeResolvedStack
    load_planes: Callable[[int, int, int], np.ndarray]
    load_geometry: Callable[[int], tuple[np.ndarray, np.ndarray]]
    digest: str
    backend: str

    @classmethod
    def from_folder(cls, time_stack: TimeResolvedStack, root: Path) -> "PlaneSource":
        """The reel's stacks as they lie under ``root``; one that is not whole is refused in its turn."""
        stores = [StackStore(root, spec) for spec in time_stack.specs]
        variant = ", ".join(sorted(set().union(*(store.backends() for store in stores))))
        digest = time_stack.digest(root)
        return cls(
            time_stack,
            lambda j, first, stop: stores[j].load_planes(first, stop),
            lambda j: stores[j].load_geometry(),
            digest,
            variant,
        )

    @classmethod
    def from_stack(cls, stack: FocalStack) -> "PlaneSource":
        """One stack in memory, of a scene that stands still."""
        time_stack = TimeResolvedStack((0,), (stack.spec,))
        return cls(
            time_stack,
            lambda j, first, stop: stack.radiance[:, first:stop],
            lambda j: (stack.depth, stack.target),
            stack.digest,
            stack.backend,
        )


def time_slice_frames(frames: int, *, readout_hz: float, slices_per_s: float) -> tuple[int, ...]:
    """Frames, from 0 to the first at or after the end, at which a moving scene is rendered.

    As many a second as asked for, or a few more: multiples of 8 frames, at least 8 apart.
    """
    step = max(FRAMES_PER_BYTE, int(readout_hz / slices_per_s) // FRAMES_PER_BYTE * FRAMES_PER_BYTE)
    return tuple(range(0, frames + step, step))


def needed_focus_windows(
    position: np.ndarray, at: tuple[int, ...], *, positions: int
) -> list[tuple[int, int]]:
    """For each of these moments the first and last rendered position that the recording needs there.

    ``position`` (T,) is the lens, fraction of the travel: a stack serves the readouts from the moment before
    it to the one after. At least two positions each.
    """
    place = np.clip(np.asarray(position, dtype=np.float64), 0, 1) * (positions - 1)
    out = []
    for j in range(len(at)):
        begin, end = at[max(j - 1, 0)], min(at[min(j + 1, len(at) - 1)], place.size)
        used = place[min(begin, place.size - 1) : max(end, begin + 1)]
        first = min(int(np.floor(used.min())), positions - 2)
        out.append((first, max(int(np.ceil(used.max())), first + 1)))
    return out
