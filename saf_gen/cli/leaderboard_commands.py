"""The command ``leaderboard``, which merges evaluations into one table."""

from pathlib import Path
from typing import Annotated

import typer

from saf_gen.cli._leaderboard_table import print_leaderboard, print_written_paths
from saf_gen.cli._terminal import OutFolder
from saf_gen.errors import BadInput


def leaderboard(
    runs: Annotated[list[Path], typer.Argument(help="Evaluation folders, or their records.jsonl.")],
    folder: OutFolder = None,
) -> None:
    """Rank the methods of several evaluations in one table, if their data and code agree."""
    from saf_gen.benchmark.plugin_description import describe_recorded_methods
    from saf_gen.benchmark.results import Evaluation
    from saf_gen.core.files import check_writable
    from saf_gen.leaderboard import read_leaderboard
    from saf_gen.leaderboard.report import write_evaluation_report

    if folder is not None:
        for run in runs:
            if folder.resolve() == (run if run.is_dir() else run.parent).resolve():
                raise BadInput(
                    f"--out {str(folder)!r} is one of the evaluations",
                    allowed="a folder of its own: what is read stays as it is",
                )
        check_writable(folder)
    board = read_leaderboard(*runs)
    print_leaderboard(board, records=board.records, title=f"{board.size}, {len(runs)} evaluations")
    if folder is not None:
        evaluation = Evaluation(
            records=board.records, sweeps=(), failures=(), plugins=describe_recorded_methods(board.records)
        )
        print_written_paths(
            write_evaluation_report(folder, rows=board.rows, evaluation=evaluation, title=folder.resolve().name)
        )
