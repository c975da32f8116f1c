"""Packing of a dataset into tar shards with an index of digests, for a server or the Hugging Face Hub."""

import json
import re
import tarfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from hashlib import file_digest
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, ClassVar

from pydantic import ConfigDict, FailFast, Field

from saf_gen.core.config.document import STRICT, Document, validate_document
from saf_gen.core.config.json_document import parse_json, read_json
from saf_gen.core.files import atomic_file, check_writable, file_sha256, refuse_link, write_folder, write_text
from saf_gen.core.plain_text import plural
from saf_gen.errors import BadInput
from saf_gen.stream.manifest import MANIFEST_NAME, Manifest, read_manifest, verify_entry
from saf_gen.stream.sharing.croissant import (
    CARD_NAME,
    DatasetFacts,
    croissant_of,
    front_matter,
    licence_urls,
    point_to_shards,
)

INDEX_NAME = "index.json"
FORMAT = "saf-gen shards"
LAYOUT = 1
FOLDER_NAME = r"(?![. ])[^\x00-\x1f\x7f/\\:*?\"<>|]{1,100}(?<![. ])"
MAX_INDEX_BYTES = 1 << 26
"""Largest size of an index, enough for about 300,000 streams; reading the index takes a dozen times as much memory."""

Bytes = Annotated[int, Field(strict=True, ge=0, le=1 << 60)]
Digest = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


@dataclass(frozen=True)
class PackedFile:
    """A file of a packed dataset: its path in the dataset folder (parts joined by '/'), its size and its SHA-256."""

    __pydantic_config__: ClassVar[ConfigDict] = STRICT

    file: str
    bytes: Bytes
    sha256: Digest


@dataclass(frozen=True)
class Shard:
    """A tar file that contains files of the dataset; it is in the folder of the index."""

    __pydantic_config__: ClassVar[ConfigDict] = STRICT

    file: str
    bytes: Bytes
    sha256: Digest
    members: Annotated[tuple[PackedFile, ...], FailFast()]


@dataclass(frozen=True)
class ShardIndex:
    """A packed dataset: its name, its shards, and the unpacked files in the folder of the index."""

    __pydantic_config__: ClassVar[ConfigDict] = STRICT

    name: str
    shards: Annotated[tuple[Shard, ...], FailFast()]
    files: Annotated[tuple[PackedFile, ...], FailFast()]

    @property
    def total_bytes(self) -> int:
        """Total number of bytes of all shards and files."""
        return sum(one.bytes for one in self.shards) + sum(one.bytes for one in self.files)


def write_shard_index(folder: Path, index: ShardIndex) -> None:
    """Write the index of a packed dataset into its folder."""
    document = {"format": FORMAT, "layout": LAYOUT, **asdict(index)}
    write_text(folder / INDEX_NAME, json.dumps(document, indent=1, ensure_ascii=False) + "\n")


def parse_shard_index(text: str, where: str) -> ShardIndex:
    """Return the index in a JSON text; ``where`` is its name in errors.

    Raises BadInput if the text is not an index, has another layout version, lists a file twice or outside the folder,
    or lacks the manifest.
    """
    document = parse_json(text, where)
    if not isinstance(document.data, dict) or document.data.pop("format", None) != FORMAT:
        raise BadInput("is not the index of a packed dataset", where=where, allowed=f'"format": "{FORMAT}"')
    if (layout := document.data.pop("layout", None)) != LAYOUT:
        raise BadInput(f"has layout {layout}", where=where, allowed=f"layout {LAYOUT}", hint="update saf_gen")
    index = validate_document(ShardIndex, document)
    _check_names(index, document)
    return index


def _check_names(index: ShardIndex, document: Document) -> None:
    where = document.locate()
    if not re.fullmatch(FOLDER_NAME, index.name):  # fetch makes a folder of this name
        raise BadInput(
            f"the dataset's name is {index.name!r}", where=where, hint="rename it in manifest.json",
            allowed="up to 100 characters, none of them / \\ : * ? \" < > |, and neither dots nor blanks at the ends",
        )  # fmt: skip
    outer_names = [*(one.file for one in index.shards), *(one.file for one in index.files)]
    member_names = [member.file for shard in index.shards for member in shard.members]
    for name in outer_names:
        if not is_plain_path(name) or "/" in name or name == INDEX_NAME:
            raise BadInput(
                f"has the file {name!r}", where=where, allowed="the name of a file in the folder of the index"
            )
    for name in member_names:
        if not is_plain_path(name):
            raise BadInput(f"has the member {name!r}", where=where, allowed="a relative path with '/', without ..")
    unpacked = Counter(name.casefold() for name in (*member_names, *(one.file for one in index.files)))
    for name, count in (unpacked + Counter(one.file.casefold() for one in index.shards)).items():
        if count > 1:
            raise BadInput(f"names {name!r} {count} times", where=where, allowed="each file once")
    if MANIFEST_NAME not in [one.file for one in index.files]:
        raise BadInput(f"has no {MANIFEST_NAME}", where=where, hint="pack the dataset again")


def is_plain_path(name: str) -> bool:
    """Return whether a name is a relative path, without hidden parts, that means the same on every system."""
    parts = PurePosixPath(name).parts
    plain = all(re.fullmatch(r"[^\x00-\x1f\\:*?\"<>|/]{1,255}", part) and not part.startswith(".") for part in parts)
    return bool(parts) and plain and "/".join(parts) == name


README = "README.md"
STACKS = "stacks"


@dataclass(frozen=True)
class PackedDataset:
    """A packed dataset: its index, the SHA-256 of the index file, and the keys that its card still lacks."""

    index: ShardIndex
    index_sha256: str
    missing: tuple[str, ...]


def pack_dataset(
    dataset: str | Path,
    out: str | Path,
    *,
    shard_bytes: int = 1_000_000_000,
    stacks: bool = False,
    licences: Sequence[str] = (),
    url: str = "",
    creator: str = "",
    report: Callable[[int, int], None] = lambda done, total: None,
) -> PackedDataset:
    """Write the shards of a dataset, its cards and its index into a folder.

    A shard is a tar file of complete streams of one split, which WebDataset can also read; the same dataset gives the
    same bytes. Before anything is packed, each stream is read and compared with the manifest. Everything is written
    into a hidden folder next to ``out``, which is renamed at the end; an interrupted command starts from the beginning
    when it is run again.

    Parameters
    ----------
    dataset : str or Path
        Dataset folder.
    out : str or Path
        Folder to write, which must be empty or missing.
    shard_bytes : int, default 1000000000
        Largest total size of the files in a shard, in bytes; a larger file gets its own shard.
    stacks : bool, default False
        Whether to pack the focal stacks too, which the closed loop needs.
    licences : sequence of str, optional
        SPDX names; required if the dataset has no ``croissant.json`` that states them.
    url, creator : str, optional
        Address of the published dataset, and its publisher, for its card.
    report : callable, optional
        Called with the number of bytes packed and the total number.

    Returns
    -------
    PackedDataset
        The index, its SHA-256, and the keys that the card still lacks.

    Raises
    ------
    BadInput
        If the folder is not a dataset or is damaged, if no licence is stated, or if ``out`` is not empty.
    """
    source, target = Path(dataset), Path(out)
    refuse_link(target)
    manifest = read_manifest(source)
    if not manifest.sequences:
        raise BadInput("has no sequence", where=str(source), hint="make some with saf-gen generate")
    if target.exists() and (not target.is_dir() or any(target.iterdir())):
        holds = "already holds this dataset, completely packed" if _is_packed(source, target) else "is not empty"
        raise BadInput(f"{target} {holds}", hint="give another folder with --out, or remove it")
    card = _read_card(source, manifest, licences=licences, url=url, creator=creator)
    check_writable(target)
    groups = _group_files(source, manifest, stacks=stacks)
    for entry in manifest.sequences:
        verify_entry(source, entry)
    with write_folder(target.absolute()) as part:
        index = _write_all(
            source, part, groups=groups, manifest=manifest, card=card, report=report, shard_bytes=shard_bytes
        )
    missing = tuple(key for key in ("url", "creator") if key not in card)
    return PackedDataset(index, file_sha256(target / INDEX_NAME), missing)


def _is_packed(source: Path, target: Path) -> bool:
    """Return whether the folder ``target`` holds the shards of the dataset in ``source``."""
    try:
        index = parse_shard_index((target / INDEX_NAME).read_text(encoding="utf-8"), INDEX_NAME)
        listed = [file.sha256 for file in index.files if file.file == MANIFEST_NAME]
        return listed == [file_sha256(source / MANIFEST_NAME)]
    except (OSError, ValueError, BadInput):
        return False


def _group_files(source: Path, manifest: Manifest, *, stacks: bool) -> dict[str, list[str]]:
    """Return the files to pack by group: one group for each split and, if requested, one for the focal stacks."""
    groups = {split: [e.file for e in manifest.sequences if e.split == split] for split in manifest.splits}
    for split in groups:
        if "/" in split or not is_plain_path(split):
            raise BadInput(f"split {split!r} cannot begin the name of a file", where=str(source / MANIFEST_NAME))
    if stacks:
        found = (p.relative_to(source).as_posix() for p in sorted((source / STACKS).rglob("*")) if p.is_file())
        kept = [name for name in found if is_plain_path(name)]  # no temporary files
        if not kept:
            raise BadInput(f"{source / STACKS} holds no focal stack", hint="leave --stacks out")
        groups[STACKS] = groups.get(STACKS, []) + kept
    return groups


def _write_all(
    source: Path,
    target: Path,
    *,
    groups: dict[str, list[str]],
    manifest: Manifest,
    card: dict[str, Any],
    report: Callable[[int, int], None],
    shard_bytes: int,
) -> ShardIndex:
    """Write shards, cards and index into a folder; raise BadInput if fetching would refuse the index."""
    total = sum((source / name).stat().st_size for names in groups.values() for name in names)
    shards: list[Shard] = []
    done = 0
    for group, names in groups.items():
        for number, batch in enumerate(_batches(source, names, shard_bytes=shard_bytes)):
            shards.append(_write_shard(target / f"{group}-{number:05d}.tar", source, names=batch))
            done += sum(member.bytes for member in shards[-1].members)
            report(done, total)
    described = point_to_shards(card, {shard.file: shard.sha256 for shard in shards})
    texts = {
        MANIFEST_NAME: (source / MANIFEST_NAME).read_text(encoding="utf-8"),
        CARD_NAME: json.dumps(described, indent=1, ensure_ascii=False) + "\n",
        README: _readme(source, manifest, licences=_licence_names(card)),
    }
    for name, text in texts.items():
        write_text(target / name, text)
    files = tuple(PackedFile(name, (target / name).stat().st_size, file_sha256(target / name)) for name in texts)
    write_shard_index(target, ShardIndex(manifest.name, tuple(shards), files))
    return parse_shard_index((target / INDEX_NAME).read_text(encoding="utf-8"), INDEX_NAME)


def _read_card(source: Path, manifest: Manifest, *, licences: Sequence[str], url: str, creator: str) -> dict[str, Any]:
    """Return the Croissant description of a dataset, made from the manifest if the dataset has none."""
    path = source / CARD_NAME
    digest = file_sha256(source / MANIFEST_NAME)
    if path.is_file():
        card = read_json(path, hint="write it again with saf-gen generate").data
        if not isinstance(card, dict) or "distribution" not in card:
            raise BadInput(
                "is not a description of a dataset", where=str(path), hint="write it again with saf-gen generate"
            )
        card["distribution"] = croissant_of(manifest, DatasetFacts("", ()), digest=digest)["distribution"]
    else:
        described = f"Spike-camera recordings with lens positions: {plural(len(manifest.sequences), 'sequence')}."
        card = croissant_of(manifest, DatasetFacts(described, licences), digest=digest)
    if not licences and not card.get("license"):
        raise BadInput(
            f"the licence of {source} is not stated", hint="state one with --licence NAME, such as CC-BY-4.0"
        )
    if licences:
        card["license"] = licence_urls(licences)
    if url:
        card["url"] = url
    if creator:
        card["creator"] = {"@type": "sc:Organization", "name": creator}
    return card


def _licence_names(card: dict[str, Any]) -> list[str]:
    licences = card["license"] if isinstance(card["license"], list) else [card["license"]]
    return [str(one).rpartition("/")[2] for one in licences]


def _readme(source: Path, manifest: Manifest, *, licences: Sequence[str]) -> str:
    """Return the README of the dataset with front matter that refers to the shards."""
    path = source / README
    text = path.read_text(encoding="utf-8", errors="replace") if path.is_file() else f"# {manifest.name}\n"
    body = re.sub(r"\A---\n.*?^---\n", "", text, flags=re.DOTALL | re.MULTILINE)
    return front_matter(manifest, licences, pattern="{split}-*.tar") + body


def _batches(source: Path, names: Sequence[str], *, shard_bytes: int) -> Iterator[list[str]]:
    batch: list[str] = []
    size = 0
    for name in names:
        bytes_of_file = (source / name).stat().st_size
        if batch and size + bytes_of_file > shard_bytes:
            yield batch
            batch, size = [], 0
        batch.append(name)
        size += bytes_of_file
    yield batch


def _write_shard(path: Path, source: Path, *, names: Sequence[str]) -> Shard:
    """Write one tar file, without times, owners and permissions of this machine."""
    members = []
    with atomic_file(path) as part, tarfile.open(part, "w", format=tarfile.PAX_FORMAT) as tar:
        for name in names:
            with (source / name).open("rb") as file:
                digest = file_digest(file, "sha256").hexdigest()
                info = tarfile.TarInfo(name)
                info.size = file.tell()
                file.seek(0)
                tar.addfile(info, file)
            members.append(PackedFile(name, info.size, digest))
    return Shard(path.name, path.stat().st_size, file_sha256(path), tuple(members))
