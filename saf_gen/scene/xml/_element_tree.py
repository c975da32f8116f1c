"""The elements of an XML file with the lines they stand on; read by expat, written again as plain text."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.parsers import expat
from xml.sax.saxutils import quoteattr

from saf_gen.errors import BadInput

__all__ = ["Element", "format_scene_xml", "parse_xml_file", "require_attribute"]

DEEPEST = 64  # elements within each other


@dataclass
class Element:
    """An element and its attributes, ``attributes``; ``line`` of ``file``, from 1."""

    tag: str
    attributes: dict[str, str]
    file: Path
    line: int
    children: list["Element"] = field(default_factory=list)

    @property
    def where(self) -> str:
        """The place and the element, as messages name it."""
        name = self.attributes.get("id") or self.attributes.get("name")
        return f"{self.file}:{self.line}: <{self.tag}{f' {name}' if name else ''}>"


def parse_xml_file(path: Path) -> Element:
    """The outermost element of a file, <scene>, with all in it; raises BadInput where the file is none."""
    parser = expat.ParserCreate()
    parser.buffer_text = True
    root: list[Element] = []
    inside: list[Element] = []

    def start(tag: str, words: dict[str, str]) -> None:
        element = Element(tag, words, path, parser.CurrentLineNumber)
        if len(inside) >= DEEPEST:
            raise BadInput("elements are nested too deep", where=element.where, allowed=f"{DEEPEST} levels")
        (inside[-1].children if inside else root).append(element)
        inside.append(element)

    def doctype(*_: Any) -> None:
        raise BadInput(
            "a DOCTYPE is refused: it can pull in files and blow up memory",
            where=f"{path}:{parser.CurrentLineNumber}",
            hint="delete it; exporters write none",
        )

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda tag: inside.pop()
    parser.StartDoctypeDeclHandler = doctype
    try:
        parser.Parse(path.read_bytes(), True)
    except expat.ExpatError as error:
        said = expat.ErrorString(error.code)
        raise BadInput(f"this is not XML: {said}", where=f"{path}:{error.lineno}") from error
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
        raise BadInput("the outermost element is no scene", where=root[0].where, allowed="<scene>")
    return root[0]


def require_attribute(element: Element, key: str) -> str:
    """An attribute that must be there."""
    if key not in element.attributes:
        raise BadInput(f"{key} is missing", where=element.where)
    return element.attributes[key]


def format_scene_xml(version: str, first: int, elements: list[Element], *, in_order: bool) -> str:
    """A scene of these elements as text; ``in_order``: each on its own line, <scene> on line ``first``."""
    lines = _Lines()
    lines.put(first if in_order else 0, f"<scene version={quoteattr(version)}>")
    for element in elements:
        _write(element, lines, in_order=in_order)
    return "\n".join([*lines.done, "</scene>"])


@dataclass
class _Lines:
    """Text of lines, in which an element can be put on the line of its number."""

    done: list[str] = field(default_factory=list)

    def put(self, line: int, text: str) -> None:
        self.done += [""] * (line - 1 - len(self.done))
        if line and len(self.done) >= line:
            self.done[-1] += text
        else:
            self.done.append(text)


def _write(element: Element, lines: _Lines, *, in_order: bool) -> None:
    line = element.line if in_order else 0
    words = "".join(f" {key}={quoteattr(value)}" for key, value in element.attributes.items())
    lines.put(line, f"<{element.tag}{words}" + (">" if element.children else "/>"))
    for inner in element.children:
        _write(inner, lines, in_order=in_order)
    if element.children:
        lines.done[-1] += f"</{element.tag}>"
