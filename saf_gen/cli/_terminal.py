"""What all commands share: the two consoles, the line of an error, bars and lines of progress."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.text import Text

__all__ = ["OutFolder", "err", "make_step_reporter", "out", "print_error", "progress_bars"]

# Names are printed as they are: brackets in a path are no markup.
out = Console(width=None if sys.stdout.isatty() else 160, markup=False, highlight=False)
err = Console(stderr=True, soft_wrap=True, markup=False, highlight=False)

LOG_EVERY_S = 30.0
OutFolder = Annotated[Path | None, typer.Option("--out", help="Folder to write to.")]


def print_error(line: str, code: int) -> int:
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


def make_step_reporter(verb: str, bars: Progress) -> Callable[[int, int, str], None]:
    """Tells (steps done, steps in all, what was done) on a bar; in a log file, which has none, by lines."""
    task, told = bars.add_task(verb, total=1), monotonic()

    def step(done: int, total: int, what: str) -> None:
        nonlocal told
        bars.update(task, completed=done, total=total, description=f"{verb} {what}")
        if not err.is_terminal and monotonic() - told >= LOG_EVERY_S:
            told = monotonic()
            err.print(f"{verb} {done / total:.0%}: {what}")

    return step
