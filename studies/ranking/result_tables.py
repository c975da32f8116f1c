"""Write the tables of a page of results from the evaluations of both tracks.

    python -m studies.ranking.result_tables RECORDED [CLOSED_LOOP] [--page PAGE ...]

RECORDED and CLOSED_LOOP are folders that ``saf-gen evaluate`` wrote; without the second, the tables of the closed loop
are not changed. The page is saf_bench-v3.md, or those of ``--page``. A table is placed between ``<!-- table: TRACK
KIND -->`` and ``<!-- end -->``; KIND is a key of ``TABLES``. Everything else on a page is written by hand.
"""

import argparse
import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from saf_gen.core.table import percent

RESULTS = Path(__file__).resolve().parents[1] / "results"
PAGES = (RESULTS / "saf_bench-v3.md",)
TABLE = re.compile(r"(<!-- table: (recorded|closed_loop) (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)
LISTED = 20
"""Number of methods in a table of all, from the best on; the records hold the others."""
CLAIMS_SHOWN = (
    *("sd_code+argmax", "sd_code+egs_code", "sd_code+sgfs_code", "gradient_code+argmax", "gradient_code_n+argmax"),
    *("gradient_code_n+egs_code", "mfdct_code+argmax", "mfdct_code_n+argmax", "mfdct_lee+argmax"),
    *("mfdct_lee_n+argmax", "er_sumsq+argmax", "cen+argmax", "sd_calibrated+photon_aware"),
    *("structure_calibrated+photon_aware", "octave_structure+peak_fit"),
)
FIRST = "#", "ranks (95 %)", "method", "within ½ DoF", "within 1 DoF", "95 %", "median error, DoF"
"""First columns of the tables of all methods."""
Evaluation = dict[str, Any]
"""Content of leaderboard.json, and its folder."""


def format_percent(fraction: float | None) -> str:
    """Return a fraction as integer per cent, or a dash if it is not known."""
    return "–" if fraction is None else percent(fraction).replace("%", " %")


def format_number(value: float | None, digits: int) -> str:
    """Return a number with ``digits`` decimal places, or a dash if it is not known."""
    return "–" if value is None else f"{value:.{digits}f}"


def format_interval(low: float | None, high: float | None, digits: int) -> str:
    """Return the ends of an interval with ``digits`` decimal places, or a dash if it is not known."""
    return "–" if low is None or high is None else f"{low:.{digits}f}–{high:.{digits}f}"


def _format_grid(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    return "".join(f"| {' | '.join(line)} |\n" for line in (header, ["---"] * len(header), *rows))


def tabulate_results(evaluation: Evaluation) -> str:
    """Return a table of the best methods, with the time to focus in the closed loop, else the frames seen."""
    in_closed_loop = evaluation["track"] == ["closed_loop"]
    costs = ("to focus, s", "95 %", "turns", "hunts") if in_closed_loop else ("frames seen",)
    rows = []
    for row in evaluation["rows"][:LISTED]:
        cells = _first_cells(row)
        if in_closed_loop:
            cells += [
                format_number(row["time_to_focus_s"], 3),
                format_interval(row["time_to_focus_low_s"], row["time_to_focus_high_s"], 3),
                format_number(row["reversals"], 1),
                format_percent(row["hunting"]),
            ]
        else:
            cells.append(format_percent(row["frames_seen"]))
        rows.append(cells)
    return _format_grid([*FIRST, *costs], rows)


def tabulate_judged(evaluation: Evaluation) -> str:
    """Return a table of the best methods, with both errors of abstaining, frames and computing time."""
    costs = "false answers", "false abstentions", "frames seen", "s"
    rows = []
    for row in evaluation["rows"][:LISTED]:
        cells = _first_cells(row)
        cells += [str(row["false_answers"]), str(row["false_abstentions"]), format_percent(row["frames_seen"])]
        rows.append([*cells, format_number(row["seconds"], 2)])
    return _format_grid([*FIRST, *costs], rows)


def _first_cells(row: Evaluation) -> list[str]:
    rank = f"{row['rank']}{'=' if row['tied'] else ''}{'~' if row['level_with_best'] and row['rank'] > 1 else ''}"
    cells = [rank, f"{row['rank_best']}–{row['rank_worst']}", f"`{row['method']}`"]
    return [*cells, format_percent(row["answerable_half_dof"]), *_success_cells(row)]


def _success_cells(row: Evaluation) -> list[str]:
    ends = (None if row[key] is None else 100 * row[key] for key in ("answerable_1dof_low", "answerable_1dof_high"))
    success, error = format_percent(row["answerable_1dof"]), format_number(row["median_error_dof"], 2)
    return [success, format_interval(*ends, 0), error]


def tabulate_division(evaluation: Evaluation) -> str:
    """Return a table of the success of each measure with and without division by brightness, with ``argmax``."""
    success = {row["method"]: row["answerable_1dof"] for row in evaluation["rows"]}
    pairs = ((name, f"{name.removesuffix('_n+argmax')}+argmax") for name in success if name.endswith("_n+argmax"))
    gains = {plain: success[divided] - success[plain] for divided, plain in pairs if plain in success}
    rows = (
        [
            f"`{plain.removesuffix('+argmax')}`",
            format_percent(success[plain]),
            format_percent(success[plain] + gain),
            f"{100 * gain:+.0f}",
        ]
        for plain, gain in sorted(gains.items(), key=lambda item: (-item[1], item[0]))
    )
    return _format_grid(["measure", "as it is", "divided by brightness", "gain, points"], rows)


def tabulate_claims(evaluation: Evaluation) -> str:
    """Return a table of success by light for the methods that the claims of the paper concern."""
    key = "answerable_1dof_light_"
    lights = [name.removeprefix(key) for name in evaluation["columns"] if name.startswith(key)]
    rows = {row["method"]: row for row in evaluation["rows"]}
    lines = (
        [
            f"`{method}`",
            *(format_percent(rows[method][f"{key}{light}"]) for light in lights),
            *_success_cells(rows[method]),
        ]
        for method in CLAIMS_SHOWN
    )
    return _format_grid(["method", *lights, "all", "95 %", "error"], lines)


TABLES: dict[str, Callable[[Evaluation], str]] = {
    "results": tabulate_results,
    "judged": tabulate_judged,
    "division": tabulate_division,
    "claims": tabulate_claims,
}


def rewrite(page: str, evaluations: Mapping[str, Evaluation]) -> str:
    """Return the text of a page with the tables of these tracks replaced."""

    def make(found: re.Match[str]) -> str:
        begin, track, kind, end = found.groups()
        return f"{begin}\n{TABLES[kind](evaluations[track])}\n{end}" if track in evaluations else found[0]

    return TABLE.sub(make, page)


def main() -> None:
    """Write the pages."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recorded", type=Path)
    parser.add_argument("closed_loop", type=Path, nargs="?")
    parser.add_argument("--page", type=Path, nargs="+", default=PAGES)
    given = parser.parse_args()
    evaluations = {
        track: json.loads((folder / "leaderboard.json").read_text(encoding="utf-8")) | {"folder": folder}
        for track, folder in (("recorded", given.recorded), ("closed_loop", given.closed_loop))
        if folder is not None
    }
    for page in given.page:
        page.write_text(rewrite(page.read_text(encoding="utf-8"), evaluations), encoding="utf-8")


if __name__ == "__main__":
    main()
