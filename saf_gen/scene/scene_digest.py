"""The digest of a scene's folder: what tells a stored focal stack from that of an edited scene."""

import hashlib
import os
from collections.abc import Mapping
from pathlib import Path

from saf_gen.errors import BadInput

__all__ = ["folder_digest"]

MOST = 100_000  # files and folders of a scene: a link to somebody's whole disk leads to more
SEEN_IN_NO_PICTURE = ".md", "preview.png"  # prose; what `saf-gen scenes preview` writes, at the top alone


def folder_digest(folder: Path, *, contents: Mapping[str, bytes], leave: bool) -> str:
    """SHA-256 (hex) over names and bytes of the files in a folder, prose and the scene's own picture aside.

    contents : by name, what counts in place of a file's bytes. leave : whether linked folders may lie out of
    this one; what is in them counts under the link's name.

    Raises BadInput where a file or folder cannot be read, for links in a circle or to where they may not
    lead, and for more files than a scene has.
    """
    sha = hashlib.sha256()
    prose, picture = SEEN_IN_NO_PICTURE
    try:
        for path in _files(folder, leave):
            name = path.relative_to(folder).as_posix()
            if path.suffix != prose and name != picture:
                content = contents[name] if name in contents else path.read_bytes()
                sha.update(f"{name}\0{len(content)}\0".encode() + content)
    except OSError as error:
        raise BadInput(f"{error.filename or folder} cannot be read: {error.strerror or error}") from error
    return sha.hexdigest()


def _files(folder: Path, leave: bool) -> list[Path]:
    """Every regular file in a folder and below, sorted, linked folders followed."""
    found: list[Path] = []
    todo: list[tuple[Path, tuple[str, ...]]] = [(folder, ())]
    looked = 0
    while todo:
        at, above = todo.pop()
        within = (*above, os.path.realpath(at))  # on the way here: to meet one again is to go in a circle
        for path in at.iterdir():
            looked += 1
            if looked > MOST:
                raise BadInput(
                    f"{folder} holds more than {MOST:,} files", hint="remove what is not the scene's"
                )
            if path.is_file():
                found.append(path)
            elif path.is_dir() and path.name != "__pycache__":
                _check_way(path, within, leave)
                todo.append((path, within))
    return sorted(found)


def _check_way(path: Path, within: tuple[str, ...], leave: bool) -> None:
    real = os.path.realpath(path)
    if real in within:
        raise BadInput(f"{path} leads in a circle, back to {real}", hint="remove the link")
    if not (leave or Path(real).is_relative_to(within[0])):
        raise BadInput(
            f"{path} is a link to {real}",
            allowed="for a scene.xml, what lies in the scene's folder",
            hint=f"copy it into {within[0]}",
        )
