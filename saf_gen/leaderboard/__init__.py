"""Records into a ranking, tables by condition, and the files that tell them.

Methods rank by success within one depth of focus. Success and cost are averaged over scenes (each scene's
light schedules first), so that a scene with many sequences weighs no more than another; errors are medians
over all sequences. Equal success shares a rank, and intervals say which ranks the scenes can tell apart.
"""

from saf_gen.leaderboard.axes import AXES, Axis, AxisTable, Cell, by_axis
from saf_gen.leaderboard.columns import Column, columns, numbers
from saf_gen.leaderboard.curves import CurveRow, MeasureRow, curve_rows, measure_rows, write_curves
from saf_gen.leaderboard.files import write_files
from saf_gen.leaderboard.merging import merged
from saf_gen.leaderboard.rows import Row, table
from saf_gen.leaderboard.texts import latex, markdown, notes

__all__ = [
    "AXES",
    "Axis",
    "AxisTable",
    "Cell",
    "Column",
    "CurveRow",
    "MeasureRow",
    "Row",
    "by_axis",
    "columns",
    "curve_rows",
    "latex",
    "markdown",
    "measure_rows",
    "merged",
    "notes",
    "numbers",
    "table",
    "write_curves",
    "write_files",
]
