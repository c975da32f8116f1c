"""The command ``tune``: constants of a method, found on train and kept in a file that records cite."""

from pathlib import Path
from typing import Annotated

import typer

from saf_gen.cli._board import show_board
from saf_gen.cli._terminal import out, progress_bars, steps_of
from saf_gen.cli.contest import terms_of
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
    from saf_gen.files import check_writable, replaced
    from saf_gen.tune import tune as run
    from saf_gen.tuned import tuned_text

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
            values,
            split=split,
            region=region,
            terms=terms_of(track, actuator, budget, sweep),
            progress=steps_of("tune", bars),
        )
    show_board(rows[:20], title=f"{len(rows)} combinations, {tuned.sequences} sequences of {split}")
    with replaced(file) as part:
        part.write_text(tuned_text(tuned), encoding="utf-8")
    out.print(f"best: {tuned.method}", soft_wrap=True)
    out.print(f"{file}   (next: saf-gen evaluate {dataset} --method @{file})", soft_wrap=True)
