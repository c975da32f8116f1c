"""The leaderboard as text for readers: Markdown, LaTeX, and notes on how to interpret the numbers."""

from collections.abc import Sequence
from itertools import groupby

from saf_gen.benchmark.records import Record
from saf_gen.core.config.frozen_benchmarks import read_frozen_digests
from saf_gen.core.plain_text import escape_markdown
from saf_gen.errors import escape_controls
from saf_gen.leaderboard.axes import AxisTable, BinSummary
from saf_gen.leaderboard.columns import ALL, Column, format_leaderboard_percent, list_shown_leaderboard_columns
from saf_gen.leaderboard.grain_tables import compose_leaderboard_grain_notes
from saf_gen.leaderboard.method_comparison import NeighbourComparison, Profile
from saf_gen.leaderboard.rank_agreement import RankAgreement
from saf_gen.leaderboard.rows import LeaderboardRow
from saf_gen.leaderboard.scene_intervals import MIN_SCENES

NEIGHBOUR_HEADERS = ("method", "next in rank", "difference, points", "95 %", "P(nearer)", "95 % ", "told apart")
AGREEMENT_HEADERS = ("condition", "first", "second", "methods", "scenes", "τ", "95 %", "by chance", "p", "most moved")
AGREEMENT_NOTE = (
    "τ is 1 if both rankings order the methods alike. By chance: the τ to expect if the condition had no effect."
    " p: the probability that τ would then be as low, for this pair alone."
)
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


def format_leaderboard_markdown(rows: Sequence[LeaderboardRow]) -> str:
    """Return the table as GitHub-flavoured Markdown."""
    shown = list_shown_leaderboard_columns(rows)
    body = [[escape_markdown(c.format_value(row)) for c in shown] for row in rows]
    return format_ranking_grid(
        [escape_markdown(c.header) for c in shown], body, is_left=[c.justify == "left" for c in shown]
    )


def format_leaderboard_axis(table: AxisTable) -> str:
    """Return the table of one axis as Markdown: success within 1 DoF and, in brackets, the median error in DoF."""
    headers = [
        f"{escape_markdown(name)}<br>{format_leaderboard_count(scenes, 'scene')}, "
        f"{format_leaderboard_count(sequences, 'sequence')}"
        for name, scenes, sequences in zip(table.bins, table.scenes, table.sequences, strict=True)
    ]
    body = [[escape_markdown(method), *map(format_leaderboard_bin, cells)] for method, cells in table.cells.items()]
    return format_ranking_grid(["method", *headers], body, is_left=[True] + [False] * len(headers))


def format_leaderboard_latex(rows: Sequence[LeaderboardRow]) -> str:
    """Return all but the most detailed columns as a LaTeX ``tabular`` that uses the rules of the package booktabs."""
    shown = [c for c in list_shown_leaderboard_columns(rows) if c.detail < ALL]
    headers, rules, first = [], [], 1
    for group, columns in groupby(shown, key=lambda c: c.group):
        span = len(list(columns))
        headers.append(rf"\multicolumn{{{span}}}{{c}}{{{escape_leaderboard_latex(group)}}}")
        if group:
            rules.append(rf"\cmidrule(lr){{{first}-{first + span - 1}}}")
        first += span
    lines = [
        r"% needs \usepackage{booktabs}",
        rf"\begin{{tabular}}{{{''.join('l' if c.justify == 'left' else 'r' for c in shown)}}}",
        r"\toprule",
        " & ".join(headers) + r" \\",
        "".join(rules),
        " & ".join(escape_leaderboard_latex(c.header) for c in shown) + r" \\",
        r"\midrule",
        *(" & ".join(escape_leaderboard_latex(c.format_value(row)) for c in shown) + r" \\" for row in rows),
        r"\bottomrule",
        r"\end{tabular}",
    ]
    return "\n".join(line for line in lines if line) + "\n"


def escape_leaderboard_latex(text: str) -> str:
    """Return the text on one line, with LaTeX's special characters escaped."""
    return "".join(_LATEX.get(character, character) for character in escape_controls(" ".join(text.split())))


def explain_leaderboard_columns(shown: Sequence[Column]) -> str:
    """Return the meanings of the columns as a Markdown list, one line per column."""
    return "".join(f"- **{escape_markdown(c.header)}**: {escape_markdown(c.meaning)}\n" for c in shown)


def compose_leaderboard_notes(rows: Sequence[LeaderboardRow], records: Sequence[Record]) -> list[str]:
    """Return the notes that a reader needs to interpret the numbers, one or two sentences each."""
    notes = _name_benchmark(records)
    notes += ["Success and cost are averaged over each scene's lights, then over scenes; errors are medians."]
    reason = next((row.missing_reason for row in rows if row.missing_reason), "")
    scenes = len({r.scene for r in records if r.success_1dof is not None})
    if reason:
        notes.append(f"There are no intervals: only {reason} have a known truth.")
    elif scenes:
        notes.append(
            f"Each 95 % interval over {scenes} scenes holds alone; rank intervals hold for all rivals of a row at once"
            + ("; with so few scenes, almost no methods can be told apart." if scenes < 2 * MIN_SCENES else ".")
        )
    notes += compose_leaderboard_grain_notes(records)
    machines = sorted({r.machine for r in records if r.machine})
    if len(machines) > 1:
        notes.append(f"Seconds cannot be compared: they come from {len(machines)} machines: {'; '.join(machines)}.")
    return notes


def _name_benchmark(records: Sequence[Record]) -> list[str]:
    """Return a sentence, in a list, that names the benchmark and the number of its sequences that the records cover.

    The list is empty if the records do not all belong to the same frozen benchmark.
    """
    named = {r.benchmark for r in records}
    label = named.pop() if len(named) == 1 else None
    if label is None:
        return []
    frozen = read_frozen_digests().get(label.partition(" ")[0])
    frozen_sequences = frozen.sequences if frozen is not None else {}
    judged: dict[str, set[str]] = {}
    for record in records:
        judged.setdefault(record.split or "", set()).add(record.sequence)
    covered = [
        f"{len(names)}{f' of {frozen_sequences[split]}' if split in frozen_sequences else ''} sequences of "
        f"{split or 'no split'}"
        for split, names in sorted(judged.items())
    ]
    return [f"The benchmark is {label}: {', '.join(covered)}."]


def format_ranked_neighbours(pair: NeighbourComparison) -> list[str]:
    """Return the texts of a row of the table with NEIGHBOUR_HEADERS."""
    known = pair.difference_low is not None and pair.difference_high is not None
    points = [f"{100 * (value or 0):+.0f}".replace("-", "−") for value in (pair.difference_low, pair.difference_high)]
    improved = [f"{value or 0:.2f}" for value in (pair.improvement_low, pair.improvement_high)]
    return [
        *(pair.first, pair.second, f"{100 * pair.difference:+.0f}".replace("-", "−")),
        " to ".join(points) if known else "–",
        f"{pair.improvement:.2f}",
        " to ".join(improved) if known else "–",
        ("yes" if pair.told_apart else "no") if known else "–",
    ]


def format_ranked_neighbours_markdown(neighbours: Sequence[NeighbourComparison]) -> str:
    """Return the table of neighbours in rank as Markdown."""
    body = [[escape_markdown(text) for text in format_ranked_neighbours(pair)] for pair in neighbours]
    return format_ranking_grid(NEIGHBOUR_HEADERS, body, is_left=[n < 2 for n in range(len(NEIGHBOUR_HEADERS))])


def format_leaderboard_profiles_markdown(profiles: Sequence[Profile]) -> str:
    """Return the profiles of one quantity as a Markdown table of the fractions within each limit."""
    headers = ["method", *(f"≤{limit:.3g}" for limit in profiles[0].limits)]
    body = [[escape_markdown(one.method), *map(format_leaderboard_percent, one.fractions)] for one in profiles]
    return format_ranking_grid(headers, body, is_left=[True] + [False] * (len(headers) - 1))


def format_rank_agreement(one: RankAgreement) -> list[str]:
    """Return the texts of a row of the table with AGREEMENT_HEADERS."""

    def text(value: float | None, digits: int = 2) -> str:
        return "–" if value is None else f"{value:.{digits}f}"

    name, before, after = one.most_moved
    interval = "–" if one.low is None else f"{text(one.low)} to {text(one.high)}"
    scenes = str(one.scenes) if one.shared == one.scenes else f"{one.scenes} ({one.shared} in both)"
    moved = "none" if before == after else f"{name}: {before} to {after}"
    return [
        *(one.condition.replace("_", " "), one.first, one.second, str(one.methods), scenes),
        *(text(one.tau), interval, text(one.by_chance), text(one.p_value, 3), moved),
    ]


def format_rank_agreement_markdown(found: Sequence[RankAgreement]) -> str:
    """Return the table of rank agreements as Markdown."""
    body = [[escape_markdown(text) for text in format_rank_agreement(one)] for one in found]
    return format_ranking_grid(
        AGREEMENT_HEADERS, body, is_left=[n in (0, 1, 2, 9) for n in range(len(AGREEMENT_HEADERS))]
    )


def format_leaderboard_bin(summary: BinSummary) -> str:
    """Return the text of a cell: success within 1 DoF in per cent and, in brackets, the median error in DoF."""
    if summary.success_1dof is None:
        return "–"
    error = "" if summary.median_error_dof is None else f" ({summary.median_error_dof:.2f})"
    return format_leaderboard_percent(summary.success_1dof) + error


def format_leaderboard_count(count: int, noun: str) -> str:
    """Return the number and its noun, in the plural unless the number is 1."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def format_ranking_grid(headers: Sequence[str], body: Sequence[Sequence[str]], *, is_left: Sequence[bool]) -> str:
    """Return a Markdown table of texts that are already escaped."""
    lines = [headers, ["---" if left else "---:" for left in is_left], *body]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)
