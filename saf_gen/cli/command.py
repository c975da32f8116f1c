"""A command as the command line lists it, and the commands of add-ons, which are found by path."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

import saf_gen

ADDONS = Path(saf_gen.__file__).parent / "addons"
FINISHED_WORK_IS_KEPT = "finished work is kept: run the same command again to continue"
NOTHING_WRITTEN = "nothing was written: the same command starts from the beginning"


class Panel(StrEnum):
    """The panels of ``saf-gen --help``, in their order."""

    GENERATE = "Generate"
    EVALUATE = "Evaluate"
    RECORDINGS = "Your recordings"
    SCENES = "Scenes, sensors"
    SHARE = "Share and check"


@dataclass(frozen=True)
class Command:
    """A command, whose words are its key in the ``COMMANDS`` of the file that defines it.

    Attributes
    ----------
    function : callable
        The function, whose parameters are the arguments and options, and whose docstring is the help.
    examples : tuple of str
        Examples at the end of the help, at least one, without the word saf-gen.
    panel : Panel
        Panel of the help that lists the command; that of the first command of a group lists the group.
    stopped : str
        What a user who stops the command is told, such as `NOTHING_WRITTEN`; empty if it writes no files.
    """

    function: Callable[..., None]
    examples: tuple[str, ...]
    panel: Panel
    stopped: str = ""


@cache
def addon_commands() -> tuple[dict[str, Command], dict[str, str]]:
    """Return the commands of all add-ons by the words that call them, and the help of the groups that they add."""
    modules = [import_module(f"saf_gen.addons.{module.name}.commands") for module in iter_modules([str(ADDONS)])]
    commands = {words: command for module in modules for words, command in module.COMMANDS.items()}
    return commands, {group: text for module in modules for group, text in getattr(module, "GROUPS", {}).items()}
