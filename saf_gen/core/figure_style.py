"""The style of figures (colours, dashes, fonts) and their output as SVG for a file or a page.

Every figure has its own canvas, so nothing depends on a screen or on the state of pyplot. Text in an SVG remains text.
On a page every colour is a CSS variable, so that one drawing serves light and dark colour schemes.
"""

import io
import re
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from html import escape
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

COLUMN = 3.5  # inches: one column of a two-column paper
WIDTH = 4.4  # inches: readable on a phone, and two or three figures fit side by side on a desktop screen
MAX_MEASURES = 8
"""Largest number of measures in one figure; more could not be distinguished."""
INK, SOFT, BAND, GREY, PAPER = "#1f2328", "#6b7280", "#e8c547", "#d5d8dc", "#ffffff"
# Okabe and Ito's colours can be distinguished with every kind of colour vision; dashes help as well.
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#111111", "#e69f00", "#8c6d31")
DASHES: tuple[Any, ...] = (
    "-",
    (0, (5, 1.5)),
    (0, (1.2, 1.2)),
    (0, (6, 1.5, 1.2, 1.5)),
    (0, (3, 1.2)),
    (0, (8, 2)),
    (0, (4, 1, 1, 1, 1, 1)),
    (0, (1, 2)),
)
VARIABLES: dict[str, str] = {
    INK: "--ink",
    SOFT: "--soft",
    BAND: "--band",
    GREY: "--area",
    PAPER: "--paper",
    **{colour: f"--c{number}" for number, colour in enumerate(COLOURS, start=1)},
}
STYLE: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 8.5,
    "axes.edgecolor": SOFT,
    "axes.facecolor": "none",
    "axes.labelcolor": INK,
    "axes.labelsize": 8,
    "axes.linewidth": 0.8,
    "axes.titlesize": 8.5,
    "text.color": INK,
    "xtick.color": SOFT,
    "xtick.labelcolor": INK,
    "xtick.labelsize": 7.5,
    "ytick.color": SOFT,
    "ytick.labelcolor": INK,
    "ytick.labelsize": 7.5,
    "legend.fontsize": 7.5,
    "legend.frameon": False,
    "figure.facecolor": "none",
    "svg.fonttype": "none",
    "text.parse_math": False,  # a name may contain a dollar sign
}
COLUMN_STYLE: dict[Any, Any] = {
    **STYLE,
    "font.size": 7, "axes.labelsize": 7, "axes.titlesize": 6.5, "xtick.labelsize": 6.5, "ytick.labelsize": 6.5,
    "lines.linewidth": 1.0, "lines.markersize": 3,
    "legend.fontsize": 6.5, "axes.linewidth": 0.6, "xtick.major.width": 0.6, "ytick.major.width": 0.6,
    "figure.facecolor": "white", "svg.hashsalt": "figure",
}  # fmt: skip
"""Style of figures for a paper, one column (3.5 inches) or two columns (7.16 inches) wide."""
_DIGITS = re.compile(r"(?<![\w#.])-?\d+\.\d{3,}(?![\w.])")


@dataclass(frozen=True)
class PlotStyle:
    """The style of one measure or light in every plot of a view."""

    colour: str
    dashes: Any


def assign_styles(names: Sequence[str]) -> dict[str, PlotStyle]:
    """Return a style for each name, in their order; there are MAX_MEASURES colours and MAX_MEASURES² styles."""
    styles = {}
    for i, name in enumerate(dict.fromkeys(names)):
        j = (i + i // MAX_MEASURES) % MAX_MEASURES  # a repeated colour has other dashes
        styles[name] = PlotStyle(COLOURS[i % MAX_MEASURES], DASHES[j])
    return styles


@contextmanager
def use_plot_style(style: dict[Any, Any] = STYLE) -> Iterator[None]:
    """Set matplotlib's settings for our figures in a ``with`` block, and restore the earlier settings after it.

    Letters that the font lacks cause no warning, because an SVG stores names as text, shown in the reader's font.
    """
    with matplotlib.rc_context(style), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "(?s)Glyph .* missing from font", UserWarning)
        yield


def hide_spines(axes: Axes, *sides: str) -> None:
    """Hide these sides of the frame around the axes, such as "top"."""
    for side in sides:
        axes.spines[side].set_visible(False)


def plot_to_svg(figure: Figure, *, name: str) -> str:
    """Return the figure as the text of an SVG file; the same figure and name give the same text."""
    buffer = io.StringIO()
    with use_plot_style({**STYLE, "svg.hashsalt": name}):
        figure.savefig(buffer, format="svg", metadata=dict.fromkeys(("Date", "Creator", "Format", "Type")))
    return _DIGITS.sub(lambda m: f"{float(m[0]):.2f}".rstrip("0").rstrip("."), buffer.getvalue())


def inline_svg(svg: str, *, label: str) -> str:
    """Return the SVG as an element of a page, with the colours and the font of the page.

    Ids that nothing refers to are removed, because other figures on the page may have the same ids. ``label``
    describes the figure to readers who cannot see it.
    """
    text = svg[svg.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>|<!--.*?-->|<style.*?</style>", "", text, flags=re.DOTALL)
    used = set(re.findall(r'(?:url\(#|xlink:href="#)([^)"]+)', text))
    text = re.sub(r' id="([^"]+)"', lambda m: m[0] if m[1] in used else "", text)
    text = re.sub(r"#[0-9a-f]{6}\b", lambda m: f"var({VARIABLES[m[0]]})" if m[0] in VARIABLES else m[0], text)
    text = re.sub(r"'DejaVu Sans'(, sans-serif)?", "inherit", text)
    text = text.replace("xlink:href=", "href=")
    box = re.search(r'viewBox="([^"]+)"', text)
    head = f'<svg viewBox="{box[1] if box else ""}" role="img" aria-label="{escape(label)}">'
    return re.sub(r"\s*\n\s*", "\n", head + text[text.index(">") + 1 :]).strip()
