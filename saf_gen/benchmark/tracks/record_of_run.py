"""The record of a run: its judgement, and what follows for the method's measure from its noise-free focus curve.

**Optimum of a measure.** The truth weighs all pixels of the target alike, and a measure weighs them by their contrast.
If the target is tilted or has relief, the measure therefore peaks elsewhere even without noise, and a search on it can
be no better. Streams of scenes at rest hold the noise-free SD at every rendered position (``/truth/sharpness``), in the
box around the target and in constant light. Its peak is the optimum of ``sd`` and of the measures of its kind. For
other measures, and for ``sd`` along the slices of a moving scene, recordings state it (:mod:`saf_gen.stream.optima`),
unless they are older. That of a moving scene holds for the course of its lens, and so not for the closed loop. Of the
rectangle inside the target recordings state all this apart; of other boxes, nothing is known.

**Grain.** A focus measure mistakes grain, the noise that the renderer left in the pictures, for texture. For each
measure whose energy is stored in the recording, its energy in the grain is compared with the range of its focus curve.
Both are of the box around the target, and stand for the rectangle inside it, too.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from saf_gen.benchmark.judgement import Run, judge, judged_dof
from saf_gen.benchmark.method_spec import split_halves
from saf_gen.benchmark.records import MAX_SECONDS_OR_TRAVELS, Record, What, Who
from saf_gen.plugins.measures import INTERVAL_SUFFIX, NORMALISED_SUFFIX
from saf_gen.stack.grain import ENERGIES
from saf_gen.stream.metadata import Truth
from saf_gen.stream.optima import PROVENANCE_KEYS, curve_peak
from saf_gen.stream.recorded_grain import RecordedGrain

ENERGY_OF_MEASURE: Mapping[str, str] = {
    **dict.fromkeys(("sd", "sd_code", "sd_debiased", "sd_calibrated", "variance", "normalised_variance"), "contrast"),
    **{name: name for name in ENERGIES if name != "contrast"},
}


def make_record(
    run: Run,
    *,
    who: Who,
    what: What,
    truth: Truth,
    end_s: Callable[[int], float],
    optima: Mapping[str, float],
    grain: RecordedGrain | None = None,
) -> Record:
    """Return the record of a run.

    Parameters
    ----------
    run : Run
        The run of a method on a sequence.
    who, what : Who, What
        Method and sequence.
    truth : Truth
        Truth of the recording.
    end_s : callable
        Returns the seconds from the beginning to the end of a number of frames.
    optima : mapping of str to float
        Distances of peaks from the truth that the recording states of the region of ``who``, in travels, by measure.
    grain : RecordedGrain, optional
        Grain along the recording.

    Returns
    -------
    Record
        The record.
    """
    seen = replace(truth, sharpness=truth.sharpness_inside) if who.region == "inside" else truth
    judgement = judge(run, seen, end_s=end_s, obstacle=what.obstacle)
    if who.region in PROVENANCE_KEYS:  # elsewhere, neither curves nor grain are known
        optimum = find_optimum(seen, judgement.truth, method=who.method, optima=optima)
        of_curve = None if grain is None else _grain_of_curve(grain, truth, method=who.method)
        judgement = replace(judgement, optimum=optimum, grain_of_curve=of_curve)
    return Record(who, what, judgement)


def find_optimum(truth: Truth, here: float | None, *, method: str, optima: Mapping[str, float]) -> float | None:
    """Return the optimum of a method's measure in the region where the sharpness is, as a fraction of the travel.

    Parameters
    ----------
    truth : Truth
        Truth of the recording, with the sharpness in the region.
    here : float or None
        True focus at the answer.
    method : str
        Name of the method.
    optima : mapping of str to float
        Distances of peaks from the truth that the recording states of the region, in travels, by measure.

    Returns
    -------
    float or None
        Position of the optimum; None if unknown.
    """
    name, _, options = split_halves(method)[0].partition(":")
    energy, dof = energy_of_method(method), judged_dof(truth.depth_of_focus)
    if dof is None:
        return None
    if energy == "contrast" and truth.track is None:
        return curve_peak(truth.sharpness, dof=dof)
    plain = "" if options else name.removesuffix(INTERVAL_SUFFIX).removesuffix(NORMALISED_SUFFIX)
    apart = optima.get("sd" if energy == "contrast" else plain)
    return None if apart is None or here is None else here + apart


def energy_of_method(method: str) -> str | None:
    """Return the energy that the measure of a method is or follows, one of ENERGIES; None if it is none of them."""
    measure = split_halves(method)[0].split(":")[0]
    return ENERGY_OF_MEASURE.get(measure.removesuffix(INTERVAL_SUFFIX).removesuffix(NORMALISED_SUFFIX))


def _grain_of_curve(grain: RecordedGrain, truth: Truth, *, method: str) -> float | None:
    """Return the grain divided by the range of the focus curve, in the box around the target; None if unknown.

    The curve is the noise-free sharpness in the file for ``contrast``, and the signal along the recording for the other
    energies.
    """
    if (energy := energy_of_method(method)) is None:
        return None
    sharpness = truth.sharpness if energy == "contrast" else None
    known = np.empty(0) if sharpness is None else sharpness[np.isfinite(sharpness)]
    return limited(grain.noise_over_curve(energy, curve_range=float(np.ptp(known)) if known.size else None))


def limited(value: float) -> float | None:
    """Return a number as stored in a record: limited to MAX_SECONDS_OR_TRAVELS, and None instead of NaN."""
    return None if math.isnan(value) else min(value, MAX_SECONDS_OR_TRAVELS)
