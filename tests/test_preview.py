"""The contact sheet of a stack."""

import numpy as np
import pytest
from PIL import Image

from saf_gen.focal_stack import FocalStack, StackSpec
from saf_gen.optics import ImageDistance
from saf_gen.preview import write_preview


@pytest.mark.parametrize("whole", [True, False])
def test_a_preview_is_a_picture_of_the_stated_size(tmp_path, whole):
    drive = ImageDistance(0.025, 2.0, (0.6, 0.42))
    spec = StackSpec("plane", "0" * 64, ("lamp", "room"), drive, 20, 32, 60e-6, 5, 16, 4)
    random = np.random.default_rng(0)
    target = np.ones((20, 32), dtype=bool)
    target[:, :10] = whole
    depth = np.full((20, 32), 0.5, dtype=np.float32)
    stack = FocalStack(spec, random.random((2, 5, 20, 32), dtype=np.float32), depth, target, "llvm")
    write_preview(stack, tmp_path / "preview" / "plane.png")
    with Image.open(tmp_path / "preview" / "plane.png") as picture:
        assert picture.size == (1400, 640)
        assert np.asarray(picture.convert("L")).std() > 20
    assert [p.name for p in (tmp_path / "preview").iterdir()] == ["plane.png"]
