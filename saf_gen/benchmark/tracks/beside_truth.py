"""Errors from two other positions than the truth: the peak of a measure's own focus curve, and the least blur.

**Optimum of a measure.** The truth weighs all pixels of the target alike, and a measure weighs them by their contrast.
If the target is tilted or has relief, the measure therefore peaks elsewhere even without noise, and a search on it can
be no better. Streams of scenes at rest hold the noise-free SD at every rendered position (``/truth/sharpness``), in the
box around the target and in constant light. Its peak is the optimum of ``sd`` and of the measures of its kind; nothing
has to be rendered or stored for it. Of other measures no curve is stored, and slices of moving scenes have too much
grain.

**Least blur.** A lens with aberrations has its largest contrast (the truth) and its least blur at different positions.
Where they are far apart, what is in focus depends on the question, and answers are judged by both.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from saf_gen.benchmark.judgement import judged_dof
from saf_gen.benchmark.tracks.sequence_fields import energy_of_method
from saf_gen.stream.metadata import Truth

MAX_STEP_DOF = 0.75
"""Largest step of a curve, in depths of focus, with which its peak is known: a parabola through three values of a
perfect lens's curve then errs by at most 0.03 depths of focus."""
MAX_APART_DOF = 0.15
"""Distance between largest contrast and least blur, in depths of focus, above which answers are judged by both."""


def optimum_fields(truth: Truth, position: float | None, *, method: str, region: str) -> dict[str, Any]:
    """Return the fields of a record on the optimum of the method's measure; None if unknown.

    Parameters
    ----------
    truth : Truth
        Truth of the recording.
    position : float or None
        Lens position at the answer, as a fraction of the travel.
    method : str
        Name of the method.
    region : str
        Region where the method looked; the curve is known only for ``target``.
    """
    has_curve = region == "target" and energy_of_method(method) == "contrast" and truth.track is None
    dof = judged_dof(truth.depth_of_focus)
    optimum = None if dof is None or not has_curve else _peak(truth.sharpness, max_step=MAX_STEP_DOF * dof)
    off = None if optimum is None or dof is None or position is None else (position - optimum) / dof
    return {"optimum": optimum, "error_optimum_dof": off}


def _peak(curve: np.ndarray | None, *, max_step: float) -> float | None:
    """Return the peak of a curve over evenly spaced positions from 0 to 1, by a parabola through the largest value.

    It is None if the curve is too coarse, or has no peak with known values on both sides.
    """
    if curve is None or curve.size < 3 or not np.isfinite(curve).any() or (step := 1 / (curve.size - 1)) > max_step:
        return None
    k = int(np.nanargmax(curve))
    if not 0 < k < curve.size - 1:
        return None
    before, at, after = curve[k - 1 : k + 2]
    bend = before - 2 * at + after
    return (k + float((before - after) / (2 * bend))) * step if bend < 0 else None


def least_blur_fields(truth: Truth, judge: Callable[[Truth], Mapping[str, Any]]) -> dict[str, Any]:
    """Return the fields of a record on the least blur, all None unless it is far from the largest contrast.

    Parameters
    ----------
    truth : Truth
        Truth of the recording.
    judge : callable
        Judges the answer by another truth, and returns its ``truth``, ``error_dof`` and ``success_1dof``.
    """
    dof, least_blur = judged_dof(truth.depth_of_focus), truth.least_blur
    if dof is None or least_blur is None or not abs(least_blur - truth.position) > MAX_APART_DOF * dof:
        return dict.fromkeys(("least_blur", "error_least_blur_dof", "success_least_blur"))
    apart = least_blur - truth.position
    judged = judge(replace(truth, position=least_blur, track=None if truth.track is None else truth.track + apart))
    return {
        "least_blur": judged["truth"],
        "error_least_blur_dof": judged.get("error_dof"),
        "success_least_blur": judged["success_1dof"],
    }
