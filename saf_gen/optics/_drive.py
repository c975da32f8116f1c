"""Interface of focus drives, and the equations of the thin lens that all drives share.

Focal length f, image distance v and object distance u satisfy 1/u + 1/v = 1/f. R is the aperture radius. A ray through
the point a of the lens with slope s in object space meets the sensor at x = -v·(s + a/u). Light of wavelength λ spreads
a point over a width of about λ·v/R even in focus: at the blur c = λ·v/R, the wavefronts at the centre and at the edge
of the aperture differ by a quarter of a wavelength.

Depths are measured in the frame of the scene card, from the lens as the card places it. A drive may move lens and scene
closer to each other by ``shift`` metres; the lens is then at that depth of the frame.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import asdict
from typing import Any, ClassVar

import numpy as np

from saf_gen.errors import BadInput
from saf_gen.optics.distortion import Distortion
from saf_gen.optics.fitted_rays import FittedRays, SeenWavefront
from saf_gen.optics.vignetting import Ring
from saf_gen.optics.wavefront import Wavefront

Positions = np.ndarray | float


class Drive(ABC):
    """A lens with its focus drive; each kind is a frozen dataclass."""

    kind: ClassVar[str]
    travel_key: ClassVar[str]
    """Key of a scene card that sets the travel, for error messages."""

    f_number: float
    """f-number of the lens focused at infinity."""
    transmission: float
    """Fraction of the light that the lens transmits."""
    wavefront: Wavefront | FittedRays | SeenWavefront | None
    """Aberrations of the lens; None for a perfect thin lens."""
    ring: Ring | None
    """Ring in front of the lens that takes light away from the edge of the picture; None for an open one."""
    distortion: Distortion | None
    """Distortion of the lens; None for one that shows all points where a perfect lens does."""
    veiling_glare: float
    """Share of the light in the frame that the lens spreads evenly over it, 0 to 1."""

    @property
    @abstractmethod
    def aperture_radius_m(self) -> float:
        """Aperture radius R in metres, which is the same at every position."""

    @abstractmethod
    def image_distance(self, position: Positions) -> np.ndarray:
        """Return the distance v from the lens to the sensor at each position, in metres."""

    @abstractmethod
    def object_distance(self, position: Positions) -> np.ndarray:
        """Return the distance u from the lens to the plane in focus at each position, in metres."""

    def shift(self, position: Positions) -> np.ndarray:
        """Return by how many metres lens and scene are closer to each other than on the card: 0 except for a stage."""
        return np.zeros_like(np.asarray(position, dtype=np.float64))

    @abstractmethod
    def best_position(self, depth: Positions, *, defocus: Positions = 0.0) -> np.ndarray:
        """Return the position that focuses a point at a depth in metres; it may be outside 0 to 1.

        ``defocus``, if given, is what :meth:`defocus` is to be there (1/m).
        """

    @abstractmethod
    def least_blur(self, depths: np.ndarray) -> float:
        """Return the position at which the mean of c², the squared blur of a perfect lens, over these depths (m) is
        least.
        """

    def depth_of_focus(
        self,
        focused: float,
        pixel_pitch_m: float,
        *,
        wavelength_m: float = 0.0,
        widths: tuple[float, float] = (1.0, 1.0),
    ) -> tuple[float, float]:
        """Return the two positions, in increasing order, at which the blur equals the width the camera resolves.

        This width is one pixel in geometric optics. With waves it is √(pixel² + (λ·v/R)²): the squared widths of
        independent blurs add, and a blur of λ·v/R alone is Rayleigh's quarter wave, at λ/(2·NA²) on either side of the
        sensor with NA = R/v, and at λ/(2·(R/u)²) in front of the lens. The blur is that of the single depth in focus at
        ``focused``, because a target with a range of depths is never sharp everywhere, and its mean blur may never be
        as small as a pixel.

        Parameters
        ----------
        focused : float
            Position at which the target is in focus (:mod:`saf_gen.optics.best_focus`).
        pixel_pitch_m : float
            Width of a pixel, metres.
        wavelength_m : float, default 0
            Wavelength of the light, metres; 0 ignores waves.
        widths : tuple of float, default (1, 1)
            How many such widths the blur of a perfect lens has at the ends that focus farther and nearer.

        Returns
        -------
        tuple of float
            The positions, which may be outside 0 to 1. One is infinite if the blur never becomes as large.

        References
        ----------
        Lord Rayleigh, "Investigations in optics, with special reference to the spectroscope", Phil. Mag. 8, 403 (1879),
        doi:10.1080/14786447908639715.
        """
        in_focus = wavelength_m * float(self.image_distance(focused)) / self.aperture_radius_m
        width = math.hypot(pixel_pitch_m, in_focus)
        low, high = sorted(self._positions_of_blur(focused, share * width)[n] for n, share in enumerate(widths))
        return low, high

    def check_wave_depth(self, wavelength_m: float) -> None:
        """Raise BadInput if waves keep more than the full travel in focus, so that no position is best.

        An aperture of zero, which passes no light, also raises BadInput.

        Parameters
        ----------
        wavelength_m : float
            Wavelength of the light, metres; 0 ignores waves.
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
        """Return the two positions at which a point in focus at ``focused`` has the blur diameter ``blur_m``.

        First that at which the lens focuses farther than the point.
        """

    def focus_depth(self, position: Positions) -> np.ndarray:
        """Return the depth of the plane in focus at each position, in metres in the frame of the card."""
        return self.object_distance(position) + self.shift(position)

    @property
    def focusing_range_m(self) -> tuple[float, float]:
        """Nearest and farthest depth in focus over the travel, in metres."""
        near, far = sorted(float(depth) for depth in self.focus_depth(np.array([0.0, 1.0])))
        return near, far

    def blur_diameter(self, position: Positions, depth: Positions) -> np.ndarray:
        """Return the blur diameter on the sensor, in metres, of a point at a depth in metres.

        For a point at the distance u_o from the lens it is c = 2R·v·|1/u_o - 1/u|, and infinite if the point is at the
        lens or behind it.
        """
        return 2 * self.aperture_radius_m * self.image_distance(position) * np.abs(self.defocus(position, depth))

    def defocus(self, position: Positions, depth: Positions) -> np.ndarray:
        """Return 1/u_o - 1/u (1/m) at a position, for a point at a depth in metres and the distance u_o from the lens.

        It is infinite if the point is at the lens or behind it.
        """
        distance = np.asarray(depth, dtype=np.float64) - self.shift(position)
        with np.errstate(divide="ignore"):
            return np.where(distance > 0, 1 / distance, np.inf) - 1 / self.object_distance(position)

    def ray_transfer(self, position: Positions, reference: float = 0.5) -> np.ndarray:
        """Return the matrix M of the path of a ray through the stack, with (x_p, a_p) = M(p)·(x, a).

        The ray meets the sensor at x and the lens at a (metres) if the drive is at the reference position, so its slope
        in object space is s = -(x/v + a/u). At position p it meets them at x_p and at a_p = a + s·d, with
        d = shift(p) - shift(reference). M is linear in p for every drive, so a path is a straight line through the
        stack. The determinant of M does not depend on the ray: rays that are spread uniformly at one position are
        spread uniformly at every position.

        Parameters
        ----------
        position : ndarray or float, any shape
            Positions p.
        reference : float, default 0.5
            The reference position.

        Returns
        -------
        ndarray of float64, shape (..., 2, 2)
            M at each position.
        """
        v, u = float(self.image_distance(reference)), float(self.object_distance(reference))
        v_p, u_p = self.image_distance(position), self.object_distance(position)
        nearer = self.shift(position) - self.shift(reference)
        from_lens = np.stack([-nearer / v, 1 - nearer / u], axis=-1)
        slope = np.array([-1 / v, -1 / u])
        on_sensor = -v_p[..., None] * (slope + from_lens / u_p[..., None])
        return np.stack([on_sensor, from_lens], axis=-2)

    @property
    def fills_its_aperture_perfectly(self) -> bool:
        """Whether rays fill the aperture evenly and meet in a point, so that paths of equal blur are alike."""
        return self.wavefront is None and self.ring is None

    def as_dict(self) -> dict[str, Any]:
        """Return the kind and the parameters of this drive as plain data, without what the lens does not have."""
        fields = asdict(self)  # type: ignore[call-overload]
        for name in ("wavefront", "ring", "distortion", "veiling_glare"):
            if not fields[name]:
                del fields[name]
        return {"kind": self.kind, **fields}
