"""Fetching of a packed dataset; only files with the size and SHA-256 in its index are accepted."""

import shutil
import tarfile
from collections.abc import Callable
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from typing import IO

from saf_gen.core.files import check_folder_writable, free_disk_bytes, sha256_of_file, unwritable_file_error
from saf_gen.errors import BadInput
from saf_gen.stream.manifest import MANIFEST_NAME
from saf_gen.stream.sharing.origin import BLOCK, Origin, Report, find_origin_of_shards
from saf_gen.stream.sharing.shard_index import (
    INDEX_NAME,
    MAX_INDEX_BYTES,
    PackedFile,
    Shard,
    ShardIndex,
    parse_shard_index,
)

PARTS = ".fetch"
"""Folder for incomplete files, inside the dataset folder; it is removed at the end."""


def fetch_dataset(
    source: str,
    out: str | Path | None = None,
    *,
    index_sha256: str = "",
    report: Callable[[int, int], None] = lambda done, total: None,
) -> tuple[Path, ShardIndex]:
    """Fetch a packed dataset from a server or a folder, check it and unpack it.

    Files that exist already are kept, and an interrupted download is continued. Each shard is fetched completely and
    checked before it is opened. Only files that the index lists are unpacked, and each is checked before it gets its
    name. The manifest is written last, because a folder without one is not a dataset.

    Parameters
    ----------
    source : str
        Address (http or https) or path of a folder with an index, or of the index itself.
    out : str or Path, optional
        Dataset folder to write; by default the name of the dataset, in ``datasets/``.
    index_sha256 : str, optional
        Required SHA-256 of the index, as its publisher states it; by default any is accepted.
    report : callable, optional
        Called with the number of bytes present so far and the total number.

    Returns
    -------
    Path
        The dataset folder.
    ShardIndex
        The index.

    Raises
    ------
    BadInput
        If there is no index, if a digest differs from the one required or listed, if the disk is too full, if the
        folder contains another dataset or other files, or if the server does not answer.
    """
    origin = find_origin_of_shards(source)
    text = origin.read(INDEX_NAME, limit=MAX_INDEX_BYTES)
    digest, where = sha256(text).hexdigest(), origin.name(INDEX_NAME)
    if index_sha256 and digest != index_sha256.strip().lower():
        raise BadInput(f"has the SHA-256 {digest}", where=where, allowed=index_sha256, hint="ask its publisher")
    index = parse_shard_index(text.decode("utf-8", errors="replace"), where)
    folder = Path(out) if out is not None else Path("datasets") / index.name
    _check_folder(folder, index)
    try:
        _fetch_into(folder, index, origin=origin, report=report)
    except OSError as error:
        raise unwritable_file_error(folder, error) from error
    finally:
        if [one.name for one in folder.glob("*")] == [PARTS]:  # nothing was fetched: leave nothing behind
            with suppress(OSError):
                (folder / PARTS).rmdir()
                folder.rmdir()
    return folder, index


def _check_folder(folder: Path, index: ShardIndex) -> None:
    check_folder_writable(folder)
    manifest = next(one for one in index.files if one.file == MANIFEST_NAME)
    if (folder / MANIFEST_NAME).exists() and not _is_complete(folder, manifest):
        raise BadInput(f"{folder} holds another dataset", hint="give another folder with --out")
    if (
        folder.is_dir()
        and any(folder.iterdir())
        and not any((folder / name).exists() for name in (MANIFEST_NAME, PARTS))
    ):
        raise BadInput(f"{folder} holds other files", hint="give a folder that is empty or new with --out")
    missing = [one for shard in index.shards for one in shard.members if not (folder / one.file).exists()]
    needed = sum(one.bytes for one in missing) + max((one.bytes for one in index.shards), default=0) * bool(missing)
    free = free_disk_bytes(folder)
    if needed > free:
        raise BadInput(
            f"the dataset needs {needed / 1e6:,.0f} MB in {folder}, but only {free / 1e6:,.0f} MB are free",
            hint="free disk space, or give another folder with --out",
        )


def _fetch_into(folder: Path, index: ShardIndex, *, origin: Origin, report: Callable[[int, int], None]) -> None:
    parts, total, done = folder / PARTS, index.total_bytes, 0
    parts.mkdir(parents=True, exist_ok=True)
    for shard in index.shards:
        wanted = {one.file: one for one in shard.members if not _is_complete(folder, one)}

        def report_shard(fetched: int, before: int = done) -> None:
            report(before + fetched, total)

        if wanted:
            path = _fetch_checked(shard, origin, parts=parts, report=report_shard)
            _unpack(path, shard, folder=folder, wanted=wanted)
            if path.parent == parts:
                path.unlink()
        done += shard.bytes
        report(done, total)
    for one in sorted(index.files, key=lambda one: one.file == MANIFEST_NAME):
        if not _is_complete(folder, one):
            with _fetch_checked(one, origin, parts=parts, report=lambda n: None).open("rb") as file:
                _write_checked(file, one, folder=folder, where=origin.name(one.file))
        done += one.bytes
        report(done, total)
    shutil.rmtree(parts, ignore_errors=True)


def _fetch_checked(one: PackedFile | Shard, origin: Origin, *, parts: Path, report: Report) -> Path:
    """Return the path of a file that has the digest in the index; a download with another digest is deleted."""
    path = origin.fetch(one, parts=parts, report=report)
    if (found := sha256_of_file(path)) != one.sha256:
        if path.parent == parts:
            path.unlink()
        raise BadInput(
            f"has the SHA-256 {found:.16}…",
            where=origin.name(one.file),
            allowed=f"{one.sha256:.16}…, as the index states",
            hint="fetch it again; if the error persists, inform its publisher",
        )
    return path


def _unpack(path: Path, shard: Shard, *, folder: Path, wanted: dict[str, PackedFile]) -> None:
    """Write the wanted files of a shard; raise BadInput if it contains anything that the index does not list."""
    known = {one.file: one for one in shard.members}
    left = set(wanted)
    try:
        with tarfile.open(path, "r:") as tar:  # never compressed, so that a small file cannot expand into a large one
            for info in tar:
                if not info.isreg() or info.name not in known or info.size != known[info.name].bytes:
                    raise BadInput(f"holds {info.name!r}, which does not match the index", where=shard.file)
                if info.name in left:
                    content = tar.extractfile(info)
                    if content is None:
                        raise BadInput(f"{info.name!r} has no content", where=shard.file)
                    _write_checked(content, wanted[info.name], folder=folder, where=f"{shard.file}: {info.name}")
                    left.discard(info.name)
    except tarfile.TarError as error:
        raise BadInput(f"is not a tar file: {error}", where=shard.file, hint="pack the dataset again") from error
    if left:
        raise BadInput(f"lacks {sorted(left)[0]!r}, which the index lists", where=shard.file)


def _write_checked(content: IO[bytes], one: PackedFile, *, folder: Path, where: str) -> None:
    """Write a file under its name, but only if it has the size and digest in the index."""
    part = folder / PARTS / f"{one.sha256}.part"
    digest, size = sha256(), 0
    with part.open("wb") as file:
        while block := content.read(BLOCK):
            digest.update(block)
            size += len(block)
            file.write(block)
    if (size, digest.hexdigest()) != (one.bytes, one.sha256):
        part.unlink()
        raise BadInput("differs from the index", where=where, allowed=f"{one.bytes:,} bytes, {one.sha256:.16}…")
    target = folder / one.file
    target.parent.mkdir(parents=True, exist_ok=True)
    if not target.parent.resolve().is_relative_to(folder.resolve()):
        raise BadInput(f"{target.parent} leads out of {folder}", hint="give another folder with --out")
    part.replace(target)


def _is_complete(folder: Path, one: PackedFile) -> bool:
    path = folder / one.file
    return path.is_file() and path.stat().st_size == one.bytes and sha256_of_file(path) == one.sha256
