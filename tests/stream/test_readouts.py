"""Copies and losses of readouts are what a table states; without one, all frames are stored."""

import json

import numpy as np
import pytest
from planted_recordings import fire, make_picture
from refusals import refusal

from saf_gen.benchmark.evaluate import evaluate
from saf_gen.stream.cutting import cut_stream
from saf_gen.stream.interop import Readouts, import_lens_log
from saf_gen.stream.interop.readouts import read_times
from saf_gen.stream.stream_file import open_stream
from saf_gen.stream.stream_writer import write_stream

HZ, FRAMES = 20_000, 600
PICTURE = make_picture(60, 80, low=0.08, high=0.4, smooth=3.0)
SPIKES = fire(PICTURE, FRAMES)


def at_readouts(number):
    """Return the frames of a recorder that stored these readouts."""
    return SPIKES[np.asarray(number)]


def but(lost=(), doubled=()):
    return np.array(sorted([*(n for n in range(FRAMES) if n not in set(lost)), *doubled]))


COPIES_AND_GAPS = but(lost=range(300, 309), doubled=[100, 101, 450])


NUMBER = np.repeat([0, 1, 2, 2, 5, 6, 9], [1, 1, 1, 1, 1, 1, 1])
STAMPS = (
    3.25 + NUMBER / HZ + np.random.default_rng(1).uniform(-4e-6, 4e-6, NUMBER.size) * (np.diff(NUMBER, append=9) > 0)
)
TABLES = {
    "readout": "readout\n" + "\n".join(map(str, NUMBER)),
    "counter from anywhere": "counter\n" + "\n".join(map(str, NUMBER + 65_000)),
    "frame and readout": "frame,readout\n" + "\n".join(f"{k},{n}" for k, n in enumerate(NUMBER)),
    "seconds": "seconds\n" + "\n".join(f"{NUMBER[k] / HZ:.9f}" for k in range(7)),
    "milliseconds": "milliseconds\n" + "\n".join(f"{1e3 * n / HZ}" for n in NUMBER),
    "microseconds, late": "microseconds\n" + "\n".join(f"{1e6 * (n / HZ + 9)}" for n in NUMBER),
    "frame and seconds": "frame, seconds\n" + "\n".join(f"{k}, {n / HZ}" for k, n in enumerate(NUMBER)),
    "uneven": "seconds\n" + "\n".join(map(str, STAMPS)),
    "another program": "\ufeff# from the recorder\r\n\r\nreadout\r\n" + "\r\n".join(map(str, NUMBER)),
    "clock that is 1 % fast": "seconds\n" + "\n".join(f"{n / HZ / 1.01}" for n in NUMBER),
}


@pytest.mark.parametrize("name", TABLES)
def test_a_table_says_which_readouts_the_frames_are(tmp_path, name):
    (tmp_path / "t.csv").write_text(TABLES[name], newline="", encoding="utf-8")
    found = read_times(tmp_path / "t.csv", frames=7, total=7, readout_hz=HZ)
    np.testing.assert_array_equal(found.number, NUMBER)
    part = read_times(tmp_path / "t.csv", frames=5, total=7, readout_hz=HZ)
    np.testing.assert_array_equal(part.number, NUMBER[:5])


BROKEN = {
    "short": ("readout\n0\n1\n", "has 2 rows; allowed: 7, one for each frame"),
    "long": ("readout\n" + "\n".join(map(str, range(8))), "has 8 rows"),
    "back": ("counter\n65533\n65534\n65535\n0\n1\n2\n3", "counter goes from 65535 to 0"),
    "half": ("readout\n0\n1\n2.5\n3\n4\n5\n6", "readout is 2.5"),
    "heading": ("time\n0\n1\n2\n3\n4\n5\n6", "the columns are 'time'"),
    "no heading": ("0\n1\n2\n3\n4\n5\n6", "the columns are '0'"),
    "from one": ("frame,readout\n" + "\n".join(f"{k},{k}" for k in range(1, 8)), "frame is 1 in row 0"),
    "word": ("readout\n0\n1\nx\n3\n4\n5\n6", "readout is 'x'"),
    "unit": ("seconds\n" + "\n".join(f"{1e3 * k / HZ}" for k in range(7)), "usual step of the time stamps is 1000"),
    "rate": ("seconds\n" + "\n".join(f"{k / 40_000}" for k in range(7)), "step of the time stamps is 0.5 readouts"),
    "jitter": ("seconds\n" + "\n".join(f"{k / HZ}" for k in (0, 1, 2, 3, 4.45, 5, 6)), "step by 1.45 readouts"),
    "equal": ("seconds\n" + "\n".join(["5"] * 7), "usual step of the time stamps is 0"),
    "endless": ("readout\n0\n1\n2\n3\n4\n5\ninf", "readout is 'inf'"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_table_that_cannot_be_is_refused(tmp_path, name):
    text, words = BROKEN[name]
    (tmp_path / "t.csv").write_text(text)
    assert words in str(refusal(read_times, tmp_path / "t.csv", frames=7, total=7, readout_hz=HZ))


def import_stored(call, tmp_path, number, *options):
    """Import frames of these readouts, with the table that states them."""
    np.save(tmp_path / "a.npy", at_readouts(number))
    (tmp_path / "t.csv").write_text("readout\n" + "\n".join(map(str, number)))
    asked = ("--axes", "TYX", "--times", tmp_path / "t.csv", *options)
    code, out, err = call("import", tmp_path / "a.npy", "--out", tmp_path / "a.h5", *asked)
    assert code == 0, err
    return out


def test_an_import_keeps_each_readout_once_with_its_number(call, tmp_path):
    out = import_stored(call, tmp_path, COPIES_AND_GAPS)
    assert "doubled readouts: 3, left out (frames 101, 103, 444)" in out
    assert "lost readouts: 9 in 1 gap (before frame 302)" in out
    kept = np.unique(COPIES_AND_GAPS)
    with open_stream(tmp_path / "a.h5") as stream:
        np.testing.assert_array_equal(stream.frames(0, stream.shape[0]), SPIKES[kept])
        np.testing.assert_array_equal(stream.metadata.readout, kept)
        assert json.loads(stream.metadata.provenance["import"])["left_out"] == [101, 103, 444]
    shown = call("inspect", tmp_path / "a.h5")[1]
    assert "591 at 20000 Hz (0.03 s)" in shown
    assert "9 in 1 gap" in shown
    cut_stream(tmp_path / "a.h5", tmp_path / "b.h5", first=250, stop=350)
    with open_stream(tmp_path / "b.h5") as part:
        np.testing.assert_array_equal(part.metadata.readout, kept[250:350] - kept[250])
    cut_stream(tmp_path / "a.h5", tmp_path / "c.h5", first=400, stop=500)
    with open_stream(tmp_path / "c.h5") as part:
        assert part.metadata.readout is None
    code, _, err = call("export", tmp_path / "a.h5", "--out", tmp_path / "a.dat")
    assert code == 0
    assert "cannot hold what the stream says of its lost readouts" in err


def test_a_complete_recording_holds_no_numbers(call, tmp_path):
    assert "readouts" not in import_stored(call, tmp_path, but())
    with open_stream(tmp_path / "a.h5") as stream:
        assert stream.metadata.readout is None
        assert stream.content_sha256 == write_stream(tmp_path / "b.h5", SPIKES)


def test_without_a_table_all_frames_are_kept(call, tmp_path):
    """Also copies, which the spikes show: what is not stated is not changed."""
    np.save(tmp_path / "a.npy", at_readouts(COPIES_AND_GAPS))
    assert call("import", tmp_path / "a.npy", "--out", tmp_path / "a.h5", "--axes", "TYX")[0] == 0
    with open_stream(tmp_path / "a.h5") as stream:
        np.testing.assert_array_equal(stream.frames(0, stream.shape[0]), SPIKES[COPIES_AND_GAPS])


@pytest.mark.parametrize("wrong", [70, 2_000])
def test_frames_that_differ_are_not_one_readout(call, tmp_path, wrong):
    """In the first block of 2,000 frames, and at the beginning of another one."""
    np.save(tmp_path / "a.npy", np.random.default_rng(1).integers(0, 2, (2_100, 6, 8), np.uint8))
    (tmp_path / "t.csv").write_text("readout\n" + "\n".join(str(k - (k >= wrong)) for k in range(2_100)))
    options = ("--axes", "TYX", "--times", tmp_path / "t.csv")
    code, _, err = call("import", tmp_path / "a.npy", "--out", tmp_path / "a.h5", *options)
    assert code == 2
    assert f"frames {wrong - 1} and {wrong} have the same time, but differ" in err
    assert not (tmp_path / "a.h5").exists()


def test_logs_and_truth_follow_the_readouts(call, tmp_path):
    """A lens that moves evenly in time is where it was at each readout, in seconds and in frames of the file."""
    number = COPIES_AND_GAPS
    kept = np.unique(number)
    (tmp_path / "s.csv").write_text(f"seconds,position\n{0.5 / HZ},0\n{(FRAMES - 0.5) / HZ},1\n")
    rows = "".join(f"{k},{number[k] / (FRAMES - 1)}\n" for k in (0, 99, 299, 301, 302, 440, 593))
    (tmp_path / "f.csv").write_text(f"frame,position\n{rows}")
    for log in ("s.csv", "f.csv"):
        options = ("--focus", tmp_path / log, "--truth", "frame:450", "--light", tmp_path / "light.csv")
        (tmp_path / "light.csv").write_text(f"seconds,lamp\n{0.5 / HZ},1\n{(FRAMES - 0.5) / HZ},600\n")
        assert "cover 100% of the recording" in import_stored(call, tmp_path, number, *options)
        with open_stream(tmp_path / "a.h5") as stream:
            assert stream.focus_position == pytest.approx(kept / (FRAMES - 1), abs=1e-6)
            assert stream.gain[:, 0] == pytest.approx(1 + kept, rel=1e-5)
            frame = int(np.flatnonzero(kept == number[450])[0])
            assert stream.truth.frame == frame
            assert stream.truth.position == pytest.approx(number[450] / (FRAMES - 1), abs=1e-6)


def test_a_log_of_a_complete_recording_is_read_as_before(tmp_path):
    (tmp_path / "s.csv").write_text("seconds,position\n0,0.1\n0.01,0.7\n0.02,0.3\n")
    usual = Readouts(np.arange(FRAMES))
    for log in (tmp_path / "s.csv",):
        plain = import_lens_log(log, frames=FRAMES, readout_hz=HZ)
        np.testing.assert_array_equal(plain, import_lens_log(log, frames=FRAMES, readout_hz=HZ, readouts=usual))


def test_time_to_focus_counts_lost_readouts(tmp_path):
    number = np.concatenate([np.arange(300), np.arange(400, 700)])
    lens, seconds = (number / 699).astype(np.float32), []
    for name, readout in (("a", None), ("b", number)):
        truth = {"position": float(lens[450]), "depth_of_focus": (0.6, 0.9), "frame": 450.0}
        write_stream(tmp_path / f"{name}.h5", SPIKES, focus_position=lens, readout=readout, truth=truth)
        (record,) = evaluate(tmp_path / f"{name}.h5", methods=["sd+argmax"]).records
        seconds.append(record.judgement.time_to_focus_s)
    assert seconds == pytest.approx([600 / HZ, 700 / HZ])


@pytest.mark.parametrize("readout", [np.arange(600)[::-1], np.arange(600) * 0.5, np.arange(1, 601), np.zeros(600)])
def test_numbers_of_readouts_that_cannot_be_are_refused(tmp_path, readout):
    assert "readout is" in str(refusal(write_stream, tmp_path / "a.h5", SPIKES, readout=readout))
