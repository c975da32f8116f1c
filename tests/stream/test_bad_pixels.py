"""Masks are read from any usual file; what does not fit is refused."""

import h5py
import numpy as np
import pytest
import scipy.io
from folder_server import serve
from PIL import Image
from planted_recordings import fire, make_picture
from refusals import refusal

from saf_gen.core.seeds import make_generator
from saf_gen.stream.interop.bad_pixels import read_mask
from saf_gen.stream.stream_file import open_stream

FRAMES, HEIGHT, WIDTH = 400, 24, 40
BAD = make_generator("bad pixels").random((HEIGHT, WIDTH)) < 0.03
SPIKES = fire(make_picture(HEIGHT, WIDTH), FRAMES)
BYTES = BAD.astype(np.uint8)
IMPORT = ("import", "--axes", "TYX")


def save_image(mode, values):
    return lambda path: Image.fromarray(values).convert(mode).save(path)


def save_palette(path):
    image = Image.fromarray(BYTES, mode="P")
    image.putpalette([0, 0, 0, 200, 10, 10] + 254 * [0, 0, 0])
    image.save(path)


def save_matlab_7(path):
    with h5py.File(path, "w", userblock_size=512) as file:
        file["bad"] = BYTES.T  # MATLAB stores the axes in reverse order
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(128))


def save_text(text, encoding="utf-8"):
    return lambda path: path.write_text(text, encoding=encoding)


PLACES = "\n".join(f"{y},{x}" for y, x in np.argwhere(BAD))
RED = np.stack([BYTES * 3, BYTES * 0, BYTES * 0], axis=2)
MASKS = {
    "grey.png": save_image("L", BYTES * 255),
    "dim.png": save_image("L", BYTES),
    "two levels.png": save_image("1", BYTES * 255),
    "deep.png": lambda path: Image.fromarray(BYTES.astype(np.uint16) * 40_000).save(path),
    "palette.png": save_palette,
    "red.png": lambda path: Image.fromarray(RED).save(path),
    "opaque.png": lambda path: Image.fromarray(RED).convert("RGBA").save(path),
    "a.bmp": save_image("L", BYTES * 255),
    "a.tif": save_image("L", BYTES * 255),
    "a.PGM": lambda path: Image.fromarray(BYTES * 255).save(path, format="PPM"),
    "bool.npy": lambda path: np.save(path, BAD),
    "whole.npy": lambda path: np.save(path, BAD.astype(np.int64) * -7),
    "float.npy": lambda path: np.save(path, BAD * 0.25),
    "columns.npy": lambda path: np.save(path, np.asfortranarray(BYTES)),
    "one.npz": lambda path: np.savez(path, bad=BAD),
    "deflated.npz": lambda path: np.savez_compressed(path, bad=BAD, name=np.zeros(3)),
    "many.npz:bad": lambda path: np.savez(path, good=~BAD, bad=BAD),
    "old.mat": lambda path: scipy.io.savemat(path, {"bad": BAD}),
    "old.mat:bad": lambda path: scipy.io.savemat(path, {"good": BYTES + 1, "bad": BYTES}, do_compression=True),
    "new.mat": save_matlab_7,
    "a.csv": save_text(f"row,column\n{PLACES}\n"),
    "marked.csv": save_text(f"# found by hand\nrow,col\n\n{PLACES}\n{PLACES}", encoding="utf-8-sig"),
}


@pytest.mark.parametrize("name", MASKS)
def test_a_mask_is_read_as_it_was_written(tmp_path, name):
    MASKS[name](tmp_path / name.partition(":")[0])
    np.testing.assert_array_equal(read_mask(str(tmp_path / name), (HEIGHT, WIDTH)), BAD)


REFUSED = {
    "size.npy": (lambda path: np.save(path, BAD[1:]), "23 × 40 pixels; allowed: 24 rows × 40 columns"),
    "turned.png": (save_image("L", BYTES.T * 255), "40 × 24 pixels"),
    "frames.npy": (lambda path: np.save(path, BAD[None]), "the array is bool (1, 24, 40)"),
    "line.npy": (lambda path: np.save(path, BAD[0]), "the array is bool (40,)"),
    "nan.npy": (lambda path: np.save(path, np.where(BAD, np.nan, 0)), "not finite"),
    "complex.npy": (lambda path: np.save(path, BAD * 1j), "the array is complex128"),
    "turned around.npy": (lambda path: np.save(path, ~BAD), "bad pixels are not 0, good ones are 0"),
    "many.npz": (lambda path: np.savez(path, good=~BAD, bad=BAD), "has 2 arrays of two axes"),
    "none.npz": (lambda path: np.savez(path, a=np.zeros(3)), "has no arrays of two axes"),
    "many.npz:worse": (lambda path: np.savez(path, good=~BAD, bad=BAD), "array 'worse'"),
    "a.jpg": (save_image("L", BYTES * 255), "kind of mask '.jpg'"),
    "a.txt": (save_text(PLACES), "kind of mask '.txt'"),
    "bare.csv": (save_text(PLACES), "allowed: row,column or row,col"),
    "turned.csv": (save_text("column,row\n3,4\n"), "the columns are 'column,row'"),
    "far.csv": (save_text("row,column\n24,0\n"), "row is 24; allowed: 0 to 23"),
    "below.csv": (save_text("row,column\n3,-1\n"), "column is -1"),
    "half.csv": (save_text("row,column\n3,2\n3,1.5\n"), "column is 1.5"),
    "word.csv": (save_text("row,column\n3,x\n"), "word.csv:2: column is 'x'"),
    "short.csv": (save_text("row,column\n3\n"), "short.csv:2: the row is '3'"),
    "empty.csv": (save_text(""), "the columns are ''"),
    "damaged.png": (save_text("no picture"), "damaged.png"),
    "damaged.npy": (save_text("no array"), "cannot be read"),
    "missing.npy": (lambda path: None, "there is no such file"),
    "folder.npy": (lambda path: path.mkdir(), "there is no such file"),
    "pages.tif": (
        lambda path: Image.fromarray(BYTES).save(path, save_all=True, append_images=[Image.fromarray(BYTES)]),
        "has 2 pages",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_mask_that_does_not_fit_is_refused(tmp_path, name):
    make, words = REFUSED[name]
    make(tmp_path / name.partition(":")[0])
    assert words in str(refusal(read_mask, str(tmp_path / name), (HEIGHT, WIDTH)))


@pytest.mark.parametrize("flip", [False, True])
def test_an_imported_mask_has_its_first_row_on_top(call, tmp_path, flip):
    np.save(tmp_path / "a.npy", SPIKES)
    np.save(tmp_path / "bad.npy", BAD)
    options = ("--mask", tmp_path / "bad.npy", *(["--flip"] if flip else []))
    code, out, err = call(*IMPORT, tmp_path / "a.npy", "--out", tmp_path / "a.h5", *options)
    assert (code, err) == (0, "")
    assert f"mask: {BAD.sum()} bad pixels, filled in counts and pictures" in out
    with open_stream(tmp_path / "a.h5") as stream:
        np.testing.assert_array_equal(stream.metadata.mask, BAD)
        np.testing.assert_array_equal(stream.frames(0, FRAMES), SPIKES[:, ::-1] if flip else SPIKES)
    assert f"{BAD.sum()} bad pixels ({BAD.mean():.2%})" in call("inspect", tmp_path / "a.h5")[1]


def test_a_dataset_keeps_its_masks_when_it_is_fetched_and_verify_shows_them(call, tmp_path):
    np.save(tmp_path / "a.npy", SPIKES)
    np.save(tmp_path / "bad.npy", BAD)
    call(*IMPORT, tmp_path / "a.npy", "--out", tmp_path / "set/desk-lamp-00.h5", "--mask", tmp_path / "bad.npy")
    call("dataset", "index", tmp_path / "set")
    with serve(tmp_path / "set") as (_, address):
        assert call("fetch", address, "--out", tmp_path / "fetched")[0] == 0
    code, out, _ = call("verify", tmp_path / "fetched")
    assert code == 0
    assert f"desk-lamp-00: mask: {BAD.sum()} bad pixels" in out
    with open_stream(tmp_path / "fetched/desk-lamp-00.h5") as stream:
        np.testing.assert_array_equal(stream.metadata.mask, BAD)


def test_a_refused_mask_leaves_nothing_behind(call, tmp_path):
    np.save(tmp_path / "a.npy", SPIKES)
    np.save(tmp_path / "bad.npy", BAD[1:])
    code, _, err = call(*IMPORT, tmp_path / "a.npy", "--out", tmp_path / "a.h5", "--mask", tmp_path / "bad.npy")
    assert code == 2
    assert err.count("\n") == 1
    assert not (tmp_path / "a.h5").exists()


def test_a_folder_of_recordings_takes_no_mask(call, tmp_path):
    code, _, err = call("import", tmp_path, "--out", tmp_path / "out", "--mask", "a.csv")
    assert code == 2
    assert "--mask is given with a folder" in err


def test_a_mask_without_bad_pixels_is_none(call, tmp_path):
    np.save(tmp_path / "a.npy", SPIKES)
    np.save(tmp_path / "bad.npy", 0 * BYTES)
    code, out, _ = call(*IMPORT, tmp_path / "a.npy", "--out", tmp_path / "a.h5", "--mask", tmp_path / "bad.npy")
    assert code == 0
    assert "mask: no bad pixel\n" in out
    with open_stream(tmp_path / "a.h5") as stream:
        assert stream.metadata.mask is None


def test_an_export_says_that_it_cannot_hold_a_mask(call, tmp_path):
    np.save(tmp_path / "a.npy", SPIKES)
    np.save(tmp_path / "bad.npy", BAD)
    call(*IMPORT, tmp_path / "a.npy", "--out", tmp_path / "a.h5", "--mask", tmp_path / "bad.npy")
    code, _, err = call("export", tmp_path / "a.h5", "--out", tmp_path / "a.dat")
    assert code == 0
    assert "cannot hold what the stream says of its mask of bad pixels" in err
