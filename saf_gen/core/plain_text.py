"""Escaping of untrusted text, so that pages, figures and Markdown show it literally."""

from dataclasses import fields, is_dataclass, replace
from html import escape
from typing import Any

from saf_gen.errors import escape_controls

_ESCAPES = {**{sign: f"\\{sign}" for sign in "\\|`*[]"}, **{sign: escape(sign) for sign in "&<>"}}


def escape_markdown(text: str) -> str:
    """Return the text on one line, escaped so that Markdown shows it as it is: no HTML, link or table column."""
    return "".join(_ESCAPES.get(sign, sign) for sign in escape_controls(" ".join(text.split())))


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
