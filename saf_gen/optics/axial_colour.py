"""The axial colour of a lens: how its power, and with it the focus, changes with the wavelength of the light.

A lens of the power φ has the power φ + δ(λ) for light of the wavelength λ, with δ = 0 at a reference wavelength. In
focus for the reference is 1/u, in focus for λ is 1/u + δ. So at the position p a lens draws in the light λ what it
draws at another position p' in the reference light, where p' focuses 1/u + δ: what p' is, the drive says. For
``focal_length`` that is exact. A lens that moves (``image_distance``) draws exactly the same picture, but larger by
v(p')/v(p); under a ``stage``, p' holds for the plane in focus, and the scale differs by the shift over u.

A singlet follows the dispersion of its glass. An achromat of two glasses focuses the lines F (486.1 nm) and C
(656.3 nm) at one point; that the line d (587.6 nm) comes to focus nearer by f/2000 is its secondary spectrum. Its shape
over the wavelengths is that of N-BK7 with F2.

References
----------
Schott AG, "Optical glass data sheets" (2017), for the coefficients of Sellmeier's formula.
R. Kingslake, R. B. Johnson, "Lens Design Fundamentals" (2010), chapter 5, doi:10.1016/C2009-0-22069-1.
"""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from saf_gen.core.config.document import FrozenModel
from saf_gen.errors import BadInput
from saf_gen.optics._drive import Drive, Positions

D_NM, F_NM, C_NM = 587.5618, 486.1327, 656.2725
"""Fraunhofer lines: helium, and two of hydrogen."""

GLASSES = {
    "n-bk7": ((1.03961212, 0.231792344, 1.01046945), (0.00600069867, 0.0200179144, 103.560653)),
    "f2": ((1.34533359, 0.209073176, 0.937357162), (0.00997743871, 0.0470450767, 111.886764)),
    "n-sf11": ((1.73759695, 0.313747346, 1.89878101), (0.013188707, 0.0623068142, 155.23629)),
    "n-fk51a": ((0.971247817, 0.216901417, 0.904651666), (0.00472301995, 0.0153575612, 168.68133)),
}
"""Coefficients B and C (µm²) of n² - 1 = Σ B·λ²/(λ² - C), by the name of the glass."""

SEEN_NM = np.arange(380.0, 1101.0, 5.0)
"""Light that a sensor may see; a stack is rendered wide enough for all of it, so that no lamp needs another stack."""
MAX_MARGIN = 4
"""Largest shift of the focus on either side, in travels of the lens."""

Shift = tuple[Annotated[float, Field(ge=200, le=3000)], Annotated[float, Field(ge=-0.2, le=0.2)]]


class AxialColour(FrozenModel):
    """How far light of other wavelengths comes to focus; give one of the first three keys."""

    achromat: float | None = Field(default=None, ge=200, le=1e6)
    """Focal length divided by the secondary spectrum, the distance between the foci of green and of blue or red light:
    2000 for a usual achromat of two glasses."""
    singlet: Literal["n-bk7", "f2", "n-sf11", "n-fk51a"] | None = None
    """Glass of a single lens."""
    measured: tuple[Shift, ...] | None = Field(default=None, min_length=2, max_length=1000)
    """Pairs of a wavelength (nm, rising) and the relative change of the focal length, such as [[450, 0.0004], [550, 0],
    [850, 0.002]]."""
    reference_nm: float | None = Field(default=None, ge=200, le=3000)
    """Wavelength at which the lens has the focal length of its card, nm; by default that of the sensor."""

    @model_validator(mode="after")
    def _states_one(self) -> "AxialColour":
        if sum(value is not None for value in (self.achromat, self.singlet, self.measured)) != 1:
            raise ValueError("one of achromat: 2000, singlet: GLASS, measured: [[NM, SHIFT], …]")
        if self.measured is not None and not (np.diff([nm for nm, _ in self.measured]) > 0).all():
            raise ValueError("wavelengths that rise")
        return self

    def relative_power(self, nm: np.ndarray, *, reference_nm: float) -> np.ndarray:
        """Return φ(λ)/φ(reference) - 1 without unit, float64, at wavelengths in nm.

        The reference is that of the lens if it states one, else ``reference_nm``.
        """
        at = np.array([self.reference_nm or reference_nm])
        power, reference = self._power(np.asarray(nm, dtype=np.float64)), self._power(at)[0]
        return np.asarray(power / reference - 1)

    def shifts(self, drive: Drive, nm: np.ndarray, *, reference_nm: float) -> np.ndarray:
        """Return δ(λ), by which the power of a lens is larger than in reference light, 1/m.

        The focal length of the lens is taken to be that of the card for ``image_distance`` and ``stage``, and that of
        the lens focused at infinity for ``focal_length``, whose varying part is thus taken to be free of colour.
        """
        focal_length_m = 2 * drive.aperture_radius_m * drive.f_number
        return self.relative_power(nm, reference_nm=reference_nm) / focal_length_m

    def _power(self, nm: np.ndarray) -> np.ndarray:
        """Return φ(λ)/φ(d)."""
        if self.measured is not None:
            wavelengths, change = np.array(self.measured).T
            return np.asarray(1 / (1 + np.interp(nm, wavelengths, change)))
        if self.singlet is not None:
            return _relative_excess(self.singlet, nm)
        crown, flint = _abbe("n-bk7"), _abbe("f2")

        def natural(nm: np.ndarray) -> np.ndarray:
            both = crown * _relative_excess("n-bk7", nm) - flint * _relative_excess("f2", nm)
            return np.asarray(both / (crown - flint) - 1)

        assert self.achromat is not None  # one of the three is given
        return 1 - natural(nm) / natural(np.array([F_NM]))[0] / self.achromat


def refractive_index(glass: str, nm: np.ndarray) -> np.ndarray:
    """Return the refractive index of a glass of GLASSES at wavelengths in nm."""
    squared = (np.asarray(nm, dtype=np.float64) * 1e-3) ** 2
    return np.sqrt(1 + sum(b * squared / (squared - c) for b, c in zip(*GLASSES[glass], strict=True)))


def _relative_excess(glass: str, nm: np.ndarray) -> np.ndarray:
    """Return (n(λ) - 1)/(n(d) - 1), the power of a thin lens of this glass relative to its power at the line d."""
    return np.asarray((refractive_index(glass, nm) - 1) / (refractive_index(glass, np.array(D_NM)) - 1))


def _abbe(glass: str) -> float:
    d, f, c = refractive_index(glass, np.array([D_NM, F_NM, C_NM]))
    return float((d - 1) / (f - c))


def shifted_positions(drive: Drive, position: Positions, *, shift: Positions) -> np.ndarray:
    """Return the position at which reference light draws what a lens whose power is larger by ``shift`` (1/m) draws.

    The arguments broadcast; the result may be outside 0 to 1.
    """
    return drive.best_position(drive.focus_depth(position), defocus=-np.asarray(shift, dtype=np.float64))


def stack_margin(colour: AxialColour, drive: Drive, *, positions: int, reference_nm: float) -> tuple[int, int]:
    """Return how many positions beyond either end of the travel colour needs, of ``positions`` in the travel.

    Raises BadInput if they are too many, or the lens cannot be there.
    """
    shift = colour.shifts(drive, SEEN_NM, reference_nm=reference_nm)
    ends = shifted_positions(drive, np.array([0.0, 1.0])[:, None], shift=shift)
    beyond = max(-float(ends.min()), float(ends.max()) - 1) if np.isfinite(ends).all() else np.inf
    if not beyond <= MAX_MARGIN:
        raise BadInput(
            f"the axial colour of the lens moves the focus by {beyond:.3g} travels beyond the ends",
            allowed=f"at most {MAX_MARGIN}",
            hint="give the lens a longer travel, or less axial_colour",
        )
    before, after = (
        max(int(np.ceil(far * (positions - 1) - 1e-9)), 0) for far in (-float(ends.min()), float(ends.max()) - 1)
    )
    nearest = np.array([-before, positions - 1 + after]) / (positions - 1)
    if not (drive.image_distance(nearest) > 0).all():
        raise BadInput("axial colour moves the focus behind the lens", hint="give the lens less axial_colour")
    return before, after
