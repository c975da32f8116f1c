"""The command ``tune``, which finds the constants of a method and writes a file that records cite."""

from pathlib import Path
from typing import Annotated

import typer

from saf_gen.cli._tables import print_leaderboard
from saf_gen.cli._terminal import ClusterAddress, err, out, progress_bars, terminal_reporter
from saf_gen.cli.evaluate_commands import ActuatorName, BudgetMs, SweepMs, Track, print_kept, protocol_from_options
from saf_gen.errors import BadInput


def tune_command(
    dataset: Annotated[Path, typer.Argument(help="Dataset folder.")],
    method: Annotated[str, typer.Option(help="MEASURE+SEARCH; options after a colon are not changed.")],
    *,
    try_: Annotated[
        list[str], typer.Option("--try", help="measure.KEY=VALUE,... or search.KEY=VALUE,...; repeatable.")
    ],
    file: Annotated[Path, typer.Option("--out", help="JSON file to write.")],
    split: Annotated[str, typer.Option(help="Split to tune on, any but test.")] = "train",
    track: Track = "recorded",
    actuator: ActuatorName = None,
    budget: BudgetMs = None,
    sweep: SweepMs = None,
    region: Annotated[str, typer.Option(help="Where methods look: target (its bounding box) or frame.")] = "target",
    cluster: ClusterAddress = None,
) -> None:
    """Evaluate every combination of values on a split, and write the best one; `@FILE` then names this method."""
    from saf_gen.benchmark.kept_sequences import KeptSequences
    from saf_gen.benchmark.method_spec import format_tuned
    from saf_gen.core.files import atomic_file, check_writable
    from saf_gen.leaderboard.tuning import tune as run
    from saf_gen.stream.manifest import read_manifest

    values: dict[str, list[str]] = {}
    for text in try_:
        key, equals, rest = text.partition("=")
        if not equals or key in values:
            raise BadInput(f"--try is {text!r}", allowed="KEY=VALUE,VALUE,..., with each key once")
        values[key] = rest.split(",")
    check_writable(file.parent)
    kept = KeptSequences(file.with_name(f".{file.name}.unfinished"))
    with progress_bars() as bars:
        tuned, rows = run(
            dataset,
            method,
            values=values,
            split=split,
            region=region,
            protocol=protocol_from_options(track, actuator=actuator, budget=budget, sweep=sweep),
            progress=terminal_reporter("tune", bars),
            keep=kept,
            cluster=cluster,
            notify=err.print,
        )
    print_kept(kept, splits={split})
    print_leaderboard(rows[:20], title=f"{len(rows)} combinations, {tuned.sequences} sequences of {split}")
    with atomic_file(file) as part:
        part.write_text(format_tuned(tuned), encoding="utf-8")
    kept.remove()
    out.print(f"best: {tuned.method}", soft_wrap=True)
    out.print(f"{file}   (next: {read_manifest(dataset).next_command(dataset)} --method @{file})", soft_wrap=True)
