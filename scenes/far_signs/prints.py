"""Pictures of signs, posters and a clock as reflectances, float32 in 0..1, row 0 on top; lengths in metres.

A sign of any layout is a list of panels; each has its own plate in the scene.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from surfaces import cloudy, noise
from typeface import Contours, Typeface, ink

TEXEL_M = 0.0008  # a pixel sees 3.8 mm of the sign
SIGN_M = (0.96, 0.70)
HERE = Path(__file__).parent
PLACES = (
    "St. Verity", "Aldermere", "Bronstad", "Castelnuovo", "Dunhaven", "Eisenacht", "Florville", "Granby",
    "Holmsted", "Karlsund", "Lindow", "Montclair", "Nordham", "Overton", "Penryn", "Quarnholm", "Rosenborg",
    "Isley",
)  # fmt: skip
VIA = ("via Lindow", "calls at all stations", "via Granby and Isley", "not on Sundays", "front coaches only")
STREETS = ("Harbour Street", "Mill Lane", "Station Square", "Kings Road", "Orchard Way", "Bakers Row", "Castle Hill")
WAYS = (
    ("1–6", "Platforms", "trains to the north"), ("i", "Tickets", "and information"),
    ("P", "Car park", "240 places"), ("B", "Buses 12, 48", "stop C, Station Square"),
    ("L", "Left luggage", "06:00–22:30"), ("T", "Taxis", "at the east door"),
    ("R", "River walk", "12 min on foot"), ("W", "Waiting room", "and café"),
)  # fmt: skip
ADS = (
    ("Sea Air", "Penryn in 80 minutes"), ("Matinee", "Saturdays at half past three"),
    ("Fresh Bread", "Baked at five, gone by noon"), ("Round Tours", "One ticket, nine towns"),
    ("Jazz at Nine", "The cellar, Mill Lane 4"), ("Night Mail", "Posted today, read tomorrow"),
)  # fmt: skip


class Panel(NamedTuple):
    """A plate: its middle relative to that of the sign and its size (m), its picture, its bolts (x, y)."""

    middle: tuple[float, float]
    size: tuple[float, float]
    picture: np.ndarray
    bolts: list[tuple[float, float]]


class Board:
    """A picture to be printed on; places are metres from its upper left corner."""

    def __init__(self, size: tuple[float, float], ground: float, *, texel: float = TEXEL_M) -> None:
        self.size, self.texel = size, texel
        self.picture = np.full((round(size[1] / texel), round(size[0] / texel)), ground, dtype=np.float32)

    def fill(self, contours: Contours, grey: float) -> None:
        """Print contours in a grey."""
        self.picture += ink(contours, self.picture.shape, scale=1 / self.texel) * (np.float32(grey) - self.picture)

    def write(
        self,
        face: Typeface,
        text: str,
        at: tuple[float, float],
        *,
        cap: float,
        grey: float,
        align: str = "left",
        room: float = np.inf,
    ) -> None:
        """Text with capitals of a height, its baseline at a place; smaller if wider than ``room``."""
        size = cap / face.cap_height
        size *= min(room / face.width(text, size=size), 1.0)
        self.fill(face.line(text, at, size=size, align=align), grey)


def faces() -> dict[str, Typeface]:
    """The typefaces of the folder by name."""
    return {name: Typeface(HERE / f"{name}.npz") for name in ("sign", "sign_bold", "condensed")}


def block(low: tuple[float, float], high: tuple[float, float], radius: float = 0.0) -> np.ndarray:
    """A rectangle with rounded corners as a contour."""
    if not radius:
        return np.array([low, (low[0], high[1]), high, (high[0], low[1])])
    a = np.linspace(0, np.pi / 2, 9)
    corners = ((high[0], high[1], 0), (low[0], high[1], 1), (low[0], low[1], 2), (high[0], low[1], 3))
    parts = []
    for x, y, quarter in corners:
        turn = a + quarter * np.pi / 2
        x, y = x - radius * (1 if quarter in (0, 3) else -1), y - radius * (1 if quarter in (0, 1) else -1)
        parts.append(np.stack([x + radius * np.cos(turn), y + radius * np.sin(turn)], axis=1))
    return np.concatenate(parts)


def frame(low: tuple[float, float], high: tuple[float, float], wide: float, radius: float) -> Contours:
    """A line inside a rounded rectangle."""
    inner = block((low[0] + wide, low[1] + wide), (high[0] - wide, high[1] - wide), max(radius - wide, 0.001))
    return [block(low, high, radius), inner[::-1]]


def arrow(at: tuple[float, float], size: float, turn_deg: float) -> Contours:
    """An arrow about a place that points to the right, turned counter-clockwise."""
    half = np.array([(-1, 0.14), (0.35, 0.14), (-0.08, 0.62), (0.22, 0.86), (1.0, 0)])
    outline = np.concatenate([half, half[-2::-1] * (1, -1)]) * size / 2
    a = np.radians(turn_deg)
    return [outline @ np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]]) + np.array(at)]


def sign(layout: str, inks: tuple[float, float], random: np.random.Generator) -> list[Panel]:
    """The panels of a sign: ``inks`` are the reflectances of ground and print."""
    made = {"timetable": _timetable, "directions": _directions, "streets": _streets}[layout](inks, faces(), random)
    return [panel._replace(picture=_weathered(panel, random)) for panel in made]


def _timetable(inks: tuple[float, float], face: dict[str, Typeface], random: np.random.Generator) -> list[Panel]:
    """Departures: a band with the title, a table, a foot line."""
    ground, grey = inks
    board, bold, plain = Board(SIGN_M, ground), face["sign_bold"], face["sign"]
    board.fill([block((0, 0), (SIGN_M[0], 0.118))], grey)
    board.write(bold, "Departures", (0.048, 0.083), cap=0.050, grey=ground)
    board.fill(frame((0.80, 0.024), (0.918, 0.094), 0.005, 0.010), ground)
    board.write(bold, "1–6", (0.859, 0.075), cap=0.032, grey=ground, align="centre")
    for x, title in ((0.048, "Time"), (0.205, "To"), (0.700, "Platf."), (0.912, "Days")):
        board.write(plain, title, (x, 0.146), cap=0.0125, grey=grey, align="right" if x > 0.9 else "left")
    minute = 60 * int(random.integers(5, 19)) + int(random.integers(0, 40))
    for row, town in enumerate(random.choice(PLACES, 8, replace=False)):
        y = 0.196 + 0.0600 * row
        board.fill([block((0.040, y + 0.0165), (0.920, y + 0.0165 + 0.0014))], grey)
        board.write(bold, f"{minute // 60:02d}:{minute % 60:02d}", (0.048, y), cap=0.0265, grey=grey)
        board.write(bold, str(town), (0.205, y), cap=0.0265, grey=grey, room=0.30)
        if random.random() < 0.6:
            width = bold.width(str(town), size=0.0265 / bold.cap_height)
            note = str(random.choice(VIA))
            board.write(plain, note, (0.222 + width, y), cap=0.0115, grey=grey, room=0.46 - width)
        board.write(bold, str(int(random.integers(1, 7))), (0.735, y), cap=0.0265, grey=grey, align="centre")
        days = str(random.choice(["daily", "Mo–Fr", "Mo–Sa", "Su"]))
        board.write(plain, days, (0.912, y), cap=0.0175, grey=grey, align="right")
        minute += int(random.integers(4, 27))
    note = "Valid from 27 May. Times in grey boxes on public holidays only. Keep behind the line."
    board.write(plain, note, (0.048, 0.674), cap=0.0100, grey=grey, room=0.86)
    return [Panel((0, 0), SIGN_M, board.picture, _corners(SIGN_M, 0.022))]


def _directions(inks: tuple[float, float], face: dict[str, Typeface], random: np.random.Generator) -> list[Panel]:
    """A guide to the ways: arrow, badge, name and a small line, four times."""
    ground, grey = inks
    board, bold, plain = Board(SIGN_M, ground), face["sign_bold"], face["sign"]
    board.fill(frame((0.010, 0.010), (SIGN_M[0] - 0.010, SIGN_M[1] - 0.010), 0.007, 0.03), grey)
    for row, k in enumerate(random.choice(len(WAYS), 4, replace=False)):
        badge, name, small = WAYS[k]
        y = 0.100 + 0.167 * row
        right = bool(random.integers(2))
        turn = float(random.choice([0.0, 45.0, 90.0])) if right else float(random.choice([180.0, 135.0]))
        board.fill(arrow((0.870 if right else 0.090, y), 0.088, turn), grey)
        left = 0.055 if right else 0.165
        board.fill([block((left, y - 0.047), (left + 0.094, y + 0.047), 0.012)], grey)
        board.write(bold, badge, (left + 0.047, y + 0.022), cap=0.045, grey=ground, align="centre", room=0.080)
        board.write(bold, name, (left + 0.120, y + 0.010), cap=0.045, grey=grey, room=0.55)
        board.write(plain, small, (left + 0.121, y + 0.044), cap=0.0175, grey=grey)
        if row < 3:
            board.fill([block((0.04, y + 0.0815), (0.92, y + 0.0840))], grey)
    _honeycomb(board.picture)
    return [Panel((0, 0), SIGN_M, board.picture, _corners(SIGN_M, 0.030))]


def _streets(inks: tuple[float, float], face: dict[str, Typeface], random: np.random.Generator) -> list[Panel]:
    """Three enamelled plates below each other, the middle one in reversed tones."""
    panels = []
    for row, street in enumerate(random.choice(STREETS, 3, replace=False)):
        ground, grey = inks if row != 1 else inks[::-1]
        size = (0.94, 0.200)
        board = Board(size, ground)
        board.fill(frame((0.010, 0.010), (size[0] - 0.010, size[1] - 0.010), 0.005, 0.020), grey)
        board.write(face["sign_bold"], str(street), (0.47, 0.112), cap=0.068, grey=grey, align="centre", room=0.84)
        first, last, district = (int(random.integers(*span)) for span in ((1, 80), (81, 240), (2, 19)))
        numbers = f"{first} – {last}   ·   {district}th District"
        board.write(face["sign"], numbers, (0.47, 0.162), cap=0.021, grey=grey, align="centre")
        bolts = [(x, 0.0) for x in (-0.445, 0.445)]
        panels.append(Panel((random.uniform(-0.008, 0.008), 0.236 - 0.236 * row), size, board.picture, bolts))
    return panels


def _corners(size: tuple[float, float], inset: float) -> list[tuple[float, float]]:
    x, y = size[0] / 2 - inset, size[1] / 2 - inset
    return [(a * x, b * y) for a in (-1, 1) for b in (-1, 1)]


def _honeycomb(picture: np.ndarray) -> None:
    """Sealed cells of a retroreflecting sheet, 4.5 mm apart, as faint lines; in place."""
    y, x = np.ogrid[: picture.shape[0], : picture.shape[1]]
    k = 2 * np.pi * TEXEL_M / 0.0045
    waves = sum(np.cos(k * (np.cos(a) * x + np.sin(a) * y)) for a in np.radians([0, 60, 120]))
    picture *= 1 - 0.06 * np.clip((waves - 0.6) / 2.4, 0, 1).astype(np.float32)


def _weathered(panel: Panel, random: np.random.Generator) -> np.ndarray:
    """Rain streaks, grime below the edge and in corners, rust from bolts, chips of enamel, scratches."""
    picture = panel.picture
    shape = picture.shape
    y = (np.arange(shape[0])[:, None] + 0.5) * TEXEL_M
    x = (np.arange(shape[1])[None, :] + 0.5) * TEXEL_M
    runs = noise(shape, (2.2, shape[1] / 7), random) + 0.7 * noise(shape, (4, shape[1] / 22), random)
    veil = 0.05 * cloudy(shape, 7, 5, random) - 0.085 * np.clip(runs, 0, 1.2)
    edge = np.minimum(np.minimum(x, panel.size[0] - x), np.minimum(y, panel.size[1] - y))
    veil -= 0.22 * np.exp(-edge / 0.006) + 0.10 * np.exp(-y / 0.03) * (0.6 + 0.5 * runs)
    picture = picture * (1 + np.clip(veil, -0.5, 0.08)) + 0.012 * np.clip(cloudy(shape, 5, 4, random), 0, 1)
    lumps = noise(shape, (shape[0] / 7, shape[1] / 7), random) + 0.7 * noise(
        shape, (shape[0] / 3, shape[1] / 3), random
    )
    for bolt in panel.bolts:
        bx, by = bolt[0] + panel.size[0] / 2, panel.size[1] / 2 - bolt[1]
        off = np.hypot(x - bx, y - by)
        drip = (y > by) * np.exp(-((x - bx - 0.002 * runs) ** 2) / 0.0035**2 - (y - by) / random.uniform(0.03, 0.14))
        picture *= 1 - 0.42 * drip - 0.25 * np.exp(-((off / 0.011) ** 2))
        chip = off + 0.004 * lumps < random.uniform(0.008, 0.0125)
        picture = np.where(chip, 0.07 + 0.03 * lumps, picture)
    for _ in range(int(random.integers(2, 6))):  # chips at the rim, each in a halo of rust
        side, along, size = int(random.integers(4)), random.uniform(0.05, 0.95), random.uniform(0.004, 0.016)
        bx, by = ((along, 0), (along, 1), (0, along), (1, along))[side]
        off = np.hypot(x - bx * panel.size[0], y - by * panel.size[1]) + 0.005 * lumps
        picture *= 1 - 0.4 * np.exp(-((off / (1.7 * size)) ** 2))
        picture = np.where(off < size, 0.06 + 0.03 * lumps, picture)
    scratches = np.abs(noise(shape, (shape[0] / 160, shape[1] / 60), random)) < 0.006
    return np.clip(picture + 0.05 * scratches, 0.02, 0.82).astype(np.float32)


def clock(time_min: float) -> np.ndarray:
    """A station clock's face: bars, numerals, hands ``time_min`` minutes past twelve."""
    board, face = Board((1.0, 1.0), 0.76, texel=1 / 640), faces()["sign_bold"]
    middle = np.array([0.5, 0.5])

    def bar(turn: float, low: float, high: float, wide: tuple[float, float]) -> np.ndarray:
        a = 2 * np.pi * turn
        out, side = np.array([np.sin(a), -np.cos(a)]), np.array([np.cos(a), np.sin(a)])
        return middle + np.array(
            [
                low * out - wide[0] * side,
                low * out + wide[0] * side,
                high * out + wide[1] * side,
                high * out - wide[1] * side,
            ]
        )

    board.fill([bar(k / 60, 0.445, 0.475, (0.0035, 0.0035)) for k in range(60) if k % 5], 0.06)
    board.fill([bar(k / 12, 0.415, 0.475, (0.010, 0.010)) for k in range(12)], 0.05)
    for hour in range(1, 13):
        a = 2 * np.pi * hour / 12
        at = 0.5 + 0.345 * np.sin(a), 0.5 - 0.345 * np.cos(a) + 0.036
        board.write(face, str(hour), at, cap=0.072, grey=0.06, align="centre")
    a = np.linspace(0, 2 * np.pi, 48, endpoint=False)[:, None]
    hub = middle + 0.035 * np.concatenate([np.cos(a), np.sin(a)], axis=1)
    for angle, long, wide in ((time_min / 720, 0.275, 0.022), (time_min % 60 / 60, 0.425, 0.014)):
        hand = bar(angle, -0.09, long, (1.15 * wide, 0.7 * wide))
        board.fill([hand + np.array([0.006, 0.010])], 0.52)  # its shadow
        board.fill([hand], 0.035)
    board.fill([hub], 0.035)
    y, x = np.ogrid[:640, :640]
    off = np.hypot(x - 319.5, y - 319.5) / 320
    return (board.picture * (1 - 0.12 * np.clip(off - 0.6, 0, 1))).astype(np.float32)


def poster(random: np.random.Generator) -> np.ndarray:
    """A printed bill, 0.84 m × 1.19 m: a flat landscape or sun, a title, a line of text."""
    face = faces()
    board = Board((0.84, 1.19), float(random.uniform(0.45, 0.72)), texel=0.0025)
    title, line = ADS[int(random.integers(len(ADS)))]
    shape = board.picture.shape
    horizon = random.uniform(0.35, 0.6) + 0.12 * noise((shape[1], 2), (4, 1), random)[:, 0]
    y = np.arange(shape[0])[:, None] / shape[0]
    board.picture[:] = np.where(y > horizon, random.uniform(0.08, 0.2), board.picture)
    nearer = horizon + 0.13 + 0.10 * noise((shape[1], 2), (6, 1), random)[:, 0]
    board.picture[:] = np.where(y > nearer, random.uniform(0.2, 0.4), board.picture)
    a = np.linspace(0, 2 * np.pi, 64, endpoint=False)[:, None]
    sun = np.array([random.uniform(0.25, 0.6), 0.30]) + 0.11 * np.concatenate([np.cos(a), np.sin(a)], axis=1)
    board.fill([sun], 0.75)
    board.fill([block((0, 0.90), (0.84, 1.19))], 0.70)
    board.write(face["condensed"], title.upper(), (0.42, 1.055), cap=0.105, grey=0.05, align="centre", room=0.76)
    board.write(face["sign"], line, (0.42, 1.125), cap=0.030, grey=0.08, align="centre", room=0.76)
    return np.clip(board.picture * (1 + 0.05 * cloudy(shape, 4, 4, random)), 0.03, 0.8).astype(np.float32)


def fascia(random: np.random.Generator) -> np.ndarray:
    """A painted board over a shop, 3.4 m × 0.46 m."""
    names = ("STATION HOTEL", "CAFÉ TERMINUS", "MILL & HARROW", "FENWICK’S BAKERY", "THE RAILWAY ARMS")
    board = Board((3.4, 0.46), 0.09, texel=0.004)
    board.fill(frame((0.03, 0.03), (3.37, 0.43), 0.012, 0.03), 0.55)
    text = str(random.choice(names))
    board.write(faces()["condensed"], text, (1.7, 0.345), cap=0.23, grey=0.66, align="centre", room=3.0)
    shape = board.picture.shape
    return np.clip(board.picture * (1 + 0.08 * cloudy(shape, 9, 4, random)), 0.03, 0.8).astype(np.float32)
