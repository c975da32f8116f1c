"""Lines of sight through clear surfaces: glass, thin sheets, masks.

A camera ray that meets a clear surface continues behind it. It passes straight through a surface that lets light
through unbent (a stained section, a mask). At a surface that reflects and refracts like polished glass, it continues in
the direction that carries more of the light. It ends at the first surface that is not clear, at a lamp, or outside the
scene. The fraction of the light at its end that reaches the lens is computed exactly, not sampled.

At every bend, a second direction branches off. One of the branches of a line is chosen at random, in proportion to the
light that it carries (a reservoir: Chao 1982), and counts for all of them. It is followed in turn, in a random
direction at each further bend. In the same way, one of the surfaces that reflect light towards the line is chosen:
these are the surfaces at its ends and those that it passes straight through.

References
----------
M. T. Chao, Biometrika 69, 653 (1982), doi:10.1093/biomet/69.3.653.
"""

from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

MAX_SURFACES = 16  # clear surfaces on a line; the next surface is traced with complete light paths
DELTA = mi.BSDFFlags.DeltaReflection | mi.BSDFFlags.DeltaTransmission
SCATTERING = mi.BSDFFlags.Diffuse | mi.BSDFFlags.Glossy
OPAQUE, STRAIGHT, BENDING = range(3)  # effects of a surface on a line


class LineOfSight(NamedTuple):
    """Lines of sight through clear surfaces, as Dr.Jit arrays (ray,).

    Attributes
    ----------
    last : Ray3f
        Part of the line behind all clear surfaces.
    clearness : Float
        Fraction of the light at its end that reaches the lens.
    branch : Ray3f
        Last part of the line that branches off at a bend.
    branch_fraction : Float
        Fraction of the light at the end of ``branch`` that reaches the lens, counted for all branches; 0 if no line
        branches off.
    segment : Ray3f
        Part of the line that meets the clear surface that was chosen to reflect light.
    reflected_fraction : Float
        Largest fraction of light that all clear surfaces together may reflect; 0 if none does.
    reflection_weight : Float
        Weight of the light that the chosen surface reflects, divided by ``reflected_fraction``.
    draw : Float
        Random number, 0 to 1, that chooses between these surfaces and those at the ends.
    straight : Bool
        Whether the line was never bent.
    nearest, farthest : Float
        Axial distances (m), from the lens at the middle position, of the clear surfaces in front of the first that
        bends the line; inf and 0 if there are none.
    """

    last: Any
    clearness: Any
    branch: Any
    branch_fraction: Any
    segment: Any
    reflected_fraction: Any
    reflection_weight: Any
    draw: Any
    straight: Any
    nearest: Any
    farthest: Any


class ClearSurfaces:
    """The clear surfaces of a scene, and their effects on a line of sight.

    Parameters
    ----------
    shapes : dict of int to shape
        Shapes of Mitsuba by their numbers in Dr.Jit's registry.
    size : int
        Upper bound of these numbers, exclusive.
    """

    def __init__(self, shapes: dict[int, Any], *, size: int) -> None:
        effect, rough, mirror = (np.zeros(size, dtype=np.uint32) for _ in range(3))
        for index, shape in shapes.items():
            bsdf = shape.bsdf()
            effect[index] = _effect_on_line(bsdf)
            rough[index] = int(bsdf.flags()) & int(mi.BSDFFlags.Glossy) != 0
            mirror[index] = _component(bsdf, mi.BSDFFlags.DeltaReflection) + 1
        self.any = bool(effect.any())
        self._mirrors = sorted(set(mirror[effect == STRAIGHT].tolist()) - {0})
        self._effect: Any = mi.UInt32(effect)
        self._rough: Any = mi.UInt32(rough)
        self._mirror: Any = mi.UInt32(mirror)

    def effect_on_line(self, hit: Any, valid: Any) -> Any:
        """Return OPAQUE, STRAIGHT or BENDING for the surfaces that rays hit, UInt32 (ray,)."""
        return dr.gather(mi.UInt32, self._effect, number_shapes(hit), valid)

    def mirrors(self, hit: Any, active: Any) -> Any:
        """Return whether surfaces that let light straight through also reflect light like a mirror, Bool (ray,)."""
        through = hit.bsdf().eval_null_transmission(hit, active).x
        return active & (self._mirrored(hit, through, active=active) > 0)

    def reflected_fraction(self, hit: Any, through: Any, *, active: Any) -> Any:
        """Return the largest fraction of light that surfaces reflect if ``through`` of it goes straight on, (ray,)."""
        matt = dr.select(active, hit.bsdf().eval_diffuse_reflectance(hit, active).x, 0)
        rough = dr.gather(mi.UInt32, self._rough, number_shapes(hit), active) > 0
        reflected = dr.select(rough, 1, matt + self._mirrored(hit, through, active=active))
        return dr.fmin(dr.fmax(reflected, 0), 1 - through)  # 0 where a picture from a file is nan

    def _mirrored(self, hit: Any, through: Any, *, active: Any) -> Any:
        """Return the fraction of light that surfaces reflect like a mirror, (ray,); masks get an upper bound."""
        index = dr.gather(mi.UInt32, self._mirror, number_shapes(hit), active)
        bsdf, fraction = hit.bsdf(), mi.Float(0)
        for number in self._mirrors:
            context = mi.BSDFContext()
            context.component = number - 1
            its = active & (index == number)
            _, weight = bsdf.sample(context, hit, mi.Float(0.5), mi.Point2f(0.5), its)
            fraction = dr.select(its, weight.x, fraction)
        return dr.minimum(fraction, 1 - through)  # nan where a picture from a file is: no mirror, see the callers


def number_shapes(hit: Any) -> Any:
    """Return the numbers in Dr.Jit's registry of the shapes that rays hit, UInt32 (ray,)."""
    return dr.reinterpret_array(mi.UInt32, hit.shape)


@dr.syntax
def through_glass(scene: Any, ray: Any, clear: ClearSurfaces, *, axial: Any, seed: int, first: int) -> LineOfSight:
    """Follow rays through the clear surfaces of a scene.

    Parameters
    ----------
    scene : mi.Scene
        Scene to trace.
    ray : mi.Ray3f
        Rays to follow.
    clear : ClearSurfaces
        Clear surfaces of the scene.
    axial : callable
        Called with points in the world; returns their axial distances (m).
    seed : int
        Seed of the random numbers.
    first : int
        Number of the first ray among all rays, so that every ray has its own random numbers.
    """
    count = dr.width(ray.o)
    random = mi.PCG32(  # type: ignore[operator]
        initstate=mi.UInt64(dr.opaque(mi.UInt32, seed & 0xFFFFFFFF)),
        initseq=mi.UInt64(dr.arange(mi.UInt32, count) + dr.opaque(mi.UInt32, first & 0xFFFFFFFF)),
    )
    line, branch, segment = mi.Ray3f(ray), mi.Ray3f(ray), mi.Ray3f(ray)
    clearness, branch_fraction, total, reflection_weight = mi.Float(1), mi.Float(0), mi.Float(0), mi.Float(0)
    straight = mi.Bool(True)
    nearest, farthest = mi.Float(dr.inf), mi.Float(0)
    surfaces, active = mi.UInt32(0), dr.full(mi.Bool, True, count)
    max_surfaces = dr.opaque(mi.UInt32, MAX_SURFACES)
    while active:
        hit = scene.ray_intersect(line, active)
        active &= hit.is_valid()
        effect = clear.effect_on_line(hit, active)
        active &= (effect != OPAQUE) & (surfaces < max_surfaces)
        unbent, bent = active & (effect == STRAIGHT), active & (effect == BENDING)

        through = dr.fmax(hit.bsdf().eval_null_transmission(hit, unbent).x, 0)  # opaque where a picture is nan
        back = clear.reflected_fraction(hit, through, active=unbent)
        weight = dr.select(unbent, clearness * back, 0)
        total += weight
        chosen = random.next_float32() * total < weight
        segment = dr.select(chosen, line, segment)
        reflection_weight = dr.select(chosen, 1 / back, reflection_weight)
        distance = axial(hit.p)  # nan only without a hit, and then not selected
        nearest = dr.select(unbent & straight, dr.minimum(nearest, distance), nearest)
        farthest = dr.select(unbent & straight, dr.maximum(farthest, distance), farthest)

        towards, fraction, other, other_fraction = _bend(hit, bent)
        weight = dr.select(bent, clearness * other_fraction, 0)
        branch_fraction += weight
        chosen = random.next_float32() * branch_fraction < weight
        branch = dr.select(chosen, hit.spawn_ray(other), branch)
        clearness = dr.select(unbent, clearness * through, dr.select(bent, clearness * fraction, clearness))
        straight &= ~bent
        line = dr.select(active, hit.spawn_ray(dr.select(bent, towards, line.d)), line)
        active &= clearness > 0
        surfaces += 1
    active, surfaces = branch_fraction > 0, mi.UInt32(0)
    while active:
        hit = scene.ray_intersect(branch, active)
        active &= hit.is_valid()
        active &= (clear.effect_on_line(hit, active) == BENDING) & (surfaces < max_surfaces)
        sample, fraction = hit.bsdf().sample(mi.BSDFContext(), hit, random.next_float32(), mi.Point2f(0.5), active)
        branch_fraction = dr.select(active, branch_fraction * fraction.x, branch_fraction)
        branch = dr.select(active, hit.spawn_ray(hit.to_world(sample.wo)), branch)
        surfaces += 1
    draw = random.next_float32()
    return LineOfSight(
        line, clearness, branch, branch_fraction, segment, total, reflection_weight, draw, straight, nearest, farthest
    )


def _bend(hit: Any, active: Any) -> tuple[Any, Any, Any, Any]:
    """Return the directions in which polished surfaces reflect and refract, each with its fraction of the light.

    The larger fraction comes first; the other is 0 if there is only one direction.
    """
    bsdf, context, nowhere = hit.bsdf(), mi.BSDFContext(), mi.Point2f(0.5)
    # A draw of 0 gives the reflected direction, a draw just below 1 the refracted one, if there is one.
    reflected, r = bsdf.sample(context, hit, mi.Float(0), nowhere, active)
    refracted, t = bsdf.sample(context, hit, mi.Float(1 - 2.0**-24), nowhere, active)
    both = refracted.sampled_type != reflected.sampled_type
    refracts = both & (refracted.pdf > 0.5)
    reflected_part, refracted_part = r.x * dr.select(both, reflected.pdf, 1), dr.select(both, t.x * refracted.pdf, 0)
    return (
        hit.to_world(dr.select(refracts, refracted.wo, reflected.wo)),
        dr.select(refracts, refracted_part, reflected_part),
        hit.to_world(dr.select(refracts, reflected.wo, refracted.wo)),
        dr.select(refracts, reflected_part, refracted_part),
    )


def _effect_on_line(bsdf: Any) -> int:
    flags = int(bsdf.flags())
    if flags & int(mi.BSDFFlags.Null):
        return STRAIGHT
    return BENDING if flags & int(DELTA) and not flags & int(SCATTERING) else OPAQUE


def _component(bsdf: Any, flag: Any) -> int:
    """Return the number of the first component of a BSDF that has a flag, or -1."""
    found = (n for n in range(bsdf.component_count()) if int(bsdf.flags(n)) & int(flag))
    return next(found, -1)
