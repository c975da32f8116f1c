"""Focus curves as tables: the quality of each, and how the measures compare.

Curves are those that argmax looked at. A lens that comes back or rests gives none, and a flat curve has none:
such lines are empty, and counted.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from math import isfinite, nan
from pathlib import Path

import numpy as np

from saf_gen.benchmark.judgement import depth_of_focus, interpolate_position
from saf_gen.benchmark.results import FocusCurve, SweepSummary
from saf_gen.leaderboard.csv_output import format_csv
from saf_gen.leaderboard.curve_quality import CurveQuality, assess_focus_curve
from saf_gen.stream.manifest import write_text_atomically

__all__ = [
    "QUALITY_MEANINGS",
    "CurveRow",
    "MeasureRow",
    "assess_curves",
    "summarise_measures",
    "write_curve_tables",
]

_NAMES = tuple(f.name for f in fields(CurveQuality))
QUALITY_MEANINGS = {
    "accuracy_dof": "Distance of the curve's peak from the truth, depths of focus.",
    "accuracy": "The same, fraction of the travel.",
    "range": "Way of the lens between the minima beside the peak, fraction of the travel.",
    "false_maxima": "Local maxima beside the peak, however small.",
    "false_peaks": "Those that stand out by more than a tenth of the curve's height.",
    "width_50": "Width of the peak at half its height, fraction of the travel.",
    "width_80": "Width at 80 % of its height.",
    "noise": "Standard deviation of the noise on the curve, of its height.",
}
"""What medians a measure has, in order."""


@dataclass(frozen=True)
class CurveRow:
    """One measure on one sequence."""

    measure: str
    sweep: SweepSummary
    quality: CurveQuality | None


@dataclass(frozen=True)
class MeasureRow:
    """One measure over all its curves; ``medians`` by the names of QUALITY_MEANINGS, None where none is
    known."""

    measure: str
    curves: int
    without_quality: int
    """Sequences whose curve has no quality."""
    medians: dict[str, float | None]


def assess_curves(sweeps: Sequence[SweepSummary]) -> list[CurveRow]:
    """Every curve of these sweeps, in their order."""
    return [CurveRow(c.measure, sweep, _quality(sweep, c)) for sweep in sweeps for c in sweep.curves]


def summarise_measures(curves: Sequence[CurveRow]) -> list[MeasureRow]:
    """A row for each measure, the most accurate first; those of unknown accuracy last, by name."""
    by_measure: dict[str, list[CurveRow]] = {}
    for row in curves:
        by_measure.setdefault(row.measure, []).append(row)
    rows = []
    for measure, some in by_measure.items():
        known = [row.quality for row in some if row.quality is not None]
        medians = {name: _median([getattr(q, name) for q in known]) for name in QUALITY_MEANINGS}
        rows.append(MeasureRow(measure, len(some), len(some) - len(known), medians))
    return sorted(rows, key=_order)


def write_curve_tables(folder: str | Path, sweeps: Sequence[SweepSummary]) -> list[Path]:
    """Write curves.csv and measures.csv into ``folder``; nothing where there is no curve. Returns the paths.

    BadInput where that fails; an unknown number is an empty field.
    """
    curves = assess_curves(sweeps)
    if not curves:
        return []
    heads = ["measure", "sequence", "split", "scene", "light", "truth", "depth_of_focus", *_NAMES]
    lines = [
        [
            row.measure,
            row.sweep.sequence,
            row.sweep.split,
            row.sweep.scene,
            row.sweep.light,
            row.sweep.truth if isfinite(row.sweep.truth) else None,
            depth_of_focus(row.sweep.depth_of_focus),
            *(None if row.quality is None else getattr(row.quality, name) for name in _NAMES),
        ]
        for row in curves
    ]
    measures = [
        [row.measure, row.curves, row.without_quality, *row.medians.values()]
        for row in summarise_measures(curves)
    ]
    out = Path(folder)
    texts = {
        "curves.csv": format_csv(heads, lines),
        "measures.csv": format_csv(["measure", "curves", "without", *QUALITY_MEANINGS], measures),
    }
    for name, text in texts.items():
        write_text_atomically(out / name, text)
    return [out / name for name in texts]


def _quality(sweep: SweepSummary, curve: FocusCurve) -> CurveQuality | None:
    lens = sweep.focus_position
    if lens is None or not np.isfinite(lens).all():
        return None
    truth = sweep.truth
    if sweep.track is not None and curve.scores.size:
        whole = isfinite(truth) and np.isfinite(sweep.track).all()  # else unknown: see scores.judge
        truth = (
            interpolate_position(float(curve.frames[curve.scores.argmax()]), sweep.track) if whole else nan
        )
    return assess_focus_curve(
        np.interp(curve.frames, np.arange(len(lens)), lens),
        curve.scores,
        truth=truth if isfinite(truth) else None,
        depth=depth_of_focus(sweep.depth_of_focus),
    )


def _median(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.median(known)) if known else None


def _order(row: MeasureRow) -> tuple[float, str]:
    accuracy = row.medians["accuracy_dof"]
    return (float("inf") if accuracy is None else accuracy, row.measure)
