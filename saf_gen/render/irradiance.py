"""The light that falls on what the camera sees: irradiance, whatever the surface does with it."""

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from saf_gen.render.render_setup import RenderSetup, make_camera_dict

__all__ = ["estimate_irradiance"]

RUNS = 4  # independent ones: their scatter is the error
POINTS, RAYS = (4096, 32), (256, 8)  # most points of the target, samples at each and run: vectors, scalar


def estimate_irradiance(setup: RenderSetup, position: float, target: np.ndarray) -> tuple[float, float]:
    """Mean irradiance (W m⁻²) over the target's pixels, bool (row, col), and its standard error.

    Of the side that faces the camera; where the surface lets light through, of both sides together. Light
    from lamps is sampled towards them; light by way of other surfaces, all of it within the integrator's
    longest path, over the hemisphere in proportion to the cosine.
    """
    vectors = dr.is_jit_v(mi.Float)
    points, samples = POINTS if vectors else RAYS
    rows, columns = np.nonzero(target)
    chosen = np.linspace(0, rows.size - 1, min(points, rows.size)).astype(int)
    x = (columns[chosen] + 0.5) / setup.film.columns
    y = (rows[chosen] + 0.5) / setup.film.rows
    sensor = mi.load_dict({"type": "perspective", **make_camera_dict(setup, position)})
    sampler = mi.load_dict({"type": "independent"})
    if vectors:
        sampler.seed(0, RUNS * x.size * samples)
        x, y = (np.tile(np.repeat(places, samples), RUNS) for places in (x, y))
        received = np.array(_fallen(setup, sensor, sampler, mi.Point2f(x, y)), dtype=np.float64)
    else:
        places = [mi.Point2f(*place) for place in zip(x, y, strict=True)] * (samples * RUNS)
        received = np.array([_fallen(setup, sensor, sampler, place) for place in places])
    means = received.reshape(RUNS, -1).mean(axis=1)
    return float(means.mean()), float(means.std(ddof=1) / np.sqrt(RUNS))


def _fallen(setup: RenderSetup, sensor: Any, sampler: Any, on_film: Any) -> Any:
    """One sample of irradiance where the ray through each place of the film, 0...1, ends."""
    ray, _ = sensor.sample_ray(0, 0.5, on_film, mi.Point2f(0.5))
    hit = setup.mitsuba_scene.ray_intersect(ray)
    facing = dr.select(dr.dot(hit.n, ray.d) < 0, hit.n, -hit.n)
    surface = hit.bsdf(mi.RayDifferential3f(ray))
    through = mi.has_flag(surface.flags(), mi.BSDFFlags.DiffuseTransmission)
    through |= mi.has_flag(surface.flags(), mi.BSDFFlags.GlossyTransmission)
    through |= dr.any(surface.eval_null_transmission(hit) > 0)  # straight on, as a thin stained section
    front = _on_side(setup, sampler, hit, facing, hit.is_valid())
    back = _on_side(setup, sampler, hit, -facing, hit.is_valid() & through)
    return mi.luminance(front + back) if mi.is_rgb else (front + back)[0]


def _on_side(setup: RenderSetup, sampler: Any, hit: Any, normal: Any, active: Any) -> Any:
    """One sample of the irradiance of the side that ``normal`` points away from the surface of."""
    lamp, weight = setup.mitsuba_scene.sample_emitter_direction(hit, sampler.next_2d(), True, active)
    direct = weight * dr.maximum(dr.dot(normal, lamp.d), 0)
    towards = mi.Frame3f(normal).to_world(mi.warp.square_to_cosine_hemisphere(sampler.next_2d()))
    ray = mi.RayDifferential3f(hit.spawn_ray(towards))
    seen, _, _ = setup.integrator.sample(setup.mitsuba_scene, sampler, ray, None, active)
    there = setup.mitsuba_scene.ray_intersect(mi.Ray3f(ray), active)
    shines = there.emitter(setup.mitsuba_scene, active)
    vectors = dr.is_jit_v(mi.Float)
    if not vectors and shines is None:  # scalar has null pointers for no lamp and no shape
        return dr.select(active, direct + dr.pi * seen, 0)
    # A lamp that was hit has been counted by the ray towards it. The integrator does not see one without a
    # surface, as Blender exports them.
    has_surface = vectors or there.is_valid()
    hidden = has_surface and mi.has_flag(there.bsdf(ray).flags(), mi.BSDFFlags.Null)
    shining = dr.select(hidden, 0, shines.eval(there, active))
    return dr.select(active, direct + dr.pi * (seen - shining), 0)
