"""Where a lens in front of pixels is in focus: the true focus of a target, and the best position of each pixel.

For a perfect thin lens it is the position of the least blur, the mean of c² over the target's pixels, in closed form.

A lens with aberrations has no such point: its rays meet nowhere. Nor has light of many wavelengths through a lens with
axial colour. What an observer would call sharp is the position at
which a texture has the most contrast, averaged over the target's pixels. The texture is stated
(:mod:`saf_gen.optics.texture_contrast`). The position of the least mean squared blur is known beside it
(:meth:`FocusCriterion.least_blur`), because the two differ: by 0.02 half depths of focus for each wave of spherical
aberration at f/2 and pixels of 20 µm, by more where waves matter.

**In focus** is a point while it is within one resolved width w of its best: a pixel, and what waves spread
(:meth:`saf_gen.optics.Drive.depth_of_focus`). For a perfect lens, whose blur grows from 0 to w, that is its depth of
focus e. A lens with aberrations keeps a point in focus

- by contrast, until its C² has fallen by the factor by which that of a perfect lens falls over e,
- by blur, until the diameter c = √(8·⟨r²⟩) of an even disc with its mean squared blur ⟨r²⟩ has grown by w. Since
  c² = c₀² + (w·x/e)² at x from the least blur, that is x = e·√(1 + 2·c₀/w).

A tilted or deep target is wider (:meth:`FocusCriterion.in_focus`).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from saf_gen.core.region import decile_pixels
from saf_gen.errors import BadInput
from saf_gen.optics._drive import Drive, Positions
from saf_gen.optics.distortion import Distortion
from saf_gen.optics.fitted_rays import FittedRays, SeenWavefront
from saf_gen.optics.texture_contrast import REACH, STEP, Blend, ContrastCurve, Imaging, contrast_curve
from saf_gen.optics.vignetting import Ring
from saf_gen.optics.wavefront import Wavefront

DEPTHS = 256  # of a target in blended light; more are put together
HEIGHTS = 8  # curves from the middle of the sensor to the height at which aberrations are stated
KNOTS = 5  # between which the best positions of a lens read from a file are interpolated
MAX_STAGE_RESIDUAL_PX = 0.1
MAX_RESIDUAL_PX = 0.2
"""Largest distance between fitted rays and those of the lens that a camera may see."""
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
    blend : tuple, default ()
        Light of several wavelengths, whose focus differs (:mod:`saf_gen.optics.texture_contrast`).
    """

    drive: Drive
    pitch_m: float
    wavelength_m: float = 0.0
    blend: Blend = ()

    @property
    def is_perfect(self) -> bool:
        """Whether all light of a point meets in a point: without aberrations, and in light of one focus."""
        return self.drive.wavefront is None and not any(shift for _, light in self.blend for shift in light.shifts)

    def true_focus(self, depth: np.ndarray, target: np.ndarray) -> float:
        """Return the position at which a target is sharpest; it may be outside 0 to 1.

        Parameters
        ----------
        depth : ndarray, shape (row, col)
            Depths of the pixels of the sensor, metres.
        target : ndarray of bool, shape (row, col)
            Pixels of the target, at least one.
        """
        if self.is_perfect:
            return self.drive.least_blur(depth[target])
        if self._fitted:
            return self._at(depth[target]).true_focus(depth, target)
        seen = self._collect(depth, target)
        return self._best(lambda position: -self._contrast(seen, position), seen=seen)

    def least_blur(self, depth: np.ndarray, target: np.ndarray) -> float:
        """Return the position of the least mean squared blur over a target; see :meth:`true_focus`."""
        if self.is_perfect:
            return self.drive.least_blur(depth[target])
        if self._fitted:
            return self._at(depth[target]).least_blur(depth, target)
        seen = self._collect(depth, target)
        return self._best(lambda position: self._mean_squared_blur(seen, position), seen=seen)

    def depth_of_focus(self, depth: np.ndarray, target: np.ndarray) -> tuple[float, float]:
        """Return the positions, in increasing order, between which a target is in focus.

        See :meth:`saf_gen.optics.Drive.depth_of_focus`.
        """
        return self.drive.depth_of_focus(self.true_focus(depth, target), self.pitch_m, wavelength_m=self.wavelength_m)

    def in_focus(self, depth: np.ndarray, target: np.ndarray, *, by_blur: bool = False) -> tuple[float, float]:
        """Return the positions, in increasing order, between which something of a target is in focus.

        Its pixels are in focus in turn: the interval begins where that at the first decile of the best positions comes
        into focus, and ends where that at the last does, so that few outliers do not count. It always includes what the
        target would have if all of it were at its true focus. For a flat target and a perfect lens it is
        :meth:`depth_of_focus`.

        Parameters
        ----------
        depth : ndarray, shape (row, col)
            Depths of the pixels of the sensor, metres.
        target : ndarray of bool, shape (row, col)
            Pixels of the target, at least one.
        by_blur : bool, default False
            Whether blur counts, and not contrast; they are the same for a perfect lens.
        """
        if self._fitted:
            return self._at(depth[target]).in_focus(depth, target, by_blur=by_blur)
        middle = self.least_blur(depth, target) if by_blur else self.true_focus(depth, target)
        depths = depth[target].astype(np.float64)
        if self.is_perfect:
            defocus, widths = np.zeros_like(depths), np.ones((2, depths.size))
        else:
            height = image_heights(depth.shape, self.pitch_m)[target]
            curves = self._curves(float(height.max()))
            place, known = height / self._curve_height_m * HEIGHTS, np.arange(len(curves))
            defocus = np.interp(place, known, [one.balanced if by_blur else one.peak for one in curves])
            reaches = np.array([self._widths(one, by_blur=by_blur) for one in curves]).T
            widths = np.array([np.interp(place, known, reach) for reach in reaches])
        best = self.drive.best_position(depths, defocus=defocus)
        ends = [(float(best[n]), widths[:, n]) for n in decile_pixels(best)] + [(middle, widths.mean(axis=1))]
        found = [
            self.drive.depth_of_focus(
                at, self.pitch_m, wavelength_m=self.wavelength_m, widths=(float(far), float(near))
            )
            for at, (near, far) in ends
        ]
        return min(low for low, _ in found), max(high for _, high in found)

    def _widths(self, curve: ContrastCurve, *, by_blur: bool) -> tuple[float, float]:
        """Return for how many half depths of focus a point is in focus where the lens focuses nearer, and farther."""
        half = self.imaging.resolved_defocus
        if by_blur:
            return (float(np.sqrt(1 + 2 * curve.left / half)),) * 2
        perfect = contrast_curve(None, self.imaging, height_m=0.0)
        below, above = curve.reach(float(perfect.at(np.array(half)) / perfect.squared.max()))
        return below / half, above / half

    def best_position(self, depth: np.ndarray) -> np.ndarray:
        """Return the position that brings each pixel into focus; it may be outside 0 to 1.

        Parameters
        ----------
        depth : ndarray, shape (row, col)
            Depths of the pixels of the sensor, metres.
        """
        if self.is_perfect:
            return self.drive.best_position(depth)
        if self._fitted:
            return self._best_positions_of_fitted(depth)
        height = image_heights(depth.shape, self.pitch_m)
        peaks = [curve.peak for curve in self._curves(float(height.max()))]
        place = height / self._curve_height_m * HEIGHTS
        return self.drive.best_position(depth, defocus=np.interp(place, np.arange(len(peaks)), peaks))

    def check(self, rows: int, columns: int) -> None:
        """Raise BadInput if the model of the lens does not hold in front of a sensor of this size.

        It does not if waves matter more than rays bent at the aperture can show, if a stage moves so far that the
        wavefront of another part of the lens counts, if a ring in front of the lens leaves parts of the picture
        without light, or if distortion folds the picture.
        """
        drive, wavefront = self.drive, self.drive.wavefront
        corner = float(np.hypot(rows, columns)) / 2 * self.pitch_m
        if drive.ring is not None:
            self._check_ring(drive.ring, corner)
        if drive.distortion is not None:
            self._check_distortion(drive.distortion, corner)
        if wavefront is None:
            return
        if isinstance(wavefront, FittedRays):
            self._check_fitted(wavefront, corner)
            wavefront = self._at(drive.object_distance(0.5)).drive.wavefront
            assert isinstance(wavefront, SeenWavefront)
        largest = wavefront.largest_path(drive.aperture_radius_m, corner)
        if (most := self.largest_path_m) is not None and largest > most * (1 + 1e-9):
            raise BadInput(
                f"the aberrations add up to {largest / self.wavelength_m:.3g} waves",
                allowed=f"at most {MAX_WAVES_SMALL_NA:g} waves, because waves spread a point over "
                f"{self.spread_by_waves_m / self.pitch_m:.2g} pixels here, half or more",
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
        if self.spread_by_waves_m >= self.pitch_m / 2:
            raise BadInput(
                f"waves spread a point over {self.spread_by_waves_m / self.pitch_m:.2g} pixels, and are not built for "
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
        return MAX_WAVES_SMALL_NA * self.wavelength_m if self.spread_by_waves_m >= self.pitch_m / 2 else None

    @property
    def spread_by_waves_m(self) -> float:
        """Width over which waves spread a point in focus, metres; 0 in geometric optics."""
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
        if not isinstance(wavefront, Wavefront) or ends[0] == ends[1]:
            return 0.0
        v, u = float(drive.image_distance(0.5)), float(drive.object_distance(0.5))
        radius = drive.aperture_radius_m
        moved = abs(float(ends[1] - ends[0])) / 2 * (height_m / v + radius / u)
        angle = np.linspace(0, 2 * np.pi, 33)
        edge, corner = (radius * np.cos(angle), radius * np.sin(angle)), (height_m, 0.0)
        nearer = (edge[0] * (1 - moved / radius), edge[1] * (1 - moved / radius))
        change = np.subtract(wavefront.slope(edge, corner), wavefront.slope(nearer, corner))
        return float(np.hypot(*change).max()) * v / self.pitch_m

    # Of a lens read from a file, whose aberrations depend on the distance of the object.

    @property
    def _fitted(self) -> bool:
        return isinstance(self.drive.wavefront, FittedRays)

    def _at(self, depths: Positions) -> "FocusCriterion":
        """Return the criterion for a lens with the aberrations of objects at the median of these depths (m)."""
        depth = float(np.median(depths))
        v = float(self.drive.image_distance(np.clip(self.drive.best_position(depth), -1, 2)))
        seen = replace(self.drive, wavefront=self.drive.wavefront.seen_from(depth, v))  # type: ignore[union-attr,type-var]
        return replace(self, drive=seen)

    def _best_positions_of_fitted(self, depth: np.ndarray) -> np.ndarray:
        """Return the best position of each pixel, between those of depths that are in focus over the travel."""
        inverse = 1 / np.asarray(depth, dtype=np.float64)
        known = 1 / self.drive.object_distance(np.linspace(0, 1, KNOTS))
        found = np.stack([self._at(1 / one).best_position(depth) for one in known])
        order = np.argsort(known)
        place = np.interp(inverse, known[order], np.arange(KNOTS))
        below = np.minimum(place.astype(int), KNOTS - 2)
        pick = [np.take_along_axis(found[order], (below + n)[None], axis=0)[0] for n in (0, 1)]
        return pick[0] + (place - below) * (pick[1] - pick[0])

    def _check_fitted(self, rays: FittedRays, corner: float) -> None:
        if corner > rays.height_m * (1 + 1e-9):
            raise BadInput(
                f"the corner of the sensor is {corner * 1e3:.3g} mm from its middle",
                allowed=f"at most {rays.height_m * 1e3:.3g} mm, for which the lens is fitted",
                hint="take a smaller sensor, or fit the lens again with --height-mm",
            )
        if rays.residual_m > MAX_RESIDUAL_PX * self.pitch_m:
            raise BadInput(
                f"the fitted lens is up to {rays.residual_m / self.pitch_m:.2g} pixels from the rays of its file",
                allowed=f"at most {MAX_RESIDUAL_PX:g} pixels",
                hint="fit it with a higher --degree, a higher --f-number or a lower --height-mm",
            )

    # Of a lens with aberrations, or of light with several foci.

    @property
    def _curve_height_m(self) -> float:
        """Distance from the middle of the sensor of the last of HEIGHTS curves, metres."""
        return 1.0 if self.drive.wavefront is None else self.drive.wavefront.height_m

    def _curves(self, largest_height_m: float) -> list[ContrastCurve]:
        """Return the contrast at heights up to one that is not below the largest."""
        count = 1
        wavefront = self.drive.wavefront
        assert not isinstance(wavefront, FittedRays)  # callers take the lens as it is seen from a depth
        if wavefront is not None and wavefront.varies_over_field:
            count = int(np.ceil(largest_height_m / wavefront.height_m * HEIGHTS)) + 1
        heights = np.arange(count) * self._curve_height_m / HEIGHTS
        return [contrast_curve(wavefront, self.imaging, height_m=float(h), blend=self.blend) for h in heights]

    def _collect(self, depth: np.ndarray, target: np.ndarray) -> "list[_Seen]":
        depths = depth[target].astype(np.float64)
        height = image_heights(depth.shape, self.pitch_m)[target]
        curves = self._curves(float(height.max()))
        place = height / self._curve_height_m * HEIGHTS if len(curves) > 1 else np.zeros_like(height)
        found = []
        for n, curve in enumerate(curves):
            share = np.clip(1 - np.abs(place - n), 0, None)  # of the two curves next to a height
            near = share > 0
            if near.any():
                distinct, where = np.unique(depths[near], return_inverse=True)
                if self.blend and distinct.size > DEPTHS:  # a recording has one true focus for each mix of its lamps
                    inverse = np.linspace(1 / distinct[0], 1 / distinct[-1], DEPTHS)
                    where = np.rint((1 / depths[near] - inverse[0]) / (inverse[1] - inverse[0])).astype(np.int64)
                    with np.errstate(divide="ignore"):  # the sky
                        distinct = 1 / inverse
                found.append(
                    _Seen(distinct, np.bincount(where, share[near], minlength=distinct.size) / depths.size, curve)
                )
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
