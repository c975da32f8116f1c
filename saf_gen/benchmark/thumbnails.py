"""Small pictures of a recording, as a page shows them; and which recordings to show when there are many."""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np

from saf_gen.core.region import Region
from saf_gen.stream.stream_file import SpikeStream

__all__ = ["Thumbnails", "make_thumbnails", "select_sequences_to_show"]

THUMBNAIL_COUNT = 48
MAX_WIDTH_PX = 400
"""Pixels; a wider sensor is shown smaller."""


@dataclass(frozen=True, eq=False)
class Thumbnails:
    """Texture from playback (TFP) of windows side by side, over a whole recording."""

    images: np.ndarray
    """uint32 (n, h, w): spikes in the window, summed over ``binning`` × ``binning`` pixels."""
    frames: np.ndarray
    """(n,) centres of the windows, frames."""
    window: int
    """Frames of a window."""
    binning: int
    box: tuple[float, float, float, float]
    """Where measures look: top, left, bottom, right, as fractions of the picture."""


def make_thumbnails(stream: SpikeStream, region: Region | None) -> Thumbnails:
    """THUMBNAIL_COUNT pictures of a recording, fewer of one that is shorter; every spike is in one, but for
    a rest.

    ``region`` is where measures look, None the whole frame. Rows and columns beyond a whole multiple of the
    binning are left out.
    """
    frames, height, width = stream.shape
    window = max(frames // THUMBNAIL_COUNT, 1)
    first = np.arange(min(THUMBNAIL_COUNT, frames)) * window
    binned = -(-width // MAX_WIDTH_PX)
    rows, columns = max(height // binned, 1), max(width // binned, 1)
    cut = (slice(0, rows * binned), slice(0, columns * binned)) if binned > 1 else None
    images = np.stack([_binned(stream.counts(int(a), int(a) + window, region=cut), binned) for a in first])
    return Thumbnails(images, first + (window - 1) / 2, window, binned, _box(region, (height, width)))


def select_sequences_to_show(keys: Sequence[tuple[Hashable, Hashable]], most: int) -> list[int]:
    """Which of (scene, condition) to show where all are too many: places in ``keys``, rising.

    The first of each pair counts. Scenes take turns, each with a condition that the one before did not
    begin with, so that few pictures show many scenes and many conditions.
    """
    found: dict[Hashable, dict[Hashable, int]] = {}
    for place, (scene, condition) in enumerate(keys):
        found.setdefault(scene, {}).setdefault(condition, place)
    turns = [
        (turn, number, list(conditions.values())[(turn + number) % len(conditions)])
        for number, conditions in enumerate(found.values())
        for turn in range(len(conditions))
    ]
    return sorted(place for _, _, place in sorted(turns)[: max(most, 0)])


def _binned(counts: np.ndarray, size: int) -> np.ndarray:
    if size == 1:
        return counts
    rows, columns = counts.shape[0] // size, counts.shape[1] // size
    binned: np.ndarray = counts.reshape(rows, size, columns, size).sum(axis=(1, 3), dtype=np.uint32)
    return binned


def _box(region: Region | None, size: tuple[int, int]) -> tuple[float, float, float, float]:
    if region is None:
        return 0.0, 0.0, 1.0, 1.0
    rows, columns = region
    return rows.start / size[0], columns.start / size[1], rows.stop / size[0], columns.stop / size[1]
