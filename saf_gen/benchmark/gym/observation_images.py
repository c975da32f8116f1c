"""Pictures for a policy and for the eye: counts brought to a fixed size, or to grey values."""

import numpy as np

__all__ = ["average_areas", "render_grey"]

GAMMA = 2.2


def average_areas(image: np.ndarray, rows: int, columns: int) -> np.ndarray:
    """The image (h, w) as means over equal areas, float64 (rows, columns); a pixel is split where it must be.

    The mean is kept, and the range. Areas smaller than a pixel are allowed. Sums are taken in a fixed order,
    so that the same counts give the same bits everywhere.
    """
    means = image.astype(np.float64)
    for axis, parts in enumerate((rows, columns)):
        means = _along_first(means if axis == 0 else means.T, parts)
    kept: np.ndarray = np.clip(means.T, image.min(), image.max())  # differences of sums are rounded
    return kept


def _along_first(image: np.ndarray, parts: int) -> np.ndarray:
    size = len(image)
    up_to = np.zeros((size + 1, image.shape[1]))  # the integral from the top to each edge of a pixel
    np.cumsum(image, axis=0, out=up_to[1:])
    edges = np.arange(parts + 1) * size / parts
    pixel = np.minimum(edges.astype(int), size - 1)
    share = (edges - pixel)[:, None]
    means: np.ndarray = np.diff((1 - share) * up_to[pixel] + share * up_to[pixel + 1], axis=0) * parts / size
    return means


def render_grey(rate: np.ndarray) -> np.ndarray:
    """Counts a pixel and frame, 0...1, as a grey picture for the eye: uint8 (h, w, 3), gamma 2.2.

    White is a spike in every frame, in every picture, so that the light can be seen to change.
    """
    grey = np.rint(255 * np.clip(rate, 0, 1) ** (1 / GAMMA)).astype(np.uint8)
    return np.repeat(grey[:, :, None], 3, axis=2)
