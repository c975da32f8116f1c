"""The all-in-focus charge in a stream: its values, its digest, its parts, and what is refused."""

import multiprocessing
import os
import pickle
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from refusals import assert_says, refusal
from windowed_dataset import FRAMES, SHAPE, make_spikes, make_truth, make_windowed_dataset

import saf_gen
from saf_gen import SpikeWindows
from saf_gen.core.region import Region
from saf_gen.stream import metadata, sharp_charge
from saf_gen.stream.cutting import cut_stream
from saf_gen.stream.description import describe_content
from saf_gen.stream.event_file import EventWriter, open_events
from saf_gen.stream.frame_file import open_frames, write_frames

STARTS = np.array([0, 400, 720, 1040])
"""Frames of four slices; the steps differ, and the last slice is behind the end."""
BOX: Region = (slice(1, 4), slice(2, 7))


def made_sharp(slices=4, lights=2):
    return np.random.default_rng(8).gamma(4.0, 500.0, (slices, lights, *SHAPE)).astype(np.float32)


def made_gain(lights=2):
    return np.random.default_rng(9).uniform(0.5, 2.0, (FRAMES, lights)).astype(np.float32)


def write(path, *, sharp=None, starts=STARTS, gain=None, **fields):
    """Write a stream with an all-in-focus charge under changing light."""
    truth = replace(make_truth(), sharp=made_sharp() if sharp is None else sharp, sharp_frame=starts)
    light = made_gain() if gain is None else gain
    saf_gen.write_stream(path, make_spikes(0), truth=truth, gain=light, **fields)
    return path


def law(frame, sharp, *, starts=STARTS, gain=None):
    """Between two slices the charge is theirs, by the time from each to the middle of the readout: float64 (H, W)."""
    gain, at = made_gain() if gain is None else gain, frame + 0.5
    between = np.stack([[np.interp(at, starts, sharp[:, g, y, x]) for y, x in np.ndindex(*SHAPE)] for g in range(2)])
    return (gain[frame].astype(np.float64)[:, None] * between).sum(axis=0).reshape(SHAPE)


@pytest.fixture
def path(tmp_path):
    return write(tmp_path / "a.h5")


def test_a_readout_collects_what_lies_between_two_slices_under_its_light(path):
    with saf_gen.open_stream(path) as stream:
        for frame in (0, 399, 400, 401, 560, 719, 720, FRAMES - 1):
            found = stream.sharp(frame)
            assert (found.dtype, found.shape) == (np.float32, SHAPE)
            assert found == pytest.approx(law(frame, made_sharp()), rel=1e-5)


def test_at_a_slice_it_is_the_slice_and_outside_the_nearest(tmp_path):
    """Half a readout before and after the beginning of frame 400; a recording that begins and ends far outside."""
    bright = np.zeros((3, 1, *SHAPE), np.float32)
    bright[1] = 100
    constant = np.ones((FRAMES, 1), np.float32)
    with saf_gen.open_stream(write(tmp_path / "a.h5", sharp=bright, starts=[300, 400, 500], gain=constant)) as stream:
        around = [float(stream.sharp(frame)[0, 0]) for frame in (299, 300, 398, 399, 400, 401, 499, 500)]
        assert around == pytest.approx([0, 0.5, 98.5, 99.5, 99.5, 98.5, 0.5, 0], abs=1e-4)
        assert stream.sharp(0).max() == stream.sharp(FRAMES - 1).max() == 0


def test_a_scene_at_rest_has_one_slice_for_all_readouts(tmp_path):
    sharp, gain = made_sharp(slices=1), made_gain()
    with saf_gen.open_stream(write(tmp_path / "a.h5", sharp=sharp, starts=[0])) as stream:
        for frame in (0, 500, FRAMES - 1):
            assert stream.sharp(frame) == pytest.approx(np.tensordot(gain[frame], sharp[0], 1), rel=1e-6)


def test_the_array_is_what_was_written_and_is_read_slice_by_slice(path, monkeypatch):
    sharp = made_sharp()
    with saf_gen.open_stream(path) as stream:
        held = stream.truth.sharp
        assert np.array_equal(stream.truth.sharp_frame, STARTS)
        assert (held.shape, held.dtype, held.ndim, len(held)) == (sharp.shape, np.float32, 4, 4)
        assert np.array_equal(np.asarray(held), sharp)
        keys = [0, -1, np.int64(2), slice(1, 3), slice(None, None, -2), (1, 0), (slice(2), 1, slice(1, 4)), ..., None]
        for key in (*keys, (2, slice(None), 3, 4), np.array([0, 3])):
            assert np.array_equal(held[key], sharp[key]), key
        with pytest.raises(IndexError):
            held[4]
        read, whole = [], sharp_charge.StoredPictures.read
        monkeypatch.setattr(
            sharp_charge.StoredPictures, "read", lambda self, j, **how: read.extend(j) or whole(self, j, **how)
        )
        stream.sharp(500)
        assert read == [1, 2]
    with h5py.File(path) as plain:
        assert np.array_equal(plain["truth/sharp"][:], sharp)
        assert plain["truth/sharp"].chunks is None


def test_it_can_be_read_after_the_stream_is_closed_in_another_process_and_from_a_pickle(path):
    with saf_gen.open_stream(path) as stream:
        truth, expected = stream.truth, stream.sharp(500)
        with multiprocessing.get_context("fork").Pool(1) as pool:
            assert np.array_equal(pool.apply(stream.sharp, (500,)), expected)
    assert np.array_equal(pickle.loads(pickle.dumps(truth)).sharp[2], made_sharp()[2])


def test_opening_a_stream_and_naming_its_truth_reads_none_of_it(path, monkeypatch):
    monkeypatch.setattr(sharp_charge.StoredPictures, "read", lambda *_, **__: pytest.fail("it was read"))
    with saf_gen.open_stream(path) as stream:
        assert f"sharp=float32 {(4, 2, *SHAPE)}" in repr(stream.truth)
        assert "sharp" in stream.truth._repr_html_()
        assert describe_content(stream)["all in focus"] == "4 pictures under each of 2 light groups"


def test_it_is_content_and_every_byte_of_it_is_verified(path, tmp_path):
    with saf_gen.open_stream(path) as stream:
        stream.verify()
        digest, at = stream.content_sha256, stream.truth.sharp.offset
    other = made_sharp()
    other[3, 1, -1, -1] += 1
    with saf_gen.open_stream(write(tmp_path / "b.h5", sharp=other)) as stream:
        assert stream.content_sha256 != digest
    data = bytearray(path.read_bytes())
    data[at + made_sharp().nbytes - 1] ^= 1
    path.write_bytes(data)
    with saf_gen.open_stream(path) as stream:
        assert_says(refusal(stream.verify), "the content has SHA-256 | make it again")


def test_a_stream_without_it_is_written_as_before(tmp_path):
    """The digest of a stream that was written before there was such a charge."""
    saf_gen.write_stream(tmp_path / "a.h5", make_spikes(0), truth=make_truth(), gain=made_gain())
    with h5py.File(tmp_path / "a.h5") as file:
        assert "sharp_sha256" not in file.attrs
        assert file.attrs["content_sha256"].startswith("795b7e13fa90a30d2e61ef0e833edd82")
        assert not [name for name in file["truth"] if "sharp_frame" in name or name == "sharp"]
    with saf_gen.open_stream(tmp_path / "a.h5") as stream:
        error = refusal(stream.sharp, 0)
        assert stream.truth.sharp is None
    assert_says(error, "does not hold its all-in-focus charge | truth: {sharp: true}")


def test_a_part_of_a_stream_has_its_part(path, tmp_path):
    """Frames 450 to 600 lie between two slices; 300 to 500 have a slice among them."""
    for first, stop, starts in ((450, 600, [-50, 270]), (300, 500, [-300, 100, 420]), (0, 1000, STARTS.tolist())):
        cut_stream(path, tmp_path / "part.h5", first=first, stop=stop, region=BOX)
        with saf_gen.open_stream(path) as whole, saf_gen.open_stream(tmp_path / "part.h5") as part:
            assert part.truth.sharp_frame.tolist() == starts
            for frame in (0, 60, stop - first - 1):
                assert part.sharp(frame) == pytest.approx(whole.sharp(first + frame)[BOX], rel=1e-6)
            part.verify()
    cut_stream(tmp_path / "part.h5", tmp_path / "less.h5", first=990)
    still = write(tmp_path / "still.h5", sharp=made_sharp(slices=1), starts=[0])
    cut_stream(still, tmp_path / "part.h5", first=700, region=BOX)
    with saf_gen.open_stream(tmp_path / "less.h5") as less, saf_gen.open_stream(path) as whole:
        assert less.sharp(3) == pytest.approx(whole.sharp(993)[BOX], rel=1e-6)
    with saf_gen.open_stream(tmp_path / "part.h5") as part, saf_gen.open_stream(still) as whole:
        assert (part.truth.sharp_frame.tolist(), len(part.truth.sharp)) == ([0], 1)
        assert np.array_equal(part.sharp(5), whole.sharp(705)[BOX])


def test_files_of_other_cameras_do_not_have_it(path, tmp_path):
    with saf_gen.open_stream(path) as stream:
        frames = (np.zeros(SHAPE, np.uint16) for _ in range(FRAMES))
        write_frames(tmp_path / "f.h5", frames, shape=stream.shape, readout_hz=50.0, metadata=stream.metadata)
        with EventWriter(tmp_path / "e.h5", shape=stream.shape, readout_hz=2e4, metadata=stream.metadata):
            pass
    with open_frames(tmp_path / "f.h5") as file, open_events(tmp_path / "e.h5") as events:
        assert file.truth.sharp is file.truth.sharp_frame is events.truth.sharp is events.truth.sharp_frame is None
    for name, opened in (("f.h5", open_frames), ("e.h5", open_events)):
        with h5py.File(tmp_path / name, "a") as file:
            file.create_dataset("truth/sharp", data=made_sharp())
        assert_says(refusal(opened, tmp_path / name), "holds /truth/sharp, which is not part of")


def test_windows_have_the_sum_over_their_readouts(tmp_path):
    dataset = make_windowed_dataset(tmp_path)
    for n, split in enumerate(("train", "train", "test")):
        write(dataset / f"{split}/s{n}.h5", focus_position=np.linspace(0, 1, FRAMES, dtype=np.float32))
    whole = SpikeWindows(dataset, "all", window=64, stride=50, target="sharp")
    part = SpikeWindows(dataset, "all", window=64, stride=50, target="sharp", crop=(4, 5))
    with saf_gen.open_stream(dataset / "train/s0.h5") as stream:
        for number in (0, 7, 8, 13, 18):
            counts, total = whole[number]
            expected = sum(stream.sharp(t).astype(np.float64) for t in range(50 * number, 50 * number + 64))
            assert (total.dtype, total.shape) == (np.float32, counts.shape[1:])
            assert total == pytest.approx(expected, rel=1e-5)
            # The target's middle is row 2, column 7: the box is moved back into the frame.
            assert np.array_equal(part[number][1], total[0:4, 4:9])
    again = pickle.loads(pickle.dumps(whole))
    assert np.array_equal(again[3][1], whole[3][1])
    assert not [fd for fd in Path("/proc/self/fd").iterdir() if fd.resolve().is_relative_to(dataset)], "left open"


def test_where_there_is_none_a_window_says_so(tmp_path):
    dataset = make_windowed_dataset(tmp_path)
    assert_says(
        refusal(SpikeWindows(dataset, "all", target="sharp").__getitem__, 0), "does not hold its all-in-focus charge"
    )
    assert_says(refusal(SpikeWindows, dataset, "all", target="sharpe"), "sharpe | did you mean 'sharp'?")
    write(dataset / "train/s0.h5")
    with saf_gen.open_stream(dataset / "train/s0.h5") as stream:
        for frame in (-1, FRAMES, 1.5, "first", None):
            assert_says(refusal(stream.sharp, frame), f"{frame!r} was asked for | 0 to {FRAMES - 1}")


WRONG = {
    "another type": ({"sharp": made_sharp().astype(int)}, "sharp is int64"),
    "text": ({"sharp": np.full((4, 2, *SHAPE), "bright")}, "sharp is"),
    "no lights": ({"sharp": made_sharp()[:, 0]}, "sharp is float32"),
    "a light too few": ({"sharp": made_sharp(lights=1)}, "(4, 2, 6, 9): slices of sharp_frame, lights of gain"),
    "a slice too few": ({"sharp": made_sharp(slices=3)}, "sharp is float32 (3, 2, 6, 9)"),
    "other pixels": ({"sharp": made_sharp()[..., 1:]}, "sharp is float32 (4, 2, 6, 8)"),
    "no slice": ({"sharp": made_sharp(slices=0), "starts": []}, "sharp_frame is []"),
    "below zero": ({"sharp": made_sharp() - 1e5}, "sharp is negative or not finite in slice 0"),
    "not a number": ({"sharp": np.where(np.arange(4)[:, None, None, None] == 2, np.nan, made_sharp())}, "in slice 2"),
    "falling frames": ({"starts": STARTS[::-1]}, "sharp_frame is [1040, 720, 400, 0] | whole numbers that rise"),
    "a frame twice": ({"starts": [0, 400, 400, 800]}, "whole numbers that rise"),
    "halves of frames": ({"starts": STARTS + 0.5}, "whole numbers that rise"),
    "no frames": ({"starts": None}, "truth has sharp, but no sharp_frame"),
    "a table of frames": ({"starts": [STARTS]}, "sharp_frame has shape (1, 4)"),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_cannot_be_the_charge_is_not_written(tmp_path, case):
    fields, says = WRONG[case]
    assert_says(refusal(write, tmp_path / "a.h5", **fields), says)
    assert list(tmp_path.iterdir()) == []


def test_frames_without_pictures_are_not_written(tmp_path):
    truth = replace(make_truth(), sharp_frame=STARTS)
    error = refusal(saf_gen.write_stream, tmp_path / "a.h5", make_spikes(0), truth=truth)
    assert_says(error, "truth has sharp_frame, but no sharp | both, or neither")


def exchange(file, **how):
    del file["truth/sharp"]
    if how:
        file.create_dataset("truth/sharp", **how)


def link(file, to):
    exchange(file)
    file["truth/sharp"] = to


ATTACKS = {
    "in pieces": (lambda f: exchange(f, data=made_sharp(), chunks=(1, 1, *SHAPE)), "in one piece"),
    "deflated": (lambda f: exchange(f, data=made_sharp(), chunks=(1, 1, *SHAPE), compression="gzip"), "in one piece"),
    "another filter": (lambda f: exchange(f, data=made_sharp(), compression="lzf"), "has the filters"),
    "float64": (lambda f: exchange(f, data=made_sharp().astype("f8")), "/truth/sharp is float64"),
    "the other byte order": (lambda f: exchange(f, data=made_sharp().astype(">f4")), "/truth/sharp is >f4"),
    "text": (lambda f: exchange(f, data="bright"), "/truth/sharp is object"),
    "never written": (lambda f: exchange(f, shape=(4, 2, *SHAPE), dtype="f4"), "was not written to its end"),
    "eight tebibytes": (lambda f: exchange(f, shape=(1 << 41, 2, *SHAPE), dtype="f4"), "was not written to its end"),
    "other pixels": (lambda f: exchange(f, data=made_sharp()[..., 1:]), "sharp is float32 (4, 2, 6, 8)"),
    "a light more": (lambda f: exchange(f, data=made_sharp(lights=3)), "sharp is float32 (4, 3, 6, 9)"),
    "one number": (lambda f: exchange(f, data=np.float32(1)), "/truth/sharp is float32 ()"),
    "nothing": (lambda f: exchange(f), "truth has sharp_frame, but no sharp"),
    "no frames": (lambda f: f.__delitem__("truth/sharp_frame"), "truth has sharp, but no sharp_frame"),
    "a soft link": (lambda f: link(f, h5py.SoftLink("/spikes")), "/truth/sharp is a link"),
    "an external link": (lambda f: link(f, h5py.ExternalLink("other.h5", "/x")), "/truth/sharp is a link"),
    "a group": (lambda f: link(f, f.create_group("time")), "/truth/sharp"),
    "storage outside": (
        lambda f: exchange(f, shape=(4, 2, *SHAPE), dtype="f4", external=[("secret", 0, 1728)]),
        "/truth/sharp is stored in other files",
    ),
    "no digest": (lambda f: f.attrs.__delitem__("sharp_sha256"), "does not state sharp_sha256"),
    "another digest": (lambda f: f.attrs.__setitem__("sharp_sha256", "0" * 64), "the content has SHA-256"),
    "a number for the digest": (lambda f: f.attrs.__setitem__("sharp_sha256", 7), "does not state sharp_sha256"),
}


@pytest.mark.parametrize("attack", ATTACKS)
def test_what_no_stream_holds_is_refused_when_it_is_opened(path, attack):
    change, says = ATTACKS[attack]
    with h5py.File(path, "a") as file:
        change(file)
    assert_says(refusal(saf_gen.open_stream, path), says)


def test_a_slice_that_would_fill_the_memory_is_refused(path, tmp_path, monkeypatch):
    monkeypatch.setattr(sharp_charge, "MAX_SMALL_BYTES", 4 * 2 * 6 * 9 - 1)
    assert_says(refusal(saf_gen.open_stream, path), "at most 431 bytes for a slice")
    assert_says(refusal(write, tmp_path / "b.h5"), "at most 431 bytes for a slice")


def test_a_file_that_changed_ended_or_went_is_told_in_one_line(path):
    with saf_gen.open_stream(path) as stream:
        held = stream.truth.sharp
        os.utime(path, ns=(1, 1))
        assert_says(refusal(stream.sharp, 3), "has changed since it was opened")
        short = replace(held, offset=path.stat().st_size - 8, version=(path.stat().st_size, 1))
        assert_says(refusal(short.__getitem__, 0), "ends within /truth/sharp")
        path.unlink()
        assert_says(refusal(stream.sharp, 3), "No such file")


def test_the_field_is_described_where_metadata_are(tmp_path):
    """A mapping of fields is taken as well, and a field that is misspelt has a neighbour."""
    fields = {"sharp": made_sharp(), "sharp_frame": STARTS}
    saf_gen.write_stream(tmp_path / "a.h5", make_spikes(0), truth=fields, gain=made_gain())
    with saf_gen.open_stream(tmp_path / "a.h5") as stream:
        assert stream.sharp(10) == pytest.approx(law(10, made_sharp()), rel=1e-5)
    error = refusal(metadata.metadata_from_options, {"truth": {"sharp_frames": STARTS}})
    assert_says(error, "sharp_frames | did you mean 'sharp_frame'?")
