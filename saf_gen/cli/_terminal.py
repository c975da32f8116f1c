"""What all commands share: the two consoles, the line of an error, bars of progress."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.text import Text

__all__ = ["OutFolder", "err", "fail", "out", "progress_bars"]

# Names are printed as they are: brackets in a path are no markup.
out = Console(width=None if sys.stdout.isatty() else 160, markup=False, highlight=False)
err = Console(stderr=True, soft_wrap=True, markup=False, highlight=False)

OutFolder = Annotated[Path | None, typer.Option("--out", help="Folder to write to.")]


def fail(line: str, code: int) -> int:
    """Say what went wrong, in one line on stderr; gives ``code`` back."""
    err.print(Text.assemble(("saf-gen:", "bold red"), " ", " ".join(line.split())))
    return code


@contextmanager
def progress_bars() -> Iterator[Progress]:
    """Progress bars with the time left, on stderr so that stdout stays clean for pipes."""
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeRemainingColumn(elapsed_when_finished=True),
    )
    with Progress(*columns, console=err, disable=not err.is_terminal) as progress:
        yield progress
