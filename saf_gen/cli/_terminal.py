"""The consoles for stdout and stderr, error lines, and progress as bars or as lines of a log."""

import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic
from typing import Annotated

import typer
from rich.console import Console, ConsoleOptions, RenderableType
from rich.progress import BarColumn, Progress, Task, TextColumn, TimeRemainingColumn
from rich.segment import Segment
from rich.table import Column
from rich.text import Text

from saf_gen.errors import escape_controls


class _PlainConsole(Console):
    """A console on which text cannot control the terminal: colours come from styles only."""

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterator[Segment]:
        for segment in super().render(renderable, options):
            yield segment if segment.control else segment._replace(text=escape_controls(segment.text, keep="\n"))


def _prepare_streams() -> None:
    """Put the null device in place of standard streams that are closed, and forget a width that no terminal has."""
    for number, (name, mode) in enumerate((("stdin", "r"), ("stdout", "w"), ("stderr", "w"))):
        if getattr(sys, name) is None:  # what is opened next would get the number, and what is printed
            null = os.open(os.devnull, os.O_RDWR)
            if null != number:
                os.dup2(null, number)
                os.close(null)
            setattr(sys, name, open(number, mode, encoding="utf-8"))  # noqa: PTH123, SIM115
    if not os.environ.get("COLUMNS", "80").isdigit() or int(os.environ.get("COLUMNS", "80")) < MIN_COLUMNS:
        del os.environ["COLUMNS"]


MIN_COLUMNS = 10
PIPED_COLUMNS = 120
"""Width of what is printed to a pipe or file, in characters, unless COLUMNS says another."""
_prepare_streams()

# No markup, because names are printed verbatim: brackets in a path are not markup.
_width = None if sys.stdout.isatty() else int(os.environ.get("COLUMNS", PIPED_COLUMNS))
out = _PlainConsole(width=_width, markup=False, highlight=False)
err = _PlainConsole(stderr=True, soft_wrap=True, markup=False, highlight=False)

LOG_EVERY_S = 30.0
AT_WORK_EVERY_S = 15.0
LEVEL_STYLES = {"ok": "green", "warning": "yellow", "error": "bold red"}
"""Style of each level of findings about a scene or a method."""
RecipeName = Annotated[str, typer.Argument(help="A recipe that comes with saf_gen, by name, or a recipe file.")]
ClusterAddress = Annotated[
    str | None, typer.Option("--cluster", help="Address of a Dask scheduler to run on, such as tcp://host:8786.")
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]
Transfer = Annotated[
    str | None, typer.Option(help="How values stand for light, where the file does not say: srgb or bt709.")
]
Linear = Annotated[bool, typer.Option("--linear", help="Values are linear light.")]
OutFolder = Annotated[Path | None, typer.Option("--out", help="Folder to write to.")]


def print_error(line: str, code: int) -> int:
    """Print an error as one line on stderr, and return ``code``, even if stderr is on a full disk."""
    try:
        err.print(Text.assemble(("saf-gen:", "bold red"), " ", " ".join(line.split())))
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stderr.fileno())  # Python flushes on exit
    return code


class _OneLine(TextColumn):
    """The description of a task, on one line whatever it names."""

    def render(self, task: Task) -> Text:
        text = super().render(task)
        text.plain = escape_controls(text.plain)
        return text


@contextmanager
def progress_bars() -> Iterator[Progress]:
    """Yield progress bars with the time left, on stderr so that stdout stays clean for pipes."""
    columns = (
        _OneLine("{task.description}", markup=False, table_column=Column(overflow="fold")),
        BarColumn(bar_width=16, table_column=Column(min_width=4)),
        TextColumn("{task.percentage:>3.0f} %", table_column=Column(min_width=5)),
        TimeRemainingColumn(elapsed_when_finished=True, table_column=Column(min_width=7)),
    )
    with Progress(*columns, console=err, disable=not err.is_terminal) as progress:
        yield progress


@contextmanager
def at_work(what: str) -> Iterator[None]:
    """Say on stderr every AT_WORK_EVERY_S that a command goes on: a small packed file may unpack for minutes."""
    begun, done = monotonic(), threading.Event()

    def say() -> None:
        while not done.wait(AT_WORK_EVERY_S):
            err.print(f"{escape_controls(what)}: at work for {monotonic() - begun:.0f} s")

    speaker = threading.Thread(target=say, daemon=True)
    speaker.start()
    try:
        yield
    finally:
        done.set()
        speaker.join()


def terminal_reporter(verb: str, bars: Progress, *, parts: int = 0) -> Callable[[int, int, str], None]:
    """Return a function that reports progress, called with (steps done, total steps, current step).

    It updates a bar on a terminal. If stderr is not a terminal, it prints a line whenever one of so many equal
    ``parts`` of the steps has ended, unless there is only one, and every half minute.
    """
    task, printed, ended = bars.add_task(verb, total=1), monotonic(), 0

    def report(done: int, total: int, what: str) -> None:
        nonlocal printed, ended
        bars.update(task, completed=done, total=total, description=f"{verb} {what}")
        before, ended = ended, done * parts // total
        if not err.is_terminal and ((ended > before and parts > 1) or monotonic() - printed >= LOG_EVERY_S):
            printed = monotonic()
            err.print(escape_controls(f"{verb} {done / total:.0%}: {what}"))

    return report
