"""Files in object stores, ``s3://bucket/folder/name``, which are read like files on a disk: the one door to fsspec.

Objects are read by ranges, and an object that is replaced or deleted meanwhile is told, never mixed. Endpoint and
credentials come from the environment and the files that all programs for S3 read (``AWS_ENDPOINT_URL``,
``AWS_ACCESS_KEY_ID``, ``AWS_PROFILE``, ...). :mod:`saf_gen.core.object_transfers` writes objects.
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
"""The package that fsspec needs for each scheme; it is that of the extra of the same name."""
_ADDRESS = re.compile(r"(?P<scheme>[A-Za-z][A-Za-z0-9+.-]+):/{1,2}(?P<key>.*)", re.DOTALL)
FIRST_RANGE, LARGEST_RANGE, KEPT_RANGES = 1 << 16, 1 << 20, 8
"""Bytes of a range where reading jumps, at most where it goes on, and how many ranges an open object keeps."""


@dataclass(frozen=True, order=True)
class StorePath:
    """The path of an object, or of a folder of objects; it offers what readers ask of a ``pathlib.Path``.

    ``key`` is all that follows ``scheme://``: the bucket, and the name in it. All methods raise BadInput where the
    store cannot be asked.
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
        """The name without what follows its last dot."""
        return PurePosixPath(self.key).stem

    @property
    def suffix(self) -> str:
        """What follows the last dot of the name, with it."""
        return PurePosixPath(self.key).suffix

    @property
    def parent(self) -> "StorePath":
        """The folder that holds this; that of a bucket is the bucket."""
        above = str(PurePosixPath(self.key).parent)
        return self if above in (".", "/") else StorePath(self.scheme, above)

    @property
    def bucket(self) -> str:
        """The first part of the path."""
        return self.key.split("/", 1)[0]

    def with_name(self, name: str) -> "StorePath":
        """Return the path of another name in the same folder."""
        return StorePath(self.scheme, str(PurePosixPath(self.key).with_name(name)))

    def resolve(self) -> Self:
        """Return the same path: an object has one name."""
        return self

    def file_system(self) -> Any:
        """Return fsspec's file system; raises BadInput where the package of this scheme is missing."""
        require_extra(self.scheme, "fsspec", SCHEMES[self.scheme], of=f"{self.scheme}://")
        import fsspec

        options = {"use_listings_cache": False} if self.scheme == "s3" else {}
        return fsspec.filesystem(self.scheme, **options)

    def exists(self) -> bool:
        """Return whether there is an object or a folder of this name."""
        return self._facts() is not None

    def is_file(self) -> bool:
        """Return whether this is an object."""
        return (self._facts() or {}).get("type") == "file"

    def is_dir(self) -> bool:
        """Return whether this is a folder that holds objects, or a bucket."""
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
        """Return size and time of an object; raises BadInput where there is none."""
        facts = self._facts()
        if facts is None or facts["type"] != "file":
            raise BadInput("there is no such object", where=str(self))
        changed = facts.get("LastModified") or facts.get("created")
        seconds = changed.timestamp() if changed else 0.0
        return os.stat_result((stat.S_IFREG, 0, 0, 1, 0, 0, facts["size"], seconds, seconds, seconds))

    def iterdir(self) -> Iterator["StorePath"]:
        """Yield what lies in a folder."""
        with self.report_problems():
            found = self.file_system().ls(self.key, detail=False)
        yield from (StorePath(self.scheme, key.strip("/")) for key in found)

    def open(self, mode: str = "rb") -> "ObjectReader":
        """Open an object for reading; its content is that of now, or reading ends in BadInput."""
        with self.report_problems():
            raw = self.file_system().open(self.key, mode, cache_type="none")
            return ObjectReader(self, raw, raw.seek(0, io.SEEK_END))

    def read_text(self, encoding: str = "utf-8") -> str:
        """Return the text of an object; ends of lines become a newline."""
        with self.open() as raw:
            return io.TextIOWrapper(io.BytesIO(raw.read()), encoding=encoding).read()

    @contextmanager
    def report_problems(self) -> Iterator[None]:
        """Turn whatever a store's client raises into one line."""
        try:
            yield
        except BadInput:
            raise
        except Exception as error:
            raise _explain(self, error) from error


AnyPath = Path | StorePath
"""A path on a disk or in an object store."""


def find_path(source: "str | os.PathLike[str] | StorePath") -> AnyPath:
    """Return the path that a text names: ``s3://bucket/name`` in an object store, all else on a disk.

    A Path that was made of such an address, and has lost one of its slashes, is understood too. Raises BadInput for the
    address of something else.
    """
    if isinstance(source, StorePath):
        return source
    text = os.fspath(source)
    found = _ADDRESS.fullmatch(text)
    if found is None or Path(f"{found['scheme']}:").exists():
        return Path(source)
    scheme = found["scheme"].lower()
    if scheme not in SCHEMES:
        hint = "saf-gen fetch takes packed datasets from http servers" if scheme in ("http", "https") else ""
        allowed = f"{', '.join(f'{one}://' for one in SCHEMES)}, or a path on a disk"
        raise BadInput(f"{scheme}:// is no kind of address that is known", where=text, allowed=allowed, hint=hint)
    key = str(PurePosixPath(found["key"].strip("/")))
    if key in (".", "") or ".." in PurePosixPath(key).parts:
        raise BadInput("names no bucket", where=text, allowed=f"{scheme}://BUCKET/FOLDER")
    return StorePath(scheme, key)


def check_on_disk(path: Path) -> None:
    """Raise BadInput for a path that names an object store: files are written there by ``generate`` alone."""
    if not path.is_absolute() and isinstance(found := find_path(path), StorePath):
        raise BadInput(
            f"{found} is in an object store", allowed="a path on a disk; `saf-gen generate` alone writes to stores"
        )


class _Garbage:
    """Keeps Python from collecting garbage while HDF5 waits for an object, in any number of threads.

    HDF5 reads under a lock of h5py. The store's client answers from a thread of its own; if a collection there found
    something of h5py, it would wait for that lock for ever.
    """

    def __init__(self) -> None:
        self._lock, self._waiting, self._collects = threading.Lock(), 0, True

    @contextmanager
    def left_alone(self) -> Iterator[None]:
        """Collect nothing until the end of the ``with`` statement."""
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


_GARBAGE = _Garbage()


class ObjectReader(io.RawIOBase):
    """An open object: ranges that grow as reading goes on, and stay small where it jumps.

    It keeps the last eight ranges, a MiB each unless more is asked for at once. ``problem`` is what went wrong while
    HDF5 read, which tells that in other words; ``fetched`` counts bytes and ``requests`` ranges.
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
        """Return where the next byte is read."""
        return self._at

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        """Move to another byte, and return its number."""
        self._at = offset + {io.SEEK_SET: 0, io.SEEK_CUR: self._at, io.SEEK_END: self.size}[whence]
        return self._at

    def readinto(self, buffer: Any) -> int:
        """Fill a buffer, but for what lies after the end; raises BadInput where the object cannot be read."""
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
        """Return a range that holds the byte ``at``, fetched with at least ``needed`` bytes where it is not kept."""
        ahead = FIRST_RANGE
        for start, data in self._ranges:
            if start <= at < start + len(data):
                return start, data
            if at == start + len(data):
                ahead = min(2 * len(data), LARGEST_RANGE)
        length = min(max(needed, ahead), self.size - at)
        try:
            with self.path.report_problems(), _GARBAGE.left_alone():
                self._raw.seek(at)
                data = self._raw.read(length)
                if len(data) != length:
                    raise BadInput(f"ends at byte {at + len(data):,} of {self.size:,}", where=str(self.path))
        except BadInput as problem:
            self.problem = problem
            raise
        self.fetched, self.requests = self.fetched + length, self.requests + 1
        self._ranges.append((at, data))
        return at, data

    def close(self) -> None:
        """Forget what was read."""
        if not self.closed:
            self._ranges.clear()
            with suppress(OSError):
                self._raw.close()
        super().close()


_NO_ANSWER = ("HTTPClientError", "ConnectionError", "FSTimeoutError")
_NO_CREDENTIALS = ("NoCredentialsError", "PartialCredentialsError", "CredentialRetrievalError", "ProfileNotFound")


def _explain(path: StorePath, error: Exception) -> BadInput:
    """Return what a store's client raised as one line; clients have errors of their own, which are told by name."""
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
        hint = "look at AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY and what they may do"
        return BadInput(f"the store refuses: {_last_words(error)}", where=where, hint=hint)
    if any(name in names for name in _NO_ANSWER):
        hint = "look at AWS_ENDPOINT_URL and AWS_DEFAULT_REGION"
        return BadInput(f"the store does not answer: {_last_words(error)}", where=where, hint=hint)
    return BadInput(f"the store cannot be used: {_last_words(error)}", where=where)


def _last_words(error: Exception) -> str:
    return (error.strerror if isinstance(error, OSError) else None) or str(error) or type(error).__name__
