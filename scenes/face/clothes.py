"""The sitter's knitted pullover. Millimetres."""

from __future__ import annotations

import numpy as np
from person import SKULL, Person
from scipy import ndimage
from solids import Body, grid

STITCH_MM = 3.6


def pullover(person: Person) -> dict[str, Body]:
    """Knitting over the shoulders with soft folds, in mm, and the ribbed band round the neck."""
    points, normals = person.vertices, person.normals
    body = np.abs(points[:, 0]) < 300
    level = np.arange(-230.0, -90.0, 2.0)
    half = np.array([np.abs(points[(np.abs(points[:, 1] - y) < 4) & body, 0]).max(initial=0) for y in level])
    neck = float(level[np.nonzero(half > 92)[0].max(initial=0)])
    edge = neck + 2 - 0.38 * (points[:, 2] - SKULL[2])
    fold = 1.6 * np.sin(points[:, 0] / 17 + points[:, 1] / 23) + 1.3 * np.sin(points[:, 0] / 41 - points[:, 1] / 13 + 2)
    raised = points + normals * (5.5 + fold * np.clip((edge - points[:, 1]) / 40, 0, 1))[:, None]
    inside = person.mesh.quads[(points[:, 1] < edge + 1.0)[person.mesh.quads].all(axis=1)]
    used, quads = np.unique(inside, return_inverse=True)
    quads = quads.reshape(-1, 4)
    cloth = Body(
        raised[used],
        np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]),
        raised[used, :2] / STITCH_MM,
        np.full(len(used), 0.5),
    )
    near = np.abs(points[:, 1] - edge) < 7
    turn = np.arctan2(points[near, 0], points[near, 2] - SKULL[2])
    r = np.hypot(points[near, 0], points[near, 2] - SKULL[2])
    bins = ((turn + np.pi) / (2 * np.pi) * 90).astype(int) % 90
    count, total = np.bincount(bins, minlength=90), np.bincount(bins, r, minlength=90)
    soft = ndimage.gaussian_filter1d(total, 1.5, mode="wrap") / np.maximum(
        ndimage.gaussian_filter1d(count.astype(float), 1.5, mode="wrap"), 1e-6
    )
    angle = np.linspace(-np.pi, np.pi, 181)
    ring = np.interp(angle, np.linspace(-np.pi, np.pi, 91), np.append(soft, soft[0]))
    around = np.linspace(0, 2 * np.pi, 17)[:, None]
    radius = ring + 4.0 + 2.6 * np.cos(around) - 2.5 * np.sin(around)
    height = neck + 2 - 0.38 * ring * np.cos(angle) + 8.5 * np.sin(around) + 3
    band = np.stack([radius * np.sin(angle), height, radius * np.cos(angle) + SKULL[2]], axis=2)
    uv = np.stack(np.broadcast_arrays(angle * ring.mean() / 4.0, around / (2 * np.pi) * 9), axis=2)
    return {"pullover": cloth, "band": grid(band, uv=uv)}
