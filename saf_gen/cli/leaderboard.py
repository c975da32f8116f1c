"""The command ``leaderboard``: evaluations of different days in one table."""

from pathlib import Path
from typing import Annotated

import typer

from saf_gen.cli._board import show_board, show_written
from saf_gen.cli._terminal import OutFolder
from saf_gen.errors import BadInput

__all__ = ["leaderboard"]


def leaderboard(
    runs: Annotated[list[Path], typer.Argument(help="Folders of saf-gen evaluate, or their records.jsonl.")],
    folder: OutFolder = None,
) -> None:
    """Rank the methods of several evaluations together: the same data, the same code, or one line why not."""
    from saf_gen.evaluate import Evaluation
    from saf_gen.files import check_writable
    from saf_gen.leaderboard import merged, table
    from saf_gen.records import read_records
    from saf_gen.report import write_evaluation

    if folder is not None:
        for run in runs:
            if folder.resolve() == (run if run.is_dir() else run.parent).resolve():
                raise BadInput(
                    f"--out {str(folder)!r} is one of the evaluations",
                    allowed="a folder of its own: what is read stays as it is",
                )
        check_writable(folder)
    records = merged({str(run): read_records(run) for run in runs})
    rows = table(records)
    sequences = len({record.sequence for record in records})
    show_board(
        rows, records=records, title=f"{len(rows)} methods, {sequences} sequences, {len(runs)} evaluations"
    )
    if folder is not None:
        evaluation = Evaluation(records=tuple(records), sweeps=(), failures=())
        title = folder.resolve().name
        show_written(write_evaluation(folder, rows=rows, evaluation=evaluation, title=title))
