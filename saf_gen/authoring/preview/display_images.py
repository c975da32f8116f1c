"""Several images side by side in one file."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.image import imsave

from saf_gen.core.files import atomic_file

GAP = 4  # pixels between two images


def save_image_grid(rows: Sequence[Sequence[np.ndarray]], path: Path, *, max_bytes: int) -> None:
    """Write rows of grey images (0 to 1, of equal height in a row) as JPEG, with at most ``max_bytes`` if possible."""
    height = sum(row[0].shape[0] + GAP for row in rows) - GAP
    sheet = np.ones((height, max(sum(image.shape[1] + GAP for image in row) - GAP for row in rows)))
    y = 0
    for row in rows:
        x = 0
        for image in row:
            sheet[y : y + image.shape[0], x : x + image.shape[1]] = image
            x += image.shape[1] + GAP
        y += row[0].shape[0] + GAP
    with atomic_file(path) as temporary:
        for quality in (90, 85, 80, 70, 60, 45, 30):
            options = {"quality": quality, "optimize": True}
            imsave(temporary, sheet, cmap="gray", vmin=0, vmax=1, format="jpg", pil_kwargs=options)
            if temporary.stat().st_size <= max_bytes:
                break
