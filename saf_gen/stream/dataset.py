"""Datasets of existing streams: the manifest that lists them, and the check of every file against it."""

import re
from collections.abc import Callable
from pathlib import Path

from saf_gen.camera.kinds import kinds_of_cameras
from saf_gen.core.files import name_as_text
from saf_gen.core.plain_text import plural
from saf_gen.errors import BadInput
from saf_gen.stream.manifest import MANIFEST_NAME, Manifest, SequenceEntry, read_manifest, verify_entry, write_manifest
from saf_gen.stream.metadata import Metadata
from saf_gen.stream.recordings import open_recording
from saf_gen.stream.sharing.croissant import RECORDED, DatasetFacts, write_croissant

SEQUENCE_NAME = re.compile(r"(?P<scene>.+?)(?P<moves>-dynamic)?-(?P<light>[^-]+)-(?P<repeat>\d+)")
"""Names of sequences, as this package writes them: SCENE-LIGHT-NUMBER.

Any other name is taken as the name of the scene, and its light is UNNAMED_LIGHT.
"""
UNNAMED_LIGHT = "recorded"


def index_folder(folder: str | Path, *, split: str = "test") -> Manifest:
    """Write ``manifest.json`` and ``croissant.json`` for the recordings (.h5) in and below a folder; return the first.

    They hold spikes, photons, events or frames. The id of a sequence is its path, joined with "-". Recordings in a
    subfolder belong to the split that has the name of the subfolder, and those in the folder itself to ``split``. Files
    and folders whose names begin with a dot, which systems and editors write, are left out. Each recording is read
    completely, so that the digests that the manifest lists are those of its content.

    Raises BadInput if the folder is missing, is a dataset already, has no recording, contains an .h5 file that is none
    or is damaged, holds events or frames beside recordings of another kind, or has two recordings with the same id.
    """
    root = Path(folder)
    if not root.is_dir():
        raise BadInput("there is no such folder", where=str(folder))
    if (root / MANIFEST_NAME).exists():
        raise BadInput(f"has a {MANIFEST_NAME}", where=str(folder), hint="remove it and run this command again")
    files = [file for file in sorted(root.rglob("*.h5")) if not is_hidden(file, root)]
    if not files:
        raise BadInput(
            "has no recording",
            where=str(folder),
            allowed="files *.h5, in it or below it",
            hint="make one with saf-gen import",
        )
    kinds: dict[str, str] = {}
    entries = tuple(_entry(root, file, split=split, kinds=kinds) for file in files)
    if len(kinds) > 1 and not kinds.keys() <= {*kinds_of_cameras("bits")}:
        raise BadInput(
            " and ".join(f"{file} holds {kind}" for kind, file in list(kinds.items())[:2]), where=str(folder),
            allowed="recordings of one kind", hint="give each kind a folder of its own",
        )  # fmt: skip
    by_id: dict[str, str] = {}
    for entry in entries:
        other = by_id.setdefault(entry.id, entry.file)
        if other != entry.file:
            raise BadInput(
                f"{other} and {entry.file} have the same id, {entry.id!r}", where=str(folder),
                allowed="paths that differ when their parts are joined with -", hint="rename one of them",
            )  # fmt: skip
    manifest = Manifest(name_as_text(root.resolve().name), "", "recorded", entries)
    write_manifest(root, manifest)
    described = f"Recordings of {' and '.join(sorted(kinds))} with moving focus: {plural(len(entries), 'sequence')}."
    write_croissant(root, manifest, facts=DatasetFacts(described, [], responsible=RECORDED))
    return manifest


def is_hidden(file: Path, root: Path) -> bool:
    """Return whether the name of a file, or of a folder between it and ``root``, begins with a dot."""
    return any(part.startswith(".") for part in file.relative_to(root).parts)


def _entry(root: Path, file: Path, *, split: str, kinds: dict[str, str]) -> SequenceEntry:
    """Return the entry of a recording, and note it in ``kinds`` if it is the first of its kind."""
    inside = file.relative_to(root)
    if name_as_text(str(inside)) != str(inside):
        raise BadInput(f"the name of {file} is not UTF-8", allowed="names that a manifest can hold", hint="rename it")
    with open_recording(file) as stream:
        stream.verify()
        frames, content = stream.shape[0], stream.content_sha256
        kinds.setdefault(stream.counted, inside.as_posix())
    named = SEQUENCE_NAME.fullmatch(inside.stem)
    return SequenceEntry(
        id="-".join((*inside.parts[:-1], inside.stem)),
        split=inside.parts[0] if len(inside.parts) > 1 else split,
        scene=named["scene"] if named else inside.stem,
        variant=0,
        scene_motion="dynamic" if named and named["moves"] else "static",
        lens_motion="recorded",
        light=named["light"] if named else UNNAMED_LIGHT,
        repeat=int(named["repeat"]) if named else 0,
        seed=0,
        file=inside.as_posix(),
        frames=frames,
        fingerprint=content,
        content_sha256=content,
    )


def verify_dataset(
    folder: str | Path, *, report: Callable[[str, Metadata], None] = lambda name, metadata: None
) -> tuple[int, dict[str, str]]:
    """Read every sequence of a dataset and compare it with the manifest.

    Returns the number of sequences, and the problems of faulty sequences by id; ``report`` is called with the id and
    the metadata of each that is intact. Raises BadInput if the manifest is missing or cannot be used.
    """
    manifest = read_manifest(folder)
    problems = {}
    for entry in manifest.sequences:
        try:
            report(entry.id, verify_entry(folder, entry))
        except BadInput as error:
            problems[entry.id] = str(error)
    return len(manifest.sequences), problems
