"""A scene set up to be looked at: one member of its family before a lens and a film, nothing stored."""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from saf_gen.core import seeds
from saf_gen.core.region import Region
from saf_gen.render import backend, depth_and_target, mitsuba_scene, one_pass, thin_lens
from saf_gen.render.depth_and_target import DepthAndTarget
from saf_gen.render.irradiance import estimate_irradiance
from saf_gen.render.render_setup import RenderSetup, SensorGrid
from saf_gen.render.texel_footprints import texel_footprints
from saf_gen.scene.keyframes import RigidMotion
from saf_gen.scene.scene_folder import Scene
from saf_gen.stack.focal_stack import FocalStack, StackSpec

__all__ = ["SceneRenderer"]

SHARP_F_NUMBER = 64.0  # the smallest stop a card may have: nothing is blurred at a camera's pixels


class SceneRenderer:
    """The scene as its geometry describes it, at any moment and under any of its light groups.

    film : the sensor's pixels. ``motions`` are those of its shapes, by name.

    Raises BadInput where the scene cannot be built, or the variant cannot run here.
    """

    motions: dict[str, RigidMotion]

    def __init__(self, scene: Scene, film: SensorGrid, *, backend_name: str, max_depth: int = 6) -> None:
        self.scene, self.film, self.max_depth = scene, film, max_depth
        self.backend_name = backend.choose_backend(backend_name)
        backend.activate_backend(self.backend_name)
        self._described = mitsuba_scene.build_scene_dict(scene)
        self.motions = mitsuba_scene.read_motions(scene, self._described)
        self._loaded = lru_cache(maxsize=4)(self._load)

    @property
    def is_slow(self) -> bool:
        """Whether this variant renders position after position."""
        return self.backend_name == "scalar"

    @property
    def entry_names(self) -> list[str]:
        """The entries of the scene, as its geometry names them."""
        return list(self._described)

    def prepare(
        self,
        groups: Sequence[str] | None = None,
        *,
        time_s: float | None = None,
        f_number: float | None = None,
        film: SensorGrid | None = None,
    ) -> RenderSetup:
        """The scene with these light groups burning (default: all), before its lens.

        Raises BadInput where Mitsuba cannot load it.
        """
        lit = tuple(self.scene.card.lights if groups is None else groups)
        loaded, integrator = self._loaded(lit, self._moment(time_s))
        to_world, unit_m = mitsuba_scene.camera_to_world(self.scene), self.scene.card.unit_m
        drive = self.scene.build_drive(f_number)
        return RenderSetup(loaded, integrator, to_world, drive, film or self.film, unit_m)

    def trace_depth_and_target(
        self, *, time_s: float | None = None, allow_unseen_target: bool = False
    ) -> DepthAndTarget:
        """Depth and target; see :func:`saf_gen.render.depth_and_target.trace_depth_and_target`."""
        return depth_and_target.trace_depth_and_target(
            self.prepare(time_s=time_s), self.scene.card.target, allow_unseen_target=allow_unseen_target
        )

    def bounds(self, *names: str) -> np.ndarray:
        """Corners (m) of the box round the shapes of these names, or round everything, world axes.

        float64 (2, 3); empty, (0, 3), where no shape has such a name: a lamp without a body, or a shape of
        ``scene.py`` that has an id other than its key.
        """
        return _box_of(self.prepare().mitsuba_scene, names) * self.scene.card.unit_m

    def rest_bounds(self, name: str) -> np.ndarray:
        """The same of an entry where its geometry places it, before it moves."""
        world = self._loaded(tuple(self.scene.card.lights), None)[0]
        return _box_of(world, (name,)) * self.scene.card.unit_m

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
    ) -> FocalStack:
        """The focal stack at evenly spaced positions, or at a window of them; ``run`` names its noise.

        ``together``: all lights at once, as one group of the name 'all'.
        """
        card = self.scene.card
        groups = {"all": tuple(card.lights)} if together else {name: (name,) for name in card.lights}
        spec = StackSpec.from_scene(
            self.scene,
            self.film,
            groups=groups,
            positions=positions,
            samples=samples,
            max_depth=self.max_depth,
            time_s=self._moment(time_s),
            window=window,
        )
        render = thin_lens.render_stack if self.is_slow else one_pass.render_stack
        seed = seeds.derive_seed("studio", replace(spec, time_s=0.0, window=None).key, run)
        radiance = [
            render(
                self.prepare(lit, time_s=time_s),
                positions=positions,
                samples=samples,
                window=window,
                seed=seeds.derive_seed(seed, group),
            )[0]
            for group, lit in groups.items()
        ]
        return FocalStack(spec, np.stack(radiance), seen.depth, seen.target, self.backend_name)

    def render_pinhole(
        self, position: float, *, samples: int, time_s: float | None = None, film: SensorGrid | None = None
    ) -> np.ndarray:
        """Everything sharp, as through a pinhole, at the scale of this position: float32 (row, col)."""
        setup = self.prepare(time_s=time_s, f_number=SHARP_F_NUMBER, film=film)
        return thin_lens.render_position(setup, position=position, samples=samples, seed=1)

    def render_region(
        self, position: float, *, samples: int, region: Region, time_s: float | None = None, run: int = 0
    ) -> np.ndarray:
        """A region of the picture at one focus position, all lights on: float32 (row, col). ``run`` names
        its noise."""
        seed = seeds.derive_seed("picture", self.scene.digest, run)
        setup = self.prepare(time_s=time_s)
        return thin_lens.render_position(setup, position=position, samples=samples, seed=seed, region=region)

    def estimate_irradiance(self, group: str, position: float, target: np.ndarray) -> tuple[float, float]:
        """Irradiance (W m⁻²) of the target by a light group, and its standard error."""
        return estimate_irradiance(self.prepare((group,)), position, target)

    def texel_footprints(self, position: float, target: np.ndarray) -> np.ndarray:
        """Size (m) of the finest texels of the target; see
        :func:`saf_gen.render.texel_footprints.texel_footprints`."""
        return texel_footprints(self.prepare(), self.scene.card.target, position, target)

    def _moment(self, time_s: float | None) -> float:
        return self.scene.card.still_s if time_s is None and self.motions else time_s or 0.0

    def _load(self, groups: tuple[str, ...], time_s: float | None) -> tuple[Any, Any]:
        """``time_s`` None: every shape where its geometry places it."""
        card = self.scene.card
        burning = tuple(emitter for group in groups for emitter in card.lights[group])
        moment = self._described
        if time_s is not None:
            moment = mitsuba_scene.pose_shapes(moment, self.motions, time_s, unit_m=card.unit_m)
        return mitsuba_scene.load_lit_scene(moment, burning, self.max_depth)


def _box_of(loaded: Any, names: tuple[str, ...]) -> np.ndarray:
    """Corners (scene units) of the box round everything, or round the shapes of these names.

    float64 (2, 3), or (0, 3) where there are none.
    """
    boxes = [shape.bbox() for shape in loaded.shapes() if shape.id() in names] if names else [loaded.bbox()]
    if not boxes:
        return np.empty((0, 3))
    corners = np.array([[box.min, box.max] for box in boxes], dtype=np.float64).reshape(-1, 2, 3)
    return np.array([corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)])
