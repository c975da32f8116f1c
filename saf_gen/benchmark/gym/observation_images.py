"""Images for a policy and for the eye: counts resampled to a fixed size, or as grey values."""

import numpy as np

GAMMA = 2.2


def average_policy_observation(image: np.ndarray, rows: int, *, columns: int) -> np.ndarray:
    """Return an image (h, w) as means over equal areas, float64 (rows, columns).

    Pixels are divided between areas where necessary, and areas may be smaller than a pixel. The mean and the
    range are kept. Sums are taken in a fixed order, so that the same counts give the same bits everywhere.
    """
    means = image.astype(np.float64)
    for axis, parts in enumerate((rows, columns)):
        means = _average_along_first(means if axis == 0 else means.T, parts)
    kept: np.ndarray = np.clip(means.T, image.min(), image.max())  # differences of sums are rounded
    return kept


def _average_along_first(image: np.ndarray, parts: int) -> np.ndarray:
    size = len(image)
    integral = np.zeros((size + 1, image.shape[1]))  # from the top to each edge of a pixel
    np.cumsum(image, axis=0, out=integral[1:])
    edges = np.arange(parts + 1) * size / parts
    pixel = np.minimum(edges.astype(int), size - 1)
    weight = (edges - pixel)[:, None]
    at_edges = (1 - weight) * integral[pixel] + weight * integral[pixel + 1]
    means: np.ndarray = np.diff(at_edges, axis=0) * parts / size
    return means


def draw_policy_observation(rate: np.ndarray) -> np.ndarray:
    """Return counts per pixel and frame, 0...1, as a grey image for the eye: uint8 (h, w, 3), gamma 2.2.

    White is a spike in every frame in every image, so that the light can be seen to change.
    """
    grey = np.rint(255 * np.clip(rate, 0, 1) ** (1 / GAMMA)).astype(np.uint8)
    return np.repeat(grey[:, :, None], 3, axis=2)
