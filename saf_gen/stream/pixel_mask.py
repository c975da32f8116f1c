"""Masks of bad pixels (dead, stuck or hot), and the rule that fills them in counts and pictures.

A masked pixel gets the mean of the valid pixels nearest to it: of the four beside it if they are valid, and in a
cluster of those at the smallest distance between centres. The mean of counts is rounded to the nearest whole number,
halves up. What was recorded is not changed; the rule is applied where counts and textures from intervals are read, so
that all focus measures see the same. The neighbours on both sides are used because a copy of one of them would shift a
slope by a pixel: in a simulated sweep, it changes the variance of the Laplacian by up to 10 %, the mean by 1 %.
"""

from functools import cached_property

import numpy as np

from saf_gen.core.region import Region, region_shape

Donors = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Masked pixels, int (n, 2); the pixels that fill them, int (m, 2), in turn; and where each begins, int (n,)."""

KEPT = 16
"""Number of regions whose neighbours are kept."""


class PixelMask:
    """A mask of bad pixels and their nearest valid pixels.

    Parameters
    ----------
    mask : ndarray of bool, shape (H, W)
        True for a bad pixel; at least one pixel is valid.
    """

    def __init__(self, mask: np.ndarray) -> None:
        self.mask = np.asarray(mask, bool)
        self._fillings: dict[tuple[int, ...], Filling] = {}

    def filling(self, region: Region) -> "Filling":
        """Return what fills a region; that of the regions used last is kept."""
        key = (region[0].start, region[0].stop, region[1].start, region[1].stop)
        if key not in self._fillings:
            if len(self._fillings) >= KEPT:
                self._fillings.clear()
            self._fillings[key] = Filling(self, region)
        return self._fillings[key]

    @cached_property
    def donors(self) -> Donors:
        """The masked pixels, and the valid pixels nearest to each."""
        from scipy.ndimage import distance_transform_edt  # imported only for streams with a mask

        distance = np.asarray(distance_transform_edt(self.mask))
        bad = np.argwhere(self.mask)
        squares = np.rint(distance[self.mask] ** 2).astype(np.int64)
        whose, found = [], []
        for square in np.unique(squares):
            at = np.flatnonzero(squares == square)
            for offset in _offsets(int(square)):
                near = bad[at] + offset
                is_inside = ((near >= 0) & (near < self.mask.shape)).all(axis=1)
                inside, near = at[is_inside], near[is_inside]
                is_valid = ~self.mask[near[:, 0], near[:, 1]]
                whose.append(inside[is_valid])
                found.append(near[is_valid])
        if not whose:
            return bad, np.empty((0, 2), np.int64), np.empty(0, np.int64)
        order = np.argsort(owner := np.concatenate(whose), kind="stable")
        return bad, np.concatenate(found)[order], np.searchsorted(owner[order], np.arange(len(bad)))


def _offsets(square: int) -> np.ndarray:
    """Return all whole offsets (rows, columns) whose squared length is ``square``, int (n, 2)."""
    reach = np.arange(-int(square**0.5), int(square**0.5) + 1)
    rows, columns = np.meshgrid(reach, reach, indexing="ij")
    return np.argwhere(rows**2 + columns**2 == square) - reach.size // 2


class Filling:
    """Fills the masked pixels of a region from their nearest valid pixels, which may lie outside it.

    Parameters
    ----------
    mask : PixelMask or None
        The mask of the whole frame; without one, nothing is filled.
    region : Region
        Rows and columns to fill.

    Attributes
    ----------
    region : Region
        The region to read: the smallest box with the region to fill and all pixels that fill it.
    """

    def __init__(self, mask: PixelMask | None, region: Region) -> None:
        self.region, self._inner = region, (slice(None), slice(None))
        self._targets = np.empty(0, np.int64)
        if mask is None or not mask.mask[region].any():
            return
        bad, near, starts = mask.donors
        (top, left), (bottom, right) = ([side.start for side in region], [side.stop for side in region])
        used = ((bad >= (top, left)) & (bad < (bottom, right))).all(axis=1)
        numbers = np.diff(starts, append=len(near))
        bad, near, self._numbers = bad[used], near[np.repeat(used, numbers)], numbers[used]
        (y0, x0), (y1, x1) = (
            np.minimum(near.min(axis=0), (top, left)),
            np.maximum(near.max(axis=0) + 1, (bottom, right)),
        )
        self.region = slice(int(y0), int(y1)), slice(int(x0), int(x1))
        self._inner = slice(top - int(y0), bottom - int(y0)), slice(left - int(x0), right - int(x0))
        width = region_shape(self.region)[1]
        self._targets, self._near = ((at - (y0, x0)) @ (width, 1) for at in (bad, near))
        self._starts = np.cumsum(self._numbers) - self._numbers

    def apply(self, image: np.ndarray) -> np.ndarray:
        """Return images (..., h, w) of the region to fill, from images of the region that was read.

        Without masked pixels in the region, this is ``image`` itself; otherwise it is a new array of the same type.
        """
        if not self._targets.size:
            return image
        flat = image.reshape(*image.shape[:-2], -1)
        is_whole = flat.dtype.kind in "ui"
        sums = np.add.reduceat(
            flat[..., self._near].astype(np.int64 if is_whole else flat.dtype), self._starts, axis=-1
        )
        flat = flat.copy()
        flat[..., self._targets] = (
            (2 * sums + self._numbers) // (2 * self._numbers) if is_whole else sums / self._numbers
        )
        return np.ascontiguousarray(flat.reshape(image.shape)[..., *self._inner])
