"""Writes the tables of contest.md and claims.md from the evaluations of both tracks.

    python benchmarks/contest_tables.py RECORDED [CLOSED_LOOP]

RECORDED and CLOSED_LOOP are folders that ``saf-gen evaluate`` wrote; without the second, tables of the closed loop stay
as they are. A table stands between ``<!-- table: NAME -->`` and ``<!-- end -->``; NAME is a key of ``TABLES``. All else
on a page is written by hand.
"""

import argparse
import json
import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
PAGES = HERE / "contest.md", HERE / "claims.md"
TABLE = re.compile(r"(<!-- table: ([a-z_]+) -->\n).*?(<!-- end -->)", re.DOTALL)
NEIGHBOURS = 12
"""Pairs of neighbours in rank that a page shows, from the best down."""
RECORDED_SHOWN = (
    *("octave_structure+peak_fit", "structure_calibrated+peak_fit", "structure_calibrated+photon_aware"),
    *("gradient_code_n+egs_code", "gradient_code_n+argmax", "cen+argmax", "sd_code+argmax", "sd_code+egs_code"),
    *("sd_code+sgfs_code", "er_sumsq+argmax"),
)
CLOSED_LOOP_SHOWN = (
    *("octave_structure+peak_fit", "structure_calibrated+peak_fit", "structure_calibrated+photon_aware"),
    *("sd_code+sgfs_code", "sd+sgfs_causal", "gradient_code_n+golden_section", "gradient_code_n+hill_climb"),
)
CLAIMS_SHOWN = (
    *("sd_code+argmax", "sd_code+egs_code", "sd_code+sgfs_code", "gradient_code+argmax", "gradient_code_n+argmax"),
    *("gradient_code_n+egs_code", "mfdct_code+argmax", "mfdct_code_n+argmax", "mfdct_lee+argmax"),
    *("mfdct_lee_n+argmax", "er_sumsq+argmax", "cen+argmax", "sd_calibrated+photon_aware"),
    *("structure_calibrated+photon_aware", "octave_structure+peak_fit"),
)
AXES = "light", "light_ratio", "scene_motion", "lens_motion", "photon_budget", "focus_position", "grain"
Document = dict[str, Any]


def format_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table."""
    lines = [header, ["---"] * len(header), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def format_percent(fraction: float | None) -> str:
    """Return a fraction as whole per cent, a half upwards, as the leaderboard prints it."""
    return "–" if fraction is None else f"{fraction + 1e-9:.0%}".replace("%", " %")


def format_interval(row: Document, name: str) -> str:
    """Return the 95 % interval of a fraction, in per cent."""
    low, high = row[f"{name}_low"], row[f"{name}_high"]
    return "–" if low is None or high is None else f"{100 * low + 1e-7:.0f}–{100 * high + 1e-7:.0f}"


def format_number(value: float | None, digits: int) -> str:
    """Return a number with so many digits, or a dash where it is not known."""
    return "–" if value is None else f"{value:.{digits}f}"


def tabulate_recorded_contest(recorded: Document, closed_loop: Document) -> str:
    """Return all methods on recordings, best first."""
    header = "#", "ranks (95 %)", "method", "within ½ DoF", "within 1 DoF", "95 %", "median error, DoF", "frames seen"
    rows = ([*_first_cells(row), *_success_cells(row), format_percent(row["frames_seen"])] for row in recorded["rows"])
    return format_table(header, rows)


def tabulate_closed_loop_contest(recorded: Document, closed_loop: Document) -> str:
    """Return all methods in the closed loop, best first."""
    costs = "to focus, s", "95 %", "turns", "hunts"
    header = "#", "ranks (95 %)", "method", "within ½ DoF", "within 1 DoF", "95 %", "median error, DoF", *costs
    rows = (
        [
            *_first_cells(row),
            *_success_cells(row),
            format_number(row["time_to_focus_s"], 3),
            f"{format_number(row['time_to_focus_low_s'], 3)}–{format_number(row['time_to_focus_high_s'], 3)}",
            format_number(row["reversals"], 1),
            format_percent(row["hunting"]),
        ]
        for row in closed_loop["rows"]
    )
    return format_table(header, rows)


def _first_cells(row: Document) -> list[str]:
    rank = f"{row['rank']}{'=' if row['tied'] else ''}{'~' if row['level_with_best'] and row['rank'] > 1 else ''}"
    return [rank, f"{row['rank_best']}–{row['rank_worst']}", f"`{row['method']}`"]


def _success_cells(row: Document) -> list[str]:
    return [
        format_percent(row["success_half_dof"]),
        format_percent(row["success_1dof"]),
        format_interval(row, "success_1dof"),
        format_number(row["median_error_dof"], 2),
    ]


def tabulate_recorded_conditions(recorded: Document, closed_loop: Document) -> str:
    """Return success on recordings under each condition, for methods worth a column."""
    return _tabulate_axes(recorded, RECORDED_SHOWN, AXES)


def tabulate_closed_loop_conditions(recorded: Document, closed_loop: Document) -> str:
    """Return success in the closed loop under each condition, for methods worth a column."""
    return _tabulate_axes(closed_loop, CLOSED_LOOP_SHOWN, [axis for axis in AXES if axis != "lens_motion"])


def tabulate_recorded_scenes(recorded: Document, closed_loop: Document) -> str:
    """Return success on recordings of each scene, for methods worth a column."""
    return _tabulate_axes(recorded, RECORDED_SHOWN, ["scene"])


def tabulate_closed_loop_scenes(recorded: Document, closed_loop: Document) -> str:
    """Return success in the closed loop on each scene, for methods worth a column."""
    return _tabulate_axes(closed_loop, CLOSED_LOOP_SHOWN, ["scene"])


def _tabulate_axes(document: Document, methods: Sequence[str], names: Iterable[str]) -> str:
    tables = {table["axis"]: table for table in document["axes"]}
    rows = []
    for name in (name for name in names if name in tables):
        table = tables[name]
        for place, one in enumerate(table["bins"]):
            cells = (format_percent(table["methods"][method][place]["success_1dof"]) for method in methods)
            title = one["bin"] if name == "scene" else f"{name.replace('_', ' ')}: {one['bin']}"
            rows.append([title, str(one["scenes"]), str(one["sequences"]), *cells])
    return format_table(["condition", "scenes", "sequences", *(f"`{method}`" for method in methods)], rows)


def tabulate_division(recorded: Document, closed_loop: Document) -> str:
    """Return each measure beside the same measure divided by brightness, by an exhaustive search."""
    success = {row["method"]: row["success_1dof"] for row in recorded["rows"]}
    twins = {method: _undivide(method) for method in success}
    gains = {plain: success[method] - success[plain] for method, plain in twins.items() if plain in success}
    rows = (
        [
            f"`{plain.removesuffix('+argmax')}`",
            format_percent(success[plain]),
            format_percent(success[plain] + gain),
            f"{100 * gain:+.0f}",
        ]
        for plain, gain in sorted(gains.items(), key=lambda item: (-item[1], item[0]))
    )
    return format_table(["measure", "as it is", "divided by brightness", "gain, points"], rows)


def _undivide(method: str) -> str:
    """Return the method whose measure is not divided, of ``NAME_n+argmax``; '' of any other."""
    measure, _, search = method.partition("+")
    return f"{measure.removesuffix('_n')}+argmax" if measure.endswith("_n") and search == "argmax" else ""


def tabulate_recorded_neighbours(recorded: Document, closed_loop: Document) -> str:
    """Return the best methods on recordings, each beside the next in rank."""
    return _tabulate_neighbours(recorded)


def tabulate_closed_loop_neighbours(recorded: Document, closed_loop: Document) -> str:
    """Return the best methods in the closed loop, each beside the next in rank."""
    return _tabulate_neighbours(closed_loop)


def _tabulate_neighbours(document: Document) -> str:
    rows = (
        [
            f"`{pair['first']}`",
            f"`{pair['second']}`",
            f"{100 * pair['difference']:+.1f}",
            f"{100 * pair['difference_low']:+.1f} to {100 * pair['difference_high']:+.1f}",
            format_percent(pair["improvement"]),
            format_interval(pair, "improvement"),
            "yes" if pair["told_apart"] else "no",
        ]
        for pair in document["neighbours"][:NEIGHBOURS]
    )
    return format_table(["method", "next", "difference, points", "95 %", "nearer in", "95 %", "told apart"], rows)


def tabulate_recorded_agreement(recorded: Document, closed_loop: Document) -> str:
    """Return how far the ranking on recordings hangs on each condition."""
    return _tabulate_agreement(recorded)


def tabulate_closed_loop_agreement(recorded: Document, closed_loop: Document) -> str:
    """Return how far the ranking in the closed loop hangs on each condition."""
    return _tabulate_agreement(closed_loop)


def _tabulate_agreement(document: Document) -> str:
    rows = (
        [
            one["condition"].replace("_", " "),
            one["first"],
            one["second"],
            format_number(one["tau"], 2),
            "–" if one["low"] is None else f"{one['low']:.2f}–{one['high']:.2f}",
            format_number(one["by_chance"], 2),
            format_number(one["p_value"], 3),
        ]
        for one in document["rank_agreement"]
    )
    return format_table(["condition", "", "", "τ", "95 %", "by chance", "p"], rows)


def tabulate_claims(recorded: Document, closed_loop: Document) -> str:
    """Return success by light for the methods that the paper's claims are about."""
    lights = [bin_["bin"] for table in recorded["axes"] if table["axis"] == "light" for bin_ in table["bins"]]
    rows = {row["method"]: row for row in recorded["rows"]}
    lines = (
        [
            f"`{method}`",
            *(format_percent(rows[method][f"success_1dof_light_{light}"]) for light in lights),
            *_success_cells(rows[method])[1:],
        ]
        for method in CLAIMS_SHOWN
    )
    return format_table(["method", *lights, "all", "95 %", "error"], lines)


TABLES: dict[str, Callable[[Document, Document], str]] = {
    "recorded": tabulate_recorded_contest,
    "recorded_conditions": tabulate_recorded_conditions,
    "recorded_scenes": tabulate_recorded_scenes,
    "recorded_neighbours": tabulate_recorded_neighbours,
    "recorded_agreement": tabulate_recorded_agreement,
    "division": tabulate_division,
    "closed_loop": tabulate_closed_loop_contest,
    "closed_loop_conditions": tabulate_closed_loop_conditions,
    "closed_loop_scenes": tabulate_closed_loop_scenes,
    "closed_loop_neighbours": tabulate_closed_loop_neighbours,
    "closed_loop_agreement": tabulate_closed_loop_agreement,
    "claims": tabulate_claims,
}


def rewrite(page: str, recorded: Document, closed_loop: Document | None = None) -> str:
    """Return the text of a page with its tables made anew."""

    def make(found: re.Match[str]) -> str:
        if closed_loop is None and found[2].startswith("closed_loop"):
            return found[0]
        return f"{found[1]}\n{TABLES[found[2]](recorded, closed_loop or {})}\n{found[3]}"

    return TABLE.sub(make, page)


def main() -> None:
    """Write both pages."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recorded", type=Path)
    parser.add_argument("closed_loop", type=Path, nargs="?")
    folders = parser.parse_args()
    documents = [
        json.loads((folder / "leaderboard.json").read_text(encoding="utf-8"))
        for folder in (folders.recorded, folders.closed_loop)
        if folder is not None
    ]
    for page in PAGES:
        page.write_text(rewrite(page.read_text(encoding="utf-8"), *documents), encoding="utf-8")


if __name__ == "__main__":
    main()
