"""Tables of focus curves: the quality of each curve, and a comparison of the measures.

The curves come from the search argmax. The quality of a curve is undefined if the curve is constant or too short, or if
the lens turned back or rested. Its fields are then empty, and tables give the number of these curves.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from math import inf
from pathlib import Path

from saf_gen.benchmark.curve_quality import AssessedCurve, CurveQuality
from saf_gen.core.files import write_text
from saf_gen.leaderboard.averages import median_magnitude_for_ranking
from saf_gen.leaderboard.csv_output import format_leaderboard_csv

_NAMES = tuple(f.name for f in fields(CurveQuality))
QUALITY_MEANINGS = {
    "accuracy_dof": "Distance of the peak of the curve from the truth, in depths of focus.",
    "accuracy": "Distance of the peak of the curve from the truth, as a fraction of the travel.",
    "range": "Distance between the minima on both sides of the peak, as a fraction of the travel.",
    "false_maxima": "Number of local maxima other than the peak, however small.",
    "false_peaks": "Number of local maxima other than the peak that stand out by over a tenth of the curve's height.",
    "width_50": "Width of the peak at half its height, as a fraction of the travel.",
    "width_80": "Width of the peak at 80 % of its height, as a fraction of the travel.",
    "noise": "Standard deviation of the noise on the curve, as a fraction of the height of the curve.",
}
"""Criteria of the quality of a curve, in the order of the tables, which give the median of each per measure."""


@dataclass(frozen=True)
class MeasureRow:
    """Summary of all curves of one measure."""

    measure: str
    curves: int
    without_quality: int
    """Number of curves whose quality is undefined."""
    medians: dict[str, float | None]
    """Median of each criterion, by the names of QUALITY_MEANINGS; None if unknown."""


def rank_measures_by_curves(curves: Sequence[AssessedCurve]) -> list[MeasureRow]:
    """Return one row per measure, the most accurate first; those of unknown accuracy come last, sorted by name."""
    by_measure: dict[str, list[AssessedCurve]] = {}
    for row in curves:
        by_measure.setdefault(row.measure, []).append(row)
    rows = []
    for measure, group in by_measure.items():
        known = [row.quality for row in group if row.quality is not None]
        medians = {name: median_magnitude_for_ranking(getattr(q, name) for q in known) for name in QUALITY_MEANINGS}
        rows.append(MeasureRow(measure, len(group), len(group) - len(known), medians))
    return sorted(rows, key=_sort_key)


def write_leaderboard_curves(folder: str | Path, curves: Sequence[AssessedCurve]) -> list[Path]:
    """Write curves.csv and measures.csv into ``folder`` and return their paths; without curves, write nothing.

    Unknown numbers become empty fields. Raises BadInput if a file cannot be written.
    """
    if not curves:
        return []
    header = ["measure", "sequence", "split", "scene", "light", "truth", "depth_of_focus", *_NAMES]
    lines = [
        [
            row.measure,
            row.sequence,
            row.split,
            row.scene,
            row.light,
            row.truth,
            row.depth_of_focus,
            *(None if row.quality is None else getattr(row.quality, name) for name in _NAMES),
        ]
        for row in curves
    ]
    measures = [
        [row.measure, row.curves, row.without_quality, *row.medians.values()] for row in rank_measures_by_curves(curves)
    ]
    texts = {
        "curves.csv": format_leaderboard_csv(header, lines),
        "measures.csv": format_leaderboard_csv(["measure", "curves", "without", *QUALITY_MEANINGS], measures),
    }
    for name, text in texts.items():
        write_text(Path(folder) / name, text)
    return [Path(folder) / name for name in texts]


def _sort_key(row: MeasureRow) -> tuple[float, str]:
    accuracy = row.medians["accuracy_dof"]
    return inf if accuracy is None else accuracy, row.measure
