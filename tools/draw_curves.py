"""Draw the focus curves of README: the same sweep under several lights, side by side, as PNG.

python tools/draw_curves.py STREAM.h5... --out docs/pictures/curves-usaf_target.png

The streams are those of one scene under different lights, such as the three static ones of ``usaf_target`` in
``recipes/sad_synthetic.yaml``. README shows the picture half as wide as its pixels say.
"""

import argparse
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from PIL import Image

from saf_gen.benchmark.evaluate import score_blocks
from saf_gen.core.figure_style import BAND, COLOURS, DASHES, GREY, INK, STYLE
from saf_gen.core.files import atomic_file
from saf_gen.leaderboard.report.charts import normalise
from saf_gen.stream.stream_file import SpikeStream, open_stream

MEASURES = ("sd", "er_sumsq", "mfdct_code")
WINDOW = 100
TITLE = "One sweep over a resolution chart, under three lights"
LIGHTS = {"constant": "constant light", "continuous": "rising light", "sudden": "jumping light"}
SHOWN_WIDTH_PX = 840
"""Width at which README shows the picture."""
SIZE_INCHES, DOTS_PER_INCH = (8.4, 3.3), 200
FONT_PT = 8.5


def draw_curves(streams: Sequence[SpikeStream]) -> Figure:
    """Return the figure: a panel for each stream, with the curves of MEASURES, the light, and the true focus."""
    style = {
        **STYLE, "font.size": FONT_PT, "axes.titlesize": FONT_PT, "axes.labelsize": FONT_PT,
        "xtick.labelsize": FONT_PT, "ytick.labelsize": FONT_PT, "legend.fontsize": FONT_PT, "figure.facecolor": "white",
    }  # fmt: skip
    with matplotlib.rc_context(style):
        figure = Figure(figsize=SIZE_INCHES, dpi=DOTS_PER_INCH, layout="constrained")
        FigureCanvasAgg(figure)
        figure.suptitle(TITLE, x=0.01, ha="left", fontsize=FONT_PT + 2, fontweight="bold")
        panels = figure.subplots(1, len(streams), sharex=True, sharey=True, squeeze=False)[0]
        for axes, stream in zip(panels, streams, strict=True):
            _draw_panel(axes, stream)
        panels[0].set_ylabel("score, scaled to its range")
        panels[len(panels) // 2].set_xlabel("position of the lens, fraction of its travel")
        figure.legend(handles=_handles(), loc="outside lower center", ncols=len(MEASURES) + 2, handlelength=2.2)
    return figure


def _draw_panel(axes: Axes, stream: SpikeStream) -> None:
    first, _ = score_blocks(stream, MEASURES[0], window=WINDOW)
    lens = np.asarray(stream.focus_position)[first + WINDOW // 2]
    light = np.array([stream.counts(a, a + WINDOW).mean() for a in first.tolist()])
    axes.fill_between(lens, light / light.max(), color=GREY, lw=0, step="mid")
    axes.axvspan(*sorted(stream.truth.depth_of_focus), color=BAND, alpha=0.45, lw=0)
    axes.axvline(stream.truth.position, color=INK, lw=1.1)
    for measure, colour, dashes in zip(MEASURES, COLOURS, DASHES, strict=False):
        axes.plot(lens, normalise(score_blocks(stream, measure, window=WINDOW)[1]), c=colour, ls=dashes, lw=1.6)
    name = stream.path.stem.split("-")[1]
    axes.set_title(LIGHTS.get(name, name), loc="left")
    axes.set(xlim=(0, 1), ylim=(0, 1.03), xticks=[0, 0.5, 1], yticks=[0, 1])
    axes.set_xticklabels(["0", "0.5", "1"])
    axes.spines[["top", "right"]].set_visible(False)


def _handles() -> list[Line2D | Patch]:
    lines = [
        Line2D([], [], color=colour, ls=dashes, lw=1.6, label=measure)
        for measure, colour, dashes in zip(MEASURES, COLOURS, DASHES, strict=False)
    ]
    return [*lines, Patch(color=GREY, label="light"), Line2D([], [], color=INK, lw=1.1, label="true focus")]


def main() -> None:
    """Draw the picture."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("streams", nargs="+", type=Path)
    parser.add_argument("--out", required=True, type=Path)
    options = parser.parse_args()
    drawn = BytesIO()
    draw_curves([open_stream(path) for path in options.streams]).savefig(drawn, format="png")
    with atomic_file(options.out) as part, Image.open(drawn) as picture:
        picture.convert("RGB").quantize(64).save(part, format="png", optimize=True)


if __name__ == "__main__":
    main()
