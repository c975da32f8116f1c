"""A dataset folder: its manifest, the list of sequences that generate writes and evaluate reads.

``manifest.json`` stands beside ``<split>/<id>.h5``. It is written whole or not at all, and read strictly: a
folder without a readable manifest is no dataset.
"""

import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path, PurePosixPath
from typing import Any

from saf_gen.core.files import write_atomically
from saf_gen.errors import BadInput, closest, unknown
from saf_gen.stream.stream_file import open_stream

__all__ = [
    "MANIFEST_NAME",
    "Manifest",
    "SequenceEntry",
    "read_manifest",
    "verify_entry",
    "write_manifest",
    "write_text_atomically",
]

MANIFEST_NAME = "manifest.json"
FORMAT = "saf-gen dataset"
LAYOUT = 1


@dataclass(frozen=True)
class SequenceEntry:
    """One sequence: what it is, where its stream lies (``file``, relative, with '/'), what it must hold.

    ``variant`` counts the members of the scene's family, ``scene_motion`` is ``static`` or ``dynamic``,
    ``lens_motion`` the kind of the lens's.
    ``fingerprint`` is of the plan it was made from, ``content_sha256`` of the stream's content.
    """

    id: str
    split: str
    scene: str
    variant: int
    scene_motion: str
    lens_motion: str
    light: str
    repeat: int
    seed: int
    file: str
    frames: int
    fingerprint: str
    content_sha256: str


@dataclass(frozen=True)
class Manifest:
    """A dataset: its name, the fingerprint of its recipe, the render variant, its sequences."""

    name: str
    recipe_fingerprint: str
    variant: str
    sequences: tuple[SequenceEntry, ...]

    @property
    def splits(self) -> tuple[str, ...]:
        """The names of the splits, in the order of the sequences."""
        return tuple(dict.fromkeys(s.split for s in self.sequences))


def read_manifest(folder: str | os.PathLike[str]) -> Manifest:
    """The manifest of a dataset folder.

    Raises BadInput when the folder or its manifest is missing, is no JSON, is of a newer layout, or holds an
    unknown or missing key, a value of the wrong type, an id twice, or a file outside the folder.
    """
    where = Path(folder)
    if not where.is_dir():
        if where.exists():
            raise BadInput("this is no folder", where=str(folder), allowed="a dataset folder")
        others = [p.name for p in where.parent.iterdir() if p.is_dir()] if where.parent.is_dir() else []
        raise BadInput("there is no such folder", where=str(folder), nearest=closest(where.name, others))
    path = where / MANIFEST_NAME
    if not path.is_file():
        raise BadInput(
            f"has no {MANIFEST_NAME}", where=str(folder), hint="make the dataset with saf-gen generate"
        )
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, OSError) as error:
        raise BadInput(
            f"is no readable JSON: {error}", where=str(path), hint="remove it and run saf-gen generate again"
        ) from error
    if not isinstance(document, dict) or document.pop("format", None) != FORMAT:
        raise BadInput("is no manifest of a dataset", where=str(path), allowed=f'"format": "{FORMAT}"')
    if (layout := document.pop("layout", None)) != LAYOUT:
        raise BadInput(
            f"has layout {layout}", where=str(path), allowed=f"layout {LAYOUT}", hint="update saf_gen"
        )
    listed = document.get("sequences")
    if not isinstance(listed, list):
        raise BadInput("sequences is no list", where=str(path), allowed="a list of sequences")
    entries = tuple(_parsed(SequenceEntry, s, f"{path}, sequence {i}") for i, s in enumerate(listed))
    manifest = _parsed(Manifest, {**document, "sequences": entries}, str(path))
    for entry in entries:
        _check_file(entry, path)
    ids = [s.id for s in entries]
    for twice in {i for i in ids if ids.count(i) > 1} if len(set(ids)) < len(ids) else ():
        raise BadInput(f"the id {twice!r} stands twice", where=str(path), allowed="each id once")
    return manifest


def verify_entry(folder: str | os.PathLike[str], entry: SequenceEntry) -> None:
    """Read the whole stream of ``entry``. Raises BadInput when it is missing, damaged or not as listed."""
    with open_stream(Path(folder) / entry.file) as stream:
        where, frames = str(stream.path), stream.shape[0]
        if stream.content_sha256 != entry.content_sha256 or frames != entry.frames:
            raise BadInput(
                f"holds {frames} frames with the SHA-256 {stream.content_sha256:.12}...",
                where=where,
                allowed=f"{entry.frames} frames, {entry.content_sha256:.12}... as in {MANIFEST_NAME}",
                hint="make it again",
            )
        stream.verify()


def write_manifest(folder: str | os.PathLike[str], manifest: Manifest) -> None:
    """Write ``manifest`` into ``folder``, which is made if missing. Raises BadInput when it cannot be."""
    path = Path(folder) / MANIFEST_NAME
    for entry in manifest.sequences:
        _check_file(entry, path)
    document = {"format": FORMAT, "layout": LAYOUT, **asdict(manifest)}
    write_text_atomically(path, json.dumps(document, indent=1, ensure_ascii=False) + "\n")


def write_text_atomically(path: str | os.PathLike[str], text: str) -> None:
    """Write a text file so that it is there whole or not at all; its folder is made if missing.

    Raises BadInput when the disk is full or the folder cannot be written.
    """
    with write_atomically(path) as part:
        part.write_text(text, encoding="utf-8")


def _check_file(entry: SequenceEntry, path: Path) -> None:
    file = PurePosixPath(entry.file)
    if not entry.file or file.is_absolute() or ".." in file.parts or "\\" in entry.file:
        raise BadInput(
            f"sequence {entry.id!r} has the file {entry.file!r}",
            where=str(path),
            allowed="a relative path inside the dataset folder, with '/'",
        )


def _parsed(cls: type, given: Any, where: str) -> Any:
    known = {f.name: f.type for f in fields(cls)}
    if not isinstance(given, Mapping):
        raise BadInput(f"{given!r:.60} is no mapping", where=where, allowed=", ".join(known))
    for key in given:
        if key not in known:
            raise unknown("key", key, allowed=known, where=where)
    for key, kind in known.items():
        if key not in given:
            raise BadInput(f"{key} is missing", where=where, allowed=", ".join(known))
        if kind in (str, int) and type(given[key]) is not kind:
            allowed = "text" if kind is str else "a whole number"
            raise BadInput(f"{key} is {given[key]!r:.60}", where=where, allowed=allowed)
    return cls(**given)
