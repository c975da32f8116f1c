"""The make-up of a newspaper page: masthead, headlines, a screened photograph, columns; as ink in 0..1."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from photograph import photograph
from press import TEXEL_MM, enlarged, screened
from stories import CAPTIONS, CREDIT, DATES, STORIES, TITLES
from typeface import Contours, Line, Typeface, ink

COLUMN_MM, GUTTER_MM = 38.0, 3.2
PHOTO_MM = 26.5  # height of a picture of one column
HERE = Path(__file__).parent


class Faces(NamedTuple):
    """The typefaces of the paper."""

    text: Typeface
    bold: Typeface
    head: Typeface


class Block(NamedTuple):
    """What stands in a column, from its top: contours, and how high it is with the room below, mm."""

    contours: Contours
    height: float


class Page:
    """Ink on a page of a width and height in mm; what is beyond is cut."""

    def __init__(self, size_mm: tuple[float, float], params: dict[str, Any], random: np.random.Generator) -> None:
        self.size, self.params, self.random = size_mm, params, random
        self.faces = Faces(*(Typeface(HERE / f"{name}.npz") for name in ("old", "old_bold", "condensed")))
        self.type = float(params["type_mm"])
        self.leading = 1.13 * self.type
        self.contours: Contours = []
        self.stories = list(random.permutation(len(STORIES)))
        self.waiting: list[Line] = []  # what is left of a story for the next column

    def columns(self, first: float, top: float, *, taken: tuple[int, float] | None = None) -> None:
        """Fill columns to the foot of the page; one has its left edge at ``first``, all begin at ``top``.

        taken : a column and the height from which on it is filled instead, below a picture.
        """
        step = COLUMN_MM + GUTTER_MM
        start = -int(np.ceil(first / step))
        for k in range(start, int((self.size[0] - first) / step) + 1):
            x = first + k * step
            self._fill(x, taken[1] if taken is not None and k == taken[0] else top)
            self.contours.append(_bar(x - GUTTER_MM / 2 - 0.06, top, 0.12, self.size[1] - top))

    def _fill(self, x: float, top: float) -> None:
        y = top + self.leading
        while y < self.size[1] + self.leading:
            if not self.waiting:
                number = int(self.stories.pop(0)) if self.stories else int(self.random.integers(len(STORIES)))
                block = self.head(number, (x, y - self.leading), COLUMN_MM)
                self.contours += block.contours
                y += block.height
                for paragraph in STORIES[number][2]:
                    self.waiting += self.faces.text.paragraph(
                        paragraph, size=self.type, measure=COLUMN_MM, indent=1.3 * self.type
                    )
            room = max(int((self.size[1] - y) / self.leading) + 2, 0)
            here, self.waiting = self.waiting[:room], self.waiting[room:]
            self.contours += self.faces.text.column(
                here, (x, y), size=self.type, measure=COLUMN_MM, leading=self.leading
            )
            y += len(here) * self.leading
            if here and not self.waiting:
                self.contours.append(_bar(x + 0.3 * COLUMN_MM, y - 0.2 * self.leading, 0.4 * COLUMN_MM, 0.14))
                y += 1.4 * self.leading

    def head(self, number: int, at: tuple[float, float], measure: float) -> Block:
        """The headline of a story and its second line over a measure, centred, with a short rule below."""
        title, second, _ = STORIES[number]
        face = self.faces.head
        size = min(2.05 * self.type * (measure / COLUMN_MM) ** 0.8, 8.5)
        y = at[1] + 1.02 * size
        made: Contours = []
        lines = face.paragraph(title, size=size, measure=measure)
        made += face.column(lines, (at[0], y), size=size, measure=measure, leading=1.16 * size, align="centre")
        y += (len(lines) - 1) * 1.16 * size + 1.75 * self.type
        lines = self.faces.bold.paragraph(second, size=1.12 * self.type, measure=0.94 * measure)
        made += self.faces.bold.column(
            lines, (at[0] + 0.03 * measure, y), size=1.12 * self.type, measure=0.94 * measure,
            leading=1.25 * self.type, align="centre",
        )  # fmt: skip
        y += (len(lines) - 1) * 1.25 * self.type + 0.9 * self.type
        made.append(_bar(at[0] + 0.36 * measure, y, 0.28 * measure, 0.16))
        return Block(made, y - at[1] + 0.9 * self.type)

    def masthead(self, at: tuple[float, float], measure: float) -> float:
        """The title of the paper between rules, with the date; returns the height below it."""
        title, date = str(self.random.choice(TITLES)), str(self.random.choice(DATES))
        size = 0.92 * measure / self.faces.bold.width(title, size=1.0)
        y = at[1] + 0.86 * size
        self.contours += self.faces.bold.line(title, (at[0] + measure / 2, y), size=size, align="centre")
        y += 0.34 * size
        small = 1.02 * self.type
        self.contours += [_bar(at[0], y, measure, 0.5), _bar(at[0], y + 0.8, measure, 0.14)]
        base = y + 1.6 + small
        number = f"No. {int(self.random.integers(4000, 19000)):,}"
        self.contours += self.faces.text.line(number, (at[0], base), size=small)
        self.contours += self.faces.bold.line(date, (at[0] + measure / 2, base), size=small, align="centre")
        self.contours += self.faces.text.line("PRICE ONE PENNY", (at[0] + measure, base), size=small, align="right")
        self.contours.append(_bar(at[0], base + 0.55 * small, measure, 0.14))
        return base + 1.2 * small

    def caption(self, at: tuple[float, float], measure: float) -> float:
        """The line under a picture; returns the height below it."""
        text, size = f"{CAPTIONS[str(self.params['motif'])]}", 0.93 * self.type
        lines = self.faces.bold.paragraph(text, size=size, measure=measure)
        y = at[1] + 1.25 * size
        self.contours += self.faces.bold.column(
            lines, (at[0], y), size=size, measure=measure, leading=1.16 * size, align="left"
        )
        self.contours += self.faces.text.line(
            CREDIT, (at[0] + measure, y + len(lines) * 1.16 * size), size=0.8 * size, align="right"
        )
        bottom = y + (len(lines) + 0.6) * 1.16 * size
        self.contours.append(_bar(at[0], bottom, measure, 0.14))
        return bottom + 0.3 * self.leading

    def cover(self) -> np.ndarray:
        """All type and rules as ink."""
        shape = round(self.size[1] / TEXEL_MM), round(self.size[0] / TEXEL_MM)
        return ink(self.contours, shape, scale=1 / TEXEL_MM)


def page_ink(
    size_mm: tuple[float, float], params: dict[str, Any], random: np.random.Generator, *, detail: int
) -> np.ndarray:
    """Ink of a page, float32 (row, col) in 0..1; the layout's subject is in its middle.

    detail : columns of the photograph before it is screened.
    """
    page = Page(size_mm, params, random)
    middle = np.array(size_mm) / 2 + random.uniform(-2.5, 2.5, 2)
    step = COLUMN_MM + GUTTER_MM
    layout = str(params["layout"])
    side = int(random.integers(2))  # the subject is in the left or the right of two columns
    left = middle[0] - (COLUMN_MM / 2 + step * side)
    if layout == "story":
        number = page.stories.pop(0)
        block = page.head(int(number), (left, middle[1] - 15), 2 * COLUMN_MM + GUTTER_MM)
        for paragraph in STORIES[number][2]:
            page.waiting += page.faces.text.paragraph(
                paragraph, size=page.type, measure=COLUMN_MM, indent=1.3 * page.type
            )
        page.contours += block.contours
        page.columns(left, middle[1] - 15 + block.height)
        return page.cover()
    top = middle[1] - 0.55 * PHOTO_MM
    if layout == "front":
        top = page.masthead((left, middle[1] - 17), 2 * COLUMN_MM + GUTTER_MM) + 1.5
    elif layout == "picture":
        number = page.stories.pop(0)
        room = page.head(int(number), (0, 0), COLUMN_MM).height
        page.contours += page.head(int(number), (left + step * side, top - room), COLUMN_MM).contours
    bottom = page.caption((left + step * side, top + PHOTO_MM), COLUMN_MM)
    page.columns(left, top if layout == "front" else top - 60, taken=(side, bottom))
    cover = page.cover()
    _print_photograph(cover, (left + step * side, top), params, random, detail=detail)
    return cover


def _print_photograph(
    cover: np.ndarray, at: tuple[float, float], params: dict[str, Any], random: np.random.Generator, *, detail: int
) -> None:
    """A screened photograph with its upper left corner at a place (mm), and a thin edge; in place."""
    shape = round(PHOTO_MM / TEXEL_MM), round(COLUMN_MM / TEXEL_MM)
    grey = photograph(str(params["motif"]), (round(detail * PHOTO_MM / COLUMN_MM), detail), random)
    screen = screened(
        enlarged(grey, shape), dots_per_mm=float(params["dots_per_mm"]), angle_deg=float(params["screen_deg"])
    )
    screen[:3] = screen[-3:] = screen[:, :3] = screen[:, -3:] = 0.9
    row, column = round(at[1] / TEXEL_MM), round(at[0] / TEXEL_MM)
    here = cover[max(row, 0) : row + shape[0], max(column, 0) : column + shape[1]]
    here[:] = screen[max(-row, 0) :, max(-column, 0) :][: here.shape[0], : here.shape[1]]


def _bar(x: float, y: float, wide: float, high: float) -> np.ndarray:
    return np.array([[x, y], [x, y + high], [x + wide, y + high], [x + wide, y]])
