"""Lines of sight through clear surfaces: glass, thin sheets, masks.

A camera ray that meets a clear surface goes on: straight through a surface that lets light through unbent (a stained
section, a mask), and in the direction of the larger share from one that reflects and refracts as polished glass does.
It ends at the first surface that is not clear, or in light. How much of the light there reaches the lens is known
without chance.

Every bend has another direction. One of all that a line passes is chosen, in proportion to its share (a reservoir: Chao
1982), counts for all, and is followed too, from bend to bend by chance. In the same way one surface is chosen of those
that reflect light towards the line: the surfaces at its ends, and the straight ones on its way.

References
----------
M. T. Chao, Biometrika 69, 653 (1982), doi:10.1093/biomet/69.3.653.
"""

from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

MOST_SURFACES = 16  # clear surfaces on a line; what it meets next is traced as whole light paths
DELTA = mi.BSDFFlags.DeltaReflection | mi.BSDFFlags.DeltaTransmission
SCATTERING = mi.BSDFFlags.Diffuse | mi.BSDFFlags.Glossy
OPAQUE, STRAIGHT, BENDING = range(3)  # what a surface does to a line


class LineOfSight(NamedTuple):
    """Lines of sight through clear surfaces, as Dr.Jit's arrays (ray,).

    Attributes
    ----------
    last : Ray3f, the part of the line behind all clear surfaces.
    clearness : how much of the light at its end reaches the lens.
    aside : Ray3f, the last part of the line that leaves it at a bend.
    share_aside : how much of the light at its end reaches the lens; 0 where there is none.
    segment : Ray3f, the part that meets the clear surface that was chosen to throw light back.
    thrown_back : how much the light may count that all of them throw back; 0 where none does.
    per_share : what the light that the chosen one throws back counts for, over ``thrown_back``.
    draw : a random number in 0...1, to choose between them and the surfaces at the ends.
    straight : whether the line was never bent.
    nearest, farthest : axial distances (m) of the clear surfaces before the first that bends the line, from the lens at
        the middle of its travel; inf and 0 where there are none.
    """

    last: Any
    clearness: Any
    aside: Any
    share_aside: Any
    segment: Any
    thrown_back: Any
    per_share: Any
    draw: Any
    straight: Any
    nearest: Any
    farthest: Any


class ClearSurfaces:
    """The clear surfaces of a scene, by what they do to a line of sight."""

    def __init__(self, shapes: dict[int, Any], *, size: int) -> None:
        """``shapes`` are by their numbers in Dr.Jit's registry, which are below ``size``."""
        does, rough, mirror = (np.zeros(size, dtype=np.uint32) for _ in range(3))
        for index, shape in shapes.items():
            bsdf = shape.bsdf()
            does[index] = _does_to_line(bsdf)
            rough[index] = int(bsdf.flags()) & int(mi.BSDFFlags.Glossy) != 0
            mirror[index] = _component(bsdf, mi.BSDFFlags.DeltaReflection) + 1
        self.any = bool(does.any())
        self._mirrors = sorted(set(mirror[does == STRAIGHT].tolist()) - {0})
        self._does: Any = mi.UInt32(does)
        self._rough: Any = mi.UInt32(rough)
        self._mirror: Any = mi.UInt32(mirror)

    def does_to_line(self, hit: Any, valid: Any) -> Any:
        """Return OPAQUE, STRAIGHT or BENDING for the surfaces that rays hit, UInt32 (ray,)."""
        return dr.gather(mi.UInt32, self._does, number_shapes_that_rays_hit(hit), valid)

    def mirrors(self, hit: Any, active: Any) -> Any:
        """Return whether surfaces that are lit straight through reflect some light as a mirror does, Bool (ray,)."""
        through = hit.bsdf().eval_null_transmission(hit, active).x
        return active & (self._mirrored(hit, through, active=active) > 0)

    def thrown_back(self, hit: Any, through: Any, *, active: Any) -> Any:
        """Return how much light surfaces throw back at most, of which ``through`` goes straight on, (ray,)."""
        matt = dr.select(active, hit.bsdf().eval_diffuse_reflectance(hit, active).x, 0)
        rough = dr.gather(mi.UInt32, self._rough, number_shapes_that_rays_hit(hit), active) > 0
        return dr.clip(dr.select(rough, 1, matt + self._mirrored(hit, through, active=active)), 0, 1 - through)

    def _mirrored(self, hit: Any, through: Any, *, active: Any) -> Any:
        """Return the fraction of light that surfaces reflect as a mirror does, (ray,); of a mask at most."""
        index = dr.gather(mi.UInt32, self._mirror, number_shapes_that_rays_hit(hit), active)
        bsdf, share = hit.bsdf(), mi.Float(0)
        for number in self._mirrors:
            context = mi.BSDFContext()
            context.component = number - 1
            its = active & (index == number)
            _, weight = bsdf.sample(context, hit, mi.Float(0.5), mi.Point2f(0.5), its)
            share = dr.select(its, weight.x, share)
        return dr.minimum(share, 1 - through)


def number_shapes_that_rays_hit(hit: Any) -> Any:
    """Return the numbers in Dr.Jit's registry of the shapes that rays hit, UInt32 (ray,)."""
    return dr.reinterpret_array(mi.UInt32, hit.shape)


@dr.syntax
def follow_rays_through_glass(
    scene: Any, ray: Any, clear: ClearSurfaces, *, axial: Any, seed: int, first: int
) -> LineOfSight:
    """Follow rays through the clear surfaces of a scene.

    Parameters
    ----------
    ray : Dr.Jit's rays.
    axial : function of points in the world that returns their axial distance (m).
    seed, first : name the random numbers; ``first`` is the number of the first ray among all.
    """
    count = dr.width(ray.o)
    random = mi.PCG32(  # type: ignore[operator]
        initstate=mi.UInt64(dr.opaque(mi.UInt32, seed & 0xFFFFFFFF)),
        initseq=mi.UInt64(dr.arange(mi.UInt32, count) + dr.opaque(mi.UInt32, first & 0xFFFFFFFF)),
    )
    line, aside, segment = mi.Ray3f(ray), mi.Ray3f(ray), mi.Ray3f(ray)
    clearness, share_aside, total, per_share = mi.Float(1), mi.Float(0), mi.Float(0), mi.Float(0)
    straight = mi.Bool(True)
    nearest, farthest = mi.Float(dr.inf), mi.Float(0)
    surfaces, active = mi.UInt32(0), dr.full(mi.Bool, True, count)
    most = dr.opaque(mi.UInt32, MOST_SURFACES)
    while active:
        hit = scene.ray_intersect(line, active)
        active &= hit.is_valid()
        does = clear.does_to_line(hit, active)
        active &= (does != OPAQUE) & (surfaces < most)
        unbent, bent = active & (does == STRAIGHT), active & (does == BENDING)

        through = hit.bsdf().eval_null_transmission(hit, unbent).x
        back = clear.thrown_back(hit, through, active=unbent)
        weight = dr.select(unbent, clearness * back, 0)
        total += weight
        chosen = random.next_float32() * total < weight
        segment = dr.select(chosen, line, segment)
        per_share = dr.select(chosen, 1 / back, per_share)
        distance = axial(hit.p)
        nearest = dr.select(unbent & straight, dr.minimum(nearest, distance), nearest)
        farthest = dr.select(unbent & straight, dr.maximum(farthest, distance), farthest)

        towards, share, other, other_share = _bend(hit, bent)
        weight = dr.select(bent, clearness * other_share, 0)
        share_aside += weight
        chosen = random.next_float32() * share_aside < weight
        aside = dr.select(chosen, hit.spawn_ray(other), aside)
        clearness = dr.select(unbent, clearness * through, dr.select(bent, clearness * share, clearness))
        straight &= ~bent
        line = dr.select(active, hit.spawn_ray(dr.select(bent, towards, line.d)), line)
        active &= clearness > 0
        surfaces += 1
    active, surfaces = share_aside > 0, mi.UInt32(0)
    while active:
        hit = scene.ray_intersect(aside, active)
        active &= hit.is_valid()
        active &= (clear.does_to_line(hit, active) == BENDING) & (surfaces < most)
        sample, share = hit.bsdf().sample(mi.BSDFContext(), hit, random.next_float32(), mi.Point2f(0.5), active)
        share_aside = dr.select(active, share_aside * share.x, share_aside)
        aside = dr.select(active, hit.spawn_ray(hit.to_world(sample.wo)), aside)
        surfaces += 1
    draw = random.next_float32()
    return LineOfSight(
        line, clearness, aside, share_aside, segment, total, per_share, draw, straight, nearest, farthest
    )


def _bend(hit: Any, active: Any) -> tuple[Any, Any, Any, Any]:
    """Return the directions in which polished surfaces reflect and refract, each with its share, the larger first.

    The other share is 0 where there is one direction only.
    """
    bsdf, context, nowhere = hit.bsdf(), mi.BSDFContext(), mi.Point2f(0.5)
    # A draw of 0 gives the direction of reflection, one next to 1 that of refraction where there is one.
    reflected, r = bsdf.sample(context, hit, mi.Float(0), nowhere, active)
    refracted, t = bsdf.sample(context, hit, mi.Float(1 - 2.0**-24), nowhere, active)
    both = refracted.sampled_type != reflected.sampled_type
    refracts = both & (refracted.pdf > 0.5)
    here, there = r.x * dr.select(both, reflected.pdf, 1), dr.select(both, t.x * refracted.pdf, 0)
    return (
        hit.to_world(dr.select(refracts, refracted.wo, reflected.wo)),
        dr.select(refracts, there, here),
        hit.to_world(dr.select(refracts, reflected.wo, refracted.wo)),
        dr.select(refracts, here, there),
    )


def _does_to_line(bsdf: Any) -> int:
    flags = int(bsdf.flags())
    if flags & int(mi.BSDFFlags.Null):
        return STRAIGHT
    return BENDING if flags & int(DELTA) and not flags & int(SCATTERING) else OPAQUE


def _component(bsdf: Any, flag: Any) -> int:
    """Return the number of the first component of a BSDF with a flag, or -1."""
    found = (n for n in range(bsdf.component_count()) if int(bsdf.flags(n)) & int(flag))
    return next(found, -1)
