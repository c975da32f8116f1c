"""Printed pages as reflectances, float32 in 0..1, row 0 on top: screened pictures, headlines, small type."""

from __future__ import annotations

import numpy as np
from letters import word
from surfaces import cloudy, noise

TEXEL_MM = 0.03  # a pixel sees 0.1 mm
COLUMN_MM, GUTTER_MM, HEAD_MM = 13.0, 1.0, 3.4
WORDS = """
    THE A OF AND TO IN ON FOR AT BY FROM WITH AFTER UNDER NEAR HARBOUR COUNCIL BRIDGE RIVER MARKET TRAIN SHIP
    STORM WINTER SPRING NIGHT MORNING NEW OLD LAST FIRST GREAT SMALL OPENS CLOSES RISES FALLS RETURNS WINS
    LOSES BUILDS FINDS SEEKS KEEPS CITY TOWN SCHOOL TEAM CREW MAYOR DOCTOR PILOT BAKER FARMERS WORKERS PRICES
    BREAD WHEAT COAL GLASS STEEL WOOL 1912 1926 1934 40 17 8 300
"""
HEADS = {
    1: ("LIGHT", "STORM", "NIGHT", "RIVER"),
    2: ("HARBOUR", "AT LAST", "RETURNS", "NEW LIGHT"),
}  # by columns


def page(size_mm: tuple[float, float], params: dict[str, object], random: np.random.Generator) -> np.ndarray:
    """A page (wide, high): columns of type, a picture with its headline among them, fibres."""
    columns, rows = (round(n / TEXEL_MM) for n in size_mm)
    ink = np.zeros((rows, columns), dtype=np.float32)
    wide, gutter, head = (round(n / TEXEL_MM) for n in (COLUMN_MM, GUTTER_MM, HEAD_MM))
    step, type_mm = wide + gutter, float(params["type_mm"])
    across = int(params["picture_columns"])
    starts = np.arange((columns // 2 - (across * step - gutter) // 2) % step - step, columns, step)
    first = int(np.argmin(np.abs(starts + (across * step - gutter) / 2 - columns / 2)))
    left, span = int(starts[first]), across * step - gutter
    high = round(float(random.uniform(13.0, 15.5)) / TEXEL_MM)
    top = (rows - high - head) // 2 + round(float(random.uniform(-2, 2)) / TEXEL_MM)
    foot = top + high + head + 3 * gutter
    for k, start in enumerate(starts):
        taken = first <= k < first + across
        spans = ((0, top - gutter), (foot, rows)) if taken else ((0, rows),)
        for low, end in spans:  # a column may be cut by the edge
            type_ = np.zeros((end - low, wide), dtype=np.float32)
            _set_type(type_, type_mm, random)
            cut = type_[:, max(-start, 0) :]
            ink[low:end, max(start, 0) : start + wide] = cut[:, : columns - max(start, 0)]
    grey = scenery(str(params["motif"]), high, span, random)
    screen = screened(grey, float(params["dots_per_mm"]), float(params["screen_deg"]))
    ink[top : top + high, left : left + span] = screen
    line = word(str(random.choice(HEADS[across])), head, pen=0.17, contrast=2.4)[:, :span]
    _lay(ink, line, (foot - head - gutter, left))
    ink *= 0.93 + 0.07 * noise(ink.shape, (rows / 3, columns / 3), random)  # it takes unevenly
    paper = float(params["paper"]) * (1 + 0.035 * cloudy(ink.shape, 60, 4, random))
    paper *= 1 - 0.05 * np.roll(ink[:, ::-1], 40, axis=0)  # the other side shows through
    fibres = noise(ink.shape, (rows / 2.5, columns / 9), random) > 0.8
    paper *= 1 - 0.07 * fibres
    return np.clip(paper + ink * (float(params["ink"]) - paper), 0.02, 0.8).astype(np.float32)


def screened(grey: np.ndarray, dots_per_mm: float, angle_deg: float) -> np.ndarray:
    """Ink of a picture of tones (0 dark, 1 bright) as round dots on a square screen, which meet half way."""
    y, x = np.ogrid[0 : grey.shape[0], 0 : grey.shape[1]]
    a, k = np.radians(angle_deg), 2 * np.pi * dots_per_mm * TEXEL_MM
    u, v = k * (np.cos(a) * x + np.sin(a) * y), k * (np.cos(a) * y - np.sin(a) * x)
    spot = (np.cos(u) + np.cos(v)).astype(np.float32) / 2  # -1..1; its distribution is symmetric about 0
    share = 0.5 + 0.5 * np.sign(spot) * (1 - (1 - np.abs(spot)) ** 1.4)  # about even over 0..1
    return np.clip((share - np.clip(grey, 0.06, 0.94)) * 3.5 / k + 0.5, 0, 1)


def scenery(motif: str, rows: int, columns: int, random: np.random.Generator) -> np.ndarray:
    """Tones of a photograph: sky and water with a lighthouse, a steamer, balloons or a bridge."""
    y, x = np.mgrid[0:rows, 0:columns].astype(np.float32)
    y, x = y / rows, x / rows  # heights of the picture
    wide = columns / rows
    clouds = cloudy((rows, columns), 5, 6, random)
    grey = 0.78 - 0.35 * (0.6 - y) + 0.28 * np.clip(clouds, -0.3, 1)
    sea = y > 0.68
    ripples = noise((rows, columns), (90, 24), random) + noise((rows, columns), (45, 9), random)
    grey = np.where(sea, 0.34 + 0.25 * np.clip(ripples, 0, 1) * (0.5 + y), grey)
    hills = 0.66 - 0.06 * np.abs(noise((rows, columns), (0.1, 5), random)[0]) - 0.03 * np.sin(3 * x[0])
    grey = np.where((y > hills) & ~sea, 0.42 + 0.1 * clouds, grey)
    at = float(random.uniform(0.35, 0.65)) * wide
    if motif == "lighthouse":
        rock = y > 0.6 + 0.9 * (x - at) ** 2 + 0.05 * clouds
        grey = np.where(rock & (y < 0.86), 0.16 + 0.2 * np.clip(clouds, 0, 1), grey)
        half = 0.045 + 0.05 * (y - 0.2)
        tower = (np.abs(x - at) < half) & (y > 0.2) & (y < 0.64)
        bands = np.where(np.mod(y, 0.16) < 0.08, 0.92, 0.2)
        grey = np.where(tower, bands * (1 - 0.5 * np.clip((x - at) / half, -0.4, 1)), grey)
        grey[(np.abs(x - at) < 0.035) & (y > 0.11) & (y < 0.2)] = 0.95
        grey[(np.abs(x - at) < 0.05 - (0.12 - y)) & (y > 0.07) & (y < 0.12)] = 0.08
    elif motif == "steamer":
        hull = (np.abs(x - at) < 0.46 - 0.5 * (y - 0.6)) & (y > 0.6) & (y < 0.75)
        grey[hull] = 0.1
        grey[(np.abs(x - at) < 0.3) & (y > 0.52) & (y < 0.6)] = 0.85
        grey[(np.abs(x - at) < 0.3) & (np.mod(x, 0.05) < 0.02) & (y > 0.55) & (y < 0.575)] = 0.1
        for k in (-0.12, 0.06):
            grey[(np.abs(x - at - k) < 0.035) & (y > 0.34) & (y < 0.52)] = 0.14
            plume = ((x - at - k - 0.9 * (0.34 - y)) / (0.05 + 0.3 * (0.34 - y))) ** 2 < 1
            grey = np.where(plume & (y < 0.34), np.clip(0.3 + 0.3 * clouds, 0.1, 0.6), grey)
    elif motif == "balloons":
        for _ in range(4):
            cx, cy, r = (
                random.uniform(0.15, wide - 0.15),
                random.uniform(0.15, 0.5),
                random.uniform(0.08, 0.17),
            )
            off = np.hypot(x - cx, (y - cy) * 0.9) / r
            gores = np.where(np.mod(np.arcsin(np.clip((x - cx) / r, -1, 1)) * 3, 1) < 0.5, 0.85, 0.25)
            grey = np.where(off < 1, gores * (1 - 0.6 * np.clip((x - cx + y - cy) / r, -0.2, 1)), grey)
            grey[(np.abs(x - cx) < 0.18 * r) & (np.abs(y - cy - 1.75 * r) < 0.13 * r)] = 0.12
    else:
        off = np.abs(np.mod(x - at + 0.5, 1.0) - 0.5)  # from the nearest pier
        deck, pier = np.abs(y - 0.56) < 0.014, (off < 0.03) & (y > 0.16) & (y < 0.76)
        sag = 0.2 + 0.33 * (1 - (1 - 2 * off) ** 2)
        chain, stays = np.abs(y - sag) < 0.008, (np.mod(x, 0.05) < 0.008) & (y > sag) & (y < 0.56)
        grey = np.where(deck | chain | stays | pier, 0.1 + 0.15 * np.clip(clouds, 0, 1), grey)
    grain = noise((rows, columns), (rows / 6, columns / 6), random)
    return (grey + 0.05 * grain).astype(np.float32)


def _set_type(ink: np.ndarray, height_mm: float, random: np.random.Generator) -> None:
    """Lines of small capitals, a word after the other, set to the measure; in place."""
    height = height_mm / TEXEL_MM
    kept: dict[str, np.ndarray] = {}
    words = WORDS.split()
    for top in np.arange(0, ink.shape[0] - 2 * height, 1.75 * height):
        line, left = [], 0
        while True:
            text = str(random.choice(words))
            cut = kept.setdefault(text, word(text, height, pen=0.15, contrast=1.3))
            if left + cut.shape[1] > ink.shape[1]:
                break
            line.append(cut)
            left += cut.shape[1] + round(0.5 * height)
        spare = (ink.shape[1] - left + 0.5 * height) / max(len(line) - 1, 1)
        at = 0.0
        for cut in line:
            _lay(ink, cut, (int(top), int(at)))
            at += cut.shape[1] + 0.5 * height + min(spare, 2 * height)


def _lay(ink: np.ndarray, cut: np.ndarray, at: tuple[int, int]) -> None:
    """Print a word with its upper left corner at a place (row, column), as far as there is room."""
    here = ink[at[0] :, at[1] :][: cut.shape[0], : cut.shape[1]]
    here[:] = cut[: here.shape[0], : here.shape[1]]
