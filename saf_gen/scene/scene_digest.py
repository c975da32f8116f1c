"""The digest of a scene's folder, which tells a stored focal stack from that of an edited scene."""

import hashlib
import os
from collections.abc import Mapping
from pathlib import Path

from saf_gen.errors import BadInput

MAX_FILES = 100_000  # files and folders of a scene; a link to a whole disk would lead to more
PROSE, OWN_PREVIEW = (".md", "preview.png")  # files without effect on a rendered pixel; the preview at the top only


def scene_folder_digest(folder: Path, *, contents: Mapping[str, bytes], allow_outside_links: bool) -> str:
    """Return the SHA-256 (hex) over names and bytes of a folder's files, without Markdown and the preview at the top.

    ``contents`` gives by name the bytes that count in place of a file's own, or for a file that is not in the
    folder. What lies in a linked folder counts under the name of the link; ``allow_outside_links`` says
    whether such a link may lead out of the folder.

    Raises BadInput for a file or folder that cannot be read, for links that form a circle or lead where they
    must not, and for more files than a scene can have.
    """
    sha = hashlib.sha256()
    try:
        for path in sorted({*_list_files(folder, allow_outside_links), *(folder / name for name in contents)}):
            name = path.relative_to(folder).as_posix()
            if path.suffix != PROSE and name != OWN_PREVIEW:
                content = contents[name] if name in contents else path.read_bytes()
                sha.update(f"{name}\0{len(content)}\0".encode() + content)
    except OSError as error:
        raise BadInput(f"{error.filename or folder} cannot be read: {error.strerror or error}") from error
    return sha.hexdigest()


def _list_files(folder: Path, allow_outside_links: bool) -> list[Path]:
    """Return every regular file in a folder and below it; linked folders are followed."""
    found: list[Path] = []
    todo: list[tuple[Path, tuple[str, ...]]] = [(folder, ())]
    seen = 0
    while todo:
        current, parents = todo.pop()
        parents = (*parents, os.path.realpath(current))  # to meet one of these again is to go in a circle
        for path in current.iterdir():
            seen += 1
            if seen > MAX_FILES:
                raise BadInput(f"{folder} holds more than {MAX_FILES:,} files", hint="remove what is not the scene's")
            if path.is_file():
                found.append(path)
            elif path.is_dir() and path.name != "__pycache__":
                _check_link(path, parents, allow_outside=allow_outside_links)
                todo.append((path, parents))
    return found


def _check_link(path: Path, parents: tuple[str, ...], *, allow_outside: bool) -> None:
    real = os.path.realpath(path)
    if real in parents:
        raise BadInput(f"{path} leads in a circle, back to {real}", hint="remove the link")
    if not (allow_outside or Path(real).is_relative_to(parents[0])):
        raise BadInput(
            f"{path} is a link to {real}",
            allowed="links within the scene's folder, for a scene.xml",
            hint=f"copy it into {parents[0]}",
        )
