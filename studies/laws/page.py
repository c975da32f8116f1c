"""The page of laws, Markdown with pictures: what was checked, how and against what, and the results."""

import math
from collections.abc import Mapping, Sequence
from io import BytesIO
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

import saf_gen
from saf_gen.core.files import atomic_file, write_text
from studies.laws.law import FALSE_ALARM, Comparison, Finding, Law, Plot

PAGE, PICTURES = "validation.md", "pictures"
COLOURS = ("#1f5fa8", "#c0392b", "#2a8a4a", "#8a5a00", "#6b3fa0", "#007c8a", "#a83279", "#555555")
SIZE_INCHES, DOTS_PER_INCH = (6.4, 2.7), 100


def write_page(laws: Sequence[Law], findings: Mapping[str, Finding], *, folder: Path, quick: bool) -> Path:
    """Write ``validation.md`` and its pictures to ``folder``, and return the path of the page.

    ``findings`` has the findings of laws by their names. Sections of other laws are kept as they are on a page that is
    there already, and laws without any section are left out. Raises BadInput if a file cannot be written.
    """
    page = folder / PAGE
    kept = _sections(page.read_text(encoding="utf-8")) if page.is_file() else {}
    shown: list[tuple[Law, str, list[str]]] = []
    for law in laws:
        if law.name in findings:
            found = findings[law.name]
            if found.plot is not None:
                draw_plot(found.plot, folder / PICTURES / _picture(law), title=law.name.replace("_", " "))
            shown.append((law, _row(law, found), _section(law, found)))
        elif law.name in kept:
            shown.append((law, *kept[law.name]))
    write_text(page, "\n".join(_lines(shown, quick=quick)) + "\n")
    return page


def _sections(page: str) -> dict[str, tuple[str, list[str]]]:
    """Return the row of the table and the lines of the section of each law on a page, by its name."""
    head, *parts = page.split("\n### ")
    rows = {line[3:].partition("]")[0]: line for line in head.splitlines() if line.startswith("| [")}
    found = {}
    for part in parts:
        lines = part.partition("\n## ")[0].rstrip().split("\n")
        found[lines[0]] = (rows[lines[0]], [f"### {lines[0]}", *lines[1:]])
    return found


def _picture(law: Law) -> str:
    return f"validation-{law.name.replace('_', '-')}.png"


def _lines(shown: list[tuple[Law, str, list[str]]], *, quick: bool) -> list[str]:
    outcomes = [row.split(" | ")[1].strip("*") for _, row, _ in shown]
    counted = {outcome: outcomes.count(outcome) for outcome in dict.fromkeys(outcomes)}
    size = "the small sizes of `--quick`" if quick else "full size"
    lines = [
        "# Validation",
        "",
        f"Made by `make validate` of saf_gen {saf_gen.__version__}, at {size}. "
        f"{'; '.join(f'{count} of {len(shown)} checks {outcome}' for outcome, count in counted.items())}.",
        "",
        "A check writes scenes, a sensor and a recipe to a folder, lets `generate` make the streams, reads them back "
        "and compares them",
        "with a law, with other code or with published figures. Tolerances follow from the statistics of the "
        "workload: all figures of a",
        f"check together fail correct code by chance once in {1 / FALSE_ALARM:,.0f} runs, and seeds are fixed. Known "
        "errors of a law are added to the",
        "tolerance, and stated. *Used* is the largest fraction of its tolerance that a figure uses; above 1 the check "
        "fails.",
        "",
        "| check | outcome | figures | used |",
        "|---|---|---|---|",
    ]
    lines += [row for _, row, _ in shown]
    subject = ""
    for law, _, section in shown:
        if law.subject != subject:
            subject = law.subject
            lines += ["", f"## {subject.replace('-', ' ').capitalize()}"]
        lines += ["", *section]
    return lines


def _row(law: Law, found: Finding) -> str:
    number = f"{sum(c.passed for c in found.comparisons)} of {len(found.comparisons)}" if found.comparisons else ""
    used = f"{found.tolerance_used:.2f}" if found.comparisons else ""
    return f"| [{law.name}](#{law.name}) | {_outcome(found)} | {number} | {used} |"


def _outcome(found: Finding) -> str:
    return found.outcome if found.outcome == "passed" else f"**{found.outcome}**"


def _section(law: Law, found: Finding) -> list[str]:
    lines = [
        f"### {law.name}",
        "",
        f"{law.law} **{found.outcome.capitalize()}.**",
        "",
        f"    {law.formula}",
        "",
        f"- Source: {law.source}.",
        f"- Workload: {law.workload}",
        f"- Tolerance: {law.tolerance}",
        *(f"- {remark}" for remark in found.remarks),
    ]
    if found.reason:
        lines += ["", f"Not completed: {found.reason}"]
    if found.plot is not None:
        lines += ["", f"![{law.name}]({PICTURES}/{_picture(law)})"]
    if found.comparisons:
        lines += ["", *_figures(found.comparisons)]
    return lines


def _figures(comparisons: tuple[Comparison, ...]) -> list[str]:
    """Return the figure that uses most of its tolerance, and, if any fails, all that fail as a table."""
    ordered = sorted(comparisons, key=lambda one: (one.passed, -one.tolerance_used))
    failing = [_cells(one) for one in ordered if not one.passed]
    if failing:
        head = ["| figure | measured (95 %) | law | allowed | |", "|---|---|---|---|---|"]
        return head + [f"| {' | '.join(cells)} | **fails** |" for cells in failing]
    what, measured, law, allowed = _cells(ordered[0])
    return [f"Nearest to its bound of {len(ordered)}: {what}, {measured}; law {law}, allowed {allowed}."]


def _cells(one: Comparison) -> tuple[str, str, str, str]:
    """Return what a figure is, its value with its interval, its law, and what is allowed."""
    step = (one.at_most - one.at_least) / 20
    low, high, measured, law = (format_number(x, step) for x in (one.low, one.high, one.measured, one.expected))
    interval = f" ({low} to {high})" if math.isfinite(one.low) else ""
    unit = f" {one.unit}" if one.unit else ""
    return one.what, f"{measured}{unit}{interval}", law if math.isfinite(one.expected) else "–", _allowed(one, step)


def _allowed(one: Comparison, step: float) -> str:
    low, high = format_number(one.at_least, step), format_number(one.at_most, step)
    if math.isfinite(one.at_least) and math.isfinite(one.at_most):
        return f"{low} to {high}"
    return f"≤ {high}" if math.isfinite(one.at_most) else f"≥ {low}"


def format_number(value: float, step: float = math.inf) -> str:
    """Return a number as text for a table.

    It has digits down to ``step``, the smallest difference that matters, or about four digits if ``step`` is infinite.
    """
    if value == 0 or not math.isfinite(value):
        return "0" if value == 0 else str(value)
    if 0 < step < math.inf:
        digits = max(0, math.ceil(-math.log10(step)))
        if digits <= 7 or abs(value) >= 0.1:
            return f"{value:,.{digits}f}"
        return f"{value:.2e}"
    if abs(value) >= 1000:
        return f"{value:,.0f}"
    return f"{value:.2e}" if abs(value) < 1e-3 else f"{value:.4g}"


def draw_plot(plot: Plot, path: Path, *, title: str) -> None:
    """Write a plot as PNG with 48 colours, about seven kilobytes; a law and its points share a colour."""
    figure = make_figure(plot, title)
    drawn = BytesIO()
    figure.savefig(drawn, format="png")
    with atomic_file(path) as part, Image.open(drawn) as picture:
        picture.convert("RGB").quantize(48).save(part, format="png", optimize=True)


def make_figure(plot: Plot, title: str) -> Figure:
    """Return the figure of a plot."""
    figure = Figure(figsize=SIZE_INCHES, dpi=DOTS_PER_INCH, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    number, drawn = 0, set[bool]()  # of the colour: whether it already has points, and whether it has a law
    for curve in plot.curves:
        is_measured = curve.kind == "points"
        if is_measured in drawn:
            number, drawn = number + 1, set()
        drawn.add(is_measured)
        colour = COLOURS[number % len(COLOURS)]
        if curve.kind == "line":
            axes.plot(curve.x, curve.y, color=colour, linewidth=1, label=curve.label)
        elif curve.kind == "marks":
            axes.plot(curve.x, curve.y, "_", color=colour, markersize=10, markeredgewidth=1, label=curve.label)
        else:
            axes.errorbar(
                curve.x,
                curve.y,
                curve.error or None,
                color=colour,
                fmt="o",
                markersize=2.5,
                elinewidth=0.8,
                label=curve.label,
            )
    axes.set_xscale("log" if plot.log_x else "linear")
    axes.set_yscale("log" if plot.log_y else "linear")
    if plot.names:
        axes.set_xticks(range(len(plot.names)), plot.names)
        axes.set_xlim(-0.5, len(plot.names) - 0.5)
        axes.set_ylim(bottom=0)
    axes.set_title(title, fontsize=9, loc="left")
    axes.set_xlabel(plot.x_label, fontsize=8)
    axes.set_ylabel(plot.y_label, fontsize=8)
    axes.tick_params(labelsize=7)
    axes.spines[["top", "right"]].set_visible(False)
    if len(plot.curves) > 1:
        axes.legend(fontsize=6.5, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure
