"""Names of strangers in Markdown: shown as they are written, whatever they hold."""

from html import escape

from saf_gen.errors import escape_controls

_ESCAPES = {**{sign: f"\\{sign}" for sign in "\\|`*[]"}, **{sign: escape(sign) for sign in "&<>"}}


def escape_markdown(text: str) -> str:
    """Return the text on one line, so that Markdown shows it as it is: no HTML, no link, no column of its own."""
    return "".join(_ESCAPES.get(sign, sign) for sign in escape_controls(" ".join(text.split())))
