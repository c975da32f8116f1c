"""Cards and drives of fitted lenses."""

import json

import numpy as np
import pytest
from pydantic import TypeAdapter
from refusals import assert_says, refusal

from saf_gen.optics import FittedLensDrive, FocusCriterion, ImageDistanceDrive, drive_from_dict
from saf_gen.optics.lens_card import LensCard

PITCH_M = 20e-6


def card(**changes):
    data = {"file": "double_gauss", "f_number": 2.0, "focus_range_m": [2.0, 0.6]}
    return TypeAdapter(LensCard).validate_python({**data, **changes})


CARDS = {
    "wider than fitted": ({"f_number": 1.4}, "1.4 | f/1.8"),
    "nearer than fitted": ({"focus_range_m": [2.0, 0.3]}, "0.3 m | 0.4 m or more"),
    "light that was not fitted": ({"wave_nm": 850.0}, "850 nm | 430 to 700 nm"),
    "no travel": ({"focus_range_m": [1.0, 1.0]}, "does not move"),
    "unknown lens": ({"file": "double_gaus"}, "double_gaus | did you mean 'double_gauss'"),
}


@pytest.mark.parametrize("what", CARDS)
def test_a_card_that_asks_for_more_than_was_fitted_is_refused(what):
    changes, fragments = CARDS[what]
    error = refusal(lambda: card(**changes).build_drive())
    assert_says(error, fragments.replace("f/1.8", "1.85"))


@pytest.mark.parametrize(
    "changes",
    [{"drive": "focal_length"}, {"drive": "stage"}, {"aberrations": {"spherical": 1.0}}, {"focal_length_mm": 50.0},
     {"file": "../double_gauss.yaml"}, {"file": "/tmp/a.yaml"}],
)  # fmt: skip
def test_a_fitted_lens_takes_no_drive_that_changes_it_and_no_other_aberrations(changes):
    with pytest.raises(ValueError, match=r"image_distance|brings its own|not permitted|folder"):
        card(**changes)


def test_a_drive_of_a_fitted_lens_survives_json():
    drive = card(wave_nm=600.0).build_drive()
    assert drive_from_dict(json.loads(json.dumps(drive.as_dict()))) == drive


def test_with_both_pupils_together_the_drive_is_that_of_a_thin_lens():
    thin = ImageDistanceDrive(0.05, 2.0, (0.55, 0.45))
    fitted = FittedLensDrive(0.05, 2.0, (0.55, 0.45), 1.0)
    p, depths = np.linspace(-0.2, 1.2, 8), np.array([0.4, 0.5, 0.6])
    for name in ("image_distance", "object_distance", "ray_transfer"):
        assert getattr(fitted, name)(p) == pytest.approx(getattr(thin, name)(p), rel=1e-12)
    assert fitted.best_position(depths) == pytest.approx(thin.best_position(depths), rel=1e-9)
    assert fitted.least_blur(depths) == pytest.approx(thin.least_blur(depths), rel=1e-9)
    assert fitted.depth_of_focus(0.5, PITCH_M) == pytest.approx(thin.depth_of_focus(0.5, PITCH_M), rel=1e-9)


@pytest.mark.parametrize("magnification", [0.7, 1.0, 1.4])
def test_a_sharp_point_stays_a_point_and_the_blur_is_the_closed_form(magnification):
    drive = FittedLensDrive(0.05, 2.0, (0.55, 0.45), magnification)
    position = float(drive.best_position(0.5))
    assert drive.blur_diameter(position, 0.5) == pytest.approx(0, abs=1e-12)
    low, high = drive.depth_of_focus(position, PITCH_M)
    assert drive.blur_diameter(np.array([low, high]), 0.5) == pytest.approx([PITCH_M] * 2, rel=0.02)
    assert drive.least_blur(np.full(4, 0.5)) == pytest.approx(position)


def test_a_sensor_beyond_the_fit_is_refused():
    drive = card().build_drive()
    assert_says(refusal(FocusCriterion(drive, PITCH_M).check, 1000, 1000), "14.1 mm | at most 12 mm | --height-mm")
    FocusCriterion(drive, PITCH_M, 550e-9).check(250, 400)
    assert_says(refusal(FocusCriterion(drive, 2e-6).check, 250, 400), "pixels | --degree")
