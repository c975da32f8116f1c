"""Reproducible images for checks: counts of all kinds, and a texture with the spectrum of natural scenes."""

from functools import lru_cache

import numpy as np

from saf_gen.core.seeds import make_generator


def sample_counts(*shape: int, highest: int = 50) -> np.ndarray:
    """Return counts drawn uniformly from 0 to ``highest`` - 1: uint32 of the given shape, read-only."""
    counts = make_generator("conformance", *shape).integers(0, highest, shape, dtype=np.uint32)
    counts.flags.writeable = False
    return counts


@lru_cache
def sample_texture(rows: int, columns: int) -> np.ndarray:
    """Return a random image with amplitudes proportional to 1/frequency, as they are on average in natural scenes.

    Returns
    -------
    ndarray of float64, shape (rows, columns)
        Read-only; the mean is about 1, the contrast about 0.4 rms, and the minimum at least 0.05.

    References
    ----------
    D. J. Field, "Relations between the statistics of natural images and the response properties of cortical cells",
    JOSA A 4(12), 1987, doi:10.1364/JOSAA.4.002379.
    """
    frequency = np.hypot(np.fft.fftfreq(rows)[:, None], np.fft.fftfreq(columns))
    frequency[0, 0] = 1.0
    white = np.fft.fft2(make_generator("conformance", "texture", rows, columns).normal(size=(rows, columns)))
    image = np.fft.ifft2(white / frequency).real
    image = np.maximum(1 + 0.4 * (image - image.mean()) / image.std(), 0.05)
    image.flags.writeable = False
    return image


EDGE_CASE_COUNTS: dict[str, np.ndarray] = {
    "random": sample_counts(37, 52),
    "empty": np.zeros((20, 30), np.uint32),
    "saturated": np.full((20, 30), 20_000, np.uint32),
    "one-pixel": sample_counts(1, 1),
    "one-row": sample_counts(1, 40),
    "one-column": sample_counts(40, 1),
    "one-spike": np.eye(1, 400, 7, dtype=np.uint32).reshape(20, 20),
}
"""Counts that every measure must be able to score."""
