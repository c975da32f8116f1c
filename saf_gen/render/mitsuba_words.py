"""Errors of Mitsuba in our words: the shape or material, the value, what is allowed, and the next step, in one line."""

import re
from collections.abc import Callable
from pathlib import Path

from saf_gen.errors import BadInput, closest
from saf_gen.scene.picture_file import ALLOWED as PICTURES
from saf_gen.scene.xml import ALLOWED_PLUGINS

PLACE = re.compile(r"\[[\w.]+(?::\d+)?\] ")  # a source file of Mitsuba, or one of its classes
NODE = re.compile(r'dictionary node "([^"]*)"|^\[[\w.]+:\d+\] \[([\w.-]+)\]')
PLUGIN = re.compile(r'(?:failed to instantiate|in) (\w+) plugin of type "([^"]*)"')
AGAIN = "export it again"
METALS = "name one of Mitsuba's materials, such as Cu, Au, Al or bk7"


def _vertex(found: re.Match[str]) -> tuple[str, str, str]:
    index = int(found[2])
    index -= (index >= 1 << 31) << 32  # Mitsuba prints negative numbers without their sign
    return f"the mesh {_name(found[1])} has a face with the vertex {index}", "vertices of the file", AGAIN


def _near(plugin: str) -> str:
    near = closest(plugin, set().union(*ALLOWED_PLUGINS.values()))
    return f"write {near!r} if you mean that" if near else "correct its name"


def _name(path: str) -> str:
    return repr(Path(path).name)


Words = Callable[[re.Match[str]], tuple[str, str, str]]
TRANSLATIONS: tuple[tuple[str, Words], ...] = (
    (
        r'The property "([^"]+)" has the wrong type \(expected ([^,)]+), got (\w+)\)',
        lambda m: (f"{m[1]} is a {m[3]}", m[2].replace("/", ", "), "correct its type"),
    ),
    (
        r'Found \d+ unreferenced propert\w+ in (\w+) plugin of type "([^"]+)": - \w+ "([^"]+)"',
        lambda m: (f"{m[2]} has no {m[3]}", "", "remove it, or correct its name"),
    ),
    (
        r'"(?:data/)?ior/([^"]+?)(?:\.\w+)*": file does not exist',
        lambda m: (f"the material {m[1]!r} is unknown", "", ""),
    ),
    (r'Error while loading OBJ file "([^"]+)": reference to invalid vertex (\d+)', _vertex),
    (
        r'Error while loading OBJ file "([^"]+)": could not parse line "([^"]*)"',
        lambda m: (f"the mesh {_name(m[1])} has the line {m[2]!r}", "numbers with a point", AGAIN),
    ),
    (r"Storing new normals in a Mesh", lambda m: ("the mesh has no face", "", AGAIN)),
    (r'Plugin "([^"]+)" not found', lambda m: (f"the type {m[1]!r} is unknown", "a plug-in of Mitsuba", _near(m[1]))),
    (r'file "([^"]+)": file not found', lambda m: (f"the file {_name(m[1])} does not exist", "", "correct its name")),
    (
        r'"([^"]+)": I/O error while attempting to open',
        lambda m: (f"the file {_name(m[1])} does not exist", "", "correct its name"),
    ),
    (
        r'unresolved reference to "([^"]*)"',
        lambda m: (f"nothing has the id {m[1]!r}", "the id of a material, texture or shape", "correct the reference"),
    ),
    (r"missing 'type' attribute", lambda m: ("the type is missing", "a plug-in of Mitsuba", "add it")),
    (
        r"could not assign an object of type '(\w+)' to key '([^']+)'",
        lambda m: (f"{m[2]} is a {m[1]}", "a number, colour, transform, text or dictionary", "correct its type"),
    ),
    (r"Unknown file format", lambda m: ("the picture is of an unknown format", PICTURES, "save it as PNG")),
    (
        r'"([^"]+)": (?:I/O error|read \d+ out of \d+ bytes)',
        lambda m: (f"the file {_name(m[1])} is damaged or truncated", "", AGAIN),
    ),
    (
        r"Invalid RGB reflectance value \[([^\]]*)\]",
        lambda m: (f"the reflectance is {m[1]}", "0 to 1", "a reflectance above 1 would make light"),
    ),
    (r'Error while loading (\w+) file "([^"]+)"', lambda m: (f"the {m[1]} mesh {_name(m[2])} is damaged", "", AGAIN)),
    (r"Couldn't find key", lambda m: ("an instance has no shape group", '<ref id="..."/> to a shape group', "")),
    (
        r"A reference to a 'shapegroup' must be specified",
        lambda m: ("the instance has no shape group", '<ref id="..."/> to a shape group', "add it"),
    ),
    (
        r"Instancing of emitters is not supported",
        lambda m: ("the shape group has a lamp", "shapes without lamps", "move the lamp out of the group"),
    ),
)


def load_refusal(error: Exception, *, names: tuple[str, ...], where: str) -> BadInput:
    """Return an error of Mitsuba on loading a scene as a BadInput; ``names`` are the entries of the file ``where``."""
    message = " ".join(str(error).split())
    node = NODE.search(message)
    plugin = PLUGIN.search(message)
    path = [
        part for part in ((node[1] or node[2]).split(".") if node else []) if not re.fullmatch(r"part_\d+|root", part)
    ]
    entry = path[0] if path else ""
    place = f"{entry!r}" if entry in names else entry
    if path[1:]:
        place = f"{'.'.join(path[1:])} of {place}"
    if plugin and plugin[2] != "scene":
        place = f"{place} ({plugin[2]})" if place else plugin[2]
    for pattern, words in TRANSLATIONS:
        if found := re.search(pattern, message):
            problem, allowed, hint = words(found)
            break
    else:
        problem = PLACE.split(message)[-1].rstrip("!.")
        allowed = hint = ""
    return BadInput(f"{place}: {problem}" if place else problem, where=where, allowed=allowed, hint=hint)


PARSED: tuple[tuple[str, Words], ...] = (
    (
        r'could not parse RGB value "([^"]*)"',
        lambda m: (f"the colour is {m[1]!r}", 'three numbers, such as "0.5, 0.5, 0.5", or #rrggbb', "correct it"),
    ),
    (
        r'could not parse floating point value "([^"]*)"',
        lambda m: (f"the number is {m[1]!r}", "a number with a decimal point, such as 1.5", "correct it"),
    ),
    (r'could not parse integer value "([^"]*)"', lambda m: (f"the number is {m[1]!r}", "a whole number", "correct it")),
    (r'could not parse boolean value "([^"]*)"', lambda m: (f"the value is {m[1]!r}", "true, false", "correct it")),
    (
        r'unresolved reference to "([^"]*)"',
        lambda m: (f"nothing has the id {m[1]!r}", "the id of a material, texture or shape", "correct the reference"),
    ),
    (r"(matrix must have .*)", lambda m: (f"the {m[1]}", "", "correct it")),
)


def parse_refusal(error: Exception, path: Path) -> BadInput:
    """Return an error of Mitsuba's parser as a BadInput; ``path`` is the file, for messages."""
    message = re.sub(r"^\[[\w.]+:\d+\] ", "", str(error))
    line = re.search(r"line (\d+)", message)
    where = f"{path}:{line[1]}" if line else str(path)
    message = " ".join(re.sub(r"^Error while loading string \(.*?\): ", "", message).split())
    for pattern, words in PARSED:
        if found := re.search(pattern, message):
            problem, allowed, hint = words(found)
            return BadInput(problem, where=where, allowed=allowed, hint=hint)
    return BadInput(f"Mitsuba does not understand this: {message}", where=where)
