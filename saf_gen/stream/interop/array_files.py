"""Arrays in untrusted files, NumPy's .npy and .npz and MATLAB's .mat, read a few slices at a time.

Nothing in such a file is executed: pickled objects are refused. A dark recording packs a thousand to one, so the ratio
of a packed file says nothing; it is read in pieces instead. The memory that this takes does not depend on the size of
the array, because a slice along the first axis has at most MAX_SLICE_BYTES, and the time is that of unpacking, because
the bytes that an array states must be in the file.
"""

import os
import struct
import subprocess
import sys
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from math import prod
from pathlib import Path
from tempfile import TemporaryDirectory
from tokenize import TokenError
from typing import IO, Any, Protocol
from warnings import catch_warnings

import numpy as np

from saf_gen.core.files import HDF5_SIGNATURE
from saf_gen.errors import BadInput, unknown

ENDINGS = (".npy", ".npz", ".mat")
MAX_CHUNK_BYTES = 64 << 20
"""Largest chunk of a MATLAB file of version 7.3; HDF5 always decompresses complete chunks."""
MAX_OLD_MATLAB_BYTES = 400 << 20
"""Largest array of a MATLAB file before version 7.3, which is always read completely."""
MAX_SLICE_BYTES = 128 << 20
"""Largest slice along the first axis of a packed array, of which one is always read completely."""
MAX_DEFLATED = 1_100
"""A little more than the ratio to which deflate packs zeros, 1,032."""
DAMAGE = (
    *(OSError, ValueError, EOFError, LookupError, TypeError, AttributeError, ArithmeticError, RuntimeError),
    *(SyntaxError, TokenError, NotImplementedError, zipfile.BadZipFile, zlib.error, struct.error),
)
"""Exceptions that the libraries raise for damaged files, depending on where the damage is."""


_MATLAB_BYTES = {"double": 8, "single": 4, "logical": 1} | {
    f"{sign}int{8 * size}": size for sign in ("", "u") for size in (1, 2, 4, 8)
}
"""Bytes of the real numbers of MATLAB, by class."""
_LOAD = """
import sys, numpy, scipy.io
path, name, kind, out = sys.argv[1:]
values = scipy.io.loadmat(path, appendmat=False, variable_names=[name])[name]
numpy.save(out, values != 0 if kind == "logical" else values)
"""


class SlicedArray(Protocol):
    """An array that is read by slices along its first axis; reading it from start to end is cheapest."""

    @property
    def shape(self) -> tuple[int, ...]: ...

    @property
    def dtype(self) -> np.dtype: ...

    def __getitem__(self, span: slice) -> np.ndarray: ...


def open_array(path: str | os.PathLike[str], *, key: str | None = None, axes: int = 3) -> SlicedArray:
    """Return an array of a .npy, .npz or .mat file.

    The axes of a .mat file are permuted to put the last first, because MATLAB stores frames along the last axis.
    ``key`` names the array if the file has several with ``axes`` axes or more.

    Raises BadInput if the file has another ending, is missing, is damaged or holds objects, or if the key is missing
    or unknown.
    """
    where = Path(path)
    ending = where.suffix.lower()
    if ending not in ENDINGS:
        raise unknown("kind of file", where.suffix, allowed=ENDINGS, where=str(path))
    if not where.is_file():
        raise BadInput("there is no such file", where=str(path))
    if key is not None and ending == ".npy":
        raise BadInput(f"--key {key} is given for a file with one array", where=str(path), hint="leave it out")
    with _report_damage(where):
        if ending == ".npy":
            return np.lib.format.open_memmap(where, mode="r")  # np.load would open other formats, too
        packed: SlicedArray
        if ending == ".npz":
            packed = _ArchivedArray(where, key=key, axes=axes)
        else:
            with where.open("rb") as file:
                is_hdf5 = _is_hdf5(file.read(1024))
            if not is_hdf5:
                return _read_old_matlab(where, key=key, axes=axes)
            packed = _HdfArray(where, key=key, axes=axes)
        if (size := prod(packed.shape[1:]) * packed.dtype.itemsize) > MAX_SLICE_BYTES:
            raise BadInput(
                f"the array has the shape {packed.shape}, of which one slice takes {size:,} bytes", where=str(path),
                allowed=f"at most {MAX_SLICE_BYTES:,}", hint="store it with time on the first axis, or as .npy",
            )  # fmt: skip
        return packed


def check_packing(member: zipfile.ZipInfo) -> zipfile.ZipInfo:
    """Return a member of a zip archive; raise ValueError unless it is stored or deflated, as by NumPy and spreadsheets.

    Of other methods, zipfile unpacks 4 KiB at once, which may hold gigabytes.
    """
    if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise ValueError(f"{member.filename} is packed by method {member.compress_type}; allowed: 0 and 8 (deflate)")
    return member


@contextmanager
def _report_damage(path: Path) -> Iterator[None]:
    try:
        yield
    except DAMAGE as error:
        raise BadInput(f"cannot be read: {error}", where=str(path), allowed="complete arrays of numbers") from error


def _is_hdf5(head: bytes) -> bool:
    return head.startswith(HDF5_SIGNATURE) or head[512:520] == HDF5_SIGNATURE  # MATLAB writes 512 bytes before it


def _choose_array(found: Mapping[str, tuple[int, ...]], key: str | None, *, axes: int, where: str) -> str:
    """Return the name of the array to read; ``found`` holds the shapes of all arrays by name."""
    if key is not None:
        if key not in found:
            raise unknown("array", key, allowed=found, where=where)
        return key
    fitting = [name for name, shape in found.items() if len(shape) >= axes]
    if len(fitting) != 1:
        listed = ", ".join(f"{name} {shape}" for name, shape in found.items()) or "none"
        number, of, how = ("three", "frames, ", "--key") if axes == 3 else ("two", "", "FILE:NAME")
        raise BadInput(
            f"has {len(fitting) or 'no'} arrays of {number} axes (it holds: {listed})", where=where,
            allowed=f"one array of ({of}rows, columns)", hint=f"name one with {how}" if fitting else "",
        )  # fmt: skip
    return fitting[0]


class _ArchivedArray:
    """An array in a .npz, which is a zip of .npy files; it is decompressed from start to end."""

    def __init__(self, path: Path, *, key: str | None, axes: int) -> None:
        self._path, self._archive = path, zipfile.ZipFile(path)
        headers = {}
        members = self._archive.infolist()
        if len({info.header_offset for info in members}) != len(members):
            raise ValueError("several of its members are one and the same")
        for info in members:
            if info.filename.endswith(".npy"):
                with self._archive.open(check_packing(info)) as file:
                    headers[info.filename.removesuffix(".npy")] = (*_read_header(file), info)
        self.name = name = _choose_array({n: h[0] for n, h in headers.items()}, key, axes=axes, where=str(path))
        self.shape, in_columns, self.dtype, self._begin, self._info = headers[name]
        if self.dtype.hasobject or in_columns:
            problem = "objects" if self.dtype.hasobject else "an array in Fortran order"
            raise BadInput(f"{name} holds {problem}", where=str(path), allowed="numbers, in C order")
        self._slice_bytes = prod(self.shape[1:]) * self.dtype.itemsize
        if self._begin + self.shape[0] * self._slice_bytes != self._info.file_size:
            raise BadInput(
                f"{name} has {self._info.file_size} bytes", where=str(path), allowed="the size that its header states"
            )
        self._file: IO[bytes] | None = None
        self._at = -1

    def __getitem__(self, span: slice) -> np.ndarray:
        first, stop, _ = span.indices(self.shape[0])
        with _report_damage(self._path):
            if self._file is None or self._at != first:
                if self._file is not None:
                    self._file.close()
                self._file = self._archive.open(self._info)
                self._file.seek(self._begin + first * self._slice_bytes)
            raw = self._file.read((stop - first) * self._slice_bytes)
            self._at = stop
            return np.frombuffer(raw, self.dtype).reshape(stop - first, *self.shape[1:])


def _read_header(file: Any) -> tuple[tuple[int, ...], bool, np.dtype, int]:
    version = np.lib.format.read_magic(file)
    read = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    if version not in read:
        raise ValueError(f"version {version} of the .npy format")
    return *read[version](file), file.tell()


class _HdfArray:
    """An array of a MATLAB file of version 7.3, which is HDF5 with the axes in reverse order."""

    def __init__(self, path: Path, *, key: str | None, axes: int) -> None:
        import h5py

        self._path, self._file = path, h5py.File(path, "r")
        found: dict[str, Any] = {}
        for name in self._file:
            link = self._file.get(name, getlink=True)
            item: Any = self._file[name] if isinstance(link, h5py.HardLink) else None  # others may leave the file
            plain = isinstance(item, h5py.Dataset) and not item.is_virtual and not item.external
            if plain and item.dtype.kind in "buif" and _is_safely_stored(item):
                found[name] = item
        name = _choose_array({n: d.shape for n, d in found.items()}, key, axes=axes, where=str(path))
        self._data = found[name]
        states, holds = self._data.size * self._data.dtype.itemsize, self._data.id.get_storage_size()
        if states > holds * (MAX_DEFLATED if self._data.compression else 1):  # HDF5 would make up the rest
            raise BadInput(f"{name} states {states:,} bytes, and the file holds {holds:,} of it", where=str(path))
        self.shape = (self._data.shape[0], *self._data.shape[:0:-1])
        self.dtype = self._data.dtype

    def __getitem__(self, span: slice) -> np.ndarray:
        with _report_damage(self._path):
            block = self._data[span]
        return np.asarray(block.transpose(0, *range(block.ndim - 1, 0, -1)))


def _is_safely_stored(item: Any) -> bool:
    """Return whether an array has only filters that MATLAB uses, each once, and chunks of at most MAX_CHUNK_BYTES.

    Other filters could run other code, and what is deflated twice unpacks a million to one.
    """
    from h5py import h5z

    plist = item.id.get_create_plist()
    filters = [plist.get_filter(n)[0] for n in range(plist.get_nfilters())]
    allowed = {h5z.FILTER_DEFLATE, h5z.FILTER_SHUFFLE, h5z.FILTER_FLETCHER32}
    plain = allowed.issuperset(filters) and len(set(filters)) == len(filters)
    return plain and prod(item.chunks or (1,)) * item.dtype.itemsize <= MAX_CHUNK_BYTES


def _read_old_matlab(path: Path, *, key: str | None, axes: int) -> np.ndarray:
    """Return an array of a MATLAB file of version 5 to 7.2, with its last axis first, by a copy in a temporary file.

    It is read in a process of its own, because a damaged file can crash scipy's reader.
    """
    from scipy.io import matlab, whosmat

    try:
        with path.open("rb") as file, catch_warnings(action="error", category=matlab.MatReadWarning):
            if matlab.matfile_version(file)[0] != 1:
                raise ValueError("it is not a MATLAB file of version 5 to 7.3")
            listed = {name: (shape, kind) for name, shape, kind in whosmat(file) if kind in _MATLAB_BYTES}
    except (matlab.MatReadError, matlab.MatReadWarning) as error:
        raise ValueError(str(error)) from error
    name = _choose_array({n: shape for n, (shape, _) in listed.items()}, key, axes=axes, where=str(path))
    shape, kind = listed[name]
    if (size := prod(shape) * _MATLAB_BYTES[kind]) > MAX_OLD_MATLAB_BYTES:
        raise BadInput(
            f"{name} has {size:,} bytes", where=str(path), allowed=f"at most {MAX_OLD_MATLAB_BYTES:,}",
            hint="save it with -v7.3, which is read in parts",
        )  # fmt: skip
    with TemporaryDirectory(prefix="saf-gen-") as folder:
        out = Path(folder) / "array.npy"
        run = subprocess.run(
            [sys.executable, "-W", "error", "-c", _LOAD, str(path), name, kind, str(out)],
            capture_output=True,
            text=True,
        )
        if run.returncode:
            raise ValueError((run.stderr.strip() or "its reader crashed").splitlines()[-1])
        array = np.load(out, mmap_mode="r")
    return np.moveaxis(array, -1, 0)
