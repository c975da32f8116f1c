"""Small pictures of recordings for a page, and the choice of the recordings to show."""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np

from saf_gen.core.region import Region
from saf_gen.stream.stream_file import SpikeStream

THUMBNAIL_COUNT = 48
MAX_WIDTH_PX = 400
"""Maximum width of a picture, in pixels; a wider sensor is binned."""
SPIKES_WIDTH_PX = 140
"""Maximum width of the part of the sensor that is shown spike by spike, in pixels."""


@dataclass(frozen=True, eq=False)
class Thumbnails:
    """Pictures of consecutive windows of a recording, each in three forms: counts, intervals and single spikes."""

    images: np.ndarray
    """Texture from playback (TFP): spikes in the window, summed over ``binning`` × ``binning`` pixels; uint32
    (n, h, w)."""
    textures: np.ndarray
    """Interval texture (TFI): the counts that the intervals imply, summed in the same way; float32 (n, h, w)."""
    spikes: np.ndarray
    """Readout in the middle of each window, in a part of the sensor, 0 or 1; uint8 (n, h', w')."""
    frames: np.ndarray
    """Centres of the windows, in frames, shape (n,)."""
    window: int
    """Number of frames per window."""
    binning: int
    """Side of the squares over which spikes are summed, in pixels."""
    box: tuple[float, float, float, float]
    """Where measures look: top, left, bottom and right, as fractions of the picture."""


def make_thumbnails(stream: SpikeStream, region: Region | None) -> Thumbnails:
    """Return THUMBNAIL_COUNT pictures of a recording, or one per frame if it has fewer frames.

    Frames after the last full window, and rows and columns beyond a multiple of the binning, are left out.

    Parameters
    ----------
    stream : SpikeStream
        Open stream.
    region : Region or None
        Where measures look; None is the whole frame. The part that is shown spike by spike is around its centre.

    Returns
    -------
    Thumbnails
        The pictures.
    """
    frames, height, width = stream.shape
    window = max(frames // THUMBNAIL_COUNT, 1)
    firsts = (np.arange(min(THUMBNAIL_COUNT, frames)) * window).tolist()
    binning = -(-width // MAX_WIDTH_PX)
    rows, columns = max(height // binning, 1) * binning, max(width // binning, 1) * binning
    part = slice(0, rows), slice(0, columns)
    box = _to_fractions(region, (height, width))
    spikes_part = _select_part(box, (height, width))

    images, textures, spikes = [], [], []
    for first in firsts:
        middle = first + window // 2
        images.append(_bin_pixels(stream.counts(first, first + window, region=part), binning))
        texture = stream.texture(first, first + window, region=part)
        textures.append(_bin_pixels(texture.astype(np.float32), binning))
        spikes.append(stream.frames(middle, middle + 1, region=spikes_part)[0])
    return Thumbnails(
        images=np.stack(images),
        textures=np.stack(textures),
        spikes=np.stack(spikes),
        frames=np.array(firsts) + (window - 1) / 2,
        window=window,
        binning=binning,
        box=box,
    )


def select_to_show(keys: Sequence[tuple[Hashable, Hashable]], max_count: int) -> list[int]:
    """Return which of many sequences to show, so that few pictures show many scenes and many conditions.

    Scenes take turns, and each scene starts one condition later than the scene before it. Of sequences with the same
    scene and condition, only the first can be shown.

    Parameters
    ----------
    keys : sequence of (hashable, hashable)
        Scene and condition of each sequence.
    max_count : int
        Maximum number of sequences.

    Returns
    -------
    list of int
        Indices into ``keys``, in increasing order.
    """
    found: dict[Hashable, dict[Hashable, int]] = {}
    for index, (scene, condition) in enumerate(keys):
        found.setdefault(scene, {}).setdefault(condition, index)
    turns = [
        (turn, number, list(conditions.values())[(turn + number) % len(conditions)])
        for number, conditions in enumerate(found.values())
        for turn in range(len(conditions))
    ]
    return sorted(index for _, _, index in sorted(turns)[: max(max_count, 0)])


def _bin_pixels(image: np.ndarray, size: int) -> np.ndarray:
    """Return the sums of an image (row, col) over squares of ``size`` × ``size`` pixels, in the type of the image."""
    if size == 1:
        return image
    rows, columns = image.shape[0] // size, image.shape[1] // size
    binned: np.ndarray = image.reshape(rows, size, columns, size).sum(axis=(1, 3), dtype=image.dtype)
    return binned


def _select_part(box: tuple[float, float, float, float], size: tuple[int, int]) -> Region:
    """Return a region of at most SPIKES_WIDTH_PX columns around the centre of a box, in the sensor's aspect ratio."""
    height, width = size
    columns = min(width, SPIKES_WIDTH_PX)
    rows = max(round(columns * height / width), 1)
    top = round((box[0] + box[2]) / 2 * height - rows / 2)
    left = round((box[1] + box[3]) / 2 * width - columns / 2)
    top, left = min(max(top, 0), height - rows), min(max(left, 0), width - columns)
    return slice(top, top + rows), slice(left, left + columns)


def _to_fractions(region: Region | None, size: tuple[int, int]) -> tuple[float, float, float, float]:
    if region is None:
        return 0.0, 0.0, 1.0, 1.0
    rows, columns = region
    return rows.start / size[0], columns.start / size[1], rows.stop / size[0], columns.stop / size[1]
