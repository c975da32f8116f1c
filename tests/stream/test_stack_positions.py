"""Stacks of microscopes, written with tifffile: their z becomes the position of the lens, or they are one line."""

import json
import re

import numpy as np
import pytest
import tifffile
from PIL import Image
from refusals import assert_says, refusal

from saf_gen.camera import get_sensor
from saf_gen.stream.interop.encode_pictures import encode_pictures, prepare_pictures
from saf_gen.stream.interop.picture_frames import open_pictures
from saf_gen.stream.stream_file import open_stream

STACK = np.random.default_rng(3).integers(20, 200, (6, 8, 10), np.uint8)
EVEN = {"PhysicalSizeZ": 2.5, "PhysicalSizeZUnit": "µm"}


def write_ome(path, stack=STACK, *, axes="ZYX", photometric="minisblack", change=(), **metadata):
    """Write an OME-TIFF; ``change`` are patterns in its XML and what replaces them."""
    tifffile.imwrite(path, stack, ome=True, photometric=photometric, metadata={"axes": axes, **metadata})
    text = tifffile.tiffcomment(path)
    for old, new in change:
        text, count = re.subn(old, new, text)
        assert count
    if change:
        tifffile.tiffcomment(path, text.encode())


def write_imagej(path, stack=STACK, *, axes="ZYX", **metadata):
    tifffile.imwrite(path, stack, imagej=True, metadata={"axes": axes, **metadata})


def planes(z, unit="µm"):
    return {"PositionZ": list(z), "PositionZUnit": [unit] * len(z)}


BACKWARDS = "".join(f'<TiffData IFD="{page}" FirstZ="{5 - page}"/>' for page in range(6))
PREFIX = [("xmlns=", "xmlns:ome="), (r"<(/?)([A-Z])", r"<\1ome:\2")]
RGB_STACK = np.repeat(STACK[..., None], 3, axis=3)
STATED = {
    "even": (lambda p: write_ome(p, **EVEN), np.arange(6) * 2.5, "µm"),
    "without a unit": (lambda p: write_ome(p, PhysicalSizeZ=0.5), np.arange(6) * 0.5, "µm"),
    "millimetres": (lambda p: write_ome(p, PhysicalSizeZ=0.5, PhysicalSizeZUnit="mm"), np.arange(6) * 500, "µm"),
    "nanometres": (lambda p: write_ome(p, PhysicalSizeZ=50, PhysicalSizeZUnit="nm"), np.arange(6) * 0.05, "µm"),
    "uneven": (lambda p: write_ome(p, Plane=planes([0, 1, 2, 4, 8, 16])), [0, 1, 2, 4, 8, 16], "µm"),
    "falling": (lambda p: write_ome(p, Plane=planes([5, 4, 3, 0, -1, -3])), [5, 4, 3, 0, -1, -3], "µm"),
    "repeated": (lambda p: write_ome(p, Plane=planes([0, 0, 1, 1, 1, 2])), [0, 0, 1, 1, 1, 2], "µm"),
    "measured, not nominal": (lambda p: write_ome(p, **EVEN, Plane=planes(range(6))), np.arange(6), "µm"),
    "a stage at rest": (lambda p: write_ome(p, **EVEN, Plane=planes([7] * 6)), np.arange(6) * 2.5, "µm"),
    "some planes alone": (
        lambda p: write_ome(p, **EVEN, Plane=planes(range(6)), change=[(' PositionZ="3"', "")]),
        np.arange(6) * 2.5, "µm",
    ),
    "of a stage": (
        lambda p: write_ome(p, Plane=planes(range(6), "reference frame")), np.arange(6), "reference frame",
    ),
    "of a stage, no unit": (
        lambda p: write_ome(p, Plane={"PositionZ": list(range(6))}), np.arange(6), "reference frame",
    ),
    "another order of axes": (lambda p: write_ome(p, **EVEN, change=[("XYCZT", "XYZTC")]), np.arange(6) * 2.5, "µm"),
    "last plane first": (
        lambda p: write_ome(p, **EVEN, change=[("<TiffData.*?/>", BACKWARDS)]),
        np.arange(6)[::-1] * 2.5, "µm",
    ),
    "a prefix of names": (lambda p: write_ome(p, **EVEN, change=PREFIX), np.arange(6) * 2.5, "µm"),
    "colour": (lambda p: write_ome(p, RGB_STACK, axes="ZYXS", photometric="rgb", **EVEN), np.arange(6) * 2.5, "µm"),
    "ImageJ": (lambda p: write_imagej(p, spacing=0.3, unit="um"), np.arange(6) * 0.3, "µm"),
    "ImageJ, escaped": (lambda p: write_imagej(p, spacing=0.3, unit="\\u00B5m"), np.arange(6) * 0.3, "µm"),
    "ImageJ, microns": (lambda p: write_imagej(p, spacing=2, unit="micron"), np.arange(6) * 2, "µm"),
    "ImageJ, millimetres": (lambda p: write_imagej(p, spacing=0.1, unit="mm"), np.arange(6) * 100, "µm"),
    "ImageJ, downwards": (lambda p: write_imagej(p, spacing=-0.3, unit="um"), np.arange(6) * -0.3, "µm"),
}  # fmt: skip


@pytest.mark.parametrize("name", STATED)
def test_the_positions_of_a_stack_are_read(tmp_path, name):
    write, z, unit = STATED[name]
    write(tmp_path / "a.tif")
    pictures = open_pictures(tmp_path / "a.tif", linear=True)
    found = pictures.positions
    assert found.z == pytest.approx(np.asarray(z, float))
    assert found.unit == unit
    assert found.travel == pytest.approx((np.asarray(z, float) - z[0]) / (z[-1] - z[0]))
    light = np.stack(list(pictures)) * 255
    assert light == pytest.approx(STACK, abs=1e-3)


NO_POSITIONS = {
    "no size of z": lambda p: write_ome(p),
    "times": lambda p: write_ome(p, axes="TYX", PhysicalSizeZ=2.5, TimeIncrement=0.1),
    "times of a moving stage": lambda p: write_ome(p, axes="TYX", Plane=planes(range(6))),
    "a stage at rest": lambda p: write_ome(p, Plane=planes([7] * 6)),
    "ImageJ without spacing": lambda p: write_imagej(p),
    "ImageJ in pixels": lambda p: write_imagej(p, spacing=1.0, unit="pixel"),
    "ImageJ in inches": lambda p: write_imagej(p, spacing=1.0, unit="inch"),
    "ImageJ, times": lambda p: write_imagej(p, axes="TYX", spacing=0.3, unit="um"),
    "ImageJ, no spacing of length": lambda p: write_imagej(p, spacing=0.0, unit="um"),
    "plain pages": lambda p: tifffile.imwrite(p, STACK, photometric="minisblack"),
    "a text": lambda p: tifffile.imwrite(p, STACK, photometric="minisblack", description="z = 3 um", metadata=None),
    "Pillow": lambda p: Image.fromarray(STACK[0]).save(
        p, save_all=True, append_images=[Image.fromarray(one) for one in STACK[1:]]
    ),
}


@pytest.mark.parametrize("name", NO_POSITIONS)
def test_other_pages_have_no_positions(tmp_path, name):
    NO_POSITIONS[name](tmp_path / "a.tif")
    pictures = open_pictures(tmp_path / "a.tif", linear=True)
    assert pictures.positions is None
    assert np.stack(list(pictures)) * 255 == pytest.approx(STACK, abs=1e-3)


def keep_pages(path, count):
    """Write the file again with fewer pages and the same description."""
    text = tifffile.tiffcomment(path)
    tifffile.imwrite(path, STACK[:count], photometric="minisblack", description=text.encode(), metadata=None)


def write_cut(path, write, count):
    write(path)
    keep_pages(path, count)


BOMB = '<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;">]><OME'
DEEP_STACK = np.stack([STACK, STACK])
REFUSED = {
    "channels": (lambda p: write_ome(p, axes="CYX"), "6 channels, 1 slices and 1 times | one axis"),
    "slices and channels": (lambda p: write_ome(p, DEEP_STACK, axes="CZYX", **EVEN), "2 channels, 6 slices"),
    "slices and times": (lambda p: write_ome(p, DEEP_STACK, axes="TZYX", **EVEN), "6 slices and 2 times"),
    "channels and times": (lambda p: write_ome(p, DEEP_STACK, axes="TCYX"), "6 channels, 1 slices and 2 times"),
    "ImageJ, channels": (lambda p: write_imagej(p, axes="CYX"), "6 channels"),
    "ImageJ, slices and channels": (
        lambda p: write_imagej(p, DEEP_STACK, axes="ZCYX", spacing=1.0, unit="um"), "6 channels, 2 slices",
    ),
    "ImageJ, slices and times": (lambda p: write_imagej(p, DEEP_STACK, axes="TZYX"), "6 slices and 2 times"),
    "two images": (
        lambda p: write_ome(p, **EVEN, change=[("</Image>", "</Image><Image><Pixels/></Image>")]),
        "describes 2 images",
    ),
    "a companion": (
        lambda p: tifffile.imwrite(
            p, STACK, photometric="minisblack", metadata=None,
            description='<?xml version="1.0"?><OME><BinaryOnly MetadataFile="x.companion.ome"/></OME>',
        ),
        "in another file",
    ),
    "pages missing": (lambda p: write_cut(p, lambda q: write_ome(q, **EVEN), 4), "has 4 pages | 6 slices"),
    "one page left": (lambda p: write_cut(p, lambda q: write_ome(q, **EVEN), 1), "has 1 pages | 6 slices"),
    "ImageJ, pages missing": (lambda p: write_cut(p, write_imagej, 5), "has 5 pages | 6 slices"),
    "a document type": (lambda p: write_ome(p, **EVEN, change=[("<OME", BOMB)]), "declares a document type"),
    "no XML": (lambda p: write_ome(p, **EVEN, change=[("</Pixels>", "")]), "OME-XML cannot be read"),
    "no size": (lambda p: write_ome(p, **EVEN, change=[('SizeZ="6"', 'SizeZ="-6"')]), "SizeZ '-6'"),
    "two planes on a page": (
        lambda p: write_ome(p, **EVEN, change=[('PlaneCount="6"/>', 'PlaneCount="5"/><TiffData IFD="5"/>')]),
        "which plane each page holds",
    ),
    "two positions": (
        lambda p: write_ome(p, Plane=planes(range(6)), change=[('TheZ="3"', 'TheZ="2"')]), "two positions of plane 2",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_pages_that_are_not_one_axis_are_one_line(tmp_path, name):
    write, message = REFUSED[name]
    write(tmp_path / "a.tif")
    assert_says(refusal(open_pictures, tmp_path / "a.tif"), message)


TURNING = {"up and down": [0, 1, 2, 3, 2, 1], "a step back": [0, 1, 0.9, 2, 3, 4], "to and fro": [0, 1, 2, 2, 1, 0]}


@pytest.mark.parametrize("name", TURNING)
def test_positions_that_turn_back_are_left_to_the_user(tmp_path, call, name):
    write_ome(tmp_path / "a.tif", Plane=planes(TURNING[name]))
    (tmp_path / "lens.csv").write_text("frame,position\n0,0\n99,1\n")
    ask = ("encode", tmp_path / "a.tif", "--linear", "--rate", 1000, "--out", tmp_path / "a.h5")
    code, _, err = call(*ask)
    assert (code, (tmp_path / "a.h5").exists()) == (2, False)
    assert "the focus turns back from" in err
    assert "--focus LOG.csv" in err
    code, out, _ = call(*ask, "--focus", tmp_path / "lens.csv")
    assert code == 0
    assert "left out, for --focus" in out
    with open_stream(tmp_path / "a.h5") as stream:
        assert stream.focus_position[[0, 99]] == pytest.approx([0, 1])


def test_each_readout_has_the_position_between_its_pictures(tmp_path, call):
    """Six pictures at 100 Hz: readout t is at (t + 1/2) / 200 pictures, and the focus moves straight between them."""
    z = np.array([-1.0, 0, 0.5, 4, 6, 9])
    write_ome(tmp_path / "a.ome.tif", Plane=planes(z))
    options = ("--linear", "--rate", 100, "--out", tmp_path / "a.h5", "--truth", "frame:500")
    code, out, _ = call("encode", tmp_path / "a.ome.tif", *options)
    assert code == 0
    assert "focus at -1 to 9 µm in 6 pictures (PositionZ in OME-XML), stored as 0 to 1" in out
    expected = np.interp((np.arange(1000) + 0.5) / 200, np.arange(6), (z + 1) / 10)
    with open_stream(tmp_path / "a.h5") as stream:
        assert stream.focus_position == pytest.approx(expected, abs=1e-6)
        assert stream.truth.position == pytest.approx(expected[500], abs=1e-6)
        assert json.loads(stream.metadata.provenance["encode"])["focus"]["z"] == z.tolist()
    plan = prepare_pictures(
        open_pictures(tmp_path / "a.ome.tif", linear=True), get_sensor("vidar_400x250"), rate_hz=100
    )
    encode_pictures(plan, tmp_path / "b.h5")
    with open_stream(tmp_path / "b.h5") as stream:
        assert stream.focus_position == pytest.approx(expected, abs=1e-6)
