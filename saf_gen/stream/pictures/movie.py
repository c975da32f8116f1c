"""A recording as a moving picture, a GIF, with a cursor on plots next to the picture."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties, findfont
from PIL import Image, ImageColor, ImageDraw, ImageFont

from saf_gen.core.figure_style import COLOURS, STYLE, use_plot_style
from saf_gen.core.region import Region
from saf_gen.stream.pictures.panels import draw_panels, list_panels, stream_legends_height
from saf_gen.stream.pictures.timeline import SEPARATOR, Timeline, WindowPictures, describe_moment

PLOTS, PANEL, LINE, DOTS_PER_INCH = 380, 110, 26, 100  # pixels: plot width and height, line of text
PICTURE, LARGEST = 400, 800  # pixels: approximate smallest width of a picture, and its largest width and height
BOX, CURSOR, TEXT = (255, 216, 74), (0, 98, 163), (31, 35, 40)
GREYS = 200  # among the 256 colours of a GIF; the others are for the plots
TINT = 16  # difference between the channels of a pixel above which it is not grey


class MovieCanvas:
    """The fixed background of a moving picture, on which the picture and the cursors are drawn.

    ``size`` is (width, height) in pixels.
    """

    def __init__(self, pictures: WindowPictures, timeline: Timeline, *, region: Region | None) -> None:
        self._pictures, self._region = pictures, region
        _, height, width = pictures.stream.shape
        larger = min(-(-PICTURE // width), LARGEST // height)
        scale = larger if larger >= 1 and width < PICTURE else min(1.0, LARGEST / width, LARGEST / height)
        self._shown = max(round(width * scale), 1), max(round(height * scale), 1)
        style: dict[Any, Any] = {**STYLE, "figure.facecolor": "white"}
        with use_plot_style(style):
            legends = round(DOTS_PER_INCH * stream_legends_height(timeline, width=PLOTS / DOTS_PER_INCH))
            tall = max(self._shown[1] + LINE, PANEL * len(list_panels(timeline)) + legends + LINE)
            self.size = self._shown[0] + PLOTS, tall
            inches = self.size[0] / DOTS_PER_INCH, self.size[1] / DOTS_PER_INCH
            figure = Figure(figsize=inches, dpi=DOTS_PER_INCH, layout="constrained")
            canvas = FigureCanvasAgg(figure)
            halves: Any = figure.subfigures(1, 2, width_ratios=[self._shown[0], self.size[0] - self._shown[0]])
            axes = draw_panels(halves[1], timeline)
            canvas.draw()
            self._background = np.asarray(canvas.buffer_rgba())[:, :, :3].copy()
            boxes = [ax.get_window_extent() for ax in axes]
            self._rows = [(self.size[1] - round(b.y1), self.size[1] - round(b.y0)) for b in boxes]
            ends = axes[0].transData.transform([(f, 0) for f in pictures.centres])[:, 0]
        self._columns = np.clip(ends.round().astype(int), 0, self.size[0] - 2)
        self._font = ImageFont.truetype(findfont(FontProperties(family="DejaVu Sans")), 12)

    def __iter__(self) -> Iterator[np.ndarray]:
        """Yield the canvas at each picture, uint8 (height, width, 3)."""
        stream, window = self._pictures.stream, self._pictures.window
        for number, grey in enumerate(self._pictures):
            first = int(self._pictures.starts[number])
            yield self._draw(grey, number, words=describe_moment(stream, first=first, window=window))

    def _draw(self, grey: np.ndarray, number: int, *, words: str) -> np.ndarray:
        out = self._background.copy()
        larger = self._shown[0] > grey.shape[1]
        how = Image.Resampling.NEAREST if larger else Image.Resampling.BOX
        picture = Image.fromarray(grey).resize(self._shown, how)
        out[: self._shown[1], : self._shown[0]] = np.asarray(picture)[:, :, None]
        for top, bottom in self._rows:
            out[top:bottom, self._columns[number] : self._columns[number] + 2] = CURSOR
        canvas = Image.fromarray(out)
        draw = ImageDraw.Draw(canvas)
        if self._region is not None:
            rows, columns = self._region
            scale = self._shown[0] / grey.shape[1]
            draw.rectangle(
                [columns.start * scale, rows.start * scale, columns.stop * scale - 1, rows.stop * scale - 1],
                outline=BOX,
            )
        draw.text((4, self._shown[1] + 5), self._fit(words), fill=TEXT, font=self._font)
        return np.asarray(canvas)

    def _fit(self, words: str) -> str:
        """Return as many parts of the text, from the first, as fit below the picture."""
        parts = words.split(SEPARATOR)
        while len(parts) > 1 and self._font.getlength(SEPARATOR.join(parts)) > self._shown[0] - 4:
            parts.pop()
        return SEPARATOR.join(parts)


def write_gif(canvas: MovieCanvas, path: Path, *, fps: float) -> None:
    """Write a canvas as a GIF that repeats for ever; all its pictures share one palette."""
    frames = iter(canvas)
    first = Image.fromarray(next(frames))
    palette = _choose_palette(np.asarray(first))

    def reduce(image: Image.Image) -> Image.Image:
        return image.quantize(palette=palette, dither=Image.Dither.NONE)

    reduce(first).save(
        path,
        format="GIF",
        save_all=True,
        append_images=(reduce(Image.fromarray(frame)) for frame in frames),
        duration=max(round(1000 / fps), 20),  # browsers slow down GIFs of more than 50 pictures per second
        loop=0,
        optimize=False,
    )


def _choose_palette(screen: np.ndarray) -> Image.Image:
    """Return greys for the picture, the colours of lines as they are, and mixtures that occur on the screen (h, w, 3).

    The picture would take most colours if all pixels were counted, and lines of different colours would look alike.
    """
    greys = np.repeat(np.linspace(0, 255, GREYS).round().astype(np.uint8)[:, None], 3, axis=1)
    lines = np.array([*(ImageColor.getrgb(colour) for colour in COLOURS), BOX, CURSOR, TEXT], np.uint8)
    tinted = screen[np.ptp(screen, axis=2) > TINT]
    mixtures = Image.fromarray(tinted[None]).quantize(256 - GREYS - len(lines)).getpalette()
    palette = Image.new("P", (1, 1))
    palette.putpalette([*greys.ravel().tolist(), *lines.ravel().tolist(), *(mixtures or ())])
    return palette
