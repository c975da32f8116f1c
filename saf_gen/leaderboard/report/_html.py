"""Text and numbers as HTML: everything that comes from a file or a name passes through here."""

import html
import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

__all__ = [
    "HeaderCell",
    "TableCell",
    "embed_json",
    "escape_html",
    "format_attributes",
    "format_code",
    "format_table",
]


@dataclass(frozen=True)
class HeaderCell:
    """The head of a column: what it says, what that means, and a name for the script."""

    text: str
    title: str = ""
    left: bool = False
    name: str = ""


@dataclass(frozen=True)
class TableCell:
    """What a cell shows, and the number to sort by where that is not its text.

    ``bar``: a share 0...1 drawn behind it; ``interval``: its interval; ``link``: where the text leads.
    """

    text: str
    value: float | None = None
    kind: str = ""
    bar: float | None = None
    interval: tuple[float, float] | None = None
    link: str = ""


def escape_html(text: object) -> str:
    """Text as HTML, in an element or in a quoted attribute."""
    return html.escape(str(text), quote=True)


def format_code(text: object) -> str:
    """A name as HTML."""
    return f"<code>{escape_html(text)}</code>"


def format_attributes(**given: Any) -> str:
    """Attributes of an element: those that are not None, '' or False; an underscore is a hyphen."""
    held = {name: value for name, value in given.items() if value is not None and value not in ("", False)}
    return "".join(
        f' {name.rstrip("_").replace("_", "-")}="{escape_html(value)}"' for name, value in held.items()
    )


def embed_json(data: Any) -> str:
    """Data as JSON for a script element: nothing in it can end the element."""
    text = json.dumps(data, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


def format_table(
    heads: Sequence[HeaderCell],
    rows: Sequence[Sequence[TableCell]],
    *,
    caption: str,
    groups: Sequence[tuple[str, int]] = (),
    id_: str = "",
    kinds: Sequence[str] = (),
) -> str:
    """A table that can be sorted, in a box of its own that scrolls; ``kinds`` are classes of its rows.

    ``groups`` stand over the heads, each with the number of columns it covers. ``caption`` is for those who
    hear the page.
    """
    over = "".join(f'<th class="group" colspan="{wide}">{escape_html(text)}</th>' for text, wide in groups)
    lines = [f"<tr>{over}</tr>"] if any(text for text, _ in groups) else []
    lines.append(f"<tr>{''.join(map(_head, heads))}</tr>")
    body = "\n".join(
        f"<tr{format_attributes(class_=kinds[number] if kinds else '')}>"
        + "".join(_cell(cell, head) for cell, head in zip(row, heads, strict=True))
        + "</tr>"
        for number, row in enumerate(rows)
    )
    return (
        f'<div class="wide" role="region" tabindex="0" aria-label="{escape_html(caption)}">'
        f'<table class="sortable"{format_attributes(id_=id_)}><caption>{escape_html(caption)}</caption>\n'
        f"<thead>{''.join(lines)}</thead>\n<tbody>\n{body}\n</tbody></table></div>"
    )


def _head(head: HeaderCell) -> str:
    side = "left" if head.left else ""
    held = format_attributes(scope="col", class_=side, title=head.title, data_name=head.name)
    return f"<th{held}>{escape_html(head.text)}</th>"


def _cell(cell: TableCell, head: HeaderCell) -> str:
    kinds = " ".join(
        filter(None, ("left" if head.left else "", cell.kind, "bar" if cell.bar is not None else ""))
    )
    style = "" if cell.bar is None else f"--v:{cell.bar:.4g}"
    if cell.interval is not None:
        style += f";--lo:{cell.interval[0]:.4g};--hi:{cell.interval[1]:.4g}"
        kinds += " ends"
    number = None if cell.value is None else f"{cell.value:.9g}"
    text = escape_html(cell.text)
    if cell.link:
        text = f"<a{format_attributes(href=cell.link)}>{text}</a>"
    return f"<td{format_attributes(class_=kinds, style=style, data_v=number)}>{text}</td>"
