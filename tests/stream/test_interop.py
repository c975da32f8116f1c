"""Foreign layouts against plain decoders that read them bit by bit."""

import json

import numpy as np
import pytest
from reference_searches import literal_egs, literal_sgfs
from refusals import assert_says, refusal

from saf_gen.benchmark.evaluate import evaluate
from saf_gen.stream.interop import RAW_LAYOUTS, export_raw_frames, import_raw_frames
from saf_gen.stream.stream_file import open_stream
from saf_gen.stream.stream_writer import write_stream


def decoded(raw, layout, t):
    """Frame t of a file's bytes, decoded bit by bit, with rows in the file's order."""
    if layout == "416":
        frame = raw[13_000 * t : 13_000 * (t + 1)]
        return [[frame[52 * y + x // 8] >> (x % 8) & 1 for x in range(400)] for y in range(250)]
    if layout == "dense":
        frame = raw[12_500 * t : 12_500 * (t + 1)]
        return [[frame[(400 * y + x) // 8] >> ((400 * y + x) % 8) & 1 for x in range(400)] for y in range(250)]
    frame = raw[128_000 * t : 128_000 * (t + 1)]
    columns = [*range(500), *range(512, 1012)]
    return [[frame[128 * y + c // 8] >> (c % 8) & 1 for c in columns] for y in range(1000)]


def raw_file(path, layout, frames, seed=0):
    """Write random bytes, including those to be ignored, so that a reader that uses them fails."""
    raw = np.random.default_rng(seed).integers(0, 256, frames * RAW_LAYOUTS[layout].frame_bytes, np.uint8).tobytes()
    path.write_bytes(raw)
    return raw


@pytest.mark.parametrize("layout", sorted(RAW_LAYOUTS))
@pytest.mark.parametrize("flip", [False, True])
@pytest.mark.slow
def test_a_plain_decoder_agrees(tmp_path, layout, flip):
    raw = raw_file(tmp_path / "a.dat", layout, 11)
    import_raw_frames(tmp_path / "a.dat", tmp_path / "a.h5", layout=layout, flip=flip)
    with open_stream(tmp_path / "a.h5") as stream:
        assert stream.shape == (11, RAW_LAYOUTS[layout].rows, RAW_LAYOUTS[layout].columns)
        for t in (0, 10):
            expected = np.array(decoded(raw, layout, t), np.uint8)
            found = stream.frames(t, t + 1)[0]
            assert np.array_equal(found, expected[::-1] if flip else expected)


@pytest.mark.parametrize("layout", sorted(RAW_LAYOUTS))
@pytest.mark.parametrize("flip", [None, True])
def test_a_stream_goes_out_and_comes_back(tmp_path, layout, flip):
    size = (RAW_LAYOUTS[layout].rows, RAW_LAYOUTS[layout].columns)
    frames = np.random.default_rng(1).integers(0, 2, (13, *size), np.uint8)
    digest = write_stream(tmp_path / "a.h5", frames)
    written = export_raw_frames(tmp_path / "a.h5", tmp_path / "a.dat", layout=layout, flip=flip)
    assert (tmp_path / "a.dat").stat().st_size == written == 13 * RAW_LAYOUTS[layout].frame_bytes
    assert import_raw_frames(tmp_path / "a.dat", tmp_path / "b.h5", layout=layout, flip=flip) == digest


@pytest.mark.slow
def test_time_blocks_join_without_a_seam(tmp_path):
    raw = raw_file(tmp_path / "a.dat", "416", 2_003)
    import_raw_frames(tmp_path / "a.dat", tmp_path / "a.h5", readout_hz=40_000)
    with open_stream(tmp_path / "a.h5") as stream:
        assert stream.readout_hz == 40_000
        for t in (1_999, 2_000, 2_002):
            assert np.array_equal(stream.frames(t, t + 1)[0], decoded(raw, "416", t))
        imported = json.loads(stream.metadata.provenance["import"])
        assert (imported["layout"], imported["frames"]) == ("416", 2_003)
    export_raw_frames(tmp_path / "a.h5", tmp_path / "b.dat")
    rows = np.frombuffer((tmp_path / "b.dat").read_bytes(), np.uint8).reshape(2_003, 250, 52)
    assert np.array_equal(rows[:, :, :50], np.frombuffer(raw, np.uint8).reshape(2_003, 250, 52)[:, :, :50])
    assert not rows[:, :, 50:].any()


def test_fewer_frames_are_the_first_ones(tmp_path):
    raw = raw_file(tmp_path / "a.dat", "416", 5)
    import_raw_frames(tmp_path / "a.dat", tmp_path / "a.h5", frames=3)
    with open_stream(tmp_path / "a.h5") as stream:
        assert stream.shape[0] == 3
        assert np.array_equal(stream.frames(2, 3)[0], decoded(raw, "416", 2))


@pytest.mark.parametrize(("layout", "lit"), [("416", 0), ("sps1000", 0), ("dense", -1)])
def test_the_first_row_of_a_file_is_the_top_one_but_for_dense(tmp_path, layout, lit):
    """A file with only 50 bytes of ones at its beginning: in ``dense`` they belong to the bottom row."""
    (tmp_path / "a.dat").write_bytes(bytes([255] * 50) + bytes(RAW_LAYOUTS[layout].frame_bytes - 50))
    import_raw_frames(tmp_path / "a.dat", tmp_path / "a.h5", layout=layout)
    with open_stream(tmp_path / "a.h5") as stream:
        frame = stream.frames(0, 1)[0]
    assert frame[lit, :400].all()
    assert frame.sum() == 400


@pytest.mark.parametrize(
    ("size", "options", "message"),
    [
        (None, {}, "No such file"),
        (0, {}, "is empty"),
        (12_500 * 3, {}, "37500 bytes | 11500 | layouts that fit: dense (3 frames of 400x250)"),
        (12_999, {}, "12999 | state another size"),
        (13_000 * 5, {"frames": 0}, "0 frames | allowed: 1 to 5"),
        (13_000 * 5, {"frames": -1}, "-1 frames | allowed: 1 to 5"),
        (13_000 * 5, {"frames": 6}, "6 frames | allowed: 1 to 5"),
        (13_000, {"layout": "dens"}, "unknown layout 'dens' | 416, dense, sps1000 | did you mean 'dense'"),
    ],
)
def test_a_file_or_an_option_that_does_not_fit_is_one_line(tmp_path, size, options, message):
    if size is not None:
        (tmp_path / "a.dat").write_bytes(bytes(size))
    assert "this is a folder" in str(refusal(import_raw_frames, tmp_path, tmp_path / "a.h5"))
    assert_says(refusal(import_raw_frames, tmp_path / "a.dat", tmp_path / "a.h5", **options), message)
    assert not (tmp_path / "a.h5").exists()


def test_a_stream_of_another_size_is_not_exported(tmp_path):
    write_stream(tmp_path / "a.h5", np.zeros((3, 250, 400), np.uint8))
    error = refusal(export_raw_frames, tmp_path / "a.h5", tmp_path / "a.dat", layout="sps1000")
    assert_says(error, "250 x 400 pixels | 1000 x 1000 | layout dense takes any size")
    (tmp_path / "file").touch()
    error = refusal(export_raw_frames, tmp_path / "a.h5", tmp_path / "file" / "a.dat")
    assert "cannot be written" in error.problem
    assert not (tmp_path / "a.dat").exists()


def test_a_file_is_not_written_over_itself(tmp_path):
    raw = raw_file(tmp_path / "a.dat", "416", 2)
    (tmp_path / "link.dat").symlink_to(tmp_path / "a.dat")
    error = refusal(import_raw_frames, tmp_path / "a.dat", tmp_path / "link.dat")
    assert_says(error, "a.dat: would be written over itself | choose another output file")
    assert (tmp_path / "a.dat").read_bytes() == raw
    import_raw_frames(tmp_path / "a.dat", tmp_path / "a.h5")
    assert "a.h5: would be written over itself" in str(refusal(export_raw_frames, tmp_path / "a.h5", tmp_path / "a.h5"))


# -- from a foreign file to an answer --------------------------------------------------------------------


def tiles_in_full(c):
    tiles = c[:248].reshape(62, 4, 100, 4).transpose(0, 2, 1, 3)
    v, full = (1, 1, -1, -1), np.zeros((62, 100, 7, 7), np.int64)
    for i, j in np.ndindex(4, 4):
        full[:, :, i : i + 4, j : j + 4] += v[i] * v[j] * tiles
    return (full**2).sum()


LITERAL_MEASURES = {"sd_code": lambda c: ((c - c.mean()) ** 2).sum() / c.mean() ** 2, "mfdct_code": tiles_in_full}


class LiteralView:
    """Windows of a ``416`` file, read without saf_gen: rows of 50 bytes and 2 skipped bytes."""

    def __init__(self, path, measure):
        rows = np.fromfile(path, np.uint8).reshape(-1, 250, 52)
        self.spikes = np.unpackbits(rows[:, :, :50], axis=2, bitorder="little")
        self.frames, self.measure = len(rows), measure

    def score(self, first, stop):
        return self.measure(self.spikes[first:stop].sum(axis=0, dtype=np.uint16).astype(np.int64))


@pytest.mark.daily(1)
@pytest.mark.parametrize("measure", LITERAL_MEASURES)
@pytest.mark.slow
def test_a_foreign_file_is_searched_as_the_released_code_would_to_the_last_frame(tmp_path, measure):
    """Over a seam between two blocks of 2,000 frames."""
    raw_file(tmp_path / "a.dat", "416", 2_403)
    import_raw_frames(tmp_path / "a.dat", tmp_path / "a.h5")
    egs, sgfs = evaluate(tmp_path / "a.h5", methods=[f"{measure}+egs_code", f"{measure}+sgfs_code:dt=20"]).records
    view = LiteralView(tmp_path / "a.dat", LITERAL_MEASURES[measure])
    assert list(egs.judgement.trace) == literal_egs(view, 1, 2_403)
    assert list(sgfs.judgement.trace) == literal_sgfs(view, 20)
    assert (egs.judgement.frame, sgfs.judgement.frame) == (egs.judgement.trace[-1] - 1, sgfs.judgement.trace[-1] - 1)
