"""Packs a dataset into tar shards with an index of digests, as one puts it on a server or the Hugging Face Hub."""

import json
import re
import tarfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from hashlib import file_digest
from pathlib import Path
from typing import Any

from saf_gen.core.config.json_document import read_json
from saf_gen.core.files import check_folder_writable, write_atomically, write_folder_atomically, write_text_atomically
from saf_gen.errors import BadInput
from saf_gen.stream.manifest import MANIFEST_NAME, Manifest, read_manifest, verify_manifest_entry
from saf_gen.stream.sharing.croissant import (
    CARD_NAME,
    DatasetFacts,
    describe_dataset_as_croissant,
    front_matter_for_sharing,
    licence_urls_for_croissant,
    point_croissant_to_shards,
    sha256_of_shared_file,
)
from saf_gen.stream.sharing.shard_index import (
    INDEX_NAME,
    PackedFile,
    Shard,
    ShardIndex,
    is_plain_path_in_shard,
    parse_shard_index,
    write_shard_index,
)

README = "README.md"
STACKS = "stacks"


@dataclass(frozen=True)
class Packed:
    """What was packed: the index, the SHA-256 of its file, and what its card does not say yet."""

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
) -> Packed:
    """Write the shards of a dataset, its cards and its index into a folder.

    A shard is a tar of whole streams of one split, which WebDataset reads too; the same dataset gives the same bytes.
    Each stream is read and held against the manifest before it is packed. All is written into a hidden folder beside
    ``out`` and gets its name in the end; after a stop the same command begins anew.

    Parameters
    ----------
    dataset, out : the dataset's folder, and a folder that is empty or to be made.
    shard_bytes : streams are added to a shard while it stays below this size.
    stacks : pack the focal stacks too, which the closed loop needs.
    licences : SPDX names; needed where the dataset has no ``croissant.json`` that tells them.
    url, creator : where it will be published, and who publishes it, for its card.
    report : called with bytes packed and bytes in all.

    Raises
    ------
    BadInput : a dataset that is no dataset or is damaged, no licence, or a folder that is not empty.
    """
    source, target = Path(dataset), Path(out)
    manifest = read_manifest(source)
    if not manifest.sequences:
        raise BadInput("has no sequence", where=str(source), hint="saf-gen generate")
    if target.exists() and (not target.is_dir() or any(target.iterdir())):
        holds = "holds this dataset, packed whole" if _is_packed(source, target) else "is not empty"
        raise BadInput(f"{target} {holds}", hint="give another folder with --out, or remove it")
    card = _read_card(source, manifest, licences=licences, url=url, creator=creator)
    check_folder_writable(target)
    groups = _group_files(source, manifest, stacks=stacks)
    for entry in manifest.sequences:
        verify_manifest_entry(source, entry)
    with write_folder_atomically(target.absolute()) as part:
        index = _write_all(
            source, part, groups=groups, manifest=manifest, card=card, report=report, shard_bytes=shard_bytes
        )
    missing = tuple(key for key in ("url", "creator") if key not in card)
    return Packed(index, sha256_of_shared_file(target / INDEX_NAME), missing)


def _is_packed(source: Path, target: Path) -> bool:
    """Return whether a folder holds the shards of this very dataset."""
    try:
        index = parse_shard_index((target / INDEX_NAME).read_text(encoding="utf-8"), INDEX_NAME)
        listed = [file.sha256 for file in index.files if file.file == MANIFEST_NAME]
        return listed == [sha256_of_shared_file(source / MANIFEST_NAME)]
    except (OSError, ValueError, BadInput):
        return False


def _group_files(source: Path, manifest: Manifest, *, stacks: bool) -> dict[str, list[str]]:
    """Return the files to pack by what their shards are called: the splits, and the focal stacks."""
    groups = {split: [e.file for e in manifest.sequences if e.split == split] for split in manifest.splits}
    for split in groups:
        if "/" in split or not is_plain_path_in_shard(split):
            raise BadInput(f"split {split!r} cannot begin the name of a file", where=str(source / MANIFEST_NAME))
    if stacks:
        found = (p.relative_to(source).as_posix() for p in sorted((source / STACKS).rglob("*")) if p.is_file())
        kept = [name for name in found if is_plain_path_in_shard(name)]  # no temporary files
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
    """Write shards, cards and index into a folder; raises BadInput for names that nobody could fetch."""
    total = sum((source / name).stat().st_size for names in groups.values() for name in names)
    shards: list[Shard] = []
    done = 0
    for group, names in groups.items():
        for number, batch in enumerate(_batches(source, names, shard_bytes=shard_bytes)):
            shards.append(_write_shard(target / f"{group}-{number:05d}.tar", source, names=batch))
            done += sum(member.bytes for member in shards[-1].members)
            report(done, total)
    described = point_croissant_to_shards(card, {shard.file: shard.sha256 for shard in shards})
    texts = {
        MANIFEST_NAME: (source / MANIFEST_NAME).read_text(encoding="utf-8"),
        CARD_NAME: json.dumps(described, indent=1, ensure_ascii=False) + "\n",
        README: _readme(source, manifest, licences=_licence_names(card)),
    }
    for name, text in texts.items():
        write_text_atomically(target / name, text)
    files = tuple(
        PackedFile(name, (target / name).stat().st_size, sha256_of_shared_file(target / name)) for name in texts
    )
    write_shard_index(target, ShardIndex(manifest.name, tuple(shards), files))
    return parse_shard_index((target / INDEX_NAME).read_text(encoding="utf-8"), INDEX_NAME)


def _read_card(source: Path, manifest: Manifest, *, licences: Sequence[str], url: str, creator: str) -> dict[str, Any]:
    """Return the dataset's description, made of the manifest where it has none."""
    path = source / CARD_NAME
    digest = sha256_of_shared_file(source / MANIFEST_NAME)
    if path.is_file():
        card = read_json(path, hint="saf-gen generate writes it again").data
        if not isinstance(card, dict) or "distribution" not in card:
            raise BadInput("is no description of a dataset", where=str(path), hint="saf-gen generate writes it again")
        card["distribution"] = describe_dataset_as_croissant(manifest, DatasetFacts("", ()), digest=digest)[
            "distribution"
        ]
    else:
        described = f"Spike-camera recordings with lens positions: {len(manifest.sequences)} sequences."
        card = describe_dataset_as_croissant(manifest, DatasetFacts(described, licences), digest=digest)
    if not licences and not card.get("license"):
        raise BadInput(
            f"nobody has said under which licence {source} may be used", hint="--licence NAME, such as CC-BY-4.0"
        )
    if licences:
        card["license"] = licence_urls_for_croissant(licences)
    if url:
        card["url"] = url
    if creator:
        card["creator"] = {"@type": "sc:Organization", "name": creator}
    return card


def _licence_names(card: dict[str, Any]) -> list[str]:
    given = card["license"] if isinstance(card["license"], list) else [card["license"]]
    return [str(one).rpartition("/")[2] for one in given]


def _readme(source: Path, manifest: Manifest, *, licences: Sequence[str]) -> str:
    """Return the dataset's page with front matter that leads to the shards."""
    path = source / README
    text = path.read_text(encoding="utf-8", errors="replace") if path.is_file() else f"# {manifest.name}\n"
    body = re.sub(r"\A---\n.*?^---\n", "", text, flags=re.DOTALL | re.MULTILINE)
    return front_matter_for_sharing(manifest, licences, pattern="{split}-*.tar") + body


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
    """Write one tar, without times, owners or rights of this machine."""
    members = []
    with write_atomically(path) as part, tarfile.open(part, "w", format=tarfile.PAX_FORMAT) as tar:
        for name in names:
            with (source / name).open("rb") as file:
                digest = file_digest(file, "sha256").hexdigest()
                info = tarfile.TarInfo(name)
                info.size = file.tell()
                file.seek(0)
                tar.addfile(info, file)
            members.append(PackedFile(name, info.size, digest))
    return Shard(path.name, path.stat().st_size, sha256_of_shared_file(path), tuple(members))
