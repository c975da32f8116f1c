"""Files of fitted lenses (YAML), by name if saf_gen brings them and else by path: what ``lens fit`` writes."""

import shlex
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from saf_gen.core.config.document import FrozenModel, read_text, validate_document
from saf_gen.core.config.presets import is_preset_file
from saf_gen.core.config.yaml_document import parse_yaml
from saf_gen.errors import BadInput, unknown
from saf_gen.optics.fitted_rays import FittedRays, monomials
from saf_gen.optics.lens_file.fit import LensFit, Reach, relative_illumination
from saf_gen.optics.lens_file.prescription import Prescription
from saf_gen.optics.lens_file.pupils import Pupils

SHIPPED = Path(__file__).parents[1] / "lenses"
MARK = "# A lens fitted by saf-gen lens fit"
MAX_FILE_BYTES = 1 << 20
DIGITS = 10  # of a coefficient, of which the largest is about 1

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
    def fit(self) -> LensFit:
        """The fitted lens as values."""
        pupils = Pupils(
            self.focal_length_mm, self.entrance_pupil_mm, self.exit_pupil_mm, self.pupil_magnification, np.nan
        )
        reach = Reach(self.focal_length_mm / (2 * self.f_number), self.height_mm, 1e3 * self.nearest_m, self.waves_nm)
        order = (self.degree - 1) // 2
        numbers = np.array(self.starts), np.array(self.slopes)
        return LensFit(pupils, reach, self.primary_nm, order, *numbers, self.rms_um, self.worst_um)

    def rays_at(self, wave_nm: float | None = None) -> FittedRays:
        """Return the polynomials at one wavelength (nm), by default the primary one.

        They know how far they are from the rays of the lens. Raises BadInput outside the fitted wavelengths.
        """
        fit = self.fit
        return replace(fit.at(wave_nm or fit.primary_nm), residual_m=self.worst_um * 1e-6)


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


def fitted_lens(lens: Prescription, fit: LensFit, *, source: str, options: str = "") -> FittedLens:
    """Return the file of a fit; ``source`` names the lens file, and ``options`` are those of the command."""
    return FittedLens(
        name=lens.name,
        source=source,
        made_with=" ".join(f"saf-gen lens fit {shlex.quote(source)} {options}".split()),
        notes=lens.notes,
        focal_length_mm=fit.pupils.focal_length_mm,
        pupil_magnification=fit.pupils.magnification,
        entrance_pupil_mm=fit.pupils.entrance_mm,
        exit_pupil_mm=fit.pupils.exit_mm,
        f_number=fit.pupils.focal_length_mm / (2 * fit.reach.radius_mm),
        height_mm=fit.reach.height_mm,
        nearest_m=fit.reach.nearest_mm / 1e3,
        waves_nm=fit.reach.waves_nm,
        primary_nm=fit.primary_nm,
        rms_um=fit.rms_um,
        worst_um=fit.worst_um,
        relative_illumination=relative_illumination(lens, fit),
        degree=2 * fit.order + 1,
        starts=tuple(tuple(map(float, row)) for row in fit.starts),
        slopes=tuple(tuple(map(float, row)) for row in fit.slopes),
    )


def fitted_text(lens: FittedLens) -> str:
    """Return the text of the file of a fitted lens."""
    lines = [f"{MARK}: {lens.made_with}"]
    for key, value in lens.model_dump().items():
        if key in ("starts", "slopes"):
            rows = [", ".join(f"{number:.{DIGITS}g}" for number in row) for row in value]
            lines += [f"{key}:", *(f"- [{row}]" for row in rows)]
        elif key == "relative_illumination":
            lines.append(f"{key}: [{', '.join(f'[{h:.4g}, {part:.4g}]' for h, part in value)}]")
        elif isinstance(value, tuple):
            lines.append(f"{key}: [{', '.join(map(_plain, value))}]")
        else:
            lines.append(f"{key}: {_plain(value)}")
    return "\n".join(lines) + "\n"


def _plain(value: object) -> str:
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    return f"{value:.9g}" if isinstance(value, float) else str(value)


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
