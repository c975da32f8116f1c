"""A figure for a paper, one column wide: pictures of a recording above plots of lens, light and scores."""

from pathlib import Path
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from saf_gen.core.figure_style import COLUMN, COLUMN_STYLE, SOFT, use_plot_style
from saf_gen.core.region import Region
from saf_gen.stream.pictures.panels import draw_panels, list_panels, stream_legends_height
from saf_gen.stream.pictures.timeline import Timeline
from saf_gen.stream.pictures.window_pictures import WindowPictures

# Heights in inches of a plot, its axis, a caption, and the tallest picture.
PANEL, AXIS, CAPTION, TALLEST = 0.72, 0.3, 0.15, 2.5
DOTS_PER_INCH = 300
BOX = "#ffd84a"


def draw_still(pictures: WindowPictures, timeline: Timeline, *, region: Region | None, path: Path, form: str) -> None:
    """Write pictures and plots to ``path`` as png, pdf or svg (``form``), 3.5 inches wide.

    The same input gives the same bytes.
    """
    count = len(pictures.starts)
    across = min(count, 3 if count <= 9 else 4 if count <= 16 else 6)
    down = -(-count // across)
    _, height, width = pictures.stream.shape
    each = min(COLUMN / across * height / width, TALLEST) + CAPTION
    above, below = down * each, PANEL * len(list_panels(timeline)) + AXIS
    with use_plot_style(COLUMN_STYLE):
        below += stream_legends_height(timeline, width=COLUMN)
        figure = Figure(figsize=(COLUMN, above + below), dpi=DOTS_PER_INCH, layout="constrained")
        FigureCanvasAgg(figure)
        layout: Any = figure.get_layout_engine()
        layout.set(w_pad=0.02, h_pad=0.02, wspace=0.02, hspace=0.02)
        halves: Any = figure.subfigures(2, 1, height_ratios=[above, below])
        cells = halves[0].subplots(down, across, squeeze=False).ravel()
        for cell in cells:
            cell.set_axis_off()
        for cell, picture, centre in zip(cells, pictures, pictures.centres, strict=False):
            cell.imshow(picture, cmap="gray", vmin=0, vmax=255, interpolation="nearest")
            cell.set_title(_caption(pictures, centre), pad=2)
            if region is not None:
                cell.add_patch(_outline(region))
        axes = draw_panels(halves[1], timeline)
        for ax in axes:
            for centre in pictures.centres:
                ax.axvline(centre, color=SOFT, lw=0.5, ls=":")
        nothing = dict.fromkeys({"pdf": ("CreationDate",), "svg": ("Date",)}.get(form, ()))
        figure.savefig(path, format=form, metadata=nothing)


def _caption(pictures: WindowPictures, centre: float) -> str:
    lens = pictures.stream.focus_position
    return f"frame {centre:,.0f}" + ("" if lens is None else f", lens {lens[round(centre)]:.2f}")


def _outline(region: Region) -> Rectangle:
    rows, columns = region
    corner = (columns.start - 0.5, rows.start - 0.5)
    return Rectangle(
        corner, columns.stop - columns.start, rows.stop - rows.start, fill=False, edgecolor=BOX, linewidth=0.7
    )
