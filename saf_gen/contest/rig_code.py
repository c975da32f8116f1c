"""Which version of the rig made a record: a digest over the sources that decide its numbers.

The sources of a track are those of its loop and of everything of saf_gen that these import, so that no new
module is forgotten. A policy runs in the closed loop too, so the environment is of that track's rig.
"""

import hashlib
import json
from functools import cache
from pathlib import Path

from saf_gen.sources import imported, text_of

__all__ = ["rig_code", "rig_files"]

PACKAGE = Path(__file__).resolve().parent.parent
OWN = f"{PACKAGE.name}."
LOOPS = {"recorded": ("contest.recorded",), "closed_loop": ("contest.closed_loop", "gym.rollout")}
DATA = {"actuators": "presets/*.yaml"}
"""Files beside a room's sources that its numbers come from."""
ELSEWHERE = {
    "measures": "in the code of a method",
    "searches": "in the code of a method",
    "methods": "names methods, and makes their code",
    "tuned": "names methods",
    "registry": "finds parts",
    "sources": "reads sources",
    "contest.rig_code": "reads sources",
    "records": "writes records, which have a format of their own",
    "record_rules": "refuses records",
    "contest.results": "hands over what figures need",
    "rig.thumbnails": "for people to look at",
    "dataset": "lists sequences, each with its digest",
    "documents": "reads files strictly",
    "errors": "words",
    "files": "writes files",
    "host": "words",
    "evaluate": "goes through sequences and methods",
}
"""Modules and rooms that decide no number of a record, and why: they are not followed."""


@cache
def rig_code(track: str, package: Path = PACKAGE) -> str:
    """12 digits of a sha256 over the files of a track's rig, as :func:`rig_files` gives them."""
    return hashlib.sha256(json.dumps(rig_files(track, package)).encode()).hexdigest()[:12]


def rig_files(track: str, package: Path = PACKAGE) -> list[list[str]]:
    """Each file as [path within the package, sha256 of its text], sorted. How lines end is not in it."""
    found: dict[str, Path] = {}
    todo = list(LOOPS[track])
    while todo:
        name = todo.pop()
        path = _path_of(name, package)
        if name in found or path is None or name in ELSEWHERE or name.partition(".")[0] in ELSEWHERE:
            continue
        found[name] = path
        home = name if path.stem == "__init__" else name.rpartition(".")[0]
        names = imported(text_of(path), f"{OWN}{home}".rstrip("."))
        todo += [other.removeprefix(OWN) for other in names if other.startswith(OWN)]
    rooms = {name.partition(".")[0] for name in found}
    data = [p for room, files in DATA.items() if room in rooms for p in (package / room).glob(files)]
    files = [*found.values(), *data]
    return sorted([p.relative_to(package).as_posix(), hashlib.sha256(text_of(p)).hexdigest()] for p in files)


def _path_of(name: str, package: Path) -> Path | None:
    place = package.joinpath(*name.split("."))
    tried = (place / "__init__.py", place.with_name(f"{place.name}.py"))
    return next((path for path in tried if path.is_file()), None)
