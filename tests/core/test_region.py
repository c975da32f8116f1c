"""Windows, regions, the box round the target, and the check of arrays."""

import numpy as np
import pytest
from refusals import assert_says, refusal

from saf_gen.core.region import REGIONS, bounding_box, place_box, validate_region, validate_window
from saf_gen.core.signals import validate_signal
from saf_gen.errors import BadInput


def mask(rows, columns, *pixels):
    out = np.zeros((rows, columns), dtype=bool)
    for row, column in pixels:
        out[row, column] = True
    return out


def test_the_box_holds_every_target_pixel_and_touches_them():
    assert bounding_box(mask(10, 20, (2, 5), (7, 3))) == (slice(2, 8), slice(3, 6))
    assert_says(refusal(bounding_box, mask(4, 4)), "0 pixels | at least one pixel")


def test_a_window_comes_back_in_plain_numbers():
    assert validate_window(np.int64(3), np.uint8(7), total=7) == range(3, 7)


@pytest.mark.parametrize("window", [(0, 0), (5, 5), (6, 5), (-1, 4), (0, 101), (0.0, 4), (0, 4.5), (None, 4)])
def test_a_window_that_is_empty_outside_or_fractional_is_refused(window):
    first, stop = window
    message = f"a.h5: bytes {first} to {stop} were asked for; allowed: whole numbers, 0 <= first < stop <= 100"
    with pytest.raises(BadInput, match=message):
        validate_window(first, stop, total=100, what="bytes", where="a.h5")


def test_open_ends_of_a_region_are_filled_in():
    assert validate_region(None, (4, 6)) == (slice(0, 4), slice(0, 6))
    assert validate_region((slice(1, None), slice(None, 3)), (4, 6)) == (slice(1, 4), slice(0, 3))


@pytest.mark.parametrize(
    "region",
    [(slice(5, 5), slice(None)), (slice(None), slice(9, 12)), (slice(-2, None), slice(None)), (slice(0, 4, 2),) * 2],
)
def test_a_region_that_is_empty_outside_or_with_gaps_is_refused(region):
    with pytest.raises(BadInput, match=r"the region's (rows|columns) are slice\(.*; allowed: .*, step 1"):
        validate_region(region, (6, 9))


def test_values_are_kept_and_the_dtype_is_the_tables():
    out = validate_signal("charge", np.ones((2, 3, 4), dtype=np.float64))
    assert out.dtype == np.float32
    assert out.flags.c_contiguous


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (np.ones((3, 4)), "charge has shape (3, 4) | 3 axes (focus, row, col)"),
        (np.full((1, 1, 1), np.nan), "charge holds values that are not finite"),
        (np.array([[["a"]]]), "charge has dtype <U1 | numbers"),
    ],
)
def test_an_array_that_does_not_fit_is_refused(array, message):
    assert_says(refusal(validate_signal, "charge", array), message)


@pytest.mark.parametrize(
    ("region", "box", "expected"),
    [  # first and last row and column, in a frame of 40 × 100
        ("target", (10, 20, 30, 50), (10, 20, 30, 50)),
        ("shifted", (10, 20, 30, 50), (10, 20, 40, 60)),
        ("shifted", (10, 20, 60, 80), (10, 20, 50, 70)),
        ("shifted", (10, 20, 5, 95), (10, 20, 10, 100)),  # as far as the frame reaches
        ("shifted", (0, 40, 0, 100), (0, 40, 0, 100)),
        ("half", (10, 20, 30, 50), (12, 17, 35, 45)),
        ("half", (5, 6, 7, 8), (5, 6, 7, 8)),  # one pixel stays one
        ("half", (5, 8, 7, 9), (5, 7, 7, 8)),
        ("double", (10, 20, 30, 50), (5, 25, 20, 60)),
        ("double", (0, 20, 90, 100), (0, 30, 85, 100)),  # cut off
        ("double", (0, 40, 0, 100), (0, 40, 0, 100)),
        ("centre", (0, 1, 0, 1), (10, 30, 25, 75)),
    ],
)
def test_a_box_of_another_size_or_place_stays_inside_the_frame(region, box, expected):
    rows, columns = place_box(region, (slice(*box[:2]), slice(*box[2:])), size=(40, 100))
    assert (rows.start, rows.stop, columns.start, columns.stop) == expected


@pytest.mark.parametrize("region", [region for region in REGIONS if region not in ("frame", "inside")])
def test_a_frame_of_one_pixel_has_every_box(region):
    whole = slice(0, 1), slice(0, 1)
    assert place_box(region, whole, size=(1, 1)) == whole
