"""The skewness of focus curves, on curves whose sides are known."""

import numpy as np
import pytest
from PIL import Image

from studies.skewness import HEIGHTS, gradient_energy, measure_stack, model_rows, shipped_curves, skewness

FOCUS = np.arange(-20, 21.0)


def bell(*, left, right, peak=0.0, floor=0.2):
    """A curve whose halves are those of normal curves with these standard deviations, in steps."""
    away = FOCUS - peak
    return floor + np.exp(-((away / np.where(away < 0, left, right)) ** 2) / 2)


@pytest.mark.parametrize(("left", "right"), [(5.0, 5.0), (4.0, 6.0), (6.0, 4.0), (5.0, 5.5)])
def test_the_sides_of_a_curve_are_compared(left, right):
    """(right - left)/(right + left) at every height, less what the vertex of the parabola gives away: up to 0.06."""
    expected = (right - left) / (right + left)
    assert skewness(bell(left=left, right=right)) == pytest.approx([expected] * len(HEIGHTS), abs=0.06)


def test_a_bell_between_two_pictures_is_symmetric():
    """Its vertex is found between them; what is left is the error of straight lines between pictures."""
    for peak in (0.0, 0.25, 0.5):
        assert skewness(bell(left=5, right=5, peak=peak)) == pytest.approx(0, abs=0.02)


@pytest.mark.parametrize(
    "curve", [np.ones(41), np.linspace(1, 3, 41), bell(left=5, right=5, floor=5.0), bell(left=5, right=40)]
)
def test_curves_without_a_peak_or_a_side_are_left_out(curve):
    assert skewness(curve) is None


def test_a_stack_of_pictures_is_measured(tmp_path):
    """A texture that is blurred more on one side than on the other: 20 pictures, seed 5."""
    rng = np.random.default_rng(5)
    texture = rng.uniform(0.2, 0.8, (48, 48))
    for n, share in enumerate(bell(left=2.0, right=4.0, floor=0.1)[13:33]):
        Image.fromarray((255 * (0.5 + share / 1.3 * (texture - 0.5))).astype(np.uint8)).save(tmp_path / f"{n:02d}.png")
    (row, *_) = measure_stack(tmp_path)
    assert row.places == 4
    assert (row.quartiles[:, 1] > 0.1).all()
    assert gradient_energy(np.ones((5, 5))).max() == 0


@pytest.mark.slow
def test_depths_that_differ_make_a_curve_as_skew_as_real_boxes_and_third_order_aberrations_do_not():
    found = {row.name: np.abs(row.quartiles[:, 1]).max() for row in model_rows()}
    lens = [skew for name, skew in found.items() if name.startswith(("f/2", "microscope"))]
    assert max(lens) < 0.07
    assert found["two depths, 3 apart, a quarter of the texture behind"] > 0.14
    assert found["one depth"] < 0.005


@pytest.mark.slow
def test_a_fast_real_lens_is_skew_off_its_axis_and_not_when_stopped_down():
    found = {name: np.abs(skewness(curve)).max() for name, curve in shipped_curves() if name.startswith("double_gauss")}
    assert found["double_gauss, f/1.85, 0 mm off the axis"] < 0.01
    assert found["double_gauss, f/1.85, 12 mm off the axis"] > 0.18
    assert max(skew for name, skew in found.items() if "f/3.7" in name) < 0.01
