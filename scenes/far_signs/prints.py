"""Reflectance pictures, float32 in 0..1, row 0 on top: signs, clock, plate, posters, brick, asphalt."""

from __future__ import annotations

import numpy as np
from letters import stamp, word
from surfaces import cloudy, noise

SIGN_M, TEXEL_M = (0.96, 0.70), 0.0008  # a pixel sees 3.8 mm of the sign
TOWNS = (
    "ALDERMERE", "BRONSTAD", "CASTELNUOVO", "DUNHAVEN", "EISENACHT", "FLORVILLE", "GRANBY", "HOLMSTED",
    "ISLEY", "KARLSUND", "LINDOW", "MONTCLAIR", "NORDHAM", "OVERTON", "PENRYN", "QUARNHOLM", "ROSENBORG",
)  # fmt: skip
STREETS = ("HARBOUR STREET", "MILL LANE", "STATION SQUARE", "KINGS ROAD", "ORCHARD WAY", "BAKERS ROW")
WAYS = (
    "PLATFORMS 1-6",
    "TICKETS",
    "EXIT TO RIVER",
    "LEFT LUGGAGE",
    "BUSES 12 & 48",
    "TAXIS",
    "WAITING ROOM",
    "CYCLES",
)
ADS = ("FRESH COFFEE", "MATINEE 3.30", "SEA AIR", "BREAD & SALT", "ROUND TOURS", "JAZZ 21:00")


def sign(layout: str, inks: tuple[float, float], random: np.random.Generator) -> np.ndarray:
    """The sign itself: ``inks`` are the reflectances of ground and print."""
    ground, ink = inks
    picture = np.full([round(side / TEXEL_M) for side in SIGN_M[::-1]], ground, dtype=np.float32)
    {"timetable": _timetable, "directions": _directions, "streets": _streets}[layout](picture, ink, random)
    _frame(picture, ink, inset=0.012, wide=0.005)
    return _weathered(picture, random)


def _timetable(picture: np.ndarray, ink: float, random: np.random.Generator) -> None:
    _write(picture, "DEPARTURES", (0.30, 0.065), 0.058, ink, pen=0.17)
    _bar(picture, 0.115, ink)
    hour, minute = int(random.integers(5, 20)), 0
    for row, town in enumerate(random.choice(TOWNS, 9, replace=False)):
        y = 0.157 + 0.059 * row
        minute += int(random.integers(4, 23))
        clock = f"{hour + minute // 60:02d}:{minute % 60:02d}"
        _write(picture, clock, (0.045, y), 0.031, ink, pen=0.16)
        _write(picture, str(town), (0.225, y), 0.031, ink)
        _write(picture, f"{int(random.integers(1, 7))}", (0.755, y), 0.031, ink, pen=0.18)
        _write(picture, str(random.choice(["ON TIME", "ON TIME", "LATE 5"])), (0.815, y + 0.004), 0.017, ink)
        if row < 8:
            _bar(picture, y + 0.0305, ink, thick=0.0015)


def _directions(picture: np.ndarray, ink: float, random: np.random.Generator) -> None:
    for row, way in enumerate(random.choice(WAYS, 5, replace=False)):
        y = 0.085 + 0.128 * row
        right = bool(random.integers(2))
        _write(picture, str(way), (0.05 if right else 0.17, y), 0.046, ink, pen=0.15)
        _write(
            picture,
            f"{10 * int(random.integers(2, 40))} M",
            (0.055 if right else 0.175, y + 0.048),
            0.019,
            ink,
        )
        _arrow(picture, (0.885 if right else 0.085, y), ink, right=right)
        if row < 4:
            _bar(picture, y + 0.069, ink, thick=0.003)


def _streets(picture: np.ndarray, ink: float, random: np.random.Generator) -> None:
    for row, street in enumerate(random.choice(STREETS, 3, replace=False)):
        top = 0.045 + 0.212 * row
        low, high = round(top / TEXEL_M), round((top + 0.185) / TEXEL_M)
        here = picture[low:high, round(0.035 / TEXEL_M) : -round(0.035 / TEXEL_M)]
        if row % 2:
            here[:] = ink
        tone = float(picture[2, 2]) if row % 2 else ink
        _frame(here, tone, inset=0.006, wide=0.003)
        _write(here, str(street), (0.035, 0.075), 0.062 if len(street) < 12 else 0.052, tone, pen=0.16)
        first, last, district = (int(random.integers(*span)) for span in ((1, 80), (81, 240), (2, 19)))
        numbers = f"{first}-{last}   DISTRICT {district}"
        _write(here, numbers, (0.035, 0.145), 0.024, tone)


def _write(
    picture: np.ndarray, text: str, at: tuple[float, float], height: float, grey: float, *, pen: float = 0.14
) -> None:
    """Text with its left end and the middle of its capitals at a place (m from the left, from the top)."""
    ink = word(text, height / TEXEL_M, pen=pen)
    stamp(picture, ink, at[1] / TEXEL_M, at[0] / TEXEL_M + ink.shape[1] / 2, grey)


def _bar(picture: np.ndarray, y: float, grey: float, *, thick: float = 0.006) -> None:
    row, rim = round(y / TEXEL_M), round(0.035 / TEXEL_M)
    picture[row : row + max(round(thick / TEXEL_M), 1), rim:-rim] = grey


def _arrow(picture: np.ndarray, at: tuple[float, float], grey: float, *, right: bool) -> None:
    y, x = np.ogrid[: picture.shape[0], : picture.shape[1]]
    u, v = (x * TEXEL_M - at[0]) * (1 if right else -1), np.abs(y * TEXEL_M - at[1])
    shaft = (np.abs(u + 0.005) < 0.033) & (v < 0.0055)
    head = (np.abs(u + v - 0.034) < 0.0085) & (v < 0.030)
    picture[shaft | head] = grey


def _frame(picture: np.ndarray, grey: float, *, inset: float, wide: float) -> None:
    rows, columns = picture.shape
    y, x = np.ogrid[:rows, :columns]
    off = np.minimum(np.minimum(y, rows - 1 - y), np.minimum(x, columns - 1 - x)) * TEXEL_M
    picture[(off > inset) & (off < inset + wide)] = grey


def _weathered(picture: np.ndarray, random: np.random.Generator) -> np.ndarray:
    shape = picture.shape
    runs = noise(shape, (3, shape[1] / 9), random)
    worn = 1 + 0.04 * cloudy(shape, 8, 4, random) + 0.05 * np.clip(runs, -1, 0)
    return np.clip(picture * worn, 0.025, 0.85).astype(np.float32)


def clock(time_min: float) -> np.ndarray:
    """A station clock's face, 0.66 m: bars, bold quarters, hands at ``time_min`` minutes past twelve."""
    n = 560
    x, y = np.meshgrid((np.arange(n) + 0.5) / n * 2 - 1, 1 - (np.arange(n) + 0.5) / n * 2)
    r, turn = np.hypot(x, y), np.arctan2(x, y) / (2 * np.pi)
    grey = np.where(r < 0.93, 0.78, 0.06)
    minute, hour = (
        np.abs(np.mod(turn * 60 + 0.5, 1) - 0.5) / 60,
        np.abs(np.mod(turn * 12 + 0.5, 1) - 0.5) / 12,
    )
    grey[(minute * 2 * np.pi * r < 0.012) & (r > 0.82) & (r < 0.9)] = 0.05
    grey[(hour * 2 * np.pi * r < 0.032) & (r > 0.68) & (r < 0.9)] = 0.05
    for angle, long, wide in ((time_min / 720, 0.55, 0.052), (time_min % 60 / 60, 0.84, 0.036)):
        a = 2 * np.pi * angle
        along, off = x * np.sin(a) + y * np.cos(a), np.abs(x * np.cos(a) - y * np.sin(a))
        grey[(off < wide * (1.15 - 0.35 * along / long)) & (along > -0.2) & (along < long)] = 0.03
    return grey.astype(np.float32)


def plate(random: np.random.Generator) -> np.ndarray:
    """A car's number plate, 0.52 m × 0.11 m."""
    grey = np.full((138, 650), 0.70, dtype=np.float32)
    letters = "".join(random.choice(list("ABDEFHKLMNPRSTVXZ"), 4))
    ink = word(
        f"{letters[:2]} {int(random.integers(10, 99))} {letters[2:]}{int(random.integers(1, 9))}",
        92,
        pen=0.18,
    )
    stamp(grey, ink, 69, 345, 0.04)
    grey[:, :46] = 0.09
    grey[:5] = grey[-5:] = grey[:, -5:] = 0.04
    return grey


def poster(random: np.random.Generator) -> np.ndarray:
    """A large printed bill of two lines under a picture of rings; 1.2 m × 1.7 m."""
    grey = np.full((680, 480), float(random.uniform(0.3, 0.75)), dtype=np.float32)
    y, x = np.ogrid[:680, :480]
    cx, cy, pitch = random.uniform(150, 330), random.uniform(180, 260), random.uniform(28, 60)
    rings = np.sin(np.hypot(x - cx, y - cy) / pitch * 2 * np.pi) > 0
    grey[:440][rings[:440]] = float(random.uniform(0.06, 0.3))
    text = str(random.choice(ADS)).split(" ", 1)
    for row, part in enumerate(text):
        ink = word(part, 66 if len(part) < 7 else 44, pen=0.17)
        stamp(grey, ink, 510 + 95 * row, 240, 0.05)
    return grey


def brick(random: np.random.Generator) -> np.ndarray:
    """A wall in stretcher bond, 2.4 m × 2.4 m a repeat."""
    n = 960
    y, x = np.mgrid[0:n, 0:n] / n * 2.4
    row = np.floor(y / 0.075).astype(int)
    along = x / 0.24 + 0.5 * (row % 2)
    tone = random.uniform(0.14, 0.30, (33, 12))[row % 32, np.floor(along).astype(int) % 10]
    joint = (np.mod(y, 0.075) < 0.011) | (np.mod(along, 1) * 0.24 < 0.011)
    grey = np.where(joint, 0.36, tone) * (1 + 0.12 * noise((n, n), (n / 3, n / 3), random))
    return np.clip(grey, 0.05, 0.6).astype(np.float32)


def asphalt(random: np.random.Generator) -> np.ndarray:
    """Grit, 4 m × 4 m a repeat."""
    n = 800
    grey = 0.10 * (1 + 0.5 * noise((n, n), (n / 2, n / 2), random) + 0.25 * cloudy((n, n), 9, 4, random))
    return np.clip(grey, 0.03, 0.4).astype(np.float32)
