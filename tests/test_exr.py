"""OpenEXR planes come back as they went."""

import numpy as np
import pytest

from saf_gen.errors import BadInput
from saf_gen.exr import read_planes, write_planes


def test_planes_and_attributes_come_back_bit_for_bit(tmp_path):
    random = np.random.default_rng(0)
    planes = {f"focus.{k:04d}": random.random((5, 7), dtype=np.float32) for k in range(12)}
    write_planes(tmp_path / "a.exr", planes, {"unit": "m"})
    back, attributes = read_planes(tmp_path / "a.exr")
    assert set(back) == set(planes)
    assert all(np.array_equal(back[name], planes[name]) for name in planes)
    assert attributes["unit"] == "m"


def test_some_planes_of_many(tmp_path):
    planes = {f"focus.{k:04d}": np.full((5, 7), k, np.float32) for k in range(12)}
    write_planes(tmp_path / "a.exr", planes, {"unit": "m"})
    back, attributes = read_planes(tmp_path / "a.exr", ["focus.0010", "focus.0003"])
    assert list(back) == ["focus.0010", "focus.0003"]
    assert all(np.array_equal(back[name], planes[name]) for name in back)
    assert attributes["unit"] == "m"
    with pytest.raises(BadInput, match=r"a.exr is no whole OpenEXR file: .*'focus.0012'.*delete it"):
        read_planes(tmp_path / "a.exr", ["focus.0012"])


@pytest.mark.parametrize("rows", [0, 3])
def test_a_file_that_is_cut_short_is_told(tmp_path, rows):
    write_planes(tmp_path / "a.exr", {"depth": np.ones((5, 70), np.float32)}, {})
    whole = (tmp_path / "a.exr").read_bytes()
    (tmp_path / "a.exr").write_bytes(whole[: len(whole) - (5 - rows) * 280])
    with pytest.raises(BadInput, match=r"a.exr is no whole OpenEXR file: .*delete it"):
        read_planes(tmp_path / "a.exr")


def test_infinite_depth_survives(tmp_path):
    write_planes(tmp_path / "a.exr", {"depth": np.array([[1.0, np.inf]])}, {})
    assert np.isinf(read_planes(tmp_path / "a.exr")[0]["depth"][0, 1])


def test_a_file_that_is_no_exr_is_told(tmp_path):
    (tmp_path / "a.exr").write_bytes(b"not an image")
    with pytest.raises(BadInput, match=r"a.exr is no whole OpenEXR file: .*delete it"):
        read_planes(tmp_path / "a.exr")
