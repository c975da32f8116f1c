"""The thin lens, against its own equations."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from saf_gen.errors import BadInput
from saf_gen.optics import ImageDistance, sweep

LENS = ImageDistance(focal_length_m=0.035, f_number=2.0, focus_range_m=(0.9, 0.4))
PITCH = 20e-6


def test_every_position_obeys_the_lens_equation():
    p = np.linspace(0, 1, 11)
    assert 1 / LENS.image_distance(p) + 1 / LENS.object_distance(p) == pytest.approx(1 / 0.035, rel=1e-12)


def test_the_ends_of_the_travel_focus_where_the_card_says():
    assert LENS.object_distance(np.array([0.0, 1.0])) == pytest.approx([0.9, 0.4], rel=1e-12)


def test_position_is_linear_in_the_image_distance():
    v = LENS.image_distance(np.linspace(0, 1, 5))
    assert np.diff(v) == pytest.approx(np.diff(v)[0])
    assert LENS.position(v) == pytest.approx(np.linspace(0, 1, 5))


def test_blur_is_the_textbooks_and_vanishes_at_the_best_position():
    depth, p = 0.55, 0.2
    v, u = float(LENS.image_distance(p)), float(LENS.object_distance(p))
    assert float(LENS.blur_diameter(p, depth)) == pytest.approx(0.0175 * v * abs(1 / depth - 1 / u))
    assert float(LENS.blur_diameter(LENS.best_position(depth), depth)) == pytest.approx(0, abs=1e-15)


def test_the_truth_of_one_depth_is_its_best_position():
    assert LENS.truth(np.full(10, 0.6)) == pytest.approx(float(LENS.best_position(0.6)), rel=1e-12)


def test_the_truth_of_many_depths_minimises_the_mean_squared_blur():
    depths = np.linspace(0.5, 0.8, 40)
    found = minimize_scalar(
        lambda p: float(np.mean(LENS.blur_diameter(p, depths) ** 2)), bounds=(0, 1), method="bounded",
        options={"xatol": 1e-10},
    )  # fmt: skip
    assert LENS.truth(depths) == pytest.approx(found.x, abs=1e-7)


def test_blur_is_one_pixel_at_the_ends_of_the_depth_of_focus():
    low, high = LENS.depth_of_focus(np.full(4, 0.6), PITCH)
    assert low < LENS.truth(np.full(4, 0.6)) < high
    assert LENS.blur_diameter(np.array([low, high]), 0.6) == pytest.approx(PITCH, rel=1e-9)


def test_a_lens_that_cannot_focus_so_near_is_refused():
    with pytest.raises(
        BadInput, match=r"the lens of 35 mm cannot focus at 0.03 m; allowed: object distances"
    ):
        ImageDistance(0.035, 2.0, (0.9, 0.03))


def test_a_lens_that_does_not_move_is_refused():
    with pytest.raises(BadInput, match="both ends focus at 0.5 m"):
        ImageDistance(0.035, 2.0, (0.5, 0.5))


def test_a_sweep_passes_the_travel_once_at_constant_speed():
    p = sweep(8)
    assert p == pytest.approx((np.arange(8) + 0.5) / 8)
