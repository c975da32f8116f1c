"""Prints of book spines: reflectances as float32 arrays in 0..1, row 0 at the head of the book."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import titles
from broad_pen import stamp, word
from patterns import cloudy, noise

ROMAN = ("I", "II", "III", "IV", "V", "VI", "VII", "VIII", "IX", "X", "XI", "XII")


@dataclass(frozen=True)
class Look:
    """What the spines of one edition share. kind : cloth, paper, journal. tones : ground, ink, label."""

    kind: str
    ground: float
    ink: float
    label: float
    style: int
    text: str
    bold: float

    @property
    def ink_on_label(self) -> float:
        """Ink, or ground where that stands out better."""
        return max(self.ink, self.ground, key=lambda tone: abs(tone - self.label))


def new_look(kind: str, contrast: float, random: np.random.Generator) -> Look:
    """A fresh design; contrast scales how far ink and label lie from the ground."""
    dark = random.random() < {"cloth": 0.75, "paper": 0.45, "journal": 0.3}[kind]
    ground = random.uniform(0.06, 0.2) if dark else random.uniform(0.45, 0.78)
    ink = ground + contrast * ((random.uniform(0.6, 0.75) if dark else 0.06) - ground)
    label = ground + contrast * (random.choice([0.06, 0.5, 0.75]) - ground)
    words = titles.JOURNALS if kind == "journal" else titles.SERIES
    return Look(
        kind, ground, ink, label, int(random.integers(3)), str(random.choice(words)), random.uniform(0.11, 0.19)
    )


def spine(
    size: tuple[int, int], texel_mm: float, look: Look, volume: int | None, random: np.random.Generator
) -> np.ndarray:
    """The print of one spine, (rows, columns). volume : its number in an edition; None: a book of its own."""
    grey = np.full(size, look.ground, dtype=np.float32)
    draw = {"cloth": _cloth, "paper": _paper, "journal": _journal}[look.kind]
    draw(_Print(grey, texel_mm, look), volume, random)
    return np.clip(_worn(grey, texel_mm, look.kind, random), 0.03, 0.9).astype(np.float32)


class _Print:
    """A spine being printed: everything in shares of its height, or in millimetres."""

    def __init__(self, grey: np.ndarray, texel_mm: float, look: Look) -> None:
        self.grey, self.texel_mm, self.look = grey, texel_mm, look
        self.rows, self.columns = grey.shape
        self.wide_mm = self.columns * texel_mm

    def band(self, at: float, thick_mm: float, tone: float) -> None:
        top = round(at * self.rows)
        self.grey[top : top + max(round(thick_mm / self.texel_mm), 1)] = tone

    def block(self, begin: float, end: float, tone: float) -> None:
        self.grey[round(begin * self.rows) : round(end * self.rows)] = tone

    def across(self, text: str, at: float, high_mm: float, tone: float, **face: Any) -> None:
        """A line from board to board, made smaller where it is too long."""
        self._line(text, at, high_mm, 0.82 * self.columns, tone, False, face)

    def along(self, text: str, begin: float, end: float, high_mm: float, tone: float, **face: Any) -> None:
        """A line that reads from head to foot."""
        self._line(text, (begin + end) / 2, high_mm, (end - begin) * self.rows, tone, True, face)

    def _line(self, text: str, at: float, high_mm: float, room: float, tone: float, turn: bool, face: Any) -> None:
        high = high_mm / self.texel_mm
        ink = word(text, high, **face)
        if ink.shape[1] > room:
            ink = word(text, high * room / ink.shape[1], **face)
        stamp(self.grey, np.rot90(ink, -1) if turn else ink, at * self.rows, self.columns / 2, tone)


def _cloth(page: _Print, volume: int | None, random: np.random.Generator) -> None:
    """Bookbinder's cloth or leather: rules, ribs, a label, gilt letters."""
    look = page.look
    for at in (0.035, 0.055, 0.93, 0.95):
        page.band(at, 0.9, look.ink)
    if look.style == 0:  # ribs across, room for the title between them
        for at in (0.13, 0.78) if volume is None else (0.16, 0.34, 0.60, 0.78):
            page.band(at - 0.006, 0.8, 0.5 * look.ground)
            page.band(at, 1.6, 0.5 * (look.ground + look.ink))
    if look.style == 1:
        page.block(0.15, 0.76, look.label)
        for at in (0.16, 0.745):
            page.band(at, 0.7, look.ink_on_label)
    tone = look.ink_on_label if look.style == 1 else look.ink
    face = {"pen": look.bold, "contrast": 1.9}
    if volume is not None:
        first, _, second = look.text.partition(" ")
        page.across(first, 0.23, 5.5, tone, **face)
        page.across(second or "VOL", 0.28, 5.5, tone, **face)
        page.across(ROMAN[volume % 12], 0.50, 9.0, tone, **face)
        page.across("&", 0.86, 6.0, look.ink, **face)
    else:
        page.along(titles.title(random), 0.18, 0.72, min(0.38 * page.wide_mm, 11), tone, **face)
        page.across(titles.author(random).split()[-1], 0.85, 5.0, look.ink, pen=look.bold)


def _paper(page: _Print, volume: int | None, random: np.random.Generator) -> None:
    """Paperback: a broad band or two, author and title along the spine, a publisher's mark at the foot."""
    look = page.look
    if look.style == 0:
        page.block(0.0, 0.24, look.label)
        page.block(0.80, 1.0, look.label)
    if look.style == 1:
        page.block(0.825, 0.845, look.ink)
    high = min(0.42 * page.wide_mm, 9)
    head = look.ink_on_label if look.style == 0 else look.ink
    page.along(titles.author(random), 0.03, 0.225, 0.8 * high, head, pen=0.12)
    name = titles.title(random) if volume is None else f"{look.text} {volume + 1}"
    page.along(name, 0.26, 0.79, high, look.ink, pen=look.bold)
    row, column = np.ogrid[: page.rows, : page.columns]
    mark = np.hypot(row - 0.92 * page.rows, column - page.columns / 2) * page.texel_mm
    radius = 0.28 * page.wide_mm
    foot = look.ink_on_label if look.style == 0 else look.ink
    page.grey[mark < radius] = foot
    page.grey[(mark < 0.6 * radius) & (row * page.texel_mm % 1.6 < 0.8)] = look.ground


def _journal(page: _Print, volume: int | None, random: np.random.Generator) -> None:
    """One of a run of thin numbers: a dark head with its number, a frame line down both edges."""
    look = page.look
    page.block(0.0, 0.10, look.ink)
    page.block(0.94, 1.0, look.ink)
    edge = max(round(0.9 / page.texel_mm), 1)
    page.grey[:, :edge] = page.grey[:, -edge:] = 0.4 * look.ground + 0.6 * look.ink
    number = 1 + (volume or 0)
    page.across(str(number), 0.055, 5.0, look.ground, pen=0.16)
    high = 0.48 * page.wide_mm
    page.along(look.text, 0.14, 0.56, high, look.ink, pen=look.bold)
    page.along(
        f"NO {number} {random.choice(['SPRING', 'SUMMER', 'AUTUMN', 'WINTER'])}", 0.60, 0.90, high, look.ink, pen=0.12
    )


def _worn(grey: np.ndarray, texel_mm: float, kind: str, random: np.random.Generator) -> np.ndarray:
    """Weave or paper grain, rubbed head and foot, stains, and the creases of a book that was read."""
    rows, columns = grey.shape
    fine = 0.9 / texel_mm if kind == "cloth" else 0.6 / texel_mm
    grain = noise(grey.shape, (rows / fine, columns / fine), random)
    grey = grey * (1 + (0.16 if kind == "cloth" else 0.05) * grain)
    grey *= 1 + 0.10 * cloudy(grey.shape, 2.0, 4, random)
    ends = np.minimum(np.arange(rows), np.arange(rows)[::-1]) * texel_mm
    rubbed = np.exp(-ends / 2.5).astype(np.float32)[:, None] * (0.5 + 0.5 * grain)
    grey += 0.35 * rubbed * (0.55 - grey)
    if kind == "paper":
        for _ in range(int(random.integers(0, 4))):
            column = int(random.integers(columns))
            begin = int(random.integers(rows // 2))
            grey[begin : begin + rows // 2, column : column + 2] += 0.18
    return grey
