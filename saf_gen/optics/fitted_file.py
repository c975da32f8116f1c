"""Files of fitted lenses (YAML), by name if saf_gen brings them and else by path: what ``lens fit`` writes."""

from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from saf_gen.core.config.document import FrozenModel, read_text, validate_document
from saf_gen.core.config.presets import is_preset_file
from saf_gen.core.config.yaml_document import parse_yaml
from saf_gen.errors import BadInput, unknown
from saf_gen.optics.fitted_rays import FittedRays, monomials

SHIPPED = Path(__file__).parent / "lenses"
MAX_FILE_BYTES = 1 << 20

Positive = Annotated[float, Field(gt=0)]


class FittedLens(FrozenModel):
    """A lens as polynomials, with what they are worth and how to make them again."""

    name: str
    """What the lens is."""
    source: str
    """File that was fitted."""
    made_with: str
    """Command that fits it again."""
    notes: tuple[str, ...] = ()
    """What the file says and the polynomials leave out."""
    focal_length_mm: Positive
    """Focal length at the primary wavelength, mm."""
    pupil_magnification: Positive
    """Exit pupil divided by entrance pupil."""
    entrance_pupil_mm: float
    """Place of the entrance pupil behind the first vertex, mm: depths of a scene are measured from it."""
    exit_pupil_mm: float
    """Place of the exit pupil behind the last vertex, mm."""
    f_number: Positive
    """Smallest f-number for which the polynomials hold."""
    height_mm: Positive
    """Distance from the middle of the sensor up to which they hold, mm."""
    nearest_m: Positive
    """Nearest object in focus for which they hold, m from the entrance pupil."""
    waves_nm: tuple[Positive, Positive]
    """Shortest and longest wavelength for which they hold, nm."""
    primary_nm: Positive
    """Wavelength at which focal length and pupils are given, nm."""
    rms_um: Annotated[float, Field(ge=0)]
    """Root of the mean squared distance between fitted and traced rays on the sensor, µm."""
    worst_um: Annotated[float, Field(ge=0)]
    """Largest such distance, µm."""
    relative_illumination: tuple[tuple[float, float], ...] = ()
    """Image height (mm) and light there relative to the middle, with the edges of the lens: told, not used."""
    degree: int = Field(ge=3, le=13)
    """Degree of the polynomials."""
    starts: tuple[tuple[float, ...], ...]
    """Coefficients of the starting point, a list for each power of (primary wavelength/wavelength)² - 1."""
    slopes: tuple[tuple[float, ...], ...]
    """Coefficients of the slope."""

    @model_validator(mode="after")
    def _counts(self) -> "FittedLens":
        size = 2 * len(monomials((self.degree - 1) // 2))
        for name in ("starts", "slopes"):
            lists = getattr(self, name)
            if not lists or any(len(one) != size for one in lists) or len(lists) != len(self.starts):
                raise ValueError(f"{name} with lists of {size} numbers, as degree {self.degree} has")
        if self.waves_nm[0] > self.waves_nm[1]:
            raise ValueError("waves_nm from the shortest to the longest")
        return self

    @property
    def radius_mm(self) -> float:
        """Radius of the entrance pupil within which the polynomials hold, mm."""
        return self.focal_length_mm / (2 * self.f_number)

    def image_distance_mm(self, object_mm: float) -> float:
        """Return V, mm, that brings objects at this distance (mm) from the entrance pupil into focus."""
        return 1 / (1 / self.focal_length_mm - 1 / (self.pupil_magnification * object_mm))

    @property
    def largest_slope(self) -> float:
        """The largest slope behind the lens less a/f for which the polynomials hold: their scale."""
        far, near = self.focal_length_mm, self.image_distance_mm(1e3 * self.nearest_m)
        return self.height_mm / (self.pupil_magnification * far) + self.radius_mm * (1 / far - 1 / near)

    def rays_at(self, wave_nm: float | None = None) -> FittedRays:
        """Return the polynomials at one wavelength (nm), by default the primary one.

        They know how far they are from the rays of the lens. Raises BadInput outside the fitted wavelengths.
        """
        wave_nm, (low, high) = wave_nm or self.primary_nm, self.waves_nm
        if not low - 1e-6 <= wave_nm <= high + 1e-6:
            raise BadInput(f"the lens is fitted for other light than {wave_nm:g} nm", allowed=f"{low:g} to {high:g} nm")
        colour = ((self.primary_nm / wave_nm) ** 2 - 1) ** np.arange(len(self.starts))
        return FittedRays(
            focal_length_m=self.focal_length_mm / 1e3,
            pupil_magnification=self.pupil_magnification,
            radius_m=self.radius_mm / 1e3,
            height_m=self.height_mm / 1e3,
            slope=self.largest_slope,
            order=(self.degree - 1) // 2,
            starts=tuple(map(float, colour @ np.array(self.starts))),
            slopes=tuple(map(float, colour @ np.array(self.slopes))),
            residual_m=self.worst_um * 1e-6,
        )


def shipped_lenses() -> list[str]:
    """Return the names of the lenses that come with saf_gen, sorted."""
    return sorted(path.stem for path in SHIPPED.glob("*.yaml"))


def shipped_text(name: str) -> str:
    """Return the text of the file of a lens that comes with saf_gen; empty for any other name."""
    return read_text(SHIPPED / f"{name}.yaml") if name in shipped_lenses() else ""


def read_lens(name: str | Path, *, folder: Path | None = None) -> FittedLens:
    """Return the fitted lens of this name, or in this file.

    Parameters
    ----------
    name : str or Path
        Name of a lens that comes with saf_gen, or the path of a file (.yaml) that ``lens fit`` wrote.
    folder : Path, optional
        Folder from which the path counts.

    Raises
    ------
    BadInput
        If there is no such lens, or the file is none of a fitted lens.
    """
    if is_preset_file(name):
        path = (folder or Path()) / name
    elif str(name) in (names := shipped_lenses()):
        path = SHIPPED / f"{name}.yaml"
    else:
        raise unknown("lens", str(name), allowed=names, hint="or give the .yaml file that saf-gen lens fit wrote")
    document = parse_yaml(read_text(path, max_bytes=MAX_FILE_BYTES), path)
    return validate_document(FittedLens, document)


def check_reach(lens: FittedLens, *, f_number: float, focus_range_m: tuple[float, float]) -> None:
    """Raise BadInput if a card asks for more of a lens than was fitted."""
    if f_number < lens.f_number * (1 - 1e-9):
        raise BadInput(
            f"f_number is {f_number:g}",
            allowed=f"{lens.f_number:.4g} or more, for which {lens.name} is fitted",
            hint="saf-gen lens fit --f-number fits it for a wider aperture",
        )
    if min(focus_range_m) < lens.nearest_m * (1 - 1e-9):
        raise BadInput(
            f"focus_range_m reaches {min(focus_range_m):g} m",
            allowed=f"{lens.nearest_m:.4g} m or more, for which {lens.name} is fitted",
            hint="saf-gen lens fit --nearest-m fits it for nearer objects",
        )
