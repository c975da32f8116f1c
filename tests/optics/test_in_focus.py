"""Between which positions a target is in focus: a flat one of a perfect lens, a slanted plane, and lenses that blur."""

from dataclasses import replace

import numpy as np
import pytest

from saf_gen.optics import FocalLengthDrive, FocusCriterion, ImageDistanceDrive, Stage, Wavefront
from saf_gen.optics.texture_contrast import Light
from studies.laws.pupils import pupil_transfer, seidel

WAVE_M, PITCH_M, SHAPE = 555e-9, 20e-6, (24, 41)
DRIVES = {
    "image_distance": ImageDistanceDrive(0.05, 2.0, (0.55, 0.45)),
    "focal_length": FocalLengthDrive(0.055, 2.2, (0.55, 0.45)),
    "stage": Stage(0.009, 1.0, 20, (-60e-6, 60e-6)),
}
every_drive = pytest.mark.parametrize("drive", DRIVES.values(), ids=DRIVES)
ALL = np.ones(SHAPE, bool)
PUPIL = np.stack(np.meshgrid(*[np.linspace(-1, 1, 401)] * 2))
PUPIL = PUPIL[:, np.hypot(*PUPIL) <= 1]


def criterion(drive, *, wave_m=WAVE_M, blend=(), **waves):
    """The lens with aberrations in wavelengths of 555 nm at the edge of its aperture."""
    if waves:
        paths = {f"{name}_m": amount * WAVE_M for name, amount in waves.items()}
        drive = replace(drive, wavefront=Wavefront(**paths, radius_m=drive.aperture_radius_m, height_m=4.7e-3))
    return FocusCriterion(drive, PITCH_M, wave_m, blend)


def flat(drive):
    return np.full(SHAPE, float(drive.focus_depth(0.5)))


def slanted(drive, first, last):
    """A plane that the positions first to last focus from left to right: 1/d is linear over the picture."""
    ends = 1 / drive.focus_depth(np.array([first, last]))
    return np.tile(1 / np.linspace(*ends, SHAPE[1]), (SHAPE[0], 1))


@every_drive
@pytest.mark.parametrize("wave_m", [0.0, WAVE_M])
def test_a_flat_target_of_a_perfect_lens_is_in_focus_over_the_depth_of_focus(drive, wave_m):
    lens = criterion(drive, wave_m=wave_m)
    known = drive.depth_of_focus(drive.least_blur(flat(drive)[ALL]), PITCH_M, wavelength_m=wave_m)
    assert lens.depth_of_focus(flat(drive), ALL) == known
    for by_blur in (False, True):
        assert lens.in_focus(flat(drive), ALL, by_blur=by_blur) == pytest.approx(known, abs=1e-12)


@every_drive
@pytest.mark.parametrize("ends", [(0.2, 0.8), (0.75, 0.3)])
def test_a_slanted_plane_is_in_focus_from_its_first_to_its_last_decile(drive, ends):
    """The 41 columns have even 1/d: a tenth of them are beyond the fifth column from either side."""
    depth = slanted(drive, *ends)
    low, high = criterion(drive).in_focus(depth, ALL)
    found = [
        drive.depth_of_focus(float(drive.best_position(depth[0, n])), PITCH_M, wavelength_m=WAVE_M) for n in (4, 36)
    ]
    assert low == pytest.approx(min(found)[0], abs=1e-12)
    assert high == pytest.approx(max(found)[1], abs=1e-12)
    assert low < criterion(drive).depth_of_focus(depth, ALL)[0]
    assert high > criterion(drive).depth_of_focus(depth, ALL)[1]


def test_the_deciles_of_a_slanted_plane_have_the_closed_form():
    """1/v = 1/f - 1/d is linear over the columns, so the deciles focus at a tenth of the way between the ends' 1/v."""
    drive = DRIVES["image_distance"]
    v = drive.image_distance(np.array([0.2, 0.8]))
    first, last = (1 / (1 / v[0] + share * (1 / v[1] - 1 / v[0])) for share in (0.1, 0.9))
    half = PITCH_M / (2 * drive.aperture_radius_m)
    known = drive.position(first * (1 - half)), drive.position(last * (1 + half))
    assert criterion(drive, wave_m=0.0).in_focus(slanted(drive, 0.2, 0.8), ALL) == pytest.approx(known, abs=1e-9)


def test_a_few_pixels_elsewhere_do_not_widen_a_target():
    drive = DRIVES["image_distance"]
    depth = flat(drive)
    depth[0, :20] = 0.46  # 20 of 984
    low, high = criterion(drive).in_focus(depth, ALL)
    near, far = criterion(drive).depth_of_focus(depth, ALL)
    assert high - low < 1.2 * (far - near)  # they are 12 half depths away


@pytest.mark.parametrize(
    "waves", [{"spherical": 1.0}, {"spherical": -3.0}, {"coma": 2.0}, {"spherical": 2.0, "coma": 1}]
)
@pytest.mark.parametrize("kind", ["image_distance", "focal_length"])
def test_blur_has_grown_by_a_resolved_width_at_the_ends(kind, waves):
    """c = √(8⟨r²⟩) of the rays of an own pupil, about their mean, in the middle of a column at the stated height."""
    drive = DRIVES[kind]
    lens = criterion(drive, **waves)
    at = (0, 40)  # coma counts where it is stated
    target = np.zeros(SHAPE, bool)
    target[at] = True
    height = np.hypot(11.5, 20) * PITCH_M / 4.7e-3
    radius, v = drive.aperture_radius_m, float(drive.image_distance(0.5))
    depth = flat(drive)
    best, ends = lens.least_blur(depth, target), lens.in_focus(depth, target, by_blur=True)

    def diameter(position):
        defocus = float(drive.defocus(position, depth[at])) * radius**2 / 2
        x, y = PUPIL
        s, c = waves.get("spherical", 0) * WAVE_M, waves.get("coma", 0) * height * WAVE_M
        slope = np.stack([
            4 * s * x * (x**2 + y**2) + c * (3 * x**2 + y**2) + 2 * defocus * x,
            4 * s * y * (x**2 + y**2) + 2 * c * x * y + 2 * defocus * y,
        ])  # fmt: skip
        return np.sqrt(8 * np.var(slope * v / radius, axis=1).sum())

    width = np.hypot(PITCH_M, WAVE_M * v / radius)
    grown = [diameter(end) - diameter(best) for end in ends]
    assert grown == pytest.approx([width] * 2, rel=0.03)
    if "spherical" in waves:
        assert np.ptp(ends) > 1.1 * np.ptp(lens.depth_of_focus(depth, target))


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "spherical"), [("image_distance", 1.0), ("image_distance", 3.0), ("stage", 0.2)])
def test_contrast_has_fallen_as_that_of_a_perfect_lens_at_the_ends(kind, spherical):
    """Contrast of the texture by a sum over an own pupil, along one direction."""
    drive, lens = DRIVES[kind], criterion(DRIVES[kind], spherical=spherical)
    depth = flat(drive)
    cycles = np.geomspace(1 / 64, 0.5, 25)
    radius, v = drive.aperture_radius_m, float(drive.image_distance(0.5))

    def contrast(position, spherical):
        defocus = float(drive.defocus(position, depth[0, 0])) * radius**2 / 2
        fractions = cycles / PITCH_M * WAVE_M * v / (2 * radius)
        transfer = pupil_transfer(seidel(spherical=spherical, defocus=defocus / WAVE_M), fractions=fractions)
        return float(np.sum(np.abs(transfer) ** 2 * np.sinc(cycles) ** 2))

    perfect = [contrast(p, 0.0) for p in (0.5, *criterion(drive).depth_of_focus(depth, ALL))]
    best, ends = lens.true_focus(depth, ALL), lens.in_focus(depth, ALL)
    found = [contrast(p, spherical) / contrast(best, spherical) for p in ends]
    assert found == pytest.approx([np.mean(perfect[1:]) / perfect[0]] * 2, abs=0.012)
    half = np.ptp(criterion(drive).depth_of_focus(depth, ALL)) / 2
    assert abs(ends[0] - best) != pytest.approx(half, rel=1e-3)


@every_drive
def test_a_weak_aberration_is_in_focus_for_as_long_as_a_perfect_lens(drive):
    """A thousandth of a wave, which moves the focus by half a percent of a half depth under the microscope."""
    perfect = criterion(drive).depth_of_focus(flat(drive), ALL)
    half = np.ptp(perfect) / 2
    for by_blur in (False, True):
        found = criterion(drive, spherical=1e-3).in_focus(flat(drive), ALL, by_blur=by_blur)
        assert found == pytest.approx(perfect, abs=1e-2 * half)


def test_colour_blurs_by_the_scatter_of_its_foci():
    """Two lights of one share each, whose foci are ±δ apart: c₀ = 2R·v·δ, and the interval is √(1 + 2·c₀/w) as wide."""
    drive = DRIVES["image_distance"]
    half = criterion(drive).imaging.resolved_defocus
    lens = criterion(drive, blend=((1.0, Light((-half, half), (0.5, 0.5))),))
    plain = np.ptp(criterion(drive).depth_of_focus(flat(drive), ALL))
    ends = lens.in_focus(flat(drive), ALL, by_blur=True)
    assert np.ptp(ends) / plain == pytest.approx(np.sqrt(3), rel=5e-3)
    assert np.mean(ends) == pytest.approx(lens.least_blur(flat(drive), ALL), abs=0.01 * plain)


def test_a_slanted_plane_before_a_lens_that_blurs_is_wider_too():
    lens = criterion(DRIVES["image_distance"], spherical=1.0)
    drive = lens.drive
    for by_blur in (False, True):
        level = np.ptp(lens.in_focus(flat(drive), ALL, by_blur=by_blur))
        wide = np.ptp(lens.in_focus(slanted(drive, 0.2, 0.8), ALL, by_blur=by_blur))
        assert wide - level == pytest.approx(0.48, abs=0.01)  # 0.8 of the tilt
