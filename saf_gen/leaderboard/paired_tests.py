"""Which differences between methods the scenes show, of many that are looked at together.

Where two methods are as good as each other, the difference on a scene might as well have had the other sign. So all
signs are turned at random, scene by scene and the same for all pairs, and the largest standardised difference of the
family is compared with that of the turned ones (max-T of Westfall and Young, in one step). That
holds whatever the number of pairs and however they depend on each other, and exactly for symmetric differences.
With five scenes or fewer nothing can be told apart: of 2⁵ signs two always give the largest sum.
"""

import numpy as np

from saf_gen.core.seeds import make_generator

TURNS = 4096
"""Most turns of the signs; up to 13 scenes these are all that there are."""
_MAX_NUMBERS = 8_000_000


def adjust_p_values_of_ranks(differences: np.ndarray) -> np.ndarray:
    """Return the p-values of the mean differences of a family, adjusted for all of them: float (P,), 0–1.

    Parameters
    ----------
    differences : float (P, S), of a pair of methods on each scene.

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
    signs = _turn_signs(scenes)
    largest = np.zeros(len(signs))
    at_once = max(1, _MAX_NUMBERS // len(signs))
    for first in range(0, pairs, at_once):
        np.maximum(largest, np.abs(signs @ scaled[first : first + at_once].T).max(axis=1), out=largest)
    largest.sort()
    found = np.abs(scaled.sum(axis=1))
    return np.asarray(1 - np.searchsorted(largest, found - 1e-9) / len(signs))


def _turn_signs(scenes: int) -> np.ndarray:
    """Return signs of the scenes: float (T, S), the first of them +1: a turn of all changes no size.

    They are all that there are, or TURNS random ones with none turned among them (random stream ``("statistics",
    "signs", scenes)``).
    """
    if 2 ** (scenes - 1) <= TURNS:
        bits = np.arange(2 ** (scenes - 1))[:, None] >> np.arange(scenes - 1) & 1
    else:
        bits = make_generator("statistics", "signs", scenes).integers(0, 2, (TURNS, scenes - 1))
        bits[0] = 0
    return np.concatenate([np.ones((len(bits), 1)), 1 - 2 * bits.astype(np.float64)], axis=1)
