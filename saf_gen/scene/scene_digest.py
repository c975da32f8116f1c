"""Digest of a scene folder, which shows whether a stored focal stack belongs to the scene as it is now."""

import hashlib
import os
from collections.abc import Mapping
from pathlib import Path

from saf_gen.errors import BadInput

MAX_FILES = 100_000  # files and folders of a scene; a link to an entire disk would lead to more
PROSE, PREVIEW_NAME = (".md", "preview.png")  # files that affect no rendered pixel; the preview at the top level only


def scene_folder_digest(folder: Path, *, contents: Mapping[str, bytes], allow_outside_links: bool) -> str:
    """Return the SHA-256 (hex) over the names and bytes of a folder's files.

    Markdown files, and ``preview.png`` at the top level, are left out. Files of a linked folder count under the name of
    the link.

    Parameters
    ----------
    folder : Path
        Folder of the scene.
    contents : mapping of str to bytes
        Bytes by file name, which replace the content of a file or add a file that is not in the folder.
    allow_outside_links : bool
        Whether links may lead out of the folder.

    Raises
    ------
    BadInput
        If a file or folder cannot be read, links form a circle or lead out of the folder without permission, or there
        are more than 100,000 files and folders.
    """
    sha = hashlib.sha256()
    try:
        for path in sorted({*_list_files(folder, allow_outside_links), *(folder / name for name in contents)}):
            name = path.relative_to(folder).as_posix()
            if path.suffix != PROSE and name != PREVIEW_NAME:
                content = contents[name] if name in contents else path.read_bytes()
                sha.update(f"{name}\0{len(content)}\0".encode() + content)
    except OSError as error:
        raise BadInput(f"{error.filename or folder} cannot be read: {error.strerror or error}") from error
    return sha.hexdigest()


def _list_files(folder: Path, allow_outside_links: bool) -> list[Path]:
    """Return all regular files in a folder and its subfolders; linked folders are followed."""
    found: list[Path] = []
    todo: list[tuple[Path, tuple[str, ...]]] = [(folder, ())]
    seen = 0
    while todo:
        current, parents = todo.pop()
        parents = (*parents, os.path.realpath(current))  # a link back to one of these forms a circle
        for path in current.iterdir():
            seen += 1
            if seen > MAX_FILES:
                raise BadInput(f"{folder} holds more than {MAX_FILES:,} files", hint="remove unrelated files")
            if path.is_file():
                found.append(path)
            elif path.is_dir() and path.name != "__pycache__":
                _check_link(path, parents, allow_outside=allow_outside_links)
                todo.append((path, parents))
    return found


def _check_link(path: Path, parents: tuple[str, ...], *, allow_outside: bool) -> None:
    real = os.path.realpath(path)
    if real in parents:
        raise BadInput(f"{path} is a link back to {real}, which contains it", hint="remove the link")
    if not (allow_outside or Path(real).is_relative_to(parents[0])):
        raise BadInput(
            f"{path} is a link to {real}",
            allowed="links within the scene's folder, for a scene.xml",
            hint=f"copy it into {parents[0]}",
        )
