"""Fetching of a packed dataset; only files with the size and SHA-256 in its index are accepted."""

import shutil
import tarfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import IO, Protocol

from saf_gen.core.config.document import check_plain_file
from saf_gen.core.files import check_writable, file_sha256, free_disk_bytes, refuse_link, unwritable
from saf_gen.errors import BadInput
from saf_gen.stream.manifest import MANIFEST_NAME, parse_manifest
from saf_gen.stream.sharing.packing import INDEX_NAME, MAX_INDEX_BYTES, PackedFile, Shard, ShardIndex, parse_shard_index

BLOCK = 1 << 20
MAX_HEADER_BYTES = 1 << 16
"""Largest header that a name may have in a tar file; a longer one takes minutes to read."""
Report = Callable[[int], None]
Tell = Callable[[str], None]
UNREADABLE = (tarfile.TarError, ValueError, ArithmeticError, LookupError, TypeError, EOFError, RecursionError)
"""Exceptions of Python's reader for a damaged or hostile tar file."""


class Origin(Protocol):
    """A packed dataset in a folder or on a server."""

    def name(self, file: str) -> str:
        """Return the address or path of a file for messages."""

    def read(self, file: str, *, limit: int) -> bytes:
        """Return the content of a small file; raise BadInput if it is missing or larger than ``limit`` bytes."""

    def fetch(self, one: PackedFile | Shard, *, parts: Path, report: Report) -> Path:
        """Return the path of a file with the size in the index, which is downloaded to ``parts`` if necessary.

        ``report`` is called with the number of bytes present so far. Raises BadInput if the file cannot be fetched or
        has another size.
        """


def find_origin(source: str, tell: Tell = lambda line: None) -> Origin:
    """Return the origin for the address or path of a folder, or of the index in it.

    ``tell`` is called with a line for the user if a server sends on to another host, or is tried again.
    """
    if "://" not in source:
        folder = Path(source)
        return _Folder(folder.parent if folder.name == INDEX_NAME else folder)
    from saf_gen.stream.sharing.server import Server  # loads httpx

    return Server.at(source.removesuffix(INDEX_NAME), tell)


@dataclass(frozen=True)
class _Folder:
    folder: Path

    def name(self, file: str) -> str:
        return str(self.folder / file)

    def read(self, file: str, *, limit: int) -> bytes:
        path = self.folder / file
        try:
            check_plain_file(path, max_bytes=limit)
            return path.read_bytes()
        except OSError as error:
            raise BadInput(
                f"{self.folder} holds no packed dataset: {file} cannot be read", hint="make one with saf-gen pack"
            ) from error

    def fetch(self, one: PackedFile | Shard, *, parts: Path, report: Report) -> Path:
        path = self.folder / one.file
        found = path.stat().st_size if path.is_file() else 0
        if found != one.bytes:
            raise BadInput(f"has {found:,} bytes", where=str(path), allowed=f"{one.bytes:,}, as the index states")
        return path


PARTS = ".fetch"
"""Folder for incomplete files, inside the dataset folder; it is removed at the end."""


def fetch_dataset(
    source: str,
    out: str | Path | None = None,
    *,
    index_sha256: str = "",
    report: Callable[[int, int], None] = lambda done, total: None,
    tell: Tell = lambda line: None,
) -> tuple[Path, ShardIndex]:
    """Fetch a packed dataset from a server or a folder, check it and unpack it.

    Files that exist already are kept, and an interrupted download is continued. Each shard is fetched completely and
    checked before it is opened. Only files that the index lists are unpacked, and each is checked before it gets its
    name. The manifest is read and compared with the index before anything else is fetched, and written last, because a
    folder without one is not a dataset.

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
    tell : callable, optional
        Called with a line for the user if a server sends on to another host, or is tried again.

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
    origin = find_origin(source, tell)
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
        raise unwritable(folder, error) from error
    finally:
        if [one.name for one in folder.glob("*")] == [PARTS]:  # nothing was fetched: leave nothing behind
            with suppress(OSError):
                (folder / PARTS).rmdir()
                folder.rmdir()
    return folder, index


def _check_folder(folder: Path, index: ShardIndex) -> None:
    refuse_link(folder)
    check_writable(folder)
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
    _check_manifest(index, origin=origin, parts=parts)
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


def _check_manifest(index: ShardIndex, *, origin: Origin, parts: Path) -> None:
    """Raise BadInput unless the manifest is that of a dataset, and the index lists each of its streams."""
    one = next(file for file in index.files if file.file == MANIFEST_NAME)
    path = _fetch_checked(one, origin, parts=parts, report=lambda n: None)
    manifest = parse_manifest(path.read_text(encoding="utf-8", errors="replace"), origin.name(one.file))
    listed = {member.file for shard in index.shards for member in shard.members}
    missing = [entry.file for entry in manifest.sequences if entry.file not in listed]
    if missing:
        raise BadInput(f"lists {missing[0]!r}, which no shard holds", where=origin.name(one.file))


def _fetch_checked(one: PackedFile | Shard, origin: Origin, *, parts: Path, report: Report) -> Path:
    """Return the path of a file that has the digest in the index; a download with another digest is deleted."""
    path = origin.fetch(one, parts=parts, report=report)
    if (found := file_sha256(path)) != one.sha256:
        if path.parent == parts:
            path.unlink()
        raise BadInput(
            f"has the SHA-256 {found:.16}…",
            where=origin.name(one.file),
            allowed=f"{one.sha256:.16}…, as the index states",
            hint="fetch it again; if the error persists, inform its publisher",
        )
    return path


class _BoundedTarInfo(tarfile.TarInfo):
    """A member of a tar file whose extended header is small."""

    def _proc_member(self, tar: tarfile.TarFile) -> tarfile.TarInfo:
        if self.type not in tarfile.REGULAR_TYPES and self.size > MAX_HEADER_BYTES:
            raise tarfile.HeaderError(f"a header of {self.size:,} bytes")
        found: tarfile.TarInfo = super()._proc_member(tar)  # type: ignore[misc]
        return found


def _unpack(path: Path, shard: Shard, *, folder: Path, wanted: dict[str, PackedFile]) -> None:
    """Write the wanted files of a shard; raise BadInput if it contains anything that the index does not list."""
    known = {one.file: one for one in shard.members}
    left = set(wanted)
    try:
        # Never compressed, so that a small file cannot expand into a large one.
        with tarfile.open(path, "r:", tarinfo=_BoundedTarInfo) as tar:
            for info in tar:
                if not info.isreg() or info.name not in known or info.size != known[info.name].bytes:
                    raise BadInput(f"holds {info.name!r}, which does not match the index", where=shard.file)
                if info.name in left:
                    content = tar.extractfile(info)
                    if content is None:
                        raise BadInput(f"{info.name!r} has no content", where=shard.file)
                    _write_checked(content, wanted[info.name], folder=folder, where=f"{shard.file}: {info.name}")
                    left.discard(info.name)
    except UNREADABLE as error:
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
    return path.is_file() and path.stat().st_size == one.bytes and file_sha256(path) == one.sha256
