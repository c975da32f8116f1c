"""Aberrations of a lens: the wavefront, the card that states it, and the focus that it moves."""

import json
from dataclasses import replace

import numpy as np
import pytest
from refusals import refusal

from saf_gen.errors import BadInput
from saf_gen.optics import FocalLengthDrive, FocusCriterion, ImageDistanceDrive, Stage, Wavefront, drive_from_dict
from saf_gen.optics.best_focus import image_heights
from saf_gen.optics.lens_card import ImageDistanceLens
from saf_gen.optics.texture_contrast import Imaging, squared_contrast
from saf_gen.optics.typical_aberrations import with_typical_aberrations
from studies.laws.pupils import pupil_transfer, seidel

WAVE_M, PITCH_M = 555e-9, 20e-6
MACRO = ImageDistanceDrive(0.05, 2.0, (0.55, 0.45))
LIQUID = FocalLengthDrive(0.055, 2.2, (0.55, 0.45))
OBJECTIVE = Stage(0.009, 1.0, 20, (-60e-6, 60e-6))
DRIVES = {"image_distance": MACRO, "focal_length": LIQUID, "stage": OBJECTIVE}
every_drive = pytest.mark.parametrize("drive", DRIVES.values(), ids=DRIVES)
SHAPE = (25, 41)
HERE = np.zeros(SHAPE, bool)
HERE[8:17, 12:30] = True


def aberrated(drive, *, height_m=4.7e-3, **waves):
    """The drive with aberrations in wavelengths of 555 nm at the edge of its aperture."""
    paths = {f"{name}_m": amount * WAVE_M for name, amount in waves.items()}
    return replace(drive, wavefront=Wavefront(**paths, radius_m=drive.aperture_radius_m, height_m=height_m))


def half_depth(drive, focused, *, wave_m=WAVE_M, pitch_m=PITCH_M):
    low, high = drive.depth_of_focus(focused, pitch_m, wavelength_m=wave_m)
    return (high - low) / 2


def test_rays_are_perpendicular_to_the_waves():
    """The slope is the gradient of the path, by central differences in double precision, at 200 points (seed 3)."""
    rng = np.random.default_rng(3)
    wavefront = Wavefront(3e-7, -2e-7, 5e-7, 1e-7, 0.0125, 4e-3)
    a, x = rng.uniform(-0.012, 0.012, (2, 200)), rng.uniform(-4e-3, 4e-3, (2, 200))
    step, found = 1e-6, wavefront.slope(tuple(a), tuple(x))
    for axis in (0, 1):
        to = np.zeros((2, 1))
        to[axis] = step
        rise = wavefront.path(tuple(a + to), tuple(x)) - wavefront.path(tuple(a - to), tuple(x))
        assert found[axis] == pytest.approx(rise / (2 * step), rel=1e-6, abs=1e-12)


def test_the_path_is_seidels_sum():
    wavefront = Wavefront(3e-7, -2e-7, 5e-7, 1e-7, 0.0125, 4e-3)
    eta, rho = (0.6, -0.3), (0.2, 0.7)
    waves = seidel(spherical=3e-7, coma=-2e-7, astigmatism=5e-7, field_curvature=1e-7, eta=eta)(*rho)
    a, x = tuple(0.0125 * part for part in rho), tuple(4e-3 * part for part in eta)
    assert wavefront.path(a, x) == pytest.approx(waves, rel=1e-12)


@every_drive
def test_spherical_aberration_moves_the_least_blur_by_four_thirds(drive):
    """⟨|∇(W040·ρ⁴ + W020·ρ²)|²⟩ is least for W020 = -4/3·W040; the points of the lens give it within 0.5 %."""
    lens = aberrated(drive, spherical=0.5)
    depth = np.full(SHAPE, float(drive.focus_depth(0.5)))
    moved = FocusCriterion(lens, PITCH_M, WAVE_M).least_blur(depth, HERE)
    defocus = float(lens.defocus(moved, depth[0, 0])) * drive.aperture_radius_m**2 / 2
    assert defocus / WAVE_M == pytest.approx(-4 / 3 * 0.5, rel=5e-3)


def test_field_curvature_and_astigmatism_move_the_corner_alone():
    """The circle of least confusion is at W020 = -(W220 + W222/2)·η²; the middle moves by at most 1e-3 half depths."""
    lens = aberrated(LIQUID, height_m=image_heights(SHAPE, PITCH_M)[0, 0], field_curvature=1.5, astigmatism=1.0)
    depth = np.full(SHAPE, 0.5)
    best = FocusCriterion(lens, PITCH_M, WAVE_M).best_position(depth)
    middle, corner = best[SHAPE[0] // 2, SHAPE[1] // 2], best[0, 0]
    plain = float(LIQUID.best_position(0.5))
    half = half_depth(LIQUID, plain)
    assert abs(middle - plain) < 1e-3 * half
    defocus = float(lens.defocus(corner, 0.5)) * lens.aperture_radius_m**2 / 2 / WAVE_M
    assert defocus == pytest.approx(-(1.5 + 0.5), rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("wave_m", [WAVE_M, 0.0])
@pytest.mark.parametrize("f_number", [1.4, 2.0, 4.0])
def test_contrast_is_greatest_where_the_pupil_says(f_number, wave_m):
    """The truth against a sum over the pupil, along one direction: within 0.02 half depths of focus.

    Rays alone are waves of a fiftieth of the length.
    """
    drive = ImageDistanceDrive(0.05, f_number, (0.55, 0.45))
    lens, length_m = aberrated(drive, spherical=1.0), wave_m or WAVE_M / 50
    depth = np.full(SHAPE, 0.5)
    found = FocusCriterion(lens, PITCH_M, wave_m).true_focus(depth, HERE)
    v, radius = float(drive.image_distance(0.5)), drive.aperture_radius_m
    cycles = np.geomspace(1 / 64, 0.5, 33)

    def contrast(position):
        defocus = float(lens.defocus(position, 0.5)) * radius**2 / 2
        waves = seidel(spherical=WAVE_M / length_m, defocus=defocus / length_m)
        fractions = cycles / PITCH_M * length_m * v / (2 * radius)
        transfer = np.abs(pupil_transfer(waves, fractions=fractions)) ** 2
        return -float(np.sum(transfer * np.sinc(cycles) ** 2))

    plain = drive.least_blur(depth[HERE])
    half = half_depth(drive, plain, wave_m=wave_m)
    near = found + np.linspace(-0.3, 0.3, 7) * half
    curve = np.polynomial.Polynomial.fit(near, [contrast(p) for p in near], 2)
    assert abs(float(curve.deriv().roots()[0]) - found) < 0.02 * half
    assert found > plain + 0.1 * half


def test_waves_part_the_truth_from_the_least_blur():
    """A microscope with half a wave: contrast is greatest at -1.6 half depths of focus, blur least at -2.0."""
    lens = aberrated(OBJECTIVE, spherical=0.5)
    criterion = FocusCriterion(lens, PITCH_M, WAVE_M)
    depth = np.full(SHAPE, float(OBJECTIVE.focus_depth(0.5)))
    half = half_depth(OBJECTIVE, 0.5)
    assert (criterion.true_focus(depth, HERE) - 0.5) / half == pytest.approx(-1.64, abs=0.05)
    assert (criterion.least_blur(depth, HERE) - 0.5) / half == pytest.approx(-2.02, abs=0.03)


@every_drive
def test_a_weak_aberration_leaves_the_truth_of_a_deep_target_where_it_was(drive):
    """A thousandth of a wave moves it by less than 2 % of a half depth, over a target that is tilted by a half depth.

    Contrast and mean blur weigh the depths of a target differently, but alike on both sides of an even tilt.
    """
    half = half_depth(drive, 0.5)
    ends = drive.focus_depth(np.array([0.5 - half / 2, 0.5 + half / 2]))
    depth = np.tile(np.linspace(*ends, SHAPE[1]), (SHAPE[0], 1))
    target = np.ones(SHAPE, bool)
    lens = aberrated(drive, spherical=1e-3)
    found = FocusCriterion(lens, PITCH_M, WAVE_M).true_focus(depth, target)
    assert abs(found - FocusCriterion(drive, PITCH_M, WAVE_M).true_focus(depth, target)) < 0.02 * half


@every_drive
def test_a_perfect_lens_has_the_truth_of_the_closed_form(drive):
    depth = np.linspace(*drive.focusing_range_m, HERE.size).reshape(SHAPE)
    criterion = FocusCriterion(drive, PITCH_M, WAVE_M)
    assert criterion.true_focus(depth, HERE) == drive.least_blur(depth[HERE]) == criterion.least_blur(depth, HERE)
    assert np.array_equal(criterion.best_position(depth), drive.best_position(depth))
    assert "wavefront" not in drive.as_dict()


@every_drive
def test_a_lens_with_aberrations_is_stored_and_read(drive):
    lens = aberrated(drive, spherical=0.2, coma=-0.1)
    assert drive_from_dict(json.loads(json.dumps(lens.as_dict()))) == lens


def test_a_lens_that_is_stopped_down_keeps_its_waves():
    """At twice the f-number, W040 at the edge of the aperture is a sixteenth."""
    card = ImageDistanceLens(
        f_number=2.0,
        focal_length_mm=50,
        focus_range_m=(0.55, 0.45),
        aberrations={"spherical": 1.6, "wave_nm": 500, "coma": 0.8, "height_mm": 4.0},
    )
    for f_number, share in ((None, 1.0), (4.0, 1 / 16)):
        drive = card.build_drive(f_number)
        edge = (drive.aperture_radius_m, 0.0)
        assert drive.wavefront.path(edge, (0.0, 0.0)) == pytest.approx(1.6 * 500e-9 * share, rel=1e-12)
    assert drive.wavefront.height_m == 4e-3
    perfect = replace(drive, wavefront=None)
    assert (
        ImageDistanceLens(
            f_number=4.0, focal_length_mm=50, focus_range_m=(0.55, 0.45), aberrations={"spherical": 0.0}
        ).build_drive()
        == perfect
    )


@pytest.mark.parametrize(
    ("aberrations", "said"),
    [
        ({"coma": 1.0}, "coma needs height_mm"),
        ({"astigmatism": 0.1, "spherical": 1}, "astigmatism needs height_mm"),
        ({"spherical": 21}, "less than or equal to 20"),
        ({"spherical": float("nan")}, "spherical"),
        ({"sperical": 1}, "sperical"),
        ({"spherical": 1, "wave_nm": 0.55}, "greater than or equal to 200"),
        ({"coma": 1, "height_mm": 0}, "greater than 0"),
        ({"distortion": 1}, "distortion"),
        (1.0, "aberrations"),
    ],
)
def test_a_card_that_states_no_wavefront_is_refused(aberrations, said):
    with pytest.raises(ValueError, match=said):
        ImageDistanceLens(f_number=2.0, focal_length_mm=50, focus_range_m=(0.55, 0.45), aberrations=aberrations)


def test_aberrations_that_rays_cannot_show_are_refused():
    small = FocusCriterion(aberrated(OBJECTIVE, spherical=0.3), PITCH_M, WAVE_M)
    assert "the aberrations add up to 0.3 waves" in refusal(small.check, 250, 400).problem
    FocusCriterion(aberrated(OBJECTIVE, spherical=0.2), PITCH_M, WAVE_M).check(250, 400)
    FocusCriterion(aberrated(MACRO, spherical=3.0), PITCH_M, WAVE_M).check(250, 400)
    far = aberrated(replace(OBJECTIVE, travel_m=(-1e-3, 1e-3)), spherical=0.2)
    assert "over the travel of the stage" in refusal(FocusCriterion(far, PITCH_M, WAVE_M).check, 250, 400).problem
    with pytest.raises(BadInput, match="all aberrations are 0"):
        Wavefront(radius_m=1.0)


def test_contrast_is_at_most_that_of_a_perfect_lens_in_focus():
    """A hundredth of a wave loses nothing that shows, and every defocus and aberration loses contrast."""
    imaging = Imaging(0.0125, 0.0556, PITCH_M, 0.0)
    strong_waves = Wavefront(2 * WAVE_M, radius_m=0.0125)
    weak = squared_contrast(np.zeros(1), Wavefront(0.01 * WAVE_M, radius_m=0.0125), imaging=imaging)
    strong = squared_contrast(np.array([-0.02, 0.0, 0.02]), strong_waves, imaging=imaging)
    assert weak[0] == pytest.approx(1, abs=1e-3)
    assert (strong < 0.99).all()
    assert (strong > 0).all()
    assert strong.argmax() == 0


@every_drive
@pytest.mark.parametrize(("severity", "halves"), [("mild", 1.0), ("strong", 3.0)])
def test_typical_aberrations_move_the_focus_by_half_depths(drive, severity, halves):
    """Spherical aberration moves the least blur in the middle, a curved field that of the corner, each by as many.

    Under the microscope they keep the proportion and stay within the quarter of a wave that rays can show.
    """
    criterion = FocusCriterion(drive, PITCH_M, WAVE_M)
    lens = with_typical_aberrations(criterion, severity, rows=250, columns=400)
    FocusCriterion(lens, PITCH_M, WAVE_M).check(250, 400)
    waves, radius = lens.wavefront, drive.aperture_radius_m
    assert waves.field_curvature_m == pytest.approx(4 / 3 * waves.spherical_m)
    assert waves.height_m == pytest.approx(np.hypot(250, 400) / 2 * PITCH_M)
    if drive is OBJECTIVE:
        assert waves.spherical_m + waves.field_curvature_m == pytest.approx(0.25 * WAVE_M)
        return
    depth = np.full(SHAPE, float(drive.focus_depth(0.5)))
    moved = FocusCriterion(lens, PITCH_M, WAVE_M).least_blur(depth, HERE)
    half = criterion.imaging.resolved_defocus
    assert float(lens.defocus(moved, depth[0, 0])) / half == pytest.approx(-halves, rel=0.01)
    assert 2 * waves.field_curvature_m / radius**2 / half == pytest.approx(halves, rel=1e-6)


def test_a_recipe_may_ask_for_a_perfect_lens():
    lens = aberrated(MACRO, spherical=1.0)
    assert with_typical_aberrations(FocusCriterion(lens, PITCH_M, WAVE_M), "none", rows=250, columns=400) == MACRO
