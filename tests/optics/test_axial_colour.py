"""Axial colour of a lens, and the focus of blended light, against closed forms and an own integral over the pupil."""

from dataclasses import replace

import numpy as np
import pytest
from pydantic import ValidationError
from refusals import refusal
from scipy.special import j1

from saf_gen.optics import AxialColour, FocalLengthDrive, FocusCriterion, ImageDistanceDrive, Stage, Wavefront
from saf_gen.optics.axial_colour import C_NM, D_NM, F_NM, refractive_index, shifted_positions, stack_margin
from saf_gen.optics.texture_contrast import Light

PITCH_M = 20e-6
DRIVES = {
    "image_distance": ImageDistanceDrive(0.05, 2.0, (0.8, 0.6)),
    "focal_length": FocalLengthDrive(0.0535, 2.14, (0.8, 0.6)),
    "stage": Stage(0.009, 1.2, 10.0, (-2e-4, 2e-4)),
}
every_drive = pytest.mark.parametrize("drive", DRIVES.values(), ids=DRIVES)


def test_an_achromat_focuses_blue_and_red_behind_green_by_the_secondary_spectrum():
    lens = AxialColour(achromat=2000)
    blue, red, infrared = lens.relative_power(np.array([F_NM, C_NM, 850.0]), reference_nm=D_NM)
    assert 1 / (1 + blue) - 1 == pytest.approx(1 / 2000, rel=1e-3)
    assert red == pytest.approx(blue, rel=1e-3)
    assert infrared < 3 * red < 0


def test_a_singlet_has_the_dispersion_of_its_glass():
    """Schott states n = 1.51680 and the Abbe number 64.17 for N-BK7, 1.62004 and 36.37 for F2."""
    for glass, index, abbe in (("n-bk7", 1.51680, 64.17), ("f2", 1.62004, 36.37), ("n-sf11", 1.78472, 25.68)):
        assert refractive_index(glass, np.array(D_NM)) == pytest.approx(index, abs=1e-5)
        blue, red = AxialColour(singlet=glass).relative_power(np.array([F_NM, C_NM]), reference_nm=D_NM)
        assert 1 / (blue - red) == pytest.approx(abbe, rel=1e-3)


def test_a_measured_shift_of_the_focal_length_is_the_lens_s():
    lens = AxialColour(measured=((450, 0.001), (550, 0.0), (850, 0.004)))
    focal = 1 / (1 + lens.relative_power(np.array([400, 450, 500, 700, 1000]), reference_nm=550.0))
    assert focal - 1 == pytest.approx([0.001, 0.001, 0.0005, 0.002, 0.004])


@every_drive
def test_the_rays_of_other_light_are_those_of_another_position(drive):
    """A ray from the point that is in focus meets the sensor where it does in reference light, up to the scale.

    By own algebra: behind a lens of the power φ + δ, x = -v·(s + a·(φ + δ - 1/v)), with φ = 1/v + 1/u.
    """
    shift, position = 0.02, 0.4
    v, u = float(drive.image_distance(position)), float(drive.object_distance(position))
    a, s = np.array([-0.01, 0.003, 0.01]), np.array([0.0, 0.01, -0.02])
    on_sensor = -v * (s + a * (1 / u + shift))
    other = float(shifted_positions(drive, position, shift=shift))
    assert other != pytest.approx(position, abs=1e-3)
    v2, u2 = float(drive.image_distance(other)), float(drive.object_distance(other))
    moved = float(drive.shift(other) - drive.shift(position))
    if moved == 0:
        assert -v2 * (s + a / u2) * v / v2 == pytest.approx(on_sensor, rel=1e-9)
    else:  # the point at the distance 1/(1/u + δ) is in focus at both
        assert 1 / (1 / u + shift) == pytest.approx(u2 + float(drive.shift(position) - drive.shift(other)) + 2 * moved)


def own_contrast(defocus, light, *, radius, v):
    """Squared contrast of a texture of power 1/f², by jinc functions: geometric optics of a round pupil."""
    total = np.zeros(defocus.size)
    for cycles in np.geomspace(1 / 64, 0.5, 200) / PITCH_M:
        x = 2 * np.pi * v * radius * cycles * (defocus[:, None] - np.array(light.shifts)) + 1e-12
        pixels = np.mean([np.sinc(cycles * PITCH_M * np.cos(t)) * np.sinc(cycles * PITCH_M * np.sin(t)) for t in TURNS])
        total += ((2 * j1(x) / x) @ np.array(light.weights) * pixels) ** 2
    return total


TURNS = np.linspace(0, np.pi, 24, endpoint=False)
BLENDS = [
    Light((0.0, 0.01, 0.03), (0.2, 0.5, 0.3)),
    Light(tuple(np.linspace(-0.08, 0.02, 30)), tuple(np.linspace(1, 3, 30) / 60)),
]


@every_drive
@pytest.mark.parametrize("light", BLENDS)
def test_the_focus_of_blended_light_is_that_of_an_own_integral(drive, light):
    """Within 0.05 half depths of focus; the least blur is at the mean shift."""
    light = Light(tuple(s * SCALES[drive.kind] for s in light.shifts), light.weights)
    depth = np.full((2, 2), float(drive.focus_depth(0.5)))
    criterion = FocusCriterion(drive, PITCH_M, blend=((1.0, light),))
    radius, v = drive.aperture_radius_m, float(drive.image_distance(0.5))
    half = criterion.imaging.resolved_defocus
    defocus = np.linspace(min(light.shifts) - 3 * half, max(light.shifts) + 3 * half, 2001)
    own = defocus[own_contrast(defocus, light, radius=radius, v=v).argmax()]
    found = drive.defocus(criterion.true_focus(depth, depth > 0), depth[0, 0])
    assert float(found) / half == pytest.approx(own / half, abs=0.05)
    least = drive.defocus(criterion.least_blur(depth, depth > 0), depth[0, 0])
    if drive.kind == "focal_length":
        assert float(least) == pytest.approx(light.mean_shift, abs=1e-3 * half)


SCALES = {"image_distance": 1.0, "focal_length": 1.0, "stage": 10.0}


def test_light_of_one_wavelength_keeps_the_closed_form():
    drive = DRIVES["image_distance"]
    depth = np.linspace(0.62, 0.7, 12).reshape(3, 4)
    plain = FocusCriterion(drive, PITCH_M)
    for light in (Light((0.0,), (1.0,)), Light((0.0, 0.0), (0.5, 0.5))):
        blended = replace(plain, blend=((1.0, light),))
        assert blended.true_focus(depth, depth > 0) == plain.true_focus(depth, depth > 0)
        assert np.array_equal(blended.best_position(depth), plain.best_position(depth))


def test_colour_and_aberrations_add_up():
    """Blended light of one shift through a lens with aberrations is in focus by the shift beside its own focus."""
    drive = DRIVES["focal_length"]
    lens = replace(drive, wavefront=Wavefront(spherical_m=1e-6, radius_m=drive.aperture_radius_m))
    depth = np.full((1, 1), float(drive.focus_depth(0.5)))
    plain = FocusCriterion(lens, PITCH_M, 555e-9)
    half = plain.imaging.resolved_defocus
    shifted = replace(plain, blend=((1.0, Light((3 * half,), (1.0,))),))
    apart = [float(drive.defocus(c.true_focus(depth, depth > 0), depth[0, 0])) / half for c in (plain, shifted)]
    assert apart[1] - apart[0] == pytest.approx(3, abs=0.01)


@every_drive
def test_the_margin_holds_every_shift_and_no_more(drive):
    lens = AxialColour(achromat=1000)
    before, after = stack_margin(lens, drive, positions=65, reference_nm=555.0)
    shifts = lens.shifts(drive, np.arange(380.0, 1101.0), reference_nm=555.0)
    ends = shifted_positions(drive, np.array([0.0, 1.0])[:, None], shift=shifts) * 64
    assert -before - 1e-6 <= ends.min() < -before + 1 or before == 0
    assert 64 + after - 1 < ends.max() <= 64 + after + 1e-6 or after == 0
    assert before + after > 0


@pytest.mark.parametrize(
    "keys",
    [
        {},
        {"achromat": 2000, "singlet": "n-bk7"},
        {"achromat": 100},
        {"achromat": "f/2000"},
        {"singlet": "bk7"},
        {"measured": [[400, 0.1]]},
        {"measured": [[500, 0.1], [400, 0.0]]},
        {"measured": [[0.5, 0.1], [0.6, 0.0]]},
        {"measured": [[500, 40], [600, 0]]},
        {"apochromat": 10_000},
    ],
)
def test_what_is_no_axial_colour_is_refused(keys):
    with pytest.raises(ValidationError):
        AxialColour.model_validate(keys)


def test_a_travel_too_short_for_the_colour_is_refused():
    short = ImageDistanceDrive(0.05, 2.0, (0.7, 0.699))
    assert "travels beyond the ends" in str(
        refusal(stack_margin, AxialColour(singlet="n-sf11"), short, positions=65, reference_nm=555.0)
    )


def test_a_lens_may_say_at_which_wavelength_it_has_its_focal_length():
    nm = np.array([450.0, 550.0, 650.0])
    at_555 = AxialColour(singlet="n-bk7").relative_power(nm, reference_nm=555.0)
    stated = AxialColour(singlet="n-bk7", reference_nm=555.0).relative_power(nm, reference_nm=850.0)
    assert np.array_equal(at_555, stated)
    assert "reference_nm" not in AxialColour(singlet="n-bk7").model_dump(exclude_none=True)
