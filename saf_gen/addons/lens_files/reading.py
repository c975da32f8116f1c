"""Reading the surfaces of a lens: a file of Zemax (.zmx), or a table of surfaces (.yaml)."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from saf_gen.addons.lens_files.glass import AIR, Glass, find_glass, model_glass, read_agf
from saf_gen.addons.lens_files.prescription import Prescription, Surface, check_prescription
from saf_gen.addons.lens_files.pupils import find_pupils
from saf_gen.addons.lens_files.zemax import read_zemax
from saf_gen.core.config.document import FrozenModel, check_plain_file, validate_document
from saf_gen.core.config.presets import is_preset_file
from saf_gen.core.config.yaml_document import parse_yaml
from saf_gen.errors import BadInput

MAX_LENS_BYTES, MAX_AGF_BYTES = 4 << 20, 16 << 20
CLOSE = 0.01  # of what a file states: rays that have it otherwise by more are told
KINDS = "a sequential lens of Zemax (.zmx), or a table of surfaces (.yaml)"


class Row(FrozenModel):
    """A surface of a table."""

    radius_mm: float | Literal["flat"]
    """Radius of curvature at the vertex, mm; above 0 if its centre is on the side of the sensor."""
    thickness_mm: float
    """Distance to the next surface, mm; that of the last surface is not used."""
    glass: str | tuple[float, float] = ""
    """Glass behind it: a name of the catalogue, or [index, Abbe number]; by default air."""
    conic: float = 0.0
    """Conic constant."""
    powers: tuple[float, ...] = ()
    """Coefficients of r², r⁴, ..., mm⁻¹, mm⁻³, ..."""
    semi_diameter_mm: float | None = Field(default=None, gt=0)
    """Radius of its clear part, mm, for the relative illumination; at the stop, also to be compared with f_number."""
    stop: bool = False
    """Whether the stop is at its vertex."""


class LensTable(FrozenModel):
    """A table of surfaces, from the scene to the sensor."""

    name: str
    """What the lens is."""
    f_number: Annotated[float, Field(gt=0)]
    """Smallest f-number."""
    height_mm: Annotated[float, Field(gt=0)]
    """Distance of the picture's corner from its middle, mm."""
    waves_nm: tuple[float, float]
    """Shortest and longest wavelength, nm."""
    primary_nm: float
    """Wavelength at which the lens is described, nm."""
    focal_length_mm: float | None = Field(default=None, gt=0)
    """Focal length that its source states, mm, to be compared with that of the rays."""
    surfaces: tuple[Row, ...]
    """Its surfaces."""


def read_prescription(
    path: Path,
    *,
    glasses: Mapping[str, Glass] | None = None,
    f_number: float | None = None,
    height_mm: float | None = None,
) -> Prescription:
    """Return the lens in a file.

    Parameters
    ----------
    path : Path
        A .zmx file, or a table of surfaces (.yaml).
    glasses : mapping of str to Glass, optional
        Further glasses by their names in capitals, which come before those of the catalogue.
    f_number, height_mm : float, optional
        Aperture and largest image height (mm), in place of those of the file.

    Returns
    -------
    Prescription
        The lens; its notes say where its rays contradict a stated focal length or f-number by over 1 %.

    Raises
    ------
    BadInput
        If the file is neither, is larger than 4 MiB, or holds what rays cannot be traced through.
    """
    where, focal_length_mm = str(path), None
    if is_preset_file(path):
        lens, focal_length_mm = _read_table(_read(path, MAX_LENS_BYTES), path, glasses=glasses or {})
    elif path.suffix.lower() == ".zmx":
        lens = read_zemax(_read(path, MAX_LENS_BYTES), where=where, glasses=glasses or {}, name=path.stem)
    else:
        raise BadInput(f"{where} is no lens file", allowed=KINDS)
    if f_number is not None:
        lens = replace(lens, aperture=("f_number", f_number))
    elif lens.aperture[1] == 0:
        raise BadInput(
            f"{where} does not say how wide its aperture is",
            allowed="the diameter of the entrance pupil, the f-number of the picture, or the size of the stop",
            hint="give it: --f-number N",
        )
    if height_mm is not None:
        lens = replace(lens, field=("image", height_mm))
    elif lens.field[1] == 0:
        raise BadInput(
            f"{where} does not say how far its picture reaches",
            allowed="a field off the axis, as an angle or an image height (FTYP 0, 2 or 3)",
            hint="give it: --height-mm MM",
        )
    check_prescription(lens, where=where)
    contradictions = _contradictions(lens, focal_length_mm, own_aperture=f_number is None)
    return replace(lens, notes=(*lens.notes, *contradictions))


def _contradictions(lens: Prescription, focal_length_mm: float | None, *, own_aperture: bool) -> Iterator[str]:
    """Yield a line for the focal length and the f-number that a file states and its rays do not have."""
    pupils = find_pupils(lens, lens.primary_nm)
    f, stop_mm = pupils.focal_length_mm, lens.surfaces[lens.stop].semi_diameter_mm
    if focal_length_mm and abs(f / focal_length_mm - 1) > CLOSE:
        yield f"the file states a focal length of {focal_length_mm:g} mm, its rays have {f:.4g} mm: a typing error?"
    if own_aperture and math.isfinite(stop_mm):
        stated, passed = (
            f / (2 * pupils.entrance_radius_mm(aperture)) for aperture in (lens.aperture, ("stop", stop_mm))
        )
        if abs(passed / stated - 1) > CLOSE:
            apart = f"the file states f/{stated:.3g}, a stop of {stop_mm:g} mm radius passes f/{passed:.3g}"
            yield f"{apart}: f/{stated:.3g} counts"


def _read_table(text: str, path: Path, *, glasses: Mapping[str, Glass]) -> tuple[Prescription, float | None]:
    """Return the lens of a table, and the focal length (mm) that it states."""
    table = validate_document(LensTable, parse_yaml(text, path))
    stops = [n for n, row in enumerate(table.surfaces) if row.stop]
    if len(stops) != 1:
        raise BadInput(f"{path}: {len(stops)} surfaces are the stop", allowed="one surface with stop: true")
    surfaces = []
    for n, row in enumerate(table.surfaces, start=1):
        if row.radius_mm == 0:
            raise BadInput(f"{path}: surface {n} has a radius of 0", allowed="a radius in mm, or flat")
        if isinstance(row.glass, tuple):
            glass = model_glass(*row.glass)
        else:
            glass = find_glass(row.glass, glasses, where=f"{path}: surface {n}") if row.glass else AIR
        surfaces.append(
            Surface(
                curvature=0.0 if row.radius_mm == "flat" else 1 / row.radius_mm,
                thickness_mm=row.thickness_mm,
                glass=glass,
                conic=row.conic,
                powers=row.powers,
                semi_diameter_mm=row.semi_diameter_mm or math.inf,
            )
        )
    lens = Prescription(
        name=table.name,
        surfaces=tuple(surfaces),
        stop=stops[0],
        aperture=("f_number", table.f_number),
        field=("image", table.height_mm),
        waves_nm=table.waves_nm,
        primary_nm=table.primary_nm,
    )
    return lens, table.focal_length_mm


def _read(path: Path, most: int) -> str:
    try:
        check_plain_file(path, max_bytes=most)
        content = path.read_bytes()
    except OSError as error:
        raise BadInput(f"{path} cannot be read: {error.strerror or error}") from error
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        encoding = "utf-16"
    elif content[:3] == b"\xef\xbb\xbf":
        encoding = "utf-8-sig"
    else:
        encoding = "utf-8"
    try:
        return content.decode(encoding)
    except UnicodeDecodeError:
        return content.decode("latin-1")  # older files of Zemax: names and notes alone have such letters


def read_glasses(stated: Sequence[str], catalogues: Sequence[Path]) -> dict[str, Glass]:
    """Return further glasses by their names in capitals: stated as NAME=INDEX/ABBE, and in catalogues (.agf)."""
    found: dict[str, Glass] = {}
    for path in catalogues:
        found |= read_agf(_read(path, MAX_AGF_BYTES), where=str(path))
    for one in stated:
        name, _, numbers = one.partition("=")
        index, _, abbe = numbers.partition("/")
        try:
            values = float(index), float(abbe)
        except ValueError:
            raise BadInput(f"--glass is {one!r}", allowed="NAME=INDEX/ABBE, such as --glass BAF7=1.608/46.2") from None
        found[name.strip().upper()] = model_glass(*values, name=name.strip())
    return found
