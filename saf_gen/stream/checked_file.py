"""Reading of HDF5 files from untrusted sources, without following links or loading anything large or unknown.

An HDF5 file can contain links and datasets that read other files, filters that run other code, and sizes that fill the
memory. A stream has a few known datasets, stored inside the file; this is checked before any value is read.
"""

import math
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import IO, Any, ClassVar, Self

import h5py
import numpy as np

from saf_gen.core.plain_text import plural
from saf_gen.errors import BadInput, closest
from saf_gen.stream.metadata import ARRAY_DATASETS, MAX_PIXELS, metadata_from_datasets

GROUPS = ("focus", "light", "pixels", "time", "truth", "provenance")
NAMES = frozenset(["/spikes", "/light/names", *(name for name, _, _ in ARRAY_DATASETS.values())])
"""The datasets that a stream may have, in addition to any text in ``/provenance``."""
MAX_SMALL_BYTES = 1 << 29
MAX_DEFLATED_BYTES = 1 << 20
"""Largest stored size, in bytes, of a compressed small dataset, which may expand a thousandfold."""
MAX_CHUNK_BYTES = 1 << 24
MAX_TEXT_BYTES = 1 << 24
MAX_NAMES = 1_000
ALLOWED_FILTERS = (h5py.h5z.FILTER_DEFLATE, h5py.h5z.FILTER_SHUFFLE)
_HEAP_HEAD, _HEAP_PIECE = struct.Struct("<5s3xQ"), struct.Struct("<H6xQ")
_REFERENCE_BYTES = 16
"""Bytes that a dataset holds for each text of variable length: four for its length, the others for its location."""


def read_attribute(item: h5py.File | h5py.Dataset, name: str, *, number: bool = False) -> Any:
    """Return an attribute that is a number or text; None if it is missing, an array, too long, or of another type.

    ``number`` allows no text. HDF5 may look for a text for ever in a file made to harm, so that no text is read before
    :func:`read_small_datasets` has checked where texts are stored.
    """
    if not h5py.h5a.exists(item.id, name.encode()):
        return None
    kind = h5py.h5a.open(item.id, name.encode())
    if kind.shape != () or (kind.dtype.kind not in "iufO" and kind.dtype.itemsize > 1024):
        return None
    if number and kind.dtype.kind not in "iuf":
        return None
    value = item.attrs[name]
    return value if isinstance(value, str | np.integer | np.floating) else None


def holds(file: h5py.File, name: str) -> bool:
    """Return whether a file has something of this name at its top, which may be a link, without following it."""
    return bool(file.id.links.exists(name.encode()))


@contextmanager
def report_damage(path: Path) -> Iterator[None]:
    """Raise BadInput instead of what HDF5 raises for a file that is damaged."""
    try:
        yield
    except (OSError, RuntimeError, KeyError, ValueError) as error:
        raise BadInput(
            f"is damaged: {str(error).splitlines()[0]:.120}", where=str(path), hint="record it again, or copy it again"
        ) from error


class CheckedFile:
    """An open HDF5 file of a camera, of which all but its large datasets was checked and read.

    Attributes
    ----------
    path : Path
        The file.
    metadata : Metadata
        Lens, light and truth, as in a stream file; ``truth``, ``focus_position``, ``gain`` and ``light_names`` are its.
    content_sha256 : str
        Digest of the content.
    """

    form: ClassVar[str]
    path: Path
    shape: tuple[int, int, int]
    readout_hz: float

    def _open(self, path: Path, *, holding: str, form: tuple[str, int], bulk: tuple[str, ...]) -> None:
        """Open a file that holds something at its top, with this format and layout, and read its small datasets.

        Raises BadInput if it is missing, not HDF5, or another file; all texts are checked before any is read.
        """
        self.path, where = path, str(path)
        if not path.is_file():
            raise BadInput("there is no such file", where=where, allowed=f"a file of {holding} of saf-gen recapture")
        try:
            self._file = h5py.File(path, "r")
        except OSError as error:
            raise BadInput(f"cannot be read as HDF5: {error}", where=where, allowed=f"a file of {holding}") from error
        if not holds(self._file, holding) or "format" not in self._file.attrs:
            raise BadInput(
                f"is HDF5, but holds no {holding} of ours",
                where=where,
                allowed=f"attribute format = {form[0]!r}",
                hint="record them with saf-gen recapture",
            )
        if (layout := read_attribute(self._file, "layout", number=True)) != form[1]:
            raise BadInput(f"its layout version is {layout!r}", where=where, allowed=str(form[1]))
        self._small = dict(read_small_datasets(self._file, where, bulk=bulk))
        if (found := read_attribute(self._file, "format")) != form[0]:
            raise BadInput(f"its format is {found!r}", where=where, allowed=form[0])
        self.content_sha256 = str(read_attribute(self._file, "content_sha256"))

    def _read_metadata(self) -> None:
        """Take the metadata from the small datasets, once ``shape`` is known."""
        self.metadata = metadata_from_datasets(self._small, self.shape, form=self.form)
        self.counted = self.metadata.kind
        self.truth, self.focus_position = self.metadata.truth, self.metadata.focus_position
        self.gain, self.light_names = self.metadata.gain, self.metadata.light_names

    def _check_content(self, found: str) -> None:
        """Raise BadInput unless this digest of the content is the stored one."""
        if found != self.content_sha256:
            raise BadInput(
                f"the content has SHA-256 {found[:12]}...",
                where=str(self.path),
                allowed=f"{self.content_sha256:.12}... as stored",
                hint="make it again",
            )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def open_spikes(file: h5py.File, where: str) -> h5py.Dataset:
    """Return ``/spikes``.

    Raises BadInput if it is a link, is stored outside the file, has the wrong type, other filters, too many pixels or
    too large chunks, or was not written to its end.
    """
    spikes = open_dataset(file, "spikes", where=where, bulk=True)
    if spikes.dtype != np.uint8 or spikes.ndim != 3 or 0 in spikes.shape:
        raise BadInput(f"/spikes is {spikes.dtype} {spikes.shape}", where=where, allowed="uint8 (H, W, ceil(T/8))")
    rows, columns, _ = spikes.shape
    if rows * columns > MAX_PIXELS:
        raise BadInput(f"/spikes has {rows * columns:,} pixels", where=where, allowed=f"at most {MAX_PIXELS:,}")
    check_stored(spikes, where=where)
    return spikes


def check_stored(item: h5py.Dataset, *, where: str) -> None:
    """Raise BadInput if a dataset that is read in pieces has too large chunks, or was not written to its end."""
    if item.chunks is None:
        parts, written = min(item.size, 1), int(item.id.get_storage_size() > 0)
    else:
        if (held := math.prod(item.chunks) * item.dtype.itemsize) > MAX_CHUNK_BYTES:
            raise BadInput(
                f"{item.name} has chunks of {held:,} bytes", where=where, allowed=f"at most {MAX_CHUNK_BYTES:,}"
            )
        parts = math.prod(-(-n // c) for n, c in zip(item.shape, item.chunks, strict=True))
        written = item.id.get_num_chunks()
    if written < parts:  # HDF5 would read zeros there
        raise BadInput(
            f"{item.name} was not written to its end: {written:,} of {plural(parts, 'chunk')}",
            where=where,
            hint="write or copy the file again",
        )


def check_deflated(item: h5py.Dataset, *, where: str) -> None:
    """Raise BadInput if a chunk has more bytes in the file than in memory: HDF5 would inflate it a thousandfold."""
    held = math.prod(item.chunks) * item.dtype.itemsize
    largest = held + held // 100 + 1024  # what cannot be compressed grows a little
    if size := item.id.chunk_iter(lambda chunk: chunk.size if chunk.size > largest else None):
        raise BadInput(
            f"{item.name} has a chunk of {size:,} bytes that holds {held:,}", where=where, hint="make it again"
        )


def read_small_datasets(
    file: h5py.File, where: str, *, bulk: tuple[str, ...] = ("spikes",)
) -> Iterator[tuple[str, Any]]:
    """Yield the name and value of every dataset except those that ``bulk`` names; text is str.

    Raises BadInput before reading anything that a stream does not contain.
    """
    checked_heaps = {0}
    groups = dict.fromkeys([*GROUPS, *(name.split("/")[0] for name in bulk if "/" in name)])
    _check_names(file, "", where=where, known=[*groups, *(name for name in bulk if "/" not in name)])
    with Path(file.filename).open("rb") as raw:
        for group in groups:
            if group not in file:
                continue
            _check_link(file, group, where=where)
            held = file[group]
            if not isinstance(held, h5py.Group):
                raise BadInput(f"/{group} is not a group", where=where, allowed="a saf-gen stream")
            names = [*NAMES, *(f"/{name}" for name in bulk)]
            known = [name.split("/")[2] for name in names if name.startswith(f"/{group}/")]
            _check_names(held, group, where=where, known=known if group != "provenance" else None)
            for name in held:
                if f"{group}/{name}" in bulk:
                    continue
                item = open_dataset(file, f"{group}/{name}", where=where)
                is_text = h5py.check_string_dtype(item.dtype) is not None
                if is_text != (group == "provenance" or name == "names"):
                    raise BadInput(
                        f"/{group}/{name} holds {item.dtype}",
                        where=where,
                        allowed="text in names and in provenance, otherwise numbers",
                    )
                if is_text:
                    _check_text_length(item, raw, where=where, checked_heaps=checked_heaps)
                yield f"/{group}/{name}", (item.asstr() if is_text else item)[()]


def _check_names(group: h5py.Group, path: str, *, where: str, known: list[str] | None) -> None:
    """Raise BadInput if a group has too many or unknown names; if ``known`` is None, any name is allowed."""
    if len(group) > MAX_NAMES:
        raise BadInput(f"/{path} holds {len(group):,} names", where=where, allowed=f"at most {MAX_NAMES:,}")
    for name in group:
        if known is not None and name not in known:
            raise BadInput(
                f"holds /{path}{'/' * bool(path)}{name}, which is not part of a stream",
                where=where,
                allowed=", ".join(sorted(known)),
                nearest=closest(name, known),
            )


def _check_link(file: h5py.File, name: str, *, where: str) -> None:
    if file.id.links.get_info(name.encode()).type != h5py.h5l.TYPE_HARD:
        raise BadInput(f"/{name} is a link", where=where, allowed="data inside the file")


def open_dataset(file: h5py.File, name: str, *, where: str, bulk: bool = False) -> h5py.Dataset:
    """Return a dataset; raise BadInput unless it is inside the file, of a plain type and not too large.

    ``bulk`` allows any size, for what is read in pieces.
    """
    _check_link(file, name, where=where)
    # A stream has two dozen datasets, and these checks take most of the time to open it: h5py's high-level interface
    # would take twice as long.
    opened = h5py.h5o.open(file.id, name.encode())
    if not isinstance(opened, h5py.h5d.DatasetID):
        raise BadInput(f"/{name} is not a dataset", where=where, allowed="a saf-gen stream")
    item = h5py.Dataset(opened, readonly=True)
    dtype, shape = item.dtype, item.shape
    stored = opened.get_create_plist()
    if stored.get_layout() == h5py.h5d.VIRTUAL or stored.get_external_count():
        raise BadInput(f"/{name} is stored in other files", where=where, allowed="data inside the file")
    filters = [stored.get_filter(i)[0] for i in range(stored.get_nfilters())]
    if not set(filters) <= set(ALLOWED_FILTERS) or len(set(filters)) < len(filters):  # deflated twice, a millionfold
        raise BadInput(
            f"/{name} has the filters {filters}", where=where, allowed="deflate (1) and shuffle (2), each once"
        )
    plain = dtype.kind in "buif" and dtype.itemsize <= 8 and not dtype.subdtype
    if shape is None or not (plain or h5py.check_string_dtype(dtype)):
        raise BadInput(f"/{name} holds {dtype}", where=where, allowed="numbers or text")
    if not bulk:
        if math.prod(shape) * dtype.itemsize > MAX_SMALL_BYTES:
            raise BadInput(f"/{name} has the shape {shape}", where=where, allowed=f"{MAX_SMALL_BYTES:,} bytes at most")
        if filters and opened.get_storage_size() > MAX_DEFLATED_BYTES:
            raise BadInput(
                f"/{name} is compressed", where=where, allowed="large datasets without compression, except /spikes"
            )
    return item


def _check_text_length(item: h5py.Dataset, raw: IO[bytes], *, where: str, checked_heaps: set[int]) -> None:
    """Raise BadInput if a dataset of text is too long.

    The lengths of variable-length texts are read from the ``raw`` file, where they are stored with the references to
    the texts.
    """
    if item.ndim > 1 or item.size > MAX_NAMES:
        raise BadInput(f"{item.name} holds text of the shape {item.shape}", where=where, allowed="one text, or a list")
    total = item.size * item.dtype.itemsize
    if h5py.check_string_dtype(item.dtype).length is None:
        at = item.id.get_offset()
        if at is None:
            if item.id.get_storage_size():
                raise BadInput(f"{item.name} is stored in pieces", where=where, allowed="text stored in one piece")
            return
        raw.seek(at)
        references = np.frombuffer(raw.read(_REFERENCE_BYTES * item.size), np.uint8).reshape(-1, _REFERENCE_BYTES)
        for heap in {int(begin) for begin in references[:, 4:12].copy().view("<u8").ravel()} - checked_heaps:
            _check_text_heap(raw, heap, where=f"{where}: {item.name}")
            checked_heaps.add(heap)
        total = int(references[:, :4].copy().view("<u4").sum(dtype=np.int64))
    if total > MAX_TEXT_BYTES:
        raise BadInput(f"{item.name} holds {total:,} bytes of text", where=where, allowed=f"at most {MAX_TEXT_BYTES:,}")


def _check_text_heap(raw: IO[bytes], begin: int, *, where: str) -> None:
    """Raise BadInput if the pieces of a text heap do not follow each other to its end; HDF5 would read it for ever.

    References
    ----------
    HDF5 File Format Specification 3.0, section III.E, Global Heap.
    """
    raw.seek(begin)
    head = raw.read(_HEAP_HEAD.size)
    signature, size = _HEAP_HEAD.unpack(head) if len(head) == _HEAP_HEAD.size else (b"", 0)
    if signature != b"GCOL\1" or not _HEAP_HEAD.size < size <= 2 * MAX_TEXT_BYTES:
        raise BadInput("its text is not in the file", where=where, hint="make the file again")
    pieces, at = raw.read(size - _HEAP_HEAD.size), 0
    while at + _HEAP_PIECE.size <= len(pieces):
        number, length = _HEAP_PIECE.unpack_from(pieces, at)
        step = length if number == 0 else _HEAP_PIECE.size + -(-length // 8) * 8  # 0 marks free space
        if step < _HEAP_PIECE.size or at + step > len(pieces):
            raise BadInput("its text is stored in broken pieces", where=where, hint="make the file again")
        at += step
