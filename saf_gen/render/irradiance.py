"""The irradiance of the surfaces that the camera sees, which does not depend on their reflectance."""

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from saf_gen.render.pinhole_sight import PinholeSight, lines_of_sight
from saf_gen.render.render_setup import RenderSetup, camera_dict

RUNS = 4  # independent estimates, whose scatter gives the standard error
JIT_SAMPLING, SCALAR_SAMPLING = (4096, 32), (256, 8)  # largest number of target points; samples per point and run


def target_irradiance(
    setup: RenderSetup, *, position: float, target: np.ndarray, target_shapes: tuple[str, ...] = ()
) -> tuple[float, float]:
    """Estimate the mean irradiance of the target by Monte Carlo.

    Light on the side that faces the camera counts, and also on the other side if the surface lets light through. Direct
    light is sampled towards the lamps; indirect light, up to the integrator's longest path, over the hemisphere in
    proportion to the cosine.

    Parameters
    ----------
    setup : RenderSetup
        Lit scene in front of its lens.
    position : float
        Focus position, as a fraction of the travel.
    target : ndarray of bool, shape (row, col)
        The target's pixels at this position.
    target_shapes : tuple of str, optional
        Ids of the target's shapes, to look for them behind clear surfaces.

    Returns
    -------
    tuple of float
        Mean irradiance over the target's pixels, and its standard error, both in W m⁻².
    """
    vectors = dr.is_jit_v(mi.Float)
    points, samples = JIT_SAMPLING if vectors else SCALAR_SAMPLING
    rows, columns = np.nonzero(target)
    chosen = np.linspace(0, rows.size - 1, min(points, rows.size)).astype(int)
    x = (columns[chosen] + 0.5) / setup.grid.columns
    y = (rows[chosen] + 0.5) / setup.grid.rows
    sensor = mi.load_dict({"type": "perspective", **camera_dict(setup, position)})
    sampler = mi.load_dict({"type": "independent"})
    sight = PinholeSight(setup.mitsuba_scene, target_shapes)
    follow = sight.may_follow or setup.drive.distortion is not None
    if follow:
        ends = sight.follow(*lines_of_sight(setup, sensor, x=x, y=y, position=position))
        lines = ends.origin, ends.direction
    if vectors:
        sampler.seed(0, RUNS * x.size * samples)

        def repeated(values: np.ndarray) -> np.ndarray:
            return np.tile(np.repeat(values, samples), RUNS)

        if follow:
            begin, towards = (
                mi.Vector3f(*(mi.Float(repeated(v).astype(np.float32)) for v in line.T)) for line in lines
            )
            ray = mi.Ray3f(mi.Point3f(begin), towards)
        else:
            ray, _ = sensor.sample_ray(0, 0.5, mi.Point2f(repeated(x), repeated(y)), mi.Point2f(0.5))
        received = np.array(_sample_point(setup, ray, sampler=sampler), dtype=np.float64)
    else:
        if follow:
            rays = [mi.Ray3f(mi.Point3f(o), mi.Vector3f(d)) for o, d in zip(*lines, strict=True)]
        else:
            places = zip(x, y, strict=True)
            rays = [sensor.sample_ray(0, 0.5, mi.Point2f(*place), mi.Point2f(0.5))[0] for place in places]
        received = np.array([_sample_point(setup, ray, sampler=sampler) for ray in rays * (samples * RUNS)])
    means = received.reshape(RUNS, -1).mean(axis=1)
    return float(means.mean()), float(means.std(ddof=1) / np.sqrt(RUNS))


def _sample_point(setup: RenderSetup, ray: Any, *, sampler: Any) -> Any:
    """Return one sample of the irradiance of the surface that each ray meets."""
    hit = setup.mitsuba_scene.ray_intersect(ray)
    facing = dr.select(dr.dot(hit.n, ray.d) < 0, hit.n, -hit.n)
    surface = hit.bsdf(mi.RayDifferential3f(ray))
    through = mi.has_flag(surface.flags(), mi.BSDFFlags.DiffuseTransmission)
    through |= mi.has_flag(surface.flags(), mi.BSDFFlags.GlossyTransmission)
    through |= dr.any(surface.eval_null_transmission(hit) > 0)  # unscattered, as by a thin stained section
    front = _sample_side(setup, hit, sampler=sampler, normal=facing, active=hit.is_valid())
    back = _sample_side(setup, hit, sampler=sampler, normal=-facing, active=hit.is_valid() & through)
    return mi.luminance(front + back) if mi.is_rgb else (front + back)[0]


def _sample_side(setup: RenderSetup, hit: Any, *, sampler: Any, normal: Any, active: Any) -> Any:
    """Return one sample of the irradiance on the side of the surface from which ``normal`` points away."""
    lamp, weight = setup.mitsuba_scene.sample_emitter_direction(hit, sampler.next_2d(), True, active)
    # A point of a lamp in the lit point itself has the direction nan, and the weight 0.
    direct = weight * dr.fmax(dr.dot(normal, lamp.d), 0)
    towards = mi.Frame3f(normal).to_world(mi.warp.square_to_cosine_hemisphere(sampler.next_2d()))
    ray = mi.RayDifferential3f(hit.spawn_ray(towards))
    seen, _, _ = setup.integrator.sample(setup.mitsuba_scene, sampler, ray, None, active)
    far_hit = setup.mitsuba_scene.ray_intersect(mi.Ray3f(ray), active)
    shines = far_hit.emitter(setup.mitsuba_scene, active)
    vectors = dr.is_jit_v(mi.Float)
    if not vectors and shines is None:  # scalar has null pointers if there is no lamp or shape
        return dr.select(active, direct + dr.pi * seen, 0)
    # A lamp that the ray hits has been counted by the sample towards the lamps. The integrator does not see a lamp
    # without a surface, as Blender exports it, so nothing is subtracted for it.
    has_surface = vectors or far_hit.is_valid()
    hidden = has_surface and mi.has_flag(far_hit.bsdf(ray).flags(), mi.BSDFFlags.Null)
    shining = dr.select(hidden, 0, shines.eval(far_hit, active))
    return dr.select(active, direct + dr.pi * (seen - shining), 0)
