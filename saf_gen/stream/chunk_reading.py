"""Chunks of spikes as stored: those that this package writes, and those of other software, which have any shape."""

import itertools
import math
from collections.abc import Callable

import h5py
import numpy as np

from saf_gen.stream.time_blocks import inflate_stream_chunk, stream_chunk_shape

ChunkReader = Callable[[int, int], bytes | np.ndarray]


def choose_stream_chunk_reader(spikes: h5py.Dataset) -> ChunkReader:
    """Return a function that reads the chunk of ``spikes`` at (row, byte): deflated bytes, or the inflated array."""
    read = _read_standard_chunk if _has_standard_chunks(spikes) else _read_any_chunk
    return lambda row, byte: read(spikes, (row, 0, byte))


def _has_standard_chunks(spikes: h5py.Dataset) -> bool:
    """Return whether chunks can be read as stored: of the standard shape, with deflate only, and none missing."""
    chunk = stream_chunk_shape(spikes.shape)
    grid = math.prod(-(-n // c) for n, c in zip(spikes.shape, chunk, strict=True))
    filters = spikes.id.get_create_plist()
    return (
        spikes.chunks == chunk
        and filters.get_nfilters() == 1
        and filters.get_filter(0)[0] == h5py.h5z.FILTER_DEFLATE
        and spikes.id.get_num_chunks() == grid
    )


def _read_standard_chunk(spikes: h5py.Dataset, origin: tuple[int, int, int]) -> bytes | np.ndarray:
    skipped, data = spikes.id.read_direct_chunk(origin)
    # HDF5 itself skips the filter if deflate would make a chunk larger.
    return np.frombuffer(data, np.uint8).reshape(spikes.chunks) if skipped else data


def _read_any_chunk(spikes: h5py.Dataset, origin: tuple[int, int, int]) -> np.ndarray:
    """Return a chunk of the standard shape from a file of other software, which has chunks of any shape or none."""
    ends = zip(origin, stream_chunk_shape(spikes.shape), spikes.shape, strict=True)
    window = [slice(first, min(first + size, total)) for first, size, total in ends]
    if (chunk := spikes.chunks) is None:
        return spikes[tuple(window)]
    out = np.full([part.stop - part.start for part in window], spikes.fillvalue, np.uint8)
    firsts = [range(part.start // size * size, part.stop, size) for part, size in zip(window, chunk, strict=True)]
    for stored in itertools.product(*firsts):
        block = _inflate_foreign_chunk(spikes, stored)
        if block is not None:
            pairs = list(zip(window, stored, chunk, strict=True))
            to = tuple(slice(max(o - w.start, 0), min(o + c, w.stop) - w.start) for w, o, c in pairs)
            of = tuple(slice(max(w.start - o, 0), min(w.stop - o, c)) for w, o, c in pairs)
            out[to] = block[of]
    return out


def _inflate_foreign_chunk(spikes: h5py.Dataset, origin: tuple[int, ...]) -> np.ndarray | None:
    """Return the stored chunk that begins at (row, column, byte), or None if it was never written."""
    stored, chunk = spikes.id.get_create_plist(), spikes.chunks
    if spikes.id.get_chunk_info_by_coord(origin).byte_offset is None:
        return None
    skipped, data = spikes.id.read_direct_chunk(origin)
    filters = [stored.get_filter(i)[0] for i in range(stored.get_nfilters())]
    deflate = h5py.h5z.FILTER_DEFLATE  # the shuffle filter leaves single bytes in their order
    if deflate in filters and not skipped >> filters.index(deflate) & 1:
        return inflate_stream_chunk(data, chunk)
    return np.frombuffer(data, np.uint8).reshape(chunk)
