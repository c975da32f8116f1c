"""Textures of eleven kinds, float32 with mean 0 and SD 1, row 0 at the top: two texels a pixel of the sensor.

Each is drawn with four texels a pixel and then loses all that is finer than ``cut`` cycles a pixel, so that
neither its texels nor the pixels of the sensor alias it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from letters import drawn, lines

FINE, TEXELS = 4, 2  # texels a pixel while it is drawn, and in the end
RIM_PX = 6  # cut off: what is cut from the spectrum rings where the rims of a picture meet
ALPHABET = tuple("ABCDEFGHIJKLMNOPRSTUVWXYZ0123456789")


class Sheet(NamedTuple):
    """Where a pattern is drawn: middles of fine texels along a side (pixels), its scale, random numbers."""

    at: np.ndarray
    feature: float
    slope: float
    random: np.random.Generator

    @property
    def side(self) -> float:
        """Length of a side, pixels."""
        return self.at.size / FINE

    @property
    def frequencies(self) -> tuple[np.ndarray, np.ndarray]:
        """Frequencies across (col,) and down (row, 1), cycles a pixel."""
        return np.fft.rfftfreq(self.at.size, 1 / FINE), np.fft.fftfreq(self.at.size, 1 / FINE)[:, None]

    def filtered_noise(self, transfer: np.ndarray) -> np.ndarray:
        """White noise through a transfer function, SD 1."""
        shape = (self.at.size, self.at.size)
        return _unit(np.fft.irfft2(np.fft.rfft2(self.random.standard_normal(shape)) * transfer, s=shape))

    def noise(self, scale: float, *, stretch: float = 1.0) -> np.ndarray:
        """Smooth noise of SD 1 whose blobs are so wide (pixels), and ``stretch`` times as high."""
        u, v = self.frequencies
        return self.filtered_noise(np.exp(-((scale * np.hypot(u, stretch * v)) ** 2)))

    def turned(self, angle: float, *, warp: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates (pixels) on axes turned by an angle (radians), which wander by ``warp`` pixels (SD)."""
        x, y = self.at[None, :] * np.cos(angle), self.at[:, None] * np.sin(angle)
        across, down = x + y, self.at[:, None] * np.cos(angle) - self.at[None, :] * np.sin(angle)
        if warp:
            across, down = across + warp * self.noise(30), down + warp * self.noise(30)
        return across, down


def texture(
    kind: str,
    side_px: float,
    *,
    feature_px: float,
    slope: float,
    cut: float,
    random: np.random.Generator,
    narrowed: tuple[float, float] = (0.0, 1.0),
) -> np.ndarray:
    """A square texture of at least so many pixels of the sensor.

    Parameters
    ----------
    kind : str
        One of KINDS.
    side_px, feature_px : float
        Side, and size of dots, threads, letters, cells, leaves: pixels of the sensor.
    slope : float
        Of ``noise``: amplitude falls as frequency to this power.
    cut : float
        Highest frequency that the lens sees, cycles a pixel; contrast falls to 0 from four fifths of it on.
    narrowed : tuple of float
        Direction (radians, from the right upwards) in which the lens sees it narrowed, and by which factor.
    """
    count = TEXELS * int(np.ceil(side_px + 2 * RIM_PX))
    sheet = Sheet((np.arange(count * FINE // TEXELS) + 0.5) / FINE, feature_px, slope, random)
    rim, picture = TEXELS * RIM_PX, _unit(KINDS[kind](sheet))
    if kind in TWO_TONED and random.random() < 0.5:
        picture = -picture
    if kind in SKEW:
        picture = np.exp(random.uniform(0, 1.5) * picture)
    return _unit(_band_limited(picture, cut, narrowed)[rim:-rim, rim:-rim]).astype(np.float32)


def _band_limited(picture: np.ndarray, cut: float, narrowed: tuple[float, float]) -> np.ndarray:
    u, v = np.fft.rfftfreq(picture.shape[1], 1 / FINE), -np.fft.fftfreq(picture.shape[0], 1 / FINE)[:, None]
    angle, factor = narrowed
    seen = np.hypot((u * np.cos(angle) + v * np.sin(angle)) / factor, v * np.cos(angle) - u * np.sin(angle))
    part = np.clip((seen / cut - 0.8) / 0.2, 0, 1)
    kept = np.fft.rfft2(picture) * (0.5 + 0.5 * np.cos(np.pi * part))
    return np.fft.irfft2(kept, s=picture.shape)[:: FINE // TEXELS, :: FINE // TEXELS]


def _unit(picture: np.ndarray) -> np.ndarray:
    return (picture - picture.mean()) / max(picture.std(), 1e-9)


def _soft(picture: np.ndarray, limit: float = 2.0) -> np.ndarray:
    """Without rare extremes, which would leave the rest no contrast."""
    return limit * np.tanh(_unit(picture) / limit)


def _noise(s: Sheet) -> np.ndarray:
    """Power 1/f^(2·slope)."""
    return _soft(s.filtered_noise(np.maximum(np.hypot(*s.frequencies), 1 / s.side) ** -s.slope))


def _dead_leaves(s: Sheet) -> np.ndarray:
    """Discs that hide one another, their radii by the law r^-3 (Lee, Mumford and Huang, IJCV 41, 2001)."""
    least, most = 0.25 * s.feature, 5 * s.feature
    picture = s.random.normal(size=(s.at.size, s.at.size))
    area = 2 * np.pi * least**2 * np.log(most / least) / (1 - (least / most) ** 2)
    for _ in range(int(3.5 * s.side**2 / area)):
        radius = least / np.sqrt(1 - s.random.random() * (1 - (least / most) ** 2))
        where, x, y = _near(s, s.random.uniform(0, s.side, 2), radius)
        picture[where][x**2 + y**2 < radius**2] = s.random.normal()
    return _soft(picture)


def _halftone(s: Sheet) -> np.ndarray:
    """Dots on a turned screen whose size gives the tone."""
    period = np.clip(s.feature, 3.0, 9.0)
    x, y = s.turned(s.random.uniform(0, np.pi / 2))
    spot = 0.5 + 0.25 * (np.cos(2 * np.pi * x / period) + np.cos(2 * np.pi * y / period))
    tone = 0.5 + 0.22 * np.clip(s.noise(0.2 * s.side) + 0.5 * s.noise(0.06 * s.side), -1.8, 1.8)
    return np.where(spot < tone, 0.0, 1.0)


def _weave(s: Sheet) -> np.ndarray:
    """Threads over and under one another: plain, twill or satin."""
    period, (step, over, repeat) = np.clip(s.feature, 3.0, 12.0), WEAVES[s.random.integers(len(WEAVES))]
    x, y = s.turned(s.random.uniform(-0.6, 0.6), warp=0.12 * period)
    x, y = x / period + 1e3, y / period + 1e3
    column, row = np.floor(x).astype(int), np.floor(y).astype(int)
    warp_tone, weft_tone = (
        s.random.normal(0.62, 0.07, 4096),
        s.random.normal(s.random.uniform(0.2, 0.6), 0.07, 4096),
    )
    over_warp = (column + step * row) % repeat < over
    aside = np.where(over_warp, x - column, y - row) - 0.5
    bright = np.where(over_warp, warp_tone[column % 4096], weft_tone[row % 4096])
    return bright * np.sqrt(np.clip(1 - 3.4 * aside**2, 0.02, 1))


WEAVES = ((1, 1, 2), (1, 2, 4), (2, 4, 5))


def _print(s: Sheet) -> np.ndarray:
    """Lines of words."""
    high = np.clip(1.8 * s.feature, 7.0, 24.0)
    ink = np.zeros((s.at.size, s.at.size), dtype=np.float32)
    x, y = s.at, s.at
    for middle in np.arange(high, s.side, s.random.uniform(1.5, 2.0) * high):
        left = -high
        while left < s.side:
            word = "".join(s.random.choice(ALPHABET, s.random.integers(2, 9)))
            wide = high * (5.6 * len(word)) / 6
            pieces = lines(word, high, (left + wide / 2, middle))
            # The font's letters stand upright where y rises; here rows fall.
            flipped = [(a * (1, -1) + (0, 2 * middle), b * (1, -1) + (0, 2 * middle)) for a, b in pieces]
            np.maximum(ink, drawn(x, y, flipped, 0.14 * high), out=ink)
            left += wide + high * s.random.uniform(0.5, 0.8)
    return -ink + 0.05 * s.noise(1.0)


def _bark(s: Sheet) -> np.ndarray:
    """Ridges that run along the trunk, with cracks between them."""
    wander = s.noise(4 * s.feature, stretch=3.0)
    ridges = np.abs(s.noise(1.2 * s.feature, stretch=4.0) + 0.4 * wander)
    cracks = np.minimum(np.abs(s.noise(0.8 * s.feature, stretch=2.5)), 0.5)
    return _soft(np.sqrt(ridges) + 1.2 * cracks + 0.25 * s.noise(1.0))


def _tissue(s: Sheet) -> np.ndarray:
    """Cells with dark walls and nuclei."""
    cell = 2.2 * s.feature
    x, y = s.turned(s.random.uniform(0, 3), warp=0.15 * cell)
    column, row = np.floor(x / cell).astype(int), np.floor(y / cell).astype(int)
    jitter, size = s.random.uniform(0.1, 0.9, (2, 64, 64)), s.random.uniform(0.14, 0.24, (64, 64))
    first, second, own = np.full(x.shape, 9.0), np.full(x.shape, 9.0), np.zeros(x.shape)
    tones = s.random.normal(0, 0.12, (64, 64))
    for down in (-1, 0, 1):
        for right in (-1, 0, 1):
            i, j = (row + down) % 64, (column + right) % 64
            away = np.hypot(
                x / cell - column - right - jitter[0, i, j], y / cell - row - down - jitter[1, i, j]
            )
            value = tones[i, j] - 0.8 * np.clip((size[i, j] - away) / 0.06, 0, 1)
            nearer = away < first
            second = np.where(nearer, first, np.minimum(second, away))
            own = np.where(nearer, value, own)
            first = np.where(nearer, away, first)
    return own - 0.6 * np.clip(1 - (second - first) / 0.13, 0, 1) + 0.08 * s.noise(1.5)


def _circuit(s: Sheet) -> np.ndarray:
    """Tracks, pads and parts on a board."""
    step = 1.3 * s.feature
    cells = int(s.side / step) + 2
    tracks = []
    for _ in range(int(0.16 * cells**2)):
        at = s.random.integers(0, cells, 2)
        for _ in range(s.random.integers(2, 6)):
            way = np.array(WAYS[s.random.integers(len(WAYS))]) * s.random.integers(1, 5)
            tracks.append((at * step, (at + way) * step))
            at = at + way
    picture = 0.5 * drawn(s.at, s.at, tracks, 0.35 * step)
    for centre in s.random.integers(0, cells, (int(0.10 * cells**2), 2)) * step:
        where, x, y = _near(s, centre, 0.5 * step)
        away = np.hypot(x, y)
        picture[where] = np.where(away < 0.45 * step, np.where(away < 0.18 * step, 0.0, 1.0), picture[where])
    for _ in range(int(0.02 * cells**2) + 2):
        half = s.random.uniform(0.8, 2.4, 2) * step
        where, x, y = _near(s, s.random.uniform(0, s.side, 2), float(half.max()))
        inside = (np.abs(x) < half[0]) & (np.abs(y) < half[1])
        leg = (np.mod(y / step, 0.6) < 0.3) & (np.abs(np.abs(x) - half[0]) < 0.25 * step)
        picture[where] = np.where(leg & (np.abs(y) < half[1]), 1.0, np.where(inside, -0.3, picture[where]))
    return picture + 0.06 * s.noise(2.0)


WAYS = ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, 1), (1, -1), (-1, -1))


def _foliage(s: Sheet) -> np.ndarray:
    """Leaves with midribs and veins, one over the other, darker below."""
    long = 3.0 * s.feature
    picture = np.full((s.at.size, s.at.size), -1.5)
    count = int(6 * s.side**2 / long**2)
    for n in range(count):
        half, angle = long * s.random.uniform(0.5, 1.2), s.random.uniform(0, 2 * np.pi)
        where, x, y = _near(s, s.random.uniform(0, s.side, 2), half)
        u, v = (x * np.cos(angle) + y * np.sin(angle)) / half, (y * np.cos(angle) - x * np.sin(angle)) / half
        rim = 0.42 * np.clip(1 - u**2, 0, 1) ** 0.8
        tone = -0.9 + 1.6 * n / count + s.random.normal(0, 0.35) + 0.5 * v
        veins = np.where(np.mod(5 * u - 4 * np.abs(v), 1) < 0.14, 0.35, 0.0) + np.where(
            np.abs(v) < 0.035, 0.7, 0.0
        )
        picture[where] = np.where(np.abs(v) < rim, tone + veins, picture[where])
    return _soft(picture)


def _specks(s: Sheet) -> np.ndarray:
    """Few bright specks on a dark ground: snow, stars, lamps far away."""
    picture = 0.012 * s.noise(6.0)
    for _ in range(int(s.side**2 * s.random.uniform(0.12, 0.7) / s.feature**2)):
        radius = s.feature * s.random.uniform(0.1, 0.35)
        where, x, y = _near(s, s.random.uniform(0, s.side, 2), 1.5 * radius + 1)
        picture[where] = np.maximum(
            picture[where], s.random.uniform(0.4, 1) * np.clip(radius + 0.5 - np.hypot(x, y), 0, 1)
        )
    return picture


def _paper(s: Sheet) -> np.ndarray:
    """Tooth and clouds, as of paper, plaster or clay."""
    return _soft(s.noise(1.2) + 0.8 * s.noise(s.feature) + 0.5 * s.noise(8 * s.feature))


def _near(s: Sheet, centre: np.ndarray, reach: float) -> tuple[tuple[slice, slice], np.ndarray, np.ndarray]:
    """The part of a sheet within so many pixels of a place, and its coordinates from there."""
    columns, rows = (slice(*np.searchsorted(s.at, (c - reach, c + reach))) for c in centre)
    return (rows, columns), s.at[columns][None, :] - centre[0], s.at[rows][:, None] - centre[1]


TWO_TONED = ("halftone", "print", "tissue", "circuit")  # dark on bright or bright on dark
SKEW = ("noise", "dead_leaves", "bark", "foliage", "paper")  # few bright places on a dark ground, in part
KINDS: dict[str, Callable[[Sheet], np.ndarray]] = {
    "noise": _noise,
    "dead_leaves": _dead_leaves,
    "halftone": _halftone,
    "weave": _weave,
    "print": _print,
    "bark": _bark,
    "tissue": _tissue,
    "circuit": _circuit,
    "foliage": _foliage,
    "specks": _specks,
    "paper": _paper,
}
