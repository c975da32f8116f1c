"""OpenEXR planes are read as they were written."""

import os
from contextlib import suppress

import numpy as np
import OpenEXR
import pytest
from refusals import refusal

from saf_gen.core.exr import read_planes, write_plane_blocks, write_planes
from saf_gen.errors import BadInput


def test_planes_of_two_and_four_bytes_and_attributes_come_back_bit_for_bit(tmp_path):
    random = np.random.default_rng(0)
    planes = {name: random.random((5, 7)).astype(np.float16) for name in ("b", "a", "c")}
    planes["depth"], planes["target"] = random.random((2, 5, 7), dtype=np.float32)
    planes["depth"][0, 1] = np.inf
    write_planes(tmp_path / "a.exr", planes, attributes={"unit": "m"})
    back, attributes = read_planes(tmp_path / "a.exr")
    assert {name: plane.dtype for name, plane in back.items()} == {n: p.dtype for n, p in planes.items()}
    assert all(np.array_equal(back[name], planes[name]) for name in planes)
    assert attributes["unit"] == "m"


def test_what_is_read_is_what_openexr_reads(tmp_path):
    planes = {f"focus.{k:04d}": np.arange(35, dtype=np.float16).reshape(5, 7) + k for k in (9, 10, 8)}
    write_planes(tmp_path / "a.exr", planes, attributes={})
    theirs = OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True).channels()
    ours, _ = read_planes(tmp_path / "a.exr")
    assert set(ours) == set(theirs)
    assert all(np.array_equal(ours[name], theirs[name].pixels) for name in theirs)


def test_some_planes_of_many(tmp_path):
    planes = {f"focus.{k:04d}": np.full((5, 7), k, np.float32) for k in range(12)}
    write_planes(tmp_path / "a.exr", planes, attributes={"unit": "m"})
    back, attributes = read_planes(tmp_path / "a.exr", ["focus.0010", "focus.0003"])
    assert list(back) == ["focus.0010", "focus.0003"]
    assert all(np.array_equal(back[name], planes[name]) for name in back)
    assert attributes["unit"] == "m"
    error = refusal(read_planes, tmp_path / "a.exr", ["focus.0012"])
    assert "focus.0012" in error.problem
    assert error.hint.startswith("delete it")


def image_bytes(path, plane, compression=OpenEXR.NO_COMPRESSION):
    header = {"compression": compression, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {"depth": plane}).write(str(path))
    return path.read_bytes()


@pytest.mark.parametrize(
    ("make", "problem"),
    [
        (lambda path: b"not an image", "not a complete OpenEXR file"),
        (lambda path: image_bytes(path, np.ones((5, 70), np.float32))[: -5 * 280], "truncated"),
        (lambda path: image_bytes(path, np.ones((5, 70), np.float32))[: -2 * 280], "truncated"),
        (lambda path: image_bytes(path, np.ones((5, 7), np.uint32)), "channel 'depth' holds no floats"),
        (
            lambda path: image_bytes(path, np.ones((5, 700), np.float32), OpenEXR.ZIP_COMPRESSION),
            "not a complete OpenEXR file",
        ),
        (
            lambda path: image_bytes(
                path, np.random.default_rng(0).random((5, 700), dtype=np.float32), OpenEXR.ZIP_COMPRESSION
            ),
            "not a complete OpenEXR file",
        ),
    ],
    ids=["not an EXR", "no lines", "lines missing", "whole numbers", "compressed flat", "compressed noise"],
)
def test_a_file_that_is_not_ours_is_refused(tmp_path, make, problem):
    path = tmp_path / "a.exr"
    path.write_bytes(make(path))
    error = refusal(read_planes, path)
    assert str(path) in error.problem
    assert problem in error.problem
    assert error.hint.startswith("delete it")


def test_a_pipe_in_the_place_of_a_file_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe.exr")
    assert refusal(read_planes, tmp_path / "pipe.exr").problem.endswith("pipe.exr is not a file on a disk")


def blocks_of(path, count, shape=(37, 13), seed=1):
    """Write planes that differ little from one to the next in blocks, and return them."""
    random = np.random.default_rng(seed)
    planes = {f"focus.{k:04d}": (random.random(shape) + 0.1 * k).astype(np.float16) for k in range(5, 5 + count)}
    write_plane_blocks(path, planes, attributes={"unit": "m", "exponent": "3"})
    return planes


def same_bits(one, other):
    return one.dtype == other.dtype and np.array_equal(one.view(np.uint16), other.view(np.uint16))


@pytest.mark.parametrize("count", [1, 3, 8, 9, 24])
def test_planes_in_blocks_come_back_bit_for_bit(tmp_path, count):
    """37 lines are two chunks of 16 and one of 5; there are full and partial blocks, and a single one."""
    planes = blocks_of(tmp_path / "a.exr", count)
    back, attributes = read_planes(tmp_path / "a.exr")
    assert list(back) == list(planes)
    assert all(same_bits(back[name], planes[name]) for name in planes)
    assert attributes == {"unit": "m", "exponent": "3"}


@pytest.mark.parametrize("block_size", [1, 2])
def test_planes_of_four_bytes_come_back_from_blocks_too(tmp_path, block_size):
    depth = np.random.default_rng(2).random((37, 13)).astype(np.float32)
    depth[3, 4] = np.inf
    planes = {"depth": depth, "target": (depth > 0.5).astype(np.float32), "noise": depth[::-1].copy()}
    write_plane_blocks(tmp_path / "a.exr", planes, attributes={}, block_size=block_size)
    back, _ = read_planes(tmp_path / "a.exr")
    assert {name: plane.dtype for name, plane in back.items()} == dict.fromkeys(planes, np.dtype(np.float32))
    assert all(np.array_equal(back[name], planes[name]) for name in planes)
    parts = OpenEXR.File(str(tmp_path / "a.exr")).parts
    assert len(parts) == -(-3 // block_size)


@pytest.mark.parametrize("kind", ["noise", "flat", "odd bits"])
def test_blocks_keep_every_bit_pattern(tmp_path, kind):
    """Noise cannot be compressed, so its chunks are stored raw; all 65,536 half floats, including NaN and -0."""
    bits = {
        "noise": np.random.default_rng(3).integers(0, 1 << 16, (9, 32, 64)),
        "flat": np.full((9, 32, 64), 0x3C00),
        "odd bits": np.arange(9 * 32 * 256).reshape(9, 32, 256) * 8191,
    }[kind].astype(np.uint16)
    planes = {f"p{k}": plane.view(np.float16) for k, plane in enumerate(bits)}
    write_plane_blocks(tmp_path / "a.exr", planes, attributes={})
    back, _ = read_planes(tmp_path / "a.exr")
    assert all(same_bits(back[name], planes[name]) for name in planes)
    size, raw = (tmp_path / "a.exr").stat().st_size, bits.nbytes
    assert {"noise": size > raw, "flat": size < raw / 5, "odd bits": True}[kind]


def test_blocks_are_what_openexr_reads(tmp_path):
    planes = blocks_of(tmp_path / "a.exr", 10)
    parts = OpenEXR.File(str(tmp_path / "a.exr")).parts
    assert [part.header["planes"].split() for part in parts] == [list(planes)[:8], list(planes)[8:]]
    for part in parts:
        picture = part.channels["Y"].pixels
        for k, name in enumerate(part.header["planes"].split()):
            assert same_bits(np.ascontiguousarray(picture[:, k::8]), planes[name])


def test_a_few_planes_are_read_from_their_blocks_alone(tmp_path):
    """The last of four blocks is damaged, and planes of the first two are read all the same."""
    planes = blocks_of(tmp_path / "a.exr", 30)
    content = (tmp_path / "a.exr").read_bytes()
    (tmp_path / "a.exr").write_bytes(content[:-2000] + bytes(2000))
    assert refusal(read_planes, tmp_path / "a.exr", ["focus.0034"]).hint.startswith("delete it")
    back, _ = read_planes(tmp_path / "a.exr", ["focus.0013", "focus.0012", "focus.0014"])
    assert list(back) == ["focus.0013", "focus.0012", "focus.0014"]
    assert all(same_bits(back[name], planes[name]) for name in back)
    assert "focus.0040" in refusal(read_planes, tmp_path / "a.exr", ["focus.0040"]).problem


def test_damaged_blocks_are_refused(tmp_path):
    """A file cut anywhere is refused; a changed byte is, or changes numbers, which the stack's digest detects."""
    blocks_of(tmp_path / "a.exr", 9)
    content = (tmp_path / "a.exr").read_bytes()
    random = np.random.default_rng(7)
    for length in (*range(0, 900, 60), *random.integers(900, len(content) - 1, 20).tolist()):
        (tmp_path / "b.exr").write_bytes(content[:length])
        assert refusal(read_planes, tmp_path / "b.exr").hint.startswith("delete it")
    for at in (*range(0, 1200, 7), *random.integers(1200, len(content), 60).tolist()):
        changed = bytearray(content)
        changed[at] ^= (0x55, 0x80, 0xFF)[at % 3]
        (tmp_path / "b.exr").write_bytes(changed)
        with suppress(BadInput):  # and no other error
            read_planes(tmp_path / "b.exr")


def test_no_damaged_header_ends_the_process_or_fills_its_memory(tmp_path):
    """OpenEXR itself crashed for two of 300 damaged files. 400 changes of the header, seed 5."""
    rng, path = np.random.default_rng(5), tmp_path / "a.exr"
    write_planes(path, {f"focus.{n:04d}": np.ones((5, 7), np.float32) for n in range(3)}, attributes={"unit": "W"})
    content, refused = path.read_bytes(), 0
    for number in range(400):
        damaged, at = bytearray(content), int(rng.integers(min(len(content), 700)))
        extremes = b"\xff\xff\xff\x7f", b"\0\0\0\0", b"\0\0\0\x80", rng.bytes(2)
        damaged[at : at + 4] = extremes[number % 4]
        path.write_bytes(damaged)
        try:
            read_planes(path)
        except BadInput:
            refused += 1
    assert refused > 100
