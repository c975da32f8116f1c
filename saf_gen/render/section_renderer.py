"""Draws a thin section by waves, as :class:`saf_gen.render.scene_renderer.SceneRenderer` renders scenes by light paths.

The pictures are those of :mod:`saf_gen.optics.partial_coherence`, one for each light group and focus position. They are
in the unit of all stacks, radiance averaged over the aperture: a condenser of the radiance L and coherence S gives
L·min(S, 1)² where the section is clear. Nothing is random, so there is no grain, and a second run gives the same
picture.
"""

from collections.abc import Callable, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from saf_gen.core.cores import usable_cores
from saf_gen.core.region import Region
from saf_gen.errors import BadInput
from saf_gen.optics import Drive, FocusCriterion
from saf_gen.optics.partial_coherence import SectionImages
from saf_gen.render.depth_and_target import DepthAndTarget
from saf_gen.render.render_setup import positions_to_render
from saf_gen.render.thin_section import ThinSection, draw_section
from saf_gen.scene.keyframes import RigidMotion
from saf_gen.scene.scene_folder import Scene
from saf_gen.scene.section_card import SectionCard
from saf_gen.stack.focal_stack import WAVES, FocalStack, PixelGrid, StackSpec, StackStore

VISIBLE = 2.0  # half depths of focus beside the focus, where a phase section shows


class SectionRenderer:
    """Renders a thin section at any position and under any of its light groups.

    Parameters
    ----------
    scene : Scene
        Member of the scene's family, with ``section`` on its card.
    grid : PixelGrid
        Pixels of the sensor.
    drive : Drive, optional
        Lens with its focus drive; by default the card's.
    threads : int, optional
        Number of threads; by default as many as the cores that this process may use.

    Raises
    ------
    BadInput
        If the section cannot be drawn, the lens runs into it, or its aberrations vary over the field.
    """

    backend_name = WAVES
    is_slow = False

    def __init__(
        self, scene: Scene, grid: PixelGrid, *, drive: Drive | None = None, threads: int | None = None
    ) -> None:
        if scene.card.section is None:
            raise BadInput(f"scene {scene.id!r} is no thin section")
        self.scene, self.grid = scene, grid
        self.card: SectionCard = scene.card.section
        self.wavelength_m = self.card.wavelength_nm * 1e-9
        self.motions: dict[str, RigidMotion] = {}
        self._drive, self._threads = drive or scene.build_drive(), threads or usable_cores()
        self._kept: dict[tuple[Any, ...], np.ndarray] = {}

    @cached_property
    def section(self) -> ThinSection:
        """The section, as ``scene.py`` draws it."""
        return draw_section(self.scene)

    @property
    def depth_m(self) -> float:
        """Distance of the section from the lens as the card places it, metres."""
        camera = self.scene.card.camera
        return float(np.linalg.norm(np.subtract(camera.look_at_m, camera.origin_m))) - self.section.height_m

    @cached_property
    def _images(self) -> SectionImages:
        return SectionImages(
            self.section.amplitude(self.wavelength_m),
            self.section.texel_m,
            drive=self._drive,
            rows=self.grid.rows,
            columns=self.grid.columns,
            pitch_m=self.grid.pitch_m,
            depth_m=self.depth_m,
            wavelength_m=self.wavelength_m,
            coherence=max(condenser.coherence for condenser in self.card.condensers.values()),
            threads=self._threads,
        )

    def contents(self) -> str:
        """Return what the scene consists of, in words."""
        rows, columns = self.section.path_m.shape
        return f"a thin section of {columns} × {rows} texels of {self.section.texel_m * 1e6:.3g} µm"

    def bounds(self, *names: str) -> np.ndarray:
        """Return the corners (m) of the box around the section, float64 (2, 3), in axes of the picture."""
        rows, columns = self.section.path_m.shape
        half = np.array([columns, rows, 0]) * self.section.texel_m / 2
        middle = np.array([*self.scene.card.camera.look_at_m])
        return middle + np.array([-half, half])

    def rest_bounds(self, name: str) -> np.ndarray:
        """Return the corners (m) of the box around the section, which does not move."""
        return self.bounds(name)

    def trace_geometry(self, *, time_s: float | None = None, allow_unseen_target: bool = False) -> DepthAndTarget:
        """Return the depth of the section's plane, and the pixels that see the array of the section in focus.

        Raises
        ------
        BadInput
            If no position focuses the section, unless ``allow_unseen_target`` is given.
        """
        depth = np.full((self.grid.rows, self.grid.columns), self.depth_m, np.float32)
        whole = np.ones_like(depth, bool)
        best = FocusCriterion(self._drive, self.grid.pitch_m, self.wavelength_m).true_focus(depth, whole)
        if not (allow_unseen_target or 0 <= best <= 1):
            near, far = self._drive.focusing_range_m
            raise BadInput(
                f"the section is {self.depth_m:.6g} m away, out of the lens's reach",
                allowed=f"{near:g} to {far:g} m ({self._drive.travel_key} in scene.yaml)",
                hint="change height_um, or give the lens a longer travel",
            )
        best = min(max(best, 0.0), 1.0)
        distance = self.depth_m - float(self._drive.shift(best))
        footprint = self.grid.pitch_m * distance / float(self._drive.image_distance(best))
        inside = [
            2 * np.abs(np.arange(count) - (count - 1) / 2) * footprint <= size * self.section.texel_m
            for count, size in zip(depth.shape, self.section.path_m.shape, strict=True)
        ]
        target = np.logical_and.outer(*inside)
        if not (target.any() or allow_unseen_target):
            raise BadInput("the section is smaller than a pixel", hint="draw more of it, or choose a larger texel_um")
        return DepthAndTarget(depth, target)

    def require_own_light(self, seen: DepthAndTarget) -> None:
        """Raise BadInput if the section lets no light through."""
        if not self.section.transmission.max() > 0:
            raise BadInput(
                "the target (section) is black: its transmission is 0 everywhere",
                allowed="a transmission above 0 somewhere",
                hint="change what build() of scene.py returns",
            )

    def render_groups(
        self,
        names: Sequence[str],
        *,
        positions: int,
        window: tuple[int, int] | None = None,
        progress: Callable[[float], None] = lambda done: None,
    ) -> dict[str, np.ndarray]:
        """Return the stacks of light groups, each float32 (focus, row, col), W m⁻² sr⁻¹."""
        focus = positions_to_render(positions, window)
        found = {}
        for n, name in enumerate(names):
            planes = []
            for k, position in enumerate(focus):
                planes.append(self._render(self.scene.card.lights[name], float(position)))
                progress((n + (k + 1) / focus.size) / len(names))
            found[name] = np.stack(planes)
        return found

    def _render(self, condensers: Sequence[str], position: float) -> np.ndarray:
        seen = np.zeros((self.grid.rows, self.grid.columns), np.float32)
        for condenser in (self.card.condensers[name] for name in condensers):
            over_aperture = np.float32(condenser.radiance * condenser.coherence**2)
            seen += over_aperture * self._images.picture(position, coherence=condenser.coherence)
        return seen

    def render_stack(
        self,
        seen: DepthAndTarget,
        *,
        positions: int,
        samples: int = 1,
        window: tuple[int, int] | None = None,
        as_one_group: bool = False,
        progress: Callable[[float], None] = lambda done: None,
        **of_paths: Any,
    ) -> FocalStack:
        """Render the focal stack; see :meth:`saf_gen.render.scene_renderer.SceneRenderer.render_stack`.

        The latest stack is kept. What concerns light paths and motion (``samples``, ``time_s``, ``run``, ``moments``,
        ``step_s``) changes nothing.
        """
        groups = list(self.scene.card.lights)
        spec = StackSpec.from_scene(
            self.scene,
            self.grid,
            positions=positions,
            samples=samples,
            max_depth=1,
            time_s=0.0,
            wavelength_m=self.wavelength_m,
            groups=["all"] if as_one_group else groups,
            window=window,
        )
        key = (positions, window)
        if key not in self._kept:
            found = self.render_groups(groups, positions=positions, window=window, progress=progress)
            self._kept = {key: np.stack([found[name] for name in groups])}
        radiance = self._kept[key]
        if as_one_group:
            radiance = radiance.sum(axis=0, keepdims=True)
        return FocalStack(spec, radiance, seen.depth, seen.target, self.backend_name)

    def render_picture(self, position: float, **of_paths: Any) -> np.ndarray:
        """Render the picture at a focus position under all lights: float32 (row, col)."""
        condensers = [name for names in self.scene.card.lights.values() for name in names]
        return self._render(condensers, position)

    def render_pinhole(self, position: float, **of_paths: Any) -> np.ndarray:
        """Render the picture beside a focus position, where a phase section shows: float32 (row, col).

        Through a pinhole nothing of it would show, and waves would blur the rest.
        """
        criterion = FocusCriterion(self._drive, self.grid.pitch_m, self.wavelength_m)
        depth = np.full((1, 1), self.depth_m)
        low, high = criterion.depth_of_focus(depth, np.ones((1, 1), bool))
        beside = position + VISIBLE * (high - low) / 2
        return self.render_picture(beside if beside <= 1 else position - VISIBLE * (high - low) / 2)

    def render_region(self, position: float, *, region: Region, **of_paths: Any) -> np.ndarray:
        """Render a region of the picture at a focus position under all lights: float32 (row, col)."""
        return self.render_picture(position)[region]

    def texel_footprints(self, position: float, target: np.ndarray) -> np.ndarray:
        """Return the size of a texel (m), float64 (1,)."""
        return np.array([self.section.texel_m])

    def estimate_irradiance(self, group: str, *, position: float, target: np.ndarray) -> tuple[float, float]:
        """Return the irradiance (W m⁻²) of the section by a light group, π·L·(S·R/u)², and its standard error, 0."""
        aperture = self._drive.aperture_radius_m / float(self._drive.object_distance(position))
        condensers = (self.card.condensers[name] for name in self.scene.card.lights[group])
        return float(sum(np.pi * one.radiance * (one.coherence * aperture) ** 2 for one in condensers)), 0.0


def render_missing_sections(
    scene: Scene,
    specs: Sequence[StackSpec],
    *,
    root: Path,
    threads: int | None = None,
    progress: Callable[[str, float], None] = lambda name, done: None,
) -> list[str]:
    """Draw the missing pieces of a thin section's stacks; see :func:`saf_gen.render.render_missing`."""
    made = []
    for spec in specs:
        store = StackStore(root, spec)
        missing = store.missing_pieces()
        if not missing:
            continue
        renderer = SectionRenderer(scene, spec, drive=spec.drive, threads=threads)
        seen = renderer.trace_geometry()
        renderer.require_own_light(seen)
        if "geometry" in missing:
            store.write_geometry(seen.depth, seen.target, backend=renderer.backend_name)
        lights = [name for name in missing if name != "geometry"]
        found = renderer.render_groups(
            lights, positions=spec.positions, window=spec.window, progress=lambda done: progress("light", done)
        )
        for name, radiance in found.items():
            store.write_group(name, radiance, backend=renderer.backend_name)
        made += missing
    return made
