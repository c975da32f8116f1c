"""The light that some of a band's rays bring, traced on from where they are, by Mitsuba's path tracer and its lamps.

Each call runs a separate kernel, so that other light groups do not change its bits.
"""

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from saf_gen.render.render_setup import RenderSetup


def trace_radiance(setup: RenderSetup, ray: Any, *, seed: int) -> Any:
    """Return the radiance along rays, each traced as a complete light path, Float (ray,)."""
    traced, _, _ = setup.integrator.sample(setup.mitsuba_scene, _random(seed, ray), ray)
    return _evaluate(traced)


def reflected_radiance(setup: RenderSetup, ray: Any, *, seed: int) -> Any:
    """Return the radiance that the clear surfaces met by rays reflect, Float (ray,).

    This is all that they scatter or reflect, without the light that comes straight through. A path to a lamp is found
    both by aiming at the lamp and by chance, weighted by the power heuristic (Veach and Guibas 1995,
    doi:10.1145/218380.218498).
    """
    scene, random = setup.mitsuba_scene, _random(seed, ray)
    context = mi.BSDFContext()
    hit = scene.ray_intersect(ray)
    valid = hit.is_valid()
    bsdf = hit.bsdf()
    lamp, light = scene.sample_emitter_direction(hit, random.next_2d(), True, valid)
    towards = hit.to_local(lamp.d)
    reflected, density = bsdf.eval_pdf(context, hit, towards, valid & (lamp.pdf > 0))
    share = dr.select(lamp.delta, 1, _power_heuristic(lamp.pdf, density))
    aimed = dr.select(lamp.pdf > 0, reflected * light * share, 0)

    sample, weight = bsdf.sample(context, hit, random.next_1d(), random.next_2d(), valid)
    on = hit.spawn_ray(hit.to_world(sample.wo))
    found = valid & (dr.max(weight) > 0) & ~mi.has_flag(sample.sampled_type, mi.BSDFFlags.Null)
    traced, _, _ = setup.integrator.sample(scene, random, mi.RayDifferential3f(on), None, found)
    met = scene.ray_intersect(on, found)
    emitter = met.emitter(scene, found)
    straight = dr.select(emitter != None, emitter.eval(met, found), 0)  # noqa: E711, an array of pointers
    mirrored = mi.has_flag(sample.sampled_type, mi.BSDFFlags.Delta)
    aim = scene.pdf_emitter_direction(hit, mi.DirectionSample3f(scene, met, hit), found & ~mirrored)
    chance = bsdf.pdf(context, hit, sample.wo, found)  # ``sample`` holds the density of only one part of a blend
    share = dr.select(mirrored, 1, _power_heuristic(chance, aim))
    return _evaluate(aimed + dr.select(found, weight * (traced + straight * (share - 1)), 0))


def lamp_radiance(setup: RenderSetup, ray: Any) -> Any:
    """Return the radiance of the lamps that rays meet, or of the sky, Float (ray,)."""
    hit = setup.mitsuba_scene.ray_intersect(ray)
    emitter = hit.emitter(setup.mitsuba_scene)
    return _evaluate(dr.select(emitter != None, emitter.eval(hit), 0))  # noqa: E711, an array of pointers


def _random(seed: int, ray: Any) -> Any:
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(seed & 0xFFFFFFFF, dr.width(ray.o))
    return sampler


def _power_heuristic(one: Any, other: Any) -> Any:
    squared = one * one
    return dr.select(squared > 0, squared / (squared + other * other), 0)


def _evaluate(radiance: Any) -> Any:
    value = radiance.x if dr.size_v(radiance) == 1 else mi.luminance(radiance)
    dr.eval(value)
    return value


def to_host(radiance: Any) -> np.ndarray:
    """Return radiance on the host, float32 (ray,); a path without a finite value counts as 0."""
    return np.nan_to_num(radiance.numpy(), nan=0.0, posinf=0.0, neginf=0.0)


def finite(radiance: Any) -> Any:
    """Return radiance on the device, Float (ray,); a path without a finite value counts as 0."""
    return dr.select(dr.isfinite(radiance), radiance, 0)
