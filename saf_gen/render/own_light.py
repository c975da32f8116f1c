"""Whether the target's own light reaches the pixels that see it: light that it emits, reflects, or takes a part of.

What leaves the target's surface towards the lens counts, also through glass in front of it. Light that a clear pane as
the target lets straight through, unweakened, does not count: it shows what is behind. Light that a stained section
weakens does, as does light that glass bends.
"""

from collections.abc import Iterable
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from saf_gen.errors import BadInput
from saf_gen.render.depth_and_target import DepthAndTarget
from saf_gen.render.line_of_sight import SCATTERING
from saf_gen.render.pinhole_sight import INVISIBLE, PinholeSight, lines_of_sight
from saf_gen.render.render_setup import RenderSetup, camera_dict

MIN_FRACTION = 0.01  # of the target's pixels
JIT_SAMPLING, SCALAR_SAMPLING = (1024, 32), (128, 16)  # largest number of pixels; light paths per pixel and light group


def require_own_light(setups: Iterable[RenderSetup], target_shapes: tuple[str, ...], *, seen: DepthAndTarget) -> None:
    """Raise BadInput if under all lights together fewer than 1 % of the target's pixels receive its own light.

    Parameters
    ----------
    setups : iterable of RenderSetup
        The scene under each of its light groups.
    target_shapes : tuple of str
        Ids of the target's shapes.
    seen : DepthAndTarget
        The target's pixels at the position that focuses it; nothing is required if there are none.
    """
    if not seen.target.any():
        return
    lit: Any = False
    for setup in setups:
        lit = lit | _lit_pixels(setup, target_shapes, seen=seen)
        if lit.mean() >= MIN_FRACTION:
            return
    raise BadInput(
        f"the target ({', '.join(target_shapes)}) is black: its own light reaches {lit.mean():.1%} of its pixels",
        allowed=f"light that the target emits or reflects, in at least {MIN_FRACTION:.0%} of its pixels",
        hint="light it, give it a surface that reflects light, or choose another target in scene.yaml",
    )


def _lit_pixels(setup: RenderSetup, target_shapes: tuple[str, ...], *, seen: DepthAndTarget) -> np.ndarray:
    """Return whether own light of the target reaches pixels spread over it, bool (pixel,)."""
    vectors = dr.is_jit_v(mi.Float)
    pixels, samples = JIT_SAMPLING if vectors else SCALAR_SAMPLING
    rows, columns = np.nonzero(seen.target)
    chosen = np.linspace(0, rows.size - 1, min(pixels, rows.size)).astype(int)
    position = min(max(setup.in_focus.true_focus(seen.depth, seen.target), 0.0), 1.0)
    camera = mi.load_dict({"type": "perspective", **camera_dict(setup, position)})
    height, width = seen.target.shape
    at = {"x": (columns[chosen] + 0.5) / width, "y": (rows[chosen] + 0.5) / height}
    origin, direction = lines_of_sight(setup, camera, **at, position=position)
    ends = PinholeSight(setup.mitsuba_scene, target_shapes).follow(origin, direction)
    sampler = mi.load_dict({"type": "independent"})
    rays = [np.repeat(values, samples, axis=0) for values in (ends.origin, ends.direction)]
    if vectors:
        sampler.seed(0, len(rays[0]))
        begin, towards = (mi.Vector3f(*(mi.Float(x.astype(np.float32)) for x in values.T)) for values in rays)
        light = np.array(_own_light(setup, mi.Ray3f(mi.Point3f(begin), towards), sampler=sampler))
    else:
        each = (mi.Ray3f(mi.Point3f(o), mi.Vector3f(d)) for o, d in zip(*rays, strict=True))
        light = np.array([float(_own_light(setup, ray, sampler=sampler)) for ray in each])
    return ends.on_target & (light.reshape(-1, samples) > 0).any(axis=1)


def _own_light(setup: RenderSetup, ray: Any, *, sampler: Any) -> Any:
    """Return one sample of the target's own light along rays that meet it, as a radiance."""
    hit = setup.mitsuba_scene.ray_intersect(ray)
    if not dr.is_jit_v(mi.Float) and not hit.is_valid():
        return 0.0
    bsdf = hit.bsdf()
    flags = bsdf.flags()
    thin = mi.has_flag(flags, mi.BSDFFlags.Null) & mi.has_flag(flags, mi.BSDFFlags.DeltaReflection)
    thin &= (flags & int(SCATTERING)) == 0
    mirrored, weight = bsdf.sample(mi.BSDFContext(), hit, 0.0, mi.Point2f(0.5), thin)
    back = weight[0] * mirrored.pdf
    clear = thin & (back + bsdf.eval_null_transmission(hit, thin)[0] >= INVISIBLE)
    seen_in_it = hit.spawn_ray(hit.to_world(mirrored.wo))
    ray.o, ray.d = dr.select(clear, seen_in_it.o, ray.o), dr.select(clear, seen_in_it.d, ray.d)
    light, _, _ = setup.integrator.sample(setup.mitsuba_scene, sampler, mi.RayDifferential3f(ray), None, True)
    radiance = mi.luminance(light) if mi.is_rgb else light[0]
    return radiance * dr.select(clear, back, 1)
