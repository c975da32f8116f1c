"""Where a lens in front of pixels is in focus: the true focus of a target, and the best position of each pixel.

For a perfect thin lens it is the position of the least blur, the mean of c² over the target's pixels, in closed form.

A lens with aberrations has no such point: its rays meet nowhere. What an observer would call sharp is the position at
which a texture has the most contrast, averaged over the target's pixels. The texture is stated
(:mod:`saf_gen.optics.texture_contrast`). The position of the least mean squared blur is known beside it
(:meth:`FocusCriterion.least_blur`), because the two differ: by 0.02 half depths of focus for each wave of spherical
aberration at f/2 and pixels of 20 µm, by more where waves matter.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from saf_gen.errors import BadInput
from saf_gen.optics._drive import Drive
from saf_gen.optics.distortion import Distortion
from saf_gen.optics.texture_contrast import REACH, STEP, ContrastCurve, Imaging, contrast_curve
from saf_gen.optics.vignetting import Ring
from saf_gen.optics.wavefront import Wavefront

HEIGHTS = 8  # curves from the middle of the sensor to the height at which aberrations are stated
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
        return self._best(lambda position: -self._contrast(seen, position), seen=seen)

    def least_blur(self, depth: np.ndarray, target: np.ndarray) -> float:
        """Return the position of the least mean squared blur over a target; see :meth:`true_focus`."""
        if self.drive.wavefront is None:
            return self.drive.least_blur(depth[target])
        seen = self._collect(depth, target)
        return self._best(lambda position: self._mean_squared_blur(seen, position), seen=seen)

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
        peaks = [curve.peak for curve in self._curves(float(height.max()))]
        place = height / self._wavefront.height_m * HEIGHTS
        return self.drive.best_position(depth, defocus=np.interp(place, np.arange(len(peaks)), peaks))

    def check(self, rows: int, columns: int) -> None:
        """Raise BadInput if the model of the lens does not hold in front of a sensor of this size.

        It does not if waves matter more than rays bent at the aperture can show, if a stage moves so far that the
        wavefront of another part of the lens counts, if a ring in front of the lens leaves parts of the picture
        without light, or if distortion folds the picture.
        """
        wavefront, drive = self.drive.wavefront, self.drive
        corner = float(np.hypot(rows, columns)) / 2 * self.pitch_m
        if drive.ring is not None:
            self._check_ring(drive.ring, corner)
        if drive.distortion is not None:
            self._check_distortion(drive.distortion, corner)
        if wavefront is None:
            return
        largest = wavefront.largest_path(drive.aperture_radius_m, corner)
        if (most := self.largest_path_m) is not None and largest > most * (1 + 1e-9):
            raise BadInput(
                f"the aberrations add up to {largest / self.wavelength_m:.3g} waves",
                allowed=f"at most {MAX_WAVES_SMALL_NA:g} waves, because waves spread a point over "
                f"{self._spread_by_waves_m / self.pitch_m:.2g} pixels here, half or more",
                hint="lower aberrations in scene.yaml, or open the aperture",
            )
        if (moved := self.stage_residual_px(corner)) > MAX_STAGE_RESIDUAL_PX:
            raise BadInput(
                f"the aberrations change by up to {moved:.2g} pixels over the travel of the stage",
                allowed=f"at most {MAX_STAGE_RESIDUAL_PX:g} pixels: they are taken from the middle of the travel",
                hint="shorten travel_m, or lower aberrations in scene.yaml",
            )

    def _check_distortion(self, distortion: Distortion, corner_m: float) -> None:
        """Raise BadInput if the distortion does not suit this lens; the picture's half diagonal is ``corner_m``."""
        if self.drive.kind == "stage":
            raise BadInput("distortion is not built for a stage", hint="leave distortion out of scene.yaml")
        slope = corner_m / float(self.drive.image_distance(np.array([0.0, 1.0])).min())
        if distortion.folds(slope):
            most = 100 / 3 * (distortion.height_m / distortion.image_distance_m / slope) ** 2
            raise BadInput(
                f"distortion is {100 * distortion.share:g} percent, which folds the corner of the picture over itself",
                allowed=f"below {most:.3g} percent at height_mm {distortion.height_m * 1e3:g}",
            )

    def _check_ring(self, ring: Ring, corner_m: float) -> None:
        """Raise BadInput if the ring does not suit this lens; ``corner_m`` is the half diagonal of the picture."""
        drive, ends = self.drive, np.array([0.0, 1.0])
        if drive.kind == "stage":
            raise BadInput("vignetting is not built for a stage", hint="leave vignetting out of scene.yaml")
        if drive.wavefront is not None:
            raise BadInput("vignetting and aberrations are not built together", hint="leave one out of scene.yaml")
        if self._spread_by_waves_m >= self.pitch_m / 2:
            raise BadInput(
                f"waves spread a point over {self._spread_by_waves_m / self.pitch_m:.2g} pixels, and are not built for "
                "the edge of a ring",
                allowed="vignetting where they spread it over less than half a pixel",
                hint="open the aperture, or leave vignetting out of scene.yaml",
            )
        nearest = float(drive.object_distance(ends).min())
        if not ring.distance_m < nearest:
            raise BadInput(
                f"vignetting.distance_mm is {ring.distance_m * 1e3:g}",
                allowed=f"nearer than what the lens focuses, {nearest * 1e3:g} mm",
            )
        left = min(
            float(
                ring.relative_illumination(
                    corner_m,
                    aperture_radius_m=drive.aperture_radius_m,
                    image_distance_m=float(drive.image_distance(end)),
                    object_distance_m=float(drive.object_distance(end)),
                )
            )
            for end in ends
        )
        if not left > 0:
            least = corner_m / float(drive.image_distance(ends).min()) * ring.distance_m - drive.aperture_radius_m
            raise BadInput(
                f"vignetting leaves no light in the corner of the picture: radius_mm is {ring.radius_m * 1e3:g}",
                allowed=f"above about {max(least, 0) * 1e3:.3g} mm",
                hint="widen the ring, or bring it nearer to the lens",
            )

    @property
    def largest_path_m(self) -> float | None:
        """Largest wavefront (m) that rays can show; None if waves spread a point over less than half a pixel."""
        return MAX_WAVES_SMALL_NA * self.wavelength_m if self._spread_by_waves_m >= self.pitch_m / 2 else None

    @property
    def _spread_by_waves_m(self) -> float:
        return self.wavelength_m * self.imaging.image_distance_m / self.imaging.radius_m

    @property
    def imaging(self) -> Imaging:
        """What light passes on its way to a pixel, at the middle of the travel."""
        drive = self.drive
        return Imaging(drive.aperture_radius_m, float(drive.image_distance(0.5)), self.pitch_m, self.wavelength_m)

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

    def _curves(self, largest_height_m: float) -> list[ContrastCurve]:
        """Return the contrast at heights up to one that is not below the largest."""
        count = 1
        if self._wavefront.varies_over_field:
            count = int(np.ceil(largest_height_m / self._wavefront.height_m * HEIGHTS)) + 1
        heights = np.arange(count) * self._wavefront.height_m / HEIGHTS
        return [contrast_curve(self._wavefront, self.imaging, height_m=float(height)) for height in heights]

    def _collect(self, depth: np.ndarray, target: np.ndarray) -> "list[_Seen]":
        depths = depth[target].astype(np.float64)
        height = image_heights(depth.shape, self.pitch_m)[target]
        curves = self._curves(float(height.max()))
        place = height / self._wavefront.height_m * HEIGHTS if len(curves) > 1 else np.zeros_like(height)
        found = []
        for n, curve in enumerate(curves):
            share = np.clip(1 - np.abs(place - n), 0, None)  # of the two curves next to a height
            near = share > 0
            if near.any():
                distinct, where = np.unique(depths[near], return_inverse=True)
                found.append(_Seen(distinct, np.bincount(where, share[near]) / depths.size, curve))
        return found

    def _contrast(self, seen: "list[_Seen]", position: float) -> float:
        return sum(float(one.weights @ one.curve.at(self.drive.defocus(position, one.depths))) for one in seen)

    def _mean_squared_blur(self, seen: "list[_Seen]", position: float) -> float:
        """Return the mean squared blur over a constant, which is the part that no defocus changes."""
        total = 0.0
        for one in seen:
            defocus = self.drive.defocus(position, one.depths)
            total += float(one.weights @ (defocus * (defocus - 2 * one.curve.balanced)))
        return total * float(self.drive.image_distance(position)) ** 2

    def _best(self, cost: Callable[[float], float], *, seen: "list[_Seen]") -> float:
        """Return the position of the least cost near that of the least blur of a perfect lens."""
        from scipy.optimize import minimize_scalar  # takes half a second and is needed for aberrations only

        start = self.drive.least_blur(np.concatenate([one.depths for one in seen]))
        low, high = self.drive.depth_of_focus(start, self.pitch_m, wavelength_m=self.wavelength_m)
        half = min(high - start, start - low)
        farthest = max(np.abs(one.curve.defocus[[0, -1]]).max() for one in seen)
        reach = REACH + farthest / self.imaging.resolved_defocus + self._relief(seen)
        tried = start + half * np.arange(-reach, reach + STEP, STEP)
        best = float(tried[int(np.argmin([cost(position) for position in tried]))])
        found = minimize_scalar(
            cost, bounds=(best - STEP * half, best + STEP * half), method="bounded", options={"xatol": 1e-4 * half}
        )
        return float(found.x)

    def _relief(self, seen: "list[_Seen]") -> float:
        """Return by how many half depths of focus the depths of a target differ."""
        inverse = [1 / depth for one in seen for depth in (one.depths[0], one.depths[-1])]  # they are sorted
        return float(max(inverse) - min(inverse)) / self.imaging.resolved_defocus


class _Seen(NamedTuple):
    """The distinct depths (m) of a target near the height of a curve, and their shares of all its pixels."""

    depths: np.ndarray
    weights: np.ndarray
    curve: ContrastCurve


def image_heights(shape: tuple[int, ...], pitch_m: float) -> np.ndarray:
    """Return the distance (m) of each pixel from the middle of the sensor, float64 (row, col)."""
    rows, columns = ((np.arange(count) - (count - 1) / 2) * pitch_m for count in shape)
    return np.hypot(rows[:, None], columns)
