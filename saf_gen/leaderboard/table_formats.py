"""The table for people: Markdown for a readme, LaTeX for a paper, and what a reader must know beside it."""

from collections.abc import Sequence
from itertools import groupby

from saf_gen.benchmark.records import Record
from saf_gen.leaderboard.axes import AxisTable, BinSummary
from saf_gen.leaderboard.columns import WIDE_TERMINAL_WIDTH, Column, format_percent, list_shown_columns
from saf_gen.leaderboard.rows import LeaderboardRow
from saf_gen.leaderboard.statistics import MIN_SCENES

__all__ = ["compose_notes", "escape_latex", "format_axis_markdown", "format_latex", "format_markdown"]

_LATEX = {
    **{sign: f"\\{sign}" for sign in "&%$#_{}"},
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": "$<$",
    ">": "$>$",
    "|": "$|$",
    "≤": r"$\leq$",
    "≥": r"$\geq$",
    "½": r"$\frac{1}{2}$",
    "–": "--",
    "−": "$-$",
    "±": r"$\pm$",
    "×": r"$\times$",
}


def format_markdown(rows: Sequence[LeaderboardRow]) -> str:
    """The table as GitHub-flavoured Markdown."""
    shown = list_shown_columns(rows)
    body = [[c.format_value(row) for c in shown] for row in rows]
    return _grid([c.header for c in shown], body, [c.justify == "left" for c in shown])


def format_axis_markdown(table: AxisTable) -> str:
    """The table of one axis as Markdown: success within 1 DoF, and the median error in brackets."""
    heads = [
        f"{name}<br>{count_noun(scenes, 'scene')}, {count_noun(sequences, 'sequence')}"
        for name, scenes, sequences in zip(table.bins, table.scenes, table.sequences, strict=True)
    ]
    body = [[method, *map(format_bin, cells)] for method, cells in table.cells.items()]
    return _grid(["method", *heads], body, [True] + [False] * len(heads))


def format_latex(rows: Sequence[LeaderboardRow]) -> str:
    """The columns of a usual terminal as a LaTeX ``tabular``, with the rules of the package booktabs."""
    shown = [c for c in list_shown_columns(rows) if c.min_terminal_width < WIDE_TERMINAL_WIDTH]
    groups = [(group, len(list(some))) for group, some in groupby(shown, key=lambda c: c.group)]
    heads, rules, at = [], [], 1
    for group, wide in groups:
        heads.append(rf"\multicolumn{{{wide}}}{{c}}{{{escape_latex(group)}}}")
        if group:
            rules.append(rf"\cmidrule(lr){{{at}-{at + wide - 1}}}")
        at += wide
    lines = [
        r"% needs \usepackage{booktabs}",
        rf"\begin{{tabular}}{{{''.join('l' if c.justify == 'left' else 'r' for c in shown)}}}",
        r"\toprule",
        " & ".join(heads) + r" \\",
        "".join(rules),
        " & ".join(escape_latex(c.header) for c in shown) + r" \\",
        r"\midrule",
        *(" & ".join(escape_latex(c.format_value(row)) for c in shown) + r" \\" for row in rows),
        r"\bottomrule",
        r"\end{tabular}",
    ]
    return "\n".join(line for line in lines if line) + "\n"


def escape_latex(text: str) -> str:
    """Text as LaTeX sets it: its own signs escaped, on one line."""
    return "".join(_LATEX.get(sign, sign) for sign in " ".join(text.split()))


def compose_notes(rows: Sequence[LeaderboardRow], records: Sequence[Record]) -> list[str]:
    """What must be known to read the numbers, a sentence each."""
    out = ["Success and cost are averaged over each scene's lights, then over scenes; errors are medians."]
    why = next((row.missing_reason for row in rows if row.missing_reason), "")
    scenes = len({r.scene for r in records if r.success_1dof is not None})
    if why:
        out.append(f"There are no intervals: {why} with a known truth.")
    elif scenes:
        out.append(
            f"Intervals are 95 % of a paired bootstrap over {scenes} scenes"
            + ("; so few make them too narrow." if scenes < 4 * MIN_SCENES else ".")
        )
    machines = sorted({r.machine for r in records if r.machine})
    if len(machines) > 1:
        out.append(f"Seconds do not compare, they come from {len(machines)} machines: {'; '.join(machines)}.")
    return out


def format_bin(cell: BinSummary) -> str:
    if cell.success_1dof is None:
        return "–"
    error = "" if cell.median_error_dof is None else f" ({cell.median_error_dof:.2f})"
    return format_percent(cell.success_1dof) + error


def count_noun(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"


def _grid(heads: Sequence[str], body: Sequence[Sequence[str]], left: Sequence[bool]) -> str:
    lines = [heads, ["---" if side else "---:" for side in left], *body]
    return "".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |\n" for line in lines)


def explain_columns(shown: Sequence[Column]) -> str:
    """The columns explained, a line of Markdown each."""
    return "".join(f"- **{c.header}**: {c.meaning}\n" for c in shown)
