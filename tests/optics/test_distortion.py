"""Distortion: the gradient of Seidel's fifth sum, and what a card may state."""

import numpy as np
import pytest
from refusals import refusal
from test_vignetting import find_lens

from saf_gen.optics import Distortion, FocusCriterion, ImageDistanceDrive, Stage, drive_from_dict
from saf_gen.optics.typical_aberrations import with_typical_aberrations

V, H, R, SHARE = 0.055, 0.006, 0.0125, 0.04


def test_the_turn_is_the_gradient_of_seidels_fifth_sum_whatever_the_point_of_the_aperture():
    """W = W311·(η·η)(η·ρ) with W311 = D·R·h/v, by central differences over the aperture."""
    x, step = np.array([0.004, -0.003]), 1e-6

    def path(a):
        eta, rho = x / H, np.asarray(a) / R
        return SHARE * R * H / V * (eta @ eta) * (eta @ rho)

    for a in (np.zeros(2), np.array([0.01, 0.002])):
        gradient = [(path(a + step * unit) - path(a - step * unit)) / (2 * step) for unit in np.eye(2)]
        assert Distortion(SHARE, H, V).turn(tuple(-x / V)) == pytest.approx(gradient, rel=1e-6)


@pytest.mark.parametrize("share", [0.1, 0.3, 0.33, 0.34, 0.5, -0.5])
def test_a_picture_folds_where_its_scale_turns_round(share):
    slope = np.linspace(0, H / V, 1_001)
    straight = slope + np.array(Distortion(share, H, V).turn((slope, 0 * slope)))[0]
    assert Distortion(share, H, V).folds(H / V) == (np.diff(straight).min() < 0)


def test_a_card_states_distortion_in_percent(tmp_path, monkeypatch):
    drive = find_lens(tmp_path, monkeypatch, "aberrations: {distortion: -2.5, height_mm: 5}")
    assert drive.wavefront is None
    assert drive.distortion == Distortion(-0.025, 0.005, float(drive.image_distance(0.5)))
    assert drive_from_dict(drive.as_dict()) == drive
    bare = with_typical_aberrations(FocusCriterion(drive, 2e-5), "none", rows=250, columns=400)
    assert "distortion" not in bare.as_dict()


@pytest.mark.parametrize(
    ("keys", "problem", "expected"),
    [
        ("distortion: 2", "lens.aberrations", "distortion needs height_mm"),
        ("distortion: 30, height_mm: 5", "lens.aberrations.distortion is 30", "20"),
        ("distortion: -30, height_mm: 5", "lens.aberrations.distortion is -30", "-20"),
        ("distortion: barrel, height_mm: 5", "lens.aberrations.distortion is 'barrel'", "number"),
        ("distortion: 2 %, height_mm: 5", "lens.aberrations.distortion is '2 %'", "number"),
        ("distortion: [2, 1], height_mm: 5", "lens.aberrations.distortion is [2, 1]", "number"),
        ("distortion: .inf, height_mm: 5", "lens.aberrations.distortion is inf", "finite"),
        ("distorsion: 2, height_mm: 5", "unknown key 'distorsion' in lens.aberrations", "distortion"),
        ("distortion: 2, height_mm: 0", "lens.aberrations.height_mm is 0", "0"),
        ("distortion: 2, height: 5", "unknown key 'height' in lens.aberrations", "height_mm"),
    ],
)
def test_a_distortion_that_cannot_be_is_refused(tmp_path, monkeypatch, keys, problem, expected):
    error = refusal(find_lens, tmp_path, monkeypatch, f"aberrations: {{{keys}}}")
    assert "\n" not in str(error)
    assert error.problem.startswith(problem)
    assert expected in str(error)


@pytest.mark.parametrize(
    ("drive", "message"),
    [
        (Stage(0.05, 2.0, 0.1, (-0.02, 0.02), distortion=Distortion(0.02, 4e-3, 0.055)), "not built for a stage"),
        (
            ImageDistanceDrive(0.05, 2.0, (0.55, 0.45), distortion=Distortion(0.2, 2e-3, 0.0556)),
            "distortion is 20 percent, which folds the corner of the picture over itself; allowed: below 5.8",
        ),
    ],
)
def test_a_distortion_that_the_model_does_not_hold_for_is_refused(drive, message):
    assert message in str(refusal(FocusCriterion(drive, 2e-5).check, rows=250, columns=400))
