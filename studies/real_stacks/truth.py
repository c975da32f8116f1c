"""The rule of truth of a box of a real stack: where four focus measures of the pictures peak, and how surely.

Nobody knows the optics, so the truth is the median of the peaks of one measure of each family. A narrow peak is the
vertex of the parabola through the logarithms of the largest value and its neighbours, which is exact for a bell; a wide
one is that of the parabola fitted to all pictures near the top, because a picture that is a little too sharp moves the
other one far. The uncertainty is the largest of: the range of the four peaks; a quarter of how far the truth moves when
every second picture is left out; and 0.03 pictures. A method is judged by the truth without the families of its own
measure and search.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import sobel

from saf_gen.benchmark.method_spec import measure_and_search, split_options
from saf_gen.plugins.measures import INTERVAL_SUFFIX, NORMALISED_SUFFIX
from saf_gen.stack.noise_free import COUNTS, score_picture

MEASURES = {
    "gradient": "tenengrad",
    "autocorrelation": "vollath_f4",
    "laplacian": "energy_of_laplacian",
    "spectrum": "mid_band_power",
}
"""The measure of each family whose peak is part of the truth."""
FAMILY = {
    **dict.fromkeys(("brenner", "gaussian_derivative", "gradient_code", "squared_gradient", "tenengrad"), "gradient"),
    **dict.fromkeys(("fine_structure", "octave_structure", "structure_calibrated", "vollath_f4", "vollath_f5"),
                    "autocorrelation"),
    **dict.fromkeys(("energy_of_laplacian", "modified_laplacian", "variance_of_laplacian"), "laplacian"),
    **dict.fromkeys(("cen", "dct_energy_ratio", "mfdct_code", "mfdct_lee", "mid_band_power", "wavelet_ratio"),
                    "spectrum"),
}  # fmt: skip
"""Families of measures; the others, such as SD, belong to none that the truth has."""
FAMILY_OF_SEARCH = {"bell_vote": "autocorrelation", "elp": "laplacian"}
"""Family of the curves that searches add to the measure of the method."""
WIDE = 15.0
"""Width in pictures from which a peak is fitted to all pictures above TOP of its height."""
TOP = 0.7
LEAST = 0.03
"""Smallest uncertainty, in pictures."""
BLOCK = 16
"""Pixels along each side of a block, by which the class of a box is found."""


@dataclass(frozen=True)
class BoxTruth:
    """Where a box is in focus, in pictures counted from 0.

    Attributes
    ----------
    peaks : mapping of str to float
        Peak of the measure of each family.
    width : float
        Width of the gradient curve at half of its height.
    uncertainty : float
        Of the truth by all families.
    given : float or None
        Truth that another instrument found, which then counts for every method.
    """

    peaks: Mapping[str, float]
    width: float
    uncertainty: float
    given: float | None = None

    def without(self, families: Collection[str] = ()) -> float | None:
        """Return the truth that some families leave; None if they leave nothing."""
        left = [peak for family, peak in self.peaks.items() if family not in families]
        return self.given if self.given is not None else float(np.median(left)) if left else None


def families_of(method: str) -> frozenset[str]:
    """Return the families of the truth to which the measure and the search of a method belong."""
    measure, search = (split_options(half) for half in measure_and_search(method))
    own = FAMILY.get(measure[0].removesuffix(INTERVAL_SUFFIX).removesuffix(NORMALISED_SUFFIX))
    return frozenset(filter(None, (own, FAMILY_OF_SEARCH.get(search[0]))))


def box_truth(pictures: np.ndarray, given: float | None = None) -> BoxTruth | None:
    """Return the truth of a box, or None if a measure has no peak between its first and its last picture.

    Parameters
    ----------
    pictures : ndarray of float32, shape (focus, row, col)
        Linear light of the box.
    given : float, optional
        Truth that another instrument found, in pictures.
    """
    if not (pictures.mean(axis=(1, 2)) > 0).all():
        return None
    curves = {family: focus_curve(name, pictures) for family, name in MEASURES.items()}
    width = curve_width(curves["gradient"])
    found = {family: peak(curve, width=width) for family, curve in curves.items()}
    peaks = {family: at for family, at in found.items() if at is not None}
    if len(peaks) < len(curves):
        return None
    best = float(np.median(list(peaks.values())))
    halves = [np.median([_half_peak(c, odd, width=width) for c in curves.values()]) for odd in (0, 1)]
    move = max(abs(float(half) - best) for half in halves) / 4
    return BoxTruth(peaks, width, max(float(np.ptp(list(peaks.values()))), move, LEAST), given)


def focus_curve(measure: str, pictures: np.ndarray) -> np.ndarray:
    """Return the score of each picture at the same mean light, float64 (focus,)."""
    return np.array([score_picture(measure, picture * (COUNTS / picture.mean())) for picture in pictures])


def curve_width(curve: np.ndarray) -> float:
    """Return the width of a curve at half of its height above its smallest value, in pictures; 0 if it is flat.

    A side that does not fall so far ends with the stack.
    """
    if not np.ptp(curve) > 0:
        return 0.0
    height, k = (curve - curve.min()) / np.ptp(curve), int(curve.argmax())
    return _fall(height[: k + 1][::-1]) + _fall(height[k:])


def _fall(height: np.ndarray) -> float:
    """Return how many pictures from its first value a height first falls to a half."""
    below = np.flatnonzero(height <= 0.5)
    if not below.size:
        return float(len(height) - 1)
    n = int(below[0])
    return n - 1 + float((height[n - 1] - 0.5) / (height[n - 1] - height[n]))


def peak(curve: np.ndarray, *, width: float) -> float | None:
    """Return where a curve of a given width peaks, in pictures; None unless that is between the first and the last."""
    k = int(curve.argmax())
    if not 0 < k < len(curve) - 1:
        return None
    if width > WIDE:
        low = np.flatnonzero(curve - curve.min() < TOP * np.ptp(curve))
        first = max((n + 1 for n in low if n < k), default=0)
        stop = min((n for n in low if n > k), default=len(curve))
        if stop - first >= 3:
            bend, slope, _ = np.polyfit(np.arange(first, stop) - k, curve[first:stop] / curve[k], 2)
            return _inside(k - slope / (2 * bend), curve) if bend < 0 else None
    if curve[k - 1 : k + 2].min() <= 0:
        return None
    before, at, after = np.log(curve[k - 1 : k + 2])
    return k + float((before - after) / (2 * (before - 2 * at + after))) if 2 * at > before + after else None


def _inside(at: float, curve: np.ndarray) -> float | None:
    return float(at) if 0 < at < len(curve) - 1 else None


def _half_peak(curve: np.ndarray, odd: int, *, width: float) -> float:
    """Return the peak by the even or the odd pictures alone; the largest of them if they have none."""
    half = curve[odd::2]
    at = peak(half, width=width)
    return odd + 2 * (float(half.argmax()) if at is None else at)


def share_in_focus(pictures: np.ndarray, truth: float, unit: float) -> float:
    """Return the share of the blocks of a box whose gradients are largest within a unit of the truth, all in pictures.

    Parameters
    ----------
    pictures : ndarray of float32, shape (focus, row, col)
        Linear light of the box.
    """
    count, rows, columns = pictures.shape
    energy = np.stack([sobel(p.astype(float), 0) ** 2 + sobel(p.astype(float), 1) ** 2 for p in pictures])
    shape = (count, rows // BLOCK, BLOCK, columns // BLOCK, BLOCK)
    of_block, light = (
        a[:, : rows // BLOCK * BLOCK, : columns // BLOCK * BLOCK].reshape(shape).mean(axis=(2, 4))
        for a in (energy, pictures)
    )
    top = (of_block / np.maximum(light, 1e-12) ** 2).argmax(axis=0)
    return float(np.mean(np.abs(top - truth) <= unit))
