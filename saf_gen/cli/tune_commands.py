"""The command ``tune``: constants of a method, found on train and kept in a file that records cite."""

from pathlib import Path
from typing import Annotated

import typer

from saf_gen.cli._leaderboard_table import print_leaderboard
from saf_gen.cli._terminal import make_step_reporter, out, progress_bars
from saf_gen.cli.evaluate_commands import build_protocol
from saf_gen.errors import BadInput

__all__ = ["tune"]


def tune(
    dataset: Annotated[Path, typer.Argument(help="A dataset folder.")],
    method: Annotated[str, typer.Option(help="MEASURE+SEARCH; options after a colon stay as they are.")],
    try_: Annotated[
        list[str], typer.Option("--try", help="measure.KEY=VALUE,... or search.KEY=VALUE,...; more of them.")
    ],
    file: Annotated[Path, typer.Option("--out", help="The file of what is found (.json).")],
    split: Annotated[str, typer.Option(help="The split to tune on; not test.")] = "train",
    track: Annotated[str, typer.Option(help="recorded or closed_loop.")] = "recorded",
    actuator: Annotated[str | None, typer.Option(help="As of evaluate.")] = None,
    budget: Annotated[float | None, typer.Option(help="As of evaluate.")] = None,
    sweep: Annotated[float | None, typer.Option(help="As of evaluate.")] = None,
    region: Annotated[str, typer.Option(help="target (box round the target) or frame.")] = "target",
) -> None:
    """Try every combination of values on a split, and keep the best: `@FILE` is then a method's name."""
    from saf_gen.benchmark.tuned_method import format_tuned_method
    from saf_gen.core.files import check_writable, write_atomically
    from saf_gen.leaderboard.tuning import tune as run

    values: dict[str, list[str]] = {}
    for given in try_:
        key, equals, rest = given.partition("=")
        if not equals or key in values:
            raise BadInput(f"--try {given!r}", allowed="KEY=VALUE,VALUE,... and each key once")
        values[key] = rest.split(",")
    check_writable(file.parent)
    with progress_bars() as bars:
        tuned, rows = run(
            dataset,
            method,
            values=values,
            split=split,
            region=region,
            protocol=build_protocol(track, actuator, budget, sweep),
            progress=make_step_reporter("tune", bars),
        )
    print_leaderboard(rows[:20], title=f"{len(rows)} combinations, {tuned.sequences} sequences of {split}")
    with write_atomically(file) as part:
        part.write_text(format_tuned_method(tuned), encoding="utf-8")
    out.print(f"best: {tuned.method}", soft_wrap=True)
    out.print(f"{file}   (next: saf-gen evaluate {dataset} --method @{file})", soft_wrap=True)
