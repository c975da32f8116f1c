"""The renderer, which makes the files of a focal stack from a scene. Only this package imports Mitsuba."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from saf_gen.core import seeds
from saf_gen.errors import BadInput
from saf_gen.render import _import_mitsuba, backend, depth_and_target, estimators, own_light
from saf_gen.render.estimators import MomentShading
from saf_gen.render.render_setup import RenderSetup
from saf_gen.render.scene_renderer import SceneRenderer
from saf_gen.render.thin_section import SectionRenderer, draw_missing
from saf_gen.scene.scene_folder import Scene
from saf_gen.stack.focal_stack import PixelGrid, StackSpec, StackStore
from saf_gen.stack.same_scene import require_same_scene

MOMENTS_IN_LIGHT = 5  # at which the target's own light is looked for, if it moves or is moved past

__all__ = ["_import_mitsuba", "make_renderer", "render_missing"]


def make_renderer(scene: Scene, grid: PixelGrid, *, backend_name: str, wavelength_m: float = 0.0) -> SceneRenderer:
    """Return the renderer of a scene; see :class:`SceneRenderer` for the parameters and errors."""
    if scene.card.section is not None:
        return SectionRenderer(scene, grid)
    return SceneRenderer(scene, grid, backend_name=backend_name, wavelength_m=wavelength_m)


def render_missing(
    scene: Scene,
    specs: Sequence[StackSpec],
    *,
    root: Path,
    backend_name: str,
    wanted: Collection[StackSpec] | None = None,
    others: Sequence[StackSpec] = (),
    geometry_first: bool = False,
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
        renders position by position. A thin section is drawn by waves with any of them.
    wanted : collection of StackSpec, optional
        Those among the stacks that are rendered; by default all. Each is the same as if all were rendered.
    others : sequence of StackSpec, optional
        Other stacks of the scene, with the same parameters. What is stored of all of them must show the same scene.
    geometry_first : bool, default False
        Whether depth and target of all moments are stored before the first picture. Other processes that render the
        remaining moments need them, but each moment is then loaded once more.
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
        If the scene cannot be built or is not the one in what is stored, the lens runs into it, the target of a single
        stack is out of sight or cannot be focused, or a spec asks for diffraction or aberrations that the backend
        cannot render.
    """
    if scene.card.section is not None:
        drawn = [spec for spec in specs if wanted is None or spec in wanted]
        return draw_missing(scene, drawn, root=root, others=others, threads=threads, progress=progress)
    if not backend.can_render_waves(backend_name) and any(spec.wavelength_m for spec in specs):
        raise BadInput(
            f"variant {backend_name} cannot render diffraction",
            allowed="llvm, cuda",
            hint="or set render: {diffraction: false}",
        )
    if backend_name == "scalar" and any(spec.margin != (0, 0) for spec in specs):
        raise BadInput(
            "variant scalar cannot render the positions beyond the travel that axial colour needs",
            allowed="llvm, cuda",
            hint="or leave axial_colour out of scene.yaml",
        )
    rendered = [spec for spec in specs if wanted is None or spec in wanted]
    todo = [(spec, name) for spec in rendered for name in StackStore(root, spec).missing_pieces()]
    if not todo:
        return []
    # All moments share their camera rays, so that noise does not flicker where nothing moves.
    base = replace(specs[0], time_s=0.0, window=None, moments_s=())
    renderer = SceneRenderer(
        scene,
        base,
        backend_name=backend_name,
        max_depth=base.max_depth,
        wavelength_m=base.wavelength_m,
        drive=base.drive,
        threads=threads,
        kept=len(base.groups),
        travel=(float(base.focus[0]), float(base.focus[-1])),
    )

    require_same_scene(root, [*specs, *others], sums=renderer.sums)
    how: dict[str, Any] = {"backend": backend_name, "sums": renderer.sums}

    def show(time_s: float) -> dict[str, RenderSetup]:
        return renderer.show(base.groups, time_s=time_s)

    paths = MomentShading(show, seed=seeds.derive_seed("stack", base.key), emitting=renderer.emitting)
    moments = [(spec, missing) for spec in rendered if (missing := StackStore(root, spec).missing_pieces())]
    if any("geometry" in missing for _, missing in moments):
        _require_own_light(scene, specs, groups=base.groups, show=show)

    def store_geometry(spec: StackSpec, setup: RenderSetup) -> None:
        seen = depth_and_target.trace_geometry(setup, scene.card.target, allow_unseen_target=len(specs) > 1)
        StackStore(root, spec).write_geometry(seen.depth, seen.target, **how)

    if geometry_first:
        for n, (spec, missing) in enumerate(moments):
            if "geometry" in missing:
                progress("geometry", n / len(moments))
                store_geometry(spec, renderer.show(base.groups[:1], time_s=spec.time_s)[base.groups[0]])
                missing.remove("geometry")
    for n, (spec, missing) in enumerate(moments):

        def report(name: str, done: float, n: int = n) -> None:
            progress(name, (n + done) / len(moments))

        store = StackStore(root, spec)
        if "geometry" in missing:
            report("geometry", 0.0)
            store_geometry(spec, show(spec.time_s)[spec.groups[0]])
        if missing in ([], ["geometry"]):
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

        found = renderer.render_groups(
            show(spec.time_s),
            shading,
            positions=spec.positions,
            samples=spec.samples,
            window=spec.indices,
            seed=seeds.derive_seed("stack", base.key, "pictures"),
            progress=report_light,
        )
        # Light groups are always rendered together, so that a picture is the same whichever of them was missing.
        for name, (radiance, clipped) in found.items():
            if name in missing:
                store.write_group(name, radiance, clipped=clipped, **how)
    if len(specs) == 1:
        return [name for _, name in todo]
    return [f"{name} at {spec.time_s:.4f} s" for spec, name in todo]


def _require_own_light(
    scene: Scene, specs: Sequence[StackSpec], *, groups: Sequence[str], show: Callable[[float], dict[str, RenderSetup]]
) -> None:
    """Raise BadInput if the target is black at each of a few moments at which it is in sight."""
    refused = None
    for spec in specs[:: max(len(specs) // (MOMENTS_IN_LIGHT - 1), 1)]:
        setups = show(spec.time_s)
        seen = depth_and_target.trace_geometry(setups[groups[0]], scene.card.target, allow_unseen_target=len(specs) > 1)
        try:
            own_light.require_own_light(setups.values(), scene.card.target, seen=seen)
        except BadInput as error:
            refused = error
        else:
            if seen.target.any():
                return
    if refused is not None:
        raise refused
