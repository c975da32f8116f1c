"""Radiance as a picture for the eye, and pictures side by side as one file."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.image import imsave

from saf_gen.core.files import write_atomically

__all__ = ["encode_gamma", "save_image_grid", "white_level"]

WHITE_QUANTILE = 0.995  # of the pixels lie below white: a glint does not darken the rest
GAP = 4  # pixels between two pictures


def white_level(*images: np.ndarray) -> float:
    """The radiance to show as white in all of these pictures, above 0."""
    brightest = max(float(np.quantile(image, WHITE_QUANTILE)) for image in images)
    return brightest if brightest > 0 else 1.0


def encode_gamma(image: np.ndarray, white: float) -> np.ndarray:
    """Linear radiance as grey values 0...1, encoded for the eye with a gamma of 2.2."""
    shown: np.ndarray = np.clip(image / white, 0, 1) ** (1 / 2.2)
    return shown


def save_image_grid(rows: Sequence[Sequence[np.ndarray]], path: Path, *, max_bytes: int) -> None:
    """Write grey pictures (0...1, of one height in a row) as JPEG, below ``max_bytes`` if it can be."""
    height = sum(row[0].shape[0] + GAP for row in rows) - GAP
    width = max(sum(picture.shape[1] + GAP for picture in row) - GAP for row in rows)
    sheet = np.ones((height, width))
    y = 0
    for row in rows:
        x = 0
        for picture in row:
            sheet[y : y + picture.shape[0], x : x + picture.shape[1]] = picture
            x += picture.shape[1] + GAP
        y += row[0].shape[0] + GAP
    with write_atomically(path) as part:
        for quality in (90, 85, 80, 70, 60, 45, 30):
            options = {"quality": quality, "optimize": True}
            imsave(part, sheet, cmap="gray", vmin=0, vmax=1, format="jpg", pil_kwargs=options)
            if part.stat().st_size <= max_bytes:
                break
