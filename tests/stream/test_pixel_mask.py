"""Masked pixels are filled by one rule, in everything that measures and views read, and in nothing else."""

import h5py
import numpy as np
import pytest
from own_plugins import PARTS
from refusals import refusal

from saf_gen.benchmark.view.recording import WindowCounts
from saf_gen.core.seeds import make_generator
from saf_gen.stream.cutting import cut_stream
from saf_gen.stream.interop import export_raw_frames, import_raw_frames
from saf_gen.stream.spike_windows import SpikeWindows
from saf_gen.stream.stream_file import open_stream
from saf_gen.stream.stream_writer import write_stream

FRAMES, HEIGHT, WIDTH = 300, 12, 16
SPIKES = (make_generator("mask").random((FRAMES, HEIGHT, WIDTH)) < 0.3).astype(np.uint8)


def mask_of(*places):
    mask = np.zeros((HEIGHT, WIDTH), bool)
    for place in places:
        mask[place] = True
    return mask


MASKS = {
    "inside": mask_of((5, 7)),
    "corners": mask_of((0, 0), (HEIGHT - 1, WIDTH - 1), (0, WIDTH - 1)),
    "cluster": mask_of((slice(3, 6), slice(4, 8))),
    "row": mask_of(4),
    "first columns": mask_of((slice(None), slice(0, 3))),
    "all but one": ~mask_of((2, 3)),
    "chessboard": np.indices((HEIGHT, WIDTH)).sum(axis=0) % 2 == 0,
    "random": make_generator("bad").random((HEIGHT, WIDTH)) < 0.2,
}


def fill_plainly(image, mask):
    """Return a picture whose masked pixels have the mean of the valid pixels at the smallest distance."""
    out = image.copy()
    valid = np.argwhere(~mask)
    for y, x in np.argwhere(mask):
        squares = ((valid - (y, x)) ** 2).sum(axis=1)
        mean = np.mean([image[tuple(at)] for at in valid[squares == squares.min()]], dtype=np.float64)
        out[y, x] = mean if image.dtype.kind == "f" else np.floor(mean + 0.5)
    return out


def write(path, mask=None):
    write_stream(path, SPIKES, mask=mask)
    return path


@pytest.mark.parametrize("name", MASKS)
def test_counts_and_textures_are_filled_as_the_plain_rule_says(tmp_path, name):
    mask, box = MASKS[name], (slice(2, 8), slice(1, 9))
    with open_stream(write(tmp_path / "a.h5", mask)) as stream, open_stream(write(tmp_path / "b.h5")) as clean:
        for first, stop in ((0, 300), (37, 141), (8, 9)):
            expected = fill_plainly(clean.counts(first, stop), mask)
            texture = fill_plainly(clean.texture(first, stop), mask)
            for source in (stream.counts(first, stop), WindowCounts(stream).window(first, stop)):
                np.testing.assert_array_equal(source, expected)
                assert source.dtype == np.uint32
            np.testing.assert_array_equal(stream.counts(first, stop, region=box), expected[box])
            np.testing.assert_array_equal(WindowCounts(stream, box).window(first, stop), expected[box])
            np.testing.assert_allclose(stream.texture(first, stop), texture, rtol=1e-12)
            np.testing.assert_allclose(WindowCounts(stream, box).intervals(first, stop), texture[box], rtol=1e-12)
        np.testing.assert_array_equal(stream.frames(0, FRAMES), SPIKES)
        np.testing.assert_array_equal(stream.packed(0, 3), clean.packed(0, 3))
        np.testing.assert_array_equal(stream.counts(0, 50, filled=False), clean.counts(0, 50))
        many = np.concatenate(list(stream.counts_of_windows([0, 40, 80], 30, region=box)))
        for at, first in enumerate((0, 40, 80)):
            np.testing.assert_array_equal(many[at], fill_plainly(clean.counts(first, first + 30), mask)[box])


def test_long_windows_are_filled_after_they_are_added_up(tmp_path):
    with open_stream(write(tmp_path / "a.h5", MASKS["random"])) as stream:
        counts = WindowCounts(stream)
        for first, stop in ((3, 297), (0, FRAMES), (40, 265), (129, 131)):
            np.testing.assert_array_equal(counts.window(first, stop), stream.counts(first, stop))


def test_a_mask_is_part_of_the_content_and_a_stream_without_one_keeps_its_digest(tmp_path):
    plain, masked = write(tmp_path / "a.h5"), write(tmp_path / "b.h5", MASKS["inside"])
    with open_stream(plain) as one, open_stream(masked) as two:
        assert one.content_sha256 == "e1d00de250ffe48299b6cba63d6533f7a8ef591c96c438fbaa588992d08cc503"
        assert one.content_sha256 != two.content_sha256
        two.verify()
        np.testing.assert_array_equal(two.metadata.mask, MASKS["inside"])
    with h5py.File(plain) as file:
        assert set(file) == {"spikes"}
    with h5py.File(masked) as file:
        assert file["pixels/mask"].dtype == bool
        np.testing.assert_array_equal(file["spikes"][:], h5py.File(plain)["spikes"][:])


def test_an_altered_mask_is_noticed_when_a_stream_is_opened(tmp_path):
    path = write(tmp_path / "a.h5", MASKS["inside"])
    with h5py.File(path, "r+") as file:
        file["pixels/mask"][0, 0] = True
    assert "SHA-256" in str(refusal(open_stream, path))


@pytest.mark.parametrize(
    ("mask", "words"),
    [
        (np.ones((HEIGHT, WIDTH), bool), "every pixel"),
        (np.zeros((WIDTH, HEIGHT), bool), "shape (16, 12)"),
        (np.zeros((1, HEIGHT, WIDTH), bool), "shape (1, 12, 16)"),
        (np.zeros((HEIGHT, WIDTH), complex), "dtype complex128"),
    ],
)
def test_a_mask_that_cannot_be_is_refused(tmp_path, mask, words):
    assert words in str(refusal(write, tmp_path / "a.h5", mask))
    assert not (tmp_path / "a.h5").exists()


@pytest.mark.parametrize("dtype", ["uint8", "int64", "float32", "bool"])
def test_a_mask_of_any_dtype_is_stored_as_bool(tmp_path, dtype):
    with open_stream(write(tmp_path / "a.h5", MASKS["random"].astype(dtype))) as stream:
        np.testing.assert_array_equal(stream.metadata.mask, MASKS["random"])


def test_a_part_keeps_its_mask_and_fills_from_its_own_pixels(tmp_path):
    box = (slice(0, 6), slice(5, 12))
    source = write(tmp_path / "a.h5", MASKS["cluster"])
    cut_stream(source, tmp_path / "b.h5", first=16, stop=200, region=box)
    with open_stream(tmp_path / "b.h5") as part:
        mask = MASKS["cluster"][box]
        np.testing.assert_array_equal(part.metadata.mask, mask)
        expected = fill_plainly(SPIKES[16:200].sum(axis=0, dtype=np.uint32)[box], mask)
        np.testing.assert_array_equal(part.counts(0, 184), expected)
    cut_stream(source, tmp_path / "c.h5", region=(slice(7, 12), slice(0, 16)))
    with open_stream(tmp_path / "c.h5") as part:
        assert part.metadata.mask is None
    masked = str(refusal(cut_stream, source, tmp_path / "d.h5", region=(slice(3, 5), slice(4, 6))))
    assert "every pixel of the part is masked" in masked
    assert not (tmp_path / "d.h5").exists()


@pytest.mark.slow
def test_kept_counts_of_a_masked_stream_are_not_those_of_the_unmasked(tmp_path):
    from saf_gen.stream.dataset import index_folder

    seen = []
    for folder, mask in (("a", None), ("b", MASKS["row"])):
        write(tmp_path / folder / "desk-lamp-00.h5", mask)
        index_folder(tmp_path / folder)
        windows = SpikeWindows(tmp_path / folder, window=50, target=lambda *_: 0, counts=tmp_path / "counts")
        seen.append(windows[1][0][0])
        windows.close()
    total = SPIKES[50:100].sum(axis=0, dtype=np.uint32)
    np.testing.assert_array_equal(seen[0], total)
    np.testing.assert_array_equal(seen[1], fill_plainly(total, MASKS["row"]))
    assert len(list((tmp_path / "counts").iterdir())) == 2


def test_an_export_holds_the_spikes_of_masked_pixels(tmp_path):
    write(tmp_path / "a.h5", MASKS["row"])
    export_raw_frames(tmp_path / "a.h5", tmp_path / "a.dat", layout="dense")
    import_raw_frames(tmp_path / "a.dat", tmp_path / "b.h5", layout="dense", size=(HEIGHT, WIDTH))
    with open_stream(tmp_path / "b.h5") as stream:
        np.testing.assert_array_equal(stream.frames(0, FRAMES), SPIKES)
        assert stream.metadata.mask is None


@pytest.mark.parametrize("measure", ["tenengrad", "sd_debiased", "sd_tfi", "my_parts.py:Range"])
def test_a_measure_sees_no_bad_pixel_whoever_wrote_it(tmp_path, call, monkeypatch, measure):
    """Pixels that are masked may hold anything: dead, stuck or wild, they change no score."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my_parts.py").write_text(PARTS)
    scores = []
    for name, value in (("dead", 0), ("stuck", 1), ("wild", SPIKES[::-1, ::-1][:, MASKS["random"]])):
        spikes = SPIKES.copy()
        spikes[:, MASKS["random"]] = value
        write_stream(f"{name}.h5", spikes, mask=MASKS["random"])
        code, out, err = call("score", f"{name}.h5", "--measure", measure, "--window", 60)
        assert code == 0, err
        scores.append(out)
    assert scores[0].count("\n") == 6
    assert len(set(scores)) == 1
