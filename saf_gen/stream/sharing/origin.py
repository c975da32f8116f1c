"""Folders and HTTP servers from which packed datasets are fetched; no other module contains an HTTP client."""

import http.client
import ssl
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol
from urllib.error import HTTPError, URLError
from urllib.parse import quote, urlsplit, urlunsplit
from urllib.request import Request, urlopen

from saf_gen.core.config.document import check_plain_file
from saf_gen.errors import BadInput
from saf_gen.stream.sharing.shard_index import INDEX_NAME, PackedFile, Shard

ATTEMPTS, TIMEOUT_S, WAIT_S = 5, 60.0, 1.0
BLOCK = 1 << 20
Report = Callable[[int], None]
BROKEN = (URLError, http.client.HTTPException, ConnectionError, TimeoutError, ssl.SSLError)
"""Exceptions of a connection that fails or breaks off."""


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


def find_origin_of_shards(source: str) -> Origin:
    """Return the origin for the address or path of a folder, or of the index in it."""
    if "://" not in source:
        folder = Path(source)
        return _Folder(folder.parent if folder.name == INDEX_NAME else folder)
    scheme, host, path, query, _ = urlsplit(source)
    if query:  # each shard would need a signature of its own
        raise BadInput(f"{source} has a query", allowed="an address without '?', below which all files are found")
    if scheme not in ("http", "https") or not host:
        raise BadInput(f"{source} cannot be fetched", allowed="an http or https address, or a folder")
    return _Server(urlunsplit((scheme, host, path.removesuffix(INDEX_NAME).rstrip("/"), "", "")))


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


@dataclass(frozen=True)
class _Server:
    address: str

    def name(self, file: str) -> str:
        return f"{self.address}/{quote(file)}"

    def read(self, file: str, *, limit: int) -> bytes:
        where = self.name(file)
        try:
            with urlopen(where, timeout=TIMEOUT_S) as answer:
                text: bytes = answer.read(limit + 1)
        except BROKEN as error:
            raise _unreachable(where, error) from error
        if len(text) > limit:
            raise BadInput(f"has more than {limit:,} bytes", where=where)
        return text

    def fetch(self, one: PackedFile | Shard, *, parts: Path, report: Report) -> Path:
        """Download a file and return its path; a partial file that an earlier run left is continued."""
        part = parts / f"{one.file}.{one.sha256[:16]}.part"
        for attempt in range(ATTEMPTS):
            have = part.stat().st_size if part.exists() else 0
            if have == one.bytes and part.exists():
                return part
            if attempt:
                time.sleep(WAIT_S * 2 ** (attempt - 1))
            try:
                self._download(one, part, have=have if have < one.bytes else 0, report=report)
            except HTTPError as error:
                if error.code < 500:
                    raise _unreachable(self.name(one.file), error) from error
                broken: Exception = error
            except BROKEN as error:
                broken = error
            else:
                broken = ConnectionError("the connection broke off")
        if part.exists() and part.stat().st_size == one.bytes:
            return part
        raise _unreachable(self.name(one.file), broken)

    def _download(self, one: PackedFile | Shard, part: Path, *, have: int, report: Report) -> None:
        request = Request(self.name(one.file), headers={"Range": f"bytes={have}-"} if have else {})
        with urlopen(request, timeout=TIMEOUT_S) as answer:
            goes_on = answer.status == 206 and answer.headers.get("Content-Range", "").startswith(f"bytes {have}-")
            have = have if goes_on else 0
            with part.open("ab" if goes_on else "wb") as file:
                while block := answer.read(BLOCK):
                    have += len(block)
                    if have > one.bytes:
                        raise BadInput(
                            f"has more than the {one.bytes:,} bytes that the index states", where=self.name(one.file)
                        )
                    file.write(block)
                    report(have)


def _unreachable(where: str, error: Exception) -> BadInput:
    reason = getattr(error, "reason", None) or str(error) or type(error).__name__
    refused = isinstance(error, HTTPError) and error.code < 500
    hint = "check the address" if refused else "run the same command again to continue where it stopped"
    return BadInput(f"cannot be fetched: {reason}", where=where, hint=hint)
