"""Makes a dataset of any folder of streams: writes the manifest that lists them."""

import re
from pathlib import Path

from saf_gen.core.files import file_name_as_text
from saf_gen.errors import BadInput
from saf_gen.stream.manifest import MANIFEST_NAME, Manifest, SequenceEntry, write_manifest
from saf_gen.stream.stream_file import open_stream

OWN_NAME = re.compile(r"(?P<scene>.+?)(?P<moves>-dynamic)?-(?P<light>[a-z0-9_]+)-(?P<repeat>\d+)")
"""How this package names a sequence; of other names scene and light are taken to be the name itself and one."""


def index_streams_of_folder(folder: str | Path, *, split: str = "test") -> Manifest:
    """Write ``manifest.json`` for all streams (.h5) in a folder and below it, and return it.

    A sequence is named by its path, its folders joined by "-". A folder below is a split of its name, and what lies in
    the folder itself belongs to ``split``. Files are opened, not read through: ``saf-gen verify`` does that.

    Raises BadInput for a folder that is a dataset already, that has no stream, or in which a file is no stream.
    """
    root = Path(folder)
    if not root.is_dir():
        raise BadInput("there is no such folder", where=str(folder))
    if (root / MANIFEST_NAME).exists():
        raise BadInput(f"has a {MANIFEST_NAME}", where=str(folder), hint="remove it, and this command makes a new one")
    files = sorted(root.rglob("*.h5"))
    if not files:
        raise BadInput(
            "has no stream", where=str(folder), allowed="files *.h5, in it or below it", hint="saf-gen import"
        )
    manifest = Manifest(
        file_name_as_text(root.resolve().name), "", "recorded", tuple(_entry(root, file, split=split) for file in files)
    )
    write_manifest(root, manifest)
    return manifest


def _entry(root: Path, file: Path, *, split: str) -> SequenceEntry:
    inside = file.relative_to(root)
    if file_name_as_text(str(inside)) != str(inside):
        raise BadInput(f"the name of {file} is no UTF-8", allowed="names that a manifest can hold", hint="rename it")
    with open_stream(file) as stream:
        frames, content = stream.shape[0], stream.content_sha256
    own = OWN_NAME.fullmatch(inside.stem)
    return SequenceEntry(
        id="-".join((*inside.parts[:-1], inside.stem)),
        split=inside.parts[0] if len(inside.parts) > 1 else split,
        scene=own["scene"] if own else inside.stem,
        variant=0,
        scene_motion="dynamic" if own and own["moves"] else "static",
        lens_motion="recorded",
        light=own["light"] if own else "recorded",
        repeat=int(own["repeat"]) if own else 0,
        seed=0,
        file=inside.as_posix(),
        frames=frames,
        fingerprint=content,
        content_sha256=content,
    )
