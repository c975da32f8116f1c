"""Refuses what no lamp emits and no surface reflects: values that are not finite, negative light, colours above 1.

Mitsuba computes with them, and a picture with a black square or a lamp that takes light away looks like any other.
"""

from collections.abc import Iterator, Mapping
from itertools import chain
from typing import Any

import mitsuba as mi
import numpy as np

from saf_gen.errors import BadInput
from saf_gen.render.backend import read_picture
from saf_gen.render.meshes import black_triangles
from saf_gen.scene.xml import NOT_RENDERED

LIGHT = frozenset({"radiance", "irradiance", "intensity"})
REFLECTANCE = frozenset({"reflectance", "base_color", "diffuse_reflectance", "specular_reflectance"})
FLOATS = (".exr", ".hdr", ".pfm")
"""Endings of pictures that can have any value; those of others are 0 to 1."""
ROUNDING, HUE = 1e-3, 0.01
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def check_values(described: Mapping[str, Any], *, where: str) -> None:
    """Raise BadInput if a lamp, surface or picture of a scene has a value that none can have.

    ``described`` is a Mitsuba dictionary, and ``where`` its file, for messages.
    """
    for path, value in _walk(described):
        plugin = value.get("type") if isinstance(value, dict) else None
        if plugin in NOT_RENDERED:
            raise BadInput(f"{_named(path)}: {plugin} is not rendered", where=where, allowed=NOT_RENDERED[plugin])
        if plugin == "normalmap" and any(_coded(inner) for inner in value.values()):
            raise BadInput(
                f"{_named(path)}: the normal map is decoded as sRGB, so all its angles are wrong",
                where=where,
                hint='write raw: in XML, <boolean name="raw" value="true"/> in its bitmap',
            )
        if plugin == "envmap":
            _check(np.array(value.get("scale", 1.0)), f"scale of {_named(path)}", role="light", where=where)
        what, numbers = _numbers(value, path)
        if numbers is not None:
            _check(numbers, what, role=_role(path), where=where)


def check_meshes(scene: Any, described: Mapping[str, Any], *, where: str) -> None:
    """Raise BadInput if a mesh of a loaded scene has normals without length, or colours that no surface has.

    Of colours, those count that a surface or lamp of ``described`` takes from its mesh.
    """
    roles: dict[str, str] = {}
    for path, value in _walk(described):
        if isinstance(value, dict) and value.get("type") == "mesh_attribute":
            roles[value.get("name", "")] = _role(path)
    for shape in (shape for shape in scene.shapes() if shape.is_mesh()):
        values = mi.traverse(shape)
        name = f"mesh {shape.id()!r}"
        for attribute, role in roles.items():
            if attribute in values:
                _check(np.array(values[attribute]), f"{attribute} of {name}", role=role, where=where)
        if count := black_triangles(values):
            raise BadInput(
                f"{name}: the normals of {count:,} triangles have no length, so they are black",
                where=where,
                hint="export it without normals",
            )


def worst_hue(described: Mapping[str, Any]) -> str:
    """Return a line about the lamp and the surface whose product of luminances is farthest from that of colours, or ''.

    Colours of numbers and the mean colours of pictures count, if a hundredth of white light is at stake.
    """
    colours: dict[str, list[tuple[str, np.ndarray]]] = {"light": [], "reflectance": []}
    for path, value in _walk(described):
        if role := _role(path):
            values = _mean_colour(value)
            if values is not None and values.max() > 0 and np.ptp(values) > HUE * values.max():
                colours[role].append((path[0], values))
    worst, line = HUE, ""
    for lamp, light in colours["light"]:
        for surface, reflectance in colours["reflectance"]:
            here, truth = LUMINANCE @ reflectance, LUMINANCE @ (light * reflectance) / (LUMINANCE @ light)
            if abs(here - truth) > worst:
                worst = abs(here - truth)
                line = (
                    f"colour: the lamp {lamp!r} and the surface {surface!r} both have a hue, which the sensor does not "
                    f"see: the surface reflects {here:.0%} of this light in place of {truth:.0%}, the largest "
                    "error of one reflection (make one of them grey if that matters)"
                )
    return line


def _mean_colour(value: Any) -> np.ndarray | None:
    """Return the linear red, green and blue of a colour, or of a picture in its mean."""
    if isinstance(value, dict):
        file = value.get("filename")
        if value.get("type") != "bitmap" or not isinstance(file, str):
            return None
        picture = read_picture(str(mi.file_resolver().resolve(file)))  # type: ignore[operator]
        if value.get("raw"):
            picture.set_srgb_gamma(False)
        linear = picture.convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, False)
        return np.array(linear).reshape(-1, 3).mean(axis=0, dtype=np.float64)
    if len(getattr(value, "wavelengths", ())):
        return np.array(mi.spectrum_list_to_srgb(list(value.wavelengths), list(value.values), bounded=False, d65=True))
    try:
        values = np.array(value, dtype=np.float64).ravel()
    except (TypeError, ValueError, RuntimeError):
        return None
    return values if values.shape == (3,) else None


def _walk(entry: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Yield everything in a dictionary of dictionaries, with its path of keys."""
    yield path, entry
    if isinstance(entry, Mapping):
        yield from chain.from_iterable(_walk(value, (*path, str(key))) for key, value in entry.items())


def _named(path: tuple[str, ...]) -> str:
    inner = [key for key in reversed(path[1:]) if not key.startswith("part_")]
    return " of ".join([*inner, repr(path[0])]) if path else "the scene"


def _role(path: tuple[str, ...]) -> str:
    """Return 'light', 'reflectance' or '' for a place in a scene."""
    for key in reversed(path):
        if key in LIGHT:
            return "light"
        if key in REFLECTANCE:
            return "reflectance"
    return ""


def _coded(entry: Any) -> bool:
    plugin = entry.get("type") if isinstance(entry, dict) else ""
    return plugin == "bitmap" and not entry.get("raw", False) and "data" not in entry


def _numbers(value: Any, path: tuple[str, ...]) -> tuple[str, np.ndarray | None]:
    """Return the name and the numbers of a picture, or of a colour, number or spectrum that has a role."""
    if isinstance(value, dict):
        if value.get("type") not in ("bitmap", "envmap"):
            return "", None
        file, picture = value.get("filename"), value.get("bitmap", value.get("data"))
        if isinstance(file, str) and file.lower().endswith(FLOATS):
            picture = read_picture(str(mi.file_resolver().resolve(file)))  # type: ignore[operator]
            return f"{_named(path)}, the picture {file.rpartition('/')[2]!r},", np.array(picture)
        values = None if picture is None else np.array(picture)
        return f"the picture of {_named(path)}", values if values is not None and values.dtype.kind == "f" else None
    if not _role(path):
        return "", None
    try:
        return _named(path), np.array(value.values if hasattr(value, "wavelengths") else value, dtype=np.float64)
    except (TypeError, ValueError, RuntimeError):  # text, an object of Mitsuba, a reference
        return "", None


def _check(numbers: np.ndarray, what: str, *, role: str, where: str) -> None:
    finite = np.isfinite(numbers)
    wrong = ~finite
    if role:
        wrong |= numbers < 0
    if role == "reflectance":
        wrong |= numbers > 1 + ROUNDING
    if wrong.any():
        allowed = {"light": "0 or more", "reflectance": "0 to 1", "": "finite numbers"}[role]
        count = f" in {int(wrong.sum()):,} of {wrong.size:,} values" if wrong.size > 4 else ""
        raise BadInput(f"{what} is {numbers[wrong].ravel()[0]:g}{count}", where=where, allowed=allowed)
