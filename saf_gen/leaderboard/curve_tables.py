"""Focus curves as tables: the quality of each curve, and how the measures compare.

The curves are those that argmax computed. A curve that is constant, or over a lens that comes back or rests,
has no quality: its fields are empty, and it is counted.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from math import inf
from pathlib import Path

from saf_gen.benchmark.curve_quality import AssessedCurve, CurveQuality
from saf_gen.core.files import write_text_atomically
from saf_gen.leaderboard.averages import median_magnitude_for_ranking
from saf_gen.leaderboard.csv_output import format_leaderboard_csv

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
class MeasureRow:
    """One measure over all its curves; ``medians`` by the names of QUALITY_MEANINGS, None where unknown."""

    measure: str
    curves: int
    without_quality: int
    """Number of curves without a quality."""
    medians: dict[str, float | None]


def rank_measures_by_curves(curves: Sequence[AssessedCurve]) -> list[MeasureRow]:
    """Return a row per measure, the most accurate first; those of unknown accuracy last, by name."""
    by_measure: dict[str, list[AssessedCurve]] = {}
    for row in curves:
        by_measure.setdefault(row.measure, []).append(row)
    rows = []
    for measure, own in by_measure.items():
        known = [row.quality for row in own if row.quality is not None]
        medians = {name: median_magnitude_for_ranking(getattr(q, name) for q in known) for name in QUALITY_MEANINGS}
        rows.append(MeasureRow(measure, len(own), len(own) - len(known), medians))
    return sorted(rows, key=_sort_key)


def write_leaderboard_curves(folder: str | Path, curves: Sequence[AssessedCurve]) -> list[Path]:
    """Write curves.csv and measures.csv into ``folder``, unless there is no curve, and return their paths.

    Unknown numbers are empty fields. Raises BadInput where a file cannot be written.
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
        write_text_atomically(Path(folder) / name, text)
    return [Path(folder) / name for name in texts]


def _sort_key(row: MeasureRow) -> tuple[float, str]:
    accuracy = row.medians["accuracy_dof"]
    return inf if accuracy is None else accuracy, row.measure
