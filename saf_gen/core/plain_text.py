"""Escaping of untrusted text, so that pages, figures, Markdown and LaTeX show it literally; numbers with nouns."""

from html import escape

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
