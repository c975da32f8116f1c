"""Bodies of the parts: flat pack, its leads, chips, solder; millimetres, the board is z = 0."""

from __future__ import annotations

import numpy as np
from layout import BODY_MM, LEAD_MM, Chip, Layout
from solids import Body, box, grid, joined, placed, turning

PACK_MM = (0.12, 0.95)  # underside and top of the flat pack


def pack(ic: np.ndarray) -> Body:
    """The moulded body, its sides drawn in towards top and bottom; its picture is seen from above."""
    low, high = PACK_MM
    middle = (low + high) / 2
    rings = [(BODY_MM - 0.14, low), (BODY_MM, middle - 0.05), (BODY_MM, middle + 0.05), (BODY_MM - 0.12, high - 0.02)]
    rings += [(BODY_MM - 0.15, high), (0.001, high)]
    corner = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]])
    made = grid(np.stack([np.column_stack([half * corner, np.full(5, z)]) for half, z in rings]))
    return placed(made._replace(uv=made.vertices[:, :2] / (2 * BODY_MM) + 0.5), [*ic, 0.0])


def leads(layout: Layout) -> Body:
    """Gull wings: out of the body, down, along the pad; flat strips with a fillet of solder at the heel."""
    heel, knee = BODY_MM + 0.36, BODY_MM + 0.22
    path = [(BODY_MM - 0.1, 0.52), (knee - 0.03, 0.52), (knee + 0.02, 0.49), (heel - 0.04, 0.17), (heel + 0.02, 0.065)]
    path += [(heel + 0.1, 0.05), (BODY_MM + 0.25 + LEAD_MM[1], 0.05)]
    upper, half = np.array(path), LEAD_MM[0] / 2
    lower = upper - [0.0, 0.045]
    curve = np.concatenate([upper, lower[::-1], upper[:1]])
    wings = []
    for t, side in layout.leads:
        across = [(-half, 1.0), (half, 1.0)]
        strip = np.stack([np.column_stack([curve[:, 0], np.full(len(curve), w), curve[:, 1]]) for w, _ in across])
        edges = [[np.column_stack([e[:, 0], np.full(7, w), e[:, 1]]) for e in (upper, lower)] for w, _ in across]
        caps = [grid(np.stack(edge)) for edge in edges]
        toe = _fillet((BODY_MM + 0.25 + LEAD_MM[1], 0.05), 0.11, half)
        wing = placed(joined([grid(strip), *caps, toe, _fillet((heel + 0.06, 0.1), -0.24, half)]), [0, t, 0])
        wings.append(placed(wing, [*layout.ic, 0.0], turn=turning([0, 0, 1], 90.0 * side)))
    return joined(wings)


def _fillet(top: tuple[float, float], reach: float, half: float) -> Body:
    """A hollow slope of solder from an edge (x, z) down to the pad."""
    share = np.linspace(0, 1, 7)
    x, z = top[0] + reach * share, top[1] * (1 - share) ** 2 + 0.002
    wide = half * (1 + 0.25 * share)
    return grid(np.stack([np.column_stack([x, side * wide, z]) for side in (-1, 1)]))


def chips(layout: Layout) -> dict[str, Body]:
    """All chips: `ceramic` bodies, `tops` of resistors that wear their value, `caps` of tin with solder."""
    ceramic, dark, caps = [], [], []
    for chip in layout.chips:
        length, wide, high = chip.size
        cap = 0.19 * length
        turn = turning([0, 0, 1], 0.0 if chip.level else 90.0)
        at = [*chip.at, 0.015]
        tone = 0.55 if chip.resistor else 0.24
        bodies = [box([-length / 2, -wide / 2, 0], [length / 2, wide / 2, high - 0.02], tone=tone)]
        ceramic += [placed(b, at, turn=turn) for b in bodies]
        if chip.resistor:
            reach = np.array([length / 2 - cap, wide / 2 - 0.03])
            dark.append(placed(box([*-reach, high - 0.03], [*reach, high]), at, turn=turn))
        for side in (-1, 1):
            inner, outer = side * (length / 2 - cap), side * (length / 2 + 0.02)
            low, up = sorted((inner, outer))
            shell = box([low, -wide / 2 - 0.02, -0.02], [up, wide / 2 + 0.02, high + 0.01], tone=0.52)
            slope = _fillet((side * (length / 2 + 0.02), 0.75 * high), 0.26 * side, wide / 2)
            caps += [placed(b, at, turn=turn) for b in (shell, slope)]
    return {"ceramic": joined(ceramic), "tops": joined(dark), "caps": joined(caps)}


def marks(chip: Chip) -> str:
    """The three digits on a resistor, from its name."""
    return f"{chip.name[1:]}{int(chip.name[1:]) % 5}"
