"""The command line, which parses arguments, calls the package and prints results.

Each group of commands has its own file. Commands are plain functions, which get their names in this module;
:mod:`saf_gen.cli.addons` finds those of add-ons. Only this folder and the commands of add-ons import typer and print.
"""

import os
import select
import signal
import sys
import threading
import traceback
from collections import Counter
from collections.abc import Callable
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
    lens_commands,
    machine_commands,
    method_commands,
    recapture_command,
    recipe_commands,
    scene_commands,
    sensor_commands,
    stream_commands,
)
from saf_gen.cli._examples import EXAMPLES, help_ending
from saf_gen.cli._terminal import at_work, err, out, print_error
from saf_gen.cli.addons import FINISHED_WORK_IS_KEPT, NOTHING_WRITTEN, addon_commands
from saf_gen.core import cores
from saf_gen.core.cores import STOPPING, check_address_space
from saf_gen.core.user_code import describe_exit
from saf_gen.errors import BadInput, SafGenError

__all__ = ["main", "root_command"]

STOPPED_EXIT_CODE = 130

COMMANDS: dict[str, Callable[..., None]] = {
    "generate": dataset_commands.generate_command,
    "evaluate": evaluate_commands.evaluate_command,
    "tune": leaderboard_commands.tune_command,
    "score": evaluate_commands.score_command,
    "import": stream_commands.import_command,
    "encode": stream_commands.encode_command,
    "export": stream_commands.export_command,
    "cut": stream_commands.cut_command,
    "recapture": recapture_command.recapture_command,
    "inspect": stream_commands.inspect_command,
    "view": stream_commands.view_command,
    "verify": dataset_commands.verify_command,
    "fetch": dataset_commands.fetch_command,
    "init": machine_commands.init_command,
    "doctor": machine_commands.doctor_command,
}
GROUPS: dict[str, tuple[str, dict[str, Callable[..., None]]]] = {
    "scenes": (
        "List, create, check and draw scenes.",
        {
            "list": scene_commands.list_scenes_command,
            "show": scene_commands.show_scene_command,
            "new": scene_commands.new_scene_command,
            "from-pictures": scene_commands.from_pictures_command,
            "check": scene_commands.check_scenes_command,
            "preview": scene_commands.preview_command,
        },
    ),
    "lens": (
        "Fit real lenses for scene cards, and show what they do.",
        {"fit": lens_commands.fit_lens_command, "show": lens_commands.show_lens_command},
    ),
    "dataset": (
        "Make a dataset from existing streams, or from shards in separate folders.",
        {"index": stream_commands.index_command, "merge": dataset_commands.merge_shards_command},
    ),
    "recipes": (
        "List and check recipes.",
        {"list": recipe_commands.list_recipes_command, "check": recipe_commands.check_recipe_command},
    ),
    "sensors": (
        "List, show and check sensors.",
        {
            "list": sensor_commands.list_sensors_command,
            "show": sensor_commands.show_sensor_command,
            "check": sensor_commands.check_sensor_command,
        },
    ),
    "leaderboard": (
        "Merge evaluations into one ranking, and verify rows.",
        {"merge": leaderboard_commands.merge_command, "verify": leaderboard_commands.verify_evaluation_command},
    ),
    "methods": (
        "List focus measures and searches, show one in full, or check a method.",
        {"show": method_commands.show_method_command, "check": method_commands.check_method_command},
    ),
}
GROUPS_THAT_TAKE_ARGUMENTS = {"leaderboard": "merge"}
"""The command that runs if the arguments of a group do not name one: ``leaderboard A B`` merges A and B."""
GROUP_DEFAULTS: dict[str, Callable[..., None]] = {"methods": method_commands.list_methods_command}
"""The function that runs if a group is given without a command; other groups print their help."""
STOP_MESSAGES = {
    **dict.fromkeys(("generate", "dataset merge", "fetch", "evaluate", "tune", "recapture"), FINISHED_WORK_IS_KEPT),
    **dict.fromkeys(("leaderboard", "score", "import", "encode", "export", "cut", "view", "lens"), NOTHING_WRITTEN),
}
"""What a user who stops a command is told, by command or group; commands that write no files have none."""


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


class _GroupThatTakesArguments(_Group):
    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        command = GROUPS_THAT_TAKE_ARGUMENTS[str(self.name)]
        named = args and (args[0] in self.commands or args[0] in ("-h", "--help"))
        return super().parse_args(ctx, args if named or not args else [command, *args])


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


@cache
def root_command() -> Any:
    """Return the command that contains all others, with those of add-ons; it is built once."""
    addons = addon_commands()
    examples = EXAMPLES | {name: command.examples for name, command in addons.items()}
    app = typer.Typer(
        help="Spike-camera autofocus data from physics, and the benchmark that ranks autofocus methods on it.",
        epilog=help_ending("", examples),
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
        cls=_Group,
    )
    app.callback()(_options)
    for name, function in COMMANDS.items():
        app.command(name, cls=_Command, epilog=help_ending(name, examples))(function)
    groups = {}
    for group, (words, functions) in GROUPS.items():
        groups[group] = typer.Typer(
            help=words,
            epilog=help_ending(group, examples),
            no_args_is_help=group not in GROUP_DEFAULTS,
            invoke_without_command=group in GROUP_DEFAULTS,
            cls=_GroupThatTakesArguments if group in GROUPS_THAT_TAKE_ARGUMENTS else _Group,
        )
        if group in GROUP_DEFAULTS:
            groups[group].callback()(GROUP_DEFAULTS[group])
        for name, function in functions.items():
            groups[group].command(name, cls=_Command, epilog=help_ending(f"{group} {name}", examples))(function)
        app.add_typer(groups[group], name=group)
    for words, command in addons.items():
        group, _, name = words.rpartition(" ")
        parent = groups[group] if group else app
        ending = help_ending(words, examples)
        parent.command(name, cls=_Command, epilog=ending, rich_help_panel=command.panel)(command.function)
    return typer.main.get_command(app)


def _stop_message(words: list[str]) -> str:
    """Return the line for a command that was stopped, called by these words; empty for one that writes no files."""
    messages = STOP_MESSAGES | {name: command.stopped for name, command in addon_commands().items()}
    return messages.get(" ".join(words)) or messages.get("".join(words[:1])) or ""


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
    except RuntimeError as error:
        if "can't start new thread" not in str(error):
            raise
        code = print_error(f"the system cannot start more threads{_MEMORY_ADVICE}", 1)
    except OSError as error:  # a full disk, or a terminal that was closed
        code = print_error(f"{error.filename or 'the output'}: {error.strerror or error}", 1)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    sys.exit(code or 0)
