"""The command line: parses, calls, prints. The one room that prints, and the one door to typer.

One file a group of commands; a command is a plain function, and this page says what it is called.
"""

import os
import sys
from collections.abc import Callable
from io import TextIOWrapper
from typing import NoReturn

import typer

from saf_gen.cli import contest, leaderboard, machine, make, methods, recipes, scenes, streams, tune
from saf_gen.cli._terminal import fail
from saf_gen.errors import SafGenError

__all__ = ["app", "main"]

STOPPED = 130

COMMANDS: dict[str, Callable[..., None]] = {
    "generate": make.generate,
    "evaluate": contest.evaluate,
    "leaderboard": leaderboard.leaderboard,
    "tune": tune.tune,
    "score": contest.score,
    "import": streams.import_,
    "export": streams.export,
    "inspect": streams.inspect,
    "verify": make.verify,
    "bench": machine.bench,
    "doctor": machine.doctor,
}
GROUPS: dict[str, tuple[str, dict[str, Callable[..., None]]]] = {
    "scenes": (
        "Scenes that recipes can name.",
        {
            "list": scenes.list_,
            "new": scenes.new,
            "check": scenes.check,
            "preview": scenes.preview,
            "gallery": scenes.gallery,
        },
    ),
    "recipes": ("Recipes of datasets.", {"check": recipes.check}),
    "methods": (
        "Focus measures and searches: list them, show one in full, or check a method.",
        {"show": methods.show, "check": methods.check},
    ),
}
ALONE: dict[str, Callable[..., None]] = {"methods": methods.list_}
"""What a group does without a command; the others show their help."""
NOTHING = "nothing was written: the same command starts from the beginning"
KEPT = {
    "generate": "what was done is kept: run the same command again to go on",
    **dict.fromkeys(("evaluate", "leaderboard", "tune", "score", "import", "export"), NOTHING),
}
"""What is left of a command that was stopped, where it writes at all."""

app = typer.Typer(
    help="Spike-camera autofocus data from physics, and the benchmark that ranks autofocus methods on it.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
)
for name, command in COMMANDS.items():
    app.command(name)(command)
for group, (words, commands) in GROUPS.items():
    under = typer.Typer(help=words, no_args_is_help=group not in ALONE, invoke_without_command=group in ALONE)
    if group in ALONE:
        under.callback()(ALONE[group])
    for name, command in commands.items():
        under.command(name)(command)
    app.add_typer(under, name=group)


def main(argv: list[str] | None = None) -> NoReturn:
    """Run a command; every error a user can cause ends in one line and exit code 2."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without θ or ┃ gets a question mark
    try:
        code = app(args=argv, standalone_mode=False)
        if code == STOPPED:  # what typer makes of Ctrl-C
            command = next(iter(sys.argv[1:] if argv is None else argv), "")
            fail("; ".join(filter(None, ("stopped", KEPT.get(command)))), STOPPED)
    except SafGenError as error:
        code = fail(str(error), error.exit_code)
    except typer.TyperException as error:
        message = error.format_message()  # empty where the help was shown in its place
        code = fail(f"{message}; see: saf-gen --help", 2) if message else 2
    except (SystemExit, BrokenPipeError):  # so typer leaves when a pipe closes: `| head` has its lines
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # python flushes while it exits
        code = 0
    except OSError as error:  # a disk or a terminal that went away
        code = fail(f"{error.filename or 'the output'}: {error.strerror or error}", 1)
    sys.exit(code or 0)
