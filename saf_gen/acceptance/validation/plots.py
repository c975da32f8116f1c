"""Plots of checks: small, and all in the same style."""

from io import BytesIO
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from saf_gen.acceptance.validation.check import Plot
from saf_gen.core.files import atomic_file

COLOURS = ("#1f5fa8", "#c0392b", "#2a8a4a", "#8a5a00", "#6b3fa0", "#007c8a", "#a83279", "#555555")
SIZE_INCHES, DOTS_PER_INCH = (6.4, 2.7), 100


def draw_validation_plot(plot: Plot, path: Path) -> None:
    """Write a plot as PNG with 48 colours, about seven kilobytes; a law and its points share a colour."""
    figure = Figure(figsize=SIZE_INCHES, dpi=DOTS_PER_INCH, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    for n, curve in enumerate(plot.curves):
        colour = COLOURS[n // 2 % len(COLOURS)]
        if curve.kind == "line":
            axes.plot(curve.x, curve.y, color=colour, linewidth=1, label=curve.label)
        else:
            axes.errorbar(
                curve.x,
                curve.y,
                curve.error or None,
                color=colour,
                fmt="o",
                markersize=2.5,
                elinewidth=0.8,
                label=curve.label,
            )
    axes.set_xscale("log" if plot.log_x else "linear")
    axes.set_yscale("log" if plot.log_y else "linear")
    axes.set_xlabel(plot.x_label, fontsize=8)
    axes.set_ylabel(plot.y_label, fontsize=8)
    axes.tick_params(labelsize=7)
    axes.spines[["top", "right"]].set_visible(False)
    if len(plot.curves) > 1:
        axes.legend(fontsize=6.5, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    drawn = BytesIO()
    figure.savefig(drawn, format="png")
    with atomic_file(path) as part, Image.open(drawn) as picture:
        picture.convert("RGB").quantize(48).save(part, format="png", optimize=True)
