"""Windows of a dataset's spikes, to train a network with: what it sees, what it is to say, and batches that read fast.

No deep-learning library is needed here, and any can take these: ``torch.utils.data.DataLoader`` reads a
:class:`SpikeWindows` as a map-style dataset and a :class:`WindowBatches` as its ``batch_sampler``.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from operator import index
from pathlib import Path
from typing import Any

import numpy as np

from saf_gen.core.region import Region, target_bounding_box
from saf_gen.core.seeds import make_generator
from saf_gen.errors import BadInput, unknown
from saf_gen.stream.manifest import SequenceEntry, read_manifest
from saf_gen.stream.stream_file import SpikeStream, open_stream
from saf_gen.stream.time_blocks import TIME_BLOCK_BYTES

BLOCK_FRAMES = 8 * TIME_BLOCK_BYTES
TARGETS = ("error", "position")


@dataclass(frozen=True)
class Window:
    """A window of frames ``first <= t < stop`` of one sequence."""

    sequence: SequenceEntry
    first: int
    stop: int


class SpikeWindows:
    """Windows of spike counts by number, each with what a network is to tell from it.

    ``windows[i]`` is (counts, target): counts float32 (1, h, w), spikes per pixel in the window. It can be pickled and
    used in processes that were forked; every process opens the streams for itself and keeps at most 512 MiB of them.

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

    Attributes
    ----------
    windows : the :class:`Window` of each number.

    Raises
    ------
    BadInput : a folder that is no dataset, an unknown split or target, numbers that do not fit; and, when a window is
        read, a stream without the truth that its target needs.
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
        self.windows = [
            Window(entry, first, first + self.window)
            for entry in entries
            for first in range(0, entry.frames - self.window + 1, self.stride)
        ]
        self._opened: dict[str, tuple[SpikeStream, Region | None]] = {}

    def __len__(self) -> int:
        return len(self.windows)

    def __getitem__(self, number: int) -> tuple[np.ndarray, Any]:
        window = self.windows[number]
        stream, region = self._open(window.sequence)
        counts = stream.counts(window.first, window.stop, region=region).astype(np.float32)[None]
        if callable(self.target):
            return counts, self.target(stream, window.first, window.stop)
        return counts, self._tell(stream, (window.first + window.stop) // 2)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_opened": {}}

    def close(self) -> None:
        """Close the streams; they are opened again when they are read."""
        for stream, _ in self._opened.values():
            stream.close()
        self._opened.clear()

    def _open(self, entry: SequenceEntry) -> tuple[SpikeStream, Region | None]:
        if entry.id not in self._opened:
            stream = open_stream(self.dataset / entry.file)
            self._opened[entry.id] = stream, self._box(stream)
        return self._opened[entry.id]

    def _box(self, stream: SpikeStream) -> Region | None:
        if self.crop is None:
            return None
        frame = stream.shape[1:]
        if not (len(self.crop) == 2 and all(1 <= n <= most for n, most in zip(self.crop, frame, strict=True))):
            raise BadInput(f"crop is {self.crop}", where=str(stream.path), allowed=f"(1, 1) to {frame}")
        mask = stream.truth.target
        whole = slice(0, frame[0]), slice(0, frame[1])
        box = target_bounding_box(mask) if mask is not None and np.any(mask) else whole
        begins = [
            min(max((side.start + side.stop - n) // 2, 0), most - n)
            for side, n, most in zip(box, self.crop, frame, strict=True)
        ]
        return slice(begins[0], begins[0] + self.crop[0]), slice(begins[1], begins[1] + self.crop[1])

    def _tell(self, stream: SpikeStream, middle: int) -> np.float32:
        track, position = stream.truth.track, stream.focus_position
        if not stream.truth.known:
            raise _lacking(stream, "its true focus")
        truth = stream.truth.position if track is None else track[middle]
        if self.target == "position":
            return np.float32(truth)
        if position is None:
            raise _lacking(stream, "the positions of its lens")
        return np.float32(truth - position[middle])


def _lacking(stream: SpikeStream, what: str) -> BadInput:
    return BadInput(
        f"does not state {what}", where=str(stream.path), allowed="streams that do", hint="or a target of your own"
    )


class WindowBatches:
    """Batches of window numbers, in another order each time, that read every stretch of a stream once.

    Spikes lie on the disk in blocks of 2,000 frames. Windows at random places would inflate a whole block for each of
    them. Here windows are shuffled among those of ``blocks`` blocks, which are drawn at random and lie in memory
    together. Batches go to ``workers`` processes in turn, as PyTorch's loader hands them out, each with its own blocks.

    Iterating gives lists of numbers, and moves on to the order of the next epoch; the last of a worker may be shorter.

    Parameters
    ----------
    windows : what to draw from.
    batch_size : windows in a batch.
    workers : the processes that read, at least 1.
    blocks : blocks that are shuffled together.
    seed : decides every order.
    """

    def __init__(
        self, windows: SpikeWindows, *, batch_size: int, workers: int = 1, blocks: int = 8, seed: int = 0
    ) -> None:
        self.windows, self.seed, self.epoch = windows, seed, 0
        self.batch_size, self.workers = _whole("batch_size", batch_size), _whole("workers", workers)
        self.blocks = _whole("blocks", blocks)

    def __len__(self) -> int:
        return sum(-(-len(queue) // self.batch_size) for queue in self._draw_queues())

    def __iter__(self) -> Iterator[list[int]]:
        queues = self._draw_queues()
        self.epoch += 1
        for begin in range(0, max(map(len, queues)), self.batch_size):
            for queue in queues:
                if begin < len(queue):
                    yield queue[begin : begin + self.batch_size]

    def _draw_queues(self) -> list[list[int]]:
        """Return the windows that each process will read, in order."""
        random = make_generator("windows", self.seed, self.epoch)
        in_block: dict[tuple[str, int], list[int]] = {}
        for number, window in enumerate(self.windows.windows):
            in_block.setdefault((window.sequence.id, window.first // BLOCK_FRAMES), []).append(number)
        blocks = list(in_block.values())
        order = random.permutation(len(blocks))
        queues: list[list[int]] = [[] for _ in range(self.workers)]
        for at in range(0, len(order), self.blocks):
            together = np.concatenate([blocks[i] for i in order[at : at + self.blocks]])
            min(queues, key=len).extend(random.permutation(together).tolist())
        return queues


def _whole(what: str, value: int, *, most: int | None = None) -> int:
    try:
        number = index(value)
    except TypeError:
        number = 0
    if number < 1 or (most is not None and number > most):
        allowed = "a whole number, at least 1" + ("" if most is None else f", at most {most}")
        raise BadInput(f"{what} is {value!r}", allowed=allowed)
    return number
