"""The commands of the group ``leaderboard``: evaluations merged into one table, and rows run again."""

from pathlib import Path
from typing import Annotated

import typer

from saf_gen.cli._leaderboard_table import print_leaderboard, print_written_paths
from saf_gen.cli._tables import TableColumn, print_json, print_table
from saf_gen.cli._terminal import AsJson, OutFolder, make_terminal_reporter, out, print_progress_bars
from saf_gen.cli.evaluate_commands import ActuatorName, BudgetMs, SweepMs, protocol_from_command_options
from saf_gen.errors import BadInput


def merge_command(
    runs: Annotated[list[Path], typer.Argument(help="Evaluation folders, or their records.jsonl.")],
    folder: OutFolder = None,
) -> None:
    """Rank the methods of several evaluations in one table, if their data and code agree."""
    from saf_gen.benchmark.plugin_description import describe_recorded_methods
    from saf_gen.benchmark.results import Evaluation
    from saf_gen.core.files import check_folder_writable
    from saf_gen.leaderboard import read_leaderboard
    from saf_gen.leaderboard.report import write_evaluation_report

    if folder is not None:
        for run in runs:
            if folder.resolve() == (run if run.is_dir() else run.parent).resolve():
                raise BadInput(
                    f"--out {str(folder)!r} is one of the evaluations",
                    allowed="a folder of its own: what is read stays as it is",
                )
        check_folder_writable(folder)
    board = read_leaderboard(*runs)
    print_leaderboard(board, records=board.records, title=f"{board.size}, {len(runs)} evaluations")
    if folder is not None:
        evaluation = Evaluation(
            records=board.records, sweeps=(), failures=(), plugins=describe_recorded_methods(board.records)
        )
        print_written_paths(
            write_evaluation_report(folder, rows=board.rows, evaluation=evaluation, title=folder.resolve().name)
        )


def compare_rankings_command(
    runs: Annotated[list[Path], typer.Argument(help="Evaluation folders, or their records.jsonl.")],
    *,
    by: Annotated[
        str | None, typer.Option(help="One condition, such as sensor, region or grain (default: all).")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Say how far the ranking of methods hangs on a condition: Kendall's tau under two of its bins, with intervals.

    Several evaluations may differ in the sensor of their datasets and in the region where methods look.
    """
    from dataclasses import asdict

    from saf_gen.leaderboard import AGREEMENT_MEANINGS, read_rank_agreement
    from saf_gen.leaderboard.table_formats import AGREEMENT_HEADERS, AGREEMENT_NOTE, format_rank_agreement

    found = read_rank_agreement(*runs, by=by)
    if as_json:
        print_json({"meanings": AGREEMENT_MEANINGS, "pairs": [asdict(one) for one in found]})
        return
    if not found:
        out.print(
            f"Nothing to compare: {f'the condition {by!r}' if by else 'each condition'} has one bin, "
            "or fewer than three methods have answers under two."
        )
        return
    print_table(
        [TableColumn(name, justify="left" if n in (0, 1, 2, 9) else "right", detail=int(n in (3, 4)), folds=n == 9)
         for n, name in enumerate(AGREEMENT_HEADERS)],
        map(format_rank_agreement, found),
        title="Rankings by success within 1 DoF under two conditions",
    )  # fmt: skip
    out.print(AGREEMENT_NOTE)


def verify_evaluation_command(
    folder: Annotated[Path, typer.Argument(help="Evaluation folder.")],
    source: Annotated[
        Path | None, typer.Option("--on", help="Its dataset or stream (default: the folder above).")
    ] = None,
    *,
    method: Annotated[
        list[str] | None,
        typer.Option(help="Method of a file that made a row and that you trust, as file.py:Class+argmax; repeatable."),
    ] = None,
    actuator: ActuatorName = None,
    budget: BudgetMs = None,
    sweep: SweepMs = None,
    as_json: AsJson = False,
) -> None:
    """Run the methods of an evaluation again, and say of each row whether its answers are found again.

    Writes verification.json into the folder; the table that `saf-gen leaderboard` makes of it then says re-run here,
    re-run elsewhere, differs or claimed. Options of a closed loop are those it was evaluated with.
    """
    from saf_gen.benchmark.records import read_records
    from saf_gen.core.files import check_folder_writable
    from saf_gen.leaderboard.rerun import verify_leaderboard_rows
    from saf_gen.leaderboard.verification import DIFFERS, write_leaderboard_verification

    track = read_records(folder)[0].track
    protocol = protocol_from_command_options(track, actuator=actuator, budget=budget, sweep=sweep)
    folder = folder if folder.is_dir() else folder.parent
    check_folder_writable(folder)
    with print_progress_bars() as bars:
        found = verify_leaderboard_rows(
            folder,
            source or folder.resolve().parent,
            methods=method or (),
            protocol=protocol,
            progress=make_terminal_reporter("verify", bars),
        )
    path = write_leaderboard_verification(folder, found)
    print_table(
        [TableColumn("method"), TableColumn("row"), TableColumn("why", folds=True)],
        [(verdict.method, verdict.state, verdict.reason) for verdict in found.verdicts],
        as_json=as_json,
    )
    if not as_json:
        out.print(str(path), soft_wrap=True)
    if any(verdict.state == DIFFERS for verdict in found.verdicts):
        raise typer.Exit(1)
