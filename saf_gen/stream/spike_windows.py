"""Windows of spikes for training networks: inputs and targets from a dataset, read quickly in any order.

This module needs no deep-learning library and works with all of them: ``torch.utils.data.DataLoader``, for example,
accepts :class:`SpikeWindows` as a map-style dataset. :mod:`saf_gen.torch` returns the same windows as tensors.
"""

import hashlib
import json
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from operator import getitem, index
from pathlib import Path
from typing import Any

import numpy as np

from saf_gen.core.region import Region, bounding_box, region_shape
from saf_gen.core.user_folder import cache_folder
from saf_gen.errors import BadInput, unknown
from saf_gen.stream.count_cache import KeptCounts, counts_dtype
from saf_gen.stream.event_file import has_events
from saf_gen.stream.frame_file import has_frames
from saf_gen.stream.manifest import (
    SequenceEntry,
    check_content,
    check_entry,
    check_single_split,
    read_manifest,
    stem_of,
)
from saf_gen.stream.sample_dataset import SAMPLE, find_data, sample
from saf_gen.stream.stream_file import SpikeStream, open_stream

COUNTS_FOLDER = "counts"
TARGETS = ("error", "position", "depth", "blur")


@dataclass(frozen=True)
class Window:
    """A window of frames ``first <= t < stop`` of one sequence."""

    sequence: SequenceEntry
    first: int
    stop: int


@dataclass(frozen=True)
class _Sequence:
    """Counts and targets of the windows of a sequence; the stream is open only if a function of the user reads it.

    ``target_at`` returns the target of a window from its number in the sequence.
    """

    counts: KeptCounts
    target_at: Callable[[int], Any]
    stream: SpikeStream


class SpikeWindows:
    """Numbered windows of spike counts from a dataset, each with the target that a network should predict.

    ``windows[i]`` is a tuple (counts, target), where the counts are the spikes per pixel in the window, float32
    (1, h, w). When the first window of a sequence is requested, its file is compared with the manifest, and all its
    windows are counted and kept in a file, from which any number of processes read them quickly in any order. The
    object can be pickled and used in forked processes.

    Parameters
    ----------
    dataset : str or Path
        Dataset folder, or its name as on the command line, such as ``sample``.
    split : str, optional
        Split to use, or ``all``. A dataset with several splits needs it, so that a network does not learn on the test
        split by mistake.
    window : int, default 100
        Frames per window.
    stride : int, optional
        Frames from the start of one window to the start of the next; by default ``window``, so that windows do not
        overlap.
    crop : tuple of int, optional
        Rows and columns of the box to cut out around the middle of the target, or of the frame if the stream has no
        target; the box is shifted into the frame. By default the whole frame is used.
    target : str or callable, default "error"
        ``error`` is the move that brings the lens into focus: the truth minus the position of the lens. ``position`` is
        the truth. Both are fractions of the travel in the middle of the window, float32 (). ``depth`` is the depth of
        what each pixel shows, in metres, and ``blur`` the signed diameter of its blur in the middle of the window, in
        pixels (:meth:`SpikeStream.blur`), both float32 (h, w) of the same pixels as the counts. A function of
        (stream, first, stop) may return anything.
    counts : str or Path, optional
        Folder that keeps the counts: one byte per window and pixel, or two for windows of more than 255 frames. By
        default ``counts`` in the dataset or, for the sample, in the user's cache folder. It may be deleted when
        nothing reads it.

    Attributes
    ----------
    windows : list of Window
        The sequence and the frames of each window.

    Raises
    ------
    BadInput
        If the folder is not a dataset, the split or target is unknown, the dataset has several splits and none is
        given, its recordings hold events or frames, or a number is not allowed; and, when a window is read, if the
        stream lacks the truth, the lens positions or the aperture that its target needs, if its scene moves and the
        target is its depth or blur, if ``crop`` is not within the frame, if the stream is not the one that the manifest
        lists, if the folder for the counts cannot be written, if kept counts were changed, or if the number of the
        window is not an integer.
    IndexError
        If there is no window of this number.
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
        dataset = find_data(Path(dataset))
        manifest = read_manifest(dataset)
        if split is None:
            check_single_split(manifest.splits, where=str(dataset))
        splits = manifest.splits if split is None else manifest.select_splits(split, where=str(dataset))
        if isinstance(target, str) and target not in TARGETS:
            raise unknown("target", target, allowed=TARGETS, hint="or pass a function of (stream, first, stop)")
        entries = [entry for entry in manifest.sequences if entry.split in splits]
        if not entries:
            raise BadInput("holds no recordings", where=str(dataset), hint="make them with saf-gen generate")
        _check_bits(Path(dataset) / entries[0].file)
        shortest = min(entries, key=lambda entry: entry.frames)
        where = str(Path(dataset) / shortest.file)
        self.window = _positive_integer("window", window, max_value=shortest.frames, where=where)
        self.stride = self.window if stride is None else _positive_integer("stride", stride)
        self.dataset, self.crop, self.target = Path(dataset), crop, target
        self.counts = _counts_folder(self.dataset) if counts is None else Path(counts)
        self.windows = [
            Window(entry, first, first + self.window)
            for entry in entries
            for first in range(0, entry.frames - self.window + 1, self.stride)
        ]
        self._file_digests = manifest.file_digests
        self._sequences: dict[str, _Sequence] = {}

    def __len__(self) -> int:
        return len(self.windows)

    def __getitem__(self, number: int) -> tuple[np.ndarray, Any]:
        window = self._window(number)
        sequence, at = self._sequence(window.sequence), window.first // self.stride
        return sequence.counts.read(at).astype(np.float32)[None], sequence.target_at(at)

    def _window(self, number: int) -> Window:
        what, allowed = f"the number of a window is {number!r:.60}", f"a whole number below {len(self)}"
        try:
            return self.windows[index(number)]
        except TypeError as error:
            raise BadInput(what, where=str(self.dataset), allowed=allowed, hint="read them one by one") from error
        except IndexError as error:  # by which Python ends a loop over the windows
            raise IndexError(f"{self.dataset}: {what}; allowed: {allowed}") from error

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_sequences": {}}

    def close(self) -> None:
        """Close all open streams, which are opened again when needed."""
        for sequence in self._sequences.values():
            sequence.stream.close()
        self._sequences.clear()

    def _sequence(self, entry: SequenceEntry) -> _Sequence:
        """Return the counts and targets of a sequence; its windows are counted now unless a file of counts exists."""
        if entry.id not in self._sequences:
            firsts = np.arange(0, entry.frames - self.window + 1, self.stride)
            with ExitStack() as undo:
                stream = undo.enter_context(open_stream(self.dataset / entry.file))
                check_entry(stream, entry)
                counts = self._keep_counts(stream, entry, firsts=firsts)
                target_at = self._target_of(stream, firsts)
                if callable(self.target):
                    undo.pop_all()  # the target function reads the open stream
                self._sequences[entry.id] = _Sequence(counts, target_at, stream)
        return self._sequences[entry.id]

    def _keep_counts(self, stream: SpikeStream, entry: SequenceEntry, *, firsts: np.ndarray) -> KeptCounts:
        box = self._box(stream)
        sides = [[side.start, side.stop] for side in box]
        key = json.dumps([stream.content_sha256, self.window, self.stride, sides])
        stem_of(entry, where=str(stream.path))
        path = self.counts / f"{entry.id}-{hashlib.sha256(key.encode()).hexdigest()[:12]}.npy"
        kept = KeptCounts(path, (len(firsts), *region_shape(box)), counts_dtype(self.window), key)
        if not kept.is_there():
            check_content(stream, self._file_digests.get(entry.file))
            kept.write(stream.counts_of_windows(firsts, self.window, region=box))
        return kept

    def _box(self, stream: SpikeStream) -> Region:
        frame = stream.shape[1:]
        if self.crop is None:
            return slice(0, frame[0]), slice(0, frame[1])
        try:
            crop = tuple(map(index, self.crop))
        except TypeError:
            crop = ()
        if not (len(crop) == 2 and all(1 <= n <= length for n, length in zip(crop, frame, strict=True))):
            raise BadInput(f"crop is {self.crop!r:.60}", where=str(stream.path), allowed=f"(1, 1) to {frame}")
        mask = stream.truth.target
        full_frame = slice(0, frame[0]), slice(0, frame[1])
        box = bounding_box(mask) if mask is not None and np.any(mask) else full_frame
        begins = [
            min(max((side.start + side.stop - n) // 2, 0), length - n)
            for side, n, length in zip(box, crop, frame, strict=True)
        ]
        return slice(begins[0], begins[0] + crop[0]), slice(begins[1], begins[1] + crop[1])

    def _target_of(self, stream: SpikeStream, firsts: np.ndarray) -> Callable[[int], Any]:
        """Return the function that returns the target of the window which begins at ``firsts[at]``, from ``at``."""
        if callable(self.target):
            chosen = self.target
            return lambda at: chosen(stream, int(firsts[at]), int(firsts[at]) + self.window)
        moments = firsts + self.window // 2
        if self.target in ("error", "position"):
            return partial(getitem, self._targets_at(stream, moments))
        from saf_gen.stream.defocus_blur import DefocusBlur, known_depth  # the optics take half a second to load

        if self.target == "depth":
            depth = known_depth(stream)[self._box(stream)].copy()
            return lambda at: depth.copy()  # a network may change its targets in place
        blur = DefocusBlur.of_stream(stream, region=self._box(stream))
        return lambda at: blur.at(int(moments[at]))

    def _targets_at(self, stream: SpikeStream, moments: np.ndarray) -> np.ndarray:
        """Return the targets at these frames, float32: the truth, or the truth minus the position of the lens."""
        track, position = stream.truth.track, stream.metadata.lens_position
        if not stream.truth.known:
            raise _missing_metadata_error(stream, "its true focus")
        truth = np.full(len(moments), stream.truth.position) if track is None else track[moments]
        if self.target == "position":
            return truth.astype(np.float32)
        if position is None:
            raise _missing_metadata_error(stream, "the positions of its lens")
        return (truth - position[moments]).astype(np.float32)


def _check_bits(path: Path) -> None:
    """Raise BadInput if the recording holds events or frames, as :func:`open_stream` does; read no counts.

    One camera has recorded a dataset, so that its first recording tells. A missing file is reported with its windows.
    """
    if has_events(path) or has_frames(path):
        open_stream(path).close()


def _missing_metadata_error(stream: SpikeStream, what: str) -> BadInput:
    return BadInput(
        f"does not state {what}", where=str(stream.path), allowed="streams that do", hint="or pass a function as target"
    )


def _positive_integer(what: str, value: int, *, max_value: int | None = None, where: str = "") -> int:
    try:
        number = index(value)
    except TypeError:
        number = 0
    if number < 1 or (max_value is not None and number > max_value):
        allowed = "a whole number, at least 1" + ("" if max_value is None else f", at most {max_value}")
        raise BadInput(f"{what} is {value!r:.60}", where=where, allowed=allowed)
    return number


def _counts_folder(dataset: Path) -> Path:
    """Return where counts are kept: in the dataset or, for the sample, which belongs to the package, in the cache."""
    if dataset.resolve() != sample().resolve():
        return dataset / COUNTS_FOLDER
    return (cache_folder() or Path.cwd()) / SAMPLE / COUNTS_FOLDER
