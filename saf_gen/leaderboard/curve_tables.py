"""Focus curves as tables: the quality of each curve, and how the measures compare.

The curves are those that argmax computed. A curve that is constant, or over a lens that comes back or rests,
has no quality: its fields are empty, and it is counted.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from math import inf, isfinite, nan
from pathlib import Path

import numpy as np

from saf_gen.benchmark.judgement import position_of_method_answer, truth_depth_of_focus
from saf_gen.benchmark.results import FocusCurve, SweepSummary
from saf_gen.core.files import write_text_atomically
from saf_gen.leaderboard.averages import median_magnitude
from saf_gen.leaderboard.csv_output import format_csv
from saf_gen.leaderboard.curve_quality import CurveQuality, assess_focus_curve

_NAMES = tuple(f.name for f in fields(CurveQuality))
QUALITY_MEANINGS = {
    "accuracy_dof": "Distance of the curve's peak from the truth, depths of focus.",
    "accuracy": "Distance of the curve's peak from the truth, fraction of the travel.",
    "range": "Distance between the minima beside the peak, fraction of the travel.",
    "false_maxima": "Local maxima beside the peak, however small.",
    "false_peaks": "Local maxima beside the peak that stand out by more than a tenth of the curve's height.",
    "width_50": "Width of the peak at half its height, fraction of the travel.",
    "width_80": "Width of the peak at 80 % of its height, fraction of the travel.",
    "noise": "Standard deviation of the noise on the curve, fraction of its height.",
}
"""The criteria of which a measure has medians, in order."""


@dataclass(frozen=True)
class CurveRow:
    """The quality of one measure's curve on one sequence."""

    measure: str
    sweep: SweepSummary
    quality: CurveQuality | None


@dataclass(frozen=True)
class MeasureRow:
    """One measure over all its curves; ``medians`` by the names of QUALITY_MEANINGS, None where unknown."""

    measure: str
    curves: int
    without_quality: int
    """Number of curves without a quality."""
    medians: dict[str, float | None]


def assess_curves(sweeps: Sequence[SweepSummary]) -> list[CurveRow]:
    """Return the quality of every curve of these sweeps, in their order."""
    return [CurveRow(c.measure, sweep, _assess(sweep, curve=c)) for sweep in sweeps for c in sweep.curves]


def summarise_measures(curves: Sequence[CurveRow]) -> list[MeasureRow]:
    """Return a row per measure, the most accurate first; those of unknown accuracy last, by name."""
    by_measure: dict[str, list[CurveRow]] = {}
    for row in curves:
        by_measure.setdefault(row.measure, []).append(row)
    rows = []
    for measure, own in by_measure.items():
        known = [row.quality for row in own if row.quality is not None]
        medians = {name: median_magnitude(getattr(q, name) for q in known) for name in QUALITY_MEANINGS}
        rows.append(MeasureRow(measure, len(own), len(own) - len(known), medians))
    return sorted(rows, key=_sort_key)


def write_leaderboard_curves(folder: str | Path, sweeps: Sequence[SweepSummary]) -> list[Path]:
    """Write curves.csv and measures.csv into ``folder``, unless there is no curve, and return their paths.

    Unknown numbers are empty fields. Raises BadInput where a file cannot be written.
    """
    curves = assess_curves(sweeps)
    if not curves:
        return []
    header = ["measure", "sequence", "split", "scene", "light", "truth", "depth_of_focus", *_NAMES]
    lines = [
        [
            row.measure,
            row.sweep.sequence,
            row.sweep.split,
            row.sweep.scene,
            row.sweep.light,
            row.sweep.truth if isfinite(row.sweep.truth) else None,
            truth_depth_of_focus(row.sweep.depth_of_focus),
            *(None if row.quality is None else getattr(row.quality, name) for name in _NAMES),
        ]
        for row in curves
    ]
    measures = [
        [row.measure, row.curves, row.without_quality, *row.medians.values()] for row in summarise_measures(curves)
    ]
    texts = {
        "curves.csv": format_csv(header, lines),
        "measures.csv": format_csv(["measure", "curves", "without", *QUALITY_MEANINGS], measures),
    }
    for name, text in texts.items():
        write_text_atomically(Path(folder) / name, text)
    return [Path(folder) / name for name in texts]


def _assess(sweep: SweepSummary, *, curve: FocusCurve) -> CurveQuality | None:
    lens = sweep.focus_position
    if lens is None or not np.isfinite(lens).all():
        return None
    truth = sweep.truth
    if sweep.track is not None and curve.scores.size:  # a moving truth counts at the frame of the peak
        is_known = isfinite(truth) and np.isfinite(sweep.track).all()
        peak_frame = float(curve.frames[curve.scores.argmax()])
        truth = position_of_method_answer(peak_frame, sweep.track) if is_known else nan
    return assess_focus_curve(
        np.interp(curve.frames, np.arange(len(lens)), lens),
        curve.scores,
        truth=truth if isfinite(truth) else None,
        depth=truth_depth_of_focus(sweep.depth_of_focus),
    )


def _sort_key(row: MeasureRow) -> tuple[float, str]:
    accuracy = row.medians["accuracy_dof"]
    return inf if accuracy is None else accuracy, row.measure
