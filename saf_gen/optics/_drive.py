"""The interface of focus drives, and the equations of the thin lens that they share.

For focal length f, image distance v, object distance u and aperture radius R, 1/u + 1/v = 1/f. A ray through
the lens point a with slope s in object space meets the sensor at x = -v·(s + a/u). Light of wavelength λ spreads
a point over a width of about λ·v/R even in focus: at the blur c = λ·v/R the wavefronts of centre and border of the
aperture are a quarter of a wavelength apart.

Depths are measured in the frame of the scene card, from the lens as the card positions it. A drive may bring
lens and scene nearer to each other by ``shift`` metres; the lens then lies at that depth of the frame.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import asdict
from typing import Any, ClassVar

import numpy as np

from saf_gen.errors import BadInput

Positions = np.ndarray | float


class Drive(ABC):
    """A lens with its focus drive; each kind is a frozen dataclass."""

    kind: ClassVar[str]
    travel_key: ClassVar[str]
    """The key of a scene card that sets the travel, for messages."""

    f_number: float
    """f-number of the lens focused at infinity."""
    transmission: float

    @property
    @abstractmethod
    def aperture_radius_m(self) -> float:
        """Aperture radius R (m), the same at every position."""

    @abstractmethod
    def image_distance(self, position: Positions) -> np.ndarray:
        """Return v (m), from the lens to the sensor, at each position."""

    @abstractmethod
    def object_distance(self, position: Positions) -> np.ndarray:
        """Return u (m), from the lens to the plane in focus, at each position."""

    def shift(self, position: Positions) -> np.ndarray:
        """Return how much nearer (m) lens and scene are to each other than on the card; here 0."""
        return np.zeros_like(np.asarray(position, dtype=np.float64))

    @abstractmethod
    def best_position(self, depth: Positions) -> np.ndarray:
        """Return the position that focuses a point of this depth (m); it may lie outside 0...1."""

    @abstractmethod
    def true_focus(self, depths: np.ndarray) -> float:
        """Return the position that minimises the mean of c² over these depths (m)."""

    def depth_of_focus(
        self, depths: np.ndarray, pixel_pitch_m: float, *, wavelength_m: float = 0.0
    ) -> tuple[float, float]:
        """Return the two positions, in rising order, at which the blur is as wide as what the camera resolves in focus.

        That width is one pixel by geometric optics. With waves it is √(pixel² + (λ·v/R)²): widths of independent
        blurs add in squares, and a blur of λ·v/R alone is Rayleigh's quarter wave, λ/(2·NA²) on either side of the
        sensor with NA = R/v, λ/(2·(R/u)²) before the lens. The blur is that of the one depth in focus at
        :meth:`true_focus`: a target with a depth range is never sharp everywhere, and its mean blur might never be as
        small as a pixel.

        Parameters
        ----------
        depths : depths (m) of the target's pixels, any shape.
        pixel_pitch_m : width of a pixel.
        wavelength_m : of the light; 0 leaves waves out.

        Returns
        -------
        The positions, which may lie outside 0...1. One is infinite where the blur never grows so wide.

        References
        ----------
        Lord Rayleigh, "Investigations in optics, with special reference to the spectroscope", Phil. Mag. 8, 403 (1879),
        doi:10.1080/14786447908639715.
        """
        truth = self.true_focus(depths)
        in_focus = wavelength_m * float(self.image_distance(truth)) / self.aperture_radius_m
        low, high = sorted(self._positions_of_blur(truth, math.hypot(pixel_pitch_m, in_focus)))
        return low, high

    def check_wave_depth(self, wavelength_m: float) -> None:
        """Raise BadInput where waves alone keep more than the whole travel in focus, so that no position is best.

        ``wavelength_m`` is that of the light; 0 leaves waves out. An aperture of zero passes no light and is refused
        too.
        """
        if not self.aperture_radius_m > 0:
            raise BadInput("the aperture has no width", allowed="a finite f_number, above 0")
        width = wavelength_m * float(self.image_distance(0.5)) / self.aperture_radius_m
        low, high = sorted(self._positions_of_blur(0.5, width))
        if high - low > 1:
            raise BadInput(
                f"light of {wavelength_m * 1e9:.0f} nm through an aperture of {2e3 * self.aperture_radius_m:.3g} mm "
                f"stays in focus over {high - low:.3g} times the travel",
                allowed="a depth of focus by waves within the travel",
                hint="open the aperture (a lower f_number), give the lens a longer travel, or leave waves out with "
                "render: {diffraction: false}",
            )

    @abstractmethod
    def _positions_of_blur(self, focused: float, blur_m: float) -> tuple[float, float]:
        """Return the two positions at which a point in focus at ``focused`` is blurred by this diameter."""

    def focus_depth(self, position: Positions) -> np.ndarray:
        """Return the depth (m) of the plane in focus at each position, in the frame of the card."""
        return self.object_distance(position) + self.shift(position)

    @property
    def focusing_range_m(self) -> tuple[float, float]:
        """Nearest and farthest depth (m) that a position focuses."""
        near, far = sorted(float(depth) for depth in self.focus_depth(np.array([0.0, 1.0])))
        return near, far

    def blur_diameter(self, position: Positions, depth: Positions) -> np.ndarray:
        """Return the blur diameter (m, on the sensor) of a point at distance u_o: c = 2R·v·|1/u_o - 1/u|.

        It is infinite for a point at the lens or behind it.
        """
        distance = np.asarray(depth, dtype=np.float64) - self.shift(position)
        with np.errstate(divide="ignore"):
            defocus = np.where(distance > 0, 1 / distance, np.inf) - 1 / self.object_distance(position)
        return 2 * self.aperture_radius_m * self.image_distance(position) * np.abs(defocus)

    def ray_transfer(self, position: Positions, reference: float = 0.5) -> np.ndarray:
        """Return the path of a ray through the stack: float64 (..., 2, 2), M with (x_p, a_p) = M(p)·(x, a).

        (x, a) is where the ray meets sensor and lens (m) at the reference position, so its slope in object space is s =
        -(x/v + a/u). (x_p, a_p) is where it meets them at position p, with a_p = a + s·(shift_p - shift). M is linear
        in p for every drive, so a path is a straight line through the stack. Its determinant does not depend on the
        ray: rays spread evenly at one position are spread evenly at every position.
        """
        v, u = float(self.image_distance(reference)), float(self.object_distance(reference))
        v_p, u_p = self.image_distance(position), self.object_distance(position)
        nearer = self.shift(position) - self.shift(reference)
        from_lens = np.stack([-nearer / v, 1 - nearer / u], axis=-1)
        slope = np.array([-1 / v, -1 / u])
        on_sensor = -v_p[..., None] * (slope + from_lens / u_p[..., None])
        return np.stack([on_sensor, from_lens], axis=-2)

    def as_dict(self) -> dict[str, Any]:
        """Return the numbers of this drive and its kind as plain data."""
        return {"kind": self.kind, **asdict(self)}  # type: ignore[call-overload]
