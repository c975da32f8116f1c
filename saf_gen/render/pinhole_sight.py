"""What a pinhole at the lens centre sees: the first visible surfaces, and the target behind clear ones.

A ray passes through what cannot be seen (a ``null`` surface, the boundary of a medium, a mask where its opacity is 0)
and on through what is clear: straight through thin glass and through a mask that is at most half opaque, and by
refraction through glass that is polished, or as good as polished. If the line meets the target, the pixel sees the
target. If it does not, the pixel sees the first visible surface, which may be the glass.

Clear surfaces of the target itself are the target: drops on a window, a stained section, a film with holes on a plate.

Behind glass, the depth that counts is where the lens must be focused. Rays through four points of the aperture are
aimed at a point of the pixel's line of sight. If they meet the target beside the point that the middle of the lens
sees, the target appears nearer or farther than that. The *vergence* 1/z of the apparent point minimises the mean
squared blur over the aperture: it is half the trace of the matrix that gives the slope of a ray from the target's point
by its position on the lens. A window of thickness t brings the target nearer by t(1 - 1/n), less the spherical
aberration of the window at this aperture. Behind curved glass, some blur may remain at any position.
"""

import math
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from saf_gen.optics import FittedRays
from saf_gen.render.camera_rays import aligned
from saf_gen.render.line_of_sight import BENDING, OPAQUE, SCATTERING, STRAIGHT, number_shapes
from saf_gen.render.render_setup import RenderSetup

MAX_SURFACES = 32  # clear surfaces on a line
LINES_AT_ONCE = 1 << 15  # what they meet takes 44 bytes for each line and surface
AHEAD = [("shape", "u4"), ("through", "f4"), *((name, "f4", 3) for name in ("point", "next_origin", "next_direction"))]
INVISIBLE = 1 - 1e-6  # smallest fraction of the light that an invisible surface lets straight through
SAME_SHEET = 5e-5  # of the distance: a film of the target with holes counts as one with the target's surface behind it
MIN_CLEAR = 0.5  # fraction of the light that a mask or a glass surface must let through for the line to go on
MAX_ALPHA = 0.01  # roughness α of glass that is as good as polished; it spreads rays by about α(n - 1)
LEAST_SQUARES_RADIUS = (2 / 3) ** 0.5  # of the aperture; the radius at which rays with spherical aberration meet at the
# focus of least mean squared blur
SHRINKAGE = (1.0, 1 / 8, 1 / 64)  # smaller parts of aperture and picture are tried if the target ends or is hidden
SLOPE_STEP_PX = 2.0


class Effect(NamedTuple):
    """Effect of a surface on a line of sight.

    Attributes
    ----------
    kind : int
        OPAQUE, STRAIGHT or BENDING.
    through : float
        Fraction of the light that goes straight through; negative if it differs from point to point.
    least : float
        Smallest fraction with which a line goes on behind a surface that is not the target.
    ratio : float
        Refractive index inside, relative to outside; 0 to sample the surface's own refraction.
    """

    kind: int
    through: float = -1.0
    least: float = MIN_CLEAR
    ratio: float = 0.0


class Ends(NamedTuple):
    """Where lines of sight end, as arrays (ray,) in the scene's units.

    Attributes
    ----------
    on_target, seen : ndarray of bool
        Whether the line meets the target, and whether it meets any visible surface.
    point : ndarray of float64, shape (ray, 3)
        Point on the target, or else on the first visible surface; inf if there is none.
    first : ndarray of float64, shape (ray, 3)
        Point on the first visible surface; inf if there is none.
    first_passed, passed : ndarray of int
        Numbers of surfaces before ``first`` and before ``point``.
    bent : ndarray of bool
        Whether the line is bent before ``point``.
    origin, direction : ndarray of float64, shape (ray, 3)
        Part of the line that meets ``point``.
    last : ndarray of int
        Number of the last visible surface that the line meets, target or not, -1 if there is none: see
        :meth:`PinholeSight.name_of`.
    instance : ndarray of int
        Number of the instance of which this surface is a part, -1 if of none.
    last_point : ndarray of float64, shape (ray, 3)
        Point on the last surface.
    """

    on_target: np.ndarray
    seen: np.ndarray
    point: np.ndarray
    first: np.ndarray
    first_passed: np.ndarray
    passed: np.ndarray
    bent: np.ndarray
    origin: np.ndarray
    direction: np.ndarray
    last: np.ndarray
    instance: np.ndarray
    last_point: np.ndarray

    def at_last(self, ray: int) -> tuple[int, int, np.ndarray]:
        """Return the numbers of the last surface of a line and of its instance, and the point on it."""
        return int(self.last[ray]), int(self.instance[ray]), self.last_point[ray]

    def only(self, chosen: np.ndarray) -> "Ends":
        """Return the ends of some of the lines."""
        return Ends(*(values[chosen] for values in self))


class PinholeSight:
    """Follows rays from the lens to what they show.

    Parameters
    ----------
    scene : mi.Scene
        Scene to trace.
    target_shapes : tuple of str
        Ids of the target's shapes: shapes, instances, or shapes in the shape group of an instance.

    Attributes
    ----------
    has_instances : bool
        Whether the scene has instances, so that the shapes of its surfaces are not those of the scene.
    may_follow : bool
        Whether any line of sight may go on behind the first surface that it meets, or meet an instance.
    """

    def __init__(self, scene: Any, target_shapes: tuple[str, ...]) -> None:
        self._scene, self._target = scene, target_shapes
        self._shapes: list[Any] = []  # shapes met so far, kept alive so that their keys stay theirs
        self._number: dict[int, int] = {}
        self._effects: list[Effect] = []
        shapes = scene.shapes()
        self.has_instances = any(shape.class_name() == "Instance" for shape in shapes)
        self._effect_of = {shape.id(): effect_of(shape.bsdf()) for shape in shapes}
        bent_here = any(effect.ratio > 0 for effect in self._effect_of.values())
        self._bends_on_device = dr.is_jit_v(mi.Float) and not (self.has_instances or bent_here)
        self.may_follow = self.has_instances or any(self.must_follow(shape) for shape in shapes)

    def must_follow(self, shape: Any) -> bool:
        """Return whether a line that meets this shape of the scene may go on."""
        effect = self._effect_of.get(shape.id(), Effect(OPAQUE))
        return effect.kind == STRAIGHT or (effect.kind == BENDING and shape.id() not in self._target)

    def is_target(self, shape: Any) -> bool:
        """Return whether a shape is one of the target's."""
        return shape.id() in self._target

    def follow(self, origin: np.ndarray, direction: np.ndarray) -> Ends:
        """Follow rays, float64 (ray, 3) in the scene's units, to the target or to the first visible surface."""
        count = len(origin)
        if count > LINES_AT_ONCE:
            parts = (slice(begin, begin + LINES_AT_ONCE) for begin in range(0, count, LINES_AT_ONCE))
            ends_of = [self.follow(origin[part], direction[part]) for part in parts]
            return Ends(*map(np.concatenate, zip(*ends_of, strict=True)))
        ahead = self._look_ahead(origin, direction) if self._bends_on_device and count else None
        line_o, line_d = np.array(origin, dtype=np.float64), np.array(direction, dtype=np.float64)
        line_bent = np.zeros(count, dtype=bool)
        nowhere = np.full((count, 3), np.inf)
        first_passed = np.zeros(count, dtype=int)
        ends = Ends(
            on_target=np.zeros(count, dtype=bool),
            seen=np.zeros(count, dtype=bool),
            point=nowhere.copy(),
            first=nowhere.copy(),
            first_passed=first_passed,
            passed=np.zeros(count, dtype=int),
            bent=line_bent.copy(),
            origin=line_o.copy(),
            direction=line_d.copy(),
            last=np.full(count, -1),
            instance=np.full(count, -1),
            last_point=nowhere.copy(),
        )
        hole, hole_at = ends.only(np.arange(count)), np.full(count, -1)  # the last hole in the target
        active = np.arange(count)
        for number in range(MAX_SURFACES):
            if not active.size:
                break
            if ahead is not None:
                met = self._meeting_of(ahead[number, active], direction=line_d[active])
            else:
                met = self._meet(line_o[active], line_d[active])
            active, met = active[met.valid], met.where(met.valid)
            invisible = (met.kind == STRAIGHT) & (met.through >= INVISIBLE)
            last = active[~invisible]
            ends.last_point[last], ends.last[last] = met.point[~invisible], met.shape[~invisible]
            ends.instance[last] = met.instance[~invisible]
            target = met.is_target & ~invisible
            is_first = ~invisible & ~ends.seen[active]
            ends.first[active[is_first]], ends.first_passed[active[is_first]] = met.point[is_first], number
            for which, into in ((target | is_first, ends), (met.is_target & invisible, hole)):
                rays = active[which]
                into.point[rays], into.passed[rays], into.bent[rays] = met.point[which], number, line_bent[rays]
                into.origin[rays], into.direction[rays] = line_o[rays], line_d[rays]
            hole_at[active[met.is_target & invisible]] = number
            ends.seen[active] |= target | is_first
            ends.on_target[active] = target
            beneath = active[target & (hole_at[active] == number - 1)]
            gap = np.linalg.norm(ends.point[beneath] - hole.point[beneath], axis=1)
            beneath = beneath[gap <= SAME_SHEET * np.linalg.norm(ends.point[beneath] - origin[beneath], axis=1)]
            for name in ("point", "passed", "bent", "origin", "direction"):
                getattr(ends, name)[beneath] = getattr(hole, name)[beneath]
            line_bent[active] |= met.kind == BENDING
            line_o[active], line_d[active] = met.next_origin, met.next_direction
            is_clear = (met.kind != OPAQUE) & (met.through >= met.least) & (met.through > 0)
            active = active[~target & (invisible | is_clear)]
        return ends

    def name_of(self, number: int) -> str:
        """Return the id of a shape by its number in :class:`Ends`, '' for -1."""
        return self._shapes[number].id() if number >= 0 else ""

    def _look_ahead(self, origin: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Return all that rays meet one after another until a surface stops all light: AHEAD (surface, ray).

        One kernel does all. It knows neither the target nor by how much a surface must let light through, and may go on
        farther than a line.
        """
        numbered = [
            (int(np.array(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(s)))[0]), s) for s in self._scene.shapes()
        ]
        kind = np.zeros(max(n for n, _ in numbered) + 1, dtype=np.uint32)
        for n, shape in numbered:
            kind[n] = self._effect_of[shape.id()].kind
            self._number_of(shape, n)
        begin, towards = (
            [mi.Float(aligned(np.ascontiguousarray(x, dtype=np.float32))) for x in part.T]
            for part in (origin, direction)
        )
        ray = mi.Ray3f(mi.Point3f(*begin), mi.Vector3f(*towards))
        shape, through, *vectors = _meet_in_turn(self._scene, ray, mi.UInt32(kind), mi.UInt32(MAX_SURFACES))
        found = np.empty((MAX_SURFACES, len(origin)), dtype=AHEAD)
        found["shape"], found["through"] = (array.numpy().reshape(found.shape) for array in (shape, through))
        for name, vector in zip(("point", "next_origin", "next_direction"), vectors, strict=True):
            found[name] = np.moveaxis(vector.numpy().reshape(3, *found.shape), 0, -1)
        return found

    def _meeting_of(self, ahead: np.ndarray, *, direction: np.ndarray) -> "_Meeting":
        """Return what rays with these directions meet, as found by :meth:`_look_ahead`."""
        valid = ahead["shape"] > 0
        keys, inverse = np.unique(ahead["shape"], return_inverse=True)
        shape = np.array([self._number[int(key)] if key else -1 for key in keys])[inverse.reshape(-1)]
        effects = [Effect(OPAQUE), *self._effects]
        kind, through, least = (np.array([effect[n] for effect in effects])[shape + 1] for n in range(3))
        found = ((kind == STRAIGHT) & (through < 0)) | (kind == BENDING)
        through = np.where(found, ahead["through"].astype(np.float64), through)
        next_direction = np.where((kind == BENDING)[:, None], ahead["next_direction"].astype(np.float64), direction)
        points = (ahead[name].astype(np.float64) for name in ("point", "next_origin"))
        point, next_origin = points
        instance = np.full(shape.shape, -1)
        is_target = self._is_target(shape, instance)
        return _Meeting(valid, point, shape, instance, is_target, kind, through, least, next_origin, next_direction)

    def _meet(self, origin: np.ndarray, direction: np.ndarray) -> "_Meeting":
        """Return what rays meet next, and how they go on behind it."""
        if dr.is_jit_v(mi.Float):
            return self._meet_all(origin, direction)
        met = [self._meet_one(mi.Point3f(o), mi.Vector3f(d)) for o, d in zip(origin, direction, strict=True)]
        return _Meeting(*(np.array(values) for values in zip(*met, strict=True)))

    def _meet_all(self, origin: np.ndarray, direction: np.ndarray) -> "_Meeting":
        towards = mi.Vector3f(*(mi.Float(np.ascontiguousarray(x, dtype=np.float32)) for x in direction.T))
        begin = mi.Point3f(*(mi.Float(np.ascontiguousarray(x, dtype=np.float32)) for x in origin.T))
        hit = self._scene.ray_intersect(mi.Ray3f(begin, towards))
        dr.eval(hit)  # once: otherwise each array that is read below traces the rays again
        valid = hit.is_valid().numpy()
        shape, instance = self._numbers(hit.shape), self._numbers(hit.instance)
        effects = [self._effects[n] if n >= 0 else Effect(OPAQUE) for n in range(-1, len(self._effects))]
        kind, through, least, index = (np.array(values)[shape + 1] for values in zip(*effects, strict=True))
        bsdf, varies = hit.bsdf(), (kind == STRAIGHT) & (through < 0)
        if varies.any():
            found = np.array(bsdf.eval_null_transmission(hit, mi.Bool(varies)).x).reshape(-1)
            through = np.where(varies, found, through)
        next_direction = np.where(valid[:, None], direction, [0.0, 0.0, 1.0])
        sampled = (kind == BENDING) & (index == 0)
        if sampled.any():
            sample, weight = bsdf.sample(
                mi.BSDFContext(), hit, mi.Float(1 - 2.0**-24), mi.Point2f(0.5), mi.Bool(sampled)
            )
            outgoing, chance = hit.to_world(sample.wo), sample.pdf * (weight.x > 0)
            dr.eval(outgoing, chance)
            next_direction = np.where(sampled[:, None], _columns(outgoing, len(origin)), next_direction)
            part = np.array(chance, dtype=np.float64).reshape(-1)
            through = np.where(sampled, part, through)
        snell = (kind == BENDING) & (index > 0)
        if snell.any():
            normal = _columns(hit.sh_frame.n, len(origin))
            refracted, part = refract(direction[snell], normal[snell], index=index[snell])
            next_direction[snell], through[snell] = refracted, part * through[snell]
        ahead = mi.Vector3f(*(mi.Float(np.ascontiguousarray(x, dtype=np.float32)) for x in next_direction.T))
        next_origin = _columns(hit.spawn_ray(ahead).o, len(origin))
        is_target = self._is_target(shape, instance)
        point = _columns(hit.p, len(origin))
        return _Meeting(valid, point, shape, instance, is_target, kind, through, least, next_origin, next_direction)

    def _meet_one(self, origin: Any, direction: Any) -> tuple[Any, ...]:
        hit = self._scene.ray_intersect(mi.Ray3f(origin, direction))
        towards = np.array(direction, dtype=np.float64).reshape(3)
        if not hit.is_valid():
            zero = np.zeros(3)
            return (False, zero, -1, -1, False, OPAQUE, 0.0, 1.0, zero, towards)
        shape = self._number_of(hit.shape, id(hit.shape))
        instance = -1 if hit.instance is None else self._number_of(hit.instance, id(hit.instance))
        kind, through, least, index = self._effects[shape]
        if kind == STRAIGHT and through < 0:
            through = float(np.array(hit.bsdf().eval_null_transmission(hit)).reshape(-1)[0])
        elif kind == BENDING and index == 0:
            sample, weight = hit.bsdf().sample(mi.BSDFContext(), hit, 1 - 2.0**-24, mi.Point2f(0.5))
            towards = np.array(hit.to_world(sample.wo), dtype=np.float64).reshape(3)
            through = float(sample.pdf) * bool(np.array(weight).reshape(-1)[0] > 0)
        elif kind == BENDING:
            normal = np.array(hit.sh_frame.n, dtype=np.float64).reshape(1, 3)
            bent, part = refract(towards[None], normal, index=np.array([index]))
            towards, through = bent[0], float(part[0]) * through
        next_origin = np.array(hit.spawn_ray(mi.Vector3f(towards)).o, dtype=np.float64).reshape(3)
        is_target = bool(self._is_target(np.array([shape]), np.array([instance]))[0])
        point = np.array(hit.p, dtype=np.float64).reshape(3)
        return (True, point, shape, instance, is_target, kind, through, least, next_origin, towards)

    def _is_target(self, shape: np.ndarray, instance: np.ndarray) -> np.ndarray:
        wanted = np.array([False, *(met.id() in self._target for met in self._shapes)])
        return wanted[shape + 1] | wanted[instance + 1]

    def _numbers(self, pointers: Any) -> np.ndarray:
        """Return the numbers of the shapes at these pointers, -1 for none, int (ray,)."""
        keys: np.ndarray = np.array(dr.reinterpret_array(mi.UInt32, pointers))
        unique, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
        found = [
            self._number_of(pointers[int(n)], int(key)) if key else -1 for key, n in zip(unique, first, strict=True)
        ]
        return np.array(found)[inverse.reshape(-1)]

    def _number_of(self, shape: Any, key: int) -> int:
        if key not in self._number:
            self._number[key] = len(self._shapes)
            self._shapes.append(shape)
            self._effects.append(effect_of(shape.bsdf()))
        return self._number[key]


class _Meeting(NamedTuple):
    """What rays meet next, arrays (ray,): numbers of shapes and instances, effects, and how the rays go on."""

    valid: np.ndarray
    point: np.ndarray
    shape: np.ndarray
    instance: np.ndarray
    is_target: np.ndarray
    kind: np.ndarray
    through: np.ndarray
    least: np.ndarray
    next_origin: np.ndarray
    next_direction: np.ndarray

    def where(self, chosen: np.ndarray) -> "_Meeting":
        return _Meeting(*(values[chosen] for values in self))


@dr.syntax
def _meet_in_turn(scene: Any, line: Any, kind_of: Any, max_surfaces: Any) -> tuple[Any, ...]:
    """Follow rays to all surfaces that they meet, and return what each met, as arrays (surface · rays + ray,).

    These are the number in Dr.Jit's registry of the shape, 0 for none; the fraction of the light that goes on; the
    point; and origin and direction behind it. ``kind_of`` holds the kind of effect of each shape.
    """
    count = dr.width(line.o)
    row, lane = dr.opaque(mi.UInt32, count), dr.arange(mi.UInt32, count)
    shapes, fractions = dr.zeros(mi.UInt32, MAX_SURFACES * count), dr.zeros(mi.Float, MAX_SURFACES * count)
    points, origins, directions = (dr.zeros(mi.Point3f, MAX_SURFACES * count) for _ in range(3))
    dr.make_opaque(shapes, fractions, points, origins, directions, max_surfaces)
    active, number = dr.full(mi.Bool, True, count), mi.UInt32(0)
    while active:
        hit = scene.ray_intersect(line, active)
        active &= hit.is_valid()
        kind = dr.gather(mi.UInt32, kind_of, number_shapes(hit), active)
        unbent, bent = active & (kind == STRAIGHT), active & (kind == BENDING)
        bsdf = hit.bsdf()
        straight_on = bsdf.eval_null_transmission(hit, unbent).x
        # A draw just below 1 gives the refracted direction, if there is one.
        sample, weight = bsdf.sample(mi.BSDFContext(), hit, mi.Float(1 - 2.0**-24), mi.Point2f(0.5), bent)
        through = dr.select(bent, sample.pdf * (weight.x > 0), dr.select(unbent, straight_on, 0))
        ahead = hit.spawn_ray(dr.select(bent, hit.to_world(sample.wo), line.d))
        at = number * row + lane
        dr.scatter(shapes, number_shapes(hit), at, active)
        dr.scatter(fractions, through, at, active)
        dr.scatter(points, hit.p, at, active)
        dr.scatter(origins, ahead.o, at, active)
        dr.scatter(directions, mi.Point3f(ahead.d), at, active)
        line = dr.select(active, ahead, line)
        number += 1
        active &= (unbent | bent) & (number < max_surfaces)
    dr.eval(shapes, fractions, points, origins, directions)
    return shapes, fractions, points, origins, directions


def _columns(vector: Any, count: int) -> np.ndarray:
    """Return vectors of Dr.Jit as float64 (count, 3)."""
    return np.broadcast_to(np.array(vector, dtype=np.float64).reshape(3, -1).T, (count, 3)).copy()


def refract(direction: np.ndarray, normal: np.ndarray, *, index: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the refracted directions, float64 (ray, 3), and the fraction of unpolarised light in them, (ray,).

    ``normal`` points to the outside, ``index`` is that of the inside relative to the outside. Where light is totally
    reflected, the direction is that of the reflection, and the fraction is 1.
    """
    cosine = -np.sum(direction * normal, axis=1)
    inward = cosine > 0
    facing = np.where(inward[:, None], normal, -normal)
    cosine, ratio = np.abs(cosine), np.where(inward, 1 / index, index)
    square = 1 - ratio**2 * (1 - cosine**2)
    total = square < 0
    inner = np.sqrt(np.maximum(square, 0))
    bent = ratio[:, None] * direction + (ratio * cosine - inner)[:, None] * facing
    reflected = direction + 2 * cosine[:, None] * facing
    s = (ratio * cosine - inner) / (ratio * cosine + inner)
    p = (cosine - ratio * inner) / (cosine + ratio * inner)
    part = np.where(total, 1.0, 1 - (s**2 + p**2) / 2)
    return np.where(total[:, None], reflected, bent), part


def effect_of(bsdf: Any) -> Effect:
    """Return the effect of a surface with this BSDF on a line of sight."""
    flags, name = int(bsdf.flags()), bsdf.class_name()
    if flags & int(mi.BSDFFlags.Null):
        return Effect(STRAIGHT, least=0.0 if name == "ThinDielectric" else MIN_CLEAR)
    if flags & int(mi.BSDFFlags.DeltaTransmission) and not flags & int(SCATTERING):
        return Effect(BENDING)
    if name == "RoughDielectric" and _parameter(bsdf, "alpha") <= MAX_ALPHA:
        return Effect(BENDING, through=1.0, ratio=_parameter(bsdf, "eta"))
    if name in ("Principled", "PrincipledThin") and _parameter(bsdf, "roughness") ** 2 <= MAX_ALPHA:
        metallic = 0.0 if name == "PrincipledThin" else _parameter(bsdf, "metallic")
        through = _parameter(bsdf, "spec_trans") * (1 - metallic) * (_parameter(bsdf, "base_color") > 0)
        if through >= MIN_CLEAR:
            if name == "PrincipledThin":
                return Effect(STRAIGHT, through=through)
            eta = _parameter(bsdf, "eta")
            ratio = eta if eta > 0 else 2 / (1 - math.sqrt(0.08 * _parameter(bsdf, "specular"))) - 1
            return Effect(BENDING, through=through, ratio=ratio)
    return Effect(OPAQUE)


def _parameter(bsdf: Any, key: str) -> float:
    """Return a parameter of a BSDF, or nan if it is missing or a picture."""
    values = mi.traverse(bsdf)
    for found in (key, f"{key}.value"):
        if found in values and np.size(values[found]) == 1:
            return float(np.array(values[found]).reshape(-1)[0])
    return float("nan")


def camera_rays(camera: Any, *, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return origins and directions of a camera's rays through points of its picture (0 to 1), float64 (ray, 3)."""
    if dr.is_jit_v(mi.Float):
        at = mi.Point2f(mi.Float(x.astype(np.float32)), mi.Float(y.astype(np.float32)))
        ray, _ = camera.sample_ray(0, 0.5, at, mi.Point2f(0.5))
        origin, direction = (np.array(v, dtype=np.float64).reshape(3, -1).T for v in (ray.o, ray.d))
        shape = (x.size, 3)  # all rays of a camera may begin at one point, or run in one direction
        return np.broadcast_to(origin, shape), np.broadcast_to(direction, shape)
    rays = [camera.sample_ray(0, 0.5, mi.Point2f(*point), mi.Point2f(0.5))[0] for point in zip(x, y, strict=True)]
    origin, direction = (np.array([v(ray) for ray in rays], dtype=np.float64) for v in (lambda r: r.o, lambda r: r.d))
    return origin.reshape(-1, 3), direction.reshape(-1, 3)


def lines_of_sight(
    setup: RenderSetup, camera: Any, *, x: np.ndarray, y: np.ndarray, position: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return origins and directions of the rays through the centre of the lens that meet points of the picture.

    They are those of the pinhole ``camera`` at this focus position, turned by the distortion of the lens, or those of a
    real lens. ``x`` and ``y`` are 0 to 1; the result is float64 (ray, 3).
    """
    origin, direction = camera_rays(camera, x=x, y=y)
    drive = setup.drive
    if drive.distortion is None and not isinstance(drive.wavefront, FittedRays):
        return origin, direction
    matrix = np.array(setup.to_world_at(float(setup.drive.shift(position))).matrix, dtype=np.float64)
    turn, lens = matrix[:3, :3], matrix[:3, 3]
    back = np.linalg.inv(turn).T
    local = direction @ back
    slope = local[:, :2] / local[:, 2:]
    added, start = np.zeros((2, len(slope))), np.zeros((2, len(slope)))
    if drive.distortion is not None:
        added += drive.distortion.turn((slope[:, 0], slope[:, 1]))
    if isinstance(drive.wavefront, FittedRays):
        v = float(drive.image_distance(position))
        moved, turned = drive.wavefront.turn((start[0], start[1]), tuple(-v * slope.T), image_distance_m=v)
        added, start = added + turned, start + moved
    ahead = np.column_stack([slope[:, 0] + added[0], slope[:, 1] + added[1], np.ones(len(slope))])
    begin = (
        lens
        + np.column_stack([*start / setup.unit_m, np.zeros(len(slope))]) @ turn.T
        + (ahead * ((origin - lens) @ back)[:, 2:]) @ turn.T
    )
    ahead = ahead @ turn.T
    return begin, ahead / np.linalg.norm(ahead, axis=1, keepdims=True)


def apparent_distance(
    setup: RenderSetup, sight: PinholeSight, *, ends: Ends, slope: np.ndarray, position: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return where a target behind glass appears, for lines of sight that end on it.

    Parameters
    ----------
    setup : RenderSetup
        Scene in front of its lens.
    sight : PinholeSight
        The sight with which the lines were followed.
    ends : Ends
        Ends of the lines, all on the target.
    slope : ndarray of float64, shape (ray, 2)
        Slopes dx/dz and dy/dz of the lines at the lens, in camera space.
    position : float
        Focus position, as a fraction of the travel.

    Returns
    -------
    tuple of ndarray of float64, shape (ray,)
        Axial distances (m) from the lens, nan where too little of the aperture sees the target or it appears at no
        distance in front of the lens; and the diameter (pixels) of the blur that remains there.
    """
    drive, unit = setup.drive, setup.unit_m
    matrix = np.array(setup.to_world_at(float(drive.shift(position))).matrix, dtype=np.float64)
    turn, lens = matrix[:3, :3], matrix[:3, 3]
    distance = ((ends.point - lens) @ np.linalg.inv(turn)[2]) * unit
    step = SLOPE_STEP_PX * setup.grid.pitch_m / float(drive.image_distance(position))
    pixels_per_slope = float(drive.image_distance(position)) / setup.grid.pitch_m
    radius = LEAST_SQUARES_RADIUS * drive.aperture_radius_m

    def landing(at: np.ndarray, slopes: np.ndarray) -> np.ndarray:
        """Return where rays from points (m) on the lens meet the target (m), nan where they miss it."""
        origin = np.column_stack([at, np.zeros(len(slopes))]) / unit
        ray = np.column_stack([slopes, np.ones(len(slopes))]) @ turn.T
        found = sight.follow(origin @ turn.T + lens, ray / np.linalg.norm(ray, axis=1, keepdims=True))
        return np.where(found.on_target[:, None], found.point * unit, np.nan)

    def bundle(step: float, towards: np.ndarray, aim: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
        """Return points (m) on the lens and slopes of two pairs of rays for each line, a pair for each axis.

        They pass the lens ``step`` (m) from its middle and are aimed at a distance (m), or their slopes differ by
        ``step`` if ``aim`` is None.
        """
        points, slopes = [], []
        for axis in np.eye(2):
            at = np.zeros(2) if aim is None else step * axis
            turned = step * axis if aim is None else -step * axis / aim[:, None]
            for sign in (1, -1):
                points.append(np.broadcast_to(sign * at, towards.shape))
                slopes.append(towards + sign * turned)
        return np.concatenate(points), np.concatenate(slopes)

    # The change of the landing point per unit of both slopes, and of both coordinates on the lens: nan where a ray
    # misses the target. All rays at once: following rays costs the same for few as for many.
    changes = np.full((2, len(slope), 3, 2), np.nan)
    for part in SHRINKAGE:
        missing = [np.flatnonzero(np.isnan(found).any(axis=(1, 2))) for found in changes]
        steps = step * part, radius * part
        aims = None, distance[missing[1]]
        bundles = [bundle(size, slope[rays], aim) for size, rays, aim in zip(steps, missing, aims, strict=True)]
        at, slopes = (np.concatenate(values) for values in zip(*bundles, strict=True))
        if not len(at):
            break
        landed = np.split(landing(at, slopes), [4 * missing[0].size])
        for found, rays, ends_of, size in zip(changes, missing, landed, steps, strict=True):
            pairs = ends_of.reshape(2, 2, rays.size, 3)
            found[rays] = np.moveaxis((pairs[:, 0] - pairs[:, 1]) / (2 * size), 0, -1)
    by_slope, by_lens = changes
    good = ~np.isnan(by_slope + by_lens).any(axis=(1, 2))
    vergence = np.full((len(slope), 2, 2), np.nan)
    vergence[good] = np.eye(2) / distance[good, None, None] + np.linalg.pinv(by_slope[good]) @ by_lens[good]
    mean = np.trace(vergence, axis1=1, axis2=2) / 2
    with np.errstate(divide="ignore", invalid="ignore"):
        apparent = np.where(mean > 0, 1 / mean, np.nan)
    left = vergence - mean[:, None, None] * np.eye(2)
    blur = 2 * drive.aperture_radius_m * pixels_per_slope * np.sqrt((left**2).sum(axis=(1, 2)) / 2)
    return apparent, blur
