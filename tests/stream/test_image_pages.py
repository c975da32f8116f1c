"""Image files of others: every bit, upright, what they say about light, and what is refused in one line."""

import struct
import zlib

import numpy as np
import pytest
import tifffile
from PIL import Image
from refusals import assert_says, refusal

from saf_gen.stream.interop.linear_light import LUMINANCE
from saf_gen.stream.interop.picture_frames import open_pictures


def write_png(path, values, *chunks):
    """A PNG of 8 or 16 bits per channel, with chunks (name, data) that Pillow does not write."""
    height, width, channels = values.shape
    kind = {1: 0, 2: 4, 3: 2, 4: 6}[channels]
    rows = b"".join(b"\0" + row.astype(values.dtype.newbyteorder(">")).tobytes() for row in values)

    def chunk(name, data):
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    head = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8 * values.itemsize, kind, 0, 0, 0))
    tags = b"".join(chunk(name, data) for name, data in chunks)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + head + tags + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))


def noise(channels, dtype=np.uint16, seed=1):
    values = np.random.default_rng(seed).integers(0, np.iinfo(dtype).max, (8, 10, channels), dtype)
    return values[:, :, 0] if channels == 1 else values


def grey_of(values):
    return values.astype(float) if values.ndim == 2 else values[:, :, :3] @ LUMINANCE.astype(float)


def save(mode=None, **options):
    return lambda path, values: Image.fromarray(values).convert(mode).save(path, **options)


def write_tiff(**options):
    def write(path, values):
        options.setdefault("photometric", "minisblack" if values.ndim == 2 else "rgb")
        tifffile.imwrite(path, values, metadata=None, **options)

    return write


def write_bare_tiff(path, values):
    """A grey TIFF of 16 bits without the tag that says how it is packed, which then means not at all."""
    rows, columns = values.shape
    tags = {256: columns, 257: rows, 258: 16, 262: 1, 273: 110, 277: 1, 278: rows, 279: values.nbytes}
    entries = b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in tags.items())
    path.write_bytes(b"II*\0" + struct.pack("<IH", 8, len(tags)) + entries + bytes(4) + values.astype("<u2").tobytes())


WHOLE = {
    "grey PNG": ("a.png", save(), noise(1, np.uint8)), "PNG": ("a.png", save(), noise(3, np.uint8)),
    "PNG with alpha": ("a.png", save(), noise(4, np.uint8)), "PNG of 16 bits": ("a.png", save(), noise(1)),
    "BMP": ("a.BMP", save(), noise(3, np.uint8)), "WebP": ("a.webp", save(lossless=True), noise(3, np.uint8)),
    "PPM": ("a.ppm", save(), noise(3, np.uint8)), "PGM of 16 bits": ("a.pgm", save(), noise(1)),
    "a palette": ("a.png", save("P"), noise(1, np.uint8)),
    "two levels": ("a.png", save("1"), noise(1, np.uint8) // 128 * 255),
    "TIFF": ("a.tif", write_tiff(), noise(1, np.uint8)), "TIFF of 16 bits": ("a.tiff", write_tiff(), noise(1)),
    "TIFF as ImageJ writes it": ("a.tif", write_bare_tiff, noise(1)),
    "TIFF in colour": ("a.tif", write_tiff(), noise(3, np.uint8)), "deep TIFF": ("a.tif", write_tiff(), noise(3)),
    "deep TIFF with alpha": ("a.tif", write_tiff(extrasamples=["unassalpha"]), noise(4)),
    "deflated TIFF": ("a.tif", write_tiff(compression="zlib", predictor=True), noise(3)),
    "big-endian TIFF in tiles": ("a.tif", write_tiff(byteorder=">", tile=(16, 16)), noise(1)),
}  # fmt: skip


@pytest.mark.parametrize(("name", "write", "values"), WHOLE.values(), ids=WHOLE)
def test_every_bit_of_an_image_is_read(tmp_path, name, write, values):
    write(tmp_path / name, values)
    (light,) = open_pictures(tmp_path / name, linear=True)
    top = np.iinfo(values.dtype).max
    assert light * top == pytest.approx(grey_of(values), abs=0.02)


def test_every_page_of_a_deep_tiff_is_read(tmp_path):
    pages = np.stack([noise(3, seed=seed) for seed in range(4)])
    tifffile.imwrite(tmp_path / "a.tif", pages, photometric="rgb")
    light = np.stack(list(open_pictures(tmp_path / "a.tif", linear=True)))
    assert light * 65535 == pytest.approx(pages @ LUMINANCE.astype(float), abs=0.02)


def deep_ppm(path, values):
    path.write_bytes(b"P6 10 8 65535\n" + values.astype(">u2").tobytes())


def animate(path, values):
    pages = [Image.fromarray(values), Image.fromarray(255 - values)]
    pages[0].save(path, save_all=True, append_images=pages[1:], duration=20)


def change_strip(path, values, *, offset=None, length):
    """Write a deflated TIFF of one strip, and change where its tags say that the strip is."""
    tifffile.imwrite(path, values, photometric="minisblack", metadata=None, compression="zlib")
    with tifffile.TiffFile(path) as file:
        places = {name: file.pages[0].tags[name] for name in ("StripOffsets", "StripByteCounts")}
        fields = {name: (tag.valueoffset, "<H" if tag.dtype == 3 else "<I") for name, tag in places.items()}
    content = bytearray(path.read_bytes())
    for name, value in (("StripOffsets", offset), ("StripByteCounts", length)):
        if value is not None:
            struct.pack_into(fields[name][1], content, fields[name][0], value)
    path.write_bytes(content)


def empty_part(path, values):
    change_strip(path, values, length=0)


def packed_zeros(path, values):
    """A strip that unpacks to 64 MiB where it states 80 bytes."""
    zeros = zlib.compress(bytes(64 << 20))[:60_000]
    change_strip(path, values, offset=4000, length=len(zeros))
    path.write_bytes(path.read_bytes().ljust(4000, b"\0") + zeros)


REFUSED = {
    "deep PNG": ("a.png", write_png, noise(3), "RGB of 16 bits | save it as TIFF"),
    "deep PNG with alpha": ("a.png", write_png, noise(4), "RGBA of 16 bits"),
    "deep grey PNG with alpha": ("a.png", write_png, noise(2), "A of 16 bits"),
    "deep PPM": ("a.ppm", deep_ppm, noise(3), "RGB of 16 bits"),
    "colour for printing": ("a.jpg", save("CMYK"), noise(3, np.uint8), "stored as CMYK"),
    "an animation": ("a.png", animate, noise(1, np.uint8), "is an animation | ffmpeg"),
    "a GIF by another name": ("a.png", save(format="GIF"), noise(1, np.uint8), "no picture of a known format"),
    "white is zero": ("a.tif", write_tiff(photometric="miniswhite"), noise(1), "MINISWHITE | grey (0 is black)"),
    "TIFF for printing": ("a.tif", write_tiff(photometric="separated"), noise(4), "SEPARATED"),
    "TIFF in planes": (
        "a.tif", lambda p, v: tifffile.imwrite(p, np.moveaxis(v, 2, 0), photometric="rgb", planarconfig="separate"),
        noise(3), "axes SYX",
    ),
    "TIFF of another packing": ("a.tif", write_tiff(compression="lzma"), noise(1), "LZMA"),
    "TIFF without its pixels": ("a.tif", empty_part, noise(1, np.uint8), "a part of a page is missing"),
    "TIFF that unpacks to more": ("a.tif", packed_zeros, noise(1, np.uint8), "more bytes than it states"),
    "no TIFF": ("a.tif", lambda p, v: p.write_bytes(b"II*\0 and nothing else"), noise(1), "cannot be read"),
}  # fmt: skip


@pytest.mark.parametrize(("name", "write", "values", "says"), REFUSED.values(), ids=REFUSED)
def test_a_picture_that_is_not_read_is_one_line(tmp_path, name, write, values, says, capfd):
    write(tmp_path / name, values)
    assert_says(refusal(lambda: list(open_pictures(tmp_path / name, linear=True))), says)
    assert capfd.readouterr() == ("", "")


# What a file says about light.


def exif_of(space):
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0xA001] = space
    return exif


PROFILE = bytes(128) + struct.pack(">I", 0)
STATED = {
    "PNG": ("a.png", {}, False), "JPEG": ("a.jpg", {}, False), "TIFF": ("a.tif", {}, False),
    "JPEG of sRGB": ("a.jpg", {"exif": exif_of(1)}, True),
    "JPEG of another space": ("a.jpg", {"exif": exif_of(65535)}, False),
    "JPEG with a profile": ("a.jpg", {"exif": exif_of(1), "icc_profile": PROFILE}, False),
}  # fmt: skip


@pytest.mark.parametrize(("name", "options", "states"), STATED.values(), ids=STATED)
def test_a_picture_states_srgb_or_is_asked_about(tmp_path, name, options, states):
    Image.fromarray(noise(3, np.uint8)).save(tmp_path / name, **options)
    pictures = open_pictures(tmp_path / name)
    assert (pictures.is_stated, pictures.transfer.name) == (states, "sRGB decoded")
    assert open_pictures(tmp_path / name, transfer="bt709").transfer.name == "BT.709 decoded"


CHUNKS = {
    "sRGB": ([(b"sRGB", b"\0")], True), "gamma": ([(b"gAMA", struct.pack(">I", 45455))], False),
    "sRGB beside another space": ([(b"sRGB", b"\0"), (b"cICP", bytes([9, 16, 0, 1]))], False),
}  # fmt: skip


@pytest.mark.parametrize(("chunks", "states"), CHUNKS.values(), ids=CHUNKS)
def test_a_png_states_srgb_by_its_chunk_alone(tmp_path, chunks, states):
    write_png(tmp_path / "a.png", noise(3, np.uint8), *chunks)
    assert open_pictures(tmp_path / "a.png").is_stated == states


def test_all_pictures_of_a_folder_say_the_same_or_the_user_does(tmp_path):
    write_png(tmp_path / "1.png", noise(3, np.uint8), (b"sRGB", b"\0"))
    write_png(tmp_path / "2.png", noise(3, np.uint8))
    assert_says(refusal(list, open_pictures(tmp_path)), "2.png does not say | --transfer srgb")
    assert len(list(open_pictures(tmp_path, transfer="srgb"))) == 2


def test_a_second_picture_that_a_phone_stores_in_a_jpeg_is_left_out(tmp_path):
    pages = [Image.fromarray(np.full((16, 16, 3), level, np.uint8)) for level in (90, 200)]
    pages[0].save(tmp_path / "a.jpg", format="MPO", save_all=True, append_images=pages[1:])
    (light,) = open_pictures(tmp_path / "a.jpg", linear=True)
    assert light * 255 == pytest.approx(90, abs=1)


@pytest.mark.parametrize("name", ["a.png", "a.webp", "a.jpg", "a.bmp", "a.pgm"])
def test_a_picture_is_refused_wherever_it_is_cut(tmp_path, name):
    Image.fromarray(noise(1, np.uint8)).save(tmp_path / name)
    data = (tmp_path / name).read_bytes()
    for stop in np.linspace(1, len(data) - 60, 40).astype(int):
        (tmp_path / f"cut_{name}").write_bytes(data[:stop])
        assert "cannot be read" in refusal(open_pictures, tmp_path / f"cut_{name}").problem
