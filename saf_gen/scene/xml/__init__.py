"""Scenes in Mitsuba's XML format, as exporters write it: parsed, confined to their folder, and normalised.

An XML scene is untrusted data, so nothing in it may run code or access files outside its folder. The file is parsed by
expat, which reports the line of every element. A DOCTYPE is rejected, because entity bombs need one. The rest is
written again as plain XML, with includes and parameters resolved and with absolute, checked file names. Only that text
is given to Mitsuba's parser, which handles types, transforms and older versions. Both parsers therefore see the same
scene, and nothing can pass unchecked because they read a file differently.
"""

import posixpath
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path, PureWindowsPath
from typing import Any
from xml.parsers import expat
from xml.sax.saxutils import quoteattr

from saf_gen.core.config.document import check_plain_file
from saf_gen.errors import BadInput, closest, unknown
from saf_gen.scene.obj_file import counts_from_the_end
from saf_gen.scene.picture_file import validate_picture
from saf_gen.scene.ply_file import is_ply, validate_ply

__all__ = ["ALLOWED_PLUGINS", "NOT_RENDERED", "Element", "SceneXml", "read_scene_xml"]

MAX_DEPTH = 64  # levels of nested elements
MAX_BYTES = 1 << 26


@dataclass
class Element:
    """An XML element, its attributes and children, and the file and line (counted from 1) at which it starts."""

    tag: str
    attributes: dict[str, str]
    file: Path
    line: int
    children: list["Element"] = field(default_factory=list)

    @property
    def where(self) -> str:
        """File, line and element, for error messages."""
        name = self.attributes.get("id") or self.attributes.get("name")
        return f"{self.file}:{self.line}: <{self.tag}{f' {name}' if name else ''}>"


def parse_xml(path: Path) -> Element:
    """Return the outermost element of a file, <scene>; raise BadInput if the file is not a scene."""
    parser = expat.ParserCreate()
    parser.buffer_text = True
    root: list[Element] = []
    inside: list[Element] = []

    def start(tag: str, attributes: dict[str, str]) -> None:
        element = Element(tag, attributes, path, parser.CurrentLineNumber)
        if len(inside) >= MAX_DEPTH:
            raise BadInput("elements are nested too deep", where=element.where, allowed=f"at most {MAX_DEPTH} levels")
        (inside[-1].children if inside else root).append(element)
        inside.append(element)

    def refuse_doctype(*_: Any) -> None:
        raise BadInput(
            "a DOCTYPE is refused: it can include files and exhaust memory",
            where=f"{path}:{parser.CurrentLineNumber}",
            hint="delete it; exporters do not write one",
        )

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda tag: inside.pop()
    parser.StartDoctypeDeclHandler = refuse_doctype
    try:
        check_plain_file(path, max_bytes=MAX_BYTES)
        parser.Parse(path.read_bytes(), True)
    except expat.ExpatError as error:
        reason = expat.ErrorString(error.code)
        raise BadInput(f"this is not XML: {reason}", where=f"{path}:{error.lineno}") from error
    except OSError as error:
        raise BadInput(f"{path} cannot be read: {error.strerror}") from error
    except (LookupError, ValueError) as error:  # an encoding that Python or expat does not have
        raise BadInput(
            f"the encoding of the file cannot be read: {error}",
            where=f"{path}:1",
            allowed="UTF-8",
            hint='save it as UTF-8, with <?xml version="1.0" encoding="utf-8"?> or without that line',
        ) from error
    if root[0].tag != "scene":
        raise BadInput("the outermost element is not a scene", where=root[0].where, allowed="<scene>")
    return root[0]


def require_attribute(element: Element, key: str) -> str:
    """Return an attribute of an element; raise BadInput if it is missing."""
    if key not in element.attributes:
        raise BadInput(f"{key} is missing", where=element.where)
    return element.attributes[key]


def format_xml(elements: list[Element], *, version: str, first: int, keep_lines: bool) -> str:
    """Return a scene of these elements as text.

    With ``keep_lines``, each element stays on the line that it has in its file, and <scene> is on line ``first``.
    """
    lines: list[str] = []
    _put(lines, f"<scene version={quoteattr(version)}>", line=first if keep_lines else 0)
    for element in elements:
        _write(element, lines, keep_lines=keep_lines)
    return "\n".join([*lines, "</scene>"])


def _put(lines: list[str], text: str, *, line: int) -> None:
    """Append text as the line with this number, or to the last line if that line exists; 0 starts a new line."""
    lines += [""] * (line - 1 - len(lines))
    if line and len(lines) >= line:
        lines[-1] += text
    else:
        lines.append(text)


def _write(element: Element, lines: list[str], *, keep_lines: bool) -> None:
    attributes = "".join(f" {key}={quoteattr(value)}" for key, value in element.attributes.items())
    closing = ">" if element.children else "/>"
    _put(lines, f"<{element.tag}{attributes}{closing}", line=element.line if keep_lines else 0)
    for inner in element.children:
        _write(inner, lines, keep_lines=keep_lines)
    if element.children:
        lines[-1] += f"</{element.tag}>"


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

NOT_RENDERED = {
    "blackbody": "an <rgb>; the colour of a lamp is stated by the recipe, spectrum: {blackbody: 3000}",
    "irregular": 'an <rgb>, or <spectrum value="400:0.2, 700:0.8"/>',
    "regular": 'an <rgb>, or <spectrum value="400:0.2, 700:0.8"/>',
    "sunsky": "envmap, with a picture of the sky, and directional for the sun",
    "timed_sunsky": "envmap, with a picture of the sky, and directional for the sun",
    "directionalarea": "area, directional",
    "projector": "spot, or area with a bitmap for its radiance",
}
"""Plug-ins that need Mitsuba's spectral modes, or whose light the paths of this renderer miss, and what to use."""

NOT_READ = {
    "blender": "it reads Blender's memory: export meshes as PLY",
    "serialized": "export it as PLY, or convert it with Mitsuba's Mesh.write_ply",  # damaged, it ends the process
}
"""Shapes of Mitsuba that are not safe to read, and what to use instead."""

OTHER_ELEMENTS = frozenset(
    (
        *("boolean", "integer", "float", "string", "point", "vector", "rgb", "spectrum", "transform", "ref"),
        *("translate", "rotate", "scale", "matrix", "lookat"),  # steps of a transform
    )
)


def vet_element(element: Element, folder: Path, *, convertible: bool = False, inside: str = "") -> list[SceneFile]:
    """Check an element and its descendants, make their file names absolute, and return the files.

    ``folder`` is the resolved folder of the scene, ``inside`` the plug-in that has the element. If ``convertible``,
    meshes may be of a form that Mitsuba does not read, but that can be rewritten. Raises BadInput if an element is
    unknown or could do harm.
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
        plugin = require_attribute(element, "type")
        if plugin in NOT_RENDERED:
            raise BadInput(f"{plugin} is not rendered", where=element.where, allowed=NOT_RENDERED[plugin])
        if plugin not in ALLOWED_PLUGINS[tag]:
            if plugin in NOT_READ:
                raise BadInput(f"{plugin} is not read", where=element.where, allowed="ply", hint=NOT_READ[plugin])
            hint = "no other plug-in is loaded from an XML scene"
            raise unknown("type", plugin, allowed=ALLOWED_PLUGINS[tag], where=element.where, hint=hint)
    if tag == "spectrum" and "filename" in attributes:
        files.append(resolve_file(element, "filename", folder=folder))
        attributes["filename"] = str(files[-1][1])
    if tag == "string":
        value = require_attribute(element, "value")
        if "file" in attributes.get("name", ""):
            files.append(resolve_file(element, "value", folder=folder))
            _vet_file(files[-1][1], element, inside=inside, convertible=convertible)
            attributes["value"] = str(files[-1][1])
        elif "/" in value or "\\" in value or ".." in value:  # Mitsuba turns some names of materials into file names
            raise BadInput(f"the value is {value!r}", where=element.where, allowed="a value that is not a path")
    if tag == "shape" and attributes.get("type") == "instance" and any(c.tag == "shape" for c in element.children):
        raise BadInput(
            "an instance holds its shape group",
            where=element.where,
            allowed='<ref id="..."/> to a shape group',
            hint="give the group an id and move it to the top of the scene",
        )
    for inner in element.children:
        files += vet_element(inner, folder, convertible=convertible, inside=attributes.get("type", ""))
    return files


def _vet_file(file: Path, element: Element, *, inside: str, convertible: bool) -> None:
    """Raise BadInput if Mitsuba could not read a file of an element, as far as its content shows."""
    if inside in ("bitmap", "envmap"):
        validate_picture(file, where=element.where)
    elif is_ply(file):
        validate_ply(file, triangles=not convertible)
    elif inside == "ply":
        raise BadInput(f"the mesh {file.name!r} is not a PLY file", where=element.where, hint="export it as PLY")
    elif inside == "obj" and not convertible and counts_from_the_end(file):
        raise BadInput(
            f"faces of the mesh {file.name!r} count vertices from the end",
            where=element.where,
            allowed="positive indices",
            hint="export it again, or import its scene with saf-gen scenes new --from",
        )


def resolve_file(element: Element, key: str, *, folder: Path) -> SceneFile:
    """Return the file that an element names.

    Raises BadInput if the file is missing, or is not in the scene's folder after links are followed.
    """
    value = require_attribute(element, key)
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


IGNORED = frozenset(("sensor", "integrator", "film", "sampler", "rfilter"))  # set by the card and the recipe
MAX_ELEMENTS = 1_000_000  # of all files together
PARAMETER_HINT = 'a parameter of an XML scene is one of its <default name="..." value="..."/>'


@dataclass(frozen=True)
class SceneXml:
    """An XML scene that passed all checks.

    Elements keep the line numbers that they have in the file, unless the file includes others.

    Attributes
    ----------
    text : str
        The elements as plain XML, without sensors and integrators. Every object at the top level has an id.
    cameras : str
        The sensors, without their films, as the XML of a separate scene.
    films : tuple of Element or None
        The film of each sensor.
    files : tuple of tuple
        All other files that the scene needs: the name relative to its folder, and the path to which it resolves.
    ignored : tuple of Element
        Elements that the card and the recipe replace: integrators, films and samplers, also those of sensors.
    media : tuple of str
        Ids of the media, which are not rendered.
    """

    text: str
    cameras: str
    files: tuple[SceneFile, ...]
    ignored: tuple[Element, ...] = ()
    media: tuple[str, ...] = ()
    films: tuple[Element | None, ...] = ()

    def with_copies(self, copies: Mapping[Path, Path]) -> "SceneXml":
        """Return the scene with copies in place of some of its files."""
        text = self.text
        for source, copy in copies.items():
            text = text.replace(quoteattr(str(source)), quoteattr(str(copy)))
        return replace(self, text=text)


def read_scene_xml(path: Path, params: Mapping[str, Any], *, convertible: bool = False) -> SceneXml:
    """Read an XML scene and check that it is harmless.

    The id of an element is its ``id``, or else its ``name``, or else its tag and number, such as ``shape_3`` for the
    third shape.

    Parameters
    ----------
    path : Path
        The XML file.
    params : mapping of str to object
        Values of its ``<default>`` parameters, by name.
    convertible : bool, default False
        Accept PLY meshes with faces of more than three corners and OBJ meshes with negative indices. Mitsuba does not
        read them.

    Raises
    ------
    BadInput
        If the file is not a scene, does not have one of the parameters, names a file that is missing or outside its
        folder, or needs a plug-in that is not known to be harmless. The message gives file, line and element.
    """
    root = parse_xml(path)
    if "version" not in root.attributes:
        raise BadInput(
            "the version is missing", where=root.where, allowed='<scene version="3.0.0">, as exporters write'
        )
    resolver = _Resolver(path.parent.resolve(), params)
    elements = list(resolver.resolve(root, (path.resolve(),)))
    for name in params:
        if name not in resolver.values:
            card = str(path.parent / "scene.yaml")
            raise unknown("parameter", name, allowed=resolver.values, where=card, hint=PARAMETER_HINT)
    files = [*resolver.included]
    for element in (*elements, *resolver.cameras):
        files += vet_element(element, resolver.folder, convertible=convertible)
    _assign_ids(elements)
    version = root.attributes["version"]

    def format_elements(elements: list[Element]) -> str:
        keep_lines = all(element.file == path for element in elements)
        return format_xml(elements, version=version, first=root.line, keep_lines=keep_lines)

    return SceneXml(
        format_elements(elements),
        format_elements(resolver.cameras),
        tuple(dict.fromkeys(files)),
        tuple(resolver.ignored),
        tuple(dict.fromkeys(_media([*elements, *resolver.cameras]))),
        tuple(resolver.films),
    )


def _media(elements: list[Element]) -> Iterator[str]:
    """Yield the ids of the media among elements and their descendants."""
    for element in elements:
        if element.tag == "medium":
            yield element.attributes.get("id") or element.attributes.get("name") or element.attributes["type"]
        else:
            yield from _media(element.children)


class _Resolver:
    """Substitutes parameters, replaces includes by the elements that they include, and drops ignored elements.

    ``values``, ``cameras``, ``films``, ``included`` and ``ignored`` are the parameters, sensors, their films, included
    files and ignored elements found so far. As in Mitsuba, a parameter is defined from its ``<default>`` element on.
    """

    def __init__(self, folder: Path, params: Mapping[str, Any]) -> None:
        self.folder, self.params = folder, params
        self.values: dict[str, str] = {}
        self.cameras: list[Element] = []
        self.films: list[Element | None] = []
        self.included: list[SceneFile] = []
        self.ignored: list[Element] = []
        self._count = 0

    def resolve(self, scene: Element, open_files: tuple[Path, ...]) -> Iterator[Element]:
        """Yield the top-level elements of a scene; ``open_files`` is the chain of files that include it."""
        for element in scene.children:
            if element.tag in IGNORED - {"sensor"}:
                with suppress(BadInput):  # what is ignored may lack a parameter
                    self._fill(element)
                self.ignored.append(element)
                continue
            film = next((inner for inner in element.children if inner.tag == "film"), None)
            self._fill(element)
            if element.tag == "sensor":
                self.cameras.append(element)
                self.films.append(film)
            elif element.tag == "include":
                name, file = resolve_file(element, "filename", folder=self.folder)
                if file in open_files:
                    raise BadInput("the file includes itself", where=element.where, hint="remove the include")
                self.included.append((name, file))
                yield from self.resolve(parse_xml(file), (*open_files, file))
            elif element.tag == "default":
                name = require_attribute(element, "name")
                value = _format_value(self.params[name]) if name in self.params else require_attribute(element, "value")
                self.values.setdefault(name, value)
            else:
                yield element

    def _fill(self, element: Element) -> None:
        """Substitute parameters in an element and its descendants; the longest matching name wins, as in Mitsuba."""
        self._count += 1
        if self._count > MAX_ELEMENTS:
            raise BadInput("the scene is too large", where=element.where, allowed=f"at most {MAX_ELEMENTS:,} elements")
        for key, text in element.attributes.items():
            for name in sorted(self.values, key=len, reverse=True) if "$" in text else ():
                text = text.replace(f"${name}", self.values[name])
            if "$" in text:
                name = re.sub(r".*?\$(\w*).*", r"\1", text, flags=re.DOTALL)
                raise unknown("parameter", name, allowed=self.values, where=element.where, hint=PARAMETER_HINT)
            element.attributes[key] = text
        dropped = [inner for inner in element.children if inner.tag in IGNORED]
        element.children = [inner for inner in element.children if inner.tag not in IGNORED]
        for inner in dropped:
            with suppress(BadInput):
                self._fill(inner)
        self.ignored += dropped
        for inner in element.children:
            self._fill(inner)


def _format_value(value: Any) -> str:
    """Return the value of a parameter as Mitsuba's XML writes it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list | tuple):
        return ", ".join(_format_value(v) for v in value)
    return str(value)


def _assign_ids(elements: list[Element]) -> None:
    """Give every object at the top level of the scene a unique id; raise BadInput if an id occurs twice."""
    by_id: dict[str, Element] = {}
    counts: Counter[str] = Counter()
    for element in elements:
        if element.tag not in ALLOWED_PLUGINS:
            continue
        counts[element.tag] += 1
        declared = element.attributes.get("id") or element.attributes.get("name")
        name = declared or f"{element.tag}_{counts[element.tag]}"
        if name in by_id:
            raise BadInput(f"the id occurs twice, first at {by_id[name].where}", where=element.where)
        by_id[name] = element
        element.attributes["id"] = name
