"""The box round the target."""

import numpy as np
import pytest

from saf_gen.errors import BadInput
from saf_gen.region import target_box


def mask(rows, columns, *pixels):
    out = np.zeros((rows, columns), dtype=bool)
    for row, column in pixels:
        out[row, column] = True
    return out


def test_the_box_holds_every_target_pixel_and_touches_them():
    assert target_box(mask(10, 20, (2, 5), (7, 3))) == (slice(2, 8), slice(3, 6))


def test_a_margin_is_cut_at_the_frame():
    assert target_box(mask(10, 20, (1, 19)), margin=3) == (slice(0, 5), slice(16, 20))


def test_a_mask_without_a_pixel_is_refused():
    with pytest.raises(
        BadInput, match="marks 0 pixels; allowed: .* at least one pixel marked; use the whole frame"
    ):
        target_box(mask(4, 4))


def test_a_negative_margin_is_refused():
    with pytest.raises(BadInput, match="margin -1; allowed: 0 or more pixels"):
        target_box(mask(4, 4, (0, 0)), margin=-1)
