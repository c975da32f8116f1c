"""Escaping of untrusted text, so that pages, figures, Markdown and LaTeX show it literally; numbers with nouns."""

from dataclasses import fields, is_dataclass, replace
from html import escape
from typing import Any

from saf_gen.errors import escape_controls

_ESCAPES = {**{sign: f"\\{sign}" for sign in "\\|`*[]"}, **{sign: escape(sign) for sign in "&<>"}}

_LATEX = {
    **{sign: f"\\{sign}" for sign in "&%$#_{}"},
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": "$<$",
    ">": "$>$",
    "|": "$|$",
    "≤": r"$\leq$",
    "≥": r"$\geq$",
    "½": r"$\frac{1}{2}$",
    "–": "--",
    "−": "$-$",
    "±": r"$\pm$",
    "×": r"$\times$",
}


def escape_markdown(text: str) -> str:
    """Return the text on one line, escaped so that Markdown shows it as it is: no HTML, link or table column."""
    return "".join(_ESCAPES.get(sign, sign) for sign in escape_controls(" ".join(text.split())))


def escape_latex(text: str) -> str:
    """Return the text on one line, with LaTeX's special characters escaped."""
    return "".join(_LATEX.get(sign, sign) for sign in escape_controls(" ".join(text.split())))


def plural(count: int, noun: str) -> str:
    """Return the number and its noun, in the plural unless the number is 1."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def escape_all_text(item: Any) -> Any:
    """Return a text, tuple or dataclass in which :func:`saf_gen.errors.escape_controls` has escaped every text.

    An item with nothing to escape is returned as it is. Mappings and lists are returned unchanged.
    """
    if isinstance(item, str):
        return escape_controls(item)
    if type(item) is tuple:
        new = tuple(map(escape_all_text, item))
        return item if all(one is other for one, other in zip(item, new, strict=True)) else new
    if is_dataclass(item) and not isinstance(item, type):
        held = {field.name: getattr(item, field.name) for field in fields(item) if field.init}
        changed = {name: new for name, old in held.items() if (new := escape_all_text(old)) is not old}
        return replace(item, **changed) if changed else item
    return item
