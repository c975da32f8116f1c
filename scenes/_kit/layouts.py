"""Where things stand, in pixels of the sensor and half depths of focus from the middle of the target."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from sight import FRAME_PX, Sight
from solids import Body, ball, box, grid, joined, placed, tube, turned, turning

RIM_PX = 4  # between a target and the rim of the frame
MAX_ROUND = 5.0  # half depths of focus that the front of a round body spans; a deeper one is flattened
MAX_TILT, MAX_HILL = np.tan(np.radians(62)), 1.0  # steepest slopes of a board and of a relief
ROLLED, MAX_ROLL = (
    ("flat", "slanted", "relief", "cluttered"),
    35.0,
)  # boards that are turned in the picture, degrees
CELLS = 64  # of a target's grid, across and down
NEAREST = 0.5  # of the target's distance: how near to the lens anything stands


class Target(NamedTuple):
    """A target: points in pixels and half depths of focus, texture coordinates and a box in pixels.

    ``narrowed`` is the direction in which the lens sees the texture narrowed, and the factor; ``notch``
    is a missing corner, a boolean for each cell of the grid.
    """

    x: np.ndarray
    y: np.ndarray
    halves: np.ndarray
    s: np.ndarray
    t: np.ndarray
    narrowed: tuple[float, float]
    centre: tuple[float, float]
    size: tuple[float, float]
    notch: np.ndarray

    @property
    def reach(self) -> float:
        """Side of the square of texture that the target shows, pixels."""
        return 2.04 * float(max(np.abs(self.s).max(), np.abs(self.t).max()))

    @property
    def seen(self) -> np.ndarray:
        """How much of the picture belongs to each point, square pixels."""
        return np.abs(np.gradient(self.x, axis=1) * np.gradient(self.y, axis=0)) + 1e-9

    @property
    def depth(self) -> float:
        """Half depths of focus between the 2nd and the 98th hundredth of it as the lens sees it."""
        order = np.argsort(self.halves.ravel())
        share = np.cumsum(self.seen.ravel()[order]) / self.seen.sum()
        low, high = np.interp((0.02, 0.98), share, self.halves.ravel()[order])
        return float(high - low)

    def body(self, sight: Sight) -> Body:
        """The target as a body, in mm."""
        uv = np.stack([self.s, self.t], axis=-1) / self.reach + 0.5
        whole = grid(sight.at(self.x + self.centre[0], self.y + self.centre[1], self.halves), uv=uv)
        return whole._replace(triangles=whole.triangles[~np.tile(self.notch.ravel(), 2)])


def target(params: dict[str, Any], sight: Sight, random: np.random.Generator) -> Target:
    """A board, a relief, the front of a ball or column, in a box at least as wide as two largest blurs."""
    form, most = params["form"], FRAME_PX - 2 * RIM_PX
    least = 2.0 * max(sight.place, 1 - sight.place) * sight.travel + 3
    side = least + params["size"] * (0.92 * most - least)
    wide, high = (float(min(side * k, most)) for k in random.permutation([1.0, random.uniform(1, 1.35)]))
    if form == "ball":
        wide = high = float(side)
    board, roll = (wide, high), 0.0
    if form in ROLLED:
        roll = np.radians(random.uniform(-MAX_ROLL, MAX_ROLL))
        c, s = np.cos(roll), abs(np.sin(roll))
        boxed = np.array([wide * c + high * s, wide * s + high * c])
        scale = max(wide, high) / boxed[int(high > wide)]
        board, (wide, high) = (scale * wide, scale * high), (float(n) for n in scale * boxed)
    centre = tuple(float(random.uniform(-1, 1) * (FRAME_PX / 2 - RIM_PX - n / 2)) for n in (wide, high))
    u, v = np.meshgrid(np.linspace(-0.5, 0.5, CELLS + 1), np.linspace(-0.5, 0.5, CELLS + 1))
    half_px, narrowed = sight.half / sight.pixel, (0.0, 1.0)
    notch = np.zeros((CELLS, CELLS), dtype=bool)
    if form == "ball":
        a, e, r = np.pi * u, np.pi * v, side / 2
        x, y, z = r * np.sin(a) * np.cos(e), r * np.sin(e), -r * np.cos(a) * np.cos(e)
        s, t = r * a * np.cos(e), r * e
    elif form == "column":
        knots = random.uniform(0.55, 1.0, 5)
        knots[random.integers(5)] = 1.0
        r = 0.5 * wide * _smooth(knots, v[:, 0])[:, None]
        a = np.pi * u
        x, y, z = r * np.sin(a), high * v, -r * np.cos(a)
        s, t = r * a, high * v
    else:
        x, y = board[0] * u, board[1] * v
        angle = random.uniform(0, 2 * np.pi)
        along, aside = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
        slope = float(np.tan(np.radians(random.uniform(0, 4))))
        if form == "slanted":
            slope = float(min(params["depth"] * half_px / np.ptp(along), MAX_TILT))
        z, along, narrowed = slope * along, along * np.hypot(1, slope), (angle, float(1 / np.hypot(1, slope)))
        s, t = along * np.cos(angle) - aside * np.sin(angle), along * np.sin(angle) + aside * np.cos(angle)
        if form == "relief":
            hills = _hills(x, y, random)
            hills *= params["depth"] * half_px / np.ptp(hills)
            slopes = np.hypot(*np.gradient(hills, board[1] / CELLS, board[0] / CELLS))
            z = z + hills * min(MAX_HILL / float(slopes.max()), 1.0)
        if form == "two_depths" and random.random() < 0.5:
            notch = (u[1:, 1:] > 0.5 - random.uniform(0.35, 0.55)) & (
                v[1:, 1:] > 0.5 - random.uniform(0.35, 0.55)
            )
            notch = notch[:: random.choice([-1, 1]), :: random.choice([-1, 1])]
        x, y = x * np.cos(roll) - y * np.sin(roll), x * np.sin(roll) + y * np.cos(roll)
    halves = z / half_px
    if form in ("ball", "column"):
        halves *= min(MAX_ROUND / (0.9 * float(np.ptp(halves))), 1.0)
    made = Target(x, y, halves, s, t, narrowed, centre, (wide, high), notch)
    return made._replace(halves=halves - float(np.average(halves, weights=made.seen)))


def _smooth(knots: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Values at -0.5..0.5 of a smooth curve through evenly spaced knots."""
    place = (at + 0.5) * (len(knots) - 1)
    first = np.minimum(place.astype(int), len(knots) - 2)
    part = place - first
    return knots[first] + (knots[first + 1] - knots[first]) * part * part * (3 - 2 * part)


def _hills(x: np.ndarray, y: np.ndarray, random: np.random.Generator) -> np.ndarray:
    total = np.zeros_like(x)
    for length in random.uniform(35, 120, 5):
        angle, phase = random.uniform(0, 2 * np.pi, 2)
        total += length * np.sin(2 * np.pi * (x * np.cos(angle) + y * np.sin(angle)) / length + phase)
    return total


class Others(NamedTuple):
    """What is not the target, in mm, and the share of the target's box that something hides."""

    second: Body
    clutter: Body
    things: Body
    hidden: float


def others(params: dict[str, Any], sight: Sight, made: Target, random: np.random.Generator) -> Others:
    """A second board at another depth in the target's box, things in front of it, and things behind it."""
    hidden = np.zeros((FRAME_PX, FRAME_PX), dtype=bool)
    second = clutter = _nothing(sight, params)
    if params["form"] == "two_depths":
        second = _second(sight, made, hidden, random)
    if params["form"] == "cluttered":
        clutter = joined([_in_front(sight, made, hidden, random) for _ in range(random.integers(2, 6))])
    behind = [_behind(params, sight, random) for _ in range(int(params["things"]))]
    mine = _box(made)
    return Others(
        second, clutter, joined(behind) if behind else _nothing(sight, params), float(hidden[mine].mean())
    )


def _second(sight: Sight, made: Target, hidden: np.ndarray, random: np.random.Generator) -> Body:
    """A board: behind the missing corner of the target, or before a corner of it."""
    (cx, cy), (wide, high) = made.centre, made.size
    away, angle = random.uniform(1.5, 8), random.uniform(-0.3, 0.3)
    if made.notch.any():
        x, y, w, h = cx, cy, 1.25 * wide, 1.25 * high
        hidden[_box(made)] |= _enlarged(made.notch, hidden[_box(made)].shape)
    else:
        away = -min(away, (1 - NEAREST) * sight.focused / sight.half)
        w, h = wide * random.uniform(0.4, 0.6), high * random.uniform(0.4, 0.6)
        x, y = (c + random.choice([-1, 1]) * (n - m) / 2 for c, n, m in ((cx, wide, w), (cy, high, h)))
        hidden[_box(made._replace(centre=(x, y), size=(w, h)))] = True
    u, v = np.meshgrid([-w / 2, w / 2], [-h / 2, h / 2])
    if away > 0:
        u, v = u * np.cos(angle) - v * np.sin(angle), u * np.sin(angle) + v * np.cos(angle)
    return grid(sight.at(x + u, y + v, away))


def _enlarged(cells: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    rows, columns = (np.arange(n) * CELLS // n for n in shape)
    return cells[rows][:, columns]


def _in_front(sight: Sight, made: Target, hidden: np.ndarray, random: np.random.Generator) -> Body:
    """A ball or a twig, nearer to the lens than the target."""
    away = -min(random.uniform(2, 12), (1 - NEAREST) * sight.focused / sight.half)
    x, y = (c + random.uniform(-0.55, 0.55) * n for c, n in zip(made.centre, made.size, strict=True))
    rows, columns = np.mgrid[0:FRAME_PX, 0:FRAME_PX] - FRAME_PX / 2 + 0.5
    if random.random() < 0.4:
        radius = random.uniform(3, 13)
        hidden |= np.hypot(columns - x, rows - y) < radius
        return ball(sight.at(x, y, away), radius * float(sight.scale(away)), rings=24, around=48)
    angle, radius, long = random.uniform(0, np.pi), random.uniform(1, 4), random.uniform(25, 120)
    across = -(columns - x) * np.sin(angle) + (rows - y) * np.cos(angle)
    along = (columns - x) * np.cos(angle) + (rows - y) * np.sin(angle)
    hidden |= (np.abs(across) < radius) & (np.abs(along) < long / 2)
    steps = np.linspace(-0.5, 0.5, 9) * long
    bend = random.uniform(-0.1, 0.1) * long * (1 - (2 * steps / long) ** 2)
    path = sight.at(
        x + steps * np.cos(angle) - bend * np.sin(angle),
        y + steps * np.sin(angle) + bend * np.cos(angle),
        away,
    )
    return tube(path, radius * float(sight.scale(away)), around=16)


def _behind(params: dict[str, Any], sight: Sight, random: np.random.Generator) -> Body:
    """A ball, a box or a column anywhere in the frame, between the target and the wall."""
    wall = wall_halves(params, sight)
    away = random.uniform(0.25, 0.85) * wall
    x, y = random.uniform(-60, 60, 2)
    room = 0.8 * min(away, wall - away) * sight.half / float(sight.scale(away))
    radius = min(random.uniform(8, 28), max(room, 2.0))
    scale, turn = float(sight.scale(away)), turning(random.normal(size=3), random.uniform(0, 360))
    kind = random.integers(3)
    if kind == 0:
        made = ball((0, 0, 0), radius, rings=24, around=48)
    elif kind == 1:
        made = box((-0.6 * radius,) * 3, (0.6 * radius,) * 3)
    else:
        made = turned(
            [
                (0.0, -0.8 * radius),
                (0.55 * radius, -0.8 * radius),
                (0.55 * radius, 0.8 * radius),
                (0.0, 0.8 * radius),
            ],
            around=48,
        )
    return placed(made, sight.at(x, y, away), turn=turn, scale=scale)


def wall_halves(params: dict[str, Any], sight: Sight) -> float:
    """Half depths of focus from the target to the wall, at most as far as from the target to the lens."""
    return float(min(params["wall"], sight.focused / sight.half))


def wall(params: dict[str, Any], sight: Sight) -> tuple[Body, float]:
    """A wall wider than the frame and any blur, and its width in pixels."""
    away = wall_halves(params, sight)
    wide = 1.1 * (FRAME_PX + sight.travel + away) + 20
    u, v = np.meshgrid([-wide / 2, wide / 2], [-wide / 2, wide / 2])
    return grid(sight.at(u, v, away)), wide


def _nothing(sight: Sight, params: dict[str, Any]) -> Body:
    """A small box behind the wall: every member has the same parts, so that kernels are compiled once."""
    place = sight.at(0, 0, wall_halves(params, sight) + 2)
    return box(place - 0.1 * sight.pixel, place + 0.1 * sight.pixel)


def _box(made: Target) -> tuple[slice, slice]:
    """Rows and columns of a box in a picture whose row 0 is the lowest."""
    (cx, cy), (wide, high) = made.centre, made.size
    return tuple(
        slice(max(round(FRAME_PX / 2 + c - n / 2), 0), max(round(FRAME_PX / 2 + c + n / 2), 1))
        for c, n in ((cy, high), (cx, wide))
    )
