"""A ring in front of the lens: the overlap of two discs, against sums over the aperture."""

import math

import numpy as np
import pytest
from refusals import refusal

from saf_gen.optics import FocalLengthDrive, FocusCriterion, ImageDistanceDrive, Ring, Stage, Wavefront, drive_from_dict
from saf_gen.optics.vignetting import overlap_of_discs
from saf_gen.scene.scene_folder import find_scene

V, U, R = 0.055, 0.5, 0.0125


@pytest.mark.parametrize(
    ("one", "other", "apart", "area"),
    [
        (1, 1, 0, math.pi),
        (2, 1, 0.5, math.pi),
        (1, 2, 1, math.pi),
        (1, 1, 2, 0),
        (1, 3, 9, 0),
        (1, 1, 1, 2 * math.pi / 3 - math.sqrt(3) / 2),
        (math.sqrt(2), 1, 1, math.pi - 1),  # a half disc and a segment of a quarter circle
    ],
)
def test_the_overlap_of_two_discs_is_that_of_geometry(one, other, apart, area):
    assert overlap_of_discs(one, other, distance=apart) == pytest.approx(area, abs=1e-12)
    assert overlap_of_discs(other, one, distance=apart) == pytest.approx(area, abs=1e-12)


@pytest.mark.parametrize(("radius", "distance"), [(0.014, 0.03), (0.012, 0.02), (0.01, 0.1), (0.05, 0.02)])
def test_the_relative_illumination_is_the_share_of_straight_lines_that_pass_the_ring(radius, distance):
    """Lines from points of the aperture to the point in focus, cut with the plane of the ring by similar triangles."""
    side = (np.arange(1_000) + 0.5) / 500 - 1
    a = R * np.stack(np.meshgrid(side, side)).reshape(2, -1)
    a = a[:, np.hypot(*a) <= R]
    heights = np.array([0, 2e-3, 5e-3, 9e-3])
    shares = []
    for height in heights:
        focus = np.array([[-height / V * U], [0.0]])  # the point of the scene that is seen at (height, 0)
        crossed = a + (focus - a) * distance / U
        shares.append(np.mean(np.hypot(*crossed) <= radius))
    found = Ring(radius, distance).relative_illumination(
        heights, aperture_radius_m=R, image_distance_m=V, object_distance_m=U
    )
    assert found == pytest.approx(shares, abs=1e-3)


@pytest.mark.parametrize("kind", [ImageDistanceDrive, FocalLengthDrive])
def test_a_lens_with_ring_and_glare_survives_a_round_trip_and_others_are_described_as_before(kind):
    plain = kind(0.05, 2.0, (0.55, 0.45))
    assert set(plain.as_dict()).isdisjoint({"ring", "veiling_glare", "wavefront"})
    lens = kind(0.05, 2.0, (0.55, 0.45), ring=Ring(0.014, 0.03), veiling_glare=0.02)
    assert drive_from_dict(lens.as_dict()) == lens
    assert FocusCriterion(lens, 2e-5).true_focus(np.full((2, 2), 0.5), np.ones((2, 2), bool)) == float(
        plain.best_position(0.5)
    )


# --- cards -------------------------------------------------------------------------------------------

LENS = "focal_length_mm: 50, f_number: 2, focus_range_m: [0.55, 0.45]"


def find_lens(folder, monkeypatch, keys):
    """Find a scene whose lens has these keys, and return its drive."""
    scene = folder / "made"
    scene.mkdir()
    (scene / "scene.yaml").write_text(
        "id: made\ntitle: Made\nlicence: Apache-2.0\nsource: here\n"
        "camera: {origin_m: [0, 0, -1], look_at_m: [0, 0, 0]}\n"
        f"lens: {{{LENS}, {keys}}}\nlights: {{lamp: [lamp]}}\ntarget: [lamp]\n"
    )
    (scene / "scene.py").write_text("def build(params):\n    return {}\n")
    monkeypatch.setenv("SAF_GEN_SCENES", str(folder))
    return find_scene("made").build_drive()


def test_a_card_states_ring_and_glare(tmp_path, monkeypatch):
    drive = find_lens(tmp_path, monkeypatch, "vignetting: {radius_mm: 14, distance_mm: 30}, veiling_glare: 0.02")
    assert (drive.ring, drive.veiling_glare) == (Ring(0.014, 0.03), 0.02)


@pytest.mark.parametrize(
    ("keys", "problem", "expected"),
    [
        ("veiling_glare: 2", "lens.veiling_glare is 2", "0.5"),
        ("veiling_glare: -0.01", "lens.veiling_glare is -0.01", "0"),
        ("veiling_glare: 2 %", "lens.veiling_glare is '2 %'", "number"),
        ("veiling_glare: .nan", "lens.veiling_glare is nan", ""),
        ("veiling_glare: {share: 0.1}", "lens.veiling_glare is {'share': 0.1}", "number"),
        ("veiling_glair: 0.1", "unknown key 'veiling_glair' in lens", "veiling_glare"),
        ("vignetting: 0.3", "lens.vignetting is 0.3", "radius_mm"),
        ("vignetting: {radius_mm: 14}", "the key 'lens.vignetting.distance_mm' is missing", ""),
        ("vignetting: {radius_mm: 14, distance_mm: 0}", "lens.vignetting.distance_mm is 0", "0"),
        ("vignetting: {radius_mm: -14, distance_mm: 3}", "lens.vignetting.radius_mm is -14", "0"),
        ("vignetting: {radius_m: 0.014, distance_mm: 30}", "unknown key 'radius_m' in lens.vignetting", "radius_mm"),
        ("vignetting: [14, 30]", "lens.vignetting is [14, 30]", "radius_mm"),
    ],
)
def test_a_card_with_a_ring_or_glare_that_cannot_be_is_refused(tmp_path, monkeypatch, keys, problem, expected):
    error = refusal(find_lens, tmp_path, monkeypatch, keys)
    assert "\n" not in str(error)
    assert error.problem == problem
    assert expected in str(error)


PLAIN = {"focal_length_m": 0.05, "f_number": 2.0, "focus_range_m": (0.55, 0.45)}


@pytest.mark.parametrize(
    ("drive", "message"),
    [
        (Stage(0.05, 2.0, 0.1, (-0.02, 0.02), ring=Ring(0.014, 0.03)), "not built for a stage"),
        (ImageDistanceDrive(**PLAIN, ring=Ring(0.014, 0.03), wavefront=Wavefront(1e-6)), "not built together"),
        (ImageDistanceDrive(**{**PLAIN, "f_number": 40.0}, ring=Ring(0.014, 0.03)), "waves spread a point"),
        (ImageDistanceDrive(**PLAIN, ring=Ring(0.014, 0.46)), "distance_mm is 460; allowed: nearer than"),
        (ImageDistanceDrive(**PLAIN, ring=Ring(0.002, 0.3)), "no light in the corner of the picture: radius_mm is 2"),
    ],
)
def test_a_ring_that_the_model_does_not_hold_for_is_refused(drive, message):
    error = refusal(FocusCriterion(drive, 2e-5, 555e-9).check, rows=250, columns=400)
    assert message in str(error)
    assert "\n" not in str(error)
