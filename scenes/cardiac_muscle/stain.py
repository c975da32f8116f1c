"""Pictures of the section: absorbance of its two layers, float32 (row, col)."""

from __future__ import annotations

import numpy as np
from fibres import SHAPE, SIZE_UM, Fibres, Spot, noise

PLASM, STRIPES = 0.34, 0.62  # absorbance of a cell, and depth of its striations
NUCLEUS, DISC, MEMBRANE, BLOOD = 0.72, 0.55, 0.30, 0.40  # absorbances
UPPER = 0.68  # share of the striated mass in the upper layer


def layers(fibres: Fibres, sarcomere_um: float, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Absorbance of the upper and the lower layer."""
    gap, vessels = _gaps(fibres, random)
    edge = fibres.width / 2 - np.abs(fibres.across) - gap  # µm inside the cell
    inside = np.clip(edge / 0.5 + 0.5, 0, 1)
    nuclei = _places(fibres, 34, (42.0, 5.0), random)
    discs = [p for p in _places(fibres, 60, (34.0, 5.0), random) if _clear(p, nuclei, (13.0, 6.0))]
    pale = _pale(fibres, nuclei)
    mass = _striated(fibres, sarcomere_um, random) * inside * (1 - 0.75 * pale)
    upper, lower = UPPER * mass, (1 - UPPER) * np.roll(mass, (4, 3), (0, 1))  # fibrils below lie beside
    upper += MEMBRANE * np.exp(-((edge / 0.55) ** 2)) * (0.6 + 0.4 * noise(fibres.x, fibres.y, (9.0, 3.0), random))
    upper += _strands(fibres, edge, random)
    for place in discs:
        _disc(upper, fibres, place, inside, sarcomere_um, random)
    for place in nuclei:
        _nucleus(upper if random.random() < 0.7 else lower, fibres, place, random)
    _fill_vessels(upper, lower, fibres, vessels, gap, random)
    _thin_nuclei(upper, fibres, random)
    return np.maximum(upper, 0) + 0.012, np.maximum(lower, 0)


def _gaps(fibres: Fibres, random: np.random.Generator) -> tuple[np.ndarray, list[tuple[float, float, float]]]:
    """Half the width (µm) of the gaps between cells, and the capillaries in them as (x, y, half length)."""
    gap = 0.75 + 0.55 * noise(fibres.x, fibres.y, (38.0, 10.0), random)
    gap += np.maximum(noise(fibres.x, fibres.y, (60.0, 26.0), random) - 0.35, 0) * 3.0
    vessels = []
    for x, y in _places(fibres, 7, (80.0, 18.0), random, gap=True):
        half = random.uniform(30, 75)
        near = fibres.near(x, y, half + 14)
        if near is None:
            continue
        window, along, across = near
        part = gap[window]
        open_ = np.clip((half - np.abs(along)) / 9.0, 0, 1)
        wide = (2.9 + 0.35 * np.sin(along / 6.0 + x)) * open_ * open_ * (3 - 2 * open_)
        np.maximum(part, wide, out=part, where=np.abs(across) < 0.5 * fibres.width)
        vessels.append((x, y, half))
    return gap, vessels


def _places(fibres: Fibres, count: int, apart: Spot, random: np.random.Generator, *, gap: bool = False) -> list[Spot]:
    """Places in the middle of cells, or of gaps, so far apart along and across."""
    found: list[Spot] = []
    reach = 0.55 * float(np.hypot(*SIZE_UM))
    for _ in range(25 * count):
        place = fibres.snapped(*random.uniform(-reach, reach, 2), gap=gap)
        if place is not None and _clear(place, found, apart):
            found.append(place)
        if len(found) == count:
            break
    return found


def _clear(place: Spot, others: list[Spot], apart: Spot) -> bool:
    return all(abs(place[0] - x) > apart[0] or abs(place[1] - y) > apart[1] for x, y in others)


def _striated(fibres: Fibres, period: float, random: np.random.Generator) -> np.ndarray:
    """Absorbance of the contractile mass: stripes across the fibre, in fibrils that are not quite in step."""
    x, y = fibres.x, fibres.y
    along = x - fibres.lean * fibres.across
    flow = fibres.phase * np.float32(fibres.width / (2 * np.pi))  # a fibril keeps its place in the cell
    step = 1.5 * noise(x, flow, (46.0, 9.0), random) + 0.55 * noise(x, flow, (14.0, 2.2), random)
    stretch = 2.2 * noise(x, y, (95.0, 60.0), random)
    turn = along * np.float32(2 * np.pi / period) + 2.2 * step + stretch
    wave = np.cos(turn)
    stripes = wave + 0.3 * (2 * wave * wave - 1)
    clear = 0.72 + 0.45 * noise(x, flow, (26.0, 6.0), random)
    fibrils = noise(x, flow, (17.0, 0.9), random)
    tone = 1 + 0.22 * noise(x, y, (70.0, 14.0), random)
    return PLASM * tone * (1 + 0.17 * fibrils + STRIPES * clear * stripes).clip(0.05, None)


def _pale(fibres: Fibres, nuclei: list[Spot]) -> np.ndarray:
    """1 in the plasm at the ends of nuclei, which has no fibrils; 0 elsewhere."""
    pale = np.zeros(SHAPE, np.float32)
    for x, y in nuclei:
        near = fibres.near(x, y, 19.0)
        if near is not None:
            window, along, across = near
            half = 3.1 * np.clip(1 - np.abs(along) / 16.0, 0, 1) ** 0.7
            pale[window] = np.maximum(pale[window], np.clip((half - np.abs(across)) / 0.9 + 0.2, 0, 1))
    return pale


def _strands(fibres: Fibres, edge: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Collagen in the gaps: thin strands along them."""
    strand = 1 - np.abs(noise(fibres.x, fibres.phase * 2.4, (30.0, 0.55), random)) / 0.2
    return 0.16 * np.clip(strand, 0, 1) * np.clip(-edge / 0.7, 0, 1)


def _disc(
    image: np.ndarray, fibres: Fibres, place: Spot, inside: np.ndarray, period: float, random: np.random.Generator
) -> None:
    """An intercalated disc: a dark line across the cell in two to four steps, thin lines along it between."""
    near = fibres.near(*place, 0.75 * fibres.width + 8)
    if near is None:
        return
    window, along, across = near
    along = along - fibres.lean[window] * across
    half = fibres.width / 2
    cuts = np.sort(random.uniform(-0.75, 0.75, random.integers(1, 4))) * half
    steps = np.cumsum(np.concatenate([[0], random.choice([-2, -1, 1, 2], len(cuts))])) * period
    level = steps[np.searchsorted(cuts, across)] - steps.mean()
    ripple = 0.22 * np.sin(across * 5.1 + place[0]) + 0.15 * np.sin(across * 11.3)
    line = np.exp(-(((along - level - ripple) / 0.52) ** 2))
    for cut, low, high in zip(cuts, steps[:-1], steps[1:], strict=True):
        between = (along > min(low, high) - steps.mean()) & (along < max(low, high) - steps.mean())
        line = np.maximum(line, 0.45 * np.exp(-(((across - cut) / 0.35) ** 2)) * between)
    image[window] += DISC * line * inside[window] * (np.abs(across) < half)


def _nucleus(image: np.ndarray, fibres: Fibres, place: Spot, random: np.random.Generator) -> None:
    """An oval along the fibre, its chromatin in lumps and a rim, and brown granules at its ends."""
    near = fibres.near(*place, 18.0)
    if near is None:
        return
    window, along, across = near
    long, wide = random.uniform(5.5, 8.5), random.uniform(2.4, 3.3)
    r = np.hypot(along / long, across / wide) * (1 + 0.05 * np.sin(along * 1.3 + place[1]))
    body = np.clip((1 - r) * wide / 0.5 + 0.5, 0, 1)
    lumps = noise(fibres.x[window], fibres.y[window], (1.3, 1.0), random)
    chromatin = NUCLEUS * (0.72 + 0.30 * lumps + 0.35 * np.exp(-(((1 - r) * wide / 0.45) ** 2)))
    granules = noise(fibres.x[window], fibres.y[window], (0.9, 0.9), random) > 0.62
    ends = np.exp(-(((np.abs(along) - long - 2.5) / 2.2) ** 2) - (across / 1.3) ** 2)
    part = image[window]
    part *= 1 - body
    part += body * chromatin + 0.5 * ends * granules


def _fill_vessels(
    upper: np.ndarray,
    lower: np.ndarray,
    fibres: Fibres,
    vessels: list[tuple[float, float, float]],
    gap: np.ndarray,
    random: np.random.Generator,
) -> None:
    """Walls of the capillaries, a nucleus that bulges into them, and red cells in a row."""
    for x, y, half in vessels:
        near = fibres.near(x, y, half + 4)
        if near is None:
            continue
        window, along, across = near
        within = (np.abs(along) < half) & (np.abs(across) < 0.5 * fibres.width)
        along, across = along[within], across[within]
        top, bottom = upper[window][within], lower[window][within]
        lumen = gap[window][within] - 0.55 - np.abs(across)
        top += 0.42 * np.exp(-((lumen / 0.4) ** 2))
        at, side = random.uniform(-0.6, 0.6) * half, random.choice([-1, 1])
        bulge = ((along - at) / 4.6) ** 2 + ((across - side * 2.0) / 0.95) ** 2
        np.maximum(top, 0.8 * np.clip((1 - bulge) * 2.0, 0, 1), out=top)
        s = -half + random.uniform(3, 9)
        while s < half - 4:
            flat, tall = random.uniform(2.1, 3.3), random.uniform(1.7, 2.3)
            r = np.hypot((along - s) / flat, (across - random.normal(0, 0.25)) / tall)
            dimple = 1 - 0.45 * np.exp(-((r / 0.5) ** 2)) * (flat > 2.6)
            layer = top if random.random() < 0.6 else bottom
            np.maximum(layer, BLOOD * np.clip((1 - r) * tall / 0.45 + 0.5, 0, 1) * dimple, out=layer)
            s += flat * 2 + random.exponential(4.0)
        upper[window][within], lower[window][within] = top, bottom


def _thin_nuclei(image: np.ndarray, fibres: Fibres, random: np.random.Generator) -> None:
    """Nuclei of the connective tissue: dark spindles in the gaps."""
    for place in _places(fibres, 26, (26.0, 4.0), random, gap=True):
        near = fibres.near(*place, 10.0)
        if near is not None:
            window, along, across = near
            long, wide = random.uniform(3.5, 7.0), random.uniform(0.7, 1.2)
            r = (along / long) ** 2 + (across / wide) ** 2
            image[window] = np.maximum(image[window], 0.85 * np.clip((1 - r) * 2.2, 0, 1))
