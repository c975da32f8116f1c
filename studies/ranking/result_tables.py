"""Write the tables of a page of results from the records that are kept beside it.

    python -m studies.ranking.result_tables [PAGE]

PAGE is saf_bench.md, unless another is named. The packed records lie in a folder of the page's name, a file for each
evaluation. A table stands between ``<!-- table: KIND FILE... -->`` and ``<!-- end -->``; KIND is a key of ``TABLES``. A
name of a file may be followed by a bin of a condition of the leaderboard: ``inside[stratum=relief]``. Everything else
on a page is written by hand.
"""

import argparse
import re
import sys
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

from saf_gen.benchmark.records import Record
from saf_gen.core.table import percent
from saf_gen.errors import BadInput, unknown
from saf_gen.leaderboard import rank_methods
from saf_gen.leaderboard.ranking import LeaderboardRow
from saf_gen.leaderboard.results import AXES
from studies.ranking import cameras
from studies.ranking.packed_records import read_packed_records

PAGE = Path(__file__).resolve().parents[1] / "results" / "saf_bench.md"
TABLE = re.compile(r"(<!-- table: (\w+) (.+?) -->\n).*?(<!-- end -->)", re.DOTALL)
COLUMN = re.compile(r"([\w.-]+)(?:\[(\w+)=([^\]]+)\])?")
SHOWN = (
    *("fine_structure+bell_vote", "fine_structure+bell_vote:area=true", "fine_structure+argmax_light"),
    *("octave_structure+argmax_light", "octave_structure+argmax:window=300", "octave_structure+peak_fit"),
    "tenengrad_n+argmax",
    *("vollath_f4_n+block_vote", "gradient_code_n+egs_code", "sd_code+egs_code", "sd_code+sgfs_code"),
    *("sd+sgfs_causal", "sd+argmax", "er_sumsq+argmax", "sd+middle"),
)
"""Methods of the tables that do not list all: ours, the best of other searches, the paper's, and guessing."""
FAR_DOF = 2.0
EARLY, GUESS = 0.9, 0.5
"""Largest share of the frames, and least success, of a method in the table of frames."""


class Column(NamedTuple):
    """Records of a file beside a page, or of a bin of a condition in it."""

    file: Path
    axis: str
    bin: str

    @property
    def title(self) -> str:
        """What the column holds, in words."""
        return self.file.name.removesuffix("-records.xz").replace("_", " ") + (f", {self.bin}" if self.bin else "")

    def records(self) -> list[Record]:
        """Return the records of all methods."""
        conditions = {axis.name: axis.bin_of for axis in AXES}
        if self.axis and self.axis not in conditions:
            raise unknown("condition", self.axis, allowed=conditions)
        return [r for r in _read(self.file) if not self.axis or conditions[self.axis](r) == self.bin]

    def rows(self, methods: Sequence[str] = ()) -> dict[str, LeaderboardRow]:
        """Return the row of each method, best first; of these methods only, if some are named."""
        return _rank(self, tuple(methods))


@cache
def _read(file: Path) -> list[Record]:
    return read_packed_records(file)


@cache
def _rank(column: Column, methods: tuple[str, ...]) -> dict[str, LeaderboardRow]:
    records = [record for record in column.records() if not methods or record.who.method in methods]
    return {row.method: row for row in rank_methods(records)}


def _percent(fraction: float | None) -> str:
    return "–" if fraction is None else percent(fraction).removesuffix("%")


def _success(row: LeaderboardRow, *, ends: bool = False) -> str:
    """Return the success within one depth of focus, with its interval if asked, and within half in brackets if not."""
    if row.answerable_1dof is None:
        return "–"
    if not ends or row.answerable_1dof_low is None or row.answerable_1dof_high is None:
        return f"{_percent(row.answerable_1dof)} ({100 * (row.answerable_half_dof or 0):.0f})"
    low, high = 100 * row.answerable_1dof_low, 100 * row.answerable_1dof_high
    return f"{_percent(row.answerable_1dof)} [{low:.0f}–{high:.0f}]"


def _grid(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    return "".join(f"|{'|'.join(line)}|\n" for line in (header, ["---"] * len(header), *rows))


def tabulate_all(columns: Sequence[Column]) -> str:
    """Return a table of all methods, in the order of the first column, with success in the others."""
    first = columns[0]
    header = ["#", "method", *(word for c in columns for word in (f"{c.title}: ≤ 1 DoF, %", "≤ ½"))]
    rows = []
    for method, row in first.rows().items():
        cells = [str(row.rank), f"`{method}`"]
        for column in columns:
            at = column.rows()[method]
            level = "~" if at.level_with_best and at.rank != 1 else ""
            cells += [f"{_success(at, ends=True)}{level}", _percent(at.answerable_half_dof)]
        error = "–" if row.median_error_dof is None else f"{row.median_error_dof:.2f}"
        rows.append([*cells, error, _percent(row.frames_seen)])
    return _grid([*header, f"{first.title}: median error, DoF", "frames seen, %"], rows)


def tabulate_success(columns: Sequence[Column]) -> str:
    """Return a table of success within one (half a) depth of focus, of the methods shown that each column has."""
    held = [column.rows(SHOWN) for column in columns]
    methods = [method for method in SHOWN if all(method in rows for rows in held)]
    lines = ([f"`{method}`", *(_success(rows[method]) for rows in held)] for method in methods)
    return _grid(["method", *(column.title for column in columns)], lines)


def tabulate_drives(columns: Sequence[Column]) -> str:
    """Return a table of success in the closed loop and the mean time until the lens was in focus, of all methods."""

    held = [column.rows() for column in columns]

    def cell(row: LeaderboardRow | None) -> str:
        time = None if row is None else row.time_to_focus_s
        return f"{_percent(row.answerable_1dof if row else None)}, {'–' if time is None else f'{time:.2f}'}"

    lines = ([f"`{method}`", *(cell(rows.get(method)) for rows in held)] for method in held[0])
    return _grid(["method", *(column.title.removeprefix("loop ") for column in columns)], lines)


def tabulate_abstention(columns: Sequence[Column]) -> str:
    """Return a table of false answers and false abstentions of each method that abstained somewhere."""
    methods = dict.fromkeys(m for c in columns for m, row in c.rows().items() if row.abstained)
    header = ["method"]
    for column in columns:
        row = next(iter(column.rows().values()))
        header += [f"{column.title}: answers, of {row.without_answer} without a focus"]
        header += [f"{column.title}: no answer, of {row.answerable} with one"]
    lines = []
    best = columns[0].rows()
    for method in sorted(methods, key=lambda m: ((best[m].false_abstentions or 0) + (best[m].false_answers or 0), m)):
        held = [column.rows()[method] for column in columns]
        lines.append([f"`{method}`", *(str(n) for row in held for n in (row.false_answers, row.false_abstentions))])
    return _grid(header, lines)


def tabulate_wrong(columns: Sequence[Column]) -> str:
    """Return a table of wrong answers, and of those beyond two depths of focus, of the best methods shown."""
    lines = []
    for method in SHOWN[:3]:
        cells = [f"`{method}`"]
        for column in columns:
            held = [r for r in column.records() if r.who.method == method and r.answerable]
            wrong = [r.judgement.error_dof for r in held if not r.success()]
            far = sum(error is None or abs(error) > FAR_DOF for error in wrong)
            cells.append(f"{len(wrong)} of {len(held)} ({far})")
        lines.append(cells)
    return _grid(["method", *(column.title for column in columns)], lines)


def tabulate_frames(columns: Sequence[Column]) -> str:
    """Return a table of the frames seen, beside the success, of each method that stops before the sweep ends."""
    held = [column.rows() for column in columns]
    early = [
        m for m, row in held[0].items() if (row.frames_seen or 1.0) < EARLY and (row.answerable_1dof or 0.0) > GUESS
    ]

    def cell(row: LeaderboardRow | None) -> str:
        return "–" if row is None else f"{_percent(row.frames_seen)}: {_percent(row.answerable_1dof)}"

    lines = ([f"`{method}`", *(cell(rows.get(method)) for rows in held)] for method in early)
    return _grid(["method", *(column.title for column in columns)], lines)


def _light(column: Column) -> str:
    """Return light and time of a file of ``studies.ranking.native``, after its split and condition if not ``test``."""
    first, *rest = column.title.split("-")
    said = " ".join(rest[:2] if rest[2:3] == ["1"] else rest[:4])
    return ", ".join(word for word in (first.removeprefix("test").strip(), said) if word)


def tabulate_cameras(columns: Sequence[Column]) -> str:
    """Return a table of the success of each camera's methods at each level of light, a column each."""
    levels = [cameras.level_of(column.records()) for column in columns]
    lines = ([camera, f"`{method}`"] for camera, method in cameras.order(levels))
    cells = (cameras.success_cells(levels, key) for key in cameras.order(levels))
    header = ["camera", "method", *(_light(column) for column in columns)]
    return _grid(header, (line + row for line, row in zip(lines, cells, strict=True)))


def tabulate_camera_leads(columns: Sequence[Column]) -> str:
    """Return a table of the points by which the best method of each camera is ahead of that of the spike camera."""
    levels = [cameras.level_of(column.records()) for column in columns]
    others = dict.fromkeys(camera for camera, _ in cameras.order(levels) if camera != cameras.BASE)
    header = ["camera", *(_light(column) for column in columns)]
    return _grid(header, ([camera, *cameras.lead_cells(levels, camera)] for camera in others))


def tabulate_camera_costs(columns: Sequence[Column]) -> str:
    """Return a table of the median error of each camera's methods, success by its own depth, and bits sent."""
    levels = [cameras.level_of(column.records()) for column in columns]
    header = ["camera", "method"]
    for column in columns:
        header += [f"{_light(column)}: median error, DoF", "≤ 1 DoF of its own, %", "Mbit"]
    lines = []
    for camera, method in cameras.order(levels):
        lines.append([camera, f"`{method}`"])
        for level in levels:
            lines[-1] += cameras.cost_cells(level, (camera, method))
    return _grid(header, lines)


TABLES: dict[str, Callable[[Sequence[Column]], str]] = {
    "all": tabulate_all,
    "success": tabulate_success,
    "drives": tabulate_drives,
    "abstention": tabulate_abstention,
    "wrong": tabulate_wrong,
    "frames": tabulate_frames,
    "cameras": tabulate_cameras,
    "camera_leads": tabulate_camera_leads,
    "camera_costs": tabulate_camera_costs,
}


def rewrite(page: str, folder: Path) -> str:
    """Return the text of a page with its tables made from the records of a folder.

    Raises BadInput if a file of records cannot be read, or if there is no such kind of table or condition.
    """

    def make(found: re.Match[str]) -> str:
        begin, kind, names, end = found.groups()
        if kind not in TABLES:
            raise unknown("table", kind, allowed=TABLES)
        columns = [Column(folder / f"{file}-records.xz", axis, name) for file, axis, name in COLUMN.findall(names)]
        return f"{begin}\n{TABLES[kind](columns)}\n{end}"

    return TABLE.sub(make, page)


def main(argv: Sequence[str] | None = None) -> int:
    """Write the page, and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("page", type=Path, nargs="?", default=PAGE)
    page = parser.parse_args(argv).page
    try:
        text = rewrite(page.read_text(encoding="utf-8"), page.with_suffix(""))
    except (BadInput, OSError) as error:
        print(error, file=sys.stderr)
        return 2
    page.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
