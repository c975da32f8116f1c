"""Focus curves without noise: the score of the pictures themselves, as the light falls on the sensor at gain 1.

Each is that of a box: the one around the target, or the largest rectangle inside the target. ``sharpness`` is the
squared contrast, which is the measure ``sd``. For other measures only the peak is kept
(:mod:`saf_gen.stream.optima`). They are those whose expected score of spikes is that of the light, apart from a factor
and an addend that do not depend on the focus: means of products of the counts of pixels, if they cost little. Scores of
other kinds, such as sums of absolute values or ratios of spectra, have another curve for each amount of noise.
"""

from collections.abc import Sequence
from functools import cache

import numpy as np

from saf_gen.core.region import Region
from saf_gen.optics.focus_crossings import focus_crossings
from saf_gen.parts import wants_halves
from saf_gen.plugins.measures import get_measure
from saf_gen.stack.charge_source import ChargeSource
from saf_gen.stream.metadata import Truth
from saf_gen.stream.optima import curve_peak, fitted_peak

MEASURES = (
    "brenner", "energy_of_laplacian", "mid_band_power", "octave_structure", "squared_gradient", "structure_calibrated",
    "tenengrad", "variance_of_laplacian", "vollath_f4", "vollath_f5",
)  # fmt: skip
"""Measures whose noise-free peaks recordings state."""
NEAR_DOF = 3.0
"""Distance from the true focus, in depths of focus, within which their peaks are looked for."""
MIN_FALL = 0.01
"""Fraction of the peak by which a curve must have fallen a depth of focus away from it, or at the end of the travel."""
COUNTS = 5e4
"""Mean counts of a picture when it is scored: so many that neither rounding nor what measures take off for spikes is
seen, and so few that measures sum whole numbers, without the threads that floats would start."""


def noise_free_sharpness(charge_source: ChargeSource, boxes: Sequence[Region], *, position: np.ndarray) -> np.ndarray:
    """Return the noise-free SD (variance divided by squared mean) in each box at each rendered position.

    In a moving scene, the value at a position is taken when the lens first reaches it, and is NaN if it never does.

    Parameters
    ----------
    charge_source : ChargeSource
        Charge of the recording's stacks.
    boxes : sequence of Region
        Rows and columns of N boxes.
    position : ndarray, shape (T,)
        Position of the lens in each readout, 0 to 1.

    Returns
    -------
    ndarray of float64, shape (N, focus)
        Sharpness at gain 1.
    """
    positions = charge_source.time_stack.specs[0].positions
    lowest, highest = float(position.min()), float(position.max())
    stride = float(np.abs(np.diff(position)).max(initial=0.0))  # readouts reach the ends only to within this
    sharpness = np.full((len(boxes), positions), np.nan)
    for k, knot in enumerate(np.linspace(0, 1, positions)):
        crossings = np.zeros(1)
        if charge_source.time_stack.is_moving:
            reached = float(np.clip(knot, lowest, highest))
            near = abs(reached - knot) <= stride
            crossings = focus_crossings(position, reached) if near else crossings[:0]
        if crossings.size:
            whole = charge_source.nominal_image(float(crossings[0]), float(knot))
            for n, box in enumerate(boxes):
                image = whole[box]
                sharpness[n, k] = image.var(dtype=np.float64) / image.mean(dtype=np.float64) ** 2
    return sharpness


def find_optima(
    charge_source: ChargeSource, truth: Truth, *, box: Region, sharpness: np.ndarray, position: np.ndarray
) -> dict[str, float]:
    """Return how far the noise-free curves of measures peak from the true focus, in travels, by measure, where known.

    For a scene at rest these are MEASURES; from the true focus each curve is climbed to its next peak, so that few
    pictures are scored. For a moving scene it is ``sd`` alone, from the sharpness: slices have grain of their own, so
    the peak is fitted.

    Parameters
    ----------
    charge_source : ChargeSource
        Charge of the recording's stacks.
    truth : Truth
        True focus.
    box : Region
        Rows and columns in which the curves are.
    sharpness : ndarray, shape (focus,)
        Noise-free SD there, by :func:`noise_free_sharpness`.
    position : ndarray, shape (T,)
        Position of the lens in each readout, 0 to 1.
    """
    dof = abs(truth.depth_of_focus[1] - truth.depth_of_focus[0])
    if charge_source.time_stack.is_moving:
        peak = fitted_peak(sharpness, dof=dof)
        if peak is None:
            return {}
        passed = focus_crossings(position, peak)
        track = np.full(1, truth.position) if truth.track is None else truth.track
        return {"sd": peak - float(np.interp(passed[0], np.arange(track.size), track))} if passed.size else {}
    if truth.track is not None:  # the mix of its lamps changes, and so does the truth
        return {}
    positions = charge_source.time_stack.specs[0].positions
    reach = int(min(NEAR_DOF * dof, 1.0) * (positions - 1))
    start = min(max(round(truth.position * (positions - 1)), 1), positions - 2)
    seen = range(max(start - reach, 0), min(start + reach, positions - 1) + 1)

    @cache
    def picture(k: int) -> np.ndarray:
        return charge_source.nominal_image(0.0, k / (positions - 1))[box]

    mean = float(picture(start).mean(dtype=np.float64))
    if not (mean > 0 and start in seen):
        return {}
    optima, away = {}, max(round(dof * (positions - 1)), 2)
    for name in MEASURES:
        curve = np.full(positions, np.nan)

        def at(k: int, *, name: str = name, curve: np.ndarray = curve) -> float:
            if k in seen and np.isnan(curve[k]):
                curve[k] = score_picture(name, picture(k) * (COUNTS / mean))
            return float(curve[k]) if k in seen else np.inf

        top, before = start, -1
        while top != before and top in seen:
            before, top = top, max((top, top - 1, top + 1), key=at)
        sides = max(top - away, seen.start), min(top + away, seen.stop - 1)
        if top in seen and max(map(at, sides)) < (1 - MIN_FALL) * at(top):
            peak = curve_peak(curve, dof=dof)
            if peak is not None:
                optima[name] = peak - truth.position
    return optima


def score_picture(name: str, picture: np.ndarray) -> float:
    """Return the score that a measure gives a picture (row, col) without noise, in counts of which there are many."""
    measure, counts = get_measure(name), np.rint(picture).astype(np.uint32)
    return float(measure(np.stack([counts, counts]) if wants_halves(measure) else counts))
