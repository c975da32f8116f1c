"""The part of a frame that a camera focuses on: the box round the target."""

import numpy as np

from saf_gen.errors import BadInput

__all__ = ["Region", "target_box"]

Region = tuple[slice, slice]
"""Rows and columns."""


def target_box(target: np.ndarray, margin: int = 0) -> Region:
    """The rows and columns of the box round a target mask, widened by ``margin`` pixels, cut at the frame.

    ``target`` is bool (H, W). Raises BadInput for a mask without a pixel or a negative margin.
    """
    mask = np.asarray(target, dtype=bool)
    if mask.ndim != 2 or not mask.any():
        raise BadInput(
            f"target mask of shape {mask.shape} marks {int(mask.sum())} pixels",
            allowed="(rows, columns), at least one pixel marked",
            hint="use the whole frame: --region frame",
        )
    if margin < 0:
        raise BadInput(f"margin {margin}", allowed="0 or more pixels")
    rows, columns = (
        slice(max(int(along[0]) - margin, 0), min(int(along[-1]) + 1 + margin, size))
        for along, size in (
            (np.flatnonzero(mask.any(axis=1)), mask.shape[0]),
            (np.flatnonzero(mask.any(axis=0)), mask.shape[1]),
        )
    )
    return rows, columns
