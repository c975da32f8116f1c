"""Elements of an XML file with their line numbers, parsed by expat and written again as plain text."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.parsers import expat
from xml.sax.saxutils import quoteattr

from saf_gen.core.config.document import check_plain_file
from saf_gen.errors import BadInput

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
