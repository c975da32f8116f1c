"""The renderer: from a scene to the files of its focal stack. The one room with Mitsuba in it."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from saf_gen.core import seeds
from saf_gen.render import _import_mitsuba, backend, depth_and_target, mitsuba_scene, one_pass, thin_lens
from saf_gen.render.render_setup import RenderSetup, SensorGrid
from saf_gen.scene.scene_folder import Scene
from saf_gen.stack.focal_stack import StackSpec, StackStore

__all__ = ["_import_mitsuba", "render_missing"]


def render_missing(
    scene: Scene,
    specs: Sequence[StackSpec],
    root: Path,
    *,
    backend_name: str,
    threads: int | None = None,
    progress: Callable[[str, float], None] = lambda name, done: None,
) -> list[str]:
    """Render what these stacks of a scene lack and store it piece by piece; returns the names rendered.

    One stack where the scene stands still, else one for each of many moments. A JIT variant traces once for
    all positions; scalar renders position after position. ``progress`` is told the name of a piece (a light
    group, or 'geometry') and the share of it that is done.

    Raises BadInput where the scene cannot be built, or its target is out of sight.
    """
    todo = [(spec, name) for spec in specs for name in StackStore(root, spec).missing_pieces()]
    if not todo:
        return []
    backend.activate_backend(backend_name, threads=threads)
    described = mitsuba_scene.build_scene_dict(scene)
    motions = mitsuba_scene.read_motions(scene, described)
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
            moment = mitsuba_scene.pose_shapes(described, motions, spec.time_s, unit_m=scene.card.unit_m)
            loaded, lit = (
                mitsuba_scene.load_lit_scene(moment, scene.card.lights[group], spec.max_depth),
                (spec.time_s, group),
            )
        _render(
            scene, loaded, spec, name, root, backend_name, allow_unseen_target=len(specs) > 1, progress=told
        )
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
    backend_name: str,
    *,
    allow_unseen_target: bool,
    progress: Callable[[float], None],
) -> None:
    """Render one piece of one stack and store it; ``loaded`` is the scene, lit, and its integrator."""
    store = StackStore(root, spec)
    film = SensorGrid(spec.rows, spec.columns, spec.pitch_m)
    lit, integrator = loaded
    setup = RenderSetup(
        lit, integrator, mitsuba_scene.camera_to_world(scene), spec.drive, film, scene.card.unit_m
    )
    if name == "geometry":
        seen = depth_and_target.trace_depth_and_target(
            setup, scene.card.target, allow_unseen_target=allow_unseen_target
        )
        store.write_geometry(seen.depth, seen.target, backend=backend_name)
        return
    stack_of = thin_lens.render_stack if backend_name == "scalar" else one_pass.render_stack
    radiance, clipped = stack_of(
        setup,
        positions=spec.positions,
        window=spec.window,
        samples=spec.samples,
        # Moments of one scene share their noise: it does not flicker where nothing moves.
        seed=seeds.derive_seed("stack", replace(spec, time_s=0.0, window=None).key, name),
        progress=progress,
    )
    store.write_group(name, radiance, backend=backend_name, clipped=clipped)
