"""A test of many differences between methods at once, which corrects for their number.

If two methods are equally good, their difference on a scene could equally well have had the opposite sign. The signs of
all differences are therefore flipped at random, scene by scene and alike for all pairs of methods. The standardised
difference of each pair is compared with the largest one of all pairs after flipping (single-step max-T of Westfall and
Young). The test is valid for any number of pairs and any dependence between them, and exact for symmetric differences.
With five scenes or fewer nothing can be told apart: two of the 2⁵ patterns of signs always give the largest sum.
"""

import numpy as np

from saf_gen.core.seeds import make_generator

MAX_SIGN_PATTERNS = 4096
"""Largest number of patterns of signs; up to 13 scenes, all patterns are used."""
_MAX_NUMBERS = 8_000_000


def adjust_p_values_of_ranks(differences: np.ndarray) -> np.ndarray:
    """Return the p-values of the mean differences of many pairs of methods, adjusted for the number of pairs.

    Parameters
    ----------
    differences : ndarray of float, shape (P, S)
        Difference of each pair of methods on each scene.

    Returns
    -------
    ndarray of float, shape (P,)
        Adjusted p-values, 0 to 1.

    References
    ----------
    .. [1] Westfall, Young, Resampling-Based Multiple Testing, Wiley 1993; signs of clusters: Cameron, Gelbach, Miller,
       "Bootstrap-based improvements for inference with clustered errors", Review of Economics and Statistics 90(3),
       2008, doi:10.1162/rest.90.3.414.
    """
    pairs, scenes = differences.shape
    if not pairs:
        return np.empty(0)
    sizes = np.sqrt((differences**2).sum(axis=1))
    scaled = differences / np.where(sizes > 0, sizes, 1)[:, None]
    signs = _make_sign_patterns(scenes)
    largest = np.zeros(len(signs))
    at_once = max(1, _MAX_NUMBERS // len(signs))
    for first in range(0, pairs, at_once):
        np.maximum(largest, np.abs(signs @ scaled[first : first + at_once].T).max(axis=1), out=largest)
    largest.sort()
    found = np.abs(scaled.sum(axis=1))
    return np.asarray(1 - np.searchsorted(largest, found - 1e-9) / len(signs))


def _make_sign_patterns(scenes: int) -> np.ndarray:
    """Return patterns of signs of the scenes, float (T, S).

    The first scene always has +1, because flipping all signs does not change the size of a sum. If there are at most
    MAX_SIGN_PATTERNS patterns, all are returned. Otherwise that many random patterns are returned, the first of which
    flips nothing (random stream ``("statistics", "signs", scenes)``).
    """
    if 2 ** (scenes - 1) <= MAX_SIGN_PATTERNS:
        bits = np.arange(2 ** (scenes - 1))[:, None] >> np.arange(scenes - 1) & 1
    else:
        bits = make_generator("statistics", "signs", scenes).integers(0, 2, (MAX_SIGN_PATTERNS, scenes - 1))
        bits[0] = 0
    return np.concatenate([np.ones((len(bits), 1)), 1 - 2 * bits.astype(np.float64)], axis=1)
