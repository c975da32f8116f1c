"""Downloads from a server, bounded in time, size and redirects whatever it does; no other module loads httpx."""

import ipaddress
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import monotonic
from urllib.parse import quote, urlsplit, urlunsplit

import httpx

from saf_gen.errors import BadInput
from saf_gen.stream.manifest import PublishedFile

ATTEMPTS, WAIT_S = 4, 1.0
TIMEOUT_S = 15.0
"""Longest silence of a server, in seconds."""
LEAST_RATE, RATE_OVER_S = 1_000, 15.0
"""Least number of bytes per second, and the time in seconds over which it is counted."""
MAX_REDIRECTS = 5
FAULTS = (httpx.HTTPError, httpx.InvalidURL, httpx.StreamError, OSError, ValueError)
"""Exceptions of a connection that fails or breaks off, and of answers that are not HTTP."""
COPY = "copy a dataset that is on a disk as a folder"
REDIRECTS = (301, 302, 303, 307, 308)


class TooSlow(Exception):
    """Error for a server that sends less than LEAST_RATE."""


class Refused(Exception):
    """Error for an answer that another attempt will not change."""


class Absent(Refused):
    """Error for a file that the server does not have, or does not give away."""


@dataclass(frozen=True)
class Server:
    """A dataset folder below an http or https address; ``tell`` is called with lines for the user."""

    address: str
    tell: Callable[[str], None]

    @classmethod
    def at(cls, source: str, tell: Callable[[str], None]) -> "Server":
        """Return the server for an address; raises BadInput if nothing can be fetched from there."""
        try:
            scheme, host, path, query, _ = urlsplit(source)
            httpx.URL(source)
            named = urlsplit(source).hostname
        except FAULTS as error:
            raise BadInput(f"{source} is no address: {error}", allowed="an http or https address", hint=COPY) from error
        if query:  # each file would need a signature of its own
            raise BadInput(f"{source} has a query", allowed="an address without '?', below which all files are found")
        if scheme not in ("http", "https") or not named:
            raise BadInput(f"{source} cannot be fetched", allowed="an http or https address", hint=COPY)
        return cls(urlunsplit((scheme, host, path.rstrip("/"), "", "")), tell)

    def name(self, file: str) -> str:
        """Return the address of a file."""
        return f"{self.address}/{quote(file)}"

    def read(self, file: str, *, limit: int, required: bool = True) -> bytes:
        """Return the content of a small file, of at most ``limit`` bytes.

        Raises BadInput if it is larger, or cannot be fetched; a file that the server does not have, and that is not
        required, is empty.
        """
        where, text = self.name(file), bytearray()
        try:
            with self._open(where) as answer:
                for block in _read(answer):
                    text += block
                    if len(text) > limit:
                        raise Refused(f"it has more than {limit:,} bytes")
        except (*FAULTS, TooSlow, Refused) as error:
            if isinstance(error, Absent) and not required:
                return b""
            raise _unreachable(where, error) from error
        return bytes(text)

    def fetch(self, one: PublishedFile, part: Path, *, report: Callable[[int], None]) -> None:
        """Download a file to ``part``, from its beginning; raise BadInput if that fails or it has another size."""
        where, broken = self.name(one.file), Exception()
        for attempt in range(ATTEMPTS):
            if attempt:
                wait = WAIT_S * 2 ** (attempt - 1)
                self.tell(f"{where}: {_reason(broken)}; trying again in {wait:g} s ({attempt + 1} of {ATTEMPTS})")
                time.sleep(wait)
            try:
                self._download(one, part, report=report)
                return
            except (TooSlow, Refused) as error:
                raise _unreachable(where, error) from error
            except FAULTS as error:
                if isinstance(error, OSError) and error.filename is not None:
                    raise  # of the disk, not of the connection
                broken = error
        raise _unreachable(where, broken)

    def _download(self, one: PublishedFile, part: Path, *, report: Callable[[int], None]) -> None:
        have = 0
        with self._open(self.name(one.file)) as answer, part.open("wb") as file:
            for block in _read(answer):
                have += len(block)
                if have > one.bytes:
                    raise Refused(f"it has more than the {one.bytes:,} bytes that the manifest states")
                file.write(block)
                report(have)
        if have < one.bytes:
            raise ConnectionError(f"the connection broke off after {have:,} of {one.bytes:,} bytes")

    @contextmanager
    def _open(self, where: str) -> Iterator[httpx.Response]:
        """Yield the answer for an address, after redirects that are as safe as the address itself."""
        asked = {"Accept-Encoding": "identity"}
        with httpx.Client(timeout=TIMEOUT_S, follow_redirects=False) as client:
            for _ in range(MAX_REDIRECTS):
                with client.stream("GET", where, headers=asked) as answer:
                    if answer.status_code not in REDIRECTS:
                        if answer.status_code >= 500:
                            raise httpx.HTTPError(f"HTTP {answer.status_code}")
                        if answer.status_code >= 400:
                            raise Absent(f"HTTP {answer.status_code} {answer.reason_phrase}")
                        yield answer
                        return
                    where = self._follow(where, answer.headers.get("Location", ""))
        raise Refused(f"it sends on more than {MAX_REDIRECTS} times")

    def _follow(self, where: str, location: str) -> str:
        """Return the address of a redirect; raises Refused if it leads to a place that its host may not name."""
        try:
            before, after = httpx.URL(where), httpx.URL(where).join(location)
        except FAULTS as error:
            raise Refused(f"it sends on to {location!r:.100}") from error
        if after.scheme not in ("https", before.scheme):
            raise Refused(f"it sends on from {before.scheme} to {after.scheme}")
        if after.host != before.host:
            if _is_internal(after.host) and not _is_internal(before.host):
                raise Refused(f"it sends on to {after.host}, which is inside this network")
            self.tell(f"{before.host} sends on to {after.host}")
        return str(after)


def _read(answer: httpx.Response) -> Iterator[bytes]:
    """Yield the blocks of an answer as they come; raises TooSlow if they are too few."""
    began, read = monotonic(), 0
    for block in answer.iter_raw():
        read += len(block)
        if (passed := monotonic() - began) >= RATE_OVER_S:
            if read < LEAST_RATE * passed:
                raise TooSlow(f"it sent {read:,} bytes in {passed:.0f} s; allowed: {LEAST_RATE:,} a second")
            began, read = monotonic(), 0
        yield block


def _is_internal(host: str) -> bool:
    """Return whether a host is this machine or one of its private network."""
    try:
        found = {str(one[4][0]) for one in socket.getaddrinfo(host, None)}
    except (OSError, UnicodeError):
        return False
    return any(not ipaddress.ip_address(one.partition("%")[0]).is_global for one in found)


def _reason(error: Exception) -> str:
    return str(error) or type(error).__name__


def _unreachable(where: str, error: Exception) -> BadInput:
    hint = (
        "check the address" if isinstance(error, Refused) else "run the same command again to continue where it stopped"
    )
    return BadInput(f"cannot be fetched: {_reason(error)}", where=where, hint=hint)
