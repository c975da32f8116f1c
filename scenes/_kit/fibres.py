"""Thousands of fibres as one mesh: hair, lashes, threads, each a tapering prism of three sides with smooth normals."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

SIDES = 3


class Fibres(NamedTuple):
    """Vertices (n, 3), triangles (m, 3), texture coordinates (n, 2), reflectances (n,) in 0..1."""

    vertices: np.ndarray
    triangles: np.ndarray
    uv: np.ndarray
    tone: np.ndarray


def fibres(paths: np.ndarray, *, radius: Any, tone: Any = 0.5, random: np.random.Generator) -> Fibres:
    """Prisms along paths (fibre, point, 3), in any unit.

    radius : one for all, or (point,), or (fibre, point); a fibre that ends at 0 has a tip.
    tone : reflectance, one for all, or (fibre,), or (fibre, point).
    random : draws how each prism is turned. u of the coordinates leads along a fibre, v is different for each.
    """
    paths = np.asarray(paths, dtype=np.float64)
    count, points = paths.shape[:2]
    along = np.gradient(paths, axis=1)
    along /= np.maximum(np.linalg.norm(along, axis=2, keepdims=True), 1e-12)
    away = random.normal(0, 1, (count, 1, 3))
    side = np.cross(along, away)
    side /= np.maximum(np.linalg.norm(side, axis=2, keepdims=True), 1e-12)
    other = np.cross(along, side)
    angle = np.arange(SIDES) * 2 * np.pi / SIDES
    ring = np.cos(angle)[:, None] * side[:, :, None] + np.sin(angle)[:, None] * other[:, :, None]
    wide = np.broadcast_to(np.asarray(radius, dtype=np.float64), (count, points))
    vertices = paths[:, :, None] + wide[..., None, None] * ring
    start = (np.arange(count)[:, None] * points + np.arange(points - 1)).ravel()[:, None] * SIDES
    here, there = start + np.arange(SIDES), start + np.roll(np.arange(SIDES), -1)
    faces = [np.stack([here, there, there + SIDES], 2), np.stack([here, there + SIDES, here + SIDES], 2)]
    tone = np.asarray(tone, dtype=np.float64)
    tones = np.broadcast_to(tone[:, None] if tone.ndim == 1 else tone, (count, points))
    uv = np.broadcast_arrays(np.linspace(0, 1, points)[None, :], ((np.arange(count) + 0.5) / count)[:, None])
    return Fibres(
        vertices.reshape(-1, 3),
        np.concatenate([face.reshape(-1, 3) for face in faces]),
        np.repeat(np.stack(uv, axis=2).reshape(-1, 2), SIDES, axis=0),
        np.repeat(tones.ravel(), SIDES),
    )
