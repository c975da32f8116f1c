"""Time-resolved focal stacks: one stack of a static scene, or one at each of many moments of a moving scene.

Between two moments the image changes linearly from one stack to the next. A readout at the fraction w of the time
between them sees, at its focus position, (1 - w) of the earlier and w of the later stack, each interpolated between the
two nearest positions. The encoder gets the two stacks as two sets of lights, so that this is exact at every readout.
"""

import hashlib
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, takewhile
from pathlib import Path

import numpy as np

from saf_gen.camera.camera import Span
from saf_gen.stack.focal_stack import FocalStack, StackSpec, StackStore
from saf_gen.stack.grain import StackGrain, read_grain
from saf_gen.stack.second_render import stacks_to_repeat
from saf_gen.stream.metadata import Truth
from saf_gen.stream.recorded_grain import GrainMoment, RecordedGrain

SHADING_MOMENTS = 9  # number of moments whose light paths give the shading of a time slice, including its own
FRAMES_PER_BYTE = 8  # a camera writes whole bytes, so the stacks that it is given can change only between two bytes


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
        return len(self.slice_frames) > 1

    @property
    def holds_full_travel(self) -> bool:
        """Whether every stack holds all focus positions, as the closed loop needs."""
        return all(len(spec.drawn) == spec.positions for spec in self.specs)

    def with_full_travel(self) -> "TimeResolvedStack":
        """Return the stacks of the same moments at all focus positions."""
        return TimeResolvedStack(self.slice_frames, tuple(spec.over_travel() for spec in self.specs))

    def without_diffraction(self) -> "TimeResolvedStack":
        """Return the stacks of the same moments without diffraction."""
        return replace(self, specs=tuple(spec.without_diffraction() for spec in self.specs))

    def truncated_to(self, frames: float) -> "TimeResolvedStack":
        """Return the stacks that the first ``frames`` readouts need, including the one after them."""
        count = 1 + sum(frame < frames for frame in self.slice_frames)
        return TimeResolvedStack(self.slice_frames[:count], self.specs[:count])

    def count_stored(self, root: Path) -> int:
        """Return how many moments are stored under ``root`` before the first missing one, without reading them."""
        return sum(takewhile(bool, (StackStore(root, spec).has_all_pictures() for spec in self.specs)))

    def has_grain(self, root: Path) -> bool:
        """Return whether grain has been measured for all stacks under ``root`` for which it is measured at all.

        Depth and target of all stacks must be stored; otherwise BadInput is raised.
        """
        return all(read_grain(root, spec) is not None for spec in stacks_to_repeat(self.specs, root))

    def has_geometry(self, root: Path) -> bool:
        """Return whether depth and target of all stacks are stored under ``root``."""
        return all("geometry" not in StackStore(root, spec).missing_pieces() for spec in self.specs)

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

    def split_at_slices(self, begin: int, end: int) -> Iterator[Span]:
        """Yield frames begin <= t < end in runs that end at whole bytes; one run for a static scene.

        A run lies between two stacks, unless a stack belongs to a frame within a byte: these eight frames are a run of
        their own, among three stacks or more. Stacks of spike cameras belong to whole bytes; those of a camera with
        another rate need not.
        """
        if not self.is_moving:
            yield Span(begin, end, 0)
            return
        end = min(end, self.slice_frames[-1])
        while begin < end:
            j = bisect_right(self.slice_frames, begin) - 1
            stop = self.slice_frames[j + 1] // FRAMES_PER_BYTE * FRAMES_PER_BYTE
            if stop <= begin:
                stop = (begin // FRAMES_PER_BYTE + 1) * FRAMES_PER_BYTE
            yield Span(begin, min(stop, end), j)
            begin = stop

    def stacks_of(self, run: Span) -> range:
        """Return the indices of the stacks among which a run lies; of a static scene, that of its one stack."""
        if not self.is_moving:
            return range(1)
        last = bisect_left(self.slice_frames, run.end)
        return range(run.slice_index, max(last, run.slice_index + 1) + 1)

    def interpolation_weights(self, run: Span) -> np.ndarray:
        """Return the weight of each stack of a run in each of its readouts, float64 (readouts, stacks), 0 to 1."""
        starts, stacks = np.array(self.slice_frames), self.stacks_of(run)
        frames = np.arange(run.begin, run.end)
        before = np.searchsorted(starts, frames, side="right") - 1
        later = (frames + 0.5 - starts[before]) / (starts[before + 1] - starts[before])
        weights = np.zeros((frames.size, len(stacks)))
        weights[np.arange(frames.size), before - stacks.start] = 1 - later
        weights[np.arange(frames.size), before - stacks.start + 1] = later
        return weights


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


GRAIN_MOMENTS = 17  # along a recording of a still scene


def grain_along(
    plane_source: PlaneSource, truth: Truth, *, position: np.ndarray, gain: np.ndarray
) -> RecordedGrain | None:
    """Return the grain at moments along a recording, or None if the grain of its stacks is not known.

    A still scene is evaluated at evenly spaced frames, and in the frame in which the lens is nearest to the truth; a
    moving scene at the slices whose grain was measured. Between two rendered positions or slices, a recording mixes
    pictures, which lowers independent noise. The figure of the nearest picture is used, and is thus too large rather
    than too small.

    Parameters
    ----------
    plane_source : PlaneSource
        Focal stacks of the recording.
    truth : Truth
        True focus; ``position`` and ``track`` are used.
    position : ndarray, shape (T,)
        Position of the lens in each readout, 0 to 1.
    gain : ndarray, shape (T, light)
        Gains of the light groups.
    """
    time_stack = plane_source.time_stack
    last = len(position) - 1
    off = np.abs(position - (truth.position if truth.track is None else truth.track))
    if time_stack.is_moving:
        found = {min(frame, last): j for j, frame in enumerate(time_stack.slice_frames)}
        measured = {t: (j, grain) for t, j in found.items() if (grain := plane_source.load_grain(j)) is not None}
    else:
        still_grain = plane_source.load_grain(0)
        frames = chain(
            np.linspace(0, last, min(GRAIN_MOMENTS, last + 1)).round().astype(int).tolist(), [int(off.argmin())]
        )
        measured = {} if still_grain is None else {t: (0, still_grain) for t in frames}
    if not measured:
        return None
    moments = tuple(
        _grain_moment(plane_source, t, j=j, grain=grain, position=float(position[t]), gain=gain[t])
        for t, (j, grain) in sorted(measured.items())
    )
    focus = min(range(len(moments)), key=lambda n: off[moments[n].frame])
    return RecordedGrain(moments, focus, next(iter(measured.values()))[1].samples)


def _grain_moment(
    plane_source: PlaneSource, frame: int, *, j: int, grain: StackGrain, position: float, gain: np.ndarray
) -> GrainMoment:
    spec = plane_source.time_stack.specs[j]
    measured = spec.focus[grain.indices]
    index = int(np.abs(measured - position).argmin())
    rms, noise, signal = grain.mix(index, gain)
    return GrainMoment(frame, float(measured[index]), rms, noise, signal)
