"""The bottle: a square body with rounded edges, closing to a round neck; glass, oil, the air above it.

Heights count from the sill that the bottle stands on; metres. Borosilicate glass and olive oil have the same
index, 1.47: their border reflects less than a millionth and bends nothing, so it is left out. Light passes
glass to air outside, glass to air inside above the oil, oil to air on top. All have their normals outwards.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import mitsuba as mi
import numpy as np

from saf_gen.render.meshes import make_mesh

OIL, AIR = 1.47, 1.0  # and glass
HALF, EDGE_R, NECK_R = 0.0250, 0.0070, 0.0100  # half width of the body, radius of its edges, of the neck
WALL, FOOT, BASE = 0.0022, 0.0002, 0.0050  # thickness of the glass; its floor outside and inside
SHOULDER, NECK, TOP = 0.057, 0.076, 0.125  # heights at which shoulder and neck begin, and the mouth
PANE, PANE_SHARE = (0.038, SHOULDER), 0.7  # the clear part of the front: its heights; share of the flat width
HEEL_R = 0.0035
AROUND = 24  # steps round each edge of the body


class Surface(NamedTuple):
    """Points and normals (row, column, 3) of a net of quads, and which of them there are (row, column)."""

    points: np.ndarray
    normals: np.ndarray
    quads: np.ndarray


def bottle(level: float, pose: Any, pane: str) -> dict[str, Any]:
    """Shapes of the bottle with oil up to this height; ``pane`` names the clear part of its front."""
    inside, outside = _profile(WALL, BASE), _loft(_profile(0.0, FOOT))
    rim = np.array([[np.interp(level, inside[3:, 2], inside[3:, k]) for k in range(3)]])
    above = inside[inside[:, 2] > level]
    rest, front = _split(outside)
    shapes = {
        "glass": (rest, OIL, AIR),
        pane: (front, OIL, AIR),
        "ullage": (_loft(np.concatenate([rim, above])), AIR, OIL),
        "surface": (_lid(rim[0]), OIL, AIR),
    }
    return {name: _mesh(name, *part, pose) for name, part in shapes.items()}


def room_inside(height: np.ndarray | float) -> np.ndarray:
    """Half width (m) of the oil at a height."""
    inside = _profile(WALL, BASE)
    return np.interp(height, inside[3:, 2], inside[3:, 0])


def _profile(inset: float, floor: float) -> np.ndarray:
    """Half width, radius of the edges, height, from the middle of the floor to the mouth: (n, 3)."""
    heel = np.linspace(0, np.pi / 2, 12)
    half, edge, neck = HALF - inset, EDGE_R - inset, NECK_R - inset
    grow = HEEL_R * (1 - np.sin(heel))
    foot = np.stack([half - grow, np.maximum(edge - grow, 0), floor + HEEL_R * (1 - np.cos(heel))], axis=1)
    share = np.linspace(0, 1, 60)
    bend = share**3 * (10 - 15 * share + 6 * share**2)
    height = SHOULDER + (NECK - SHOULDER) * share
    shoulder = np.stack([half + (neck - half) * bend, edge + (neck - edge) * bend, height], axis=1)
    middle = np.array([[0.0, 0.0, floor], [0.5 * half, 0.5 * edge, floor]])
    body = np.array([[half, edge, h] for h in (*np.linspace(foot[-1, 2], PANE[0], 4)[1:], 0.047)])
    end = np.linspace(shoulder[-1], [neck, neck, TOP], 8)[1:]
    return np.concatenate([middle, foot, body, shoulder, end])


def _loft(profile: np.ndarray) -> Surface:
    """Rounded squares of these half widths and edge radii at these heights, with exact normals."""
    corner = np.repeat([[1, 1], [-1, 1], [-1, -1], [1, -1]], AROUND + 1, axis=0).astype(float)
    angle = np.concatenate([np.linspace(k, k + 1, AROUND + 1) * np.pi / 2 for k in range(4)])
    corner, angle = np.concatenate([corner, corner[:1]]), np.append(angle, 2 * np.pi)
    sides = [[PANE_SHARE, 1], [-PANE_SHARE, 1]]  # of the pane, on the front between the first two edges
    corner, angle = (np.insert(corner, AROUND + 1, sides, axis=0), np.insert(angle, AROUND + 1, [np.pi / 2] * 2))
    out = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    half, edge, height = (profile[:, k, None, None] for k in range(3))
    flat = (half - edge) * corner + edge * out
    along = np.gradient(np.concatenate([flat, height + 0 * flat[..., :1]], axis=2), axis=0)
    rise, widen = along[..., 2], (along[..., :2] * out).sum(axis=2)
    size = np.hypot(rise, widen)
    normals = np.stack([out[:, 0] * rise / size, -widen / size, out[:, 1] * rise / size], axis=2)
    points = np.stack([flat[..., 0], height[..., 0] + 0 * flat[..., 0], flat[..., 1]], axis=2)
    return Surface(points, normals, np.ones((len(profile) - 1, angle.size - 1), dtype=bool))


def _split(whole: Surface) -> tuple[Surface, Surface]:
    """All but the clear part of the front, and that part."""
    height = (whole.points[:-1, 0, 1] + whole.points[1:, 0, 1]) / 2
    pane = np.zeros_like(whole.quads)
    pane[(height > PANE[0]) & (height < PANE[1]), AROUND + 1] = True
    return whole._replace(quads=~pane), whole._replace(quads=pane)


def _lid(rim: np.ndarray) -> Surface:
    """The level top of the oil, from its middle to this rim."""
    ring = _loft(np.stack([rim, rim + np.array([0, 0, 1e-9])])).points[:1]
    middle = np.broadcast_to([0.0, rim[2], 0.0], ring.shape)
    points = np.concatenate([ring, middle])
    normals = np.broadcast_to([0.0, 1.0, 0.0], points.shape)
    return Surface(points, normals, np.ones((1, ring.shape[1] - 1), dtype=bool))


def _mesh(name: str, surface: Surface, inside: float, outside: float, pose: Any) -> mi.Mesh:
    row, column = np.nonzero(surface.quads)
    across = surface.points.shape[1]
    first = row * across + column
    halves = [(first, first + across, first + across + 1), (first, first + across + 1, first + 1)]
    triangles = np.concatenate([np.stack(half, axis=1) for half in halves])
    used, triangles = np.unique(triangles, return_inverse=True)
    matrix = np.array(pose.matrix, dtype=float)
    placed = surface.points.reshape(-1, 3)[used] @ matrix[:3, :3].T + matrix[:3, 3]
    normals = surface.normals.reshape(-1, 3)[used] @ matrix[:3, :3].T
    bsdf = dielectric(inside, outside)
    return make_mesh(name, placed, faces=triangles, bsdf=bsdf, normals=normals)


def dielectric(inside: float, outside: float) -> dict[str, Any]:
    """A smooth surface between two clear substances of these indices."""
    return {"type": "dielectric", "int_ior": inside, "ext_ior": outside}
