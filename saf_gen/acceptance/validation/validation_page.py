"""The validation page, Markdown with pictures: what was checked, how and against what, and the results."""

import math
from collections.abc import Sequence
from pathlib import Path

import saf_gen
from saf_gen.acceptance.validation.check import Check, Comparison, Verdict
from saf_gen.acceptance.validation.inference import FALSE_ALARM
from saf_gen.acceptance.validation.plots import draw_validation_plot
from saf_gen.core.files import write_text

PAGE, PICTURES = "validation.md", "pictures"
LISTED_FIGURES = 8
"""Number of figures listed per check, those that use most of their tolerance; figures that fail are all listed."""


def write_validation_page(checks: Sequence[Check], verdicts: Sequence[Verdict], *, folder: Path, quick: bool) -> Path:
    """Write ``validation.md`` and its pictures to ``folder``, and return the path of the page.

    Raises BadInput if a file cannot be written.
    """
    by_name = {verdict.name: verdict for verdict in verdicts}
    shown = [(check, by_name[check.name]) for check in checks]
    for check, verdict in shown:
        if verdict.plot is not None:
            draw_validation_plot(verdict.plot, folder / PICTURES / _picture(check))
    page = folder / PAGE
    write_text(page, "\n".join(_lines(shown, quick=quick)) + "\n")
    return page


def _picture(check: Check) -> str:
    return f"validation-{check.name.replace('_', '-')}.png"


def _lines(shown: list[tuple[Check, Verdict]], *, quick: bool) -> list[str]:
    outcomes = [verdict.outcome for _, verdict in shown]
    counted = {outcome: outcomes.count(outcome) for outcome in dict.fromkeys(outcomes)}
    size = "the small sizes of `--quick`" if quick else "full size"
    lines = [
        "# Validation",
        "",
        f"Made by `saf-gen validate` of saf_gen {saf_gen.__version__}, at {size}. "
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
    for check, verdict in shown:
        number = (
            f"{sum(c.passed for c in verdict.comparisons)} of {len(verdict.comparisons)}" if verdict.comparisons else ""
        )
        used = f"{tolerance_used_in_validation(verdict):.2f}" if verdict.comparisons else ""
        lines.append(f"| [{check.name}](#{check.name}) | {_outcome(verdict)} | {number} | {used} |")
    subject = ""
    for check, verdict in shown:
        if check.subject != subject:
            subject = check.subject
            lines += ["", f"## {subject.replace('-', ' ').capitalize()}"]
        lines += ["", *_section(check, verdict)]
    return lines


def _outcome(verdict: Verdict) -> str:
    return verdict.outcome if verdict.outcome == "passed" else f"**{verdict.outcome}**"


def _section(check: Check, verdict: Verdict) -> list[str]:
    lines = [
        f"### {check.name}",
        "",
        f"{check.law} **{verdict.outcome.capitalize()}.**",
        "",
        f"    {check.formula}",
        "",
        f"- Source: {check.source}.",
        f"- Workload: {check.workload}",
        f"- Tolerance: {check.tolerance}",
        *(f"- {remark}" for remark in verdict.remarks),
    ]
    if verdict.reason:
        lines += ["", f"Not completed: {verdict.reason}"]
    if verdict.plot is not None:
        lines += ["", f"![{check.name}]({PICTURES}/{_picture(check)})"]
    if verdict.comparisons:
        lines += ["", *_figures(verdict.comparisons)]
    return lines


def _figures(comparisons: tuple[Comparison, ...]) -> list[str]:
    """Return the table of figures, failing ones first, then by the tolerance used, and a note on those left out."""
    ordered = sorted(comparisons, key=lambda one: (one.passed, -_rank(one)))
    shown = ordered[: max(LISTED_FIGURES, sum(not one.passed for one in ordered))]
    lines = ["| figure | measured (95 %) | law | allowed | |", "|---|---|---|---|---|"]
    for one in shown:
        step = (one.at_most - one.at_least) / 20
        low, high, measured, law = (
            format_validation_number(x, step) for x in (one.low, one.high, one.measured, one.expected)
        )
        interval = f" ({low} to {high})" if math.isfinite(one.low) else ""
        unit, passed = f" {one.unit}" if one.unit else "", "" if one.passed else "**fails**"
        law = law if math.isfinite(one.expected) else "–"
        lines.append(f"| {one.what} | {measured}{unit}{interval} | {law} | {_allowed(one, step)} | {passed} |")
    if len(shown) < len(ordered):
        lines += ["", f"The other {len(ordered) - len(shown)} figures use less of their tolerance."]
    return lines


def _rank(one: Comparison) -> float:
    used = one.tolerance_used
    return math.inf if math.isnan(used) else used


def _allowed(one: Comparison, step: float) -> str:
    low, high = format_validation_number(one.at_least, step), format_validation_number(one.at_most, step)
    if math.isfinite(one.at_least) and math.isfinite(one.at_most):
        return f"{low} to {high}"
    return f"≤ {high}" if math.isfinite(one.at_most) else f"≥ {low}"


def tolerance_used_in_validation(verdict: Verdict) -> float:
    """Return the largest fraction of its tolerance that a figure of the check uses; NaN without figures."""
    return max((_rank(one) for one in verdict.comparisons), default=math.nan)


def format_validation_number(value: float, step: float = math.inf) -> str:
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
