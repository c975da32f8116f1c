"""The renderer, which makes the files of a focal stack from a scene. Only this package imports Mitsuba."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from saf_gen.core import seeds
from saf_gen.errors import BadInput
from saf_gen.render import _import_mitsuba, backend, depth_and_target, estimators, mitsuba_scene, posed_shapes
from saf_gen.render.moment_shading import MomentShading
from saf_gen.render.render_setup import RenderSetup
from saf_gen.scene.keyframes import RigidMotion
from saf_gen.scene.scene_folder import Scene
from saf_gen.stack.focal_stack import StackSpec, StackStore

__all__ = ["_import_mitsuba", "render_missing"]


def render_missing(
    scene: Scene,
    specs: Sequence[StackSpec],
    *,
    root: Path,
    backend_name: str,
    threads: int | None = None,
    progress: Callable[[str, float], None] = lambda name, done: None,
) -> list[str]:
    """Render the missing pieces of a scene's focal stacks, and store them one by one.

    Parameters
    ----------
    scene : Scene
        Member of the scene's family.
    specs : sequence of StackSpec
        One stack of a scene at rest, or one for each of many moments of a moving scene.
    root : Path
        Folder of the stacks.
    backend_name : str
        'cuda', 'llvm' or 'scalar'. The first two (JIT backends) trace every path once for all focus positions; scalar
        renders position by position.
    threads : int, optional
        Number of threads; by default as many as the cores that this process may use.
    progress : callable, optional
        Called with 'light' (all light groups together) or 'geometry', and with the completed fraction of all moments, 0
        to 1.

    Returns
    -------
    list of str
        Names of the rendered pieces, with the time if there are several moments.

    Raises
    ------
    BadInput
        If the scene cannot be built, the lens runs into it, the target of a single stack is out of sight or cannot be
        focused, or a spec asks for diffraction that the backend cannot render.
    """
    if not backend.can_render_waves(backend_name) and any(spec.wavelength_m for spec in specs):
        raise BadInput(
            f"variant {backend_name} cannot render diffraction",
            allowed="llvm, cuda",
            hint="or set render: {diffraction: false}",
        )
    todo = [(spec, name) for spec in specs for name in StackStore(root, spec).missing_pieces()]
    if not todo:
        return []
    backend.activate_backend(backend_name, threads=threads)
    described = mitsuba_scene.scene_dict(scene)
    motions = mitsuba_scene.shape_motions(scene, described)
    emitting = mitsuba_scene.emitter_names(described)
    # All moments share their camera rays, so that noise does not flicker where nothing moves.
    base = replace(specs[0], time_s=0.0, window=None, moments_s=())
    shown = _ShownScene(scene, base, described=described, motions=motions)
    paths = MomentShading(shown.show, seed=seeds.derive_seed("stack", base.key), emitting=emitting)
    moments = [(spec, missing) for spec in specs if (missing := StackStore(root, spec).missing_pieces())]
    for n, (spec, missing) in enumerate(moments):

        def report(name: str, done: float, n: int = n) -> None:
            progress(name, (n + done) / len(moments))

        store = StackStore(root, spec)
        if "geometry" in missing:
            report("geometry", 0.0)
            seen = depth_and_target.trace_geometry(
                shown.show(spec.time_s)[spec.groups[0]], scene.card.target, allow_unseen_target=len(specs) > 1
            )
            store.write_geometry(seen.depth, seen.target, backend=backend_name)
        if missing == ["geometry"]:
            report("geometry", 1.0)
            continue
        shading = None
        if estimators.shares_shading(spec.estimator, backend_name=backend_name):
            shading = paths.estimate(
                spec.moments_s or (spec.time_s,), samples=spec.samples, progress=lambda done: report("light", done / 2)
            )
        begun = 0.5 if shading is not None else 0.0

        def report_light(done: float, begun: float = begun) -> None:
            report("light", begun + (1 - begun) * done)

        found = estimators.render_groups(
            shown.show(spec.time_s),
            backend_name=backend_name,
            positions=spec.positions,
            samples=spec.samples,
            window=spec.window,
            seed=seeds.derive_seed("stack", base.key, "pictures"),
            emitting=emitting,
            shading=shading,
            progress=report_light,
        )
        # Light groups are always rendered together, so that a picture is the same whichever of them was missing.
        for name, (radiance, clipped) in found.items():
            if name in missing:
                store.write_group(name, radiance, backend=backend_name, clipped=clipped)
    if len(specs) == 1:
        return [name for _, name in todo]
    return [f"{name} at {spec.time_s:.4f} s" for spec, name in todo]


class _ShownScene:
    """A scene that is loaded for one moment at a time, under each of its light groups."""

    def __init__(
        self, scene: Scene, spec: StackSpec, *, described: dict[str, Any], motions: dict[str, RigidMotion]
    ) -> None:
        self._scene, self._spec, self._described, self._motions = scene, spec, described, motions
        self._camera = mitsuba_scene.camera_to_world(scene)
        self._time_s: float | None = None
        self._setups: dict[str, RenderSetup] = {}

    def show(self, time_s: float) -> dict[str, RenderSetup]:
        """Return the scene at a time (s) under each light group, and release the scenes of the previous time."""
        if time_s == self._time_s:
            return self._setups
        # The previous scenes are released first. The new ones then get the same indices in Dr.Jit's registry. These are
        # part of a kernel's code, so the kernels are found in the cache, which saves 0.2 to 0.6 s each.
        self._setups.clear()
        card, spec = self._scene.card, self._spec
        moment = posed_shapes.pose_shapes(self._described, self._motions, time_s=time_s, unit_m=card.unit_m)
        moved = posed_shapes.moved_shapes(self._motions, time_s=time_s, still_s=card.still_s)
        for group in spec.groups:
            loaded, integrator = mitsuba_scene.load_lit_scene(moment, card.lights[group], max_depth=spec.max_depth)
            self._setups[group] = RenderSetup(
                loaded, integrator, self._camera, spec.drive, spec, card.unit_m, spec.wavelength_m, moved
            )
        self._time_s = time_s
        return self._setups
