"""The renderer: from a scene to the files of its focal stack. The one room with Mitsuba in it."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

from saf_gen import seeds
from saf_gen.focal_stack import StackSpec, StackStore
from saf_gen.render import _load, geometry, one_pass, thinlens, variant, world
from saf_gen.render.film import Film, Setup
from saf_gen.scene import Scene

__all__ = ["_load", "render_missing"]


def render_missing(
    scene: Scene,
    spec: StackSpec,
    root: Path,
    *,
    variant_name: str,
    threads: int | None = None,
    progress: Callable[[str, float], None] = lambda name, done: None,
) -> list[str]:
    """Render what the stack's folder lacks and store it piece by piece; returns the names rendered.

    A JIT variant traces once for all positions; scalar renders position after position. ``progress`` is
    told the name of a piece (a light group, or 'geometry') and the share of it that is done.

    Raises BadInput where the scene cannot be built, or its target is out of sight.
    """
    store = StackStore(root, spec)
    missing = store.missing()
    if not missing:
        return []
    variant.use(variant_name, threads=threads)
    described = world.build(scene)
    to_world = world.camera_to_world(scene)
    film = Film(spec.rows, spec.columns, spec.pitch_m)
    stack_of = thinlens.render_stack if variant_name == "scalar" else one_pass.render_stack
    for name in missing:
        progress(name, 0.0)
        lit = spec.groups if name == "geometry" else (name,)
        burning = tuple(e for group in lit for e in scene.card.lights[group])
        loaded, integrator = world.load(described, burning, spec.max_depth)
        setup = Setup(loaded, integrator, to_world, spec.drive, film)
        if name == "geometry":
            seen = geometry.look(setup, scene.card.target)
            store.put_geometry(seen.depth, seen.target, variant_name)
        else:
            radiance, clipped = stack_of(
                setup,
                positions=spec.positions,
                samples=spec.samples,
                seed=seeds.integer("stack", spec.key, name),
                progress=partial(progress, name),
            )
            store.put_group(name, radiance, variant_name, clipped=clipped)
        progress(name, 1.0)
    return missing
