"""Town houses with shops: walls with recessed windows, sills, frames, cornices, awnings; in metres.

A house stands on x = 0...width with its front at z = 0, looking towards +z, before it is put in its street.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from meshes import Body, Vector, box, quad, tube
from surfaces import Shape, lettering, noise

GROUND_FLOOR, STOREY, RECESS = 3.7, 3.05, 0.17
PANES, SIGNS = 12, 16  # pictures side by side: what is behind a window, what is above a shop


@dataclass
class Houses:
    """Bodies gathered by what they are made of."""

    plaster: list[list[Body]] = field(default_factory=lambda: [[] for _ in range(4)])
    matte: list[Body] = field(default_factory=list)
    glass: list[Body] = field(default_factory=list)
    signs: list[Body] = field(default_factory=list)

    def add(self, other: Houses, place: Vector, turn_deg: float) -> None:
        """Take in the parts of another, put in place."""
        for mine, new in zip(self.plaster, other.plaster, strict=True):
            mine += [b.moved(place, turn_deg) for b in new]
        for name in ("matte", "glass", "signs"):
            getattr(self, name).extend(b.moved(place, turn_deg) for b in getattr(other, name))


def house(width: float, storeys: int, wall: int, random: np.random.Generator, *, deep: float = 9.0) -> Houses:
    """One house of so many storeys above its shop, ``deep`` metres deep; ``wall`` chooses its surface."""
    made = Houses()
    bays = max(int(width / random.uniform(2.0, 2.7)), 2)
    pitch = width / bays
    frame = float(random.choice([0.65, 0.55, 0.12]))
    trim = float(random.uniform(0.35, 0.6))
    top = GROUND_FLOOR + storeys * STOREY
    _shop(made, width, wall, frame, random)
    for storey in range(storeys):
        low = GROUND_FLOOR + storey * STOREY
        sill, lintel = low + 0.75, low + 0.75 + (1.75 if storey < storeys - 1 else 1.45)
        wide = min(1.15, 0.55 * pitch)
        holes = [(pitch * (k + 0.5) - wide / 2, pitch * (k + 0.5) + wide / 2) for k in range(bays)]
        _pierced(made.plaster[wall], width, low, low + STOREY, [(a, b, sill, lintel) for a, b in holes])
        for a, b in holes:
            _window(made, a, b, sill, lintel, frame, trim, random)
        made.matte.append(box((0, low - 0.06, 0), (width, low + 0.08, 0.06), trim))
    made.matte.append(box((-0.1, top, -0.2), (width + 0.1, top + 0.35, 0.30), trim))
    made.matte.append(box((0, top, -deep), (width, top + 0.3, -0.2), 0.08))
    shut = [(0, 0, 0), (0, 0, -deep), (0, top, -deep), (0, top, 0)]
    made.plaster[wall].append(quad(*shut[::-1]))
    made.plaster[wall].append(quad(*[(width, y, z) for _, y, z in shut]))
    pipe = float(random.uniform(0.2, width - 0.2))
    made.matte.append(tube([(pipe, 0.1, 0.07), (pipe, 4.0, 0.07), (pipe, top, 0.07)], 0.05, around=8, tone=0.18))
    return made


def _pierced(walls: list[Body], width: float, low: float, high: float, holes: list[tuple[float, ...]]) -> None:
    """A strip of wall with one row of rectangular holes (left, right, sill, lintel), and their reveals."""
    sill, lintel = holes[0][2], holes[0][3]
    walls.append(_panel(0, width, low, sill))
    walls.append(_panel(0, width, lintel, high))
    edges = [0.0, *[x for a, b, *_ in holes for x in (a, b)], width]
    walls += [_panel(a, b, sill, lintel) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    for a, b, *_ in holes:
        near = [(a, sill, 0), (b, sill, 0), (b, lintel, 0), (a, lintel, 0)]
        far = [(x, y, -RECESS) for x, y, _ in near]
        walls += [quad(near[k], near[(k + 1) % 4], far[(k + 1) % 4], far[k]) for k in range(4)]


def _panel(a: float, b: float, low: float, high: float) -> Body:
    return quad((a, low, 0), (b, low, 0), (b, high, 0), (a, high, 0))


def _window(
    made: Houses, a: float, b: float, low: float, high: float, frame: float, trim: float,
    random: np.random.Generator,
) -> None:  # fmt: skip
    made.glass.append(_pane(a, b, low, high, -RECESS, int(random.integers(PANES - 3))))
    middle, cross = (a + b) / 2, low + 0.68 * (high - low)
    bars = [(a, a + 0.07, low, high), (b - 0.07, b, low, high), (middle - 0.045, middle + 0.045, low, high)]
    bars += [(a, b, low, low + 0.08), (a, b, high - 0.07, high), (a, b, cross - 0.035, cross + 0.035)]
    z = -RECESS + 0.04
    made.matte += [quad((p, s, z), (q, s, z), (q, t, z), (p, t, z), tone=frame) for p, q, s, t in bars]
    made.matte.append(box((a - 0.08, low - 0.09, -RECESS), (b + 0.08, low, 0.11), trim))
    made.matte.append(box((a - 0.05, high, -0.02), (b + 0.05, high + 0.14, 0.05), trim))


def _pane(a: float, b: float, low: float, high: float, z: float, picture: int) -> Body:
    """Glass; ``picture`` of :func:`behind_glass` is seen in it."""
    u0, u1 = (picture + 0.02) / PANES, (picture + 0.98) / PANES
    uv = [(u0, 0), (u1, 0), (u1, 1), (u0, 1)]
    return quad((a, low, z), (b, low, z), (b, high, z), (a, high, z), uv=uv)


def _shop(made: Houses, width: float, wall: int, frame: float, random: np.random.Generator) -> None:
    """Ground floor: wide windows on a plinth, a door, a sign, on some an awning."""
    door = float(random.uniform(0.25, 0.75)) * width
    stops = [0.4, door - 0.55, door + 0.55, width - 0.4]
    plinth = float(random.uniform(0.06, 0.30))
    made.matte += [box((x, 0, -0.25), (x + 0.4, 3.05, 0.05), plinth) for x in (0.0, width - 0.4)]
    for a, b in ((stops[0], stops[1]), (stops[2], stops[3])):
        panes = max(int((b - a) / 1.7), 1)
        step = (b - a) / panes
        made.matte.append(box((a, 0, -0.25), (b, 0.55, 0.02), plinth))
        for k in range(panes):
            left = a + k * step
            picture = PANES - 1 - int(random.integers(3))
            made.glass.append(_pane(left, left + step, 0.55, 3.0, -0.12, picture))
            made.matte.append(box((left - 0.04, 0.55, -0.14), (left + 0.04, 3.0, 0.0), frame))
    made.glass.append(_pane(stops[1] + 0.1, stops[2] - 0.1, 0.3, 2.2, -0.45, PANES - 1))
    made.matte.append(
        quad(
            *[(x, y, -0.5) for x, y in ((stops[1], 0), (stops[2], 0), (stops[2], 3.0), (stops[1], 3.0))],
            tone=frame * 0.6,
        )
    )
    number = int(random.integers(SIGNS))
    u0, u1 = number / SIGNS, (number + 1) / SIGNS
    long = min(width - 0.6, 6.5)
    left = float(random.uniform(0.3, width - 0.3 - long)) if width - 0.6 > long else 0.3
    face = [(left, 3.05, 0.10), (left + long, 3.05, 0.10), (left + long, 3.65, 0.10), (left, 3.65, 0.10)]
    made.signs.append(quad(*face, uv=[(0, u0), (1, u0), (1, u1), (0, u1)]))
    made.matte.append(box((left, 3.05, -0.1), (left + long, 3.65, 0.09), 0.1))
    made.plaster[wall].append(_panel(0, width, 3.0, GROUND_FLOOR))
    if random.random() < 0.5:
        _awning(made, stops[0] - 0.2, stops[1] + 0.1, random)


def _awning(made: Houses, a: float, b: float, random: np.random.Generator) -> None:
    """Striped canvas, leaning out over the pavement."""
    light, dark = 0.62, float(random.choice([0.08, 0.15, 0.25]))
    stripes = max(int((b - a) / 0.28), 2)
    x = np.linspace(a, b, stripes + 1)
    for k in range(stripes):
        tone = (light, dark)[k % 2]
        p, q = x[k], x[k + 1]
        made.matte.append(quad((p, 2.45, 1.25), (q, 2.45, 1.25), (q, 3.05, 0.12), (p, 3.05, 0.12), tone=tone))
        made.matte.append(quad((p, 2.22, 1.27), (q, 2.22, 1.27), (q, 2.45, 1.25), (p, 2.45, 1.25), tone=tone))


def behind_glass(random: np.random.Generator) -> np.ndarray:
    """Windows side by side: dark rooms, curtains, blinds; the last three are shops with goods."""
    high, wide = 96, 64
    rooms = []
    for k in range(PANES):
        room = 0.02 + 0.02 * np.abs(noise((high, wide), (3, 2), random))
        x = np.abs(np.linspace(-1, 1, wide))[None, :] * np.ones((high, 1), dtype=np.float32)
        y = np.linspace(0, 1, high)[:, None]
        if k >= PANES - 3:
            for _ in range(14):
                r, c = int(random.integers(20, high - 6)), int(random.integers(0, wide - 10))
                room[r : r + int(random.integers(5, 30)), c : c + int(random.integers(3, 10))] = random.uniform(
                    0.02, 0.28
                )
            room[int(0.92 * high) :] = 0.25
        elif k % 3 == 0:
            folds = 0.34 + 0.12 * np.sin(34 * x + 3 * k)
            drawn = x > random.uniform(0.25, 0.75)
            room[drawn] = folds[drawn]
        elif k % 3 == 1:
            down = np.broadcast_to(y < random.uniform(0.15, 0.9), room.shape)
            slats = np.broadcast_to(0.30 + 0.18 * (np.floor(y * 26) % 2), room.shape)
            room[down] = slats[down]
        rooms.append(room)
    return np.concatenate(rooms, axis=1).astype(np.float32)


def shop_signs(random: np.random.Generator) -> np.ndarray:
    """Signs one above the other, each 6.5 m × 0.6 m when laid on."""
    shape: Shape = (40, 433)
    tones = [(0.05, 0.7), (0.6, 0.05), (0.15, 0.75), (0.35, 0.04)]
    rows = []
    for k in range(SIGNS):
        ground, ink = tones[k % len(tones)]
        rows.append(lettering(shape, random, ground=ground, ink=ink))
    return np.concatenate(rows)
