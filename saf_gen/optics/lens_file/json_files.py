"""Readers of the JSON files in which optiland and DeepLens keep their lenses; both state lengths in millimetres."""

import math
from collections.abc import Mapping
from typing import Any

from saf_gen.errors import BadInput
from saf_gen.optics.lens_file.glass import AIR, Glass, find_glass, model_glass
from saf_gen.optics.lens_file.prescription import Prescription, Surface

USUAL_WAVES_NM = (486.1327, 587.5618, 656.2725)  # the lines F, d and C, where a file names no light


class _Reader:
    """Values of a file by their keys, with one line for each that is missing or of another kind."""

    def __init__(self, where: str, kind: str) -> None:
        self.where, self.kind = where, kind

    def get(self, data: Any, *keys: str | int) -> Any:
        for key in keys:
            try:
                data = data[key]
            except (KeyError, IndexError, TypeError):
                path = ".".join(map(str, keys))
                raise BadInput(
                    f"{self.where} has no {path}",
                    allowed=f"a lens of {self.kind} with it",
                    hint="is the file complete?",
                ) from None
        return data

    def number(self, data: Any, *keys: str | int, finite: bool = True) -> float:
        value = self.get(data, *keys)
        good = isinstance(value, int | float) and not isinstance(value, bool) and not math.isnan(value)
        if not good or (finite and math.isinf(value)):
            raise BadInput(f"{self.where}: {'.'.join(map(str, keys))} is {str(value)[:40]}", allowed="a finite number")
        return float(value)

    def numbers(self, data: Any, *keys: str | int) -> list[float]:
        values = self.get(data, *keys)
        if not isinstance(values, list):
            raise BadInput(f"{self.where}: {keys[-1]} is {str(values)[:40]}", allowed="a list of numbers")
        return [self.number(values, n) for n in range(len(values))]


def read_deeplens(data: Any, *, where: str, glasses: Mapping[str, Glass], name: str) -> Prescription:
    """Return the lens of a DeepLens file; raise BadInput for surfaces other than spheres, aspheres, planes and stop."""
    reader, surfaces, stops = _Reader(where, "DeepLens"), [], []
    for n, one in enumerate(reader.get(data, "surfaces")):
        at = f"{where}: surface {n + 1}"
        kind = reader.get(one, "type")
        if kind in ("Stop", "Aperture"):
            stops.append(n)
        elif kind not in ("Spheric", "Aspheric", "Plane"):
            raise BadInput(f"{at} is of type {str(kind)[:40]}", allowed="Spheric, Aspheric, Plane, Aperture or Stop")
        flat = kind in ("Stop", "Aperture", "Plane")
        material = str(one.get("mat2", "air")) if isinstance(one, dict) else "air"
        surfaces.append(
            Surface(
                curvature=0.0 if flat else _curvature(reader, one),
                thickness_mm=reader.number(one, "d_next"),
                glass=AIR if material.lower() in ("air", "vacuum") else find_glass(material, glasses, where=at),
                conic=reader.number(one, "k") if kind == "Aspheric" else 0.0,
                powers=_powers(reader, one) if kind == "Aspheric" else (),
                semi_diameter_mm=reader.number(one, "r"),
            )
        )
    if len(stops) != 1:
        raise BadInput(f"{where}: {len(stops)} surfaces are the stop", allowed="one surface of type Stop or Aperture")
    return Prescription(
        name=" ".join(str(data.get("info", "")).split())[:120] or name,
        surfaces=tuple(surfaces),
        stop=stops[0],
        aperture=("stop", surfaces[stops[0]].semi_diameter_mm),  # DeepLens derives fnum from it
        field=("image", reader.number(data, "r_sensor")),
        waves_nm=USUAL_WAVES_NM,
        primary_nm=USUAL_WAVES_NM[1],
        notes=("the file names no wavelengths: taken are the lines F, d and C",),
    )


def _curvature(reader: _Reader, one: dict[str, Any]) -> float:
    if "roc" not in one:
        return reader.number(one, "c")
    radius = reader.number(one, "roc", finite=False)
    if radius == 0 or math.isinf(radius):
        return 0.0
    if "c" in one and abs(reader.number(one, "c") - 1 / radius) > 1e-4 * abs(1 / radius):
        raise BadInput(f"{reader.where}: c is {one['c']:g} and roc is {radius:g}", allowed="c = 1/roc")
    return 1 / radius


def _powers(reader: _Reader, one: dict[str, Any]) -> tuple[float, ...]:
    """Return the coefficients of r², r⁴, ...; they are named by their powers, because lists begin at either."""
    named = {int(key[2:]): reader.number(one, key) for key in one if key[:2] == "ai" and key[2:].isdigit()}
    if not named:
        if any(reader.numbers(one, "ai") if one.get("ai") else ()):
            raise BadInput(
                f"{reader.where}: coefficients are a list alone (ai)",
                allowed="ai2, ai4, ai6, ..., each named by its power of r",
                hint="save the lens with a DeepLens that names them",
            )
        return ()
    if odd := [power for power in named if power % 2 or power < 2]:
        raise BadInput(f"{reader.where} has the coefficient ai{odd[0]}", allowed="even powers from 2 on")
    return tuple(named.get(power, 0.0) for power in range(2, max(named) + 1, 2))


def read_optiland(data: Any, *, where: str, glasses: Mapping[str, Glass], name: str) -> Prescription:
    """Return the lens of an optiland file; raise BadInput for tilts, mirrors and shapes that are no even aspheres."""
    reader, notes = _Reader(where, "optiland"), []
    listed = reader.get(data, "surface_group", "surfaces")
    if not isinstance(listed, list) or len(listed) < 3:
        raise BadInput(f"{where} has fewer than 3 surfaces", allowed="an object, at least one surface and an image")
    places = [reader.number(one, "geometry", "cs", "z", finite=False) for one in listed]
    if math.isfinite(places[0]):
        notes.append("the file's object is at a finite distance: a card states its own distances")
    surfaces, stops = [], []
    for n, one in enumerate(listed[1:-1], start=1):
        if one.get("is_stop"):
            stops.append(n - 1)
        surfaces.append(_optiland_surface(reader, one, n=n, thickness_mm=places[n + 1] - places[n], glasses=glasses))
        if one.get("aperture"):
            notes.append(f"the aperture of surface {n} is not used: the stop alone bounds the light")
    if len(stops) != 1:
        raise BadInput(f"{where}: {len(stops)} surfaces are the stop", allowed="one surface with is_stop: true")
    waves, primary = [], None
    for one in reader.get(data, "wavelengths", "wavelengths"):
        unit = {"um": 1e3, "nm": 1.0, "mm": 1e6}.get(str(one.get("unit", "um")))
        if unit is None:
            raise BadInput(f"{where}: a wavelength is in {one['unit']!s}", allowed="um, nm, mm")
        waves.append(round(reader.number(one, "value") * unit, 6))
        primary = waves[-1] if one.get("is_primary") else primary
    if not waves:
        raise BadInput(f"{where} has no wavelengths", allowed="at least one")
    kind, value = reader.get(data, "aperture", "type"), reader.number(data, "aperture", "value")
    sizes = {"EPD": ("entrance", value), "imageFNO": ("f_number", value), "float_by_stop_size": ("stop", value / 2)}
    return Prescription(
        name=str(data.get("name") or name),
        surfaces=tuple(surfaces),
        stop=stops[0],
        aperture=sizes.get(str(kind), ("f_number", 0.0)),
        field=_optiland_field(reader, data),
        waves_nm=tuple(sorted(set(waves))),
        primary_nm=primary or waves[0],
        notes=tuple(notes),
    )


def _optiland_surface(
    reader: _Reader, one: dict[str, Any], *, n: int, thickness_mm: float, glasses: Mapping[str, Glass]
) -> Surface:
    at, geometry = f"{reader.where}: surface {n}", reader.get(one, "geometry")
    shape, place = reader.get(geometry, "type"), reader.get(geometry, "cs")
    if shape not in ("Plane", "StandardGeometry", "EvenAsphere"):
        raise BadInput(f"{at} is a {str(shape)[:40]}", allowed="Plane, StandardGeometry or EvenAsphere")
    if any(reader.number(place, key) for key in ("x", "y", "rx", "ry", "rz")) or place.get("reference_cs"):
        raise BadInput(f"{at} is shifted or tilted", allowed="a lens whose surfaces share one axis")
    model = one.get("interaction_model") or {}
    if model.get("is_reflective") or one.get("is_reflective"):
        raise BadInput(f"{at} is a mirror", allowed="surfaces that refract")
    if model.get("type", "RefractiveReflectiveModel") != "RefractiveReflectiveModel":
        raise BadInput(f"{at} is a {str(model['type'])[:40]}", allowed="surfaces that refract")
    radius = math.inf if shape == "Plane" else reader.number(geometry, "radius", finite=False)
    if radius == 0:
        raise BadInput(f"{at} has a radius of 0", allowed="a radius, or Infinity")
    return Surface(
        curvature=1 / radius,
        thickness_mm=thickness_mm,
        glass=_optiland_glass(reader, reader.get(one, "material_post"), at=at, glasses=glasses),
        conic=reader.number(geometry, "conic") if "conic" in geometry else 0.0,
        powers=tuple(reader.numbers(geometry, "coefficients")) if shape == "EvenAsphere" else (),
    )


def _optiland_glass(reader: _Reader, material: Any, *, at: str, glasses: Mapping[str, Glass]) -> Glass:
    kind = reader.get(material, "type")
    if kind == "IdealMaterial":
        index = material["index"]
        index = index[0] if isinstance(index, list) and len(index) == 1 else index
        index = reader.number({"index": index}, "index")
        return AIR if index == 1 else Glass(f"n = {index:g}", "constant", (index,))
    if kind == "AbbeMaterial":
        index, abbe = (_only(material.get(key)) for key in ("index", "abbe"))
        return model_glass(reader.number({"index": index}, "index"), reader.number({"abbe": abbe}, "abbe"))
    if kind == "Material":
        return find_glass(str(reader.get(material, "name")), glasses, where=at)
    raise BadInput(f"{at}: the material is a {str(kind)[:40]}", allowed="IdealMaterial, AbbeMaterial or Material")


def _only(value: Any) -> Any:
    return value[0] if isinstance(value, list) and len(value) == 1 else value


def _optiland_field(reader: _Reader, data: Any) -> tuple[str, float]:
    fields = reader.get(data, "fields")
    kind = fields.get("field_type") or (fields.get("field_definition") or {}).get("field_type")
    points = reader.get(fields, "fields")
    largest = max((math.hypot(reader.number(one, "x"), reader.number(one, "y")) for one in points), default=0.0)
    if kind in ("angle", "AngleField"):
        return "angle", largest
    if kind in ("paraxial_image_height", "real_image_height", "ParaxialImageHeightField", "RealImageHeightField"):
        return "image", largest
    return "angle", 0.0
