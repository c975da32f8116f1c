"""A printed USAF-1951 resolution chart on a flat board: true vector geometry, no bitmap anywhere.

World frame: metres, x right, y up, z towards the lens, which stands at z = 0.5; the middle of the chart's
face lies on the axis. Drawings are lists of convex polygons in millimetres, each an (n, 2) array,
counter-clockwise as the lens sees them.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import mitsuba as mi
import numpy as np

from saf_gen.render.meshes import make_mesh

Polygons = list[np.ndarray]

M_PER_MM = 1e-3
INK_HEIGHT_MM = 0.02  # keeps ink off its carrier; far below anything the lens resolves
CARD_THICKNESS_MM = 0.30

BOARD_MM = (240.0, 170.0)  # far outside the 106 mm x 66 mm field, so blur and guard bands still meet board
CARD_MM, CARD_CENTRE_MM = (66.0, 59.0), (-14.0, 0.5)
CHART_CENTRE_MM = (-16.0, -2.0)
STAR_CENTRE_MM, STAR_RADIUS_MM, STAR_SECTORS = (35.0, 14.0), 15.5, 36

COARSEST_GROUP, NESTED_PAIRS = -2, 3  # pairs (-2, -1), (0, 1), (2, 3): lines from 2 mm down to 0.035 mm

PAPER, CARD = 0.55, 0.82  # diffuse reflectances

LAMP_RADIANCE, ROOM_RADIANCE = 110.0, 0.55  # W m^-2 sr^-1
LAMP_SIZE_M, LAMP_ORIGIN_M = 0.15, (-0.28, 0.20, 0.30)
LENS_Z_M = 0.5

# Strokes of the numerals in a box 1 wide and 2 high.
_GLYPHS: dict[str, list[list[tuple[float, float]]]] = {
    "-": [[(0.1, 1.0), (0.9, 1.0)]],
    "0": [[(0.5, 0), (0.95, 0.4), (0.95, 1.6), (0.5, 2), (0.05, 1.6), (0.05, 0.4), (0.5, 0)]],
    "1": [[(0.15, 1.6), (0.55, 2), (0.55, 0)]],
    "2": [[(0.05, 1.6), (0.3, 2), (0.7, 2), (0.95, 1.6), (0.95, 1.3), (0.05, 0), (0.95, 0)]],
    "3": [[(0.05, 2), (0.95, 2), (0.45, 1.2), (0.95, 0.9), (0.95, 0.35), (0.6, 0), (0.05, 0.1)]],
    "4": [[(0.75, 0), (0.75, 2), (0.0, 0.6), (1.0, 0.6)]],
    "5": [[(0.9, 2), (0.1, 2), (0.1, 1.1), (0.6, 1.2), (0.95, 0.8), (0.95, 0.4), (0.6, 0), (0.05, 0.1)]],
    "6": [[(0.85, 2), (0.3, 1.5), (0.05, 0.9), (0.05, 0.4), (0.4, 0), (0.65, 0), (0.95, 0.4), (0.95, 0.75),
           (0.65, 1.1), (0.1, 0.9)]],
}  # fmt: skip
_STROKE = 0.28


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Scene dictionary (metres, W m^-2 sr^-1) without sensor and integrator."""
    turn = mi.ScalarTransform4f().rotate([0, 0, 1], params["lamp_deg"])
    lamp_pose = mi.ScalarTransform4f().look_at(origin=list(LAMP_ORIGIN_M), target=[0, 0, 0], up=[0, 1, 0])
    lamp_pose = turn @ lamp_pose @ mi.ScalarTransform4f().scale(LAMP_SIZE_M / 2)
    pose, ink = _pose(params["distance_m"], params["turn_deg"], params["swing_deg"]), params["ink"]
    board_z = -CARD_THICKNESS_MM
    return {
        "type": "scene",
        "chart": _plate("chart", [_rectangle(*CARD_CENTRE_MM, *CARD_MM)], 0.0, CARD, pose),
        "chart_ink": _plate("chart_ink", _moved(usaf_1951(), *CHART_CENTRE_MM), INK_HEIGHT_MM, ink, pose),
        "board": _plate("board", [_rectangle(0, 0, *BOARD_MM)], board_z, PAPER, pose),
        "board_ink": _plate("board_ink", board_marks(), board_z + INK_HEIGHT_MM, ink, pose),
        "lamp": {
            "type": "rectangle",
            "to_world": lamp_pose,
            "bsdf": {"type": "diffuse", "reflectance": 0.0},
            "emitter": {"type": "area", "radiance": LAMP_RADIANCE},
        },
        "room": {"type": "constant", "radiance": ROOM_RADIANCE},
    }


def _pose(distance_m: float, turn_deg: float, swing_deg: float) -> np.ndarray:
    """Where the board stands, float64 (4, 4): turned in its plane, then swung about the vertical."""
    pose = mi.ScalarTransform4f().translate([0, 0, LENS_Z_M - distance_m])
    pose = pose.rotate([0, 1, 0], swing_deg).rotate([0, 0, 1], turn_deg)
    return np.array(pose.matrix, dtype=np.float64)


def usaf_1951() -> Polygons:
    """Nested pairs of groups about the origin, each pair a quarter the size of the one round it."""
    ink: Polygons = []
    x = 0.0
    for nest in range(NESTED_PAIRS):
        group = COARSEST_GROUP + 2 * nest
        ink += _moved(_group_pair(group), x, 0.0)
        x += 2.5 * _line_width(group, 1)  # the gap between the columns lies right of their middle
    return ink


def _group_pair(group: int) -> Polygons:
    """Elements 2-6 of the group in the left column, 1 at the lower right, the next group in the right."""
    unit = _line_width(group, 1)
    left, right, top = -12.0 * unit, 14.0 * unit, 11.0 * unit
    label = 2.2 * unit  # height of a group's number
    ink = _text(str(group), left + 4 * unit, top + 0.6 * unit, label)
    ink += _text(str(group + 1), right - 4 * unit, top + 0.6 * unit, label)

    y = top
    for element in range(2, 7):
        width = _line_width(group, element)
        ink += _element(left, y - 5 * width, width)
        ink += _text(str(element), left - 2.0 * width, y - 3.6 * width, 2.2 * width)
        y -= 6.2 * width
    floor = y + 1.2 * width

    y = top
    for element in range(1, 7):
        width = _line_width(group + 1, element)
        ink += _element(right - 12 * width, y - 5 * width, width)
        ink += _text(str(element), right + 0.9 * width, y - 3.6 * width, 2.2 * width)
        y -= 6.2 * width

    ink += _element(right - 12 * unit, floor, unit)
    ink += _text("1", right + 0.9 * unit, floor + 1.4 * unit, 2.2 * unit)
    return ink


def _line_width(group: int, element: int) -> float:
    """Width of one line in mm (MIL-STD-150A: 2^(group + (element - 1) / 6) line pairs a millimetre)."""
    return 0.5 * 2.0 ** -(group + (element - 1) / 6)


def _element(left: float, bottom: float, width: float) -> Polygons:
    """Three horizontal lines beside three vertical ones, each five widths long; 12 by 5 widths in all."""
    ink: Polygons = []
    for line in range(3):
        ink.append(_box(left, bottom + 2 * line * width, 5 * width, width))
        ink.append(_box(left + (7 + 2 * line) * width, bottom, width, 5 * width))
    return ink


def board_marks() -> Polygons:
    """What fills the field round the card: Siemens star, slanted square, checks, gratings and rulers."""
    ink = _siemens_star(*STAR_CENTRE_MM, STAR_RADIUS_MM, STAR_SECTORS)
    ink += _moved([_turned(_rectangle(0, 0, 11, 11), degrees=5)], 28.0, -13.5)
    ink += [
        _box(37 + column * 1.5, -20 + row * 1.5, 1.5, 1.5)
        for row in range(9)
        for column in range(9)
        if (row + column) % 2 == 0
    ]
    for row, width in enumerate((2.0, 1.4, 1.0, 0.7, 0.5, 0.35)):
        lines = int(5.0 / (2 * width))
        ink += [_box(-53.5 + 2 * line * width, 20 - 9 * row, width, 7.0) for line in range(lines + 1)]
    for tick in range(-60, 61):
        length = 4.0 if tick % 10 == 0 else 2.8 if tick % 5 == 0 else 1.8
        ink += [_box(tick - 0.15, -33.5, 0.3, length), _box(tick - 0.15, 33.5 - length, 0.3, length)]
        if tick % 10 == 0:
            ink += _text(str(abs(tick) // 10), tick + 0.5, -31.5, 1.6)
    return ink


def _siemens_star(x: float, y: float, radius: float, sectors: int) -> Polygons:
    angle = np.linspace(0, 2 * np.pi, 2 * sectors + 1)
    rim = np.stack([np.cos(angle), np.sin(angle)], axis=1) * radius
    return _moved([np.stack([np.zeros(2), rim[2 * k], rim[2 * k + 1]]) for k in range(sectors)], x, y)


def _text(text: str, x: float, y: float, height: float) -> Polygons:
    """A number of the given height, its lower left corner at (x, y)."""
    scale = height / 2
    ink: Polygons = []
    for index, character in enumerate(text):
        origin = np.array([x + 1.5 * scale * index, y])
        for stroke in _GLYPHS[character]:
            points = np.array(stroke, dtype=float)
            for start, stop in pairwise(points):
                along = (stop - start) / np.linalg.norm(stop - start) * _STROKE / 2
                across = np.array([-along[1], along[0]])
                corners = [start - along - across, stop + along - across]
                corners += [stop + along + across, start - along + across]
                ink.append(origin + scale * np.stack(corners))
    return ink


def _box(left: float, bottom: float, width: float, height: float) -> np.ndarray:
    return np.array([left, bottom]) + np.array([[0, 0], [width, 0], [width, height], [0, height]])


def _rectangle(x: float, y: float, width: float, height: float) -> np.ndarray:
    return _box(x - width / 2, y - height / 2, width, height)


def _turned(polygon: np.ndarray, *, degrees: float) -> np.ndarray:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return polygon @ np.array([[c, s], [-s, c]])


def _moved(polygons: Sequence[np.ndarray], x: float, y: float) -> Polygons:
    return [polygon + np.array([x, y]) for polygon in polygons]


def _plate(name: str, polygons: Polygons, z_mm: float, reflectance: float, pose: np.ndarray) -> mi.Mesh:
    """One flat diffuse mesh of all polygons, at height z over the middle of the board at ``pose``."""
    vertices, faces, first = [], [], 0
    for polygon in polygons:
        vertices.append(np.column_stack([polygon, np.full(len(polygon), z_mm)]))
        faces += [(first, first + k, first + k + 1) for k in range(1, len(polygon) - 1)]
        first += len(polygon)
    positions = np.concatenate(vertices) * M_PER_MM @ pose[:3, :3].T + pose[:3, 3]
    bsdf = {"type": "diffuse", "reflectance": reflectance}
    return make_mesh(name, positions, faces=np.array(faces), bsdf=bsdf)
