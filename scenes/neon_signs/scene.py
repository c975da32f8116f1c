"""A neon sign on a damp brick front at night, another farther back along the passage beside it.

World frame: metres, x right, y up, z towards the lens, which stands at the origin and looks along -z.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import tubes
import walls
from solids import Body, box, grid, joined, placed, rounded, tube, turned, turning
from surfaces import cloudy, glossy, matte, mesh, panel, texture, tones

TUBES, FAR_TUBES = 168, 56  # lit pieces of the sign, of the far one
BOARD, BORDER, FAR = (0.62, 0.33), (0.285, 0.143), (0.13, 0.19)
HEIGHT, LONG, LIFT = 0.118, 0.42, 0.018  # of the letters; of a word at most; of its middle
WALL_BACK, FAR_BACK, CORNER = 0.075, 2.2, 0.38  # behind the board; the far wall; where the front ends
COLOURS = {"red": 5.0, "blue": 4.0, "green": 6.0, "white": 5.5}  # W m^-2 sr^-1
STREET, SKY = 24.0, 0.02  # W m^-2 sr^-1


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Scene dictionary (metres, W m^-2 sr^-1) without sensor and integrator."""
    random = np.random.default_rng([1923, int(params["seed"])])
    side = 1 if params["passage"] == "right" else -1
    turn = turning([0, 1, 0], params["yaw_deg"])
    at = np.array([-0.13 * side, 0.0, -params["distance_m"]])
    text, glow = str(params["word"]), float(params["glow"])
    height = min(HEIGHT, 6 * LONG / (tubes.PITCH * (len(text) - 1) + 4))
    letters = [path + np.array([0, LIFT]) for path in tubes.word(text, height, float(params["slant"]))]
    border = tubes.loop(BORDER, str(params["border"]))
    scene: dict[str, Any] = {}
    for k, piece in enumerate(tubes.cut(letters + border, TUBES, random)):
        colour = "border_colour" if piece.path >= len(letters) else "word_colour"
        scene[f"tube_{k}"] = tubes.lit(piece, turn, at, COLOURS[str(params[colour])] * glow)
    back = turning([0, 1, 0], -20.0 * side)
    far = np.array([0.49 * side, random.uniform(-0.12, 0.12), at[2] - FAR_BACK])
    beyond = float(random.choice([4.5, 6.0]))
    shape = tubes.loop(FAR, str(random.choice(["star", "oval"])))
    for k, piece in enumerate(tubes.cut(shape, FAR_TUBES, random)):
        scene[f"far_{k}"] = tubes.lit(piece, back, far, beyond)
    outlet = np.array([0.20, -BOARD[1] / 2 + 0.012])
    held = tubes.fittings(letters, outlet, random) + tubes.fittings(border, outlet - np.array([0.1, 0]), random)
    scene["fittings"] = mesh("fittings", placed(joined(held), at, turn=turn), coated(0.25))
    held = tubes.fittings(shape, np.array([0.0, -0.25]), random)
    scene["far_fittings"] = mesh("far_fittings", placed(joined(held), far, turn=back), coated(0.25))
    enamel = walls.board(BOARD, float(params["board"]), text, letters, random)
    return scene | _front(params, side, turn, at, enamel, random) | _lights(params, at)


def coated(roughness: float) -> dict[str, Any]:
    """The tones of a mesh below a coat: painted glass, rubber, sheet metal."""
    coat = {"type": "principled", "base_color": tones(), "roughness": roughness, "specular": 0.5}
    return {"type": "twosided", "bsdf": coat}


def _front(
    params: dict[str, Any], side: int, turn: np.ndarray, at: np.ndarray, enamel: np.ndarray, random: np.random.Generator
) -> dict[str, Any]:
    """The board in its case, the brick front that ends at a corner, and the far wall of the passage."""
    w, h = BOARD
    board = grid([[(-w / 2, -h / 2, 0), (w / 2, -h / 2, 0)], [(-w / 2, h / 2, 0), (w / 2, h / 2, 0)]])
    low, high = sorted((-2.0 * side, CORNER * side))
    brick = walls.brickwork(float(params["brick"]), random)
    wall = at - np.array([0, 0, WALL_BACK])
    front = placed(_upright((low, -1.2), (high, 1.2)), wall)
    reveal = _upright((0, -1.2), (1.2, 1.2))
    reveal = placed(reveal, wall + np.array([CORNER * side, 0, 0]), turn=turning([0, 1, 0], 90.0))
    far = placed(_upright((-2.5, -1.8), (2.5, 1.8)), at - np.array([0, 0, FAR_BACK + 0.05]))
    case = placed(joined(_case(random)), at, turn=turn)
    pipes = placed(joined(_pipes()), wall)
    return {
        "board": mesh("board", placed(board, at, turn=turn), glossy(texture(enamel), 0.14), smooth=False),
        "case": mesh("case", case._replace(tone=_rusty(case, random)), coated(0.35)),
        "pipes": mesh("pipes", pipes._replace(tone=_rusty(pipes, random)), coated(0.35)),
        "front": mesh("front", front, brick, smooth=False),
        "reveal": mesh("reveal", reveal, brick, smooth=False),
        "far_wall": mesh("far_wall", far, brick, smooth=False),
        "behind": mesh("behind", placed(box((-3, -2, -0.3), (3, 2, 0), tone=0.02), far_end(at)), matte(0.02)),
    }


def far_end(at: np.ndarray) -> np.ndarray:
    """Behind everything, so that no sky is seen past the far wall."""
    return at - np.array([0, 0, FAR_BACK + 0.6])


def _upright(low: tuple[float, float], high: tuple[float, float]) -> Body:
    """A rectangle that faces the lens, with one repeat of the brickwork every TILE metres."""
    body = grid([[(low[0], low[1], 0), (high[0], low[1], 0)], [(low[0], high[1], 0), (high[0], high[1], 0)]])
    return body._replace(uv=body.vertices[:, :2] / walls.TILE)


def _case(random: np.random.Generator) -> list[Body]:
    """A sheet-metal case round the board: a bead along its edge, sides, screws, brackets."""
    w, h = BOARD[0] / 2, BOARD[1] / 2
    corners = np.array([(0, -h), (w, -h), (w, h), (-w, h), (-w, -h), (0, -h)])
    ring = tubes.bent(corners, np.full(6, 0.02))
    bead = [tube(np.column_stack([ring, np.full(len(ring), 0.002)]), 0.0055, around=12, tone=0.16)]
    sides = [box((-w, -h, -0.055), (w, h, -0.003), tone=0.07)]
    for x in np.linspace(-w + 0.02, w - 0.02, 7):
        for y in (-h + 0.0035, h - 0.0035):
            screw = turned([(0.0035, 0), (0.003, 0.0018), (0.0, 0.0024)], around=14, tone=0.22)
            bead.append(placed(screw, (x + random.normal(0, 0.001), y, 0.006), turn=turning([1, 0, 0], 90)))
    for x in (-0.2, 0.2):
        sides.append(box((x - 0.015, -h - 0.05, -0.074), (x + 0.015, h + 0.05, -0.055), tone=0.12))
    return bead + sides


def _pipes() -> list[Body]:
    """On the wall: a transformer in its box, conduit to the board and away, saddles."""
    low, x = -BOARD[1] / 2, 0.18
    made = [
        box((x - 0.085, low - 0.165, 0), (x + 0.085, low - 0.07, 0.065), tone=0.10),
        box((x - 0.088, low - 0.168, 0.060), (x + 0.088, low - 0.067, 0.068), tone=0.13),
        tube(rounded([(x, low - 0.07, 0.03), (x, low - 0.03, 0.03), (x, low + 0.03, 0.03)]), 0.010, tone=0.14),
        tube([(x - 0.085, low - 0.125, 0.014), (-1.5, low - 0.125, 0.014)], 0.010, around=16, tone=0.14),
    ]
    for k in range(4):
        a = x - 0.17 - 0.21 * k
        made.append(box((a, low - 0.139, 0), (a + 0.016, low - 0.111, 0.026), tone=0.17))
    for a in (-0.07, 0.07):
        screw = turned([(0.005, 0), (0.004, 0.002), (0.0, 0.003)], around=14, tone=0.25)
        made += [placed(screw, (x + a, low - y, 0.068), turn=turning([1, 0, 0], 90)) for y in (0.085, 0.15)]
    return made


def _rusty(body: Body, random: np.random.Generator) -> np.ndarray:
    """Tones with blotches, as of old paint on steel."""
    lump = cloudy((256, 256), 12, 5, random)
    at = np.mod((body.vertices[:, [0, 1]] * 330).astype(int), 256)
    return np.clip(body.tone * (1 + 0.5 * lump[at[:, 1], at[:, 0]]), 0.015, 0.5)


def _lights(params: dict[str, Any], at: np.ndarray) -> dict[str, Any]:
    lamp = at + np.array([2.0 * np.sign(params["street_side"]), 2.6, 1.9])
    made = {
        "street": panel(lamp, at, (0.8, 0.8), STREET),
        "sky": {"type": "constant", "radiance": SKY, "sampling_weight": 10.0},
    }
    made["street"]["emitter"]["sampling_weight"] = 60.0  # one lamp among 224 tubes
    return made
