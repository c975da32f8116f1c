"""Where the noise-free focus curves of measures peak, stored as JSON texts in ``/provenance``.

``optima`` is of the curves in the box around the target, ``optima_inside`` of those in the rectangle inside it. A text
has the distance of each peak from the true focus, in travels, by the name of the measure. They are no datasets of
``/truth``, because ``content_sha256`` covers those: recordings made again from an older recipe keep their digest. A
file without the texts can still be read; the optima of its measures are unknown, but that of ``sd`` at rest, which
follows from ``/truth/sharpness`` and ``/truth/sharpness_inside``.
"""

import json
import math
from collections.abc import Mapping

import numpy as np

from saf_gen.core.config.json_document import load_plain_json

PROVENANCE_KEYS = {"target": "optima", "inside": "optima_inside"}
"""Names of the texts, by the region of the curves."""
DIGITS = 6
MAX_STEP_DOF = 0.75
"""Largest step of a curve, in depths of focus, with which its peak is known: a parabola through three values of a
perfect lens's curve then errs by at most 0.03 depths of focus."""
MAX_ERROR_DOF = 0.05
"""Largest standard error, in depths of focus, of a peak that is fitted."""


def curve_peak(curve: np.ndarray | None, *, dof: float) -> float | None:
    """Return the peak of a curve over evenly spaced positions from 0 to 1, by a parabola through the largest value.

    It is None if the curve is too coarse for a depth of focus of ``dof``, or has no peak with known values on both
    sides.
    """
    if not _is_fine(curve, dof=dof):
        return None
    assert curve is not None
    step, k = 1 / (curve.size - 1), int(np.nanargmax(curve))
    if not 0 < k < curve.size - 1:
        return None
    before, at, after = curve[k - 1 : k + 2]
    bend = before - 2 * at + after
    return (k + float((before - after) / (2 * bend))) * step if bend < 0 else None


def sharpness_lost(curve: np.ndarray | None, position: float, *, dof: float) -> float | None:
    """Return 1 − S(position)/S(best) of a curve S over evenly spaced positions from 0 to 1, between them a line: 0...1.

    It is None if the curve is too coarse for a depth of focus of ``dof``, is not known at the position, or has no value
    above 0.
    """
    if not _is_fine(curve, dof=dof):
        return None
    assert curve is not None
    best, here = float(np.nanmax(curve)), float(np.interp(position, np.linspace(0, 1, curve.size), curve))
    return float(np.clip(1 - here / best, 0, 1)) if best > 0 and math.isfinite(here) else None


def fitted_peak(curve: np.ndarray | None, *, dof: float) -> float | None:
    """Return the peak of a curve whose values scatter, such as that of slices: of the parabola that fits it best there.

    The parabola is fitted to the values within half a depth of focus of the largest one. The peak is None if these are
    fewer than five, if they have no peak among them, or if its standard error by their scatter is above MAX_ERROR_DOF.
    """
    if not _is_fine(curve, dof=dof):
        return None
    assert curve is not None
    x = np.linspace(0, 1, curve.size)
    x = (x - x[int(np.nanargmax(curve))]) / dof
    near = (np.abs(x) <= 0.5) & np.isfinite(curve)
    if near.sum() < 5 or not (x[near].min() < 0 < x[near].max()):
        return None
    top = float(np.nanmax(curve))
    (bend, slope, _), spread = np.polyfit(x[near], curve[near] / top, 2, cov=True)
    if not bend < 0:
        return None
    peak = float(-slope / (2 * bend))
    by_bend, by_slope = -peak / bend, -1 / (2 * bend)  # how the peak depends on them
    error = math.sqrt(max(np.array([by_bend, by_slope]) @ spread[:2, :2] @ np.array([by_bend, by_slope]), 0.0))
    if abs(peak) > 0.5 or error > MAX_ERROR_DOF:
        return None
    return float(np.linspace(0, 1, curve.size)[int(np.nanargmax(curve))] + peak * dof)


def _is_fine(curve: np.ndarray | None, *, dof: float) -> bool:
    return (
        curve is not None
        and curve.size >= 3
        and bool(np.isfinite(curve).any())
        and 1 / (curve.size - 1) <= MAX_STEP_DOF * dof
    )


def optima_to_text(optima: Mapping[str, float]) -> str:
    """Return distances of peaks from the true focus, by measure, as the text that a stream file stores."""
    return json.dumps({name: float(f"{apart:.{DIGITS}g}") for name, apart in optima.items()})


def optima_of_stream(provenance: Mapping[str, str], region: str = "target") -> dict[str, float]:
    """Return the distances that the provenance of a stream states of a region; empty if none can be read."""
    try:
        found = load_plain_json(provenance[PROVENANCE_KEYS[region]])
        optima = {str(name): float(apart) for name, apart in found.items()}
    except (KeyError, ValueError, TypeError, AttributeError, OverflowError):
        return {}
    return optima if all(map(math.isfinite, optima.values())) else {}
