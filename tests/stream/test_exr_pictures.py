"""OpenEXR files of others as pictures, written with the OpenEXR library: linear light, every bit, or one line."""

import struct
from fractions import Fraction

import Imath
import numpy as np
import OpenEXR
import pytest
from PIL import Image
from refusals import assert_says, refusal

from saf_gen.camera import get_sensor
from saf_gen.core.exr import read_foreign_channels, read_foreign_headers
from saf_gen.errors import BadInput
from saf_gen.stream.interop.encode_pictures import encode_pictures, prepare_pictures
from saf_gen.stream.interop.picture_frames import open_pictures
from saf_gen.stream.stream_file import open_stream

LIGHT = (np.random.default_rng(1).random((12, 16)) * 8).astype(np.float16).astype(np.float32)
"""Light up to 8, which half floats hold exactly."""
BT709 = np.array([0.2126, 0.7152, 0.0722], np.float32)
ACES_AP1 = (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767)
WIDE = (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290)
LOSSLESS = ["NO", "RLE", "ZIPS", "ZIP", "PIZ"]
LOSSY = {"PXR24": 2e-5, "B44": 0.3, "B44A": 0.3, "DWAA": 0.05, "DWAB": 0.05}


def window(left, top, right, bottom):
    return np.array([left, top], np.int32), np.array([right, bottom], np.int32)


def write(path, channels, *, compression="ZIP", tiled=False, **header):
    """Write one part; channels that are arrays of 2 axes, by name."""
    header |= {
        "compression": getattr(OpenEXR, f"{compression}_COMPRESSION"),
        "type": OpenEXR.tiledimage if tiled else OpenEXR.scanlineimage,
    }
    if tiled:
        header["tiles"] = OpenEXR.TileDescription()
    OpenEXR.File(header, {name: np.ascontiguousarray(one) for name, one in channels.items()}).write(str(path))


def colours(scale=(1.0, 0.5, 0.25), dtype=np.float32, prefix=""):
    return {prefix + name: (LIGHT * share).astype(dtype) for name, share in zip("RGB", scale, strict=True)}


def light_of(path, **options):
    (light,) = open_pictures(path, **options)
    return light


@pytest.mark.parametrize("tiled", [False, True], ids=["lines", "tiles"])
@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.uint32])
@pytest.mark.parametrize("compression", LOSSLESS)
def test_what_was_written_is_read_with_every_bit(tmp_path, compression, dtype, tiled):
    values = np.arange(LIGHT.size).reshape(LIGHT.shape) if dtype is np.uint32 else LIGHT
    write(tmp_path / "a.exr", {"Y": values.astype(dtype)}, compression=compression, tiled=tiled)
    assert np.array_equal(light_of(tmp_path / "a.exr"), values.astype(np.float32))


@pytest.mark.parametrize("compression", LOSSY)
def test_lossy_compression_is_read_within_what_it_keeps(tmp_path, compression):
    smooth = np.add.outer(np.arange(12), np.arange(16)).astype(np.float32) / 4
    write(tmp_path / "a.exr", {"Y": smooth.astype(np.float16)}, compression=compression)
    assert light_of(tmp_path / "a.exr") == pytest.approx(smooth, abs=LOSSY[compression])


def test_light_above_one_is_kept_and_needs_no_option(tmp_path, call):
    """A step of 50 times the light, from which the ideal sensor has rates in that proportion."""
    (tmp_path / "in").mkdir()
    light = np.full((8, 10), 0.1, np.float32)
    light[:, 5:] = 5.0
    for number in range(3):
        write(tmp_path / "in" / f"f_{number}.exr", {"Y": light})
    options = ("--rate", 1000, "--sensor", "ideal", "--mean-rate", 0.4)
    code, out, _ = call("encode", tmp_path / "in", "--out", tmp_path / "a.h5", *options)
    assert code == 0
    assert "linear light" in out
    assert "in this order: f_0.exr, f_1.exr, f_2.exr" in out
    for linear in (False, True):
        assert np.array_equal(next(iter(open_pictures(tmp_path / "in", linear=linear))), light)
    plan = prepare_pictures(open_pictures(tmp_path / "in"), get_sensor("ideal"), rate_hz=10, mean_rate=0.4)
    encode_pictures(plan, tmp_path / "b.h5")
    with open_stream(tmp_path / "b.h5") as stream:
        rates = stream.counts(0, plan.frames) / plan.frames
    assert rates[:, 5:].mean() / rates[:, :5].mean() == pytest.approx(50, rel=0.02)


def test_files_follow_the_numbers_in_their_names(tmp_path):
    for level, name in sorted((level, name) for level, name in enumerate(["z_-3", "z_0.15", "z_0.3", "z_10"], 1)):
        write(tmp_path / f"{name}.exr", {"Y": np.full((4, 4), level, np.float32)})
    assert [float(light[0, 0]) for light in open_pictures(tmp_path)] == [1, 2, 3, 4]


RATES = {"equal": (["24000/1001"] * 2, Fraction(24000, 1001)), "different": (["24", "25"], None)}


@pytest.mark.parametrize("name", RATES)
def test_a_sequence_has_the_rate_that_all_its_files_state(tmp_path, name):
    rates, expected = RATES[name]
    for number, rate in enumerate(rates):
        write(tmp_path / f"{number}.exr", {"Y": LIGHT}, framesPerSecond=Fraction(rate))
    assert open_pictures(tmp_path).rate_hz == expected


CHANNELS = {
    "colour": (colours(), 0.2126 + 0.5 * 0.7152 + 0.25 * 0.0722),
    "colour and alpha": (colours() | {"A": np.zeros_like(LIGHT)}, 0.2126 + 0.5 * 0.7152 + 0.25 * 0.0722),
    "halves": (colours((1, 1, 1), np.float16), 1.0),
    "luminance": ({"Y": LIGHT}, 1.0),
    "luminance and alpha": ({"Y": LIGHT, "A": np.zeros_like(LIGHT)}, 1.0),
    "colour and depth": (colours((2, 2, 2)) | {"Z": LIGHT * 7}, 2.0),
    "colour and layers": (colours((2, 2, 2)) | colours(prefix="diffuse."), 2.0),
    "one layer": (colours((2, 2, 2), prefix="View.Combined."), 2.0),
    "one layer and normals": (colours((2, 2, 2), prefix="a.") | {f"N.{axis}": LIGHT for axis in "XYZ"}, 2.0),
}


@pytest.mark.parametrize("name", CHANNELS)
def test_channels_become_luminance(tmp_path, name):
    channels, share = CHANNELS[name]
    write(tmp_path / "a.exr", channels)
    assert light_of(tmp_path / "a.exr") == pytest.approx(LIGHT * share, rel=1e-5)


def test_luminance_with_coarser_colour_is_its_luminance(tmp_path):
    """RY and BY of every other pixel, as OpenEXR's own luminance-chroma files have them."""
    half = Imath.PixelType(Imath.PixelType.HALF)
    header = OpenEXR.Header(16, 12)
    header["channels"] = {name: Imath.Channel(half, step, step) for name, step in (("Y", 1), ("RY", 2), ("BY", 2))}
    file = OpenEXR.OutputFile(str(tmp_path / "a.exr"), header)
    coarse = np.ones((6, 8), np.float16).tobytes()
    file.writePixels({"Y": LIGHT.astype(np.float16).tobytes(), "RY": coarse, "BY": coarse})
    file.close()
    assert np.array_equal(light_of(tmp_path / "a.exr"), LIGHT)


@pytest.mark.parametrize(
    ("chromaticities", "weights"),
    [
        ((0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290), BT709),
        (WIDE, [0.2627, 0.6780, 0.0593]),  # ITU-R BT.2020, table 4
        (ACES_AP1, [0.27223, 0.67408, 0.05369]),  # SMPTE ST 2065-1 and S-2014-004
        ((0.68, 0.32, 0.265, 0.69, 0.15, 0.06, 0.3127, 0.3290), [0.2290, 0.6917, 0.0793]),  # SMPTE EG 432-1, D65
    ],
)
def test_colours_are_weighed_by_the_primaries_that_a_file_states(tmp_path, chromaticities, weights):
    for number, name in enumerate("RGB"):
        only = {other: LIGHT * (other == name) for other in "RGB"}
        write(tmp_path / "a.exr", only, chromaticities=chromaticities)
        assert light_of(tmp_path / "a.exr") == pytest.approx(LIGHT * weights[number], rel=2e-3)


WINDOWS = {
    "inside": (window(10, 5, 25, 16), window(0, 0, 29, 19)),
    "beyond": (window(-4, -3, 11, 8), window(0, 0, 7, 5)),
    "aside": (window(-4, 2, 11, 13), window(0, 0, 19, 9)),
    "elsewhere": (window(100, 100, 115, 111), window(0, 0, 9, 9)),
    "both moved": (window(100, 200, 115, 211), window(100, 200, 115, 211)),
    "one row": (window(0, 0, 15, 11), window(3, 4, 8, 4)),
}


@pytest.mark.parametrize("name", WINDOWS)
def test_pixels_lie_where_the_window_says(tmp_path, name):
    data, shown = WINDOWS[name]
    write(tmp_path / "a.exr", {"Y": LIGHT + 1}, dataWindow=data, displayWindow=shown)
    pictures = open_pictures(tmp_path / "a.exr")
    (left, top), (right, bottom) = shown
    expected = np.zeros((bottom - top + 1, right - left + 1), np.float32)
    for row, column in np.ndindex(*expected.shape):
        y, x = row + top - data[0][1], column + left - data[0][0]
        if 0 <= y < 12 and 0 <= x < 16:
            expected[row, column] = LIGHT[y, x] + 1
    assert np.array_equal(next(iter(pictures)), expected)
    assert ("black where" in "".join(pictures.notes)) == (name != "both moved")


def test_what_is_left_out_is_one_line(tmp_path, call):
    write(tmp_path / "a.exr", colours() | colours(prefix="diffuse.") | {"Z": LIGHT, "N.X": LIGHT, "N.Y": LIGHT})
    assert open_pictures(tmp_path / "a.exr").notes == ("layers left out: N, Z, diffuse",)
    _, out, err = call("encode", tmp_path / "a.exr", "--frames", 8, "--out", tmp_path / "a.h5")
    assert "layers left out: N, Z, diffuse" in out + err


def write_parts(path, **parts):
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File([OpenEXR.Part(dict(header), channels, name) for name, channels in parts.items()]).write(str(path))


LAYERS = {
    "layers": (lambda p: write(p, colours((1, 1, 1), prefix="a.") | colours((2, 2, 2), prefix="b.")), "b", "a, b"),
    "deep names": (lambda p: write(p, colours(prefix="V.a.") | colours((2, 2, 2), prefix="V.b.")), "V.b", "V.a, V.b"),
    "parts": (lambda p: write_parts(p, left=colours((1, 1, 1)), right=colours((2, 2, 2))), "right", "left, right"),
    "layers of parts": (
        lambda p: write_parts(p, one=colours(prefix="a."), two=colours((2, 2, 2), prefix="b.")), "b", "one.a, two.b",
    ),
    "a channel": (lambda p: write(p, {"power": LIGHT * 2, "A": LIGHT}), "power", "A, power"),
    "depth": (lambda p: write(p, {"Z": LIGHT * 2}), "Z", "Z"),
    "positions": (lambda p: write(p, {"P.X": LIGHT, "P.Y": LIGHT * 2, "P.Z": LIGHT}), "P.Y", "P.X, P.Y, P.Z"),
    "red and green": (lambda p: write(p, {"R": LIGHT * 2, "G": LIGHT}), "R", "G, R"),
}  # fmt: skip


@pytest.mark.parametrize("name", LAYERS)
def test_a_layer_is_asked_for_where_nothing_says_which_is_the_picture(tmp_path, name):
    write_file, key, offered = LAYERS[name]
    write_file(tmp_path / "a.exr")
    assert_says(refusal(open_pictures, tmp_path / "a.exr"), f"a.exr | one of {offered} | --key NAME")
    assert light_of(tmp_path / "a.exr", key=key) == pytest.approx(LIGHT * 2, rel=1e-5)
    assert_says(refusal(open_pictures, tmp_path / "a.exr", key="nothing"), f"nothing | one of {offered}")


def test_a_part_of_colour_beside_one_of_depth_needs_no_choice(tmp_path):
    write_parts(tmp_path / "a.exr", rgba=colours((2, 2, 2)), depth={"Z": LIGHT})
    assert light_of(tmp_path / "a.exr") == pytest.approx(LIGHT * 2, rel=1e-5)


def write_deep(path):
    samples = np.empty(LIGHT.shape, object)
    for at in np.ndindex(*LIGHT.shape):
        samples[at] = np.ones(2, np.float32)
    header = {"compression": OpenEXR.ZIPS_COMPRESSION, "type": OpenEXR.deepscanline}
    OpenEXR.File(header, {"Y": samples}).write(str(path))


def with_value(value, name="R"):
    channels = colours()
    channels[name][3, 4] = value
    return channels


REFUSED = {
    "no number": (lambda p: write(p, with_value(np.nan)), "b.exr has 1 values | nan | 0 and above"),
    "infinite": (lambda p: write(p, with_value(np.inf, "B")), "b.exr has 1 values | inf"),
    "minus infinite": (lambda p: write(p, {"Y": with_value(-np.inf)["R"]}), "b.exr has 1 values | -inf"),
    "negative light": (lambda p: write(p, {"Y": LIGHT * -1}), "b.exr has values - | 0 and above"),
    "another size": (lambda p: write(p, {"Y": LIGHT[:8]}), "b.exr has (8, 16) pixels | like the first"),
    "no colour": (lambda p: write(p, {"Z": LIGHT}), "b.exr: has no layers | one of Z"),
    "deep": (write_deep, "b.exr: has deep pixels"),
    "degenerate primaries": (
        lambda p: write(p, colours(), chromaticities=(0.3,) * 8), "b.exr | chromaticities 0.3, 0.3",
    ),
    "empty": (lambda p: p.write_bytes(b""), "b.exr | cannot be read"),
    "another format": (lambda p: Image.new("L", (16, 12)).save(p, "PNG"), "b.exr | cannot be read"),
    "a folder": (lambda p: p.mkdir(), "b.exr"),
    "a png beside": (lambda p: Image.new("L", (16, 12)).save(p.with_suffix(".png")), "both .exr and .png"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_picture_is_one_line(tmp_path, name):
    (tmp_path / "in").mkdir()
    write(tmp_path / "in" / "a.exr", {"Y": LIGHT})
    write_file, message = REFUSED[name]
    write_file(tmp_path / "in" / "b.exr")
    assert_says(refusal(lambda: list(open_pictures(tmp_path / "in"))), message)


def test_colours_outside_the_primaries_are_light_as_long_as_their_luminance_is(tmp_path):
    """A saturated green of wider primaries has negative red; its luminance is what a sensor without colour sees."""
    write(tmp_path / "a.exr", {"R": LIGHT * -0.2, "G": LIGHT, "B": LIGHT * 0})
    assert light_of(tmp_path / "a.exr") == pytest.approx(LIGHT * (0.7152 - 0.2 * 0.2126), rel=1e-5)


@pytest.mark.parametrize("compression", ["NO", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "B44", "DWAA"])
@pytest.mark.parametrize("tiled", [False, True], ids=["lines", "tiles"])
def test_a_file_that_ends_early_is_refused(tmp_path, compression, tiled, capfd):
    write(tmp_path / "a.exr", colours(), compression=compression, tiled=tiled)
    content = (tmp_path / "a.exr").read_bytes()
    for length in (0, 1, 8, 200, len(content) // 2, len(content) - 9, len(content) - 1):
        (tmp_path / "b.exr").write_bytes(content[:length])
        assert_says(refusal(light_of, tmp_path / "b.exr"), "b.exr | cannot be read | a complete OpenEXR file")
    assert capfd.readouterr() == ("", "")  # OpenEXR itself would print


@pytest.mark.parametrize("lines", [0, 1, 11])
def test_a_file_whose_writer_was_stopped_is_refused(tmp_path, lines):
    """Its table of chunks, which is written last, is empty; with all lines behind it, OpenEXR makes the table again."""
    write(tmp_path / "a.exr", {"Y": LIGHT}, compression="ZIPS")
    content = (tmp_path / "a.exr").read_bytes()
    table = next(at for at in range(len(content)) if struct.unpack_from("<Q", content, at) == (at + 8 * 12,))
    begins = struct.unpack_from("<12Q", content, table)
    empty = content[:table] + bytes(8 * 12) + content[table + 8 * 12 :]
    (tmp_path / "b.exr").write_bytes(empty)
    assert np.array_equal(light_of(tmp_path / "b.exr"), LIGHT)
    for stopped in (empty, content[: table + 8 * lines] + empty[table + 8 * lines :]):
        (tmp_path / "b.exr").write_bytes(stopped[: begins[lines]])
        assert_says(refusal(light_of, tmp_path / "b.exr"), "cannot be read")


def test_damage_is_refused_or_leaves_the_size(tmp_path):
    """600 files with changed bytes: none ends the process, takes long, or gives pixels of another number.

    OpenEXR has no checksums, so that a changed pixel cannot be seen.
    """
    rng, path, read = np.random.default_rng(7), tmp_path / "b.exr", 0
    kinds = [(c, tiled) for c in ("NO", "RLE", "ZIP", "PIZ", "PXR24", "B44", "DWAA") for tiled in (False, True)]
    for number in range(600):
        compression, tiled = kinds[number % len(kinds)]
        whole = tmp_path / f"{compression}{tiled}.exr"
        if number < len(kinds):
            write(whole, colours(), compression=compression, tiled=tiled)
        content = bytearray(whole.read_bytes())
        for _ in range(rng.integers(1, 4)):
            content[rng.integers(len(content) if rng.random() < 0.5 else 400)] = rng.integers(256)
        path.write_bytes(content)
        try:
            (part, *_) = read_foreign_headers(path, max_pixels=1 << 16)
            found = read_foreign_channels(path, list(part.channels), part=part)
        except BadInput:
            continue
        left, top, right, bottom = part.data_window
        assert all(one.shape == (bottom - top + 1, right - left + 1) for one in found.values())
        read += 1
    assert 0 < read < 600
