"""The elements, plug-ins and files that an XML scene may contain because they are harmless."""

import posixpath
from pathlib import Path, PureWindowsPath

from saf_gen.errors import BadInput, closest, unknown
from saf_gen.scene.ply_file import is_scene_ply_file, validate_scene_ply_file
from saf_gen.scene.xml._element_tree import Element, require_scene_xml_attribute

SceneFile = tuple[str, Path]
"""Name of a file relative to the scene's folder, and the path to which it resolves."""

ALLOWED_PLUGINS: dict[str, frozenset[str]] = {
    tag: frozenset(names.split())
    for tag, names in {
        "shape": "bsplinecurve cube cylinder disk instance linearcurve obj ply rectangle sdfgrid shapegroup sphere",
        "emitter": "area constant directional directionalarea envmap point projector spot sunsky timed_sunsky",
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
"""Plug-ins that may be loaded, by element. Mitsuba loads a shared library by its name alone, so only known names are
allowed. ``blender`` is not, because it reads memory at an address given in the file."""

OTHER_ELEMENTS = frozenset(
    (
        *("boolean", "integer", "float", "string", "point", "vector", "rgb", "spectrum", "transform", "ref"),
        *("translate", "rotate", "scale", "matrix", "lookat"),  # steps of a transform
    )
)


def vet_scene_xml_element(element: Element, folder: Path) -> list[SceneFile]:
    """Check an element and its descendants, make their file names absolute, and return the files.

    ``folder`` is the resolved folder of the scene. Raises BadInput if an element is unknown or could do harm.
    """
    files: list[SceneFile] = []
    tag, attributes = element.tag, element.attributes
    if tag == "path":
        raise BadInput(
            "a search path is not allowed", where=element.where, hint="name files relative to the scene's folder"
        )
    known = {*ALLOWED_PLUGINS, *OTHER_ELEMENTS}
    if tag not in known and tag not in ("alias", "sensor"):
        raise unknown("element", tag, allowed=known, where=f"{element.file}:{element.line}")
    if tag in ALLOWED_PLUGINS and (tag != "spectrum" or "type" in attributes):
        plugin = require_scene_xml_attribute(element, "type")
        if plugin not in ALLOWED_PLUGINS[tag]:
            hint = "no other plug-in is loaded from an XML scene"
            if plugin == "blender":
                hint = "it reads Blender's memory: export meshes as PLY"
            if plugin == "serialized":  # a damaged file ends the process of Mitsuba without a message
                hint = "convert it to PLY with Mitsuba's Mesh.write_ply"
            raise unknown("type", plugin, allowed=ALLOWED_PLUGINS[tag], where=element.where, hint=hint)
    if tag == "spectrum" and "filename" in attributes:
        files.append(resolve_scene_xml_file(element, "filename", folder=folder))
        attributes["filename"] = str(files[-1][1])
    if tag == "string":
        value = require_scene_xml_attribute(element, "value")
        if "file" in attributes.get("name", ""):
            files.append(resolve_scene_xml_file(element, "value", folder=folder))
            if is_scene_ply_file(files[-1][1]):
                validate_scene_ply_file(files[-1][1])
            attributes["value"] = str(files[-1][1])
        elif "/" in value or "\\" in value or ".." in value:  # Mitsuba turns some names of materials into file names
            raise BadInput(f"the value is {value!r}", where=element.where, allowed="a value that is not a path")
    for inner in element.children:
        files += vet_scene_xml_element(inner, folder)
    return files


def resolve_scene_xml_file(element: Element, key: str, *, folder: Path) -> SceneFile:
    """Return the file that an element names.

    Raises BadInput if the file is missing, or is not in the scene's folder after links are followed.
    """
    value = require_scene_xml_attribute(element, key)
    if PureWindowsPath(value).anchor:  # an absolute path on any system
        raise BadInput(
            f"the file {value!r} is named by an absolute path",
            where=element.where,
            hint=f"copy it into {folder} and name it from there",
        )
    name = posixpath.normpath(value.replace("\\", "/"))
    try:
        file = (folder / value.replace("\\", "/")).resolve()
    except (OSError, RuntimeError) as error:  # a circular link
        raise BadInput(f"the file {value!r} cannot be resolved: {error}", where=element.where) from error
    if not file.is_relative_to(folder) or name.startswith("../"):
        raise BadInput(
            f"the file {value!r} is outside the scene's folder",
            where=element.where,
            hint=f"copy it into {folder} and name it from there",
        )
    if not file.is_file():
        neighbours = [p.name for p in file.parent.iterdir()] if file.parent.is_dir() else []
        near = closest(file.name, neighbours)
        raise BadInput(
            f"the file {value!r} does not exist",
            where=element.where,
            nearest=(Path(value).parent / near).as_posix() if near else "",
            hint="export again with its files, or correct the name",
        )
    return name, file
