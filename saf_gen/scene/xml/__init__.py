"""Scenes in Mitsuba's XML format, as exporters write it: parsed, confined to their folder, and normalised.

An XML scene is untrusted data, so nothing in it may run code or access files outside its folder. The file is parsed by
expat, which reports the line of every element. A DOCTYPE is rejected, because entity bombs need one. The rest is
written again as plain XML, with includes and parameters resolved and with absolute, checked file names. Only that text
is given to Mitsuba's parser, which handles types, transforms and older versions. Both parsers therefore see the same
scene, and nothing can pass unchecked because they read a file differently.
"""

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from saf_gen.errors import BadInput, unknown
from saf_gen.scene.xml._allowlist import ALLOWED_PLUGINS, SceneFile, resolve_scene_xml_file, vet_scene_xml_element
from saf_gen.scene.xml._element_tree import Element, format_scene_xml, parse_scene_xml_file, require_scene_xml_attribute

__all__ = ["ALLOWED_PLUGINS", "SceneXml", "read_scene_xml"]

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
    files : tuple of tuple
        All other files that the scene needs: the name relative to its folder, and the path to which it resolves.
    """

    text: str
    cameras: str
    files: tuple[SceneFile, ...]


def read_scene_xml(path: Path, params: Mapping[str, Any]) -> SceneXml:
    """Read an XML scene and check that it is harmless.

    The id of an element is its ``id``, or else its ``name``, or else its tag and number, such as ``shape_3`` for the
    third shape.

    Parameters
    ----------
    path : Path
        The XML file.
    params : mapping of str to object
        Values of its ``<default>`` parameters, by name.

    Raises
    ------
    BadInput
        If the file is not a scene, does not have one of the parameters, names a file that is missing or outside its
        folder, or needs a plug-in that is not known to be harmless. The message gives file, line and element.
    """
    root = parse_scene_xml_file(path)
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
        files += vet_scene_xml_element(element, resolver.folder)
    _assign_ids(elements)
    version = root.attributes["version"]

    def format_elements(elements: list[Element]) -> str:
        keep_lines = all(element.file == path for element in elements)
        return format_scene_xml(elements, version=version, first=root.line, keep_lines=keep_lines)

    return SceneXml(format_elements(elements), format_elements(resolver.cameras), tuple(dict.fromkeys(files)))


class _Resolver:
    """Substitutes parameters, replaces includes by the elements that they include, and drops ignored elements.

    ``values``, ``cameras`` and ``included`` are the parameters, sensors and included files found so far. As in Mitsuba,
    a parameter is defined from its ``<default>`` element on.
    """

    def __init__(self, folder: Path, params: Mapping[str, Any]) -> None:
        self.folder, self.params = folder, params
        self.values: dict[str, str] = {}
        self.cameras: list[Element] = []
        self.included: list[SceneFile] = []
        self._count = 0

    def resolve(self, scene: Element, open_files: tuple[Path, ...]) -> Iterator[Element]:
        """Yield the top-level elements of a scene; ``open_files`` is the chain of files that include it."""
        for element in scene.children:
            if element.tag in IGNORED - {"sensor"}:
                continue
            self._fill(element)
            if element.tag == "sensor":
                self.cameras.append(element)
            elif element.tag == "include":
                name, file = resolve_scene_xml_file(element, "filename", folder=self.folder)
                if file in open_files:
                    raise BadInput("the file includes itself", where=element.where, hint="remove the include")
                self.included.append((name, file))
                yield from self.resolve(parse_scene_xml_file(file), (*open_files, file))
            elif element.tag == "default":
                name = require_scene_xml_attribute(element, "name")
                if name in self.params:
                    value = _format_value(self.params[name])
                else:
                    value = require_scene_xml_attribute(element, "value")
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
        element.children = [inner for inner in element.children if inner.tag not in IGNORED]
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
