"""The thin lens, its drives and when it passes a position, against their equations."""

from dataclasses import replace

import numpy as np
import pytest
from refusals import refusal
from scipy.optimize import minimize_scalar

from saf_gen.camera.exposure import irradiance_ratio
from saf_gen.optics import DRIVES, FocalLengthDrive, ImageDistanceDrive, Stage
from saf_gen.optics.focus_crossings import focus_crossings

MACRO = ImageDistanceDrive(focal_length_m=0.035, f_number=2.0, focus_range_m=(0.9, 0.4))
LIQUID = FocalLengthDrive(image_distance_m=0.035, f_number=2.0, focus_range_m=(0.9, 0.4))
MICROSCOPE = Stage(focal_length_m=0.004, f_number=1.1, magnification=20, travel_m=(-30e-6, 30e-6))
TABLE = Stage(focal_length_m=0.05, f_number=2.0, magnification=0.25, travel_m=(0.06, -0.04))
LENSES = (MACRO, LIQUID, MICROSCOPE, TABLE)
P = np.linspace(0, 1, 11)
PITCH = 20e-6

every_drive = pytest.mark.parametrize("lens", LENSES, ids=("macro", "liquid", "microscope", "table"))


def among(lens, count):
    """Depths that the middle of the travel focuses."""
    return lens.focus_depth(np.linspace(0.3, 0.7, count))


def test_a_lens_that_moves_obeys_the_lens_equation_and_is_linear_in_v():
    v = MACRO.image_distance(P)
    assert 1 / v + 1 / MACRO.object_distance(P) == pytest.approx(1 / 0.035, rel=1e-12)
    assert np.diff(v) == pytest.approx(np.diff(v)[0])


def test_a_varifocal_lens_keeps_v_and_is_linear_in_its_power():
    assert np.array_equal(LIQUID.image_distance(P), np.full(11, 0.035))
    power = 1 / LIQUID.image_distance(P) + 1 / LIQUID.object_distance(P)
    assert np.diff(power) == pytest.approx(np.diff(power)[0])


def test_a_stage_keeps_the_lens_and_is_linear_in_z():
    u, v = MICROSCOPE.object_distance(P), MICROSCOPE.image_distance(P)
    assert 1 / u + 1 / v == pytest.approx(1 / 0.004, rel=1e-12)
    assert v / u == pytest.approx(20, rel=1e-12)
    assert np.diff(MICROSCOPE.shift(P)) == pytest.approx(6e-6)


@pytest.mark.parametrize(
    ("lens", "ends"),
    [(MACRO, (0.9, 0.4)), (LIQUID, (0.9, 0.4)), (MICROSCOPE, (0.00417, 0.00423)), (TABLE, (0.31, 0.21))],
)
def test_the_ends_of_the_travel_focus_where_the_card_says(lens, ends):
    assert lens.focus_depth(np.array([0.0, 1.0])) == pytest.approx(ends, rel=1e-12)
    assert lens.focusing_range_m == pytest.approx(sorted(ends), rel=1e-12)


@every_drive
def test_the_best_position_is_the_inverse_of_the_depth_in_focus(lens):
    assert lens.best_position(lens.focus_depth(P)) == pytest.approx(P, abs=1e-9)


@every_drive
def test_blur_is_the_textbooks_and_vanishes_at_the_best_position(lens):
    depth, p = float(lens.focus_depth(0.6)), 0.2
    u, v = float(lens.object_distance(p)), float(lens.image_distance(p))
    distance = depth - float(lens.shift(p))
    expected = 2 * lens.aperture_radius_m * v * abs(1 / distance - 1 / u)
    assert float(lens.blur_diameter(p, depth)) == pytest.approx(expected, rel=1e-12)
    assert expected > PITCH
    assert float(lens.blur_diameter(lens.best_position(depth), depth)) == pytest.approx(0, abs=1e-12)


def test_a_point_that_the_lens_has_reached_has_no_finite_blur():
    assert TABLE.blur_diameter(0.0, np.array([0.06, 0.05])) == pytest.approx(np.inf)


def test_the_f_number_is_that_of_the_lens_at_infinity():
    assert MACRO.aperture_radius_m == pytest.approx(0.035 / 4)
    assert LIQUID.aperture_radius_m == pytest.approx(0.035 / 4)  # f = v when focused at infinity
    assert MICROSCOPE.aperture_radius_m == pytest.approx(0.004 / 2.2)


@every_drive
def test_the_truth_of_many_depths_minimises_the_mean_squared_blur(lens):
    depths = among(lens, 40)
    found = minimize_scalar(
        lambda p: float(np.mean(lens.blur_diameter(p, depths) ** 2)) * 1e12, bounds=(0, 1), method="bounded",
        options={"xatol": 1e-10},
    )  # fmt: skip
    assert lens.least_blur(depths) == pytest.approx(found.x, abs=1e-7)


@pytest.mark.parametrize("counts", [(3, 6, 4), (1, 1, 1), (1, 50, 2000)])
def test_the_truth_of_a_deep_relief_on_a_stage_is_its_only_minimum(counts):
    """Layers at 1, 2.2 and 5 times u; 100,001 positions, until the nearest layer has reached the lens."""
    lens = Stage(focal_length_m=0.05, f_number=2.0, magnification=0.25, travel_m=(-0.1, 0.1))
    u = float(lens.object_distance(0.0))
    p = np.linspace(*(float(lens.best_position(d)) for d in (u, 2 * u * (1 - 1e-9))), 100_001)
    mean = sum(n * lens.blur_diameter(p, d) ** 2 for n, d in zip(counts, (u, 2.2 * u, 5 * u), strict=True))
    assert (np.diff(np.sign(np.diff(mean))) != 0).sum() == 1
    depths = np.repeat([u, 2.2 * u, 5 * u], counts)
    assert lens.least_blur(depths) == pytest.approx(p[mean.argmin()], abs=2 * (p[1] - p[0]))


@every_drive
def test_blur_is_one_pixel_at_the_ends_of_the_depth_of_focus(lens):
    depth = float(lens.focus_depth(0.4))
    low, high = lens.depth_of_focus(0.4, PITCH)
    assert low < 0.4 < high
    assert lens.blur_diameter(np.array([low, high]), depth) == pytest.approx(PITCH, rel=1e-6)


@every_drive
def test_waves_add_in_squares_to_the_depth_of_focus(lens):
    """At its ends the blur is √(pixel² + (λ·v/R)²); by waves alone it is Rayleigh's quarter wave: c = 4·W·λ·v/R."""
    depth = float(lens.focus_depth(0.4))
    v = float(lens.image_distance(lens.best_position(depth)))
    width = 555e-9 * v / lens.aperture_radius_m
    for pitch in (PITCH, 0.0):
        ends = lens.depth_of_focus(0.4, pitch, wavelength_m=555e-9)
        assert ends[0] < float(lens.best_position(depth)) < ends[1]
        blur = lens.blur_diameter(np.array(ends), depth)
        assert blur == pytest.approx(np.hypot(pitch, width), rel=1e-6)
    waves = blur * lens.aperture_radius_m / (4 * 555e-9 * v)
    assert waves == pytest.approx(0.25, rel=1e-6)
    assert lens.depth_of_focus(0.4, PITCH, wavelength_m=0.0) == lens.depth_of_focus(0.4, PITCH)


@pytest.mark.parametrize(
    ("objective", "geometric_m", "by_waves_m"),
    [
        (Stage(0.018, 1.8, 10, (-1e-4, 1e-4)), 3.96e-6, 4.35e-6),  # usaf_microscope, lily_anther
        (Stage(0.008, 1.2, 25, (-2.5e-5, 2.5e-5)), 0.998e-6, 1.73e-6),  # cardiac_muscle
    ],
)
def test_half_depths_of_focus_under_the_microscopes(objective, geometric_m, by_waves_m):
    """u²·pitch/(2R·v) and λ·u²/(2R²) separately, and the root of the sum of their squares; within 0.3 %."""
    micrometres = abs(objective.travel_m[1] - objective.travel_m[0])
    for pitch, wave, expected in (
        (PITCH, 0.0, geometric_m),
        (0.0, 555e-9, by_waves_m),
        (PITCH, 555e-9, np.hypot(geometric_m, by_waves_m)),
    ):
        low, high = objective.depth_of_focus(0.5, pitch, wavelength_m=wave)
        assert (high - low) / 2 * micrometres == pytest.approx(expected, rel=3e-3)


def test_a_lens_that_waves_keep_in_focus_all_the_way_is_refused():
    pinhole = replace(MACRO, f_number=64.0)
    error = refusal(pinhole.check_wave_depth, 555e-9)
    assert "light of 555 nm through an aperture of 0.547 mm stays in focus over" in error.problem
    assert error.allowed == "a depth of focus by waves within the travel"
    assert "diffraction: false" in error.hint
    pinhole.check_wave_depth(0.0)
    assert refusal(replace(MACRO, f_number=np.inf).check_wave_depth, 555e-9).problem == "the aperture has no width"
    for lens in LENSES:
        lens.check_wave_depth(555e-9)


def test_a_pinhole_on_a_stage_has_no_far_end_of_focus():
    pinhole = Stage(focal_length_m=0.004, f_number=300.0, magnification=0.5, travel_m=(-1e-3, 1e-3))
    near, far = pinhole.depth_of_focus(float(pinhole.best_position(0.012)), PITCH)
    assert (near, far) == (-np.inf, pytest.approx(float(pinhole.best_position(0.012)), abs=10))


@every_drive
def test_a_path_is_a_straight_line_through_the_stack(lens):
    entries = lens.ray_transfer(P)
    assert np.diff(entries, axis=0) == pytest.approx(np.broadcast_to(entries[1] - entries[0], (10, 2, 2)))
    assert entries[5] == pytest.approx(np.eye(2), abs=1e-15)


@every_drive
def test_the_transfer_is_the_ray_through_the_moved_lens(lens):
    """Against the formulas of the drives: x = a - v·(s + a/f), with the lens moved by z along the ray."""
    x, a = 0.7e-3, 0.4 * lens.aperture_radius_m
    s = (a - x) / lens.image_distance(0.5) - a * power(lens, 0.5)
    moved = a + s * (lens.shift(P) - lens.shift(0.5))
    expected = moved - lens.image_distance(P) * (s + moved * power(lens, P))
    x_p, a_p = (lens.ray_transfer(P) @ [x, a]).T
    assert x_p == pytest.approx(expected, rel=1e-9)
    assert a_p == pytest.approx(moved, rel=1e-12)


def power(lens, position):
    return 1 / lens.object_distance(position) + 1 / lens.image_distance(position)


@every_drive
def test_rays_spread_evenly_stay_spread_evenly(lens):
    """The determinant is the scale of the picture, which is 1 if v does not change (étendue)."""
    scale = lens.image_distance(P) / lens.image_distance(0.5)
    assert np.linalg.det(lens.ray_transfer(P)) == pytest.approx(scale, rel=1e-12)


@every_drive
def test_the_light_that_the_lens_collects_changes_with_v_alone(lens):
    """E/L = π·R²/v² on the axis, with a constant aperture."""
    v = lens.image_distance(P)
    seen = irradiance_ratio((1, 1), v, pitch_m=PITCH, aperture_radius_m=lens.aperture_radius_m)
    assert seen[:, 0, 0] == pytest.approx(np.pi * (lens.aperture_radius_m / v) ** 2, rel=1e-12)
    assert (float(np.ptp(seen)) > 0) == (lens is MACRO)


@every_drive
def test_a_drive_as_plain_data_makes_the_drive_again(lens):
    plain = lens.as_dict()
    assert DRIVES[plain.pop("kind")](**plain) == lens


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: ImageDistanceDrive(0.035, 2.0, (0.9, 0.03)),
            r"the lens of 35 mm cannot focus at 0.03 m; allowed: object distances beyond 0.035 m",
        ),
        (lambda: ImageDistanceDrive(0.035, 2.0, (0.5, 0.5)), "does not move: both ends focus at 0.5 m"),
        (
            lambda: FocalLengthDrive(0.035, 2.0, (0.5, -0.1)),
            "cannot focus at -0.1 m; allowed: object distances in front of it",
        ),
        (lambda: FocalLengthDrive(0.035, 2.0, (0.5, 0.5)), "does not change: both ends focus at 0.5 m"),
        (lambda: Stage(0.004, 1.1, 20, (1e-5, 1e-5)), "stage does not move: both ends of the travel are 1e-05 m"),
        (lambda: Stage(0.004, 1.1, 20, (-0.003, 0.002)), "less than 0.0042"),
        (lambda: Stage(0.004, 1.1, 20, (-0.005, -0.0045)), "a travel above -0.0042 m"),
    ],
)
def test_a_drive_that_cannot_be_is_refused_in_one_line(make, message):
    assert message in str(refusal(make))


def test_a_sweep_passes_every_place_of_the_travel_once_when_its_formula_says():
    sweep = (np.arange(50) + 0.5) / 50
    for position in (1e-4, 0.003, 0.25, 0.5, 0.999, 1 - 1e-4):
        assert focus_crossings(sweep, position) == pytest.approx([position * 50 - 0.5], abs=1e-9)
        assert focus_crossings(sweep[::-1], position) == pytest.approx([(1 - position) * 50 - 0.5], abs=1e-9)


def test_what_lies_outside_the_way_is_never_passed():
    sweep = 0.2 + 0.5 * (np.arange(50) + 0.5) / 50
    assert [focus_crossings(sweep, position).size for position in (0.19, 0.71, float("nan"))] == [0, 0, 0]


def test_there_and_back_passes_a_place_twice_and_its_turn_once():
    lens = np.array([0.0, 0.5, 1.0, 0.5, 0.0])
    assert focus_crossings(lens, 0.25) == pytest.approx([0.5, 3.5])
    assert focus_crossings(lens, 0.5).tolist() == [1, 3]
    assert focus_crossings(lens, 1.0).tolist() == [2]


def test_a_lens_at_rest_crosses_its_position_in_every_readout():
    assert focus_crossings(np.full(3, 0.2), 0.2).tolist() == [0, 1, 2]
    assert focus_crossings(np.full(3, 0.2), 0.3).size == 0
    assert focus_crossings(np.array([0.1, 0.2, 0.2, 0.3]), 0.2).tolist() == [1, 2]


def test_float32_as_in_a_file_gives_the_same_frames():
    grid = np.round((np.arange(1000) + 0.5) / 1000 * 2**24) / 2**24
    assert np.array_equal(focus_crossings(grid, 0.37), focus_crossings(grid.astype(np.float32), 0.37))
