"""Reader of Zemax lens files (.zmx): lenses of rotation in sequence. A record that is not listed here is refused.

A file is a list of records, each a word and its values. Those of the system stand at the beginning of a line, those of
the surface that the last ``SURF`` began are indented. Surface 0 is the object, the last one the image.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from saf_gen.addons.lens_files.glass import AIR, Glass, find_glass, model_glass
from saf_gen.addons.lens_files.prescription import Prescription, Surface
from saf_gen.errors import BadInput

UNITS_MM = {"MM": 1.0, "CM": 10.0, "IN": 25.4, "METER": 1000.0}
BLANK_GLASS = "___BLANK"
SHAPES = ("STANDARD", "EVENASPH")
POWERS = 8
FIELDS = {0: "angle", 2: "image", 3: "image"}
MOST = 1000  # fields, wavelengths and coefficients that a file counts
SYSTEM = (
    *("MODE", "NAME", "UNIT", "ENPD", "FNUM", "FLOA", "OBNA", "FTYP", "XFLN", "YFLN", "PWAV", "WAVM"),  # read here
    # Versions, notes, coatings, colours of the drawing, ways of search, polarisation, and weights of fields:
    *("VERS", "NOTE", "PFIL", "LANG", "ENVD", "GFAC", "GCAT", "RAIM", "PUSH", "SDMA", "OMMA", "ROPD", "HYPR", "PICB"),
    *("FWGN", "VDXN", "VDYN", "VCXN", "VCYN", "VANN", "POLS", "GLRS", "GSTD", "NSCD", "COFN", "AUTH", "DBDT", "RCMF"),
)
SURFACE = (
    *("TYPE", "CURV", "DISZ", "GLAS", "CONI", "PARM", "DIAM", "STOP"),  # read here
    # Comments, coatings, drawing, and solves and pickups, of which the file states the results:
    *("COMM", "COAT", "FIMP", "HIDE", "MIRR", "SLAB", "POPS", "MEMA", "OEMA", "MAZH", "PZUP", "PPAR", "VDSZ", "VPAR"),
    *("CLAP", "FLAP"),  # told
)


@dataclass
class _Lines:
    """What the lines of a file say, with the place of each for messages."""

    where: str
    system: dict[str, list[str]] = field(default_factory=dict)
    waves: dict[int, float] = field(default_factory=dict)
    surfaces: list[dict[str, list[str]]] = field(default_factory=list)
    parameters: list[dict[int, float]] = field(default_factory=list)


def read_zemax(text: str, *, where: str, glasses: Mapping[str, Glass], name: str) -> Prescription:
    """Return the lens in the text of a .zmx file.

    Raises
    ------
    BadInput
        If it is damaged, has an unknown record, or is no lens of rotation in sequence: mirrors, tilts, other surfaces
        than spheres, conics and even aspheres, a glass of unknown name, several configurations.
    """
    lines = _split(text, where)
    mode = lines.system.get("MODE", ["SEQ"])[0]
    if mode != "SEQ":
        raise BadInput(f"{where} is of mode {mode}", allowed="a sequential lens (MODE SEQ)")
    unit = lines.system.get("UNIT", ["MM"])[0].upper()
    if unit not in UNITS_MM:
        raise BadInput(f"{where} is in units of {unit}", allowed=", ".join(UNITS_MM))
    if len(lines.surfaces) < 3:
        raise BadInput(
            f"{where} has {len(lines.surfaces)} surfaces",
            allowed="an object, at least one surface and an image",
            hint="is the file complete?",
        )
    _check_image(lines)
    mm, notes = UNITS_MM[unit], []
    middle = list(enumerate(lines.surfaces))[1:-1]
    surfaces = [_surface(lines, n, mm=mm, glasses=glasses) for n, _ in middle]
    stops = [n - 1 for n, found in middle if "STOP" in found]
    if len(stops) != 1:
        raise BadInput(
            f"{where}: {len(stops)} surfaces are the stop", allowed="one surface with STOP between object and image"
        )
    if cut := [n for n, found in middle if {"CLAP", "FLAP"} & set(found)]:
        notes.append(f"apertures of surfaces {', '.join(map(str, cut))} are not used: the stop alone bounds the light")
    object_mm = _thickness(lines, 0)
    if math.isfinite(object_mm):
        notes.append(
            f"the file's object is {object_mm * mm:g} mm in front of the lens: a card states its own distances"
        )
    waves, primary = _waves(lines)
    return Prescription(
        name=" ".join(lines.system.get("NAME", [])) or name,
        surfaces=tuple(surfaces),
        stop=stops[0],
        aperture=_aperture(lines, mm, stop_mm=surfaces[stops[0]].semi_diameter_mm),
        field=_field(lines, mm),
        waves_nm=waves,
        primary_nm=primary,
        notes=tuple(notes),
    )


def _check_image(lines: _Lines) -> None:
    """Raise BadInput if the last surface is no flat image in air: the file is cut, or its sensor is curved."""
    last = lines.surfaces[-1]
    if "GLAS" in last or not {"CURV", "DISZ"} <= set(last) or _thickness(lines, -1) or _number(lines, last["CURV"]):
        raise BadInput(
            f"{lines.where}: the last surface, {len(lines.surfaces) - 1}, is no image",
            allowed="a last surface with CURV 0 and DISZ 0, and without a glass",
            hint="is the file complete?",
        )


def _split(text: str, where: str) -> _Lines:
    lines = _Lines(where)
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.split()
        if not words:
            continue
        word, values, inside = words[0], words[1:], line[:1].isspace() and bool(lines.surfaces)
        if word == "SURF":
            lines.surfaces.append({})
            lines.parameters.append({})
        elif word == "MNUM":
            if _number(lines, values) > 1:
                raise BadInput(f"{where} has {values[0]} configurations", allowed="one: save it without the others")
        elif lines.surfaces and not inside and word not in (*SYSTEM, *SURFACE):
            continue  # tolerances and merit function, which stand behind the surfaces
        elif word not in (SURFACE if inside else SYSTEM):
            raise BadInput(
                f"the record {word[:20]!r} is not known here",
                where=f"{where}:{number}",
                allowed=", ".join(SURFACE if inside else SYSTEM),
                hint="if it changes no ray, delete its line from a copy",
            )
        elif word == "WAVM":
            lines.waves[_whole(lines, values)] = _number(lines, values, at=1)
        elif word == "PARM":
            lines.parameters[-1][_whole(lines, values)] = _number(lines, values, at=1)
        else:
            (lines.surfaces[-1] if inside else lines.system)[word] = values
    return lines


def _number(lines: _Lines, values: list[str], *, at: int = 0) -> float:
    try:
        number = math.inf if values[at].upper() == "INFINITY" else float(values[at])
    except (ValueError, IndexError):
        raise BadInput(
            f"{lines.where} is damaged: {' '.join(values)[:40]!r} where a number is due", allowed="a lens file (.zmx)"
        ) from None
    if math.isnan(number):
        raise BadInput(f"{lines.where}: a number is NaN", allowed="finite numbers, or INFINITY for a distance")
    return number


def _whole(lines: _Lines, values: list[str], *, at: int = 0) -> int:
    number = _number(lines, values, at=at)
    if not 0 <= number <= MOST or number % 1:
        raise BadInput(
            f"{lines.where} is damaged: {number:g} where a count or the number of something is due",
            allowed=f"a whole number from 0 to {MOST}",
        )
    return int(number)


def _thickness(lines: _Lines, n: int) -> float:
    return _number(lines, lines.surfaces[n].get("DISZ", ["0"]))


def _surface(lines: _Lines, n: int, *, mm: float, glasses: Mapping[str, Glass]) -> Surface:
    found, at = lines.surfaces[n], f"{lines.where}: surface {n}"
    shape = (found.get("TYPE") or ["STANDARD"])[0]
    if shape not in SHAPES:
        raise BadInput(f"{at} is of type {shape}", allowed="STANDARD (spheres and conics) or EVENASPH, on one axis")
    if "CURV" not in found:
        raise BadInput(f"{at} has no CURV", allowed="a curvature for each surface", hint="is the file complete?")
    parameters = lines.parameters[n] if shape == "EVENASPH" else {}
    if beyond := [k for k, value in parameters.items() if value and not 1 <= k <= POWERS]:
        raise BadInput(
            f"{at} has the coefficient {beyond[0]}", allowed=f"coefficients 1 to {POWERS} of an even asphere"
        )
    coefficients = [parameters.get(k, 0.0) * mm ** (1 - 2 * k) for k in range(1, POWERS + 1)]
    while coefficients and not coefficients[-1]:
        coefficients.pop()
    diameter = _number(lines, found["DIAM"]) * mm if "DIAM" in found else math.inf
    return Surface(
        curvature=_number(lines, found["CURV"]) / mm,
        thickness_mm=_thickness(lines, n) * mm,
        glass=_glass(lines, found, at=at, glasses=glasses),
        conic=_number(lines, found.get("CONI", ["0"])),
        powers=tuple(coefficients),
        semi_diameter_mm=diameter if diameter else math.inf,
    )


def _glass(lines: _Lines, found: dict[str, list[str]], *, at: str, glasses: Mapping[str, Glass]) -> Glass:
    values = found.get("GLAS")
    if not values:
        return AIR
    if values[0].upper() == "MIRROR":
        raise BadInput(f"{at} is a mirror", allowed="surfaces that refract")
    if values[0].upper() != BLANK_GLASS:
        return find_glass(values[0], glasses, where=at)
    return model_glass(_number(lines, values, at=3), _number(lines, values, at=4))


def _count(lines: _Lines, at: int, *, what: str) -> int:
    """Return a number of FTYP: how many fields or wavelengths there are; newer files list further ones, not in use."""
    values = lines.system.get("FTYP", [])
    if len(values) <= at:
        raise BadInput(f"{lines.where} does not say how many {what} it has", allowed="FTYP with at least four numbers")
    return _whole(lines, values, at=at)


def _waves(lines: _Lines) -> tuple[tuple[float, ...], float]:
    numbers = range(1, _count(lines, 3, what="wavelengths") + 1)
    if missing := [n for n in numbers if n not in lines.waves] or ([] if numbers else [1]):
        raise BadInput(f"{lines.where} has no wavelength {missing[0]}", allowed="WAVM for each that FTYP counts")
    primary = _whole(lines, lines.system.get("PWAV", ["1"]))
    if primary not in numbers:
        raise BadInput(f"{lines.where}: the primary wavelength is number {primary}", allowed=f"1 to {len(numbers)}")
    return tuple(sorted({round(1e3 * lines.waves[n], 6) for n in numbers})), round(1e3 * lines.waves[primary], 6)


def _aperture(lines: _Lines, mm: float, *, stop_mm: float) -> tuple[str, float]:
    system = lines.system
    if "ENPD" in system:
        return "entrance", _number(lines, system["ENPD"]) * mm
    if "FNUM" in system:
        working = "1" in system["FNUM"][1:2] and math.isfinite(_thickness(lines, 0))  # depends on the object's distance
        return "f_number", 0.0 if working else _number(lines, system["FNUM"])
    if "FLOA" in system and math.isfinite(stop_mm):
        return "stop", stop_mm
    return "f_number", 0.0  # the file does not say


def _field(lines: _Lines, mm: float) -> tuple[str, float]:
    kind, count = _count(lines, 0, what="kinds of field"), _count(lines, 2, what="fields")
    listed = [lines.system.get(word, ["0"] * count) for word in ("XFLN", "YFLN")]
    x, y = ([_number(lines, values, at=n) for n in range(count)] for values in listed)
    largest = max(map(math.hypot, x, y), default=0.0)
    if kind not in FIELDS or not largest:
        return "angle", 0.0  # the file does not say: heights of objects mean nothing without their distance
    return ("angle", largest) if FIELDS[kind] == "angle" else ("image", largest * mm)
