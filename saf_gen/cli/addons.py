"""The commands of add-ons, which are found by path: each folder in ``saf_gen/addons`` that is there."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from types import ModuleType

import saf_gen

FOLDER = Path(saf_gen.__file__).parent / "addons"
FINISHED_WORK_IS_KEPT = "finished work is kept: run the same command again to continue"
NOTHING_WRITTEN = "nothing was written: the same command starts from the beginning"


@dataclass(frozen=True)
class Command:
    """A command of an add-on.

    Attributes
    ----------
    function : callable
        The function, whose parameters are the arguments and options, and whose docstring is the help.
    examples : tuple of str
        Examples at the end of the help, at least one, without the word saf-gen.
    panel : str
        Title of the panel of the help that lists the command.
    stopped : str
        What a user who stops the command is told, such as `NOTHING_WRITTEN`; empty if it writes no files.
    """

    function: Callable[..., None]
    examples: tuple[str, ...]
    panel: str = "Commands"
    stopped: str = ""


@cache
def _modules() -> list[ModuleType]:
    names = [module.name for module in iter_modules([str(FOLDER)])]
    return [import_module(f"saf_gen.addons.{name}.commands") for name in names]


@cache
def addon_commands() -> dict[str, Command]:
    """Return the commands of all add-ons, by the words that call them."""
    return {words: command for module in _modules() for words, command in module.COMMANDS.items()}


@cache
def addon_groups() -> dict[str, str]:
    """Return the groups of commands that add-ons bring, with the help of each."""
    return {group: text for module in _modules() for group, text in getattr(module, "GROUPS", {}).items()}
