"""The commands ``submit new``, ``submit check`` and ``submit page``."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from rich.text import Text

from saf_gen.cli._tables import print_json
from saf_gen.cli._terminal import LEVEL_STYLES, AsJson, OutFolder, out, print_error


def new_submission_command(
    folder: Annotated[Path, typer.Argument(help="Folder of the submission, with the name of the method.")],
) -> None:
    """Write submission.yaml, with a line that explains each key."""
    from saf_gen.leaderboard.submission import create_submission

    out.print(str(create_submission(folder)), soft_wrap=True)
    out.print(
        f"next: fill it in, put your method into its folder, and run saf-gen submit check {folder}", soft_wrap=True
    )


def check_submission_command(
    folder: Annotated[Path, typer.Argument(help="Folder of the submission.")],
    *,
    dataset: Annotated[Path | None, typer.Option("--on", help="Dataset whose split test was evaluated.")] = None,
    as_json: AsJson = False,
) -> None:
    """Report what is missing or inconsistent in a submission, without running its code."""
    from saf_gen.leaderboard.submission import check_submission

    found = list(check_submission(folder, dataset=dataset))
    if as_json:
        print_json([asdict(finding) for finding in found])
    for finding in () if as_json else found:
        parts = ((finding.level, LEVEL_STYLES[finding.level]), f" {finding.check}: {finding.text}")
        out.print(Text.assemble(*parts), soft_wrap=True)
    errors = sum(finding.level == "error" for finding in found)
    if not as_json:
        out.print("complete" if not errors else f"{errors} to do", soft_wrap=True)
    if errors:
        raise typer.Exit(1)


def submissions_page_command(
    folder: Annotated[Path, typer.Argument(help="Folder that has a folder for each submission.")],
    target: OutFolder = None,
) -> None:
    """Write a page that ranks all submissions, with dates and verified rows, without running their code.

    The command writes index.html and submissions.md into the folder, unless --out names another one.
    """
    from saf_gen.core.files import check_writable
    from saf_gen.leaderboard.report.submissions_page import write_submissions_page
    from saf_gen.leaderboard.submission import list_submissions

    target = target or folder
    listed = list_submissions(folder)
    check_writable(target)
    for path in write_submissions_page(target, listed, source=folder):
        out.print(str(path), soft_wrap=True)
    for submission in listed.submissions:
        out.print(f"{submission.name}: {submission.state}, {submission.card.date or 'no date'}", soft_wrap=True)
    for name, problem in listed.problems:
        print_error(f"{name} is not shown: {problem}", 1)
    if listed.problems:
        raise typer.Exit(1)
