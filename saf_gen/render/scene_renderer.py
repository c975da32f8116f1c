"""Renders a member of a scene family in front of a lens and a sensor, and stores nothing."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from saf_gen.core import seeds
from saf_gen.core.region import Region
from saf_gen.errors import BadInput
from saf_gen.optics import Drive
from saf_gen.render import backend, depth_and_target, estimators, irradiance, mitsuba_scene, own_light, thin_lens
from saf_gen.render.depth_and_target import DepthAndTarget
from saf_gen.render.estimators import MomentShading
from saf_gen.render.render_setup import RenderSetup
from saf_gen.render.scene_sums import sum_up
from saf_gen.render.shading_cells import ShadingField
from saf_gen.scene.keyframes import RigidMotion
from saf_gen.scene.scene_folder import Scene
from saf_gen.stack.focal_stack import FocalStack, PixelGrid, StackSpec

POSITION_STEPS = 1024  # per travel; the position of a single picture is rounded to one of them
MAX_SCENES = 4
PINHOLE_F_NUMBER = 64.0  # the smallest aperture that a card may have; no blur is as wide as a pixel


class SceneRenderer:
    """Renders a scene at any moment and under any of its light groups.

    Parameters
    ----------
    scene : Scene
        Member of the scene's family.
    grid : PixelGrid
        Pixels of the sensor.
    backend_name : str
        'cuda', 'llvm', 'scalar', or 'auto' for the fastest that the machine can run.
    max_depth : int, default 6
        Longest light path, in segments.
    wavelength_m : float, default 0.0
        Wavelength (m) of the light in focal stacks; 0 leaves out diffraction, and so does the backend scalar.
    drive : Drive, optional
        Lens with its focus drive; by default the card's.
    threads : int, optional
        Number of threads; by default as many as the cores that this process may use.
    kept : int, default 4
        Number of loaded scenes (a moment under some lights) that are kept.
    travel : tuple of float, default (0.0, 1.0)
        First and last position of the lens in any picture.

    Attributes
    ----------
    motions : dict of str to RigidMotion
        Motions of the shapes, by name.
    emitting : list of str
        Names of the lamps, and of the shapes that are lamps, under any light group.

    Raises
    ------
    BadInput
        If the scene cannot be built, or the backend cannot run on this machine or cannot render its lens.
    """

    motions: dict[str, RigidMotion]

    def __init__(
        self,
        scene: Scene,
        grid: PixelGrid,
        *,
        backend_name: str,
        max_depth: int = 6,
        wavelength_m: float = 0.0,
        drive: Drive | None = None,
        threads: int | None = None,
        kept: int = MAX_SCENES,
        travel: tuple[float, float] = (0.0, 1.0),
    ) -> None:
        self.scene, self.grid, self.max_depth, self._drive, self._travel = scene, grid, max_depth, drive, travel
        self.backend_name = backend.choose_backend(backend_name)
        lens = drive or scene.build_drive()
        if self.is_slow and not (lens.fills_its_aperture_perfectly and lens.distortion is None):
            what = "aberrations" if lens.wavefront or lens.distortion else "vignetting"
            raise BadInput(
                f"variant scalar cannot render the {what} of a lens",
                allowed="llvm, cuda",
                hint=f"or leave {what} out of scene.yaml",
            )
        self.wavelength_m = wavelength_m if backend.can_render_waves(self.backend_name) else 0.0
        backend.activate_backend(self.backend_name, threads=threads)
        self._described, self._kept = mitsuba_scene.scene_dict(scene), kept
        self.motions = mitsuba_scene.shape_motions(scene, self._described)
        self.emitting = mitsuba_scene.emitter_names(self._described)
        self._scenes: dict[tuple[tuple[str, ...], float | None], tuple[Any, Any]] = {}
        self._shadings: dict[tuple[tuple[float, ...], int, int], ShadingField] = {}

    @cached_property
    def sums(self) -> tuple[float, ...]:
        """Sums of what the scene's files or script describe; see :mod:`saf_gen.render.scene_sums`."""
        motions = {name: self.motions[name].model_dump() for name in sorted(self.motions)}  # in any order the same
        return sum_up({"build": self._described, "motion": motions}, folder=self.scene.folder)

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
        """Return the scene in front of its lens, under some light groups.

        Parameters
        ----------
        groups : sequence of str, optional
            Light groups that are lit; by default all.
        time_s : float, optional
            Moment (s); by default the moment that the card shows.
        f_number : float, optional
            F-number of the card's lens; by default that of the renderer's lens.
        grid : PixelGrid, optional
            Pixels of the sensor; by default the renderer's.

        Raises
        ------
        BadInput
            If Mitsuba cannot load the scene.
        """
        lit = tuple(self.scene.card.lights if groups is None else groups)
        loaded, integrator = self._loaded(lit, self._moment(time_s))
        to_world, unit_m = mitsuba_scene.camera_to_world(self.scene), self.scene.card.unit_m
        drive = self._drive if self._drive and f_number is None else self.scene.build_drive(f_number)
        moved = mitsuba_scene.moved_shapes(self.motions, time_s=self._moment(time_s), still_s=self.scene.card.still_s)
        grid = grid or self.grid
        return RenderSetup(
            loaded, integrator, to_world, drive, grid, unit_m, self.wavelength_m, moved, travel=self._travel
        )

    def show(self, groups: Sequence[str], *, time_s: float) -> dict[str, RenderSetup]:
        """Return the scene at a moment (s) under each of these light groups, and release those of other moments.

        They are released first. The new ones then get the same indices in Dr.Jit's registry. These are part of a
        kernel's code, so the kernels are found in the cache, which saves 0.2 to 0.6 s each.
        """
        if any(shown_s != time_s for _, shown_s in self._scenes):
            self._scenes.clear()
        return {group: self.prepare((group,), time_s=time_s) for group in groups}

    def contents(self) -> str:
        """Return what the scene consists of, in words."""
        return f"{len(self.prepare().mitsuba_scene.shapes())} shapes"

    def trace_geometry(self, *, time_s: float | None = None, allow_unseen_target: bool = False) -> DepthAndTarget:
        """Trace depth and target; see :func:`saf_gen.render.depth_and_target.trace_geometry`."""
        return depth_and_target.trace_geometry(
            self.prepare(time_s=time_s), self.scene.card.target, allow_unseen_target=allow_unseen_target
        )

    def require_own_light(self, seen: DepthAndTarget) -> None:
        """Raise BadInput if the target is black; see :func:`saf_gen.render.own_light.require_own_light`."""
        own_light.require_own_light([self.prepare()], self.scene.card.target, seen=seen)

    def bounds(self, *names: str) -> np.ndarray:
        """Return the corners (m) of the box around the shapes with these names; without names, around everything.

        The result is float64 (2, 3), in world axes. For a shape of a shape group, it is the box around its instances.
        It is (0, 3) if no shape has one of the names, as for a lamp without a body or a shape of ``scene.py`` whose id
        is not its key.
        """
        instances = mitsuba_scene.instances_by_shape(self._described)
        names = tuple(shown for name in names for shown in instances.get(name, [name]))
        return _bounding_box(self.prepare().mitsuba_scene, names) * self.scene.card.unit_m

    def rest_bounds(self, name: str) -> np.ndarray:
        """Return the corners (m) of the box around a shape where its geometry places it, before any motion."""
        return _bounding_box(self._loaded(tuple(self.scene.card.lights), None)[0], (name,)) * self.scene.card.unit_m

    def render_stack(
        self,
        seen: DepthAndTarget,
        *,
        positions: int,
        samples: int,
        window: tuple[int, int] | None = None,
        time_s: float | None = None,
        as_one_group: bool = False,
        run: int = 0,
        moments: int = 1,
        step_s: float = 0.0,
        progress: Callable[[float], None] = lambda done: None,
    ) -> FocalStack:
        """Render the focal stack at evenly spaced positions, or at a window of them.

        Parameters
        ----------
        seen : DepthAndTarget
            Depth and target of the stack.
        positions : int
            Number of positions over the full travel.
        samples : int
            Smallest number of light paths per pixel, position and light group.
        window : tuple of int, optional
            First and last index of the positions to render; by default all.
        time_s : float, optional
            Moment (s); by default the moment that the card shows.
        as_one_group : bool, default False
            Render all lights at once, as one group with the name 'all'.
        run : int, default 0
            Number of the run; runs with different numbers have independent noise.
        moments : int, default 1
            Number of moments whose light paths give the shading, as for a time slice of a recording; the last is the
            moment of the stack.
        step_s : float, default 0.0
            Seconds from one of these moments to the next; if 0, the scene is at rest.
        progress : callable, optional
            Called with the fraction of the pictures that is done, 0 to 1.
        """
        lights = self.scene.card.lights
        groups = {"all": tuple(lights)} if as_one_group else {name: (name,) for name in lights}
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
        shading = None
        if estimators.shares_shading(spec.estimator, backend_name=self.backend_name):

            def show(at_s: float) -> dict[str, RenderSetup]:
                return setups if at_s == spec.time_s else {n: self.prepare(g, time_s=at_s) for n, g in groups.items()}

            moments_s = [spec.time_s - n * step_s for n in reversed(range(moments))]
            shading = self._estimate_shading(show, moments_s=moments_s, samples=samples, seed=seed)
        size = {"positions": positions, "samples": samples}
        found = self.render_groups(setups, shading, **size, window=window, seed=seed, progress=progress)
        radiance = [found[name][0] for name in groups]
        return FocalStack(spec, np.stack(radiance), seen.depth, seen.target, self.backend_name)

    def render_groups(
        self, setups: Mapping[str, RenderSetup], shading: ShadingField | None, **how: Any
    ) -> dict[str, tuple[np.ndarray, int]]:
        """Render the stacks of the scene under several lights; see :func:`saf_gen.render.estimators.render_groups`."""
        return estimators.render_groups(
            setups, backend_name=self.backend_name, emitting=self.emitting, shading=shading, **how
        )

    def _estimate_shading(
        self, show: Callable[[float], Mapping[str, RenderSetup]], *, moments_s: list[float], samples: int, seed: int
    ) -> ShadingField:
        """Return the shading at the last of several moments.

        The two latest results are kept, one for each of two runs. They can be used for every window of positions,
        because shading is estimated over the full travel.
        """
        shading_key = (tuple(moments_s), samples, seed)
        if shading_key not in self._shadings:
            paths = MomentShading(show, seed=seed, emitting=self.emitting)
            kept = list(self._shadings.items())[-1:]
            self._shadings = {**dict(kept), shading_key: paths.estimate(moments_s, samples=samples)}
        return self._shadings[shading_key]

    def render_picture(self, position: float, *, samples: int, time_s: float | None = None) -> np.ndarray:
        """Render the picture at a focus position under all lights: float32 (row, col).

        If the backend supports shared shading, the picture is rendered with it, at the nearest of POSITION_STEPS
        positions per travel.
        """
        return self._render_picture(self.prepare(time_s=time_s), position, samples=samples)

    def render_pinhole(
        self, position: float, *, samples: int, time_s: float | None = None, grid: PixelGrid | None = None
    ) -> np.ndarray:
        """Render the picture of a pinhole without diffraction, at the scale of ``position``: float32 (row, col)."""
        setup = self.prepare(time_s=time_s, f_number=PINHOLE_F_NUMBER, grid=grid)
        return self._render_picture(replace(setup, wavelength_m=0.0), position, samples=samples)

    def _render_picture(self, setup: RenderSetup, position: float, *, samples: int) -> np.ndarray:
        seed = seeds.derive_seed("whole picture", self.scene.digest)
        if not estimators.shares_shading("filtered", backend_name=self.backend_name):
            return thin_lens.render_position(setup, position=position, samples=samples, seed=seed)
        nearest = round(position * POSITION_STEPS)
        first = min(nearest, POSITION_STEPS - 1)
        paths = MomentShading(lambda _: {"all": setup}, seed=seed, emitting=self.emitting)
        found = self.render_groups(
            {"all": setup},
            paths.estimate((0.0,), samples=samples),
            positions=POSITION_STEPS + 1,
            window=(first, first + 1),
            samples=samples,
            seed=seed,
        )
        return found["all"][0][nearest - first]

    def render_region(
        self, position: float, *, samples: int, region: Region, time_s: float | None = None, run: int = 0
    ) -> np.ndarray:
        """Render a region of the image at a focus position under all lights: float32 (row, col).

        Runs with different numbers have independent noise.
        """
        seed = seeds.derive_seed("picture", self.scene.digest, run)
        setup = self.prepare(time_s=time_s)
        return thin_lens.render_position(setup, position=position, samples=samples, seed=seed, region=region)

    def estimate_irradiance(self, group: str, *, position: float, target: np.ndarray) -> tuple[float, float]:
        """Return the irradiance (W m⁻²) of the target by a light group, and its standard error."""
        return irradiance.target_irradiance(
            self.prepare((group,)), position=position, target=target, target_shapes=self.scene.card.target
        )

    def texel_footprints(self, position: float, target: np.ndarray) -> np.ndarray:
        """Return the size of texels; see :func:`saf_gen.render.depth_and_target.footprints`."""
        return depth_and_target.footprints(self.prepare(), self.scene.card.target, position=position, target=target)

    def _moment(self, time_s: float | None) -> float:
        return self.scene.card.still_s if time_s is None and self.motions else time_s or 0.0

    def _loaded(self, groups: tuple[str, ...], time_s: float | None) -> tuple[Any, Any]:
        """Return the scene at a time, or before any motion if ``time_s`` is None; the last scenes are kept.

        A scene that is not kept is released before another is loaded. The new one then gets its indices in Dr.Jit's
        registry, which are part of a kernel's code, and so finds its kernels in the cache. An ``lru_cache`` on a method
        would keep the renderer, and all its scenes, alive until garbage collection.
        """
        key = (groups, time_s)
        found = self._scenes.pop(key, None)
        if found is None:
            while len(self._scenes) >= self._kept:
                del self._scenes[next(iter(self._scenes))]
            found = self._load(groups, time_s)
        self._scenes[key] = found
        return found

    def _load(self, groups: tuple[str, ...], time_s: float | None) -> tuple[Any, Any]:
        card, moment = self.scene.card, self._described
        if time_s is not None:
            moment = mitsuba_scene.pose_shapes(moment, self.motions, time_s=time_s, unit_m=card.unit_m)
        emitters = tuple(emitter for group in groups for emitter in card.lights[group])
        where = str(self.scene.folder / ("scene.py" if self.scene.has_script else "scene.xml"))
        return mitsuba_scene.load_lit_scene(moment, emitters, max_depth=self.max_depth, where=where)


def _bounding_box(scene: Any, names: tuple[str, ...]) -> np.ndarray:
    """Return the corners (scene units) of the box around the shapes with these names, or around everything.

    The result is float64 (2, 3), or (0, 3) if there are no shapes with these names.
    """
    boxes = [shape.bbox() for shape in scene.shapes() if shape.id() in names] if names else [scene.bbox()]
    if not boxes:
        return np.empty((0, 3))
    corners = np.array([[box.min, box.max] for box in boxes], dtype=np.float64).reshape(-1, 2, 3)
    return np.array([corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)])
