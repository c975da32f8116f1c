"""The command line, which parses arguments, calls the package and prints results.

Each file of commands ends with its ``COMMANDS``, a :class:`saf_gen.cli.command.Command` for the words that call it;
those of add-ons are found by path. Only this folder and the commands of add-ons import typer and print.
"""

import os
import select
import signal
import sys
import threading
import traceback
from collections import Counter
from collections.abc import Iterable
from contextlib import nullcontext, suppress
from functools import cache
from io import TextIOWrapper
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer
from typer.core import TyperCommand, TyperGroup

import saf_gen
from saf_gen.cli import (
    dataset_commands,
    evaluate_commands,
    leaderboard_commands,
    machine_commands,
    method_commands,
    recapture_command,
    recipe_commands,
    scene_commands,
    sensor_commands,
    stream_commands,
)
from saf_gen.cli._terminal import at_work, err, out, print_error
from saf_gen.cli.command import Command, Panel, addon_commands
from saf_gen.core import cores
from saf_gen.core.cores import STOPPING, check_address_space
from saf_gen.core.execution.job import cannot_start
from saf_gen.core.user_code import describe_exit
from saf_gen.errors import BadInput, SafGenError

__all__ = ["main", "root_command"]

STOPPED_EXIT_CODE = 130

FILES = (
    dataset_commands,
    recapture_command,
    recipe_commands,
    evaluate_commands,
    method_commands,
    leaderboard_commands,
    stream_commands,
    scene_commands,
    sensor_commands,
    machine_commands,
)
COMMANDS = {words: command for file in FILES for words, command in file.COMMANDS.items()}
GROUPS = {
    "recipes": "List and check recipes.",
    "methods": "List and show measures and searches; check a method.",
    "leaderboard": "Merge evaluations into one ranking, and verify rows.",
    "dataset": "Make a dataset from existing streams.",
    "scenes": "List, create, check and draw scenes.",
    "sensors": "List, show and check sensors.",
}
FIRST_STEPS = ("generate quickstart", "evaluate datasets/quickstart", "scenes list", "methods show sd")

UNPACKING = ("import", "encode", "export", "cut", "inspect", "view", "score", "verify", "fetch", "dataset")
"""Commands whose time is that of unpacking what strangers packed, and that have no bar or log of their own."""
_MEMORY_ADVICE = ": finished work is kept; stop other programs, raise the limit (ulimit -v, -u), or use fewer --workers"
MIN_MEMORY = 1 << 30
TYPER = Path(typer.__file__).parent


class _Command(TyperCommand):
    def get_params(self, ctx: Any) -> list[Any]:
        return _hide_type_of_flags(super().get_params(ctx))

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        _refuse_repeated_options(self.make_parser(ctx).parse_args(args=list(args))[2])
        return super().parse_args(ctx, args)


class _Group(TyperGroup):
    def get_params(self, ctx: Any) -> list[Any]:
        return _hide_type_of_flags(super().get_params(ctx))


class _Root(_Group):
    def list_commands(self, ctx: Any) -> list[str]:
        """Return commands and groups in the order of the panels; typer would put all groups last."""
        return list(dict.fromkeys(words.partition(" ")[0] for words in all_commands()))


def _refuse_repeated_options(given: list[Any]) -> None:
    """Raise BadInput if an option that has one value is given more than once; the parser would keep the last value."""
    for param, count in Counter(given).items():
        if count > 1 and param.param_type_name == "option" and not (param.multiple or param.is_flag):
            raise BadInput(f"{param.opts[0]} is given {count} times", allowed="once")


def _hide_type_of_flags(params: list[Any]) -> list[Any]:
    """Remove "<bool>" from the help of options that have no value."""
    for param in params:
        if getattr(param, "is_bool_flag", False):
            param.metavar = ""
    return params


def _print_version(requested: bool) -> None:
    if requested:
        out.print(f"saf-gen {saf_gen.__version__}")
        raise typer.Exit


Version = Annotated[
    bool, typer.Option("--version", help="Print the version and exit.", is_eager=True, callback=_print_version)
]


def _options(*, version: Version = False) -> None:
    pass


def all_commands() -> dict[str, Command]:
    """Return the commands of the core and of add-ons by the words that call them, in the order of the panels."""
    commands = COMMANDS | addon_commands()[0]
    return {words: command for panel in Panel for words, command in commands.items() if command.panel == panel}


@cache
def root_command() -> Any:
    """Return the command that contains all others; it is built once."""
    commands, texts = all_commands(), GROUPS | addon_commands()[1]
    app = typer.Typer(
        help="Spike-camera autofocus data from physics, and the benchmark that ranks autofocus methods on it.",
        epilog=_help_ending(FIRST_STEPS),
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
        cls=_Root,
    )
    app.callback()(_options)
    groups: dict[str, typer.Typer] = {}
    for words, command in commands.items():
        group, _, name = words.rpartition(" ")
        if group and group not in groups:
            below = [below.examples[0] for others, below in commands.items() if others.startswith(f"{group} ")]
            groups[group] = typer.Typer(help=texts[group], epilog=_help_ending(below), no_args_is_help=True, cls=_Group)
            app.add_typer(groups[group], name=group, rich_help_panel=command.panel)
        ending, panel = _help_ending(command.examples), None if group else command.panel
        parent = groups[group] if group else app
        parent.command(name, cls=_Command, epilog=ending, rich_help_panel=panel)(command.function)
    return typer.main.get_command(app)


def _help_ending(examples: Iterable[str]) -> str:
    return "\n".join(["Examples:", *(f"  saf-gen {line}" for line in examples)])


def _stop_message(words: list[str]) -> str:
    """Return the line for a command that was stopped, called by these words; empty for one that writes no files."""
    commands = all_commands()
    command = commands.get(" ".join(words)) or commands.get("".join(words[:1]))
    return command.stopped if command else ""


def _find_exit_code(error: BaseException) -> Any:
    """Return the exit code for a SystemExit or a BrokenPipeError, after printing a line if it is a fault.

    If the reader of the output has gone, as with ``| head``, the code is 0: in place of a BrokenPipeError, typer raises
    SystemExit, and so does rich, which first puts the null device in place of stdout. typer also exits after it has
    completed a line of the shell. Nothing else may end the program, least of all with 0.
    """
    cause = error.__context__ if isinstance(error.__context__, BrokenPipeError) else error
    origin, raised_by = (traceback.extract_tb(one.__traceback__)[-1] for one in (cause, error))
    if isinstance(cause, BrokenPipeError) and (raised_by.name == "on_broken_pipe" or _is_output_closed()):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # Python flushes on exit
        return 0
    if isinstance(cause, SystemExit) and TYPER in Path(origin.filename).parents:
        return cause.code
    problem = f"called {describe_exit(cause)}" if isinstance(cause, SystemExit) else f"failed: {cause}"
    return print_error(f"{origin.filename}, line {origin.lineno}, {problem}", 1)


def _is_output_closed() -> bool:
    if not hasattr(select, "poll"):  # Windows, where writing to a closed pipe raises another error
        return False
    poll = select.poll()
    for stream in (sys.stdout, sys.stderr):
        with suppress(AttributeError, OSError, ValueError):  # a stream may be None, closed, or no file
            poll.register(stream.fileno(), 0)  # errors and hang-ups are reported all the same
    return bool(poll.poll(0))


def main(argv: list[str] | None = None) -> NoReturn:
    """Run one command and exit.

    An error that the user can correct is printed as one line on stderr. The exit code is 0 for success, 1 if some
    sequences failed, 2 for wrong input, 130 after Ctrl-C, 143 after SIGTERM, which batch systems and containers
    send before they kill a process, and 129 after the terminal was closed, unless that is ignored, as by ``nohup``.

    Parameters
    ----------
    argv : list of str, optional
        Arguments of the command; by default, the arguments of this process.
    """
    stopped: list[int] = []

    def stop(number: int, frame: object) -> NoReturn:
        stopped.append(128 + number)
        raise KeyboardInterrupt

    in_main_thread = threading.current_thread() is threading.main_thread()  # other threads cannot handle signals
    handlers = {number: signal.getsignal(number) for number in STOPPING if number != signal.SIGINT}
    before = {number: found for number, found in handlers.items() if in_main_thread and found != signal.SIG_IGN}
    for number in before:
        signal.signal(number, stop)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without θ or ┃ shows a question mark
    try:
        check_address_space(MIN_MEMORY)
        words = (sys.argv[1:] if argv is None else argv)[:2]
        if cores.IS_WINDOWS and words[:1] and words[0] not in cores.TRIED_ON_WINDOWS:
            err.print(f"saf-gen: {cores.WINDOWS_ADVICE}")
        with at_work(words[0]) if words[:1] and words[0] in UNPACKING else nullcontext():
            code = root_command()(args=argv, standalone_mode=False, prog_name="saf-gen")
        if code == STOPPED_EXIT_CODE:  # typer returns it for Ctrl-C
            code = stopped[0] if stopped else STOPPED_EXIT_CODE
            print_error("; ".join(filter(None, ("stopped", _stop_message(words)))), code)
    except SafGenError as error:
        code = print_error(str(error), error.exit_code)
    except typer.TyperException as error:
        message = error.format_message()  # empty if typer printed the help of a group instead
        at = getattr(getattr(error, "ctx", None), "command_path", "saf-gen")
        code = print_error(f"{message.removesuffix('.')}; see: {at} --help", 2) if message else 0
    except (SystemExit, BrokenPipeError) as error:
        code = _find_exit_code(error)
    except MemoryError:
        code = print_error(f"memory ran out{_MEMORY_ADVICE}", 1)
    except (RuntimeError, OSError) as error:
        if cannot_start(error):
            code = print_error(f"the system cannot start more threads and processes{_MEMORY_ADVICE}", 1)
        elif isinstance(error, OSError):  # a full disk, or a terminal that was closed
            code = print_error(f"{error.filename or 'the output'}: {error.strerror or error}", 1)
        else:
            raise
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    sys.exit(code or 0)
