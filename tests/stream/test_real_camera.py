"""Recordings of a real camera: raw frames, a lens log and a truth become a ranked row; odd layouts are reported."""

import json
import os

import h5py
import numpy as np
import pytest
from refusals import assert_says, refusal

from saf_gen.stream.dataset import index_folder
from saf_gen.stream.interop import export_raw_frames, import_lens_log, truth_from_text
from saf_gen.stream.manifest import read_manifest
from saf_gen.stream.stream_file import open_stream
from saf_gen.stream.stream_writer import write_stream

FRAMES, TRUTH = 1_000, 0.42


def sweep_over_stripes():
    """A sweep over stripes whose contrast is largest at the truth: random spikes (T, 250, 400), one seed."""
    random = np.random.default_rng(1)
    stripes = np.where(np.arange(400) // 8 % 2, 1.0, -1.0)
    contrast = 0.8 * np.exp(-(((np.linspace(0, 1, FRAMES) - TRUTH) / 0.1) ** 2))
    rate = 0.3 * (1 + contrast[:, None] * stripes)
    return random.random((FRAMES, 250, 400), dtype=np.float32) < rate[:, None, :]


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """The folder with a camera's raw file, in the layout that SAF recorded, and its lens log."""
    folder = tmp_path_factory.mktemp("camera")
    write_stream(folder / "made.h5", sweep_over_stripes())
    export_raw_frames(folder / "made.h5", folder / "desk.dat", layout="416")
    (folder / "lens.csv").write_text("seconds,position\n0,0\n0.05,1\n")
    return folder


@pytest.mark.slow
def test_a_raw_file_a_lens_log_and_a_truth_become_a_ranked_row_in_three_commands(recording, call, tmp_path):
    stream = tmp_path / "mine" / "desk-daylight-00.h5"
    options = ("--focus", recording / "lens.csv", "--truth", TRUTH, "--depth-of-focus", 0.37, 0.47)
    code, out, err = call("import", recording / "desk.dat", "--layout", "416", "--out", stream, *options)
    assert (code, err) == (0, "")
    assert "1000 frames of 400×250" in out
    assert "layout 416" in out
    code, out, _ = call("dataset", "index", tmp_path / "mine")
    assert code == 0
    assert "1 sequence in split test; next: saf-gen evaluate" in out
    code, _, err = call("evaluate", tmp_path / "mine", "--method", "sd+argmax")
    assert (code, err) == (0, "")
    (row,) = json.loads((tmp_path / "mine" / "evaluation" / "leaderboard.json").read_text())["rows"]
    assert (row["rank"], row["answerable_1dof"]) == (1, 1.0)
    record = json.loads((tmp_path / "mine" / "evaluation" / "records.jsonl").read_text())
    assert (record["scene"], record["light"]) == ("desk", "daylight")
    assert abs(record["error"]) < 0.05


def test_what_was_imported_is_what_was_logged(recording, call, tmp_path):
    options = ("--focus", recording / "lens.csv", "--truth", TRUTH)
    call("import", recording / "desk.dat", "--layout", "416", "--out", tmp_path / "a.h5", *options)
    with open_stream(tmp_path / "a.h5") as stream, open_stream(recording / "made.h5") as made:
        assert np.array_equal(stream.counts(0, FRAMES), made.counts(0, FRAMES))
        # The middle of readout t is at (t + 0.5)/20,000 s, and the sweep takes 0.05 s.
        assert stream.focus_position == pytest.approx((np.arange(FRAMES) + 0.5) / 1_000, abs=1e-6)
        assert stream.truth.position == 0.42
        assert stream.truth.frame == pytest.approx(419.5, abs=1e-3)


def test_a_log_of_lights_becomes_their_gains(recording, call, tmp_path):
    (tmp_path / "light.csv").write_text("seconds,lamp,window\n0,1,0.5\n0.025,1,0.5\n0.05,3,0.5\n")
    options = ("--light", tmp_path / "light.csv")
    assert call("import", recording / "desk.dat", "--layout", "416", "--out", tmp_path / "a.h5", *options)[0] == 0
    with open_stream(tmp_path / "a.h5") as stream:
        assert stream.light_names == ("lamp", "window")
        # Readout 749 has its middle at 749.5/20,000 s, half a readout before halfway from 0.025 to 0.05 s.
        assert stream.gain[[0, 499, 749]] == pytest.approx(np.array([[1, 0.5], [1, 0.5], [1.998, 0.5]]), abs=1e-3)
    for text, message in (
        ("seconds,lamp\n0,-1\n", "a gain of lamp is -1"),
        ("seconds\n0\n", "the columns are 'seconds'; allowed: frame,NAME,NAME… or seconds,NAME,NAME…"),
        ("seconds,a,a\n0,1,1\n", "the columns are 'seconds,a,a'"),
    ):
        (tmp_path / "light.csv").write_text(text)
        code, _, err = call("import", recording / "desk.dat", "--layout", "416", "--out", tmp_path / "b.h5", *options)
        assert (code, message in err) == (2, True), err
    assert not (tmp_path / "b.h5").exists()


def spikecv_reads(raw, *, rows=250, columns=400):
    """Return the frames of a .dat file as SpikeCV and Spike-Zoo decode it: dense bits, then flipped."""
    bits = np.unpackbits(np.frombuffer(raw, np.uint8), bitorder="little")
    return bits.reshape(-1, rows, columns)[:, ::-1]


@pytest.mark.parametrize("options", [(), ("--for", "spikecv"), ("--for", "spike-zoo")])
def test_other_software_reads_an_export_bit_for_bit_and_the_right_way_up(call, tmp_path, options):
    frames = np.random.default_rng(3).integers(0, 2, (17, 250, 400), np.uint8)
    write_stream(tmp_path / "a.h5", frames)
    code, out, _ = call("export", tmp_path / "a.h5", "--out", tmp_path / "a.dat", *options)
    assert code == 0
    assert out == f"{17 * 12_500} bytes in {tmp_path / 'a.dat'}, layout dense\n"
    assert np.array_equal(spikecv_reads((tmp_path / "a.dat").read_bytes()), frames)


def test_an_export_for_saf_has_its_gaps_and_can_be_turned_over(call, tmp_path):
    frames = np.random.default_rng(3).integers(0, 2, (3, 250, 400), np.uint8)
    write_stream(tmp_path / "a.h5", frames)
    for options, seen in ((("--for", "saf"), frames), (("--for", "saf", "--flip"), frames[:, ::-1])):
        (tmp_path / "a.dat").unlink(missing_ok=True)
        call("export", tmp_path / "a.h5", "--out", tmp_path / "a.dat", *options)
        raw = np.frombuffer((tmp_path / "a.dat").read_bytes(), np.uint8).reshape(3, 250, 52)
        assert not raw[:, :, 50:].any()
        assert np.array_equal(np.unpackbits(raw[:, :, :50], axis=2, bitorder="little"), seen)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("time,position\n0,0\n", "the columns are 'time,position'"),
        ("frame,position\n0,1.5\n", "a position is 1.5"),
        ("frame,position\n5000,0.5\n", "the log covers frames 5000 to 5000"),
        ("frame,position\n0,0\n0,1\n", "frame goes from 0 to 0"),
        ("frame,position\n", "the table has no rows"),
        ("", "the columns are ''"),
    ],
)
def test_a_lens_log_that_does_not_fit_is_one_line(tmp_path, text, problem):
    (tmp_path / "log.csv").write_text(text)
    assert refusal(lambda: import_lens_log(tmp_path / "log.csv", frames=100, readout_hz=20_000)).problem == problem


def test_a_truth_is_a_position_or_a_frame_of_the_log():
    lens = np.linspace(0, 1, 101, dtype=np.float32)
    assert truth_from_text("frame:25", focus_position=lens).position == pytest.approx(0.25)
    assert truth_from_text("0.25", focus_position=lens).frame == pytest.approx(25)
    assert np.isnan(truth_from_text("0.25", focus_position=None).frame)
    for text in ("1.2", "frame:101", "half", "second:3", "nan"):
        error = refusal(lambda text=text: truth_from_text(text, focus_position=lens))
        assert error.allowed == "a position from 0 to 1, or frame:N with N from 0 to 100"
    assert refusal(lambda: truth_from_text("frame:3", focus_position=None)).hint == "add --focus"
    error = refusal(lambda: truth_from_text("0.25", focus_position=lens, depth_of_focus=(0.3, 0.4)))
    assert "the truth 0.25" in error.allowed


def test_nothing_is_written_where_something_does_not_fit(recording, call, tmp_path):
    for options, message in (
        (("--truth", "2"), "truth is '2'"),
        (("--depth-of-focus", 0.1, 0.2), "--depth-of-focus is given without --truth"),
        (("--layout", "dens"), "did you mean 'dense'?"),
        (("--focus", tmp_path / "no.csv"), "does not exist"),
    ):
        stated = () if "--layout" in options else ("--layout", "416")
        code, _, err = call("import", recording / "desk.dat", *stated, "--out", tmp_path / "a.h5", *options)
        assert code == 2
        assert message in err
        assert not (tmp_path / "a.h5").exists()
    code, _, err = call("export", recording / "made.h5", "--out", tmp_path / "a.dat", "--for", "spikecw")
    assert (code, "did you mean 'spikecv'?" in err) == (2, True)
    code, _, err = call("export", recording / "made.h5", "--out", tmp_path / "a.dat", "--for", "saf", "--layout", "416")
    assert (code, "--layout and --for are both given" in err) == (2, True)


def test_a_folder_is_indexed_once_with_splits_and_names(tmp_path):
    frames = np.zeros((16, 4, 5), np.uint8)
    for name in ("train/desk-lamp-01.h5", "test/vase-dynamic-sun-00.h5", "lonely.h5"):
        write_stream(tmp_path / name, frames)
    manifest = index_folder(tmp_path, split="rest")
    assert read_manifest(tmp_path) == manifest
    found = {s.id: (s.split, s.scene, s.scene_motion, s.light, s.repeat) for s in manifest.sequences}
    assert found == {
        "lonely": ("rest", "lonely", "static", "recorded", 0),
        "test-vase-dynamic-sun-00": ("test", "vase", "dynamic", "sun", 0),
        "train-desk-lamp-01": ("train", "desk", "static", "lamp", 1),
    }
    assert "manifest.json" in refusal(index_folder, tmp_path).problem
    (tmp_path / "none").mkdir()
    assert refusal(index_folder, tmp_path / "none").problem == "has no recording"
    (tmp_path / "none" / "a.h5").write_text("no stream")
    assert "not an HDF5 file" in refusal(index_folder, tmp_path / "none").problem
    assert "no such folder" in refusal(index_folder, tmp_path / "nowhere").problem


def test_a_stream_whose_spikes_are_not_those_of_its_digest_is_not_indexed(tmp_path):
    """`evaluate` compares a file with the digest that the manifest has of it."""
    write_stream(tmp_path / "a.h5", np.ones((16, 4, 5), np.uint8))
    with h5py.File(tmp_path / "a.h5", "r+") as file:
        file["spikes"][...] = 0
    assert_says(refusal(index_folder, tmp_path), "a.h5: the content has SHA-256")
    assert not (tmp_path / "manifest.json").exists()


def test_a_name_that_is_no_utf_8_is_written_as_escapes(tmp_path, call):
    """Such names come from cameras and archives of other systems; a file cannot store them unchanged."""
    recorded, made = tmp_path / os.fsdecode(b"\xff\x1b.npy"), tmp_path / os.fsdecode(b"made\xfe.h5")
    np.save(recorded, np.zeros((16, 8, 8), bool))
    code, out, err = call("import", recorded, "--axes", "TYX", "--out", made)
    assert (code, err) == (0, "")
    assert "\x1b" not in out
    with open_stream(made) as stream:
        assert json.loads(stream.metadata.provenance["import"])["file"] == "\\xff\x1b.npy"
    assert call("view", made, "--out", tmp_path / "page.html")[0] == 0
    assert "made\\xfe" in (tmp_path / "page.html").read_text(encoding="utf-8")
    assert call("evaluate", made, "--method", "sd+argmax:window=4")[0] == 0
    code, _, err = call("dataset", "index", tmp_path)
    assert code == 2
    assert "is not UTF-8; allowed: names that a manifest can hold; rename it" in err
