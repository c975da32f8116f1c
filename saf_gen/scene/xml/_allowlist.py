"""What an XML scene may hold: elements, plug-ins and files that can do no harm."""

import posixpath
from pathlib import Path, PureWindowsPath

from saf_gen.errors import BadInput, closest, unknown
from saf_gen.scene.xml._element_tree import Element, require_attribute

__all__ = ["ALLOWED_PLUGINS", "SceneFile", "check_element", "resolve_file"]

SceneFile = tuple[str, Path]
"""The name in the scene's folder by which a file is asked for, and the file, once links are followed."""

ALLOWED_PLUGINS: dict[str, frozenset[str]] = {
    tag: frozenset(names.split())
    for tag, names in {
        "shape": "bsplinecurve cube cylinder disk instance linearcurve obj ply rectangle sdfgrid serialized"
        " shapegroup sphere",
        "emitter": "area constant directional directionalarea envmap point projector spot sunsky"
        " timed_sunsky",
        "bsdf": "blendbsdf bumpmap conductor dielectric diffuse hair mask measured normalmap null plastic"
        " pplastic principled principledthin roughconductor roughdielectric roughplastic thindielectric"
        " twosided",
        "texture": "bitmap checkerboard mesh_attribute volume",
        "spectrum": "blackbody d65 irregular rawconstant regular srgb uniform",
        "volume": "constvolume gridvolume",
        "medium": "heterogeneous homogeneous",
        "phase": "blendphase hg isotropic rayleigh sggx tabphase",
    }.items()
}
"""What may be loaded, by element. A name is all that Mitsuba needs to load a library, so it must be known;
``blender`` is not here: it reads memory at whatever address the file says."""

PROPERTIES = frozenset(
    ("boolean", "integer", "float", "string", "point", "vector", "rgb", "spectrum", "transform", "ref")
)
STEPS = frozenset(("translate", "rotate", "scale", "matrix", "lookat"))  # of a transform


def check_element(element: Element, folder: Path) -> list[SceneFile]:
    """Refuse an element, or one within it, that is not known or could do harm; make its file names absolute.

    ``folder`` is the scene's, resolved. Returns the files. Raises BadInput with file, line, element and the
    next step.
    """
    files: list[SceneFile] = []
    tag, words = element.tag, element.attributes
    if tag == "path":
        raise BadInput(
            "a search path is refused", where=element.where, hint="name files relative to the scene's folder"
        )
    known = {*ALLOWED_PLUGINS, *PROPERTIES, *STEPS}
    if tag not in known and tag not in ("alias", "sensor"):
        raise unknown("element", tag, known, where=f"{element.file}:{element.line}")
    if tag in ALLOWED_PLUGINS and (tag != "spectrum" or "type" in words):
        plugin = require_attribute(element, "type")
        if plugin not in ALLOWED_PLUGINS[tag]:
            raise unknown("type", plugin, ALLOWED_PLUGINS[tag], where=element.where, hint=_why_not(plugin))
    if tag == "spectrum" and "filename" in words:
        files.append(resolve_file(element, "filename", folder))
        words["filename"] = str(files[-1][1])
    if tag == "string":
        value = require_attribute(element, "value")
        if "file" in words.get("name", ""):
            files.append(resolve_file(element, "value", folder))
            words["value"] = str(files[-1][1])
        elif "/" in value or "\\" in value or ".." in value:  # some names of materials become names of files
            raise BadInput(f"the value is {value!r}", where=element.where, allowed="no path here")
    for inner in element.children:
        files += check_element(inner, folder)
    return files


def _why_not(plugin: str) -> str:
    if plugin == "blender":
        return "it reads Blender's memory: export meshes as PLY"
    return "no other plug-in is loaded from an XML scene"


def resolve_file(element: Element, key: str, folder: Path) -> SceneFile:
    """The file that an element names; it lies in the scene's folder, as named and once links are followed."""
    value = require_attribute(element, key)
    if PureWindowsPath(value).anchor:  # of a path of either kind of system
        raise BadInput(
            f"the file {value!r} is named by an absolute path",
            where=element.where,
            hint=f"copy it into {folder} and name it from there",
        )
    name = posixpath.normpath(value.replace("\\", "/"))
    try:
        file = (folder / value.replace("\\", "/")).resolve()
    except (OSError, RuntimeError) as error:  # a link in a circle
        raise BadInput(f"the file {value!r} cannot be followed: {error}", where=element.where) from error
    if not file.is_relative_to(folder) or name.startswith("../"):
        raise BadInput(
            f"the file {value!r} lies outside of the scene's folder",
            where=element.where,
            hint=f"copy it into {folder} and name it from there",
        )
    if not file.is_file():
        there = [p.name for p in file.parent.iterdir()] if file.parent.is_dir() else []
        near = closest(file.name, there)
        raise BadInput(
            f"the file {value!r} does not exist",
            where=element.where,
            nearest=(Path(value).parent / near).as_posix() if near else "",
            hint="export again with its files, or correct the name",
        )
    return name, file
