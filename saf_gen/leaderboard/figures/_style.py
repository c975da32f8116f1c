"""How figures look: colours, dashes, markers, type; and a figure as SVG, for a file or within a page.

Figures are drawn on the canvas of their own Figure, so nothing depends on a screen or on pyplot's state. Text
stays text. Within a page every colour is a variable of the page, so that one drawing serves light and dark.
"""

import io
import re
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

__all__ = [
    "MAX_MEASURES",
    "PREDICTIONS_LABEL",
    "PlotStyle",
    "add_paper_background",
    "assign_styles",
    "create_figure",
    "describe_omissions",
    "inline_svg",
    "shorten_middle",
    "split_method",
    "to_svg",
    "use_figure_style",
]

WIDTH = 4.4  # inches: a figure is readable on a phone, and two or three stand side by side on a desk
MAX_MEASURES = 8
"""Measures in one figure: more cannot be told apart."""
PREDICTIONS_LABEL = "predictions"
"""Stands for the search of a method that has none."""
TITLE, TITLE_LINE = 52, 0.16  # letters of a line of the title, inches of a further one
INK, SOFT, BAND, GREY, PAPER = "#1f2328", "#6b7280", "#e8c547", "#d5d8dc", "#ffffff"
# Okabe and Ito's colours can be told apart with any colour vision; dashes and markers say the same again.
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
MARKERS = "osD^vPX*"
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
    "text.parse_math": False,  # a name may hold a dollar sign
}
_DIGITS = re.compile(r"(?<![\w#.])-?\d+\.\d{3,}(?![\w.])")


@dataclass(frozen=True)
class PlotStyle:
    """How one measure is drawn, in every figure of a page."""

    colour: str
    dashes: Any
    marker: str

    def legend_handle(self, **more: Any) -> Line2D:
        """A sample for a legend."""
        options = {"color": self.colour, "ls": self.dashes, "lw": 1.4, "marker": self.marker}
        return Line2D([], [], **{**options, "ms": 5, "mec": PAPER, "mew": 0.5, **more})


def assign_styles(names: Sequence[str]) -> dict[str, PlotStyle]:
    """A look for each name, by its place: MAX_MEASURES colours; with dashes and marks MAX_MEASURES ×
    MAX_MEASURES that differ."""
    found = {}
    for i, name in enumerate(dict.fromkeys(names)):
        other = (
            i + i // MAX_MEASURES
        ) % MAX_MEASURES  # a colour that comes again has other dashes and another mark
        found[name] = PlotStyle(COLOURS[i % MAX_MEASURES], DASHES[other], MARKERS[other])
    return found


def describe_omissions(*held: tuple[int, int, str]) -> str:
    """What a figure leaves out, in words, from (drawn, held, of what); '' where it has everything."""
    said = [f"{drawn} of {all_} {what}" for drawn, all_, what in held if drawn < all_]
    return f"Drawn: the first {', the first '.join(said)}" if said else ""


def shorten_middle(name: str, most: int) -> str:
    """The name; of one that is longer than ``most`` letters both ends, for options differ at the end."""
    if len(name) <= most:
        return name
    end = (most - 1) // 2
    return f"{name[: most - 1 - end]}…{name[len(name) - end :]}"


def split_method(method: str) -> tuple[str, str]:
    """Measure and search of a method's name, with their options; the name itself where it has no plus."""
    measure, _, search = method.partition("+")
    return measure, search


def use_figure_style() -> Any:
    """Matplotlib's settings while a figure is drawn; what was set before comes back."""
    return matplotlib.rc_context(STYLE)


def create_figure(inches: float, *, title: str) -> Figure:
    """An empty figure, WIDTH wide and so high, with its title on the left."""
    lines = textwrap.wrap(title, TITLE) or [""]
    high = inches + TITLE_LINE * (len(lines) - 1)
    figure = Figure(figsize=(WIDTH, high), dpi=72, layout="constrained")
    FigureCanvasSVG(figure)
    figure.suptitle("\n".join(lines), x=0.012, ha="left", fontsize=9.5, fontweight="bold")
    return figure


def hide_spines(axes: Axes, *sides: str) -> None:
    """Hide these sides of the frame."""
    for side in sides:
        axes.spines[side].set_visible(False)


def to_svg(figure: Figure, *, name: str) -> str:
    """The figure as the text of an SVG file; the same figure and name give the same text."""
    buffer = io.StringIO()
    nothing: Mapping[str, Any] = dict.fromkeys(("Date", "Creator", "Format", "Type"))
    with matplotlib.rc_context({**STYLE, "svg.hashsalt": name}):
        figure.savefig(buffer, format="svg", metadata=dict(nothing))
    return _DIGITS.sub(lambda m: f"{float(m[0]):.2f}".rstrip("0").rstrip("."), buffer.getvalue())


def add_paper_background(svg: str) -> str:
    """The SVG of a file: with paper under it, for viewers that have a dark one."""
    end = svg.index(">", svg.index("<svg")) + 1
    return f'{svg[:end]}\n <rect width="100%" height="100%" fill="{PAPER}"/>{svg[end:]}'


def inline_svg(svg: str, *, label: str) -> str:
    """The SVG as an element of a page: the page's colours and type, no name that another figure has.

    ``label`` describes it to readers who do not see it.
    """
    text = svg[svg.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>|<!--.*?-->|<style.*?</style>", "", text, flags=re.DOTALL)
    named = set(re.findall(r'(?:url\(#|xlink:href="#)([^)"]+)', text))
    text = re.sub(r' id="([^"]+)"', lambda m: m[0] if m[1] in named else "", text)
    text = re.sub(r"#[0-9a-f]{6}\b", lambda m: f"var({VARIABLES[m[0]]})" if m[0] in VARIABLES else m[0], text)
    text = re.sub(r"'DejaVu Sans'(, sans-serif)?", "inherit", text)
    text = text.replace("xlink:href=", "href=")
    box = re.search(r'viewBox="([^"]+)"', text)
    head = f'<svg viewBox="{box[1] if box else ""}" role="img" aria-label="{escape(label)}">'
    return re.sub(r"\s*\n\s*", "\n", head + text[text.index(">") + 1 :]).strip()
