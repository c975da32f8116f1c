"""Files in object stores, ``s3://bucket/folder/name``, which are read like files on a disk.

Only this module imports fsspec. Objects are read by ranges; if an object is replaced or deleted while it is read,
reading fails and never mixes two versions. Endpoint and credentials come from the environment and the files that all
programs for S3 read (``AWS_ENDPOINT_URL``, ``AWS_ACCESS_KEY_ID``, ``AWS_PROFILE``, ...).
:mod:`saf_gen.core.object_transfers` writes objects.
"""

import gc
import io
import os
import re
import stat
import threading
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, Self

from saf_gen.core.extras import require_extra
from saf_gen.errors import BadInput

SCHEMES = {"s3": "s3fs"}
"""The package that fsspec needs for each scheme; the extra with the name of the scheme installs it."""
_ADDRESS = re.compile(r"(?P<scheme>[A-Za-z][A-Za-z0-9+.-]+):/{1,2}(?P<key>.*)", re.DOTALL)
FIRST_RANGE, LARGEST_RANGE, KEPT_RANGES = 1 << 16, 1 << 20, 8
"""Bytes read after a jump, largest number of bytes read ahead, and number of ranges that an open object keeps."""


@dataclass(frozen=True, order=True)
class StorePath:
    """The path of an object, or of a folder of objects, with the methods of ``pathlib.Path`` that readers use.

    Every method that queries the store raises BadInput if the query fails.

    Attributes
    ----------
    scheme : str
        Kind of store, such as "s3".
    key : str
        Everything that follows ``scheme://``: the bucket, and the name in it.
    """

    scheme: str
    key: str

    def __str__(self) -> str:
        return f"{self.scheme}://{self.key}"

    def __truediv__(self, name: str | os.PathLike[str]) -> "StorePath":
        return StorePath(self.scheme, f"{self.key.rstrip('/')}/{os.fspath(name)}")

    @property
    def name(self) -> str:
        """The last part of the path."""
        return PurePosixPath(self.key).name

    @property
    def stem(self) -> str:
        """The name without its suffix."""
        return PurePosixPath(self.key).stem

    @property
    def suffix(self) -> str:
        """The part of the name from its last dot on."""
        return PurePosixPath(self.key).suffix

    @property
    def parent(self) -> "StorePath":
        """The folder that contains this path; a bucket is its own parent."""
        above = str(PurePosixPath(self.key).parent)
        return self if above in (".", "/") else StorePath(self.scheme, above)

    @property
    def bucket(self) -> str:
        """The name of the bucket: the first part of the path."""
        return self.key.split("/", 1)[0]

    def with_name(self, name: str) -> "StorePath":
        """Return the path with another name in the same folder."""
        return StorePath(self.scheme, str(PurePosixPath(self.key).with_name(name)))

    def resolve(self) -> Self:
        """Return the same path, because an object has only one name."""
        return self

    def file_system(self) -> Any:
        """Return fsspec's file system; raise BadInput if the package for this scheme is missing."""
        require_extra(self.scheme, "fsspec", SCHEMES[self.scheme], of=f"{self.scheme}://")
        import fsspec

        options = {"use_listings_cache": False} if self.scheme == "s3" else {}
        return fsspec.filesystem(self.scheme, **options)

    def exists(self) -> bool:
        """Return whether an object or a folder of this name exists."""
        return self._facts() is not None

    def is_file(self) -> bool:
        """Return whether this is an object."""
        return (self._facts() or {}).get("type") == "file"

    def is_dir(self) -> bool:
        """Return whether this is a folder that contains objects, or a bucket."""
        return (self._facts() or {}).get("type") == "directory"

    def _facts(self) -> dict[str, Any] | None:
        with self.report_problems():
            files = self.file_system()
            try:
                return files.info(self.key)
            except FileNotFoundError:
                if self.scheme == "s3" and not files.exists(self.bucket):
                    raise BadInput(f"there is no bucket {self.bucket!r}", where=str(self)) from None
                return None

    def stat(self) -> os.stat_result:
        """Return the size and the modification time of an object; raise BadInput if it does not exist."""
        facts = self._facts()
        if facts is None or facts["type"] != "file":
            raise BadInput("there is no such object", where=str(self))
        changed = facts.get("LastModified") or facts.get("created")
        seconds = changed.timestamp() if changed else 0.0
        return os.stat_result((stat.S_IFREG, 0, 0, 1, 0, 0, facts["size"], seconds, seconds, seconds))

    def iterdir(self) -> Iterator["StorePath"]:
        """Yield the objects and folders in this folder."""
        with self.report_problems():
            found = self.file_system().ls(self.key, detail=False)
        yield from (StorePath(self.scheme, key.strip("/")) for key in found)

    def open(self, mode: str = "rb") -> "ObjectReader":
        """Open an object for reading; reading raises BadInput if its content changes after this call."""
        with self.report_problems():
            raw = self.file_system().open(self.key, mode, cache_type="none")
            return ObjectReader(self, raw, raw.seek(0, io.SEEK_END))

    def read_text(self, encoding: str = "utf-8") -> str:
        """Return the text of an object, with every line end converted to a newline."""
        with self.open() as raw:
            return io.TextIOWrapper(io.BytesIO(raw.read()), encoding=encoding).read()

    @contextmanager
    def report_problems(self) -> Iterator[None]:
        """Turn every exception of a store's client into a BadInput of one line."""
        try:
            yield
        except BadInput:
            raise
        except Exception as error:
            raise _explain(self, error) from error


AnyPath = Path | StorePath
"""A path on a disk or in an object store."""


def find_path(source: "str | os.PathLike[str] | StorePath") -> AnyPath:
    """Return the path that a text names: ``s3://bucket/name`` in an object store, anything else on a disk.

    A Path that was made from such an address, and has lost one of its slashes, is understood too. Raises BadInput if
    the address has another scheme or names no bucket.
    """
    if isinstance(source, StorePath):
        return source
    text = os.fspath(source)
    found = _ADDRESS.fullmatch(text)
    if found is None or Path(f"{found['scheme']}:").exists():
        return Path(source)
    scheme = found["scheme"].lower()
    if scheme not in SCHEMES:
        hint = "download packed datasets with saf-gen fetch" if scheme in ("http", "https") else ""
        allowed = f"{', '.join(f'{one}://' for one in SCHEMES)}, or a path on a disk"
        raise BadInput(f"{scheme}:// is not a known kind of address", where=text, allowed=allowed, hint=hint)
    key = str(PurePosixPath(found["key"].strip("/")))
    if key in (".", "") or ".." in PurePosixPath(key).parts:
        raise BadInput("the address names no bucket", where=text, allowed=f"{scheme}://BUCKET/FOLDER")
    return StorePath(scheme, key)


def check_on_disk(path: Path) -> None:
    """Raise BadInput for a path in an object store, because only ``generate`` writes files there."""
    if not path.is_absolute() and isinstance(found := find_path(path), StorePath):
        raise BadInput(
            f"{found} is in an object store", allowed="a path on a disk; only `saf-gen generate` writes to stores"
        )


class _CollectionPause:
    """Suspends Python's garbage collection while HDF5 waits for an object, in any number of threads.

    HDF5 reads under a lock of h5py, and the store's client answers from another thread. If that thread collected an
    object of h5py as garbage, it would wait for the lock for ever.
    """

    def __init__(self) -> None:
        self._lock, self._waiting, self._collects = threading.Lock(), 0, True

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Collect no garbage until the end of the ``with`` block."""
        with self._lock:
            if not self._waiting:
                self._collects = gc.isenabled()
                gc.disable()
            self._waiting += 1
        try:
            yield
        finally:
            with self._lock:
                self._waiting -= 1
                if not self._waiting and self._collects:
                    gc.enable()


_COLLECTION_PAUSE = _CollectionPause()


class ObjectReader(io.RawIOBase):
    """An open object, read in ranges that grow during continuous reading and are small after a jump.

    It keeps the last eight ranges, each of at most 1 MiB unless more is requested at once.

    Attributes
    ----------
    path : StorePath
        Path of the object.
    size : int
        Bytes of the object.
    problem : BadInput or None
        The last error of the store, kept because HDF5 replaces its message.
    fetched, requests : int
        Numbers of bytes and of ranges fetched so far.
    """

    def __init__(self, path: StorePath, raw: Any, size: int) -> None:
        self.path, self.size, self._raw, self._at = path, size, raw, 0
        self._ranges: deque[tuple[int, bytes]] = deque(maxlen=KEPT_RANGES)
        self.problem: BadInput | None = None
        self.fetched = self.requests = 0

    def readable(self) -> bool:
        """Return True."""
        return True

    def seekable(self) -> bool:
        """Return True."""
        return True

    def tell(self) -> int:
        """Return the position of the next byte to read."""
        return self._at

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        """Move to another position, and return it, in bytes from the beginning."""
        self._at = offset + {io.SEEK_SET: 0, io.SEEK_CUR: self._at, io.SEEK_END: self.size}[whence]
        return self._at

    def readinto(self, buffer: Any) -> int:
        """Fill a buffer and return the number of bytes read, fewer at the end; raise BadInput if reading fails."""
        out = memoryview(buffer).cast("B")
        count = max(0, min(len(out), self.size - self._at))
        done = 0
        while done < count:
            start, data = self._range_at(self._at, count - done)
            piece = data[self._at - start : self._at - start + count - done]
            out[done : done + len(piece)] = piece
            done += len(piece)
            self._at += len(piece)
        return count

    def _range_at(self, at: int, needed: int) -> tuple[int, bytes]:
        """Return start and bytes of a range that contains byte ``at``; if none is kept, fetch at least ``needed``."""
        ahead = FIRST_RANGE
        for start, data in self._ranges:
            if start <= at < start + len(data):
                return start, data
            if at == start + len(data):
                ahead = min(2 * len(data), LARGEST_RANGE)
        length = min(max(needed, ahead), self.size - at)
        try:
            with self.path.report_problems(), _COLLECTION_PAUSE.paused():
                self._raw.seek(at)
                data = self._raw.read(length)
                if len(data) != length:
                    raise BadInput(f"the object ends at byte {at + len(data):,} of {self.size:,}", where=str(self.path))
        except BadInput as problem:
            self.problem = problem
            raise
        self.fetched, self.requests = self.fetched + length, self.requests + 1
        self._ranges.append((at, data))
        return at, data

    def close(self) -> None:
        """Close the object and drop the kept ranges."""
        if not self.closed:
            self._ranges.clear()
            with suppress(OSError):
                self._raw.close()
        super().close()


_NO_ANSWER = ("HTTPClientError", "ConnectionError", "FSTimeoutError")
_NO_CREDENTIALS = ("NoCredentialsError", "PartialCredentialsError", "CredentialRetrievalError", "ProfileNotFound")


def _explain(path: StorePath, error: Exception) -> BadInput:
    """Return the exception of a store's client as a BadInput of one line; types of clients are recognised by name."""
    names, where = [kind.__name__ for kind in type(error).__mro__], str(path)
    if "FileExpired" in names or "PreconditionFailed" in str(error):
        return BadInput("was replaced while it was read", where=where, hint="run the same command again")
    if "The specified bucket does not exist" in str(error):
        return BadInput(f"there is no bucket {path.bucket!r}", where=where)
    if isinstance(error, FileNotFoundError):
        return BadInput("there is no such object", where=where)
    if any(name in names for name in _NO_CREDENTIALS):
        hint = "set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or AWS_PROFILE"
        return BadInput(f"no credentials for it: {error}", where=where, hint=hint)
    if isinstance(error, PermissionError):
        hint = "check AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY and their permissions"
        return BadInput(f"the store refuses: {_error_message(error)}", where=where, hint=hint)
    if any(name in names for name in _NO_ANSWER):
        hint = "check AWS_ENDPOINT_URL and AWS_DEFAULT_REGION"
        return BadInput(f"the store does not answer: {_error_message(error)}", where=where, hint=hint)
    return BadInput(f"the store cannot be used: {_error_message(error)}", where=where)


def _error_message(error: Exception) -> str:
    return (error.strerror if isinstance(error, OSError) else None) or str(error) or type(error).__name__
