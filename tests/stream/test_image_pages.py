"""Image files of others: every bit of deep colour, the times of pages, what PNG says about light, and damage."""

import struct
import sys
import zlib
from fractions import Fraction

import av
import numpy as np
import pytest
from PIL import Image
from refusals import assert_says, refusal
from videos import frame_of

from saf_gen.camera import get_sensor
from saf_gen.stream.interop.encode_pictures import prepare_pictures
from saf_gen.stream.interop.linear_light import LUMINANCE, decode_hlg, decode_pq, decode_srgb
from saf_gen.stream.interop.picture_frames import open_pictures

IDEAL = get_sensor("ideal")


def write_png(path, values, *chunks):
    """A PNG of 8 or 16 bits per channel, which Pillow cannot write in colour, with chunks (name, data)."""
    height, width, channels = values.shape
    kind = {1: 0, 2: 4, 3: 2, 4: 6}[channels]
    rows = b"".join(b"\0" + row.astype(values.dtype.newbyteorder(">")).tobytes() for row in values)

    def chunk(name, data):
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    head = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8 * values.itemsize, kind, 0, 0, 0))
    tags = b"".join(chunk(name, data) for name, data in chunks)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + head + tags + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))


def write_with_ffmpeg(path, values, codec, pix_fmt):
    context = av.CodecContext.create(codec, "w")
    context.height, context.width = values.shape[:2]
    context.pix_fmt, context.time_base = pix_fmt, Fraction(1)
    packets = [*context.encode(frame_of([values.reshape(values.shape[0], -1)], pix_fmt)), *context.encode(None)]
    path.write_bytes(b"".join(bytes(packet) for packet in packets))


def noise(channels, dtype=np.uint16, seed=1):
    return np.random.default_rng(seed).integers(0, np.iinfo(dtype).max, (8, 10, channels), dtype)


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_all_16_bits_of_a_png_are_read(tmp_path, channels):
    values = noise(channels)
    write_png(tmp_path / "a.png", values)
    (light,) = open_pictures(tmp_path / "a.png", linear=True)
    grey = values[:, :, 0] if channels < 3 else values[:, :, :3] @ LUMINANCE.astype(float)
    assert light * 65535 == pytest.approx(grey, abs=0.02)


DEEP = {
    "TIFF": ("a.tif", "tiff", "rgb48le", 3), "TIFF with alpha": ("a.tif", "tiff", "rgba64le", 4),
    "grey TIFF": ("a.tif", "tiff", "gray16le", 1), "PPM": ("a.ppm", "ppm", "rgb48be", 3),
    "PGM": ("a.pgm", "pgm", "gray16be", 1), "PNG": ("a.png", "png", "rgb48be", 3),
    "PNG with alpha": ("a.png", "png", "rgba64be", 4), "grey PNG with alpha": ("a.png", "png", "ya16be", 2),
}  # fmt: skip


@pytest.mark.parametrize(("name", "codec", "pix_fmt", "channels"), DEEP.values(), ids=DEEP)
def test_all_16_bits_of_any_image_are_read(tmp_path, name, codec, pix_fmt, channels):
    values = noise(channels)
    write_with_ffmpeg(tmp_path / name, values.astype(">u2") if pix_fmt.endswith("be") else values, codec, pix_fmt)
    (light,) = open_pictures(tmp_path / name, linear=True)
    grey = values[:, :, 0] if channels < 3 else values[:, :, :3] @ LUMINANCE.astype(float)
    assert light * 65535 == pytest.approx(grey, abs=0.02)


def write_tiff(path, pages, *, bits=16, photometric=None):
    """An uncompressed TIFF of several pages, integers (H, W, c) of 12 or 16 bits."""
    out = bytearray(struct.pack("<2sHI", b"II", 42, 0))
    link = 4
    for page in pages:
        height, width, channels = page.shape
        if bits == 16:
            data = page.astype("<u2").tobytes()
        else:
            digits = (page[:, :, 0, None] >> np.arange(11, -1, -1)) & 1
            data = np.packbits(digits.reshape(height, -1), axis=1).tobytes()
        at = len(out)
        out += data + struct.pack(f"<{channels}H", *[bits] * channels)
        struct.pack_into("<I", out, link, len(out))
        count = (
            struct.pack("<HHIHH", 258, 3, 1, bits, 0)
            if channels == 1
            else (struct.pack("<HHII", 258, 3, channels, at + len(data)))
        )
        entries = [
            struct.pack("<HHIHH", 256, 3, 1, width, 0), struct.pack("<HHIHH", 257, 3, 1, height, 0), count,
            struct.pack("<HHIHH", 259, 3, 1, 1, 0),
            struct.pack("<HHIHH", 262, 3, 1, (2 if channels > 1 else 1) if photometric is None else photometric, 0),
            struct.pack("<HHII", 273, 4, 1, at), struct.pack("<HHIHH", 277, 3, 1, channels, 0),
            struct.pack("<HHIHH", 278, 3, 1, height, 0), struct.pack("<HHII", 279, 4, 1, len(data)),
        ]  # fmt: skip
        out += struct.pack("<H", len(entries)) + b"".join(entries)
        link = len(out)
        out += bytes(4)
    path.write_bytes(out)


def test_every_page_of_a_deep_tiff_is_read(tmp_path):
    pages = [noise(3, seed=seed) for seed in range(4)]
    write_tiff(tmp_path / "a.tif", pages)
    found = list(open_pictures(tmp_path / "a.tif", linear=True))
    assert np.array(found) * 65535 == pytest.approx(np.array(pages) @ LUMINANCE.astype(float), abs=0.02)


def test_12_bits_of_grey_are_scaled_by_their_own_range(tmp_path):
    values = noise(1) >> 4
    write_tiff(tmp_path / "a.tif", [values], bits=12)
    (light,) = open_pictures(tmp_path / "a.tif", linear=True)
    assert light * 4095 == pytest.approx(values[:, :, 0], abs=1e-3)


def test_white_may_be_zero(tmp_path):
    values = noise(1)
    write_tiff(tmp_path / "a.tif", [values], photometric=0)
    (light,) = open_pictures(tmp_path / "a.tif", linear=True)
    assert light * 65535 == pytest.approx(65535 - values[:, :, 0].astype(float), abs=0.01)


def test_deep_colour_for_printing_is_refused(tmp_path):
    write_tiff(tmp_path / "a.tif", [noise(4)], photometric=5)
    assert_says(refusal(open_pictures, tmp_path / "a.tif"), "CMYK | grey or RGB of 16 bits")


def test_a_deep_picture_needs_the_extra_and_says_so(tmp_path, monkeypatch):
    write_png(tmp_path / "a.png", noise(3))
    monkeypatch.setitem(sys.modules, "av", None)
    assert refusal(open_pictures, tmp_path / "a.png").hint == "pip install 'saf-gen[video]'"


def test_a_deep_picture_on_its_side_is_turned_upright(tmp_path):
    values = noise(3)
    exif = b"MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0%c\0\0\0\0\0\0"
    turns = {
        1: values,
        2: values[:, ::-1],
        3: values[::-1, ::-1],
        4: values[::-1],
        6: np.rot90(values, -1),
        8: np.rot90(values),
    }
    turns |= {5: np.swapaxes(values, 0, 1), 7: np.rot90(np.swapaxes(values, 0, 1), 2)}
    for number, upright in turns.items():
        write_png(tmp_path / "a.png", values, (b"eXIf", exif % number))
        (light,) = open_pictures(tmp_path / "a.png", linear=True)
        assert light * 65535 == pytest.approx(upright @ LUMINANCE.astype(float), abs=0.02)


def gamma(value):
    return (b"gAMA", struct.pack(">I", value))


LIGHT = {
    "no tag": ([], decode_srgb), "sRGB gamma": ([gamma(45455)], decode_srgb),
    "linear gamma": ([gamma(100000)], lambda v: v),
    "gamma 1.8": ([gamma(55556)], lambda v: v**1.8), "gamma 3": ([gamma(33333)], lambda v: v**3),
    "sRGB before gamma": ([(b"sRGB", b"\0"), gamma(100000)], decode_srgb),
    "cICP sRGB": ([(b"cICP", bytes([1, 13, 0, 1]))], decode_srgb),
    "cICP linear": ([(b"cICP", bytes([1, 8, 0, 1]))], lambda v: v),
    "cICP PQ": ([(b"cICP", bytes([1, 16, 0, 1]))], decode_pq),
    "cICP HLG": ([(b"cICP", bytes([1, 18, 0, 1]))], decode_hlg),
    "cICP before gamma": ([gamma(45455), (b"cICP", bytes([1, 8, 0, 1]))], lambda v: v),
}  # fmt: skip


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize(("chunks", "decode"), LIGHT.values(), ids=LIGHT)
def test_a_png_is_decoded_as_it_says(tmp_path, chunks, decode, dtype):
    values = noise(3, dtype)
    write_png(tmp_path / "a.png", values, *chunks)
    (light,) = open_pictures(tmp_path / "a.png")
    assert light == pytest.approx(decode(values / np.iinfo(dtype).max) @ LUMINANCE, rel=1e-3, abs=1e-6)
    (light,) = open_pictures(tmp_path / "a.png", linear=True)
    assert light == pytest.approx(values / np.iinfo(dtype).max @ LUMINANCE, abs=1e-6)


def icc(curve):
    """The part of an ICC profile that matters here: a curve of green, in a profile of one tag."""
    return bytes(128) + struct.pack(">I4sII", 1, b"gTRC", 144, len(curve)) + curve


def formula(kind, *numbers):
    return struct.pack(f">4sIHH{len(numbers)}i", b"para", 0, kind, 0, *(round(n * 65536) for n in numbers))


SRGB_TABLE = np.rint(65535 * decode_srgb(np.arange(257) / 256)).astype(int)
PROFILES = {
    "linear": (struct.pack(">4sII", b"curv", 0, 0), lambda v: v),
    "linear as a power": (struct.pack(">4sIIH", b"curv", 0, 1, 256), lambda v: v),
    "linear as a table": (struct.pack(">4sII3H", b"curv", 0, 3, 0, 32768, 65535), lambda v: v),
    "linear as a formula": (formula(0, 1), lambda v: v),
    "power 2.2, close to sRGB": (struct.pack(">4sIIH", b"curv", 0, 1, 563), decode_srgb),
    "power 1.8": (struct.pack(">4sIIH", b"curv", 0, 1, 461), lambda v: v ** (461 / 256)),
    "sRGB as a formula": (formula(3, 2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045), decode_srgb),
    "a table of sRGB": (struct.pack(">4sII257H", b"curv", 0, 257, *SRGB_TABLE), decode_srgb),
    "no curve": (b"mft2", decode_srgb),
}  # fmt: skip


@pytest.mark.parametrize("ending", ["png", "tif", "webp"])
@pytest.mark.parametrize(("curve", "decode"), PROFILES.values(), ids=PROFILES)
def test_an_icc_profile_says_how_light_is_stored(tmp_path, curve, decode, ending):
    values = noise(3, np.uint8)
    options = {"lossless": True} if ending == "webp" else {}
    Image.fromarray(values).save(tmp_path / f"a.{ending}", icc_profile=icc(curve), **options)
    (light,) = open_pictures(tmp_path / f"a.{ending}")
    assert light == pytest.approx(decode(values / 255) @ LUMINANCE, rel=2e-3, abs=1e-5)


def test_png_that_cannot_be_decoded_as_it_says_is_refused(tmp_path):
    write_png(tmp_path / "a.png", noise(3), (b"cICP", bytes([1, 10, 0, 1])))
    assert_says(refusal(open_pictures, tmp_path / "a.png"), "logarithmic | --linear")
    assert open_pictures(tmp_path / "a.png", linear=True).transfer.name == "linear light"
    write_png(tmp_path / "a.png", noise(3), (b"cICP", bytes([1, 13, 0, 0])))
    assert_says(refusal(open_pictures, tmp_path / "a.png"), "limited range")
    (tmp_path / "a.png").unlink()
    write_png(tmp_path / "1.png", noise(3))
    write_png(tmp_path / "2.png", noise(3), gamma(100000))
    assert_says(refusal(list, open_pictures(tmp_path)), "2.png has other tags of light")


# The time of pages.

PAGES = [np.full((8, 10), level, np.uint8) for level in (50, 100, 150, 200, 250)]
DURATIONS = {
    "GIF": ("a.gif", [20, 500, 30, 20, 40]), "WebP": ("a.webp", [20, 501, 33, 1, 40]),
    "APNG": ("a.png", [20, 501, 33, 1, 40]),
    "steady GIF": ("a.gif", [30] * 5), "steady WebP": ("a.webp", [4] * 5), "steady APNG": ("a.png", [40] * 5),
    "GIF with a long last page": ("a.gif", [20, 20, 20, 20, 2000]),
    "GIF with a long first page": ("a.gif", [900, 20, 20, 20, 20]),
}  # fmt: skip


@pytest.mark.parametrize(("name", "durations"), DURATIONS.values(), ids=DURATIONS)
def test_pages_come_when_those_before_them_have_lasted(tmp_path, name, durations):
    pages = [Image.fromarray(page) for page in PAGES]
    options = {"lossless": True} if name.endswith("webp") else {}
    pages[0].save(tmp_path / name, save_all=True, append_images=pages[1:], duration=durations, **options)
    pictures = open_pictures(tmp_path / name, linear=True)
    assert pictures.times == tuple(Fraction(sum(durations[:number]), 1000) for number in range(5))
    assert pictures.rate_hz == (Fraction(1000, durations[0]) if len(set(durations[:4])) == 1 else None)
    assert [round(float(light.mean()) * 255) for light in pictures] == [50, 100, 150, 200, 250]
    assert prepare_pictures(pictures, IDEAL).frames == sum(durations[:4]) * 20


def test_apng_states_times_as_fractions(tmp_path):
    pages = [Image.fromarray(page) for page in PAGES]
    pages[0].save(tmp_path / "a.png", save_all=True, append_images=pages[1:], duration=40)
    data, begin = bytearray((tmp_path / "a.png").read_bytes()), 0
    while (begin := data.find(b"fcTL", begin) + 4) > 3:
        data[begin + 20 : begin + 24] = struct.pack(">HH", 1001, 24000)
        data[begin + 26 : begin + 30] = struct.pack(">I", zlib.crc32(data[begin - 4 : begin + 26]))
    (tmp_path / "a.png").write_bytes(data)
    assert open_pictures(tmp_path / "a.png").rate_hz == Fraction(24000, 1001)


def test_an_animation_of_16_bits_is_refused(tmp_path):
    """Two frames of deep colour, of which Pillow reads 8 bits and ffmpeg's decoder of PNG the first."""
    values = noise(3)
    control = struct.pack(">IIIII", 0, 10, 8, 0, 0) + struct.pack(">HHBB", 1, 25, 0, 0)
    write_png(tmp_path / "a.png", values, (b"acTL", struct.pack(">II", 2, 0)), (b"fcTL", control))
    data = (tmp_path / "a.png").read_bytes()
    rows = zlib.compress(b"".join(b"\0" + row.astype(">u2").tobytes() for row in values))
    extra = b""
    for name, body in ((b"fcTL", struct.pack(">I", 1) + control[4:]), (b"fdAT", struct.pack(">I", 2) + rows)):
        extra += struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
    (tmp_path / "a.png").write_bytes(data[:-12] + extra + data[-12:])
    assert_says(refusal(open_pictures, tmp_path / "a.png"), "is an animation of 16 bits")


def test_a_page_that_lasts_no_time_is_refused_unless_a_rate_is_given(tmp_path):
    pages = [Image.fromarray(page) for page in PAGES]
    pages[0].save(tmp_path / "a.gif", save_all=True, append_images=pages[1:], duration=[20, 0, 20, 20, 20])
    pictures = open_pictures(tmp_path / "a.gif", linear=True)
    assert_says(
        refusal(prepare_pictures, pictures, IDEAL), "picture 3 is at 0.02 s, and picture 2 at 0.02 s | --rate HZ"
    )
    plan = prepare_pictures(pictures, IDEAL, rate_hz=50)
    assert (plan.frames, plan.notes) == (
        1600,
        ("a.gif: its pictures at times 0 to 20 ms apart are taken to be at 50 Hz (--rate)",),
    )


@pytest.mark.parametrize("name", ["a.gif", "a.webp", "a.png", "a.tif"])
def test_a_file_of_pages_is_refused_wherever_it_is_cut(tmp_path, name):
    pages = [Image.fromarray(noise(3, np.uint8, seed)) for seed in range(6)]
    options = {"lossless": True} if name.endswith("webp") else {}
    pages[0].save(tmp_path / name, save_all=True, append_images=pages[1:], **options)
    data = (tmp_path / name).read_bytes()
    for stop in np.linspace(1, len(data) - 60, 40).astype(int):
        (tmp_path / f"cut_{name}").write_bytes(data[:stop])
        assert "cannot be read" in refusal(open_pictures, tmp_path / f"cut_{name}").problem
