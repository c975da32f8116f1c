"""OpenEXR planes come back as they went."""

import numpy as np
import OpenEXR
import pytest
from refusals import refusal

from saf_gen.stack.exr import read_planes, write_planes


def test_planes_and_attributes_come_back_bit_for_bit(tmp_path):
    random = np.random.default_rng(0)
    planes = {f"focus.{k:04d}": random.random((5, 7), dtype=np.float32) for k in range(12)}
    write_planes(tmp_path / "a.exr", planes, attributes={"unit": "m"})
    back, attributes = read_planes(tmp_path / "a.exr")
    assert set(back) == set(planes)
    assert all(np.array_equal(back[name], planes[name]) for name in planes)
    assert attributes["unit"] == "m"


def test_half_floats_come_back_as_they_went(tmp_path):
    random = np.random.default_rng(0)
    planes = {name: random.random((5, 7)).astype(np.float16) for name in ("b", "a", "c")}
    planes["depth"] = random.random((5, 7), dtype=np.float32)  # of two bytes and of four, in one file
    write_planes(tmp_path / "a.exr", planes, attributes={})
    back, _ = read_planes(tmp_path / "a.exr")
    assert {name: plane.dtype for name, plane in back.items()} == {n: p.dtype for n, p in planes.items()}
    assert all(np.array_equal(back[name], planes[name]) for name in planes)


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


def test_infinite_depth_survives(tmp_path):
    write_planes(tmp_path / "a.exr", {"depth": np.array([[1.0, np.inf]])}, attributes={})
    assert np.isinf(read_planes(tmp_path / "a.exr")[0]["depth"][0, 1])


def image_bytes(path, plane, compression=OpenEXR.NO_COMPRESSION):
    header = {"compression": compression, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {"depth": plane}).write(str(path))
    return path.read_bytes()


@pytest.mark.parametrize(
    ("make", "problem"),
    [
        (lambda path: b"not an image", "not a whole OpenEXR file"),
        (lambda path: image_bytes(path, np.ones((5, 70), np.float32))[: -5 * 280], "truncated"),
        (lambda path: image_bytes(path, np.ones((5, 70), np.float32))[: -2 * 280], "truncated"),
        (lambda path: image_bytes(path, np.ones((5, 7), np.uint32)), "depth is UINT, not FLOAT or HALF"),
        (
            lambda path: image_bytes(path, np.ones((5, 700), np.float32), OpenEXR.ZIP_COMPRESSION),
            "not a whole OpenEXR file",
        ),
        (
            lambda path: image_bytes(
                path, np.random.default_rng(0).random((5, 700), dtype=np.float32), OpenEXR.ZIP_COMPRESSION
            ),
            "not a whole OpenEXR file",
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
