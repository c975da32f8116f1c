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
    from saf_gen.benchmark.records import read_records
    from saf_gen.benchmark.results import Evaluation
    from saf_gen.core.files import check_writable
    from saf_gen.leaderboard import merge_records, rank_methods
    from saf_gen.leaderboard.report import write_evaluation_report

    if folder is not None:
        for run in runs:
            if folder.resolve() == (run if run.is_dir() else run.parent).resolve():
                raise BadInput(
                    f"--out {str(folder)!r} is one of the evaluations",
                    allowed="a folder of its own: what is read stays as it is",
                )
        check_writable(folder)
    records = merge_records({str(run): read_records(run) for run in runs})
    rows = rank_methods(records)
    sequences = len({record.sequence for record in records})
    print_leaderboard(
        rows, records=records, title=f"{len(rows)} methods, {sequences} sequences, {len(runs)} evaluations"
    )
    if folder is not None:
        evaluation = Evaluation(
            records=tuple(records), sweeps=(), failures=(), plugins=describe_recorded_methods(records)
        )
        print_written_paths(
            write_evaluation_report(folder, rows=rows, evaluation=evaluation, title=folder.resolve().name)
        )
