"""Fetching of a published dataset folder; only files with the size and SHA-256 in its manifest are accepted."""

import re
import shutil
import unicodedata
from collections.abc import Callable
from contextlib import suppress
from hashlib import sha256
from pathlib import Path, PurePosixPath

from saf_gen.core.files import atomic_file, check_writable, file_sha256, free_disk_bytes, refuse_link, unwritable
from saf_gen.errors import BadInput
from saf_gen.stream.manifest import (
    MANIFEST_NAME,
    TABLE_NAME,
    Manifest,
    PublishedFile,
    is_own_file,
    parse_manifest,
    write_table,
)
from saf_gen.stream.sharing.croissant import CARD_NAME

README = "README.md"
CARDS = (README, CARD_NAME)
"""Files for people and programs that a publisher may put beside the manifest, and that no digest covers."""
MAX_MANIFEST_BYTES, MAX_CARD_BYTES = 1 << 26, 1 << 22
"""Largest sizes that are fetched: 100,000 streams fit in a manifest, and reading it takes a dozen times its memory."""
PARTS = ".fetch"
"""Folder for the file that is being fetched, inside the dataset folder; it is removed at the end."""
_NAME = re.compile(r"(?![. ])[^\x00-\x1f\x7f/\\:*?\"<>|]{1,255}(?<![. ])")
_DEVICE = re.compile(r"(con|prn|aux|nul|conin\$|conout\$|(com|lpt)[0-9\u00b9\u00b2\u00b3])\s*(\..*)?", re.IGNORECASE)
"""Names that Windows takes for a device, with any ending."""


def fetch_dataset(
    source: str,
    out: str | Path | None = None,
    *,
    manifest_sha256: str = "",
    report: Callable[[int, int], None] = lambda done, total: None,
    tell: Callable[[str], None] = lambda line: None,
) -> tuple[Path, Manifest]:
    """Fetch a dataset folder from a server and check it.

    The manifest is read first and written last, because a folder without one is not a dataset. Each stream gets its
    name once its size and digest are right; streams that are there and right are kept, so that a fetch that was stopped
    goes on with the next file. Focal stacks are not fetched.

    Parameters
    ----------
    source : str
        Address (http or https) of a dataset folder, or of its manifest.
    out : str or Path, optional
        Dataset folder to write; by default the name of the dataset, in ``datasets/``.
    manifest_sha256 : str, optional
        Required SHA-256 of the manifest, as its publisher states it; by default any is accepted.
    report : callable, optional
        Called with the number of bytes present so far and the total number.
    tell : callable, optional
        Called with a line for the user if a server sends on to another host, or is tried again.

    Returns
    -------
    Path
        The dataset folder.
    Manifest
        Its manifest.

    Raises
    ------
    BadInput
        If there is no manifest, if a digest differs from the one required or listed, if a file has a name that is not
        safe on every system, if the disk is too full, if the folder contains another dataset or other files, or if the
        server does not answer.
    """
    from saf_gen.stream.sharing.server import Server  # loads httpx

    server = Server.at(source.removesuffix(MANIFEST_NAME), tell)
    where, text = server.name(MANIFEST_NAME), server.read(MANIFEST_NAME, limit=MAX_MANIFEST_BYTES)
    if manifest_sha256 and (digest := sha256(text).hexdigest()) != manifest_sha256.strip().lower():
        raise BadInput(f"has the SHA-256 {digest}", where=where, allowed=manifest_sha256, hint="ask its publisher")
    manifest = parse_manifest(text.decode("utf-8", errors="replace"), where)
    check_fetchable(manifest, where)
    folder = Path(out) if out is not None else Path("datasets") / manifest.name
    _check_folder(folder, manifest, text=text)
    parts, done, total = folder / PARTS, 0, sum(stream.bytes for stream in manifest.files)

    def report_part(count: int) -> None:
        report(done + count, total)

    try:
        refuse_link(parts)
        parts.mkdir(parents=True, exist_ok=True)
        for stream in manifest.files:
            if not _is_complete(folder, stream):
                part = parts / f"{stream.sha256}.part"
                server.fetch(stream, part, report=report_part)
                _put(part, stream, folder=folder, where=server.name(stream.file))
            done += stream.bytes
            report(done, total)
        for name in CARDS:
            if not (folder / name).exists() and (card := server.read(name, limit=MAX_CARD_BYTES, required=False)):
                _write(folder / name, card)
        write_table(folder, manifest)
        _write(folder / MANIFEST_NAME, text)
        shutil.rmtree(parts, ignore_errors=True)
    except OSError as error:
        raise unwritable(folder, error) from error
    finally:
        if [path.name for path in folder.glob("*")] == [PARTS]:  # nothing was fetched: leave nothing behind
            with suppress(OSError):
                (folder / PARTS).rmdir()
                folder.rmdir()
    return folder, manifest


def check_fetchable(manifest: Manifest, where: str) -> None:
    """Raise BadInput unless a manifest states size and digest of each stream, under names that every system can hold.

    Two names must not be one file where case or the form of accents does not count, nor one of them a folder of the
    other.
    """
    if not is_plain_path(manifest.name) or "/" in manifest.name or len(manifest.name) > 100:  # fetch makes this folder
        raise BadInput(
            f"the dataset's name is {manifest.name!r}", where=where, hint="rename it in manifest.json",
            allowed="up to 100 characters, none of them / \\ : * ? \" < > |, and neither dots nor blanks at the ends",
        )  # fmt: skip
    streams, files = {entry.file for entry in manifest.sequences}, [stream.file for stream in manifest.files]
    for name in sorted(streams ^ set(files)):
        problem = "size and SHA-256 of" if name in streams else "as a sequence"
        raise BadInput(
            f"does not list {problem} {name!r}", where=where, allowed="files, no links, that the dataset holds",
            hint="put the file itself there, and write the manifest again",
        )  # fmt: skip
    taken: dict[str, str] = {}
    for name in (MANIFEST_NAME, TABLE_NAME, *CARDS, *files):
        if not is_plain_path(name):
            raise BadInput(
                f"has the file {name!r}", where=where,
                allowed="a relative path with '/', without .., hidden parts, and names that a system cannot hold",
            )  # fmt: skip
        if (other := taken.setdefault(_fold(name), name)) != name or files.count(name) > 1:
            raise BadInput(f"names {name!r} and {other!r}", where=where, allowed="each file once, on every system")
    for key, name in taken.items():
        for above in PurePosixPath(key).parents:
            if (held := taken.get(str(above))) is not None:
                raise BadInput(f"has the file {held!r} and the file {name!r} in a folder of that name", where=where)


def check_published(folder: Path, manifest: Manifest) -> None:
    """Raise BadInput if others could not fetch a dataset folder as it is on this disk."""
    check_fetchable(manifest, str(folder / MANIFEST_NAME))
    for stream in manifest.files:
        if not _is_complete(folder, stream):
            raise BadInput(
                "is a link, or has other bytes than its manifest states", where=str(folder / stream.file),
                hint="write the manifest again",
            )  # fmt: skip


def is_plain_path(name: str) -> bool:
    """Return whether a name is a relative path, without hidden parts, that means the same on every system."""
    parts = PurePosixPath(name).parts
    plain = all(_NAME.fullmatch(part) and not _DEVICE.fullmatch(part) for part in parts)
    return bool(parts) and plain and "/".join(parts) == name


def _fold(name: str) -> str:
    """Return what two names have in common that are one on a file system without case or forms of accents."""
    return unicodedata.normalize("NFD", unicodedata.normalize("NFD", name).casefold())


def _check_folder(folder: Path, manifest: Manifest, *, text: bytes) -> None:
    refuse_link(folder)
    check_writable(folder)
    held = folder / MANIFEST_NAME
    if held.exists() and not (is_own_file(folder, MANIFEST_NAME) and held.read_bytes() == text):
        raise BadInput(f"{folder} holds another dataset", hint="give another folder with --out")
    if folder.is_dir() and any(folder.iterdir()) and not (held.exists() or (folder / PARTS).exists()):
        raise BadInput(f"{folder} holds other files", hint="give a folder that is empty or new with --out")
    needed = sum(stream.bytes for stream in manifest.files if not (folder / stream.file).exists())
    free = free_disk_bytes(folder)
    if needed > free:
        raise BadInput(
            f"the dataset needs {needed / 1e6:,.0f} MB in {folder}, but only {free / 1e6:,.0f} MB are free",
            hint="free disk space, or give another folder with --out",
        )


def _put(part: Path, stream: PublishedFile, *, folder: Path, where: str) -> None:
    """Give a file its name if it has the digest in the manifest and no link leads to that name; otherwise delete it."""
    if (digest := file_sha256(part)) != stream.sha256:
        part.unlink()
        raise BadInput(
            f"has the SHA-256 {digest:.16}…", where=where, allowed=f"{stream.sha256:.16}…, as the manifest states",
            hint="fetch it again; if the error persists, inform its publisher",
        )  # fmt: skip
    target = folder / stream.file
    for above in [*target.parents][: len(PurePosixPath(stream.file).parts) - 1]:
        refuse_link(above)
    target.parent.mkdir(parents=True, exist_ok=True)
    part.replace(target)


def _write(path: Path, content: bytes) -> None:
    with atomic_file(path) as part:
        part.write_bytes(content)


def _is_complete(folder: Path, stream: PublishedFile) -> bool:
    path = folder / stream.file
    there = is_own_file(folder, stream.file)
    return there and path.stat().st_size == stream.bytes and file_sha256(path) == stream.sha256
