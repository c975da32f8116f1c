"""The renderer: from a scene to the files of its focal stack. The one room with Mitsuba in it."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from saf_gen import seeds
from saf_gen.focal_stack import StackSpec, StackStore
from saf_gen.render import _load, geometry, one_pass, thinlens, variant, world
from saf_gen.render.film import Film, Setup
from saf_gen.scene import Scene

__all__ = ["_load", "render_missing"]


def render_missing(
    scene: Scene,
    specs: Sequence[StackSpec],
    root: Path,
    *,
    variant_name: str,
    threads: int | None = None,
    progress: Callable[[str, float], None] = lambda name, done: None,
) -> list[str]:
    """Render what these stacks of a scene lack and store it piece by piece; returns the names rendered.

    One stack where the scene stands still, else one for each of many moments. A JIT variant traces once for
    all positions; scalar renders position after position. ``progress`` is told the name of a piece (a light
    group, or 'geometry') and the share of it that is done.

    Raises BadInput where the scene cannot be built, or its target is out of sight.
    """
    todo = [(spec, name) for spec in specs for name in StackStore(root, spec).missing()]
    if not todo:
        return []
    variant.use(variant_name, threads=threads)
    described = world.build(scene)
    motions = world.motions(scene, described)
    left = Counter(name for _, name in todo)
    whole = dict(left)
    loaded, lit = None, None  # Mitsuba's scene with its integrator; the moment and the group that it is of
    for spec, name in todo:

        def told(share: float, name: str = name) -> None:
            progress(name, 1 - (left[name] - share) / whole[name])

        told(0.0)
        # Depth and target need no light of their own: they are looked at under the first group's.
        group = spec.groups[0] if name == "geometry" else name
        if (spec.time_s, group) != lit:
            # The scene before is let go first. This one then takes its places in Dr.Jit's registry, which
            # stand in the kernel's code, and the kernel is found in the cache: 0.2 to 0.6 s saved.
            loaded = None
            moment = world.posed(described, motions, spec.time_s, unit_m=scene.card.unit_m)
            loaded, lit = world.load(moment, scene.card.lights[group], spec.max_depth), (spec.time_s, group)
        _render(scene, loaded, spec, name, root, variant_name, passing=len(specs) > 1, progress=told)
        left[name] -= 1
        told(0.0)
    if len(specs) == 1:
        return [name for _, name in todo]
    return [f"{name} at {spec.time_s:.4f} s" for spec, name in todo]


def _render(
    scene: Scene,
    loaded: Any,
    spec: StackSpec,
    name: str,
    root: Path,
    variant_name: str,
    *,
    passing: bool,
    progress: Callable[[float], None],
) -> None:
    """Render one piece of one stack and store it; ``loaded`` is the scene, lit, and its integrator."""
    store = StackStore(root, spec)
    film = Film(spec.rows, spec.columns, spec.pitch_m)
    lit, integrator = loaded
    setup = Setup(lit, integrator, world.camera_to_world(scene), spec.drive, film, scene.card.unit_m)
    if name == "geometry":
        seen = geometry.look(setup, scene.card.target, passing=passing)
        store.put_geometry(seen.depth, seen.target, variant_name)
        return
    stack_of = thinlens.render_stack if variant_name == "scalar" else one_pass.render_stack
    radiance, clipped = stack_of(
        setup,
        positions=spec.positions,
        window=spec.window,
        samples=spec.samples,
        # Moments of one scene share their noise: it does not flicker where nothing moves.
        seed=seeds.integer("stack", replace(spec, time_s=0.0, window=None).key, name),
        progress=progress,
    )
    store.put_group(name, radiance, variant_name, clipped=clipped)
