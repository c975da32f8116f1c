"""A scene set up to be looked at: a member of its family in front of a lens and a sensor, nothing stored."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from saf_gen.core import seeds
from saf_gen.core.region import Region
from saf_gen.render import backend, depth_and_target, estimators, irradiance, mitsuba_scene, posed_shapes, thin_lens
from saf_gen.render import texel_footprints as texels
from saf_gen.render.depth_and_target import DepthAndTarget
from saf_gen.render.moment_shading import MomentShading
from saf_gen.render.render_setup import RenderSetup
from saf_gen.render.shading_cells import ShadingField
from saf_gen.scene.keyframes import RigidMotion
from saf_gen.scene.scene_folder import Scene
from saf_gen.stack.focal_stack import FocalStack, PixelGrid, StackSpec

STEPS = 1024  # of the travel, to which the position of a single picture is rounded
SCENES_KEPT = 4
PINHOLE_F_NUMBER = 64.0  # the smallest stop a card may have: no blur is as wide as a pixel


class SceneRenderer:
    """The scene as its geometry describes it, at any moment and under any of its light groups.

    ``max_depth`` is the longest light path, in segments; ``motions`` are those of the shapes, by name.
    ``wavelength_m`` is that of the light in focal stacks; 0, and the backend scalar, leave waves out. Raises BadInput
    for a scene that cannot be built, and a backend that cannot run on this machine.
    """

    motions: dict[str, RigidMotion]

    def __init__(
        self, scene: Scene, grid: PixelGrid, *, backend_name: str, max_depth: int = 6, wavelength_m: float = 0.0
    ) -> None:
        self.scene, self.grid, self.max_depth = scene, grid, max_depth
        self.backend_name = backend.choose_render_backend(backend_name)
        self.wavelength_m = wavelength_m if backend.can_render_waves(self.backend_name) else 0.0
        backend.activate_render_backend(self.backend_name)
        self._described = mitsuba_scene.build_mitsuba_scene_dict(scene)
        self.motions = mitsuba_scene.mitsuba_shape_motions(scene, self._described)
        self._scenes: dict[tuple[tuple[str, ...], float | None], tuple[Any, Any]] = {}
        self._shadings: dict[tuple[tuple[float, ...], int, int], ShadingField] = {}

    @property
    def is_slow(self) -> bool:
        """Whether this backend renders position by position."""
        return self.backend_name == "scalar"

    def prepare(
        self,
        groups: Sequence[str] | None = None,
        *,
        time_s: float | None = None,
        f_number: float | None = None,
        grid: PixelGrid | None = None,
    ) -> RenderSetup:
        """Return the scene under some light groups, by default all, in front of its lens.

        Raises BadInput for a scene that Mitsuba cannot load.
        """
        lit = tuple(self.scene.card.lights if groups is None else groups)
        loaded, integrator = self._loaded(lit, self._moment(time_s))
        to_world, unit_m = mitsuba_scene.mitsuba_camera_to_world(self.scene), self.scene.card.unit_m
        drive = self.scene.build_drive(f_number)
        moved = posed_shapes.find_moved_rendered_shapes(
            self.motions, time_s=self._moment(time_s), still_s=self.scene.card.still_s
        )
        return RenderSetup(loaded, integrator, to_world, drive, grid or self.grid, unit_m, self.wavelength_m, moved)

    def trace_depth_and_target(
        self, *, time_s: float | None = None, allow_unseen_target: bool = False
    ) -> DepthAndTarget:
        """Trace depth and target; see :func:`saf_gen.render.depth_and_target.trace_depth_and_target`."""
        return depth_and_target.trace_depth_and_target(
            self.prepare(time_s=time_s), self.scene.card.target, allow_unseen_target=allow_unseen_target
        )

    def bounds(self, *names: str) -> np.ndarray:
        """Return the corners (m) of the box round the shapes of these names, by default round everything.

        World axes, float64 (2, 3); or (0, 3) where no shape has such a name, as for a lamp without a body or
        a shape of ``scene.py`` whose id is not its key.
        """
        return _bounding_box(self.prepare().mitsuba_scene, names) * self.scene.card.unit_m

    def rest_bounds(self, name: str) -> np.ndarray:
        """Return the corners (m) of the box round a shape as its geometry places it, before it moves."""
        return _bounding_box(self._loaded(tuple(self.scene.card.lights), None)[0], (name,)) * self.scene.card.unit_m

    def render_stack(
        self,
        seen: DepthAndTarget,
        *,
        positions: int,
        samples: int,
        window: tuple[int, int] | None = None,
        time_s: float | None = None,
        together: bool = False,
        run: int = 0,
        moments: int = 1,
        step_s: float = 0.0,
    ) -> FocalStack:
        """Render the focal stack at evenly spaced positions, or at a window of them.

        ``together`` renders all lights at once, as one group with the name 'all'. Runs of different numbers
        have independent noise. ``moments`` tell the shading: several that of a time slice of a recording, each
        ``step_s`` after the one before; with 0 the scene stands still for all of them.
        """
        lights = self.scene.card.lights
        groups = {"all": tuple(lights)} if together else {name: (name,) for name in lights}
        spec = StackSpec.from_scene(
            self.scene,
            self.grid,
            positions=positions,
            samples=samples,
            max_depth=self.max_depth,
            time_s=self._moment(time_s),
            wavelength_m=self.wavelength_m,
            groups=groups,
            window=window,
        )
        setups = {name: self.prepare(lit, time_s=time_s) for name, lit in groups.items()}
        seed = seeds.derive_seed("studio", replace(spec, time_s=0.0, window=None).key, run)
        emitting = mitsuba_scene.mitsuba_emitter_names(self._described)
        shading = None
        if estimators.renders_with_shared_shading(spec.estimator, backend_name=self.backend_name):

            def show(at_s: float) -> dict[str, RenderSetup]:
                return setups if at_s == spec.time_s else {n: self.prepare(g, time_s=at_s) for n, g in groups.items()}

            told = [spec.time_s - n * step_s for n in reversed(range(moments))]
            shading = self._estimate_shading(show, told=told, samples=samples, seed=seed)
        found = estimators.render_light_groups(
            setups,
            backend_name=self.backend_name,
            positions=positions,
            samples=samples,
            window=window,
            seed=seed,
            emitting=emitting,
            shading=shading,
        )
        radiance = [found[name][0] for name in groups]
        return FocalStack(spec, np.stack(radiance), seen.depth, seen.target, self.backend_name)

    def _estimate_shading(
        self, show: Callable[[float], Mapping[str, RenderSetup]], *, told: list[float], samples: int, seed: int
    ) -> ShadingField:
        """Return the shading at the last of some moments; the latest two that were asked for are kept.

        It is that of the whole travel, so the same for all windows of two runs.
        """
        asked = (tuple(told), samples, seed)
        if asked not in self._shadings:
            paths = MomentShading(show, seed=seed, emitting=mitsuba_scene.mitsuba_emitter_names(self._described))
            kept = list(self._shadings.items())[-1:]
            self._shadings = {**dict(kept), asked: paths.estimate(told, samples=samples)}
        return self._shadings[asked]

    def render_picture(self, position: float, *, samples: int, time_s: float | None = None) -> np.ndarray:
        """Render the picture at a focus position, to 1/STEPS of the travel, under all lights: float32 (row, col).

        With shared shading, where the backend can.
        """
        return self._render_picture(self.prepare(time_s=time_s), position, samples=samples)

    def render_pinhole(
        self, position: float, *, samples: int, time_s: float | None = None, grid: PixelGrid | None = None
    ) -> np.ndarray:
        """Render everything sharp, through a pinhole without waves, at the scale of a position: float32 (row, col)."""
        setup = self.prepare(time_s=time_s, f_number=PINHOLE_F_NUMBER, grid=grid)
        return self._render_picture(replace(setup, wavelength_m=0.0), position, samples=samples)

    def _render_picture(self, setup: RenderSetup, position: float, *, samples: int) -> np.ndarray:
        seed = seeds.derive_seed("whole picture", self.scene.digest)
        if not estimators.renders_with_shared_shading("filtered", backend_name=self.backend_name):
            return thin_lens.render_position(setup, position=position, samples=samples, seed=seed)
        emitting = mitsuba_scene.mitsuba_emitter_names(self._described)
        nearest = round(position * STEPS)
        first = min(nearest, STEPS - 1)
        show = MomentShading(lambda _: {"all": setup}, seed=seed, emitting=emitting)
        found = estimators.render_light_groups(
            {"all": setup},
            backend_name=self.backend_name,
            positions=STEPS + 1,
            window=(first, first + 1),
            samples=samples,
            seed=seed,
            emitting=emitting,
            shading=show.estimate((0.0,), samples=samples),
        )
        return found["all"][0][nearest - first]

    def render_region(
        self, position: float, *, samples: int, region: Region, time_s: float | None = None, run: int = 0
    ) -> np.ndarray:
        """Render a region of the image at a focus position under all lights: float32 (row, col).

        Runs of different numbers have independent noise.
        """
        seed = seeds.derive_seed("picture", self.scene.digest, run)
        setup = self.prepare(time_s=time_s)
        return thin_lens.render_position(setup, position=position, samples=samples, seed=seed, region=region)

    def estimate_irradiance(self, group: str, *, position: float, target: np.ndarray) -> tuple[float, float]:
        """Return the irradiance (W m⁻²) of the target by a light group, and its standard error."""
        return irradiance.render_target_irradiance(self.prepare((group,)), position=position, target=target)

    def texel_footprints(self, position: float, target: np.ndarray) -> np.ndarray:
        """Measure the target's texels; see :func:`saf_gen.render.texel_footprints.rendered_texel_footprints`."""
        return texels.rendered_texel_footprints(
            self.prepare(), self.scene.card.target, position=position, target=target
        )

    def _moment(self, time_s: float | None) -> float:
        return self.scene.card.still_s if time_s is None and self.motions else time_s or 0.0

    def _loaded(self, groups: tuple[str, ...], time_s: float | None) -> tuple[Any, Any]:
        """Return the scene at a time, or with every shape where its geometry places it (None); the last four are kept.

        A scene that is not kept is released before another is loaded. That one then gets its indices in Dr.Jit's
        registry, which are part of a kernel's code, and finds its kernels in the cache. An ``lru_cache`` on a method
        would keep the renderer, and all its scenes, until garbage is collected.
        """
        key = (groups, time_s)
        found = self._scenes.pop(key, None)
        if found is None:
            while len(self._scenes) >= SCENES_KEPT:
                del self._scenes[next(iter(self._scenes))]
            found = self._load(groups, time_s)
        self._scenes[key] = found
        return found

    def _load(self, groups: tuple[str, ...], time_s: float | None) -> tuple[Any, Any]:
        card, moment = self.scene.card, self._described
        if time_s is not None:
            moment = posed_shapes.pose_rendered_shapes(moment, self.motions, time_s=time_s, unit_m=card.unit_m)
        emitters = tuple(emitter for group in groups for emitter in card.lights[group])
        return mitsuba_scene.load_lit_mitsuba_scene(moment, emitters, max_depth=self.max_depth)


def _bounding_box(scene: Any, names: tuple[str, ...]) -> np.ndarray:
    """Return the corners (scene units) of the box round the shapes of these names, or round everything.

    float64 (2, 3), or (0, 3) where there are no such shapes.
    """
    boxes = [shape.bbox() for shape in scene.shapes() if shape.id() in names] if names else [scene.bbox()]
    if not boxes:
        return np.empty((0, 3))
    corners = np.array([[box.min, box.max] for box in boxes], dtype=np.float64).reshape(-1, 2, 3)
    return np.array([corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)])
