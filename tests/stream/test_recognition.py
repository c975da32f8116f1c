"""Files of others are read as they are stored, or an option is asked for: what a file does not show is not guessed."""

import gzip
import io

import numpy as np
import pytest
from planted_recordings import fire, make_picture, write_416, write_dense, write_sps1000
from refusals import refusal
from scipy.io import savemat

from saf_gen.stream.interop import SpikeArray, evidence, export_raw_frames, import_raw_frames, recognise
from saf_gen.stream.stream_file import open_stream
from saf_gen.stream.stream_writer import write_stream

CAMERA = fire(make_picture(250, 400), 72)
SMALL = fire(make_picture(40, 64), 320)
RANDOM = (np.random.default_rng(3).random((72, 250, 400)) < 0.2).astype(np.uint8)
DARK = np.zeros((300, 250, 400), np.uint8)
GRATING = fire(np.broadcast_to(0.2 + 0.1 * np.sin(np.arange(400) * np.pi / 8), (250, 400)), 72)

RAW = {
    "dense": (write_dense, CAMERA, {}, "dense lsb"),
    "dense, most significant bit first": (write_dense, CAMERA, {"bitorder": "big"}, "dense msb"),
    "dense, fine texture": (write_dense, fire(make_picture(250, 400, smooth=1), 72), {}, "dense lsb"),
    "dense, coarse texture": (write_dense, fire(make_picture(250, 400, smooth=15), 72), {}, "dense lsb"),
    "dense, bright": (write_dense, fire(make_picture(250, 400, low=0.2, high=0.95), 72), {}, "dense lsb"),
    "416": (write_416, CAMERA, {}, "416 lsb"),
    "416, most significant bit first": (write_416, CAMERA, {"bitorder": "big"}, "416 msb"),
    "416, dark at first": (write_416, np.concatenate([DARK, CAMERA]), {}, "416 lsb"),
    "416, random bits": (write_416, RANDOM, {}, "416 lsb"),
    "416, a grating of 16 pixels": (write_416, GRATING, {}, "416 lsb"),
    "sps1000": (write_sps1000, fire(make_picture(1000, 1000), 36), {}, "sps1000 lsb"),
    "dense, dark": (write_dense, DARK, {}, "shows no layout"),
    "dense, random bits": (write_dense, RANDOM, {}, "shows no layout"),
    "dense, white noise": (write_dense, fire(make_picture(250, 400, smooth=0.01), 72), {}, "shows no layout"),
    "dense, dark at first": (write_dense, np.concatenate([DARK, CAMERA]), {}, "dense lsb"),
    "dense, too few frames": (write_dense, CAMERA[:8], {}, "shows no layout"),
    "600x400": (write_dense, fire(make_picture(400, 600), 40), {}, "dense lsb"),
    "500x200, as many bytes as 400x250": (write_dense, fire(make_picture(200, 500), 72), {}, "dense lsb"),
    "200x500": (write_dense, fire(make_picture(500, 200), 72), {}, "dense lsb"),
    "500x400, two to a frame": (write_dense, fire(make_picture(400, 500), 60), {}, "dense lsb"),
    "400x500": (write_dense, fire(make_picture(500, 400), 60), {}, "dense lsb"),
    "400x125, half a frame": (write_dense, fire(make_picture(125, 400), 144), {}, "dense lsb"),
    "200x250": (write_dense, fire(make_picture(250, 200), 144), {}, "dense lsb"),
    "448x256, dark": (write_dense, np.zeros((72, 256, 448), np.uint8), {}, "fit no known layout"),
    "448x256": (write_dense, fire(make_picture(256, 448), 72), {}, "dense lsb"),
}


@pytest.mark.parametrize(("write", "spikes", "options", "expected"), RAW.values(), ids=RAW)
def test_a_raw_file_is_read_as_its_picture_shows_or_asked_about(tmp_path, write, spikes, options, expected):
    write(tmp_path / "a.dat", spikes, **options)
    if " no " in expected:
        error = refusal(recognise, tmp_path / "a.dat")
        assert expected in error.problem
        assert "--size" in error.hint
        return
    layout, order = recognise(tmp_path / "a.dat")
    assert f"{layout.name} {order}" == expected
    assert (layout.rows, layout.columns) == spikes.shape[1:]
    size = spikes.shape[1:]
    import_raw_frames(tmp_path / "a.dat", tmp_path / "a.h5", layout=layout.name, size=size, order=order, flip=False)
    with open_stream(tmp_path / "a.h5") as stream:
        assert np.array_equal(stream.frames(0, len(spikes)), spikes)


@pytest.mark.parametrize("bitorder", ["little", "big"])
@pytest.mark.parametrize("size", [(400, 600), (256, 448), (1000, 1000)], ids=str)
def test_any_size_is_read_when_it_is_stated(call, tmp_path, size, bitorder):
    spikes = fire(make_picture(*size), 24)
    write_dense(tmp_path / "a.dat", spikes, bitorder=bitorder)
    code, out, err = call("import", tmp_path / "a.dat", "--size", f"{size[1]}x{size[0]}", "--out", tmp_path / "a.h5")
    assert (code, err) == (0, "")
    assert f"24 frames of {size[1]}×{size[0]}" in out
    assert ("least" if bitorder == "little" else "most") + " significant bit first" in out
    with open_stream(tmp_path / "a.h5") as stream:
        assert np.array_equal(stream.frames(0, 24), spikes[:, ::-1])
    export_raw_frames(
        tmp_path / "a.h5", tmp_path / "b.dat", layout="dense", order="lsb" if bitorder == "little" else "msb"
    )
    assert (tmp_path / "b.dat").read_bytes() == (tmp_path / "a.dat").read_bytes()


def test_a_size_against_what_the_file_shows_is_believed_and_reported(call, tmp_path):
    write_dense(tmp_path / "a.dat", CAMERA)
    options = ("--size", "500x200", "--bits", "lsb")
    code, _, err = call("import", tmp_path / "a.dat", *options, "--out", tmp_path / "a.h5")
    assert code == 0
    assert "looks like layout dense of 400×250, but is read as layout dense of 500×200" in err


REFUSED_OPTIONS = {
    "size": (["--size", "400"], "the size is '400'"),
    "no pixels": (["--size", "0x250"], "the size is '0x250'"),
    "size of another layout": (["--size", "600x400", "--layout", "416"], "the size is 600x400"),
    "part of a byte": (["--size", "3x5"], "a multiple of 8 pixels"),
    "too many pixels": (["--size", "40000x40000"], "at most"),
    "not whole frames": (["--size", "448x256"], "900000 bytes are 62 frames of 14336 bytes"),
    "bits": (["--bits", "left", "--layout", "dense"], "order of bits 'left'"),
    "axes of a raw file": (["--axes", "TYX"], "--axes TYX is given for a raw file"),
    "most significant bits in a named layout": (["--layout", "dense"], "most significant is first"),
}


@pytest.mark.parametrize(("options", "words"), REFUSED_OPTIONS.values(), ids=REFUSED_OPTIONS)
def test_options_that_do_not_fit_are_refused(call, tmp_path, options, words):
    write_dense(tmp_path / "a.dat", CAMERA, bitorder="big")
    code, _, err = call("import", tmp_path / "a.dat", "--out", tmp_path / "a.h5", *options)
    assert code == 2
    assert words in err
    assert not (tmp_path / "a.h5").exists()


PERIODS = [2, 3, 4, 5, 7.5, 8, 15, 16, 30]


@pytest.mark.parametrize("period", PERIODS)
def test_a_grating_is_not_taken_for_the_other_order_of_bits(tmp_path, period):
    """With a period of 3, 5 or 15 pixels, pixels that are 15 apart are alike, and neighbours are not."""
    grating = np.broadcast_to(0.2 + 0.15 * np.sin(2 * np.pi * np.arange(400) / period), (250, 400))
    write_dense(tmp_path / "a.dat", fire(grating, 72))
    assert recognise(tmp_path / "a.dat", layout="dense")[1] == "lsb"


def test_without_texture_a_size_needs_the_order_of_bits(call, tmp_path):
    write_dense(tmp_path / "a.dat", RANDOM)
    code, _, err = call("import", tmp_path / "a.dat", "--size", "400x250", "--out", tmp_path / "a.h5")
    assert code == 2
    assert "--bits lsb or --bits msb" in err
    assert call("import", tmp_path / "a.dat", "--size", "400x250", "--bits", "lsb", "--out", tmp_path / "a.h5")[0] == 0


def npz_bytes():
    file = io.BytesIO()
    np.savez(file, a=SMALL)
    return file.getvalue()


CONTAINERS = {
    "an HDF5 file": b"\x89HDF\r\n\x1a\n", "a .npy file": b"\x93NUMPY\x01\x00", "a zip or .npz file": npz_bytes()[:16],
    "a gzip file": gzip.compress(b"")[:8], "a picture": b"\x89PNG\r\n\x1a\n", "a TIFF file": b"II*\0",
    "a video": b"\0\0\0\x20ftypisom",
    "an OpenEXR file": b"v/1\x01",
}  # fmt: skip


@pytest.mark.parametrize(("kind", "head"), CONTAINERS.items(), ids=CONTAINERS)
def test_a_file_of_another_kind_is_not_read_as_raw_frames(tmp_path, kind, head):
    (tmp_path / "a.dat").write_bytes(head + bytes(12_500 * 13 - len(head)))
    for layout in (None, "dense"):
        assert f"this is {kind}" in refusal(recognise, tmp_path / "a.dat", layout=layout).problem


TIME_LAST = np.ascontiguousarray(np.moveaxis(SMALL, 0, 2))
ARRAYS = {
    "0 and 1": (SMALL, "frames, axes TYX"),
    "bool": (SMALL.astype(bool), "frames, axes TYX"),
    "float": (SMALL.astype(np.float32), "frames, axes TYX"),
    "int64": (SMALL.astype(np.int64), "frames, axes TYX"),
    "0 and 255": (SMALL * 255, "frames, axes TYX, spikes are 255"),
    "0 and 255 as int16": (SMALL.astype(np.int16) * 255, "frames, axes TYX, spikes are 255"),
    "time last": (TIME_LAST, "frames, axes YXT"),
    "time last, 0 and 255": (TIME_LAST * 255, "frames, axes YXT, spikes are 255"),
    "time in the middle": (np.moveaxis(SMALL, 0, 1), "frames, axes YTX"),
    "packed": (np.packbits(SMALL, axis=0, bitorder="little"), "packed, axes TYX, least significant bit first"),
    "packed in numpy's order": (np.packbits(SMALL, axis=0), "packed, axes TYX, most significant bit first"),
    "packed, time last": (np.packbits(TIME_LAST, axis=2), "packed, axes YXT, most significant bit first"),
    "packed along rows": (np.packbits(SMALL, axis=2), "packed-x, axes TYX, most significant bit first"),
    "packed along rows, least significant bit first": (
        np.packbits(SMALL, axis=2, bitorder="little"), "packed-x, axes TYX, least significant bit first",
    ),
    "packed along columns": (np.packbits(SMALL, axis=1), "packed-y, axes TYX, most significant bit first"),
    "packed along rows, time last": (np.packbits(TIME_LAST, axis=1), "packed-x, axes YXT, most significant bit first"),
}  # fmt: skip


@pytest.mark.parametrize("ending", ["npy", "npz", "mat"])
@pytest.mark.parametrize(("array", "reading"), ARRAYS.values(), ids=ARRAYS)
def test_an_array_is_read_as_its_spikes_show(tmp_path, ending, array, reading):
    path = tmp_path / f"a.{ending}"
    if ending == "mat":
        savemat(path, {"a": array})
    else:
        (np.save if ending == "npy" else np.savez_compressed)(path, array)
    if ending == "mat" and array.dtype == bool:
        array = array.astype(np.uint8)
    found = SpikeArray(path)
    assert str(found.reading) == reading
    assert np.array_equal(found.frames(0, 320), SMALL)
    assert np.array_equal(found.frames(5, 23), SMALL[5:23])


BERNOULLI = (np.random.default_rng(4).random((80, 40, 64)) < make_picture(40, 64)).astype(np.uint8)
BYTES, ROW_BYTES = (np.packbits(RANDOM[:, :40, :64], axis=axis) for axis in (0, 2))
NUMPY_ORDER = np.packbits(SMALL, axis=0)
LSB, MSB = (f"packed, axes TYX, {which} significant bit first" for which in ("least", "most"))
UNCLEAR = {
    "single values, time first": (BERNOULLI, {}, "frames, axes TYX"),
    "single values, time last": (np.moveaxis(BERNOULLI, 0, 2), {}, None),
    "single values, time last, stated": (np.moveaxis(BERNOULLI, 0, 2), {"axes": "YXT"}, "frames, axes YXT"),
    "long last axis, random": (RANDOM[:8, :8], {}, None),
    "long first axis, stripes": (np.repeat(RANDOM[:, :1, :16], 16, axis=1), {}, "frames, axes TYX"),
    "random bits": (RANDOM[:, :40, :64], {}, "frames, axes TYX"),
    "random bytes": (BYTES, {}, None),
    "random bytes, packed": (BYTES, {"layout": "packed"}, LSB),
    "random bytes, order stated": (BYTES, {"layout": "packed", "order": "msb"}, MSB),
    "random bytes, only their axes": (BYTES, {"axes": "TYX"}, None),
    "random rows": (ROW_BYTES, {"layout": "packed-x", "order": "msb"}, MSB.replace("packed", "packed-x")),
    "packed against what is stated": (NUMPY_ORDER, {"layout": "packed", "axes": "YXT"}, None),
    "numpy's order, stated as usual": (NUMPY_ORDER, {"layout": "packed", "order": "lsb"}, LSB),
    "numpy's order, packed": (NUMPY_ORDER, {"layout": "packed"}, MSB),
    "0 and 7": (SMALL * 7, {}, None),
    "bytes without a spike": (SMALL * 0, {}, None),
    "bytes without a spike, stated": (SMALL * 0, {"layout": "frames"}, "frames, axes TYX"),
    "bool without a spike": (np.zeros((320, 40, 64), bool), {}, "frames, axes TYX"),
    "dark in all blocks but one": (
        np.concatenate([SMALL[:8] * 0] * 70 + [SMALL * 255]),
        {},
        "frames, axes TYX, spikes are 255",
    ),
}


@pytest.mark.parametrize(("array", "options", "reading"), UNCLEAR.values(), ids=UNCLEAR)
def test_an_array_that_shows_nothing_is_read_as_usual_only_if_its_values_are_single(tmp_path, array, options, reading):
    np.save(tmp_path / "a.npy", array)
    if reading is None:
        assert refusal(SpikeArray, tmp_path / "a.npy", **options).hint
    else:
        assert str(SpikeArray(tmp_path / "a.npy", **options).reading) == reading


def test_the_array_of_rsir_is_read_as_its_program_writes_it(tmp_path):
    np.savez(tmp_path / "a.npz", seq=np.packbits(RANDOM[:, :40, :64], axis=0, bitorder="little"))
    assert np.array_equal(SpikeArray(tmp_path / "a.npz").frames(0, 72), RANDOM[:, :40, :64])


def test_a_size_says_where_packed_rows_end(tmp_path):
    np.save(tmp_path / "a.npy", np.packbits(SMALL[:, :, :61], axis=2))
    assert "--size" in refusal(SpikeArray, tmp_path / "a.npy").hint
    assert np.array_equal(SpikeArray(tmp_path / "a.npy", size=(40, 61)).frames(0, 320), SMALL[:, :, :61])
    for size in ((40, 50), (33, 61), (41, 64), (40, 65)):
        assert "as in the array" in refusal(SpikeArray, tmp_path / "a.npy", size=size).allowed


@pytest.mark.parametrize("rate", [0.02, 0.1, 0.3, 0.5, 0.7, 0.95])
def test_readouts_of_one_pixel_exclude_each_other_and_random_ones_do_not(rate):
    """80 frames of 100 x 100; a wrong axis would need 8 standard deviations, so one in 10^14."""
    spikes = fire(np.full((100, 100), rate), 80)
    assert evidence.time_axes(spikes) == [0]
    shuffled = np.random.default_rng(1).permuted(spikes, axis=0)
    assert evidence.time_axes(shuffled) == []


LOGS = {
    "seconds": ("seconds,position\n0,0\n0.05,1\n", "2 rows, which cover 100% of the recording", ""),
    "byte order mark": ("\ufeffseconds,position\n0,0\n0.05,1\n", "cover 100%", ""),
    "milliseconds": ("milliseconds,position\n0,0\n50,1\n", "cover 100%", ""),
    "milliseconds under seconds": ("seconds,position\n0,0\n50,1\n", "", "1e+03 times as long"),
    "frames of another rate": ("frame,position\n0,0\n4,1\n", "", "cover 0%"),
    "a twentieth": ("frame,position\n100,0\n150,1\n", "", "cover 5%"),
    "twice as long": ("frame,position\n0,0\n2000,1\n", "cover 100%", ""),
    "three times as long": ("frame,position\n-1000,0\n2000,1\n", "", "3 times as long"),
    "microseconds": ("microseconds,position\n0,0\n50000,1\n", "cover 100%", ""),
}


@pytest.mark.parametrize(("text", "said", "warned"), LOGS.values(), ids=LOGS)
def test_import_says_how_much_of_a_recording_its_log_covers(call, tmp_path, text, said, warned):
    np.save(tmp_path / "a.npy", np.tile(SMALL[:, :8, :8], (4, 1, 1))[:1000])
    (tmp_path / "log.csv").write_text(text, encoding="utf-8")
    code, out, err = call("import", tmp_path / "a.npy", "--focus", tmp_path / "log.csv", "--out", tmp_path / "a.h5")
    assert code == 0
    assert said in out
    assert warned in err
    assert bool(warned) == bool(err)


def test_import_shows_a_small_picture(call, tmp_path):
    spikes = np.zeros((400, 40, 64), np.uint8)
    spikes[::2, :, 32:] = 1
    np.save(tmp_path / "a.npy", spikes)
    _, out, _ = call("import", tmp_path / "a.npy", "--axes", "TYX", "--out", tmp_path / "a.h5")
    rows = out.splitlines()[1:]
    assert {row.rstrip() for row in rows} == {" " * 24 + "@" * 24}


def test_a_large_stream_can_be_exported_for_spikecv(call, tmp_path):
    write_stream(tmp_path / "a.h5", fire(make_picture(1000, 1000), 12))
    code, out, _ = call("export", tmp_path / "a.h5", "--for", "spikecv", "--out", tmp_path / "a.dat")
    assert code == 0
    assert f"{12 * 125_000} bytes" in out
