"""Images of spike counts: resampled to a fixed size for policies, and as grey values for display."""

import numpy as np

GAMMA = 2.2


def average_observation(image: np.ndarray, rows: int, *, columns: int) -> np.ndarray:
    """Return the means of an image over a grid of equal areas.

    Pixels are divided between areas if necessary, and areas may be smaller than a pixel. The mean is kept, and the
    values stay in the range of the image. Sums are computed in a fixed order, so that the same counts give the same
    bits on every machine.

    Parameters
    ----------
    image : ndarray, shape (h, w)
        Image to resample.
    rows, columns : int
        Number of areas in each direction.

    Returns
    -------
    ndarray of float64, shape (rows, columns)
        Mean of each area.
    """
    means = image.astype(np.float64)
    for axis, parts in enumerate((rows, columns)):
        means = _average_along_first(means if axis == 0 else means.T, parts)
    clipped: np.ndarray = np.clip(means.T, image.min(), image.max())  # rounded differences of sums may leave the range
    return clipped


def _average_along_first(image: np.ndarray, parts: int) -> np.ndarray:
    size = len(image)
    integral = np.zeros((size + 1, image.shape[1]))  # sums from the top to each pixel edge
    np.cumsum(image, axis=0, out=integral[1:])
    edges = np.arange(parts + 1) * size / parts
    pixel = np.minimum(edges.astype(int), size - 1)
    weight = (edges - pixel)[:, None]
    at_edges = (1 - weight) * integral[pixel] + weight * integral[pixel + 1]
    means: np.ndarray = np.diff(at_edges, axis=0) * parts / size
    return means


def draw_observation(rate: np.ndarray) -> np.ndarray:
    """Return counts per pixel and frame, 0...1, as a grey image for display: uint8 (h, w, 3), gamma 2.2.

    White always means a spike in every frame, so that changes of the light are visible across images.
    """
    grey = np.rint(255 * np.clip(rate, 0, 1) ** (1 / GAMMA)).astype(np.uint8)
    return np.repeat(grey[:, :, None], 3, axis=2)
