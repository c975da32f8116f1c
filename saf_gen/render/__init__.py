"""The renderer: from a scene to the files of its focal stack. The only package that imports Mitsuba."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from saf_gen.core import seeds
from saf_gen.errors import BadInput
from saf_gen.render import _import_mitsuba, backend, depth_and_target, mitsuba_scene, posed_shapes
from saf_gen.render.render_setup import RenderSetup
from saf_gen.render.scene_renderer import stack_renderer
from saf_gen.scene.scene_folder import Scene
from saf_gen.stack.focal_stack import StackSpec, StackStore

__all__ = ["_import_mitsuba", "render_missing_stacks"]


def render_missing_stacks(
    scene: Scene,
    specs: Sequence[StackSpec],
    *,
    root: Path,
    backend_name: str,
    threads: int | None = None,
    progress: Callable[[str, float], None] = lambda name, done: None,
) -> list[str]:
    """Render what is missing of a scene's focal stacks, and store it piece by piece.

    Parameters
    ----------
    scene : the member of the scene's family.
    specs : one stack of a scene that stands still, or one for each of many moments.
    root : folder of the stacks.
    backend_name : 'cuda', 'llvm' or 'scalar'. A JIT backend traces every path once for all focus positions;
        scalar renders position by position.
    threads : by default the cores that this process may use.
    progress : called with the name of a piece (a light group, or 'geometry') and the fraction of it done.

    Returns
    -------
    The names of the rendered pieces.

    Raises
    ------
    BadInput : for a scene that cannot be built, or whose target is out of sight, and for diffraction with a backend
        that cannot render it.
    """
    if not backend.can_render_waves(backend_name) and any(spec.wavelength_m for spec in specs):
        raise BadInput(
            f"variant {backend_name} cannot render diffraction",
            allowed="llvm, cuda",
            hint="or leave waves out with render: {diffraction: false}",
        )
    todo = [(spec, name) for spec in specs for name in StackStore(root, spec).missing_pieces()]
    if not todo:
        return []
    backend.activate_render_backend(backend_name, threads=threads)
    described = mitsuba_scene.build_scene_dict(scene)
    motions = mitsuba_scene.mitsuba_shape_motions(scene, described)
    remaining = Counter(name for _, name in todo)
    total = dict(remaining)
    loaded, lit = None, None  # Mitsuba's scene with its integrator; the moment and light group that it shows
    for spec, name in todo:

        def report(fraction: float, name: str = name) -> None:
            progress(name, 1 - (remaining[name] - fraction) / total[name])

        report(0.0)
        # Depth and target need no light of their own: they are traced under the first group's.
        group = spec.groups[0] if name == "geometry" else name
        if (spec.time_s, group) != lit:
            # The scene before is released first. The new one then gets the same indices in Dr.Jit's registry,
            # which are part of a kernel's code, and finds its kernels in the cache: this saves 0.2 to 0.6 s.
            loaded = None
            moment = posed_shapes.pose_shapes(described, motions, time_s=spec.time_s, unit_m=scene.card.unit_m)
            loaded = mitsuba_scene.load_lit_mitsuba_scene(moment, scene.card.lights[group], max_depth=spec.max_depth)
            lit = spec.time_s, group
        _render_piece(
            scene,
            loaded,
            spec=spec,
            name=name,
            root=root,
            backend_name=backend_name,
            allow_unseen_target=len(specs) > 1,
            progress=report,
        )
        remaining[name] -= 1
        report(0.0)
    if len(specs) == 1:
        return [name for _, name in todo]
    return [f"{name} at {spec.time_s:.4f} s" for spec, name in todo]


def _render_piece(
    scene: Scene,
    loaded: Any,
    *,
    spec: StackSpec,
    name: str,
    root: Path,
    backend_name: str,
    allow_unseen_target: bool,
    progress: Callable[[float], None],
) -> None:
    """Render one piece of one stack and store it; ``loaded`` is the lit scene and its integrator."""
    store = StackStore(root, spec)
    lit_scene, integrator = loaded
    camera = mitsuba_scene.camera_to_world(scene)
    setup = RenderSetup(lit_scene, integrator, camera, spec.drive, spec, scene.card.unit_m, spec.wavelength_m)
    if name == "geometry":
        seen = depth_and_target.trace_depth_and_target(
            setup, scene.card.target, allow_unseen_target=allow_unseen_target
        )
        store.write_geometry(seen.depth, seen.target, backend=backend_name)
        return
    radiance, clipped = stack_renderer(backend_name)(
        setup,
        positions=spec.positions,
        window=spec.window,
        samples=spec.samples,
        # Moments of one scene share their noise: it does not flicker where nothing moves.
        seed=seeds.derive_seed("stack", replace(spec, time_s=0.0, window=None).key, name),
        progress=progress,
    )
    store.write_group(name, radiance, backend=backend_name, clipped=clipped)
