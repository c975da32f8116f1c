"""Small pictures of a recording for a page, and which recordings to show when there are many."""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np

from saf_gen.core.region import Region
from saf_gen.stream.stream_file import SpikeStream

THUMBNAIL_COUNT = 48
MAX_WIDTH_PX = 400
"""Widest picture, in pixels; a wider sensor is binned."""


@dataclass(frozen=True, eq=False)
class Thumbnails:
    """Texture from playback (TFP) of windows side by side, over a whole recording."""

    images: np.ndarray
    """uint32 (n, h, w): spikes in the window, summed over ``binning`` × ``binning`` pixels."""
    frames: np.ndarray
    """(n,) centres of the windows, frames."""
    window: int
    """Frames per window."""
    binning: int
    box: tuple[float, float, float, float]
    """Where measures look: top, left, bottom, right, as fractions of the picture."""


def make_recording_thumbnails(stream: SpikeStream, region: Region | None) -> Thumbnails:
    """Return THUMBNAIL_COUNT pictures of a recording, or one per frame where it has fewer frames.

    ``region`` is where measures look, None the whole frame. Frames beyond the last whole window, and rows and
    columns beyond a whole multiple of the binning, are left out.
    """
    frames, height, width = stream.shape
    window = max(frames // THUMBNAIL_COUNT, 1)
    first = np.arange(min(THUMBNAIL_COUNT, frames)) * window
    binning = -(-width // MAX_WIDTH_PX)
    rows, columns = max(height // binning, 1), max(width // binning, 1)
    whole_bins = (slice(0, rows * binning), slice(0, columns * binning)) if binning > 1 else None
    images = np.stack([_bin_pixels(stream.counts(a, a + window, region=whole_bins), binning) for a in first.tolist()])
    return Thumbnails(
        images=images,
        frames=first + (window - 1) / 2,
        window=window,
        binning=binning,
        box=_to_fractions(region, (height, width)),
    )


def select_sequences_to_show(keys: Sequence[tuple[Hashable, Hashable]], most: int) -> list[int]:
    """Return which of (scene, condition) to show, as rising indices into ``keys``, at most ``most``.

    Of equal pairs the first counts. Scenes take turns, each beginning with another condition than the scene before, so
    that few pictures show many scenes and many conditions.
    """
    found: dict[Hashable, dict[Hashable, int]] = {}
    for index, (scene, condition) in enumerate(keys):
        found.setdefault(scene, {}).setdefault(condition, index)
    turns = [
        (turn, number, list(conditions.values())[(turn + number) % len(conditions)])
        for number, conditions in enumerate(found.values())
        for turn in range(len(conditions))
    ]
    return sorted(index for _, _, index in sorted(turns)[: max(most, 0)])


def _bin_pixels(counts: np.ndarray, size: int) -> np.ndarray:
    if size == 1:
        return counts
    rows, columns = counts.shape[0] // size, counts.shape[1] // size
    binned: np.ndarray = counts.reshape(rows, size, columns, size).sum(axis=(1, 3), dtype=np.uint32)
    return binned


def _to_fractions(region: Region | None, size: tuple[int, int]) -> tuple[float, float, float, float]:
    if region is None:
        return 0.0, 0.0, 1.0, 1.0
    rows, columns = region
    return rows.start / size[0], columns.start / size[1], rows.stop / size[0], columns.stop / size[1]
