"""The commands of the group ``leaderboard``, and the command ``tune``."""

import shlex
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from saf_gen.cli._tables import print_leaderboard, print_table
from saf_gen.cli._terminal import AsJson, ClusterAddress, OutFolder, err, out, progress_bars, terminal_reporter
from saf_gen.cli.command import FINISHED_WORK_IS_KEPT, NOTHING_WRITTEN, Command, Panel
from saf_gen.cli.evaluate_commands import (
    ActuatorName,
    BudgetMs,
    OperationRate,
    SweepMs,
    Track,
    name_splits,
    print_kept,
    protocol_from_options,
)
from saf_gen.core.plain_text import plural
from saf_gen.core.table import Column, Table
from saf_gen.errors import BadInput


def merge_command(
    runs: Annotated[list[Path], typer.Argument(help="Evaluation folders, or their records.jsonl.")],
    folder: OutFolder = None,
) -> None:
    """Rank the methods of several evaluations in one table, if their data and code agree."""
    from saf_gen.benchmark.plugin_description import describe_recorded
    from saf_gen.core.files import check_writable, lock_folder
    from saf_gen.leaderboard import read_leaderboard
    from saf_gen.leaderboard.report import check_replaceable, write_evaluation

    if folder is not None:
        for run in runs:
            if folder.resolve() == (run if run.is_dir() else run.parent).resolve():
                raise BadInput(
                    f"--out {str(folder)!r} is one of the evaluations",
                    allowed="another folder: the evaluations are not changed",
                )
        check_replaceable(folder)
        check_writable(folder)
    board = read_leaderboard(*runs)
    written = None
    if folder is not None:
        board = replace(board, evaluation=replace(board.evaluation, plugins=describe_recorded(board.records)))
        with lock_folder(folder):
            written = write_evaluation(folder, board, title=folder.resolve().name)
    splits = dict.fromkeys(record.what.split for record in board.records if record.what.split is not None)
    title = f"{board.size}, {plural(len(runs), 'evaluation')}{f', {name_splits(splits)}' if splits else ''}"
    print_leaderboard(replace(board.printed, title=title), last_words=board.last_words, written=written)


def verify_evaluation_command(
    folder: Annotated[Path, typer.Argument(help="Evaluation folder.")],
    source: Annotated[
        Path | None, typer.Option("--on", help="Dataset or stream that was evaluated (default: the folder above).")
    ] = None,
    *,
    method: Annotated[
        list[str] | None,
        typer.Option(
            help="Method of a row, in a file that you trust, such as file.py:Class+argmax, or @FILE of a tuned method; "
            "repeatable."
        ),
    ] = None,
    scene_motion: Annotated[
        str | None, typer.Option(help="If only static or only dynamic sequences were evaluated, which.")
    ] = None,
    actuator: ActuatorName = None,
    budget: BudgetMs = None,
    sweep: SweepMs = None,
    as_json: AsJson = False,
) -> None:
    """Run the methods of an evaluation again, and report for each row whether the records are the same.

    A row needs a record of each sequence of the split; only time and machine may differ. The command writes
    verification.json into the folder. In tables that `saf-gen leaderboard` makes of this evaluation, each row is then
    marked as re-run here, re-run elsewhere, differs or claimed. Repeat the option --scene-motion of the evaluation and,
    for a closed loop, its options, except for the rate of operations, which its records state.
    """
    from saf_gen.benchmark.records import read_records
    from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol
    from saf_gen.core.files import check_writable
    from saf_gen.leaderboard.ranking import describe_size
    from saf_gen.leaderboard.rerun import verify
    from saf_gen.leaderboard.verification import DIFFERS, PROVES, RERUN_HERE, write_verification

    records = read_records(folder)
    first = records[0]
    rate = None if first.what.track == "recorded" else ClosedLoopProtocol.rate_in(first.what.terms) or 0.0
    protocol = protocol_from_options(first.what.track, actuator=actuator, budget=budget, sweep=sweep, op_rate=rate)
    folder = folder if folder.is_dir() else folder.parent
    check_writable(folder)
    with progress_bars() as bars:
        found = verify(
            folder,
            source or folder.resolve().parent,
            methods=method or (),
            scene_motion=scene_motion,
            protocol=protocol,
            progress=terminal_reporter("verify", bars),
        )
    path = write_verification(folder, found)
    columns = Column("method", "method"), Column("row", "state"), Column("why", "reason", folds=True)
    splits = dict.fromkeys(record.what.split for record in records if record.what.split is not None)
    covered = filter(None, (describe_size(records), name_splits(splits) if splits else "", scene_motion))
    print_table(Table(columns, found.verdicts, ", ".join(covered)), as_json=as_json)
    if not as_json:
        out.print(str(path), soft_wrap=True)
        if any(verdict.state == RERUN_HERE for verdict in found.verdicts):
            out.print(f"{RERUN_HERE}: {PROVES}", soft_wrap=True)
    if any(verdict.state == DIFFERS for verdict in found.verdicts):
        raise typer.Exit(1)


def tune_command(
    dataset: Annotated[Path, typer.Argument(help="Dataset folder.")],
    method: Annotated[str, typer.Option(help="MEASURE+SEARCH, or @FILE of a tuned method.")],
    *,
    try_: Annotated[
        list[str] | None, typer.Option("--try", help="measure.KEY=VALUE,... or search.KEY=VALUE,...; repeatable.")
    ] = None,
    trials: Annotated[
        int | None,
        typer.Option(help="Evaluate the method as it is and with random constants, so many in all, instead of a grid."),
    ] = None,
    file: Annotated[Path, typer.Option("--out", help="JSON file to write.")],
    split: Annotated[str, typer.Option(help="Split to tune on, any but test.")] = "train",
    track: Track = "recorded",
    actuator: ActuatorName = None,
    budget: BudgetMs = None,
    sweep: SweepMs = None,
    op_rate: OperationRate = None,
    region: Annotated[
        str,
        typer.Option(
            help="Where methods look: target (its bounding box), inside (a rectangle within the target), frame, "
            "shifted, half, double or centre."
        ),
    ] = "target",
    cluster: ClusterAddress = None,
) -> None:
    """Try values of the constants of a method on a split.

    The best are written into a file, and `@FILE` then names the method with them.
    """
    from saf_gen.benchmark.kept_sequences import KeptSequences, kept_folder
    from saf_gen.benchmark.method_spec import TUNING_FORMAT, format_tuned
    from saf_gen.core.files import check_ours, check_writable, write_text
    from saf_gen.leaderboard.tables import ranking
    from saf_gen.leaderboard.tuning import tune as run
    from saf_gen.stream.manifest import read_manifest

    values: dict[str, list[str]] = {}
    for text in try_ or ():
        key, equals, rest = text.partition("=")
        if not equals or key in values:
            raise BadInput(f"--try is {text!r}", allowed="KEY=VALUE,VALUE,..., with each key once")
        values[key] = rest.split(",")
    check_writable(file.parent)
    check_ours(file, TUNING_FORMAT)
    kept = KeptSequences(kept_folder(file))
    with progress_bars() as bars:
        tuned, rows = run(
            dataset,
            method,
            values=values,
            trials=trials,
            split=split,
            region=region,
            protocol=protocol_from_options(track, actuator=actuator, budget=budget, sweep=sweep, op_rate=op_rate),
            progress=terminal_reporter("tune", bars),
            keep=kept,
            cluster=cluster,
            notify=err.print,
        )
    print_kept(kept, splits={split})
    title = f"{plural(len(rows), 'trial')}, {plural(tuned.sequences, 'sequence')} of {split}"
    print_leaderboard(replace(ranking(rows[:20]), title=title))
    write_text(file, format_tuned(tuned))
    kept.remove()
    if trials is not None and len(rows) < trials:
        err.print(f"{len(rows)} of {plural(trials, 'trial')}: the constants of {method} allow no more")
    out.print(f"best: {tuned.method}", soft_wrap=True)
    out.print(
        f"{file}   (next: {read_manifest(dataset).next_command(dataset)} --method {shlex.quote(f'@{file}')})",
        soft_wrap=True,
    )


COMMANDS = {
    "tune": Command(
        tune_command,
        ("tune mine --method sd+sgfs_code --try search.dt=25,50 --out best.json",),
        Panel.EVALUATE,
        FINISHED_WORK_IS_KEPT,
    ),
    "leaderboard merge": Command(
        merge_command,
        ("leaderboard merge mine/evaluation other/evaluation --out merged",),
        Panel.EVALUATE,
        NOTHING_WRITTEN,
    ),
    "leaderboard verify": Command(
        verify_evaluation_command,
        (
            "leaderboard verify datasets/quickstart/evaluation",
            "leaderboard verify theirs --on mine --method their.py:Measure+argmax",
        ),
        Panel.EVALUATE,
        NOTHING_WRITTEN,
    ),
}
"""The commands of this file, by the words that call them."""
