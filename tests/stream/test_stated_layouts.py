"""How raw frames are stored is what a user states; what nobody states is asked for, with pictures to choose from."""

import gzip
import io

import numpy as np
import pytest
from planted_recordings import fire, make_picture, write_416, write_dense, write_sps1000
from refusals import refusal

from saf_gen.stream.interop import export_raw_frames, state_layout
from saf_gen.stream.stream_file import open_stream
from saf_gen.stream.stream_writer import write_stream

CAMERA = fire(make_picture(250, 400), 72)
SMALL = fire(make_picture(40, 64), 320)


@pytest.mark.parametrize(("layout", "write"), [("dense", write_dense), ("416", write_416), ("sps1000", write_sps1000)])
@pytest.mark.parametrize("bits", ["lsb", "msb"])
def test_a_named_layout_is_read_with_its_usual_bits_or_those_that_are_stated(call, tmp_path, layout, write, bits):
    spikes = CAMERA if layout != "sps1000" else fire(make_picture(1000, 1000), 8)
    write(tmp_path / "a.dat", spikes, bitorder="little" if bits == "lsb" else "big")
    options = ("--layout", layout, "--no-flip", *(("--bits", "msb") if bits == "msb" else ()))
    code, out, err = call("import", tmp_path / "a.dat", "--out", tmp_path / "a.h5", *options)
    assert (code, err) == (0, "")
    assert (
        f"read as layout {layout}, {'least' if bits == 'lsb' else 'most'} significant bit first, top row first" in out
    )
    with open_stream(tmp_path / "a.h5") as stream:
        assert np.array_equal(stream.frames(0, len(spikes)), spikes)


def test_without_a_layout_import_shows_those_that_fit_and_names_the_options(call, tmp_path):
    """Left half bright: a picture of the right layout has an edge, that of the other is torn."""
    spikes = np.zeros((130, 250, 400), np.uint8)
    spikes[:, :, :200] = 1
    write_dense(tmp_path / "a.dat", spikes)
    code, out, err = call("import", tmp_path / "a.dat", "--out", tmp_path / "a.h5")
    assert code == 2
    assert err.count("\n") == 1
    for words in ("--layout 416 (400x250)", "--layout dense (400x250)", "--size", "--bits", "do not say how they are"):
        assert words in err
    assert "sps1000 (1000x1000)" not in err  # it does not fit the length
    assert not (tmp_path / "a.h5").exists()
    heads = [at for at, line in enumerate(out.splitlines()) if "as --layout" in line]
    of_416, of_dense = out.splitlines()[1 : heads[1]], out.splitlines()[heads[1] + 1 :]
    assert {line.rstrip() for line in of_dense} == {"@" * 16}
    assert {line.rstrip() for line in of_416} != {"@" * 16}


def test_without_a_layout_that_fits_no_picture_is_shown(call, tmp_path):
    write_dense(tmp_path / "a.dat", fire(make_picture(256, 448), 71))
    code, out, err = call("import", tmp_path / "a.dat", "--out", tmp_path / "a.h5")
    assert (code, out) == (2, "")
    assert "layouts that fit the length, which proves nothing: none" in err


@pytest.mark.slow
@pytest.mark.parametrize("bitorder", ["little", "big"])
@pytest.mark.parametrize("size", [(400, 600), (256, 448), (1000, 1000)], ids=str)
def test_any_size_is_read_when_it_is_stated(call, tmp_path, size, bitorder):
    spikes = fire(make_picture(*size), 24)
    write_dense(tmp_path / "a.dat", spikes, bitorder=bitorder)
    order = "lsb" if bitorder == "little" else "msb"
    options = ("--size", f"{size[1]}x{size[0]}", "--bits", order)
    code, out, err = call("import", tmp_path / "a.dat", *options, "--out", tmp_path / "a.h5")
    assert (code, err) == (0, "")
    assert f"24 frames of {size[1]}×{size[0]}" in out
    assert ("least" if bitorder == "little" else "most") + " significant bit first" in out
    with open_stream(tmp_path / "a.h5") as stream:
        assert np.array_equal(stream.frames(0, 24), spikes[:, ::-1])
    export_raw_frames(tmp_path / "a.h5", tmp_path / "b.dat", layout="dense", order=order)
    assert (tmp_path / "b.dat").read_bytes() == (tmp_path / "a.dat").read_bytes()


REFUSED_OPTIONS = {
    "size": (["--size", "400"], "the size is '400'"),
    "no pixels": (["--size", "0x250"], "the size is '0x250'"),
    "size of another layout": (["--size", "600x400", "--layout", "416"], "the size is 600x400"),
    "part of a byte": (["--size", "3x5", "--bits", "lsb"], "a multiple of 8 pixels"),
    "too many pixels": (["--size", "40000x40000", "--bits", "lsb"], "at most"),
    "not whole frames": (["--size", "448x256", "--bits", "lsb"], "900000 bytes are 62 frames of 14336 bytes"),
    "bits": (["--bits", "left", "--layout", "dense"], "order of bits 'left'"),
    "axes of a raw file": (["--axes", "TYX"], "--axes TYX is given for a raw file"),
    "a size without an order of bits": (["--size", "400x250"], "which bit of a byte is first; allowed: --bits lsb or"),
}


@pytest.mark.parametrize(("options", "words"), REFUSED_OPTIONS.values(), ids=REFUSED_OPTIONS)
def test_options_that_do_not_fit_are_refused(call, tmp_path, options, words):
    write_dense(tmp_path / "a.dat", CAMERA)
    code, _, err = call("import", tmp_path / "a.dat", "--out", tmp_path / "a.h5", *options)
    assert code == 2
    assert words in err
    assert not (tmp_path / "a.h5").exists()


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
        error = refusal(state_layout, tmp_path / "a.dat", layout=layout, size=None, order=None)
        assert f"this is {kind}" in error.problem


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
    code, out, err = call(
        "import", tmp_path / "a.npy", "--axes", "TYX", "--focus", tmp_path / "log.csv", "--out", tmp_path / "a.h5"
    )
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


@pytest.mark.slow
def test_a_large_stream_can_be_exported_for_spikecv(call, tmp_path):
    write_stream(tmp_path / "a.h5", fire(make_picture(1000, 1000), 12))
    code, out, _ = call("export", tmp_path / "a.h5", "--for", "spikecv", "--out", tmp_path / "a.dat")
    assert code == 0
    assert f"{12 * 125_000} bytes" in out
