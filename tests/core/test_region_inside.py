"""The largest rectangle inside a target: against a slow readable twin, and in shapes whose answer is known."""

from itertools import product

import numpy as np
import pytest

from saf_gen.core.region import MARGIN, MIN_SIDE, inside_box

SIZE = (36, 40)


def bounds(box):
    return None if box is None else (box[0].start, box[0].stop, box[1].start, box[1].stop)


def slow_inside(target):
    """Try every rectangle: all pixels up to MARGIN away, in the frame, must belong to the target."""
    rows, columns = target.shape
    found = []
    for top, left in product(range(MARGIN, rows), range(MARGIN, columns)):
        for bottom, right in product(range(top + MIN_SIDE, rows + 1), range(left + MIN_SIDE, columns + 1)):
            grown = (slice(top - MARGIN, bottom + MARGIN), slice(left - MARGIN, right + MARGIN))
            if bottom + MARGIN <= rows and right + MARGIN <= columns and target[grown].all():
                tall, wide = bottom - top, right - left
                found.append((-tall * wide, top, left, -tall, (top, bottom, left, right)))
    return min(found)[-1] if found else None


def test_the_fast_search_finds_what_trying_every_rectangle_finds():
    """60 masks (seed 68) of 36 × 40 pixels with up to three holes and ragged corners; equality is exact."""
    random = np.random.default_rng(68)
    found = []
    for n in range(60):
        target = np.ones(SIZE, bool)
        for _ in range(n % 4):
            target[tuple(random.integers(0, SIZE))] = False
        if n % 3:
            corner = random.integers(0, 9, 2)
            target[: corner[0], SIZE[1] - corner[1] :] = False
        found.append(bounds(inside_box(target)))
        assert found[-1] == slow_inside(target), n
    assert 10 < sum(box is None for box in found) < 50


@pytest.mark.parametrize("edge", [0, 1, 10])
def test_a_full_rectangle_keeps_all_but_its_margin_also_at_the_edge_of_the_frame(edge):
    target = np.zeros((60 + 2 * edge, 90 + 2 * edge), bool)
    target[edge : edge + 60, edge : edge + 90] = True
    assert bounds(inside_box(target)) == (edge + MARGIN, edge + 60 - MARGIN, edge + MARGIN, edge + 90 - MARGIN)


@pytest.mark.parametrize("radius", [21.0, 24.5, 30.0, 50.0])
def test_the_rectangle_in_a_disc_is_the_largest_whose_grown_corners_touch_it(radius):
    y, x = np.mgrid[-55:56, -55:56]
    halves = [
        ((2 * a + 1) * (2 * b + 1), a, b)
        for a, b in product(range(56), repeat=2)
        if (a + MARGIN) ** 2 + (b + MARGIN) ** 2 <= radius**2 and 2 * min(a, b) + 1 >= MIN_SIDE
    ]
    box = inside_box(y**2 + x**2 <= radius**2)
    assert (0 if box is None else (box[0].stop - box[0].start) * (box[1].stop - box[1].start)) == max(
        halves, default=(0,)
    )[0]


@pytest.mark.parametrize(("rows", "columns", "there"), [(30, 30, True), (29, 200, False), (200, 29, False)])
def test_no_side_is_shorter_than_its_limit_however_large_the_area(rows, columns, there):
    target = np.zeros((220, 220), bool)
    target[10 : 10 + rows, 10 : 10 + columns] = True
    assert (inside_box(target) is not None) == there
    target[10:40, 10:40] = True
    assert bounds(inside_box(target)) == (13, 37, 13, 37)


def test_of_equal_rectangles_the_topmost_and_then_the_leftmost_is_taken():
    target = np.zeros((100, 100), bool)
    for top, left in ((50, 0), (10, 60), (10, 5)):
        target[top : top + 30, left : left + 30] = True
    assert bounds(inside_box(target)) == (13, 37, 8, 32)


def test_of_equal_rectangles_with_one_corner_the_tallest_is_taken():
    target = np.zeros((100, 100), bool)
    target[:30, :54] = target[:54, :30] = True
    assert bounds(inside_box(target)) == (3, 51, 3, 27)


@pytest.mark.parametrize("target", [np.zeros((50, 50), bool), np.ones((1, 1), bool), np.ones((5, 300), bool)])
def test_an_empty_or_narrow_mask_has_none(target):
    assert inside_box(target) is None
