"""The size of a texture's texels on the surface that it covers."""

from typing import Any

import mitsuba as mi
import numpy as np

from saf_gen.render.render_setup import RenderSetup, camera_dict, render_with_camera


def footprints(
    setup: RenderSetup, target_shapes: tuple[str, ...], *, position: float, target: np.ndarray
) -> np.ndarray:
    """Return the size (m) of a texel at each target pixel, from the finest bitmap of its shape, float64 (pixel,).

    A texel of a bitmap with (rows, columns) texels spans |∂p/∂u| / columns along one side and |∂p/∂v| / rows along the
    other, after the texture's own scaling; the size is their geometric mean. Pixels of shapes without a bitmap or
    without texture coordinates are left out, because geometry and formulas are sharp at any size.

    Parameters
    ----------
    setup : RenderSetup
        Scene in front of its lens.
    target_shapes : tuple of str
        Ids of the target's shapes.
    position : float
        Focus position, as a fraction of the travel.
    target : ndarray of bool, shape (row, col)
        The target's pixels at this position.
    """
    sampler = {"type": "stratified", "sample_count": 1, "jitter": False}
    camera = mi.load_dict({"type": "perspective", **camera_dict(setup, position), "sampler": sampler})
    sizes = []
    for shape in (s for s in setup.mitsuba_scene.shapes() if s.id() in target_shapes):
        density = _texel_density(shape.bsdf())
        if density > 0:
            shape_scene = mi.load_dict({"type": "scene", "it": shape}, optimize=False)
            integrator = mi.load_dict({"type": "aov", "aovs": "u:dp_du,v:dp_dv"})
            planes = render_with_camera(shape_scene, camera, integrator=integrator, samples=1).astype(np.float64)
            area = np.linalg.norm(np.cross(planes[..., 0:3], planes[..., 3:6]), axis=-1)[target]
            sizes.append(np.sqrt(area[area > 0] / density) * setup.unit_m)
    return np.concatenate(sizes) if sizes else np.empty(0)


def _texel_density(bsdf: Any) -> float:
    """Return the texels per unit square of texture coordinates of the finest bitmap; 0 without a bitmap."""
    densest = 0.0
    parameters = mi.traverse(bsdf)
    for key, value in parameters.items():
        if key.endswith(".data") and len(np.shape(value)) == 3:
            rows, columns = np.shape(value)[:2]
            scaling = parameters.get(key.removesuffix("data") + "to_uv")
            matrix = np.eye(3) if scaling is None else np.array(scaling.matrix, dtype=np.float64)
            matrix = matrix.reshape(matrix.shape[0], matrix.shape[1])
            densest = max(densest, rows * columns * abs(np.linalg.det(matrix[:2, :2])))
    return densest
