"""The train: where its wheels stand, how they mesh, how they turn; millimetres."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

RADII_MM = (21.0, 15.0, 11.0, 17.5, 8.5, 13.0)  # of pitch circles, before they are rounded to whole teeth
FRAME_MM = (50.0, 31.0)  # half of what the lens sees
TRIES = 400  # trees that are drawn; the one that fills the frame best is taken
GAP_MM = 3.6  # between the pitch circles of wheels that do not mesh


class Wheel(NamedTuple):
    """Teeth, pitch radius, centre (mm), angle of a tooth at rest (rad), turns over those of wheel 0."""

    teeth: int
    radius: float
    centre: np.ndarray
    phase: float
    ratio: float


def train(module_mm: float, random: np.random.Generator) -> list[Wheel]:
    """Wheels in one plane, each but the first driven by one before it."""
    teeth = [max(round(2 * r * random.uniform(0.93, 1.07) / module_mm), 12) for r in RADII_MM]
    radii = np.array(teeth) * module_mm / 2
    best: tuple[float, Any] = (-1.0, None)
    for _ in range(TRIES):
        tree = _tree(radii, random)
        if tree is not None and (filled := _filled(tree[0], radii)) > best[0]:
            best = filled, tree
    centres, drivers = best[1]
    wheels = [Wheel(teeth[0], radii[0], centres[0], random.uniform(0, 2 * np.pi), 1.0)]
    for k in range(1, len(teeth)):
        driver = wheels[drivers[k]]
        towards = float(np.arctan2(*(centres[k] - driver.centre)[::-1]))
        tooth = driver.teeth * (driver.phase - towards) / (2 * np.pi)  # of the driver, in pitches along the tangent
        phase = towards + np.pi - 2 * np.pi / teeth[k] * (tooth + 0.5)  # a gap of this one lies there
        ratio = -driver.ratio * driver.teeth / teeth[k]
        wheels.append(Wheel(teeth[k], radii[k], centres[k], phase, ratio))
    return wheels


def _tree(radii: np.ndarray, random: np.random.Generator) -> tuple[list[np.ndarray], list[int]] | None:
    """Centres, and which wheel drives each; None where they do not find room."""
    centres = [random.uniform(-0.55, 0.55, 2) * FRAME_MM]
    drivers = [0]
    for k in range(1, len(radii)):
        for _ in range(12):
            driver = int(random.integers(k))
            angle = random.uniform(0, 2 * np.pi)
            away = radii[driver] + radii[k]
            at = centres[driver] + away * np.array([np.cos(angle), np.sin(angle)])
            gaps = [np.linalg.norm(at - c) - radii[k] - radii[n] for n, c in enumerate(centres) if n != driver]
            if np.all(np.abs(at) < FRAME_MM) and all(gap > GAP_MM for gap in gaps):
                centres.append(at)
                drivers.append(driver)
                break
        else:
            return None
    return centres, drivers


def _filled(centres: list[np.ndarray], radii: np.ndarray) -> float:
    """Share of the frame that the wheels cover."""
    x, y = np.meshgrid(*(np.linspace(-0.95 * half, 0.95 * half, 36) for half in FRAME_MM))
    covered = [np.hypot(x - c[0], y - c[1]) < r for c, r in zip(centres, radii, strict=True)]
    return float(np.any(covered, axis=0).mean())


def outline(wheel: Wheel, *, inset_mm: float = 0.0) -> np.ndarray:
    """Rim of a toothed wheel, (n + 1, 2), counter-clockwise and closed, a tooth at angle 0."""
    module = 2 * wheel.radius / wheel.teeth
    # Half a pitch from the middle of a tooth on: share of the pitch, height over the pitch circle in modules.
    form = [
        (0.0, 1.0),
        (0.07, 0.93),
        (0.14, 0.68),
        (0.20, 0.30),
        (0.238, 0.0),
        (0.255, -0.6),
        (0.275, -1.15),
        (0.36, -1.3),
    ]
    half = np.array([*form, (0.5, -1.32)])
    whole = np.concatenate([half, [(1 - s, h) for s, h in form[:0:-1]]])
    angle = (np.arange(wheel.teeth)[:, None] + whole[:, 0]) * 2 * np.pi / wheel.teeth
    radius = wheel.radius + module * np.tile(whole[:, 1], wheel.teeth)
    points = np.stack([radius * np.cos(angle.ravel()), radius * np.sin(angle.ravel())], axis=1)
    if inset_mm:
        along = np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0)
        points = points + inset_mm * np.stack([-along[:, 1], along[:, 0]], 1) / np.linalg.norm(along, axis=1)[:, None]
    return np.concatenate([points, points[:1]])
