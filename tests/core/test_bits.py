"""Bits along time, compared with numpy's packing, on sizes that fit no block."""

import numpy as np
import pytest

from saf_gen.core import bits


def random_frames(count, rows=5, columns=7, seed=0):
    return np.random.default_rng(seed).integers(0, 2, (count, rows, columns), np.uint8)


def planes_of(frames):
    return np.packbits(frames, axis=0, bitorder="little")


@pytest.mark.parametrize(("count", "dtype"), [(1, bool), (8, np.float32), (64, np.uint8), (67, np.uint8)])
def test_packing_is_numpys_along_time(count, dtype):
    frames = random_frames(count).astype(dtype)
    assert np.array_equal(bits.pack_bits(frames), planes_of(frames != 0).transpose(1, 2, 0))


@pytest.mark.parametrize(("first", "stop"), [(0, 67), (3, 4), (7, 9), (8, 16), (66, 67), (5, 5)])
def test_unpacking_gives_back_any_window(first, stop):
    frames = random_frames(67)
    out = np.full((stop - first, 5, 7), 9, np.uint8)
    bits.unpack_bits(planes_of(frames), out, first=first)
    assert np.array_equal(out, frames[first:stop])


def test_counts_of_every_window_are_sums():
    frames = random_frames(37)
    planes = planes_of(frames)
    for first in range(38):
        for stop in range(first, 38):
            counts = np.zeros((5, 7), np.uint32)
            bits.sum_planes(planes, counts, first=first, stop=stop)
            assert np.array_equal(counts, frames[first:stop].sum(axis=0)), (first, stop)


def test_counts_add_up_and_take_views():
    frames = np.ones((40, 5, 7), np.uint8)
    counts = np.full((2, 3), 10, np.uint32)
    bits.sum_planes(planes_of(frames)[:, 1:3, 2:5], counts, first=1, stop=39)
    assert np.array_equal(counts, np.full((2, 3), 48))


@pytest.mark.parametrize("count", [1, 8, 13, 16])
def test_turning_a_bit_matrix_is_a_transpose(count):
    rows = np.random.default_rng(1).integers(0, 256, (count, 3), np.uint8)
    tracks = bits.to_trains(rows)
    expected = np.unpackbits(rows, axis=1, bitorder="little").T
    assert np.array_equal(np.unpackbits(tracks, axis=1, bitorder="little")[:, :count], expected)
    assert not np.unpackbits(tracks, axis=1, bitorder="little")[:, count:].any()
    assert np.array_equal(bits.to_frames(tracks, count), rows)
