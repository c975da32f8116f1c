"""A recording as a self-contained page: pictures to scrub through, with a cursor on plots."""

import json
from base64 import b64encode
from collections.abc import Iterator
from html import escape
from importlib.resources import files
from math import isfinite
from pathlib import Path
from string import Template

import numpy as np
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from saf_gen.core.display_tone import display_gamma
from saf_gen.core.figure_style import WIDTH, inline_svg, plot_to_svg, use_plot_style
from saf_gen.core.region import Region
from saf_gen.stream.pictures.image_strip import encode_jpegs, lay_out_pictures, shrink_picture
from saf_gen.stream.pictures.panels import draw_panels, list_panels, stream_legends_height
from saf_gen.stream.pictures.timeline import KINDS, Timeline, WindowPictures, describe_moment

PANEL, AXIS = 0.95, 0.45  # inches
WIDEST, MAX_BYTES = 400, 4_000_000


def write_player(
    pictures: WindowPictures, timeline: Timeline, *, region: Region | None, path: Path, title: str, fps: float
) -> None:
    """Write the page to ``path``; it needs no network, and scripts only for its motion."""
    stream, two_tone = pictures.stream, pictures.kind == "spikes"
    sheet = lay_out_pictures(_small_pictures(pictures), count=len(pictures.starts), two_tone=two_tone)
    strip = sheet.encode("PNG", optimize=True) if two_tone else encode_jpegs(sheet, max_bytes=MAX_BYTES)
    with use_plot_style():
        tall = PANEL * len(list_panels(timeline)) + AXIS + stream_legends_height(timeline, width=WIDTH)
        figure = Figure(figsize=(WIDTH, tall), dpi=72, layout="constrained")
        FigureCanvasSVG(figure)
        axes = draw_panels(figure, timeline)
        figure.draw_without_rendering()
        x = axes[0].transData.transform([(f, 0) for f in pictures.centres])[:, 0] / figure.bbox.width
        top, bottom = 1 - axes[0].get_position().y1, 1 - axes[-1].get_position().y0
        svg = inline_svg(plot_to_svg(figure, name="view"), label="Lens, light and scores over the frames")
    frames, rows, columns = stream.shape
    words = [describe_moment(stream, first=int(a), window=pictures.window) for a in pictures.starts]
    size = f"{columns} × {rows} pixels, {frames:,} readouts at {stream.readout_hz:,.0f} per second"
    rest = "." if pictures.kind == "spikes" else f"; {pictures.window} readouts per window."
    play = {"across": strip.columns, "down": strip.rows, "x": [round(f, 5) for f in x.tolist()], "words": words}
    page = Template(files(__package__).joinpath("player.html").read_text(encoding="utf-8")).substitute(
        title=escape(title),
        facts=escape(f"{size}. {KINDS[pictures.kind]}{rest}"),
        play=escape(json.dumps({**play, "fps": fps}, ensure_ascii=False)),
        source=f"data:{strip.media_type};base64,{b64encode(strip.file).decode()}",
        alt=escape(f"{strip.count} pictures of the recording, {words[0]} to {words[-1]}"),
        width=strip.size[0],
        height=strip.size[1],
        across=strip.columns,
        rendering="pixelated" if strip.size[0] < 300 else "auto",
        last=strip.count - 1,
        start=int(np.abs(pictures.centres - stream.truth.frame).argmin()) if isfinite(stream.truth.frame) else 0,
        box=_box_style(region, (rows, columns)),
        top=f"{top:.4f}",
        bottom=f"{1 - bottom:.4f}",
        svg=svg,
    )
    path.write_text(page, encoding="utf-8")


def _small_pictures(pictures: WindowPictures) -> Iterator[np.ndarray]:
    _, rows, columns = pictures.stream.shape
    if pictures.kind == "spikes" or columns <= WIDEST:
        yield from pictures
        return
    size = WIDEST, max(round(rows * WIDEST / columns), 1)
    for number in range(len(pictures.starts)):
        grey = display_gamma(shrink_picture(pictures.linear(number), size), pictures.white)
        yield (255 * grey).round().astype(np.uint8)


def _box_style(region: Region | None, size: tuple[int, int]) -> str:
    if region is None:
        return "display: none"
    rows, columns = region
    edges = {
        "top": rows.start / size[0],
        "left": columns.start / size[1],
        "height": (rows.stop - rows.start) / size[0],
        "width": (columns.stop - columns.start) / size[1],
    }
    return "; ".join(f"{name}: {100 * value:.3f}%" for name, value in edges.items())
