"""Assessment of focus curves, whose quality is kept even if the sweep of a recording is not drawn."""

from collections.abc import Iterable
from math import isfinite, nan

import numpy as np

from saf_gen.benchmark.curve_quality import AssessedCurve, CurveQuality, assess_curve
from saf_gen.benchmark.judgement import judged_dof, lens_position
from saf_gen.benchmark.results import FocusCurve, SweepSummary


def assess_curves(sweeps: Iterable[SweepSummary]) -> list[AssessedCurve]:
    """Return the quality of every focus curve, in the order of the sweeps."""
    return [
        AssessedCurve(
            curve.measure,
            sweep.sequence,
            sweep.split,
            sweep.scene,
            sweep.light,
            sweep.truth if isfinite(sweep.truth) else None,
            judged_dof(sweep.depth_of_focus),
            _assess(sweep, curve=curve),
        )
        for sweep in sweeps
        for curve in sweep.curves
    ]


def _assess(sweep: SweepSummary, *, curve: FocusCurve) -> CurveQuality | None:
    lens = sweep.focus_position
    if lens is None or not np.isfinite(lens).all():
        return None
    truth = sweep.truth
    if sweep.track is not None and curve.scores.size:  # if the target moves, the truth at the peak counts
        is_known = isfinite(truth) and np.isfinite(sweep.track).all()
        peak_frame = float(curve.frames[curve.scores.argmax()])
        truth = lens_position(peak_frame, sweep.track) if is_known else nan
    return assess_curve(
        np.interp(curve.frames, np.arange(len(lens)), lens),
        curve.scores,
        truth=truth if isfinite(truth) else None,
        depth=judged_dof(sweep.depth_of_focus),
    )
