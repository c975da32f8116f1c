"""Pages as HTML: their templates, which escape every text that is not marked as HTML, and their style and script."""

import base64
import hashlib
import re
from functools import cache
from importlib.resources import files

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from saf_gen.core.table import Table, percent
from saf_gen.leaderboard.tables import USUAL

MAX_TOGETHER_CHARACTERS = 60
"""Largest total length of the headings of columns that are shown together, at which they are shown at first.

The tables by condition and the view of all columns always show them.
"""


@cache
def load_templates() -> Environment:
    """Return the templates of the pages, with their filters."""
    templates = Environment(
        loader=PackageLoader("saf_gen.leaderboard.report", "assets"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    templates.filters["base64"] = lambda data: base64.b64encode(data).decode()
    templates.filters["css_percent"] = lambda fraction: f"{100 * fraction:.4g}%"
    templates.filters["fold_rules"] = _format_fold_rules
    templates.filters["link_sources"] = _link_sources
    templates.filters["percent"] = percent
    templates.filters["breakable"] = lambda method: Markup(re.sub("([+:,])", r"\1<wbr>", str(escape(method))))
    templates.policies["json.dumps_kwargs"] = {"ensure_ascii": False, "allow_nan": False, "separators": (",", ":")}
    return templates


def read_asset(*names: str) -> Markup:
    """Return the joined text of files in ``assets``, for a style or script element."""
    folder = files("saf_gen.leaderboard.report") / "assets"
    return Markup("\n".join((folder / name).read_text(encoding="utf-8") for name in names))


def hash_script(script: str) -> str:
    """Return the base64-encoded SHA-256 by which the content security policy of a page allows its script."""
    return base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()


def _format_fold_rules(table: Table, id: str) -> Markup:
    """Return the style rules that hide the columns of a folded table for which the screen has no space."""
    shown = table.shown
    is_long = sum(len(column.header) + 3 for column in shown if column.together) > MAX_TOGETHER_CHARACTERS
    rules = []
    for where, is_always in (("all", True), ("screen and (max-width: 40rem)", False)):
        cells = ", ".join(
            f"#{id}.folded tr:not(.groups) > :nth-child({number})"
            for number, column in enumerate(shown, start=1)
            if column.detail and is_always == (column.detail > USUAL or bool(column.together and is_long))
        )
        rules += [f"@media {where} {{ {cells} {{ display: none; }} }}"] if cells else []
    return Markup("\n".join(rules))


def _link_sources(text: str) -> Markup:
    """Return the text as HTML with a link for each DOI."""
    linked = re.sub(
        r"\bdoi:(10\.\S+?)(?=[.,;)]*(?:\s|$))", r'<a href="https://doi.org/\1">doi:\1</a>', str(escape(text))
    )
    return Markup(linked)
