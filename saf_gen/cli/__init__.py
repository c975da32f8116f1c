"""The command line: parses, calls, prints. The one room that prints, and the one door to typer.

One file a group of commands; a command is a plain function, and this page says what it is called.
"""

import os
import sys
from collections.abc import Callable
from io import TextIOWrapper
from typing import NoReturn

import typer

from saf_gen.cli import (
    dataset_commands,
    evaluate_commands,
    leaderboard_commands,
    machine_commands,
    method_commands,
    recipe_commands,
    scene_commands,
    stream_commands,
    tune_commands,
)
from saf_gen.cli._terminal import print_error
from saf_gen.errors import SafGenError

__all__ = ["app", "main"]

STOPPED_EXIT_CODE = 130

COMMANDS: dict[str, Callable[..., None]] = {
    "generate": dataset_commands.generate,
    "evaluate": evaluate_commands.evaluate,
    "leaderboard": leaderboard_commands.leaderboard,
    "tune": tune_commands.tune,
    "score": evaluate_commands.score,
    "import": stream_commands.import_,
    "export": stream_commands.export,
    "inspect": stream_commands.inspect,
    "verify": dataset_commands.verify,
    "bench": machine_commands.bench,
    "doctor": machine_commands.doctor,
}
GROUPS: dict[str, tuple[str, dict[str, Callable[..., None]]]] = {
    "scenes": (
        "Scenes that recipes can name.",
        {
            "list": scene_commands.list_,
            "new": scene_commands.new,
            "check": scene_commands.check,
            "preview": scene_commands.preview,
            "gallery": scene_commands.gallery,
        },
    ),
    "recipes": ("Recipes of datasets.", {"check": recipe_commands.check}),
    "methods": (
        "Focus measures and searches: list them, show one in full, or check a method.",
        {"show": method_commands.show, "check": method_commands.check},
    ),
}
GROUP_DEFAULTS: dict[str, Callable[..., None]] = {"methods": method_commands.list_}
"""What a group does without a command; the others show their help."""
NOTHING_WRITTEN = "nothing was written: the same command starts from the beginning"
STOP_MESSAGES = {
    "generate": "what was done is kept: run the same command again to go on",
    **dict.fromkeys(("evaluate", "leaderboard", "tune", "score", "import", "export"), NOTHING_WRITTEN),
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
    under = typer.Typer(
        help=words,
        no_args_is_help=group not in GROUP_DEFAULTS,
        invoke_without_command=group in GROUP_DEFAULTS,
    )
    if group in GROUP_DEFAULTS:
        under.callback()(GROUP_DEFAULTS[group])
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
        if code == STOPPED_EXIT_CODE:  # what typer makes of Ctrl-C
            command = next(iter(sys.argv[1:] if argv is None else argv), "")
            print_error("; ".join(filter(None, ("stopped", STOP_MESSAGES.get(command)))), STOPPED_EXIT_CODE)
    except SafGenError as error:
        code = print_error(str(error), error.exit_code)
    except typer.TyperException as error:
        message = error.format_message()  # empty where the help was shown in its place
        code = print_error(f"{message}; see: saf-gen --help", 2) if message else 2
    except (SystemExit, BrokenPipeError):  # so typer leaves when a pipe closes: `| head` has its lines
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # python flushes while it exits
        code = 0
    except OSError as error:  # a disk or a terminal that went away
        code = print_error(f"{error.filename or 'the output'}: {error.strerror or error}", 1)
    sys.exit(code or 0)
