"""What lies where on the board: pads, copper, vias, print, parts; millimetres, the middle at 0."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from stroke_font import lines

SIZE_MM = (15.0, 12.0)  # of the board that is modelled; the lens sees 10 mm × 6.25 mm
PITCH, LEAD_MM, BODY_MM = 0.5, (0.22, 0.75), 2.1  # of the flat pack: pitch, foot of a lead, half the body
CHIP_MM = ((1.0, 0.5, 0.30), (1.6, 0.8, 0.40))  # 0402 and 0603
TRACE_MM, CLEAR_MM = 0.16, 0.14

Piece = tuple[np.ndarray, np.ndarray]


class Chip(NamedTuple):
    """A two-ended part: middle, whether it lies along x, size (mm), its number, whether it is a resistor."""

    at: np.ndarray
    level: bool
    size: tuple[float, float, float]
    name: str
    resistor: bool


class Layout(NamedTuple):
    """Straight pieces of copper by width (mm), pads (centre, half sizes), vias, print, parts."""

    copper: list[tuple[float, list[Piece]]]
    pads: np.ndarray
    vias: np.ndarray
    print_: list[tuple[float, list[Piece]]]
    ic: np.ndarray
    leads: np.ndarray
    chips: list[Chip]


def draw_layout(ic_mm: float, random: np.random.Generator) -> Layout:
    """A flat pack with its fan of traces, rows of chips beside it, vias, names."""
    ic = np.array([-2.1 + ic_mm, 0.7 + random.uniform(-0.4, 0.4)])
    leads, traces, vias = _fan(ic, random)
    pads = [(*(ic + at), *half) for at, half in _feet(leads)]
    print_ = _corner(ic)
    chips: list[Chip] = []
    for column, x in enumerate((2.75, 4.35, 6.0)):
        heights = np.arange(5.0, -6.0, -1.75) + random.uniform(-0.3, 0.3)
        for y in heights:
            if random.random() < 0.85:
                level = bool(random.random() < 0.65)
                chips.append(_chip(np.array([x + ic_mm / 2 + (0.0 if level else 0.15 * column), y]), level, random))
    xs = np.arange(-6.2, 1.6, 1.9) + random.uniform(-0.3, 0.3)
    chips += [_chip(np.array([x, y]), True, random) for y in (-4.3, 5.4) for x in xs]
    for chip in chips:
        along = np.array([1.0, 0.0]) if chip.level else np.array([0.0, 1.0])
        length, wide = chip.size[0], chip.size[1]
        for side in (-1, 1):
            at = chip.at + side * along * (length / 2 + 0.06)
            half = (0.24, wide / 2 + 0.05) if chip.level else (wide / 2 + 0.05, 0.24)
            pads.append((*at, *half))
            stop = at + side * along * random.uniform(0.3, 0.4)
            bend = stop + random.uniform(0.1, 0.3) * (along[::-1] * random.choice([-1, 1]) + 0.6 * side * along)
            traces += [(at, stop), (stop, bend)]
            if random.random() < 0.6:
                vias.append(bend)
        across = along[::-1]
        below = (wide if chip.level else length + 0.5) / 2 + 0.48
        print_.append((0.09, lines(chip.name, 0.40, (float(chip.at[0]), float(chip.at[1]) - below))))
        for side in (-1, 1):
            edge = chip.at + side * across * (wide / 2 + 0.14)
            print_.append((0.08, [(edge - along * length * 0.2, edge + along * length * 0.2)]))
    loose = [random.uniform(-0.5, 0.5, 2) * SIZE_MM for _ in range(160)]
    taken = np.array([*(p[:2] for p in pads), *vias, *(a for a, _ in traces), *(b for _, b in traces)])
    for at in loose:
        if np.min(np.hypot(*(taken - at).T)) > 0.55 and np.max(np.abs(at - ic)) > BODY_MM + 0.3:
            vias.append(at)
            taken = np.vstack([taken, at])
    return Layout([(TRACE_MM, traces)], np.array(pads), np.array(vias), print_, ic, leads, chips)


def _fan(ic: np.ndarray, random: np.random.Generator) -> tuple[np.ndarray, list[Piece], list[np.ndarray]]:
    """Leads (position along the side, side), the traces that leave them, and the vias where these end."""
    count = 7
    at = (np.arange(count) - (count - 1) / 2) * PITCH
    leads, traces, vias = [], [], []
    for side in range(4):
        c, w = ((1, 0), (0, 1), (-1, 0), (0, -1))[side]
        turn = np.array([[c, -w], [w, c]])
        for k, t in enumerate(at):
            leads.append((t, side))
            out = BODY_MM + 0.95
            spread = 0.55 * t
            first = out + 0.3 * (at[-1] - abs(t))
            stop = first + abs(spread) + (0.15 if k % 2 else 0.6)
            path = [(BODY_MM + 0.5, t), (first, t), (first + abs(spread), t + spread), (stop, t + spread)]
            points = [ic + turn @ np.array(p) for p in path]
            traces += [(a, b) for a, b in pairwise(points)]
            if random.random() < 0.85:
                vias.append(points[-1])
    return np.array(leads), traces, vias


def _feet(leads: np.ndarray) -> list[tuple[np.ndarray, tuple[float, float]]]:
    """Pads under the leads' feet, about the part's middle."""
    made = []
    for t, side in leads:
        out = BODY_MM + 0.62
        at, half = np.array([out, t]), (LEAD_MM[1] / 2 + 0.06, LEAD_MM[0] / 2 + 0.03)
        for _ in range(int(side)):
            at, half = np.array([-at[1], at[0]]), half[::-1]
        made.append((at, half))
    return made


def _corner(ic: np.ndarray) -> list[tuple[float, list[Piece]]]:
    """The printed outline of the flat pack's corners, a dot at lead 1, its name."""
    reach = BODY_MM + 0.1
    pieces = []
    for sx in (-1, 1):
        for sy in (-1, 1):
            tip = ic + reach * np.array([sx, sy])
            pieces += [(tip, tip - [0.33 * sx, 0]), (tip, tip - [0, 0.33 * sy])]
    dot = ic + np.array([-reach - 0.25, reach + 0.05])
    name = lines("U7", 0.62, (float(ic[0]) + 2.75, float(ic[1]) + 2.75))
    return [(0.12, pieces), (0.26, [(dot, dot + np.array([1e-3, 0.0]))]), (0.12, name)]


def _chip(at: np.ndarray, level: bool, random: np.random.Generator) -> Chip:
    resistor = bool(random.random() < 0.6)
    name = ("R" if resistor else "C") + str(random.integers(10, 99))
    return Chip(at, level, CHIP_MM[int(random.random() < 0.25)], name, resistor)
