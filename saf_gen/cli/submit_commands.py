"""The commands ``submit new`` and ``submit check``."""

from pathlib import Path
from typing import Annotated

import typer
from rich.text import Text

from saf_gen.cli._tables import print_json
from saf_gen.cli._terminal import LEVEL_STYLES, AsJson, out


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
        print_json([{"check": one.check, "level": one.level, "text": one.text} for one in found])
    for finding in () if as_json else found:
        parts = ((finding.level, LEVEL_STYLES[finding.level]), f" {finding.check}: {finding.text}")
        out.print(Text.assemble(*parts), soft_wrap=True)
    errors = sum(finding.level == "error" for finding in found)
    if not as_json:
        out.print("complete" if not errors else f"{errors} to do", soft_wrap=True)
    if errors:
        raise typer.Exit(1)
