"""A scene as Mitsuba's XML, as exporters write it: read, kept within its folder, made plain.

An XML scene is data of somebody else, so nothing in it may run code or reach out of its folder. The file is
parse_xml_file by expat, which standard libraries stand on and which knows the line of every element; a
DOCTYPE, the
root of entity bombs, is refused as such. What is left is written again as plain XML (includes, parameters and
aliases settled, every file name absolute and checked), and only that text is handed to Mitsuba's own parser,
which knows types, transforms and older versions. So both see the same, and nothing escapes between them.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from saf_gen.errors import BadInput, unknown
from saf_gen.scene.xml._allowlist import ALLOWED_PLUGINS, SceneFile, check_element, resolve_file
from saf_gen.scene.xml._element_tree import Element, format_scene_xml, parse_xml_file, require_attribute

__all__ = ["ALLOWED_PLUGINS", "SceneXml", "read_scene_xml"]

IGNORED = frozenset(
    ("sensor", "integrator", "film", "sampler", "rfilter")
)  # the card and the recipe say these
MOST = 1_000_000  # elements, of all files together
HOW = 'a parameter of an XML scene is one of its <default name="..." value="..."/>'


@dataclass(frozen=True)
class SceneXml:
    """An XML scene that has been found harmless.

    text : its own elements as plain XML, every top-level one with an id; sensors and the like left out.
    cameras : its sensors, without their films, as a scene of their own. files : all that it needs, beside
    itself: by which name from its folder, and which file that is once links are followed. Elements keep the
    lines they have in the file, unless it includes others.
    """

    text: str
    cameras: str
    files: tuple[SceneFile, ...]


def read_scene_xml(path: Path, params: Mapping[str, Any]) -> SceneXml:
    """Read an XML scene; ``params`` are values for its ``<default>`` parameters, by name.

    An id is the element's ``id``, else its ``name``, else tag and number, as ``shape_3`` for the third shape.

    Raises BadInput, in one line that names file, line and element, for a file that is no such scene, that
    names a file which is missing or out of its folder, or that asks for a plug-in which is not known to be
    harmless; and for a parameter that the file does not have.
    """
    root = parse_xml_file(path)
    if "version" not in root.attributes:
        raise BadInput(
            "the version is missing", where=root.where, allowed='<scene version="3.0.0">, as exporters write'
        )
    settled = _Resolver(path.parent.resolve(), params)
    elements = list(settled.scene(root, (path.resolve(),)))
    for name in params:
        if name not in settled.values:
            card = str(path.parent / "scene.yaml")
            raise unknown("parameter", name, settled.values, where=card, hint=HOW)
    files = [*settled.included]
    for element in (*elements, *settled.cameras):
        files += check_element(element, settled.folder)
    _name(elements)
    version = root.attributes["version"]

    def plain(elements: list[Element]) -> str:
        return format_scene_xml(version, root.line, elements, in_order=all(e.file == path for e in elements))

    return SceneXml(plain(elements), plain(settled.cameras), tuple(dict.fromkeys(files)))


class _Resolver:
    """Fills in parameters, puts what is included in its place, and leaves out what does not count.

    ``values``: the parameters met so far; as in Mitsuba one holds from its ``<default>`` on. ``cameras``: the
    sensors met, ``included``: the files.
    """

    def __init__(self, folder: Path, params: Mapping[str, Any]) -> None:
        self.folder, self.params = folder, params
        self.values: dict[str, str] = {}
        self.cameras: list[Element] = []
        self.included: list[SceneFile] = []
        self._count = 0

    def scene(self, scene: Element, within: tuple[Path, ...]) -> Iterator[Element]:
        """The elements directly in a scene; ``within``: the files that are being read."""
        for element in scene.children:
            if element.tag in IGNORED - {"sensor"}:
                continue
            self._fill(element)
            if element.tag == "sensor":
                self.cameras.append(element)
            elif element.tag == "include":
                name, file = resolve_file(element, "filename", self.folder)
                if file in within:
                    raise BadInput("the file includes itself", where=element.where, hint="remove the include")
                self.included.append((name, file))
                yield from self.scene(parse_xml_file(file), (*within, file))
            elif element.tag == "default":
                name = require_attribute(element, "name")
                value = (
                    _text(self.params[name]) if name in self.params else require_attribute(element, "value")
                )
                self.values.setdefault(name, value)
            else:
                yield element

    def _fill(self, element: Element) -> None:
        """Put parameters into an element and all in it; the longest name that fits wins, as in Mitsuba."""
        self._count += 1
        if self._count > MOST:
            raise BadInput("the scene is too large", where=element.where, allowed=f"{MOST:,} elements")
        for key, text in element.attributes.items():
            for name in sorted(self.values, key=len, reverse=True) if "$" in text else ():
                text = text.replace(f"${name}", self.values[name])
            if "$" in text:
                name = re.sub(r".*?\$(\w*).*", r"\1", text, flags=re.DOTALL)
                raise unknown("parameter", name, self.values, where=element.where, hint=HOW)
            element.attributes[key] = text
        element.children = [inner for inner in element.children if inner.tag not in IGNORED]
        for inner in element.children:
            self._fill(inner)


def _text(value: Any) -> str:
    """A parameter's value as XML has it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list | tuple):
        return ", ".join(_text(v) for v in value)
    return str(value)


def _name(elements: list[Element]) -> None:
    """Give every object directly in the scene an id of its own."""
    taken: dict[str, Element] = {}
    counts: dict[str, int] = {}
    for element in elements:
        if element.tag not in ALLOWED_PLUGINS:
            continue
        counts[element.tag] = counts.get(element.tag, 0) + 1
        name = (
            element.attributes.get("id")
            or element.attributes.get("name")
            or f"{element.tag}_{counts[element.tag]}"
        )
        if name in taken:
            raise BadInput(f"the id stands twice, first at {taken[name].where}", where=element.where)
        taken[name] = element
        element.attributes["id"] = name
