"""Where a lens in front of pixels is in focus: the true focus of a target, and the best position of each pixel.

For a perfect thin lens it is the position of the least blur, the mean of c² over the target's pixels, in closed form.

A lens with aberrations has no such point: its rays meet nowhere. What an observer would call sharp is the position at
which a texture has the most contrast. The texture is stated: its power falls as 1/f², as that of natural scenes does
(Field 1987), from MIN_CYCLES to the Nyquist frequency of the pixels, evenly in all directions. Its contrast is

    C² = mean over pixels of ∫ |T(f)·S(f)|²/f² d²f

where S is the transfer of a square pixel and T that of the lens: of its waves if a wavelength is given,

    T(f) = 1/(π·R²)·∫ exp(2πi/λ·(W(a + λvf/2) - W(a - λvf/2))) d²a   over points a with both arguments in the aperture,

otherwise of its rays, T(f) = mean of exp(2πi·f·Δ(a)) with Δ = v·∇W. W is the wavefront plus that of defocus,
a²/2·(1/u_o - 1/u). The position of the least mean blur is known beside it (:meth:`FocusCriterion.least_blur`), because
the two differ: by a tenth of the half depth of focus for each wave of spherical aberration at f/2 and pixels of 20 µm,
by more where waves matter.

References
----------
D. J. Field, "Relations between the statistics of natural images and the response properties of cortical cells", J. Opt.
Soc. Am. A 4, 2379 (1987), doi:10.1364/JOSAA.4.002379.
H. H. Hopkins, "The frequency response of a defocused optical system", Proc. R. Soc. A 231, 91 (1955),
doi:10.1098/rspa.1955.0158.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np

from saf_gen.errors import BadInput
from saf_gen.optics._drive import Drive
from saf_gen.optics.wavefront import Wavefront

MIN_CYCLES = 1 / 64  # per pixel
FREQUENCIES, DIRECTIONS = 12, 6
LENS_POINTS = 512
STEP = 0.25  # of the half depth of focus, between the defoci of a table
REACH = 5.0  # half depths of focus beyond the aberrations that a table covers
HEIGHTS = 8  # tables from the middle of the sensor to the height at which aberrations are stated
MAX_STAGE_RESIDUAL_PX = 0.1
MAX_WAVES_SMALL_NA = 0.25
"""Largest wavefront, in wavelengths, where waves blur a point over half a pixel or more: paths bent at the aperture
have the transfer of waves within 0.05 there, and the gradient of a larger wavefront would add 0.1 and more."""


@dataclass(frozen=True)
class FocusCriterion:
    """What counts as in focus, for a lens in front of pixels.

    Attributes
    ----------
    drive : Drive
        Focus drive of the lens.
    pitch_m : float
        Pitch of the pixels, metres.
    wavelength_m : float, default 0.0
        Wavelength of the light, metres; 0 for geometric optics.
    """

    drive: Drive
    pitch_m: float
    wavelength_m: float = 0.0

    def true_focus(self, depth: np.ndarray, target: np.ndarray) -> float:
        """Return the position at which a target is sharpest; it may be outside 0 to 1.

        Parameters
        ----------
        depth : ndarray, shape (row, col)
            Depths of the pixels of the sensor, metres.
        target : ndarray of bool, shape (row, col)
            Pixels of the target, at least one.
        """
        if self.drive.wavefront is None:
            return self.drive.least_blur(depth[target])
        seen = self._collect(depth, target)
        return self._best(lambda position: -self._contrast(seen, position), seen, depth[target])

    def least_blur(self, depth: np.ndarray, target: np.ndarray) -> float:
        """Return the position of the least mean squared blur over a target; see :meth:`true_focus`."""
        if self.drive.wavefront is None:
            return self.drive.least_blur(depth[target])
        seen = self._collect(depth, target)
        return self._best(lambda position: self._mean_squared_blur(seen, position), seen, depth[target])

    def depth_of_focus(self, depth: np.ndarray, target: np.ndarray) -> tuple[float, float]:
        """Return the positions, in increasing order, between which a target is in focus.

        See :meth:`saf_gen.optics.Drive.depth_of_focus`.
        """
        return self.drive.depth_of_focus(self.true_focus(depth, target), self.pitch_m, wavelength_m=self.wavelength_m)

    def best_position(self, depth: np.ndarray) -> np.ndarray:
        """Return the position that brings each pixel into focus; it may be outside 0 to 1.

        Parameters
        ----------
        depth : ndarray, shape (row, col)
            Depths of the pixels of the sensor, metres.
        """
        if self.drive.wavefront is None:
            return self.drive.best_position(depth)
        height = image_heights(depth.shape, self.pitch_m)
        tables = self._tables(float(height.max()))
        peaks = [table.peak for table in tables]
        place = height / self._wavefront.height_m * HEIGHTS
        return self.drive.best_position(depth, defocus=np.interp(place, np.arange(len(tables)), peaks))

    def check(self, rows: int, columns: int) -> None:
        """Raise BadInput if the model of the lens does not hold in front of a sensor of this size.

        It does not if waves matter more than rays bent at the aperture can show, or if a stage moves so far that the
        wavefront of another part of the lens counts.
        """
        wavefront, drive = self.drive.wavefront, self.drive
        if wavefront is None:
            return
        corner = float(np.hypot(rows, columns)) / 2 * self.pitch_m
        largest = wavefront.largest_path(drive.aperture_radius_m, corner)
        spread = self.wavelength_m * float(drive.image_distance(0.5)) / drive.aperture_radius_m
        if spread >= self.pitch_m / 2 and largest > MAX_WAVES_SMALL_NA * self.wavelength_m:
            raise BadInput(
                f"the aberrations add up to {largest / self.wavelength_m:.3g} waves, and waves spread a point over "
                f"{spread / self.pitch_m:.2g} pixels",
                allowed=f"at most {MAX_WAVES_SMALL_NA:g} waves where waves spread a point over half a pixel or more",
                hint="lower aberrations in scene.yaml, or open the aperture",
            )
        if (moved := self.stage_residual_px(corner)) > MAX_STAGE_RESIDUAL_PX:
            raise BadInput(
                f"the aberrations change by up to {moved:.2g} pixels over the travel of the stage",
                allowed=f"at most {MAX_STAGE_RESIDUAL_PX:g} pixels: they are taken from the middle of the travel",
                hint="shorten travel_m, or lower aberrations in scene.yaml",
            )

    def stage_residual_px(self, height_m: float) -> float:
        """Return by how many pixels a ray may be off because a stage moves it over the lens; 0 for other drives."""
        wavefront, drive = self.drive.wavefront, self.drive
        ends = drive.shift(np.array([0.0, 1.0]))
        if wavefront is None or ends[0] == ends[1]:
            return 0.0
        v, u = float(drive.image_distance(0.5)), float(drive.object_distance(0.5))
        radius = drive.aperture_radius_m
        moved = abs(float(ends[1] - ends[0])) / 2 * (height_m / v + radius / u)
        angle = np.linspace(0, 2 * np.pi, 33)
        edge, corner = (radius * np.cos(angle), radius * np.sin(angle)), (height_m, 0.0)
        nearer = (edge[0] * (1 - moved / radius), edge[1] * (1 - moved / radius))
        change = np.subtract(wavefront.slope(edge, corner), wavefront.slope(nearer, corner))
        return float(np.hypot(*change).max()) * v / self.pitch_m

    # Of a lens with aberrations.

    @property
    def _wavefront(self) -> Wavefront:
        assert self.drive.wavefront is not None  # callers have made sure
        return self.drive.wavefront

    def _tables(self, largest_height: float) -> "list[_HeightTable]":
        """Return the contrast at heights up to one that is not below ``largest_height`` (m)."""
        count = 1
        if self._wavefront.varies_over_field:
            count = int(np.ceil(largest_height / self._wavefront.height_m * HEIGHTS)) + 1
        drive = self.drive
        lens = (self._wavefront, drive.aperture_radius_m, float(drive.image_distance(0.5)))
        heights = np.arange(count) * self._wavefront.height_m / HEIGHTS
        return [_height_table(*lens, float(h), self.pitch_m, self.wavelength_m) for h in heights]

    def _collect(self, depth: np.ndarray, target: np.ndarray) -> "list[_Seen]":
        depths = depth[target].astype(np.float64)
        height = image_heights(depth.shape, self.pitch_m)[target]
        tables = self._tables(float(height.max()))
        place = height / self._wavefront.height_m * HEIGHTS if len(tables) > 1 else np.zeros_like(height)
        found = []
        for n, table in enumerate(tables):
            share = np.clip(1 - np.abs(place - n), 0, None)  # of the two tables next to a height
            near = share > 0
            if near.any():
                distinct, where = np.unique(depths[near], return_inverse=True)
                found.append(_Seen(distinct, np.bincount(where, share[near]) / depths.size, table))
        return found

    def _contrast(self, seen: "list[_Seen]", position: float) -> float:
        return sum(float(one.weights @ one.table.contrast(self.drive.defocus(position, one.depths))) for one in seen)

    def _mean_squared_blur(self, seen: "list[_Seen]", position: float) -> float:
        defocus = [self.drive.defocus(position, one.depths) for one in seen]
        total = sum(
            float(one.weights @ (amount * (amount - 2 * one.table.balanced)))
            for one, amount in zip(seen, defocus, strict=True)
        )
        return total * float(self.drive.image_distance(position)) ** 2

    def _best(self, cost: Callable[[float], float], seen: "list[_Seen]", depths: np.ndarray) -> float:
        """Return the position of the least cost near that of the least blur of a perfect lens."""
        from scipy.optimize import minimize_scalar

        start, v = self.drive.least_blur(depths), float(self.drive.image_distance(0.5))
        low, high = self.drive.depth_of_focus(start, self.pitch_m, wavelength_m=self.wavelength_m)
        half = min(high - start, start - low)
        reach = max(
            abs(edge) for one in seen for edge in (one.table.defocus[0], one.table.defocus[-1])
        ) / resolved_defocus(self.drive.aperture_radius_m, v, self.pitch_m, self.wavelength_m)
        tried = start + half * np.arange(-reach, reach + STEP, STEP)
        best = float(tried[int(np.argmin([cost(position) for position in tried]))])
        found = minimize_scalar(
            cost, bounds=(best - STEP * half, best + STEP * half), method="bounded", options={"xatol": 1e-4 * half}
        )
        return float(found.x)


class _Seen(NamedTuple):
    """The distinct depths (m) of a target near the height of a table, and their shares of all its pixels."""

    depths: np.ndarray
    weights: np.ndarray
    table: "_HeightTable"


@dataclass(frozen=True, eq=False)
class _HeightTable:
    """Squared contrast over defocus (1/m) at one distance from the middle of the sensor.

    ``balanced`` is the defocus of the least blur.
    """

    defocus: np.ndarray
    squared: np.ndarray
    balanced: float

    @cached_property
    def _spline(self) -> Any:
        from scipy.interpolate import CubicSpline  # takes half a second and is needed for aberrations only

        return CubicSpline(self.defocus, self.squared)

    def contrast(self, defocus: np.ndarray) -> np.ndarray:
        return np.asarray(self._spline(np.clip(defocus, self.defocus[0], self.defocus[-1])))

    @property
    def peak(self) -> float:
        """Defocus of the largest contrast, by the parabola through the largest value and its neighbours."""
        k = min(max(int(self.squared.argmax()), 1), self.squared.size - 2)
        before, at, after = self.squared[k - 1 : k + 2]
        step = self.defocus[1] - self.defocus[0]
        return float(self.defocus[k] + step * (before - after) / (2 * (before - 2 * at + after)))


@lru_cache(maxsize=256)
def _height_table(
    wavefront: Wavefront, radius_m: float, image_distance_m: float, height_m: float, pitch_m: float, wavelength_m: float
) -> _HeightTable:
    a = lens_points(radius_m)
    slope = wavefront.slope(a, (height_m, 0.0))
    balanced = -2 * float(np.mean(a[0] * slope[0] + a[1] * slope[1])) / radius_m**2
    resolved = resolved_defocus(radius_m, image_distance_m, pitch_m, wavelength_m)
    # No part of the lens focuses farther from the least blur than this.
    spread = 4 * wavefront.largest_path(radius_m, height_m) / radius_m**2 / resolved
    count = int(np.ceil((REACH + spread) / STEP))
    defocus = balanced + np.arange(-count, count + 1) * STEP * resolved
    lens = (wavefront, radius_m, image_distance_m, height_m, pitch_m, wavelength_m)
    return _HeightTable(defocus, squared_contrast(defocus, *lens), balanced)


def resolved_defocus(radius_m: float, image_distance_m: float, pitch_m: float, wavelength_m: float) -> float:
    """Return the defocus (1/m) that blurs a point over the width that the camera resolves."""
    width = np.hypot(pitch_m, wavelength_m * image_distance_m / radius_m)
    return float(width) / (2 * radius_m * image_distance_m)


def image_heights(shape: tuple[int, ...], pitch_m: float) -> np.ndarray:
    """Return the distance (m) of each pixel from the middle of the sensor, float64 (row, col)."""
    rows, columns = ((np.arange(count) - (count - 1) / 2) * pitch_m for count in shape)
    return np.hypot(rows[:, None], columns)


def lens_points(radius_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Return points (m) spread evenly over a disc: a spiral whose turns are the golden angle."""
    n = np.arange(LENS_POINTS) + 0.5
    r, angle = radius_m * np.sqrt(n / LENS_POINTS), n * np.pi * (3 - np.sqrt(5))
    return r * np.cos(angle), r * np.sin(angle)


def squared_contrast(
    defocus: np.ndarray,
    wavefront: Wavefront,
    radius_m: float,
    image_distance_m: float,
    height_m: float,
    pitch_m: float,
    wavelength_m: float,
) -> np.ndarray:
    """Return the squared contrast of the stated texture at each defocus, divided by that of a perfect lens in focus.

    Parameters
    ----------
    defocus : ndarray of float64, shape (defocus,)
        1/u_o - 1/u, 1/m.
    wavefront : Wavefront
        Aberrations of the lens.
    radius_m, image_distance_m : float
        Radius of the aperture, and distance from the lens to the sensor, metres.
    height_m : float
        Distance from the middle of the sensor, metres.
    pitch_m, wavelength_m : float
        Pitch of the pixels and wavelength of the light, metres; 0 for geometric optics.

    Returns
    -------
    ndarray of float64, shape (defocus,)
        Without unit, at most about 1.
    """
    edges = np.geomspace(MIN_CYCLES, 0.5, FREQUENCIES + 1)
    cycles = np.sqrt(edges[1:] * edges[:-1]) / pitch_m
    a, point = lens_points(radius_m), (height_m, 0.0)
    slope = wavefront.slope(a, point)
    amount = np.asarray(defocus, np.float32)[:, None]
    total, full = np.zeros(len(defocus)), 0.0
    for direction in (np.arange(DIRECTIONS) + 0.5) * np.pi / DIRECTIONS:
        for f in cycles:
            fx, fy = f * np.cos(direction), f * np.sin(direction)
            pixel = float(np.sinc(fx * pitch_m) * np.sinc(fy * pitch_m)) ** 2
            full += pixel
            by_defocus = 2 * np.pi * image_distance_m * (a[0] * fx + a[1] * fy)
            if not wavelength_m:
                by_waves = 2 * np.pi * image_distance_m * (slope[0] * fx + slope[1] * fy)
            else:
                sx, sy = (wavelength_m * image_distance_m * part / 2 for part in (fx, fy))
                ahead, behind = (a[0] + sx, a[1] + sy), (a[0] - sx, a[1] - sy)
                both = np.maximum(np.hypot(*ahead), np.hypot(*behind)) <= radius_m
                path = wavefront.path(ahead, point) - wavefront.path(behind, point)
                by_defocus, by_waves = by_defocus[both], 2 * np.pi / wavelength_m * path[both]
            phase = amount * by_defocus.astype(np.float32) + by_waves.astype(np.float32)
            total += pixel * (np.cos(phase).sum(axis=1) ** 2 + np.sin(phase).sum(axis=1) ** 2)
    return total.astype(np.float64) / (full * LENS_POINTS**2)
