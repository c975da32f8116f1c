"""Where a packed dataset is fetched from: a folder, or a server; nothing else in this package opens a connection."""

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
"""What a connection that fails or breaks off raises."""


class Origin(Protocol):
    """A packed dataset, wherever it lies."""

    def name(self, file: str) -> str:
        """Return how a file of it is called in messages."""

    def read(self, file: str, *, limit: int) -> bytes:
        """Return a small file; raises BadInput where it is not there, or larger than ``limit`` bytes."""

    def fetch(self, one: PackedFile | Shard, *, parts: Path, report: Report) -> Path:
        """Return a path that holds as many bytes of a file as the index says, in ``parts`` or where it lies."""


def find_origin_of_shards(source: str) -> Origin:
    """Return the origin at an address or path, of the folder or of the index in it."""
    if "://" not in source:
        folder = Path(source)
        return _Folder(folder.parent if folder.name == INDEX_NAME else folder)
    scheme, host, path, _, _ = urlsplit(source)
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
            check_plain_file(path, most=limit)
            return path.read_bytes()
        except OSError as error:
            raise BadInput(
                f"{self.folder} holds no packed dataset: {file} cannot be read", hint="saf-gen pack makes one"
            ) from error

    def fetch(self, one: PackedFile | Shard, *, parts: Path, report: Report) -> Path:
        path = self.folder / one.file
        found = path.stat().st_size if path.is_file() else 0
        if found != one.bytes:
            raise BadInput(f"has {found:,} bytes", where=str(path), allowed=f"{one.bytes:,}, as the index says")
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
        """Download to a file that a later run goes on with."""
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
                broken = ConnectionError("it broke off")
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
                            f"has more than {one.bytes:,} bytes, which the index says", where=self.name(one.file)
                        )
                    file.write(block)
                    report(have)


def _unreachable(where: str, error: Exception) -> BadInput:
    reason = getattr(error, "reason", None) or str(error) or type(error).__name__
    refused = isinstance(error, HTTPError) and error.code < 500
    hint = "is the address right?" if refused else "the same command goes on where it stopped"
    return BadInput(f"cannot be fetched: {reason}", where=where, hint=hint)
