"""The public names of saf_gen: its commands, and the functions and classes on which scripts and plug-ins may rely.

``tools/build_site.py`` writes two pages of the site from them, each of which begins with its list: all commands with
their options, and all names with their docstrings.
"""

import inspect
import re
from collections.abc import Iterable, Iterator
from importlib import import_module
from typing import Any

import saf_gen
from saf_gen.cli import root_command

PUBLIC = {
    "saf_gen": [name for name in saf_gen.__all__ if not name.startswith("__")],
    "saf_gen.parts": ["Light", "Motion", "Measure", "Search", "View", "Answer"],
    "saf_gen.stream.stream_file": ["SpikeStream"],
    "saf_gen.stream.metadata": ["Metadata", "Truth"],
    "saf_gen.generate.resolve": ["resolve_recipe"],
    "saf_gen.generate.run": ["generate"],
    "saf_gen.benchmark.evaluate": ["evaluate"],
    "saf_gen.benchmark.records": ["read_records"],
    "saf_gen.camera": ["Encoder"],
    "saf_gen.optics.actuators": ["get_actuator", "ActuatedLens"],
    "saf_gen.errors": ["BadInput", "SafGenError"],
}
"""Names on which scripts and plug-ins of users may rely, by the module from which to import them."""


def table(*header: str, rows: Iterable[Iterable[str]]) -> str:
    """Return a Markdown table, with each | in a cell escaped."""
    lines = [header, ["---"] * len(header), *rows]
    return "".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |\n" for line in lines)


def tick(text: str) -> str:
    """Return text of a docstring with its reStructuredText code marks replaced by those of Markdown."""
    text = re.sub(r":\w+:`~?\.?([^`]+)`", r"`\1`", text)
    return text.replace("``", "`")


def first_sentence(text: str) -> str:
    """Return the first sentence of a docstring on one line, up to a semicolon."""
    return re.split(r"(?<=[.;])\s", tick(" ".join(text.split())))[0].rstrip(".;") + "."


# --- the lists -----------------------------------------------------------------------------------------


def public_commands() -> str:
    """Return the table of the commands."""
    rows = ([f"`{name}`", first_sentence((command.help or "").replace("\b", ""))] for name, command in commands())
    return table("command", "what it does", rows=rows)


def public_python() -> str:
    """Return the table of the public functions and classes."""
    rows = []
    for module, names in PUBLIC.items():
        for name in names:
            text = inspect.getdoc(getattr(import_module(module), name)) or ""
            rows.append([f"`{name}`", f"`{module}`", first_sentence(text)])
    return table("name", "import it from", "what it is", rows=rows)


def commands() -> Iterator[tuple[str, Any]]:
    """Yield the name and the click object of every command."""
    return _walk(root_command(), "saf-gen")


def _walk(command: Any, name: str) -> Iterator[tuple[str, Any]]:
    if not hasattr(command, "commands"):
        yield name, command
        return
    if command.invoke_without_command and name != "saf-gen":
        yield name, command
    for key, inner in command.commands.items():
        yield from _walk(inner, f"{name} {key}")


# --- pages of the site ---------------------------------------------------------------------------------


def python_page() -> str:
    """Return the page of the public functions and classes, which autodoc makes from their docstrings."""
    parts = [f"# Python interface\n\nNames on which scripts and plug-ins may rely.\n\n{public_python()}"]
    for module, names in PUBLIC.items():
        directives = (_directive(getattr(import_module(module), name), f"{module}.{name}") for name in names)
        parts.append(f"## {module}\n\n```{{eval-rst}}\n" + "\n".join(directives) + "```\n")
    return "\n".join(parts)


def _directive(one: Any, name: str) -> str:
    if isinstance(one, type):
        return f".. autoclass:: {name}\n   :members:\n"
    return f".. autofunction:: {name}\n"


def commands_page() -> str:
    """Return the page of every command with its arguments and options."""
    return f"# Commands\n\n{public_commands()}\n" + "\n".join(_command(name, command) for name, command in commands())


def _command(name: str, command: Any) -> str:
    shown = [p for p in command.params if not p.hidden and "--help" not in p.opts]
    arguments = [p for p in shown if p.param_type_name == "argument"]
    words = [_option(p) if p.required else f"[{_option(p)}]" for p in arguments]
    words += [f"{p.opts[0]} {_value(p)}".strip() for p in shown if p not in arguments and p.required]
    usage = " ".join([name, *words, *(["[OPTIONS]"] if len(shown) > len(words) else [])])
    text = f"## {name}\n\n```\n{usage}\n```\n\n{_help(command.help)}\n"
    rows = [[f"`{_option(p)}`", tick(p.help or ""), _default(p)] for p in shown]
    return text + ("\n" + table("argument, option", "what it is", "default", rows=rows) if rows else "")


def _help(text: str | None) -> str:
    """Return the help of a command as Markdown; blocks of example commands become code blocks."""
    blocks = tick(inspect.cleandoc((text or "").replace("\b", ""))).split("\n\n")
    return "\n\n".join(f"```\n{b}\n```" if b.startswith("saf-gen ") else " ".join(b.split()) for b in blocks)


def _option(parameter: Any) -> str:
    if parameter.param_type_name == "argument":
        return parameter.name.upper() + ("..." if parameter.nargs == -1 else "")
    return f"{', '.join([*parameter.opts, *parameter.secondary_opts])} {_value(parameter)}".strip()


def _value(parameter: Any) -> str:
    if parameter.is_flag:
        return ""
    return " ".join([parameter.name.upper().strip("_")] * max(parameter.nargs, 1))


def _default(parameter: Any) -> str:
    if parameter.required:
        return "must be given"
    if parameter.default in (None, False, (), []) or getattr(parameter, "is_flag", False):
        return ""
    return f"`{parameter.default}`"
