"""Thin sections: what ``scene.py`` draws of one, and its pictures by waves in place of light paths.

``build(params)`` returns a dictionary:

| key | what |
|---|---|
| `transmission` | share of the light that passes, 0 to 1, (row, col) |
| `path_nm` | optical thickness beyond that of the mounting medium, Δn times thickness, nm, (row, col) |
| `texel_um` | distance between neighbouring values, µm |
| `height_um` | height of the section over `camera.look_at_m`, towards the lens, µm; 0 if left out |

One of the two arrays may be a number. The first row is at the top of the picture, and the middle of the array in its
middle. Beyond the array the slide is clear. Values are samples of a smooth function: what is finer than two texels does
not exist.

The pictures are those of :mod:`saf_gen.optics.partial_coherence`, one for each light group and focus position. They are
in the unit of all stacks, radiance averaged over the aperture: a condenser of the radiance L and coherence S gives
L·min(S, 1)² where the section is clear. Nothing is random, so there is no grain, and a second run gives the same
picture.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from saf_gen.core.cores import usable_cores
from saf_gen.errors import BadInput
from saf_gen.optics import Drive, FocusCriterion
from saf_gen.optics.partial_coherence import SectionImages
from saf_gen.render.depth_and_target import DepthAndTarget
from saf_gen.render.mitsuba_scene import call_scene_script
from saf_gen.render.scene_renderer import SceneRenderer
from saf_gen.render.scene_sums import sum_up
from saf_gen.scene.scene_folder import Scene
from saf_gen.stack.focal_stack import WAVES, FocalStack, PixelGrid, StackSpec, StackStore
from saf_gen.stack.same_scene import require_same_scene

ARRAYS = {"transmission": (0.0, 1.0), "path_nm": (-1e5, 1e5)}
NUMBERS = {"texel_um": (1e-3, 1e4), "height_um": (-1e6, 1e6)}
"""Least and largest values of what a script draws."""
MAX_SIDE = 1 << 14  # texels


@dataclass(frozen=True, eq=False)
class ThinSection:
    """A thin section, perpendicular to the optical axis.

    Attributes
    ----------
    transmission : ndarray of float64, shape (row, col)
        Share of the light that passes, 0 to 1.
    path_m : ndarray of float64, shape (row, col)
        Optical thickness beyond that of the mounting medium, metres.
    texel_m : float
        Distance between neighbouring values, metres.
    height_m : float
        Height over ``camera.look_at_m`` towards the lens, metres.
    """

    transmission: np.ndarray
    path_m: np.ndarray
    texel_m: float
    height_m: float

    def amplitude(self, wavelength_m: float) -> np.ndarray:
        """Return the factor by which the section changes a wave, complex128 (row, col)."""
        return np.sqrt(self.transmission) * np.exp(2j * np.pi / wavelength_m * self.path_m)


def draw_section(scene: Scene) -> ThinSection:
    """Return the thin section that a scene's ``build(params)`` draws.

    Raises
    ------
    BadInput
        If the script fails or returns something else, with one line that names the value.
    """
    where = f"build() of {scene.folder / 'scene.py'}"
    drawn, keys = call_scene_script(scene, "build"), ARRAYS | NUMBERS
    if not (isinstance(drawn, dict) and set(keys) == {*drawn, "height_um"}):
        what = ", ".join(map(str, drawn)) if isinstance(drawn, dict) else type(drawn).__name__
        raise BadInput(f"{where} returned {what}", allowed=f"a dictionary of {', '.join(keys)}")
    found = {}
    for key, (low, high) in keys.items():
        try:
            given = np.asarray(drawn.get(key, 0.0))
        except ValueError:  # rows of different lengths
            given = np.asarray(None)
        fits = given.dtype.kind in "fiu" and given.ndim in ((0, 2) if key in ARRAYS else (0,))
        fits = fits and min(given.shape, default=1) > 0 and max(given.shape, default=1) <= MAX_SIDE
        if not (fits and low <= given.min() and given.max() <= high):  # NaN is neither
            what = f"{given.min():g} to {given.max():g}" if fits else f"{given.dtype} of shape {given.shape}"
            form = f"an array (row, col), at most {MAX_SIDE:,} a side, or a number" if key in ARRAYS else "a number"
            raise BadInput(f"{where} returned {key} as {what}", allowed=f"{form} of {low:g} to {high:g}")
        found[key] = given.astype(np.float64)
    shapes = [found[key].shape for key in ARRAYS]
    if len({*shapes} - {()}) != 1:
        raise BadInput(
            f"{where} returned transmission of shape {shapes[0]} and path_nm of {shapes[1]}",
            allowed="arrays (row, col) of one shape, or one of the two a number",
        )
    transmission, path = np.broadcast_arrays(found["transmission"], found["path_nm"])
    return ThinSection(transmission, path * 1e-9, float(found["texel_um"]) * 1e-6, float(found["height_um"]) * 1e-6)


class SectionRenderer(SceneRenderer):
    """Draws a thin section at any position and under any of its light groups.

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
        If the section cannot be drawn.
    """

    def __init__(
        self, scene: Scene, grid: PixelGrid, *, drive: Drive | None = None, threads: int | None = None
    ) -> None:
        assert scene.card.section is not None  # the caller has looked
        self.scene, self.grid, self.card = scene, grid, scene.card.section
        self.backend_name, self.motions, self.wavelength_m = WAVES, {}, self.card.wavelength_nm * 1e-9
        self.lens, self.section, self._threads = drive or scene.build_drive(), draw_section(scene), threads
        camera = scene.card.camera
        apart = float(np.linalg.norm(np.subtract(camera.look_at_m, camera.origin_m)))
        self.depth_m = apart - self.section.height_m

    @cached_property
    def _images(self) -> SectionImages:
        return SectionImages(
            self.section.amplitude(self.wavelength_m),
            self.section.texel_m,
            drive=self.lens,
            rows=self.grid.rows,
            columns=self.grid.columns,
            pitch_m=self.grid.pitch_m,
            depth_m=self.depth_m,
            wavelength_m=self.wavelength_m,
            coherence=max(condenser.coherence for condenser in self.card.condensers.values()),
            threads=self._threads or usable_cores(),
        )

    @cached_property
    def sums(self) -> tuple[float, ...]:
        """Sums of what the scene's script drew; see :mod:`saf_gen.render.scene_sums`."""
        return sum_up(vars(self.section), folder=self.scene.folder)

    def contents(self) -> str:
        """Return what the scene consists of, in words."""
        rows, columns = self.section.path_m.shape
        return f"a thin section of {columns} × {rows} texels of {self.section.texel_m * 1e6:.3g} µm"

    def bounds(self, *names: str) -> np.ndarray:
        """Return the corners (m) of the box around the section, float64 (2, 3), in axes of the picture."""
        rows, columns = self.section.path_m.shape
        half = np.array([columns, rows, 0]) * self.section.texel_m / 2
        return np.array(self.scene.card.camera.look_at_m) + np.array([-half, half])

    def trace_geometry(self, *, time_s: float | None = None, allow_unseen_target: bool = False) -> DepthAndTarget:
        """Return the depth of the section's plane, and the pixels that see the array of the section in focus.

        Raises
        ------
        BadInput
            If no position focuses the section, unless ``allow_unseen_target`` is given.
        """
        depth = np.full((self.grid.rows, self.grid.columns), self.depth_m, np.float32)
        whole = np.ones_like(depth, bool)
        best = FocusCriterion(self.lens, self.grid.pitch_m, self.wavelength_m).true_focus(depth, whole)
        if not (allow_unseen_target or 0 <= best <= 1):
            near, far = self.lens.focusing_range_m
            raise BadInput(
                f"the section is {self.depth_m:.6g} m away, out of the lens's reach",
                allowed=f"{near:g} to {far:g} m ({self.lens.travel_key} in scene.yaml)",
                hint="change height_um, or give the lens a longer travel",
            )
        best = min(max(best, 0.0), 1.0)
        distance = self.depth_m - float(self.lens.shift(best))
        footprint = self.grid.pitch_m * distance / float(self.lens.image_distance(best))
        inside = [
            2 * np.abs(np.arange(count) - (count - 1) / 2) * footprint <= size * self.section.texel_m
            for count, size in zip(depth.shape, self.section.path_m.shape, strict=True)
        ]
        return DepthAndTarget(depth, np.logical_and.outer(*inside))

    def require_own_light(self, seen: DepthAndTarget) -> None:
        """Raise BadInput if the section lets no light through."""
        if not self.section.transmission.max() > 0:
            raise BadInput("the target (section) is black", allowed="a transmission above 0 somewhere")

    def draw(
        self,
        groups: Mapping[str, Sequence[str]],
        focus: np.ndarray,
        *,
        progress: Callable[[float], None] = lambda done: None,
    ) -> np.ndarray:
        """Return the pictures under groups of condensers at positions, float32 (light, focus, row, col), W m⁻² sr⁻¹."""
        found = np.zeros((len(groups), len(focus), self.grid.rows, self.grid.columns), np.float32)
        for k, position in enumerate(focus.tolist()):
            for n, names in enumerate(groups.values()):
                for one in (self.card.condensers[name] for name in names):
                    over_aperture = np.float32(one.radiance * one.coherence**2)
                    found[n, k] += over_aperture * self._images.picture(position, coherence=one.coherence)
            progress((k + 1) / len(focus))
        return found

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
        """Render the focal stack; what concerns light paths and motion changes nothing."""
        spec = StackSpec.from_scene(
            self.scene,
            self.grid,
            positions=positions,
            samples=samples,
            max_depth=1,
            time_s=0.0,
            wavelength_m=self.wavelength_m,
            groups=["all"] if as_one_group else None,
            window=window,
        )
        groups = self._all_lights if as_one_group else self.scene.card.lights
        radiance = self.draw(groups, spec.focus, progress=progress)
        return FocalStack(spec, radiance, seen.depth, seen.target, self.backend_name)

    @property
    def _all_lights(self) -> dict[str, list[str]]:
        return {"all": [name for names in self.scene.card.lights.values() for name in names]}

    def render_picture(self, position: float, **of_paths: Any) -> np.ndarray:
        """Render the picture at a focus position under all lights: float32 (row, col)."""
        picture: np.ndarray = self.draw(self._all_lights, np.array([position]))[0, 0]
        return picture

    def render_pinhole(self, position: float, **of_paths: Any) -> np.ndarray:
        """Render the picture a depth of focus beside a position, where a phase section shows: float32 (row, col).

        Through a pinhole nothing of it would show, and waves would blur the rest.
        """
        low, high = self.lens.depth_of_focus(position, self.grid.pitch_m, wavelength_m=self.wavelength_m)
        away = high - low
        return self.render_picture(position + away if position + away <= 1 else position - away)

    def estimate_irradiance(self, group: str, *, position: float, target: np.ndarray) -> tuple[float, float]:
        """Return the irradiance (W m⁻²) of the section by a light group, π·L·(S·R/u)², and its standard error, 0."""
        aperture = self.lens.aperture_radius_m / float(self.lens.object_distance(position))
        condensers = (self.card.condensers[name] for name in self.scene.card.lights[group])
        return float(sum(np.pi * one.radiance * (one.coherence * aperture) ** 2 for one in condensers)), 0.0


def draw_missing(
    scene: Scene,
    specs: Sequence[StackSpec],
    *,
    root: Path,
    others: Sequence[StackSpec] = (),
    threads: int | None = None,
    progress: Callable[[str, float], None] = lambda name, done: None,
) -> list[str]:
    """Draw the missing pieces of a thin section's stacks; see :func:`saf_gen.render.render_missing`."""
    made: list[str] = []
    for spec in specs:
        store = StackStore(root, spec)
        missing = store.missing_pieces()
        if not missing:
            continue
        renderer = SectionRenderer(scene, spec, drive=spec.drive, threads=threads)
        require_same_scene(root, [*specs, *others], sums=renderer.sums)
        seen = renderer.trace_geometry()
        renderer.require_own_light(seen)
        how: dict[str, Any] = {"backend": renderer.backend_name, "sums": renderer.sums}
        if "geometry" in missing:
            store.write_geometry(seen.depth, seen.target, **how)
        groups = {name: scene.card.lights[name] for name in missing if name != "geometry"}
        drawn = renderer.draw(groups, spec.focus, progress=lambda done: progress("light", done))
        for name, radiance in zip(groups, drawn, strict=True):
            store.write_group(name, radiance, **how)
        made += missing
    return made
