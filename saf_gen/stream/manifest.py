"""The manifest of a dataset folder: the list of sequences that `generate` writes and `evaluate` reads.

``manifest.json`` is next to the folders ``<split>/``, which contain the streams ``<id>.h5``. It is written completely
or not at all, and read strictly; a folder without a readable manifest is not a dataset. ``sequences.csv`` beside it is
the same list as a table for other programs; nothing reads it here.
"""

import csv
import io
import os
import shlex
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path, PurePosixPath
from typing import Annotated, ClassVar

from pydantic import ConfigDict, FailFast, Field

from saf_gen.core.config.document import STRICT, read_text, validate_document
from saf_gen.core.config.json_document import format_checked_json, parse_checked_json
from saf_gen.core.files import check_on_disk, check_ours, file_sha256, write_text
from saf_gen.errors import BadInput, closest, escape_controls, unknown
from saf_gen.stream.metadata import Metadata
from saf_gen.stream.recordings import Recording, open_recording

MANIFEST_NAME, TABLE_NAME = "manifest.json", "sequences.csv"
TABLE_MARK = "id,split,scene,"
"""The beginning of the table, by which it is known as ours."""
FORMAT = "saf-gen dataset"
LAYOUT = 1
HINT = "remove it and run saf-gen generate again"
TRAIN_SPLIT, TEST_SPLIT = "train", "test"
ALL_SPLITS = "all"
"""The word that selects all splits together where the name of a split is expected."""

StrictInteger = Annotated[int, Field(strict=True)]
SequenceCount = Annotated[int, Field(strict=True, ge=0, le=1 << 32)]


@dataclass(frozen=True)
class SequenceEntry:
    """One sequence of a dataset.

    Attributes
    ----------
    variant : int
        Number of the member in its scene family.
    scene_motion : str
        ``static`` or ``dynamic``.
    lens_motion : str
        Kind of lens motion.
    file : str
        Path of the stream in the dataset folder, with '/'.
    fingerprint : str
        SHA-256 of the plan from which the sequence was made.
    content_sha256 : str
        SHA-256 of the content of the stream.
    """

    __pydantic_config__: ClassVar[ConfigDict] = STRICT

    id: str
    split: str
    scene: str
    variant: StrictInteger
    scene_motion: str
    lens_motion: str
    light: str
    repeat: StrictInteger
    seed: StrictInteger
    file: str
    frames: StrictInteger
    fingerprint: str
    content_sha256: str


@dataclass(frozen=True)
class PublishedFile:
    """A file that others may fetch: its path in the dataset folder, with '/', its size in bytes, and its SHA-256."""

    __pydantic_config__: ClassVar[ConfigDict] = STRICT

    file: str
    bytes: Annotated[int, Field(strict=True, ge=0, le=1 << 60)]
    sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


@dataclass(frozen=True)
class Manifest:
    """A dataset: its name, the fingerprint of its recipe, its backend (``variant``), and its sequences.

    ``planned`` states how many sequences of each split its recipe makes, if it has one; those that are not made yet are
    not listed. ``files`` are the files of its streams as :func:`write_manifest` found them. They belong to the copy on
    this disk: the same content may be stored in other bytes, so that manifests are compared without them.
    """

    __pydantic_config__: ClassVar[ConfigDict] = STRICT

    name: str
    recipe_fingerprint: str
    variant: str
    sequences: Annotated[tuple[SequenceEntry, ...], FailFast()]
    files: Annotated[tuple[PublishedFile, ...], FailFast()] = field(default=(), compare=False)
    planned: Mapping[str, SequenceCount] = field(default_factory=dict, hash=False)

    @property
    def splits(self) -> tuple[str, ...]:
        """The names of the splits, in the order of the sequences."""
        return tuple(dict.fromkeys(s.split for s in self.sequences))

    def count_unmade(self, splits: Collection[str]) -> int:
        """Return how many sequences of some splits the recipe makes besides those that are listed."""
        listed = sum(entry.split in splits for entry in self.sequences)
        return max(sum(self.planned.get(split, 0) for split in splits) - listed, 0)

    @property
    def file_digests(self) -> dict[str, str]:
        """SHA-256 of each file that is listed with one, by its path in the dataset folder."""
        return {file.file: file.sha256 for file in self.files}

    @property
    def default_split(self) -> str | None:
        """The split that is ranked if none is named: ``test``, or the only one; otherwise None."""
        if TEST_SPLIT in self.splits:
            return TEST_SPLIT
        return self.splits[0] if len(self.splits) == 1 else None

    def select_splits(self, name: str, *, where: str) -> tuple[str, ...]:
        """Return the split of this name, or every split if the name is ``all``.

        Raises BadInput, with the dataset ``where``, if there is no such split, or if ``all`` is also one of several
        splits.
        """
        if name == ALL_SPLITS:
            if ALL_SPLITS in self.splits and len(self.splits) > 1:
                raise BadInput(
                    f"{ALL_SPLITS!r} could mean all splits, or the split of this name",
                    where=where,
                    allowed=", ".join(split for split in self.splits if split != ALL_SPLITS),
                    hint="rename this split, and make the dataset again",
                )
            return self.splits
        if name not in self.splits:
            raise unknown("split", name, allowed={*self.splits, ALL_SPLITS}, where=where)
        return (name,)

    def next_command(self, folder: str | os.PathLike[str]) -> str:
        """Return the command that ranks methods on this dataset; it names a split if there is no default."""
        named = [split for split in self.splits if split != ALL_SPLITS]
        option = f" --split {shlex.quote(named[-1])}" if named and self.default_split is None else ""
        return escape_controls(f"saf-gen evaluate {shlex.quote(str(folder))}{option}")


def check_single_split(splits: Sequence[str], *, where: str) -> None:
    """Raise BadInput if a dataset has several splits, since what trains without the name of one would mix them.

    It would then be judged by recordings from which it has learned.
    """
    if len(splits) > 1:
        names = [split for split in splits if split != TEST_SPLIT]
        name = TRAIN_SPLIT if TRAIN_SPLIT in names else names[0]
        raise BadInput(
            "no split is given",
            where=where,
            allowed=f"{', '.join(splits)}, or {ALL_SPLITS}",
            hint=f'train with split="{name}", or with another one except {TEST_SPLIT}',
        )


def read_manifest(folder: str | os.PathLike[str]) -> Manifest:
    """Return the manifest of a dataset folder.

    Raises BadInput if the folder or its manifest is missing, or if the manifest is not JSON, has another layout
    version, an unknown or missing key, a value of the wrong type, a repeated id or a file outside the folder, or was
    changed since it was written.
    """
    where = Path(folder)
    check_on_disk(where)
    if not where.is_dir():
        if where.exists():
            raise BadInput("this is not a folder", where=str(where), allowed="a dataset folder")
        others = [p.name for p in where.parent.iterdir() if p.is_dir()] if where.parent.is_dir() else []
        raise BadInput("there is no such folder", where=str(where), nearest=closest(where.name, others))
    path = where / MANIFEST_NAME
    if not path.is_file():
        raise BadInput(f"has no {MANIFEST_NAME}", where=str(where), hint="make the dataset with saf-gen generate")
    return parse_manifest(read_text(path, hint=HINT), path)


def parse_manifest(text: str, path: str | Path) -> Manifest:
    """Return the manifest in a JSON text; ``path`` is its name in errors. Raises BadInput as read_manifest does."""
    document = parse_checked_json(text, path, hint=HINT)
    if not isinstance(document.data, dict) or document.data.pop("format", None) != FORMAT:
        raise BadInput("is not the manifest of a dataset", where=str(path), allowed=f'"format": "{FORMAT}"')
    if (layout := document.data.pop("layout", None)) != LAYOUT:
        raise BadInput(f"has layout {layout}", where=str(path), allowed=f"layout {LAYOUT}", hint="update saf_gen")
    manifest = validate_document(Manifest, document, hint=HINT)
    for i, entry in enumerate(manifest.sequences):
        if not _is_inside(entry.file):
            raise _outside(entry, document.locate("sequences", i, "file"))
    for name, count in Counter(entry.id for entry in manifest.sequences).items():
        if count > 1:
            raise BadInput(f"the id {name!r} occurs {count} times", where=str(path), allowed="each id once")
    return manifest


def check_entry(recording: Recording, entry: SequenceEntry) -> None:
    """Raise BadInput unless an open recording states the digest and the frames of ``entry``."""
    frames = recording.shape[0]
    if recording.content_sha256 != entry.content_sha256 or frames != entry.frames:
        raise BadInput(
            f"holds {frames} frames with the SHA-256 {recording.content_sha256:.12}...",
            where=str(recording.path),
            allowed=f"{entry.frames} frames, {entry.content_sha256:.12}... as in {MANIFEST_NAME}",
            hint="make it again",
        )


def check_content(recording: Recording, listed: str | None) -> None:
    """Read all bytes of an open recording; raise BadInput unless they hold what its ``content_sha256`` says.

    ``listed`` is the SHA-256 of its file in the manifest, which was written when the content was known. The bytes as
    stored are a fraction of the content. Only if they are others, because another program stored the same content or
    because something was changed, or if there is no manifest, the content itself is decompressed and compared.
    """
    if listed is None or file_sha256(recording.path) != listed:
        recording.verify()


def verify_entry(folder: str | os.PathLike[str], entry: SequenceEntry) -> Metadata:
    """Read the complete stream of ``entry`` and return its metadata.

    Raises BadInput if it is missing, damaged or differs from ``entry``.
    """
    with open_recording(Path(folder) / entry.file) as stream:
        check_entry(stream, entry)
        stream.verify()
        return stream.metadata


def write_manifest(folder: str | os.PathLike[str], manifest: Manifest) -> None:
    """Write ``manifest`` and its table into ``folder``, which is created if it is missing.

    Size and SHA-256 of each stream are taken from the disk. A stream that is missing, a link, or in a linked folder has
    none, because it cannot be fetched. Raises BadInput if a file cannot be written, or if the table would replace a
    file that saf-gen did not write.
    """
    root = Path(folder)
    path = root / MANIFEST_NAME
    for entry in manifest.sequences:
        if not _is_inside(entry.file):
            raise _outside(entry, str(path))
    names = [name for name in dict.fromkeys(entry.file for entry in manifest.sequences) if is_own_file(root, name)]
    files = [PublishedFile(name, (root / name).stat().st_size, file_sha256(root / name)) for name in names]
    write_table(root, manifest)
    document = {"format": FORMAT, "layout": LAYOUT, **asdict(replace(manifest, files=tuple(files)))}
    write_text(path, format_checked_json(document, indent=1) + "\n")


def write_table(folder: Path, manifest: Manifest) -> None:
    """Write the sequences of a manifest as ``sequences.csv``; raise BadInput as :func:`write_manifest` does."""
    check_ours(folder / TABLE_NAME, TABLE_MARK)
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(column.name for column in fields(SequenceEntry))
    table.writerows(asdict(entry).values() for entry in manifest.sequences)
    write_text(folder / TABLE_NAME, text.getvalue())


def is_own_file(folder: Path, file: str) -> bool:
    """Return whether a path in a folder is a file to which no link leads on the way."""
    path = folder / file
    way = [path, *path.parents][: len(PurePosixPath(file).parts)]
    return path.is_file() and not any(part.is_symlink() for part in way)


def stem_of(entry: SequenceEntry, *, where: str) -> str:
    """Return SPLIT/ID of a sequence, by which files of it are named; raise BadInput if one of them is a path itself."""
    for key, name in (("id", entry.id), ("split", entry.split)):
        if not _is_inside(name) or "/" in name:
            raise BadInput(f"the {key} {name!r}", where=where, allowed="a name without / and \\")
    return f"{entry.split}/{entry.id}"


def _is_inside(file: str) -> bool:
    path = PurePosixPath(file)
    return bool(file) and not path.is_absolute() and ".." not in path.parts and "\\" not in file


def _outside(entry: SequenceEntry, where: str) -> BadInput:
    return BadInput(
        f"sequence {entry.id!r} has the file {entry.file!r}",
        where=where,
        allowed="a relative path inside the dataset folder, with '/'",
    )
