"""The command ``validate``."""

from pathlib import Path
from typing import Annotated

import typer

from saf_gen.cli._tables import TableColumn, print_json, print_table
from saf_gen.cli._terminal import AsJson, out, print_error, progress_bars, terminal_reporter


def validate_command(
    *,
    quick: Annotated[bool, typer.Option("--quick", help="Run small sizes, in about a minute.")] = False,
    only: Annotated[
        list[str] | None,
        typer.Option("--only", help="Name of a check, or subject such as noise; repeatable (default: all)."),
    ] = None,
    folder: Annotated[
        Path, typer.Option("--out", help="Folder for validation.md and its pictures; the same command resumes there.")
    ] = Path("datasets/validation"),
    as_json: AsJson = False,
) -> None:
    """Validate saf_gen against theory, other code and itself (eleven minutes), and write a page of results."""
    from saf_gen.acceptance.validation import choose_validation_checks
    from saf_gen.acceptance.validation.runner import run_validation_checks
    from saf_gen.acceptance.validation.validation_page import tolerance_used_in_validation, write_validation_page
    from saf_gen.core.extras import RENDERER, require_extra

    checks = choose_validation_checks(only or [])
    require_extra("render", *RENDERER, of="rendering")
    with progress_bars() as bars:
        verdicts = run_validation_checks(checks, folder, quick=quick, report=terminal_reporter("validate", bars))
    page = write_validation_page(checks, verdicts, folder=folder, quick=quick)
    if as_json:
        print_json([v.as_dict() for v in verdicts])
    else:
        rows = []
        for verdict in verdicts:
            figures = verdict.comparisons
            number = f"{sum(one.passed for one in figures)} of {len(figures)}" if figures else ""
            rows.append(
                (
                    verdict.name,
                    verdict.outcome,
                    number,
                    f"{tolerance_used_in_validation(verdict):.2f}" if figures else "",
                )
            )
        columns = TableColumn("check", folds=True), TableColumn("outcome"), TableColumn("figures", justify="right")
        print_table([*columns, TableColumn("tolerance used", justify="right")], rows)
        out.print(f"page: {page}")
    for verdict in verdicts:
        worst = next((one for one in verdict.comparisons if not one.passed), None)
        if verdict.outcome == "failed" and worst is not None:
            print_error(f"{verdict.name} failed: {worst.what}: {worst.measured:.6g}", 1)
        elif verdict.outcome == "skipped":
            print_error(f"{verdict.name} was skipped: {verdict.reason}", 0)
        elif verdict.outcome != "passed":
            print_error(f"{verdict.name} {verdict.outcome}: {verdict.reason or 'it gave no figure'}", 1)
    if any(verdict.outcome in ("failed", "broken") for verdict in verdicts):
        raise typer.Exit(1)
