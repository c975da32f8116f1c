"""Counts of many windows in one pass over a stream: those of one window at a time."""

import h5py
import numpy as np
import pytest
from refusals import assert_says, refusal

from saf_gen import open_stream, write_stream
from saf_gen.core.bits import sum_trains
from saf_gen.stream.count_cache import KeptCounts

FRAMES = np.random.default_rng(0).integers(0, 2, (6_503, 7, 600), np.uint8)
REGION = slice(2, 7), slice(3, 8)


@pytest.fixture(scope="module")
def stream(tmp_path_factory):
    """A stream with blocks of 2,000 frames, and chunks of six of its seven rows."""
    path = tmp_path_factory.mktemp("counts") / "a.h5"
    write_stream(path, FRAMES)
    with h5py.File(path) as file:
        assert file["spikes"].chunks == (6, 600, 250)
    with open_stream(path) as stream:
        yield stream


@pytest.mark.slow
@pytest.mark.parametrize(
    ("first", "window", "stride", "region"),
    [
        *((0, 2_000, 2_000, None), (3, 3_000, 7, REGION), (0, 1, 1, REGION)),
        *((13, 300, 1_250, None), (40, 9, 6_000, REGION), (0, 6_503, 1, None)),
    ],
)
def test_windows_in_one_pass_are_those_read_alone(stream, region, first, window, stride):
    """Inside a block, over several, overlapping, with blocks that none needs, at both ends."""
    firsts = range(first, 6_503 - window + 1, stride)
    found = np.concatenate(list(stream.counts_of_windows(firsts, window, region=region)))
    rows, columns = region or (slice(None), slice(None))
    total = np.concatenate([[0 * FRAMES[0, rows, columns]], FRAMES[:, rows, columns].cumsum(axis=0, dtype=np.uint16)])
    assert np.array_equal(found, [total[t + window] - total[t] for t in firsts])
    assert found.dtype == (np.uint8 if window < 256 else np.uint16)


@pytest.mark.slow
def test_a_count_of_every_frame_fits(tmp_path):
    write_stream(tmp_path / "ones.h5", np.ones((600, 2, 2), np.uint8))
    with open_stream(tmp_path / "ones.h5") as ones:
        for window in (255, 256, 600):
            (counts,) = ones.counts_of_windows([0], window)
            assert (counts == window).all()


@pytest.mark.parametrize("size", [(1, 1, 1), (2, 3, 5)])
def test_trains_of_any_length_are_counted(size):
    trains = np.random.default_rng(1).integers(0, 256, size, np.uint8)
    frames = np.unpackbits(trains, axis=2, bitorder="little")
    total = 8 * size[2]
    firsts, stops = np.array([(a, b) for a in range(total) for b in range(a + 1, total + 1)]).T
    counts = np.ones((len(firsts), *size[:2]), np.uint16)
    sum_trains(trains, counts, firsts=firsts, stops=stops)
    assert np.array_equal(counts, [1 + frames[:, :, a:b].sum(axis=2) for a, b in zip(firsts, stops, strict=True)])


@pytest.mark.parametrize(
    ("firsts", "window"), [([0, 6_404], 100), ([-1, 5], 10), ([5, 4], 10), ([], 10), ([0.5], 10), ([0], 0)]
)
def test_windows_that_are_not_there_are_refused(stream, firsts, window):
    assert "whole numbers" in refusal(lambda: stream.counts_of_windows(firsts, window)).allowed


KEPT = np.random.default_rng(2).integers(0, 256, (5, 3, 4), np.uint8)


@pytest.fixture
def kept(tmp_path):
    kept = KeptCounts(tmp_path / "a.npy", KEPT.shape, KEPT.dtype, "of a")
    kept.write([KEPT[:2], KEPT[2:]])
    return kept


def test_kept_counts_are_an_array_that_numpy_reads(kept):
    assert kept.is_there()
    assert np.array_equal([kept.read(number) for number in range(5)], KEPT)
    assert np.array_equal(np.load(kept.path), KEPT)
    assert np.array_equal(np.load(kept.path, mmap_mode="r")[3], KEPT[3])


def swap_two_windows(data, first):
    data[first : first + 24] = data[first + 12 : first + 24] + data[first : first + 12]


CHANGES = {
    "one count is another": lambda data, first: data.__setitem__(first + 13, data[first + 13] ^ 1),
    "all counts are zero": lambda data, first: data.__setitem__(slice(first, first + 60), bytes(60)),
    "counts and checksums are zero": lambda data, first: data.__setitem__(slice(first, None), bytes(len(data) - first)),
    "two windows changed places": swap_two_windows,
    "a checksum is another": lambda data, first: data.__setitem__(first + 64, data[first + 64] ^ 1),
}


@pytest.mark.parametrize("kind", CHANGES)
def test_counts_that_were_changed_behind_their_header_are_refused(kept, kind):
    data = bytearray(kept.path.read_bytes())
    CHANGES[kind](data, len(data) - 5 * (12 + 4))
    kept.path.write_bytes(data)
    assert kept.is_there()
    error = refusal(kept.read, 1)
    assert_says(error, f"{kept.path} | are not those that were counted | delete the file")


def test_a_file_that_is_emptied_or_goes_while_it_is_used_is_refused(kept):
    kept.path.write_bytes(b"")
    assert_says(refusal(kept.read, 1), str(kept.path))
    kept.path.unlink()
    assert_says(refusal(kept.read, 1), f"{kept.path} | cannot be read: No such file")


def test_counts_of_one_recording_do_not_pass_for_those_of_another(kept, tmp_path):
    other = KeptCounts(tmp_path / "b.npy", kept.shape, kept.dtype, "of b")
    other.write([KEPT])
    other.path.replace(kept.path)
    assert kept.is_there()
    assert_says(refusal(kept.read, 0), "are not those that were counted")


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"\x93NUMPY", b"\x93NUMPY\x01\x00\xff\xff{", bytes(500)])
def test_other_files_are_no_kept_counts(kept, content):
    kept.path.write_bytes(content)
    assert not kept.is_there()
