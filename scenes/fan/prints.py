"""Reflectance pictures, float32 in 0..1, row 0 on top: rotor, badge, calendar, wall, desk, books."""

from __future__ import annotations

import numpy as np
from stroke_font import drawn, lines

Shape = tuple[int, int]
ROTOR_MM, BADGE_MM = 42.0, 11.5  # half the side of the picture
ROTOR_TEXEL_MM, BADGE_TEXEL_MM = 0.11, 0.06  # a pixel sees 0.45 mm
CALENDAR_MM, CALENDAR_TEXEL_MM = (200.0, 150.0), 0.25  # a pixel sees 0.7 mm there


def noise(shape: Shape, cells: tuple[float, float], random: np.random.Generator) -> np.ndarray:
    """Smooth value noise in -1..1 with so many lattice cells down and across."""
    lattice = random.uniform(-1, 1, [int(n) + 2 for n in cells]).astype(np.float32)
    for axis in (0, 1):
        at = np.arange(shape[axis], dtype=np.float32) * np.float32(cells[axis] / shape[axis])
        first = at.astype(np.int64)
        part = at - first
        part *= part * (3 - 2 * part)
        part = part[:, None] if axis == 0 else part
        here = np.take(lattice, first, axis=axis)
        lattice = here + part * (np.take(lattice, first + 1, axis=axis) - here)
    return lattice


def cloudy(shape: Shape, cells: float, octaves: int, random: np.random.Generator) -> np.ndarray:
    """Octaves of noise, each twice as fine and 0.6 times as strong, about -1..1; cells across the first."""
    high = cells * shape[0] / shape[1]
    layers = (0.6**k * noise(shape, (high * 2**k, cells * 2**k), random) for k in range(octaves))
    return sum(layers, np.zeros(shape, dtype=np.float32))


def rotor(blades: int, random: np.random.Generator) -> np.ndarray:
    """Blades and hub seen along the axle: print, scratches, mould marks, and dust on the leading edges.

    Blade k lies about the angle 2π k / blades; the rotor turns with the angle.
    """
    axis = _axis(ROTOR_MM, ROTOR_TEXEL_MM)
    x, y = axis[None, :], axis[:, None]
    shape = axis.size, axis.size
    radius, turn = np.hypot(x, y), np.arctan2(y, x) / (2 * np.pi) * blades + 0.5
    blade, across = np.floor(turn).astype(int) % blades, turn - np.floor(turn)  # 0: trails, 1: leads
    tone = random.uniform(0.85, 1.15, blades).astype(np.float32)[blade]
    grey = 0.15 * tone * (1 + 0.10 * cloudy(shape, 8, 5, random))
    grey[np.abs(radius - 35.6) < 1.1] = 0.66
    grey[np.abs(radius - 33.2) < 0.35] = 0.66
    ink = np.zeros(shape, dtype=np.float32)
    words = ["AERO 3", "MIN 2 MAX", "KEEP CLEAR", "5V 0.9A", "MADE IN EU"]
    for k in range(blades):
        middle = 2 * np.pi * k / blades
        text = lines(words[k % len(words)], 4.4 - 0.24 * len(words[k % len(words)]), (24.5, 1.5))
        small = lines(f"LOT {random.integers(100, 999)}-{random.integers(10, 99)}", 1.7, (24.0, -3.4))
        ink = np.maximum(ink, drawn(axis, axis, _turned(text, middle), 0.55))
        ink = np.maximum(ink, drawn(axis, axis, _turned(small, middle), 0.28))
    grey += ink * (0.68 - grey)
    worn = cloudy(shape, 30, 3, random) > 0.95  # print and paint rubbed off
    grey[worn] = 0.12
    scratches = np.zeros(shape, dtype=np.float32)
    for width, count in ((0.22, 40 * blades), (0.45, 9 * blades)):
        scratches = np.maximum(scratches, drawn(axis, axis, _scratches(count, 41.0, random), width))
    grey += 0.55 * scratches * (np.where(noise(shape, (9, 9), random) > -0.2, 0.62, 0.08) - grey)
    specks = cloudy(shape, 110, 3, random)
    dust = np.clip((across - 0.45) * 1.6, 0, 1) ** 2 * (radius / 40) + 0.10
    grey += np.clip(dust * (0.8 + 1.3 * specks), 0, 0.85) * (0.42 - grey)
    hub = radius < 13.4
    grey[hub] = _logo(axis, 13.0, 0.62, 0.07, "AERO", random)[hub]
    return np.clip(grey, 0.03, 0.85).astype(np.float32)[::-1]


def badge(random: np.random.Generator) -> np.ndarray:
    """The maker's plate in the middle of the guard: a dark ground with a bright mark."""
    axis = _axis(BADGE_MM, BADGE_TEXEL_MM)
    return _logo(axis, 11.0, 0.07, 0.66, "AERO", random)[::-1]


def _logo(
    axis: np.ndarray, size: float, ground: float, print_: float, name: str, random: np.random.Generator
) -> np.ndarray:
    """Three bent vanes in a ring over a name, on scratched lacquer; y rising with the rows."""
    x, y = axis[None, :] / size, axis[:, None] / size
    shape = axis.size, axis.size
    radius, angle = np.hypot(x, y - 0.18), np.arctan2(y - 0.18, x)
    vane = np.mod(angle / (2 * np.pi) * 3 + 0.9 * radius, 1)
    mark = (vane < 0.52) & (radius > 0.10) & (radius < 0.42)
    mark |= np.abs(radius - 0.50) < 0.025
    rim = np.hypot(x, y)
    mark |= np.abs(rim - 0.90) < 0.03
    mark |= (np.abs(rim - 0.80) < 0.035) & (np.mod(np.arctan2(y, x) / (2 * np.pi) * 48, 1) < 0.5)
    grey = np.where(mark, print_, ground).astype(np.float32)
    ink = drawn(axis, axis, lines(name, 0.27 * size, (0.0, -0.54 * size)), 0.075 * size)
    grey += ink * (print_ - grey)
    scratches = drawn(axis, axis, _scratches(60, size, random), 0.12)
    grey += 0.4 * scratches * (0.4 - grey)
    return (grey * (1 + 0.12 * cloudy(shape, 30, 3, random))).astype(np.float32)


def _axis(half: float, texel: float) -> np.ndarray:
    count = round(2 * half / texel)
    return ((np.arange(count) + 0.5) * texel - half).astype(np.float32)


def _turned(pieces: list[tuple[np.ndarray, np.ndarray]], angle: float) -> list[tuple[np.ndarray, np.ndarray]]:
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    return [(start @ turn, stop @ turn) for start, stop in pieces]


def _scratches(count: int, reach: float, random: np.random.Generator) -> list[tuple[np.ndarray, np.ndarray]]:
    start = random.uniform(-reach, reach, (count, 2))
    length, angle = reach * random.uniform(0.04, 0.35, count), random.uniform(0, 2 * np.pi, count)
    return list(zip(start, start + length[:, None] * np.stack([np.cos(angle), np.sin(angle)], 1), strict=True))


def calendar(random: np.random.Generator) -> np.ndarray:
    """A month on a wall: a photograph of hills, weekdays, dates, crossed-off days and pencilled notes."""
    width, height = CALENDAR_MM
    x = ((np.arange(round(width / CALENDAR_TEXEL_MM)) + 0.5) * CALENDAR_TEXEL_MM).astype(np.float32)
    y = ((np.arange(round(height / CALENDAR_TEXEL_MM)) + 0.5) * CALENDAR_TEXEL_MM).astype(np.float32)
    shape = y.size, x.size
    grey = 0.78 * (1 + 0.02 * cloudy(shape, 40, 3, random))
    picture = y > 92  # the photograph fills the upper part
    scene = 0.55 + 0.15 * cloudy(shape, 5, 5, random)
    for ridge in range(5):
        steps = np.arange(5)
        waves = np.sin(x[:, None] * 0.02 * 1.9**steps + random.uniform(0, 6, 5)) * 9.0 * 0.55**steps
        line = 128 - 7.5 * ridge + waves.sum(axis=1)
        tone = 0.42 - 0.075 * ridge
        wooded = tone * (1 + 0.4 * cloudy(shape, 60, 3, random))
        scene = np.where(y[:, None] < line[None, :], wooded, scene)
    grey[picture] = scene[picture]
    ink = drawn(x, y, lines("OCTOBER 2031", 7.0, (width / 2, 84.0)), 1.1)
    for day, name in enumerate(["MO", "TU", "WE", "TH", "FR", "SA", "SU"]):
        ink = np.maximum(ink, drawn(x, y, lines(name, 3.4, (22 + 26 * day, 73.0)), 0.6))
    for date in range(1, 32):
        column, row = (date + 1) % 7, (date + 1) // 7
        place = np.array([22 + 26.0 * column, 64 - 13.0 * row])
        ink = np.maximum(ink, drawn(x, y, lines(str(date), 5.2, (place[0] - 5, place[1])), 0.85))
        pencil = random.random()
        if date < 17:
            cross = [(place - np.array([11, 5]), place + np.array([10, 5]))]
            ink = np.maximum(ink, 0.7 * drawn(x, y, cross, 0.7))
        elif pencil < 0.35:
            note = str(random.choice(["DENTIST", "CALL ANN", "RENT", "GYM", "MILK"]))
            ink = np.maximum(ink, 0.6 * drawn(x, y, lines(note, 2.0, (place[0], place[1] - 5.2)), 0.4))
    grey += ink * (0.06 - grey)
    for column in range(8):
        grey[(y < 69), np.argmin(np.abs(x - (9 + 26 * column)))] = 0.4
    for row in range(6):
        grey[np.argmin(np.abs(y - (69 - 13 * row))), :] = 0.4
    return np.clip(grey, 0.04, 0.85).astype(np.float32)[::-1]


def wall(shape: Shape, random: np.random.Generator) -> np.ndarray:
    """Rolled paint: blotches, the roller's orange peel, a few scuffs."""
    peel = noise(shape, (shape[0] / 3, shape[1] / 3), random)
    grey = 0.40 * (1 + 0.05 * cloudy(shape, 4, 4, random) + 0.07 * peel)
    return np.clip(grey * (1 - 0.3 * (cloudy(shape, 50, 2, random) > 1.15)), 0.05, 0.8).astype(np.float32)


def desk(shape: Shape, boards: int, random: np.random.Generator) -> np.ndarray:
    """Oiled boards, grain across the picture, dark joints, a few scratches."""
    rows = []
    for edge in np.array_split(np.arange(shape[0]), boards):
        size = (len(edge), shape[1])
        bent = noise(size, (2, 4), random) + 0.3 * noise(size, (4, 9), random)
        rings = np.arange(size[0], dtype=np.float32)[:, None] * random.uniform(5, 9) / size[0] + 1.5 * bent
        fibre = noise(size, (size[0] / 2, size[1] / 50), random)
        board = random.uniform(0.16, 0.24) * (1.12 - 0.5 * (rings - np.floor(rings)) ** 3 + 0.15 * fibre)
        board[:2] *= 0.35
        rows.append(board)
    worn = 1 + 0.10 * cloudy(shape, 6, 4, random)
    return np.clip(np.concatenate(rows) * worn, 0.02, 0.8).astype(np.float32)


def spine(ground: float, ink: float, title: str, random: np.random.Generator) -> np.ndarray:
    """The back of a book that lies: cloth, a title along it, two rules at each end; 220 mm × 30 mm."""
    x, y = (np.arange(880, dtype=np.float32) * 0.25 - 110), (np.arange(120, dtype=np.float32) * 0.25 - 15)
    shape = y.size, x.size
    grey = ground * (1 + 0.14 * noise(shape, (40, 290), random))
    mark = drawn(x, y, lines(title, 9.0, (-12.0, 0.0)), 1.5)
    for at in (-102, -99, 84, 87):
        mark[:, np.abs(x - at) < 0.7] = 1
    return np.clip(grey + mark * (ink - grey), 0.03, 0.85).astype(np.float32)[::-1]
