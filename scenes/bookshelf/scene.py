"""A bookshelf: rows of lettered spines, editions of equal backs, leaning books and a globe.

World frame: metres, x right, y up, z towards the lens, which stands at the origin and looks along -z.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import books
import numpy as np
from patterns import globe, wood
from shapes import box, matte, panel, satin, swept, turned

BOARD_Y, BOARD_THICK, BOARD_DEEP = -0.046, 0.018, 0.25  # metres; the lens looks at y = 0
PITCH = 0.262  # from board to board
WIDTH_MM = 255.0  # of books on either side of the middle; the lens sees 150 mm to 210 mm on either side
GAP_MM = 74.0  # room for the globe
TALLEST_MM, LOWER_TALLEST_MM = 165.0, 232.0
TEXEL_MM, LOWER_TEXEL_MM = 0.25, 0.5  # a pixel sees 0.7 mm to 1.0 mm
GLOBE_RADIUS, GLOBE_HEIGHT, TILT_DEG = 0.030, 0.052, 23.4
# Radius and height (m) of the globe's foot, from the board up.
FOOT = [(0.0, 0.0), (0.022, 0.0), (0.023, 0.002), (0.018, 0.005), (0.007, 0.008), (0.0035, 0.011), (0.0032, 0.018)]

LAMP_SIZE, LAMP_RADIANCE = (0.28, 0.28), 26.0  # W m^-2 sr^-1
CEILING_SIZE, CEILING_RADIANCE = (1.2, 0.6), 5.0


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Scene dictionary (metres, W m^-2 sr^-1) without sensor and integrator."""
    random = np.random.default_rng([61, params["shelf_seed"]])
    contrast, front = params["print_contrast"], -params["distance_m"]
    gap = random.uniform(-60, 90)
    left = books.row(-WIDTH_MM, gap - 90, TALLEST_MM, params["edition_share"], contrast, random)
    end = left[-1].left + left[-1].thick + 0.5
    left += books.leaning(end, TALLEST_MM, params["lean_deg"], contrast, random)
    stop = left[-1].left + left[-1].thick + 6
    right = books.row(stop + GAP_MM, WIDTH_MM, TALLEST_MM, params["edition_share"], contrast, random)
    lower = books.row(-WIDTH_MM, WIDTH_MM, LOWER_TALLEST_MM, params["edition_share"], contrast, random)
    lower = [replace(book, back=book.back + 8) for book in lower]
    below = BOARD_Y - PITCH
    return {
        "type": "scene",
        **books.meshes("row", left + right, BOARD_Y, front, TEXEL_MM, random),
        **books.meshes("lower", lower, below, front, LOWER_TEXEL_MM, random),
        **_case(front, random),
        **_globe((stop + GAP_MM / 2) * books.M_PER_MM, front - 0.036, random),
        **_lights(params["lamp_side"], front),
    }


def _case(front: float, random: np.random.Generator) -> dict[str, Any]:
    """Boards, back and uprights of stained oak."""
    grain = satin(wood((90, 2600), 5, 0.24, random), 0.3)
    half, back = WIDTH_MM * books.M_PER_MM + 0.02, front - BOARD_DEEP
    edge = front + 0.012
    case = {"back": box((-half, -0.5, back - 0.01), (half, 0.5, back), matte(0.20))}
    for number, y in enumerate((BOARD_Y + PITCH, BOARD_Y, BOARD_Y - PITCH)):
        case[f"board_{number}"] = box((-half, y - BOARD_THICK, back), (half, y, edge), grain)
    for number, x in enumerate((-half - 0.02, half)):
        case[f"upright_{number}"] = box((x, -0.5, back), (x + 0.02, 0.5, edge), matte(0.22))
    return case


def _globe(x: float, z: float, random: np.random.Generator) -> dict[str, Any]:
    """A desk globe in its half ring, on a turned foot."""
    tilt = np.radians(TILT_DEG)
    axis, across = np.array([np.sin(tilt), np.cos(tilt), 0.0]), np.array([np.cos(tilt), -np.sin(tilt), 0.0])
    toward = np.array([0.0, 0.0, 1.0])
    middle = np.array([x, BOARD_Y + GLOBE_HEIGHT, z])
    latitude = np.linspace(-np.pi / 2, np.pi / 2, 65)[:, None, None]
    turn = np.linspace(0, 2 * np.pi, 129)[None, :, None]
    ball = np.cos(latitude) * (np.cos(turn) * toward + np.sin(turn) * across) + np.sin(latitude) * axis
    # The ring goes from pole to pole round the left side, a bar of 2 mm by 5 mm.
    way = np.linspace(0, np.pi, 65)[:, None, None]
    out = np.cos(way) * axis - np.sin(way) * across
    rim = np.array([[0.0, -1.0], [1.0, -1.0], [1.0, 1.0], [0.0, 1.0], [0.0, -1.0]])
    ring = out * (GLOBE_RADIUS + 0.002 + 0.002 * rim[None, :, :1]) + 0.0025 * rim[None, :, 1:] * toward
    brass = satin(0.33, 0.25)
    return {
        "globe": swept("globe", GLOBE_RADIUS * ball + middle, satin(globe((512, 1024), random), 0.2)),
        "globe_ring": swept("globe_ring", ring + middle, brass),
        "globe_foot": swept("globe_foot", turned(FOOT, (x, BOARD_Y, z)), brass),
    }


def _lights(side: str, front: float) -> dict[str, Any]:
    """A reading lamp before the shelf on one side, and a ceiling light above the reader."""
    sign = {"left": -1.0, "right": 1.0}[side]
    towards = 0.0, 0.0, front
    return {
        "lamp": panel((0.62 * sign, 0.40, front + 0.80), towards, LAMP_SIZE, LAMP_RADIANCE),
        # The room's far walls and its floor give some of the light back.
        "room": box((-2.0, -1.0, front - 0.6), (2.0, 1.5, 1.6), matte(0.5)),
        "ceiling": panel((-0.3 * sign, 1.35, front + 0.95), towards, CEILING_SIZE, CEILING_RADIANCE),
    }
