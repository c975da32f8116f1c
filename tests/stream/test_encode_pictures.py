"""Pictures of other cameras become spikes: linear light, independent of the file format, and read in parts."""

import sys
from dataclasses import replace
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
import tifffile
from PIL import Image
from refusals import assert_says, refusal
from videos import write_video

from saf_gen.camera import get_sensor
from saf_gen.errors import BadInput
from saf_gen.stream.interop import encode_pictures as module
from saf_gen.stream.interop.encode_pictures import encode_pictures, prepare_pictures
from saf_gen.stream.interop.linear_light import decode_srgb
from saf_gen.stream.interop.picture_frames import open_pictures
from saf_gen.stream.stream_file import open_stream

IDEAL = get_sensor("ideal")
PICTURES = np.random.default_rng(4).integers(20, 236, (12, 8, 10), np.uint8)


def encode_array(tmp_path, array, *, linear=True, **options):
    """Encode an array with the ideal sensor; return the rates in each tenth of the recording, and the plan."""
    np.save(tmp_path / "in.npy", array)
    stated = {"linear": True} if linear else {"transfer": "srgb"}
    plan = prepare_pictures(open_pictures(tmp_path / "in.npy", **stated), IDEAL, **options)
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


@pytest.mark.parametrize("name", ["a.npy", "images"])
def test_pictures_that_do_not_say_how_they_stand_for_light_are_asked_about(tmp_path, call, name):
    np.save(tmp_path / "a.npy", PICTURES)
    write_images(tmp_path / "images", PICTURES)
    ask = ("encode", tmp_path / name, "--out", tmp_path / "a.h5", "--rate", 1000)
    code, _, err = call(*ask)
    assert (code, err.count("\n"), (tmp_path / "a.h5").exists()) == (2, 1, False)
    assert "does not say how its values stand for light" in err
    assert "--transfer srgb, --transfer bt709, or --linear" in err
    for transfer, words in (("srgb", "sRGB decoded"), ("bt709", "BT.709 decoded")):
        code, out, _ = call(*ask, "--transfer", transfer)
        assert (code, words in out) == (0, True)


def test_the_same_pictures_in_any_file_become_the_same_spikes(tmp_path):
    """Twelve images of 8 bits in natural order, with frame_10 after frame_9."""
    write_images(tmp_path / "images", PICTURES)
    np.save(tmp_path / "a.npy", PICTURES)
    np.savez_compressed(tmp_path / "a.npz", frames=PICTURES, times=np.arange(12))
    np.save(tmp_path / "wide.npy", PICTURES.astype(np.uint16) * 257)
    np.save(tmp_path / "grey.npy", np.repeat(PICTURES[..., None], 3, axis=3))
    write_video(
        tmp_path / "clip.mkv",
        [np.repeat(picture[:, :, None], 3, axis=2) for picture in PICTURES],
        rate=1_000,
        pix_fmt="bgr0",
    )
    digests = set()
    for name in ("images", "a.npy", "a.npz", "wide.npy"):
        plan = prepare_pictures(open_pictures(tmp_path / name, transfer="srgb"), IDEAL, rate_hz=1_000)
        digests.add(encode_pictures(plan, tmp_path / "out.h5", seed=1))
    assert len(digests) == 1
    # Three equal colours are summed with weights, which rounds.
    light = np.stack(list(open_pictures(tmp_path / "a.npy")))
    for name in ("clip.mkv", "grey.npy"):
        assert np.stack(list(open_pictures(tmp_path / name))) == pytest.approx(light, rel=1e-5)
    assert prepare_pictures(open_pictures(tmp_path / "clip.mkv", transfer="srgb"), IDEAL).rate_hz == 1_000


def test_neither_blocks_nor_the_pictures_in_memory_change_a_spike(tmp_path, monkeypatch):
    np.save(tmp_path / "a.npy", PICTURES)
    for rate in (1_000, 20_000, 90_000):  # slower than the camera, as fast, and faster
        plan = prepare_pictures(open_pictures(tmp_path / "a.npy", transfer="srgb"), IDEAL, rate_hz=rate)
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
    options = ("--rate", 200, "--transfer", "srgb", "--focus", tmp_path / "lens.csv", "--truth", 0.5, "--seed", 5)
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
    error = refusal(lambda: prepare_pictures(open_pictures(tmp_path / "in", transfer="srgb"), IDEAL, **options))
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
        (np.ones((32, 48, 3)), "the array has shape (32, 48, 3) | one colour picture"),
        (np.ones((32, 48, 4), np.uint8), "the array has shape (32, 48, 4) | one colour picture"),
    ],
)
def test_values_that_are_no_pictures_are_one_line(tmp_path, array, message):
    np.save(tmp_path / "in.npy", array)
    assert_says(refusal(lambda: list(open_pictures(tmp_path / "in.npy"))), message)


def test_a_picture_or_video_that_cannot_be_read_is_one_line(tmp_path, call):
    (tmp_path / "images").mkdir()
    (tmp_path / "images" / "a.png").write_bytes(b"no picture")
    assert_says(refusal(open_pictures, tmp_path / "images"), "a.png: cannot be read")
    (tmp_path / "clip.mp4").write_bytes(b"video")
    code, _, err = call("encode", tmp_path / "clip.mp4", "--out", tmp_path / "a.h5")
    assert (code, "clip.mp4: cannot be decoded" in err) == (2, True)
    assert not (tmp_path / "a.h5").exists()


def test_a_video_without_its_package_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "av", None)
    (tmp_path / "clip.mp4").write_bytes(b"video")
    assert refusal(open_pictures, tmp_path / "clip.mp4").hint == "pip install 'saf-gen[video]'"
    monkeypatch.undo()
    monkeypatch.setattr("av.__version__", "17.0.0")
    assert_says(refusal(open_pictures, tmp_path / "clip.mp4"), "17.0.0 | 18 or newer | --upgrade")


# Pictures of others: their order, pages and time.

NAMES = {
    "numbers": ["frame_9", "frame_10", "frame_11"],
    "signs": ["z_-3", "z_-2", "z_-1", "z_0", "z_1", "z_3"],
    "signs at the beginning": ["-3", "-2", "0", "+1", "2"],
    "decimals": ["z_0.1", "z_0.15", "z_0.3", "z_1.0"],
    "signed decimals": ["um=-1.5", "um=-0.5", "um=0.25", "um=10.0"],
    "hyphens between": ["scene-1", "scene-2", "scene-10"],
    "hyphens after a digit": ["2024-01-02", "2024-01-10", "2024-11-02"],
    "versions": ["v1.2.9", "v1.2.10", "v1.10.1"],
    "two numbers": ["a1_b2", "a1_b10", "a2_b1"],
    "zeros": ["img001", "img002", "img010"],
}


@pytest.mark.parametrize("names", NAMES.values(), ids=NAMES)
def test_pictures_of_a_folder_follow_the_numbers_in_their_names(tmp_path, call, names):
    for level, name in sorted((level, name) for level, name in enumerate(names)):
        Image.fromarray(np.full((8, 8), 10 + level, np.uint8)).save(tmp_path / f"{name}.png")
    levels = [round(float(light[0, 0]) * 255) for light in open_pictures(tmp_path, linear=True)]
    assert levels == list(range(10, 10 + len(names)))
    _, out, _ = call("encode", tmp_path, "--rate", 2000, "--linear", "--out", tmp_path / "a.h5")
    assert f"in this order: {names[0]}.png, {names[1]}.png" in out


def save_pages(path, levels, **options):
    pages = [Image.fromarray(np.full((8, 10), level, np.uint8)) for level in levels]
    pages[0].save(path, save_all=True, append_images=pages[1:], **options)


def test_every_page_of_a_tiff_is_a_picture(tmp_path):
    save_pages(tmp_path / "a.tif", [50, 100, 150, 200])
    pictures = open_pictures(tmp_path / "a.tif", linear=True)
    assert [round(float(light.mean()) * 255) for light in pictures] == [50, 100, 150, 200]
    assert pictures.rate_hz is None


def test_a_photograph_that_lies_on_its_side_is_turned_upright(tmp_path):
    values = np.arange(80, dtype=np.uint8).reshape(8, 10)
    exif = Image.Exif()
    exif[0x0112] = 6  # turn by 90 degrees clockwise to see it
    Image.fromarray(values).save(tmp_path / "a.png", exif=exif)
    (light,) = open_pictures(tmp_path / "a.png", linear=True)
    assert np.array_equal(np.rint(light * 255), np.rot90(values, -1))


@pytest.mark.parametrize("compression", ["none", "zlib"])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_pages_that_lie_on_their_side_are_turned_upright(tmp_path, orientation, compression):
    """Orientations of Exif, of which 5 to 8 swap rows and columns."""
    pages = np.arange(2 * 8 * 10, dtype=np.uint8).reshape(2, 8, 10)
    turn = {
        1: lambda a: a, 2: np.fliplr, 3: lambda a: np.rot90(a, 2), 4: np.flipud, 5: np.transpose,
        6: lambda a: np.rot90(a, -1), 7: lambda a: np.rot90(a, 2).T, 8: np.rot90,
    }[orientation]  # fmt: skip
    tags = [(0x0112, "H", 1, orientation, False)]
    tifffile.imwrite(tmp_path / "a.tif", pages, photometric="minisblack", metadata=None, extratags=tags,
                     compression=compression)  # fmt: skip
    light = np.stack(list(open_pictures(tmp_path / "a.tif", linear=True)))
    assert np.array_equal(np.rint(light * 255), np.stack([turn(page) for page in pages]))


TIFFS = {
    "plain": {}, "big-endian": {"byteorder": ">"}, "BigTIFF": {"bigtiff": True}, "deflate": {"compression": "zlib"},
    "a page a write": {"contiguous": False},
    "tiles": {"tile": (16, 16)}, "ImageJ": {"imagej": True, "metadata": {"axes": "TYX"}},
    "OME": {"ome": True, "metadata": {"axes": "TYX"}},
}  # fmt: skip


@pytest.mark.parametrize("name", TIFFS)
def test_a_tiff_that_ends_early_never_has_fewer_pages(tmp_path, name):
    """Cut anywhere, it is refused, or all its pages are read as before."""
    pages = np.arange(5 * 8 * 10, dtype=np.uint8).reshape(5, 8, 10) + 20
    options = {"photometric": "minisblack", "metadata": None, **TIFFS[name]}
    tifffile.imwrite(tmp_path / "a.tif", pages, **options)
    whole = np.stack(list(open_pictures(tmp_path / "a.tif", linear=True)))
    assert np.array_equal(np.rint(whole * 255), pages)
    content, refused = (tmp_path / "a.tif").read_bytes(), 0
    for length in range(1, len(content), 7):
        (tmp_path / "b.tif").write_bytes(content[:length])
        try:
            found = np.stack(list(open_pictures(tmp_path / "b.tif", linear=True)))
        except BadInput:
            refused += 1
        else:
            assert np.array_equal(found, whole)
    assert refused > 0.8 * len(content) / 7


def lights_of(plan):
    """The mean light of each readout, (frames, H, W)."""
    lights = []
    for knots, index, fraction in module._blocks(plan):
        after = np.minimum(index + 1, len(knots) - 1)
        lights += [(1 - f) * knots[i] + f * knots[j] for i, j, f in zip(index, after, fraction, strict=True)]
    return np.array(lights)


RATES = [15_000.0, 23_976.0, 30_000.0, 40_000.0, 60_000.0, 70_001.0, 200_000.0, 9_999.5]


@pytest.mark.parametrize("rate", RATES)
def test_pictures_faster_than_readouts_are_integrated(tmp_path, rate):
    """Every other picture is black: whatever the readouts meet, half of the light arrives, to one spike in 100."""
    light = np.zeros((int(rate / 40), 4, 6), np.float32)
    light[::2] = 2.0
    rates, _ = encode_array(tmp_path, light, rate_hz=rate, mean_rate=0.2)
    assert rates.mean() == pytest.approx(0.2, rel=0.01)


@pytest.mark.parametrize("rate", [13_000.0, 40_000.0, 200_000.0])
def test_a_flash_of_one_picture_keeps_its_light(tmp_path, rate):
    """One picture of 200 times the light is a triangle of its area; it adds 200 / pictures per readout spikes."""
    pictures = int(rate / 40)
    light = np.full((pictures, 4, 6), 0.1, np.float32)
    light[pictures // 2] = 20.0
    np.save(tmp_path / "in.npy", light)
    plan = prepare_pictures(open_pictures(tmp_path / "in.npy", linear=True), IDEAL, rate_hz=rate, mean_rate=0.1)
    area = sum(float(light.mean()) for light in lights_of(plan))
    exact = np.trapezoid(light.mean(axis=(1, 2)), dx=plan.readouts_per_picture)
    assert area == pytest.approx(exact, rel=2e-3)  # less than one readout is left out at the end


def test_the_integral_is_that_of_a_fine_sum(tmp_path):
    """A slow twin: the light of each readout as the mean of 2,000 samples of the interpolated pictures."""
    light = np.random.default_rng(2).random((40, 3, 4)).astype(np.float32)
    np.save(tmp_path / "in.npy", light)
    for rate in (7_777.0, 33_333.0, 123_456.0):
        plan = prepare_pictures(open_pictures(tmp_path / "in.npy", linear=True), IDEAL, rate_hz=rate)
        found = lights_of(plan)
        at = (np.arange(plan.frames)[:, None] + (np.arange(2000) + 0.5) / 2000) * rate / 20_000
        for y, x in ((0, 0), (2, 3)):
            expected = np.interp(at, np.arange(40), light[:, y, x]).mean(axis=1)
            assert found[:, y, x] == pytest.approx(expected, abs=2e-5)


@pytest.mark.slow
def test_pictures_at_their_own_times_are_integrated_as_a_fine_sum_would(tmp_path):
    """Slow pictures, one faster than a readout, and crowds, against 4,000 samples of the interpolated pictures."""
    light = np.random.default_rng(3).random((40, 3, 4)).astype(np.float32)
    steps = np.random.default_rng(4).choice([7, 50, 333, 1000, 3333, 12_345], 39)  # in µs; a readout lasts 50
    np.save(tmp_path / "in.npy", light)
    pictures = open_pictures(tmp_path / "in.npy", linear=True)
    pictures.times = tuple(Fraction(int(t), 1_000_000) for t in np.cumsum([0, *steps]))
    for readout in (20_000.0, 400.0):
        sensor = replace(IDEAL, readout_hz=readout)
        plan = prepare_pictures(pictures, sensor)
        assert plan.frames == int(pictures.times[-1] * int(readout))
        found = lights_of(plan)
        at = (np.arange(plan.frames)[:, None] + (np.arange(4000) + 0.5) / 4000) / readout
        for y, x in ((0, 0), (2, 3)):
            expected = np.interp(at, np.array(pictures.times, float), light[:, y, x]).mean(axis=1)
            assert found[:, y, x] == pytest.approx(expected, abs=2e-5)


UNEVEN = {
    "two paces": [1, 3] * 30,
    "once a second": [1000, 1001, 999],
    "bursts": [1, 1, 1, 200] * 10,
    "slower": [*range(1, 40)],
    "faster": [*range(40, 0, -1)],
    "one long": [5, 5, 900, 5],
    "odd": [7, 11, 13] * 12,
    "long ends": [500, *[2] * 50, 500],
}


@pytest.mark.parametrize("steps", UNEVEN.values(), ids=UNEVEN)
def test_no_light_is_lost_between_uneven_times(tmp_path, steps):
    """The spikes are the area of the light, the trapezia between pictures, to less than 1 %."""
    light = np.random.default_rng(5).random((len(steps) + 1, 1, 1)).astype(np.float32) * np.ones((1, 8, 10), np.float32)
    np.save(tmp_path / "in.npy", light)
    pictures = open_pictures(tmp_path / "in.npy", linear=True)
    pictures.times = tuple(Fraction(int(t), 1000) for t in np.cumsum([0, *steps]))
    plan = prepare_pictures(pictures, IDEAL, mean_rate=0.2)
    encode_pictures(plan, tmp_path / "out.h5", seed=3)
    with open_stream(tmp_path / "out.h5") as stream:
        spikes = stream.counts(0, plan.frames).mean()
    area = np.trapezoid(light[:, 0, 0], np.array(pictures.times, float)) * 20_000 * plan.scale / IDEAL.threshold_e
    assert spikes == pytest.approx(area, rel=0.01, abs=1)
    assert spikes / plan.frames == pytest.approx(0.2, rel=0.01, abs=1 / plan.frames)


RATES_AS_WRITTEN = {
    "24000/1001": (Fraction(24000, 1001), "24000/1001 Hz (23.976)"), "1/3": (Fraction(1, 3), "1/3 Hz"),
    "23.976": (Fraction(23976, 1000), "23.976 Hz"), "240": (Fraction(240), "240 Hz"),
    "1e3": (Fraction(1000), "1000 Hz"),
    "0.5": (Fraction(1, 2), "0.5 Hz"), ".25": (Fraction(1, 4), "0.25 Hz"), "60/1": (Fraction(60), "60 Hz"),
    "20000.0": (Fraction(20000), "20000 Hz"), "2e-1": (Fraction(1, 5), "0.2 Hz"),
    "100/3": (Fraction(100, 3), "100/3 Hz (33.333)"),
}  # fmt: skip


@pytest.mark.parametrize("text", RATES_AS_WRITTEN)
def test_a_rate_is_kept_and_printed_as_it_was_written(text):
    rate, words = RATES_AS_WRITTEN[text]
    assert module.rate_from_text(text) == rate
    assert module.describe_pace(None, rate) == f"at {words}"


@pytest.mark.parametrize(
    "text", ["0", "-1", "abc", "1/0", "", "nan", "inf", "1e999", "24000/1001/2", "0/5", "240 Hz", "1,5"]
)
def test_a_rate_that_is_none_is_one_line(text, tmp_path, call):
    np.save(tmp_path / "in.npy", PICTURES)
    code, _, err = call("encode", tmp_path / "in.npy", "--out", tmp_path / "a.h5", f"--rate={text}")
    assert (code, f"--rate is {text}" in err, err.count("\n")) == (2, True, 1)
