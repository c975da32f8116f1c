"""A neon sign on a dark brick front at night, another farther back along the passage beside it.

World frame: metres, x right, y up, z towards the lens, which stands at the origin and looks along -z.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from letters import PITCH, lines
from solids import Body, box, grid, joined, placed, turning
from surfaces import cloudy, glossy, matte, mesh, noise, panel, texture

TUBES, FAR_TUBES = 48, 20  # of the sign, of the far one
RADIUS, STANDS_OFF = 0.0075, 0.045  # of a tube, and from the board to its middle
BOARD, BORDER = (0.60, 0.31), (0.275, 0.135)
HEIGHT, LONG = 0.115, 0.40  # of the letters; of a word at most
WALL_BACK, FAR_BACK, CORNER = 0.06, 2.2, 0.34  # behind the board; the far wall; where the front ends
COLOURS = {"red": 8.0, "blue": 7.0, "green": 10.0, "white": 9.0}  # W m^-2 sr^-1
STREET, SKY = 4.0, 0.005  # W m^-2 sr^-1


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Scene dictionary (metres, W m^-2 sr^-1) without sensor and integrator."""
    random = np.random.default_rng([1910, int(params["seed"])])
    side = 1 if params["passage"] == "right" else -1
    turn = turning([0, 1, 0], params["yaw_deg"])
    at = np.array([-0.14 * side, 0.0, -params["distance_m"]])
    word, border = COLOURS[str(params["word_colour"])], COLOURS[str(params["border_colour"])]
    scene: dict[str, Any] = {}
    pieces = _pieces(str(params["word"]))
    rest = TUBES - len(pieces)
    pieces += _loop(rest, BORDER, str(params["border"]))
    for k, (start, stop) in enumerate(pieces):
        bright = (border if k >= TUBES - rest else word) * params["glow"]
        scene[f"tube_{k}"] = _tube(start, stop, turn, at, bright)
    back = turning([0, 1, 0], -20.0 * side)
    far = np.array([0.46 * side, random.uniform(-0.12, 0.12), at[2] - FAR_BACK])
    beyond = float(random.choice([8.0, 10.0]))
    for k, (start, stop) in enumerate(_loop(FAR_TUBES, (0.13, 0.19), str(random.choice(["star", "oval"])))):
        scene[f"far_{k}"] = _tube(start, stop, back, far, beyond)
    return scene | _front(params, side, turn, at, random) | _lights(params, at)


def _pieces(text: str) -> list[tuple[np.ndarray, np.ndarray]]:
    """The straight tubes of a word, two coordinates each."""
    return lines(text, min(HEIGHT, 6 * LONG / (PITCH * (len(text) - 1) + 4)), (0.0, 0.0))


def _loop(count: int, size: tuple[float, float], kind: str) -> list[tuple[np.ndarray, np.ndarray]]:
    """A closed loop of so many straight tubes: a rounded frame, an oval, a star."""
    a = np.linspace(0, 2 * np.pi, count + 1)
    c, s = np.cos(a), np.sin(a)
    if kind == "frame":
        c, s = (np.sign(v) * np.abs(v) ** 0.45 for v in (c, s))
    if kind == "star":
        c, s = (v * np.where(np.arange(count + 1) % 4 < 2, 1.0, 0.55) for v in (c, s))
    points = np.stack([size[0] * c, size[1] * s], axis=1)
    return [(points[k], points[k + 1]) for k in range(count)]


def _tube(
    start: np.ndarray, stop: np.ndarray, turn: np.ndarray, at: np.ndarray, bright: float
) -> dict[str, Any]:
    """A lit cylinder before the board, a little longer than its piece, so that bends are closed."""
    more = 0.5 * RADIUS * (stop - start) / np.linalg.norm(stop - start)
    ends = [turn @ [*p, STANDS_OFF] + at for p in (start - more, stop + more)]
    return {
        "type": "cylinder",
        "p0": ends[0].tolist(),
        "p1": ends[1].tolist(),
        "radius": RADIUS,
        "bsdf": {"type": "diffuse", "reflectance": 0.3},
        "emitter": {"type": "area", "radiance": float(bright)},
    }


def _front(
    params: dict[str, Any], side: int, turn: np.ndarray, at: np.ndarray, random: np.random.Generator
) -> dict[str, Any]:
    """The board, the brick front that ends at a corner, and the far wall of the passage."""
    w, h = BOARD
    board = placed(_upright((-w / 2, -h / 2), (w / 2, h / 2), (1, 1)), at, turn=turn)
    low, high = sorted((-2.0 * side, CORNER * side))
    tile = texture(_bricks(float(params["brick"]), random), repeat=(1, 1))
    front = placed(_upright((low, -1.2), (high, 1.2), (0.6, 0.6)), at - np.array([0, 0, WALL_BACK]))
    frame = box((-w / 2 - 0.01, -h / 2 - 0.01, -0.03), (w / 2 + 0.01, h / 2 + 0.01, -0.004))
    edge = sorted((CORNER * side - 0.05 * side, CORNER * side))
    corner = box((edge[0], -1.2, -WALL_BACK - 0.5), (edge[1], 1.2, -WALL_BACK - 0.001))
    rim = joined([placed(frame, at, turn=turn), placed(corner, at)])
    far = placed(_upright((-2.5, -1.8), (2.5, 1.8), (0.6, 0.6)), at - np.array([0, 0, FAR_BACK + 0.08]))
    return {
        "board": mesh("board", board, glossy(texture(_enamel(float(params["board"]), random)), 0.25)),
        "front": mesh("front", front, matte(tile)),
        "rim": mesh("rim", rim, matte(0.05), smooth=False),
        "far_wall": mesh("far_wall", far, matte(tile)),
    }


def _upright(low: tuple[float, float], high: tuple[float, float], tile: tuple[float, float]) -> Body:
    """A rectangle that faces the lens; a tile of so many metres is one repeat, (1, 1) the whole of it."""
    body = grid([[(low[0], low[1], 0), (high[0], low[1], 0)], [(low[0], high[1], 0), (high[0], high[1], 0)]])
    return body if tile == (1, 1) else body._replace(uv=body.vertices[:, :2] / tile)


def _enamel(tone: float, random: np.random.Generator) -> np.ndarray:
    """An enamelled board, weathered: streaks that run down, chips, a painted line inside its edge."""
    rows, columns = 310, 600
    grey = tone * (1 + 0.12 * cloudy((rows, columns), 9, 4, random))
    grey *= 1 - 0.35 * np.clip(noise((rows, columns), (2, 90), random), 0, 1)
    y, x = np.mgrid[0:rows, 0:columns]
    edge = np.minimum(np.minimum(x, columns - 1 - x), np.minimum(y, rows - 1 - y))
    grey[(edge > 6) & (edge < 10)] = 0.5
    chips = noise((rows, columns), (60, 110), random) + 0.6 * noise((rows, columns), (20, 40), random)
    grey[chips > 1.05] = 0.04
    return np.clip(grey, 0.02, 0.7)


def _bricks(tone: float, random: np.random.Generator) -> np.ndarray:
    """A tile of 0.6 m: eight courses of stretchers, each of its own tone, in mortar; it repeats."""
    n, course, brick = 640, 80, 213
    y, x = np.mgrid[0:n, 0:n].astype(np.float32)
    row = (y // course).astype(int)
    along = np.mod(x + (row % 2) * brick / 2, n)
    column = np.minimum(along // brick, 2).astype(int)
    u, v = along - column * brick, y - row * course
    grey = tone * random.uniform(0.6, 1.3, (8, 3))[row, column]
    grey = grey * (1 + 0.3 * noise((n, n), (n / 4, n / 4), random))
    mortar = (np.minimum(u, brick - u) < 5) | (np.minimum(v, course - v) < 5)
    grey = np.where(mortar, 1.7 * tone, grey)
    return np.clip(grey, 0.015, 0.6).astype(np.float32)


def _lights(params: dict[str, Any], at: np.ndarray) -> dict[str, Any]:
    lamp = at + np.array([1.4 * np.sign(params["street_side"]), 2.2, 2.6])
    return {
        "street": panel(lamp, at, (0.8, 0.8), STREET),
        "sky": {"type": "constant", "radiance": SKY},
    }
