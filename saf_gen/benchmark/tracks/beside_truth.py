"""What records say of an answer beside its error from the truth.

**Optimum of a measure.** The truth weighs all pixels of the target alike, and a measure weighs them by their contrast.
If the target is tilted or has relief, the measure therefore peaks elsewhere even without noise, and a search on it can
be no better. Streams of scenes at rest hold the noise-free SD at every rendered position (``/truth/sharpness``), in the
box around the target and in constant light. Its peak is the optimum of ``sd`` and of the measures of its kind. For
other measures, and for ``sd`` along the slices of a moving scene, recordings state it (:mod:`saf_gen.stream.optima`),
unless they are older. That of a moving scene holds for the course of its lens, and so not for the closed loop.

**Least blur.** A lens with aberrations has its largest contrast (the truth) and its least blur at different positions.
Where they are far apart, what is in focus depends on the question, and answers are judged by both.

**Sharpness lost.** What the task is about: how much of its best sharpness the target lost at the answer.

**Whole target.** Of a tilted or deep target something is in focus over a longer way than the depth of focus by which
answers are judged. Where it is much longer, records say whether the lens stood there.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from saf_gen.benchmark.judgement import judged_dof
from saf_gen.benchmark.method_spec import split_halves
from saf_gen.benchmark.tracks.sequence_fields import energy_of_method
from saf_gen.plugins.measures import INTERVAL_SUFFIX, NORMALISED_SUFFIX
from saf_gen.stream.metadata import Truth
from saf_gen.stream.optima import curve_peak, sharpness_lost

MAX_APART_DOF = 0.15
"""Distance between largest contrast and least blur, in depths of focus, above which answers are judged by both."""
MIN_WIDER_DOF = 0.3
"""By how many depths of focus a target must be wider to be called tilted or deep."""


def optimum_fields(
    truth: Truth, position: float | None, *, method: str, region: str, optima: Mapping[str, float], here: float | None
) -> dict[str, Any]:
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
        Region where the method looked; curves are known only for ``target``.
    optima : mapping of str to float
        Distances of peaks from the truth that the recording states, in travels, by measure.
    here : float or None
        True focus at the answer.
    """
    measure, dof, optimum = _measure_of(method), judged_dof(truth.depth_of_focus), None
    if dof is not None and region == "target":
        if measure == "sd" and truth.track is None:
            optimum = curve_peak(truth.sharpness, dof=dof)
        elif measure in optima and here is not None:
            optimum = here + optima[measure]
    off = None if optimum is None or dof is None or position is None else (position - optimum) / dof
    return {"optimum": optimum, "error_optimum_dof": off}


def _measure_of(method: str) -> str:
    """Return the measure whose noise-free curve is that of a method: ``sd`` for all of its kind."""
    name, _, options = split_halves(method)[0].partition(":")
    if energy_of_method(method) == "contrast":
        return "sd"
    return "" if options else name.removesuffix(INTERVAL_SUFFIX).removesuffix(NORMALISED_SUFFIX)


def sharpness_fields(truth: Truth, position: float | None) -> dict[str, Any]:
    """Return the sharpness that the target lost at an answer, at ``position``; None in a moving scene or if unknown."""
    dof = judged_dof(truth.depth_of_focus)
    if dof is None or position is None or truth.track is not None:
        return {"sharpness_lost": None}
    return {"sharpness_lost": sharpness_lost(truth.sharpness, position, dof=dof)}


def whole_target_fields(truth: Truth, error: float | None) -> dict[str, Any]:
    """Return whether something of a tilted or deep target is in focus at an answer; None for flat ones, or if unknown.

    Parameters
    ----------
    truth : Truth
        Truth of the recording.
    error : float or None
        Answer minus truth, in travels.
    """
    dof, (low, high) = judged_dof(truth.depth_of_focus), truth.whole_target
    if dof is None or error is None or not high - low > (1 + MIN_WIDER_DOF) * dof:
        return {"in_focus": None}
    return {"in_focus": low <= truth.position + error <= high}


def least_blur_fields(truth: Truth, judge: Callable[[Truth], Mapping[str, Any]]) -> dict[str, Any]:
    """Return the success of an answer by the least blur; None unless it is far from the largest contrast.

    Parameters
    ----------
    truth : Truth
        Truth of the recording.
    judge : callable
        Judges the answer by another truth, and returns its ``success_1dof``.
    """
    dof, least_blur = judged_dof(truth.depth_of_focus), truth.least_blur
    if dof is None or least_blur is None or not abs(least_blur - truth.position) > MAX_APART_DOF * dof:
        return {"success_least_blur": None}
    apart = least_blur - truth.position
    judged = judge(replace(truth, position=least_blur, track=None if truth.track is None else truth.track + apart))
    return {"success_least_blur": judged["success_1dof"]}
