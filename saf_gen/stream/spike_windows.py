"""Windows of a dataset's spikes, to train a network with: what it sees and what it is to say, read fast in any order.

No deep-learning library is needed here, and any can take these: ``torch.utils.data.DataLoader`` reads a
:class:`SpikeWindows` as a map-style dataset. :mod:`saf_gen.torch` gives the same as tensors.
"""

import hashlib
import json
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from operator import index
from pathlib import Path
from typing import Any

import numpy as np

from saf_gen.core.region import Region, mask_bounding_box, region_shape
from saf_gen.errors import BadInput, unknown
from saf_gen.stream.manifest import SequenceEntry, read_manifest
from saf_gen.stream.stream_file import SpikeStream, open_stream
from saf_gen.stream.window_counts import KeptCounts, keep_stream_counts, type_of_stream_counts

COUNTS_FOLDER = "counts"
TARGETS = ("error", "position")


@dataclass(frozen=True)
class Window:
    """A window of frames ``first <= t < stop`` of one sequence."""

    sequence: SequenceEntry
    first: int
    stop: int


@dataclass(frozen=True)
class _Sequence:
    """Counts and targets of a sequence's windows. The stream is open where a function tells targets."""

    counts: KeptCounts
    targets: np.ndarray
    stream: SpikeStream


class SpikeWindows:
    """Windows of spike counts by number, each with what a network is to tell from it.

    ``windows[i]`` is (counts, target): counts float32 (1, h, w), spikes per pixel in the window. When a sequence is
    first asked for, all its windows are counted and kept in a file, from which any of them is read at once, in any
    order and by any number of processes. It can be pickled, and used in processes that were forked.

    Parameters
    ----------
    dataset : a dataset folder.
    split : the split to take; None takes all.
    window : frames in a window.
    stride : frames from one window to the next; None is ``window``, so that each frame is in one window.
    crop : (rows, columns) of the box to cut out round the middle of the target, moved so that it lies in the frame;
        None is the whole frame.
    target : ``error`` is how far the lens has to move, the truth less its position in the middle of the window, and
        ``position`` the truth, of that moment where the scene moves; both in fractions of the travel, float32 (). A
        function of (stream, first, stop) gives anything else.
    counts : the folder that keeps the counts, a byte for each window and pixel, two for windows of more than 255
        frames; None is ``counts`` in the dataset. Delete it when nothing reads it.

    Attributes
    ----------
    windows : the :class:`Window` of each number.

    Raises
    ------
    BadInput : a folder that is no dataset, an unknown split or target, numbers that do not fit; and, when a window is
        read, a stream without the truth that its target needs, or a folder for the counts that cannot be written.
    """

    def __init__(
        self,
        dataset: str | Path,
        split: str | None = None,
        *,
        window: int = 100,
        stride: int | None = None,
        crop: tuple[int, int] | None = None,
        target: str | Callable[[SpikeStream, int, int], Any] = "error",
        counts: str | Path | None = None,
    ) -> None:
        manifest = read_manifest(dataset)
        if split is not None and split not in manifest.splits:
            raise unknown("split", split, allowed=manifest.splits, where=str(dataset))
        if isinstance(target, str) and target not in TARGETS:
            raise unknown("target", target, allowed=TARGETS, hint="or a function of (stream, first, stop)")
        entries = [entry for entry in manifest.sequences if split in (None, entry.split)]
        shortest = min((entry.frames for entry in entries), default=0)
        self.window = _whole("window", window, most=shortest)
        self.stride = self.window if stride is None else _whole("stride", stride)
        self.dataset, self.crop, self.target = Path(dataset), crop, target
        self.counts = Path(dataset, COUNTS_FOLDER) if counts is None else Path(counts)
        self.windows = [
            Window(entry, first, first + self.window)
            for entry in entries
            for first in range(0, entry.frames - self.window + 1, self.stride)
        ]
        self._sequences: dict[str, _Sequence] = {}

    def __len__(self) -> int:
        return len(self.windows)

    def __getitem__(self, number: int) -> tuple[np.ndarray, Any]:
        window = self.windows[number]
        sequence, at = self._sequence(window.sequence), window.first // self.stride
        counts = sequence.counts.read(at).astype(np.float32)[None]
        if callable(self.target):
            return counts, self.target(sequence.stream, window.first, window.stop)
        return counts, sequence.targets[at]

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_sequences": {}}

    def close(self) -> None:
        """Close what is open; it is opened again when it is read."""
        for sequence in self._sequences.values():
            sequence.stream.close()
        self._sequences.clear()

    def _sequence(self, entry: SequenceEntry) -> _Sequence:
        """Return what is known of a sequence; the first time its windows are counted, unless another process did."""
        if entry.id not in self._sequences:
            firsts = np.arange(0, entry.frames - self.window + 1, self.stride)
            with ExitStack() as undo:
                stream = undo.enter_context(open_stream(self.dataset / entry.file))
                counts = self._keep_counts(stream, entry.id, firsts=firsts)
                if callable(self.target):
                    undo.pop_all()  # it is asked for each target
                    targets = np.empty(0, np.float32)
                else:
                    targets = self._tell(stream, firsts + self.window // 2)
                self._sequences[entry.id] = _Sequence(counts, targets, stream)
        return self._sequences[entry.id]

    def _keep_counts(self, stream: SpikeStream, name: str, *, firsts: np.ndarray) -> KeptCounts:
        box = self._box(stream)
        shape, dtype = (len(firsts), *region_shape(box)), type_of_stream_counts(self.window)
        sides = [[side.start, side.stop] for side in box]
        key = json.dumps([stream.content_sha256, self.window, self.stride, sides])
        path = self.counts / f"{name}-{hashlib.sha256(key.encode()).hexdigest()[:12]}.npy"
        with suppress(OSError, ValueError):  # not there, or damaged
            kept = KeptCounts.open(path)
            if (kept.shape, kept.dtype) == (shape, dtype):
                return kept
        pieces = stream.counts_of_windows(firsts, self.window, region=box)
        return keep_stream_counts(path, pieces, shape=shape, dtype=dtype)

    def _box(self, stream: SpikeStream) -> Region:
        frame = stream.shape[1:]
        if self.crop is None:
            return slice(0, frame[0]), slice(0, frame[1])
        if not (len(self.crop) == 2 and all(1 <= n <= most for n, most in zip(self.crop, frame, strict=True))):
            raise BadInput(f"crop is {self.crop}", where=str(stream.path), allowed=f"(1, 1) to {frame}")
        mask = stream.truth.target
        whole = slice(0, frame[0]), slice(0, frame[1])
        box = mask_bounding_box(mask) if mask is not None and np.any(mask) else whole
        begins = [
            min(max((side.start + side.stop - n) // 2, 0), most - n)
            for side, n, most in zip(box, self.crop, frame, strict=True)
        ]
        return slice(begins[0], begins[0] + self.crop[0]), slice(begins[1], begins[1] + self.crop[1])

    def _tell(self, stream: SpikeStream, moments: np.ndarray) -> np.ndarray:
        """Return the targets at these frames, float32."""
        track, position = stream.truth.track, stream.focus_position
        if not stream.truth.known:
            raise _lacking(stream, "its true focus")
        truth = np.full(len(moments), stream.truth.position) if track is None else track[moments]
        if self.target == "position":
            return truth.astype(np.float32)
        if position is None:
            raise _lacking(stream, "the positions of its lens")
        return (truth - position[moments]).astype(np.float32)


def _lacking(stream: SpikeStream, what: str) -> BadInput:
    return BadInput(
        f"does not state {what}", where=str(stream.path), allowed="streams that do", hint="or a target of your own"
    )


def _whole(what: str, value: int, *, most: int | None = None) -> int:
    try:
        number = index(value)
    except TypeError:
        number = 0
    if number < 1 or (most is not None and number > most):
        allowed = "a whole number, at least 1" + ("" if most is None else f", at most {most}")
        raise BadInput(f"{what} is {value!r}", allowed=allowed)
    return number
