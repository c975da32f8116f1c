"""Pictures of other cameras become spikes: linear light, independent of the file format, and read in parts."""

import sys
from importlib.machinery import ModuleSpec
from itertools import pairwise
from types import ModuleType

import numpy as np
import pytest
from PIL import Image
from refusals import assert_says, refusal

from saf_gen.camera import get_sensor
from saf_gen.stream.interop import encode_pictures as module
from saf_gen.stream.interop.encode_pictures import encode_pictures, prepare_pictures
from saf_gen.stream.interop.picture_frames import decode_srgb, open_pictures
from saf_gen.stream.stream_file import open_stream

IDEAL = get_sensor("ideal")
PICTURES = np.random.default_rng(4).integers(20, 236, (12, 8, 10), np.uint8)


def encode_array(tmp_path, array, *, linear=True, **options):
    """Encode an array with the ideal sensor; return the rates in each tenth of the recording, and the plan."""
    np.save(tmp_path / "in.npy", array)
    plan = prepare_pictures(open_pictures(tmp_path / "in.npy", linear=linear), IDEAL, **options)
    encode_pictures(plan, tmp_path / "out.h5", seed=3)
    with open_stream(tmp_path / "out.h5") as stream:
        edges = np.linspace(0, plan.frames, 11).astype(int)
        return np.stack([stream.counts(a, b) / (b - a) for a, b in pairwise(edges)]), plan


def test_screen_values_are_decoded_as_the_standard_says():
    """Against the closed form of IEC 61966-2-1 at four values, the last one on its linear part."""
    assert decode_srgb(np.array([1.0, 0.5, 0.04045, 0.04])) == pytest.approx(
        [1, 0.21404, 0.0031308, 0.0030960], rel=1e-4
    )


def test_rates_are_proportional_to_light_and_their_mean_is_what_was_asked_for(tmp_path):
    """A pixel without noise fires at its charge over the threshold, exact to one spike in 2,000 readouts."""
    light = np.broadcast_to(np.linspace(0.1, 1.0, 10, dtype=np.float32), (1, 8, 10))
    rates, _ = encode_array(tmp_path, light, frames=2_000, mean_rate=0.22)
    assert rates.mean(axis=(0, 1)) == pytest.approx(0.22 * light[0, 0] / 0.55, abs=1e-3)


def test_light_between_two_pictures_is_a_fade(tmp_path):
    """From 1 to 3 in 4,000 readouts, each tenth has the light of its middle."""
    light = np.ones((2, 8, 10), np.float32) * np.array([1, 3], np.float32)[:, None, None]
    rates, plan = encode_array(tmp_path, light, rate_hz=5, mean_rate=0.2)
    assert plan.frames == 4_000
    assert rates.mean(axis=(1, 2)) == pytest.approx(0.1 * (1 + 2 * (np.arange(10) + 0.5) / 10), abs=1e-3)


def test_screen_values_and_the_light_they_stand_for_give_the_same_rates(tmp_path):
    values = np.broadcast_to(np.linspace(0.1, 1, 10, dtype=np.float32), (1, 8, 10))
    decoded, _ = encode_array(tmp_path, values, linear=False, frames=500)
    light, _ = encode_array(tmp_path, decode_srgb(values), frames=500)
    assert np.array_equal(decoded, light)


def test_colours_are_weighed_as_light_and_alpha_is_left_out(tmp_path):
    colours = np.zeros((1, 4, 4, 4), np.float32)
    for column in range(3):
        colours[..., column, column] = 1
    colours[..., 3, :3] = 1
    colours[..., 3] = 0.5
    np.save(tmp_path / "a.npy", colours)
    (light,) = open_pictures(tmp_path / "a.npy")
    assert light[0] == pytest.approx([0.2126, 0.7152, 0.0722, 1])


def write_images(folder, pictures, ending="png"):
    folder.mkdir()
    for number, picture in enumerate(pictures):
        Image.fromarray(picture).save(folder / f"frame_{number}.{ending}")
    (folder / "notes.txt").write_text("left alone")


@pytest.fixture
def video(monkeypatch):
    """Replace imageio-ffmpeg, which need not be installed: PICTURES at 1,000 Hz, in three equal colours."""
    fake = ModuleType("imageio_ffmpeg")
    fake.__spec__ = ModuleSpec("imageio_ffmpeg", None)

    def read_frames(path, input_params):
        fake.input_params = input_params
        yield {"fps": 1_000.0, "size": (10, 8)}
        yield from (np.repeat(picture[:, :, None], 3, axis=2).tobytes() for picture in PICTURES)

    fake.read_frames = read_frames
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", fake)
    return fake


def test_the_same_pictures_in_any_file_become_the_same_spikes(tmp_path, video):
    """Twelve images of 8 bits in natural order, with frame_10 after frame_9."""
    write_images(tmp_path / "images", PICTURES)
    np.save(tmp_path / "a.npy", PICTURES)
    np.savez_compressed(tmp_path / "a.npz", frames=PICTURES, times=np.arange(12))
    np.save(tmp_path / "wide.npy", PICTURES.astype(np.uint16) * 257)
    np.save(tmp_path / "grey.npy", np.repeat(PICTURES[..., None], 3, axis=3))
    (tmp_path / "clip.mp4").write_bytes(b"video")
    digests = set()
    for name in ("images", "a.npy", "a.npz", "wide.npy"):
        plan = prepare_pictures(open_pictures(tmp_path / name), IDEAL, rate_hz=1_000)
        digests.add(encode_pictures(plan, tmp_path / "out.h5", seed=1))
    assert len(digests) == 1
    # Three equal colours are summed with weights, which rounds.
    light = np.stack(list(open_pictures(tmp_path / "a.npy")))
    for name in ("clip.mp4", "grey.npy"):
        assert np.stack(list(open_pictures(tmp_path / name))) == pytest.approx(light, rel=1e-5)
    assert prepare_pictures(open_pictures(tmp_path / "clip.mp4"), IDEAL).rate_hz == 1_000
    assert video.input_params == ["-protocol_whitelist", "file,pipe"]


def test_neither_blocks_nor_the_pictures_in_memory_change_a_spike(tmp_path, monkeypatch):
    np.save(tmp_path / "a.npy", PICTURES)
    for rate in (1_000, 20_000, 90_000):  # slower than the camera, as fast, and faster
        plan = prepare_pictures(open_pictures(tmp_path / "a.npy"), IDEAL, rate_hz=rate)
        assert plan.frames == int(11 / rate * 20_000)
        digest = encode_pictures(plan, tmp_path / "out.h5", seed=1)
        with monkeypatch.context() as patch:
            patch.setattr(module, "BLOCK_FRAMES", 16)
            patch.setattr(module, "BLOCK_KNOTS", 2)
            assert encode_pictures(plan, tmp_path / "out.h5", seed=1) == digest
            held = [len(knots) for knots, _, _ in module._blocks(plan)]
        assert max(held) <= max(3, 8 * rate / 20_000 + 3)


def test_the_command_says_how_pictures_were_taken_and_keeps_the_lens(tmp_path, call):
    write_images(tmp_path / "images", PICTURES)
    (tmp_path / "lens.csv").write_text("frame,position\n0,0\n1099,1\n")
    options = ("--rate", 200, "--focus", tmp_path / "lens.csv", "--truth", 0.5, "--seed", 5)
    code, out, err = call("encode", tmp_path / "images", "--out", tmp_path / "a.h5", *options)
    assert code == 0
    assert "1100 frames of 10×8" in out
    assert "12 pictures at 200 Hz, sRGB decoded" in out
    assert "100 readouts per picture" in err
    assert "not physics" in err
    with open_stream(tmp_path / "a.h5") as stream:
        assert stream.truth.frame == pytest.approx(549.5)
        assert '"between": "linear cross-fade"' in stream.metadata.provenance["encode"]
    code, out, err = call("encode", tmp_path / "images", "--out", tmp_path / "b.h5", "--rate", 5_000, "--linear")
    assert (code, err) == (0, "")
    assert "at 5000 Hz, linear light" in out


def write_two_sizes(folder):
    write_images(folder, PICTURES[:2])
    Image.fromarray(PICTURES[0, :4]).save(folder / "frame_9.png")


@pytest.mark.parametrize(
    ("write", "options", "message"),
    [
        (lambda p: None, {}, "no such file or folder"),
        (lambda p: p.mkdir(), {}, "has no picture"),
        (write_two_sizes, {}, "frame_9.png has (4, 10) pixels | (8, 10), like the first"),
        (lambda p: write_images(p, PICTURES), {"rate_hz": None}, "does not state how many pictures | --rate HZ"),
        (lambda p: write_images(p, PICTURES), {"rate_hz": 0.0}, "0 pictures per second"),
        (lambda p: write_images(p, PICTURES[:1]), {"rate_hz": -1.0, "frames": 9}, "-1 pictures per second"),
        (lambda p: write_images(p, PICTURES), {"frames": 221}, "221 readouts were requested of 12 pictures | 1 to 220"),
        (lambda p: write_images(p, PICTURES[:1]), {}, "is a single picture | --frames"),
        (lambda p: write_images(p, PICTURES[:2] * 0), {}, "all pictures are black"),
        (lambda p: write_images(p, PICTURES), {"mean_rate": 1.5}, "mean_rate is 1.5"),
    ],
)
def test_pictures_that_do_not_fit_are_one_line(tmp_path, write, options, message):
    write(tmp_path / "in")
    options = {"rate_hz": 1_000.0, **options}
    error = refusal(lambda: prepare_pictures(open_pictures(tmp_path / "in"), IDEAL, **options))
    assert_says(error, message)


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (np.full((2, 3, 4), 1.5), "values 1.5 to 1.5 | --linear"),
        (np.full((2, 3, 4), -1.0), "values -1 to -1"),
        (np.full((2, 3, 4), np.nan), "frame 0 has values nan"),
        (np.ones((2, 3, 4), bool), "frame 0 is bool | saf-gen import"),
        (np.ones((2, 3, 4, 7)), "frame 0 has shape (3, 4, 7)"),
        (np.ones((3, 4)), "the array has shape (3, 4)"),
    ],
)
def test_values_that_are_no_pictures_are_one_line(tmp_path, array, message):
    np.save(tmp_path / "in.npy", array)
    assert_says(refusal(lambda: list(open_pictures(tmp_path / "in.npy"))), message)


def test_a_picture_or_video_that_cannot_be_read_is_one_line(tmp_path, video, call):
    (tmp_path / "images").mkdir()
    (tmp_path / "images" / "a.png").write_bytes(b"no picture")
    assert_says(refusal(open_pictures, tmp_path / "images"), "a.png: cannot be read")

    def fail(path, input_params):
        yield {"fps": 25.0, "size": (10, 8)}
        raise RuntimeError("ffmpeg said\nmuch")

    video.read_frames = fail
    (tmp_path / "clip.mp4").write_bytes(b"video")
    code, _, err = call("encode", tmp_path / "clip.mp4", "--out", tmp_path / "a.h5")
    assert (code, "clip.mp4: cannot be decoded" in err) == (2, True)
    assert not (tmp_path / "a.h5").exists()


def test_a_video_without_its_package_says_what_to_install(tmp_path):
    if "imageio_ffmpeg" in sys.modules:
        pytest.skip("imageio-ffmpeg is installed")
    (tmp_path / "clip.mp4").write_bytes(b"video")
    assert refusal(open_pictures, tmp_path / "clip.mp4").hint == "pip install 'saf-gen[video]'"
