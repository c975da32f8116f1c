"""Pictures of thin sections by waves, against closed forms and a slow sum over condenser and pupil."""

from dataclasses import replace

import numpy as np
import pytest
from refusals import assert_says, refusal
from scipy.special import jv

from saf_gen.optics import Distortion, ImageDistanceDrive, Ring, Stage, Wavefront
from saf_gen.optics.partial_coherence import SectionImages
from studies.laws.pupils import section_transfer, seidel

WAVE_M, TEXEL_M = 550e-9, 0.22e-6
NA = 0.374
OBJECTIVE = Stage(8e-3, 8 / (2 * 8.32 * NA), 25, (-6e-6, 6e-6))
IN_FOCUS_M = float(OBJECTIVE.object_distance(0.5))
CUTOFF = NA / WAVE_M  # cycles per metre
PITCH_M, ROWS, COLUMNS = 10e-6, 4, 160
FRACTIONS = np.array([0.25, 0.55, 0.85, 1.2])  # of the cutoff of the aperture
HALF_DEPTH_M = WAVE_M / (2 * NA**2)


def at(z_m, drive=OBJECTIVE):
    """The position at which the section is z nearer to the lens than in focus."""
    return float(drive.position(z_m))


def scale(z_m):
    """Metres of the section a metre of the sensor."""
    return (IN_FOCUS_M - z_m) / float(OBJECTIVE.image_distance(0.5))


def images(amplitude, *, coherence, drive=OBJECTIVE, **size):
    size = {"rows": ROWS, "columns": COLUMNS, "pitch_m": PITCH_M, **size}
    return SectionImages(
        amplitude, TEXEL_M, drive=drive, depth_m=IN_FOCUS_M, wavelength_m=WAVE_M, coherence=coherence, threads=1, **size
    )


def places(shape):
    """Places (m) of texels right and above of the middle of an array."""
    rows, columns = shape
    x, y = ((np.arange(n) - (n - 1) / 2) * TEXEL_M for n in (columns, rows))
    return x[None, :], -y[:, None]


def gratings(power, *, shape=(220, 460)):
    """The amplitude of gratings of all FRACTIONS across; ``power`` is the exponent per grating, 1j·φ for phase."""
    x, _ = places(shape)
    waves = sum(np.cos(2 * np.pi * fraction * CUTOFF * x) for fraction in FRACTIONS)
    return np.broadcast_to(np.exp(power * waves), shape)


def modulation(picture, z_m):
    """The amplitude of each grating in a picture, with the loss by the width of a pixel undone."""
    x = (np.arange(picture.shape[1]) - (picture.shape[1] - 1) / 2) * PITCH_M * scale(z_m)
    phases = 2 * np.pi * np.outer(x, FRACTIONS * CUTOFF)
    basis = np.hstack([np.ones((x.size, 1)), np.cos(phases), np.sin(phases)])
    found = np.linalg.lstsq(basis, picture.mean(axis=0, dtype=np.float64), rcond=None)[0]
    return found[1 : 1 + FRACTIONS.size] / np.sinc(FRACTIONS * CUTOFF * PITCH_M * scale(z_m))


def waves_at(z_m, spherical=0.0):
    """The wavefront in wavelengths over the pupil."""
    y = IN_FOCUS_M - z_m
    defocus = OBJECTIVE.aperture_radius_m**2 / 2 * (1 / y - 1 / IN_FOCUS_M) / WAVE_M
    return seidel(spherical=spherical, defocus=defocus)


@pytest.mark.parametrize("coherence", [0.3, 0.6, 1.0])
@pytest.mark.parametrize(("z_um", "spherical"), [(0, 0), (-2, 0), (4, 0), (6, 0), (2, 0.6)])
def test_weak_sections_have_the_transfer_of_the_sum_over_the_condenser(coherence, z_um, spherical):
    small, z_m = 1e-3, z_um * 1e-6
    drive = OBJECTIVE
    if spherical:
        wavefront = Wavefront(spherical_m=spherical * WAVE_M, radius_m=drive.aperture_radius_m)
        drive = replace(drive, wavefront=wavefront)
    absorption, phase = section_transfer(FRACTIONS, coherence=coherence, waves=waves_at(z_m, spherical))
    for power, expected in ((small, absorption), (1j * small, phase)):
        picture = images(gratings(power), coherence=coherence, drive=drive).picture(at(z_m), coherence=coherence)
        found = modulation(picture, z_m) / (2 * small)
        assert found == pytest.approx(expected, abs=0.02)
        if power.imag and coherence == 1.0 and not spherical:
            assert found == pytest.approx(np.zeros(FRACTIONS.size), abs=0.02)


def common_area(radius, fraction):
    """The area common to a disc of this radius and one of radius 1, with their middles ``fraction`` apart."""
    if fraction <= 1 - radius:
        return np.pi * radius**2
    if fraction >= 1 + radius:
        return 0.0
    first = np.arccos((fraction**2 + radius**2 - 1) / (2 * fraction * radius))
    second = np.arccos((fraction**2 + 1 - radius**2) / (2 * fraction))
    kite = (1 + radius - fraction) * (fraction + radius - 1) * (fraction - radius + 1) * (fraction + radius + 1)
    return radius**2 * first + second - np.sqrt(kite) / 2


@pytest.mark.parametrize("coherence", [0.3, 0.6, 1.0])
def test_in_focus_weak_absorption_has_the_overlap_of_condenser_and_aperture_and_phase_nothing(coherence):
    small = 1e-3
    expected = [common_area(coherence, f) / (np.pi * coherence**2) for f in FRACTIONS]
    absorbing, clear = (
        modulation(images(gratings(power), coherence=coherence).picture(at(0), coherence=coherence), 0) / (2 * small)
        for power in (small, 1j * small)
    )
    assert absorbing == pytest.approx(expected, abs=0.02)
    assert abs(clear).max() < 2 * small  # the square of the phase


def cell_texture(shape, seed):
    """Smooth noise of rms 1, as fine as the lens resolves: (row, col)."""
    rng = np.random.default_rng(seed)
    f = np.hypot(np.fft.fftfreq(shape[0], TEXEL_M)[:, None], np.fft.rfftfreq(shape[1], TEXEL_M))
    noise = np.fft.irfft2(np.fft.rfft2(rng.normal(size=shape)) * np.exp(-((f / CUTOFF) ** 2)), shape)
    return noise / noise.std()


def slow_sum(amplitude, *, coherence, waves, z_m, shape, pitch_m, points=400):
    """The mean intensity over each pixel, float64 (row, col): a sum over points of the condenser, wave by wave."""
    at = np.arange(points) + 0.5  # a sunflower
    source = coherence * np.sqrt(at / points) * np.exp(1j * np.pi * (1 + 5**0.5) * at)
    y_m = IN_FOCUS_M - z_m
    cutoff = OBJECTIVE.aperture_radius_m / (WAVE_M * y_m)
    down, across = (np.fft.fftfreq(n, TEXEL_M) for n in amplitude.shape)
    spectrum = np.fft.fft2(amplitude)
    seen = np.zeros(amplitude.shape)
    for s in source:
        x, y = np.meshgrid(across / cutoff + s.real, down / cutoff + s.imag)
        pupil = (x**2 + y**2 <= 1) * np.exp(2j * np.pi * waves(x, y))
        seen += abs(np.fft.ifft2(spectrum * pupil)) ** 2 / points
    width_m = pitch_m * scale(z_m)
    for n, lines in zip(shape, (down, across), strict=True):
        place = (np.arange(n) - (n - 1) / 2) * width_m + (lines.size - 1) / 2 * TEXEL_M
        pixels = np.exp(2j * np.pi * np.outer(place, lines)) * np.sinc(lines * width_m)
        seen = (pixels @ np.fft.fft(seen, axis=0) / lines.size).real.T
    return seen


@pytest.mark.slow
@pytest.mark.daily(2)
@pytest.mark.parametrize(
    ("coherence", "z_um", "spherical"),
    [(0.6, 0, 0), (0.6, -6, 0), (0.3, 6, 0), (1.0, 3, 0), (0.6, 2, 1.5), (1.5, 0, 0)],
)
def test_the_modes_of_a_condenser_bring_what_all_its_points_bring(coherence, z_um, spherical):
    """The section is strong: it scatters most of the light."""
    shape, pitch_m, z_m = (24, 30), 20e-6, z_um * 1e-6
    amplitude = np.exp((1j - 0.2) * cell_texture((180, 204), seed=3))
    fades = (np.clip(np.minimum(np.arange(n), np.arange(n)[::-1]) / 40, 0, 1) for n in amplitude.shape)
    amplitude = np.pad(1 + (amplitude - 1) * np.outer(*fades), 60, constant_values=1)
    drive = OBJECTIVE
    if spherical:
        wavefront = Wavefront(spherical_m=spherical * WAVE_M, radius_m=drive.aperture_radius_m)
        drive = replace(drive, wavefront=wavefront)
    found = images(amplitude, coherence=coherence, drive=drive, rows=shape[0], columns=shape[1], pitch_m=pitch_m)
    wave = {"waves": waves_at(z_m, spherical), "z_m": z_m, "shape": shape, "pitch_m": pitch_m}
    expected = slow_sum(amplitude, coherence=coherence, **wave)
    wrong = (found.picture(at(z_m), coherence=coherence) - expected) / expected.mean()
    limit = 0.015 if coherence <= 1 else 0.025
    assert np.sqrt((wrong**2).mean()) < limit * expected.std() / expected.mean()


def contrast_over_focus(power, steps_um):
    found = images(np.exp(power * cell_texture((260, 330), seed=5)), coherence=0.6, rows=30, columns=50, pitch_m=20e-6)
    pictures = [found.picture(at(z * 1e-6), coherence=0.6) for z in steps_um]
    return np.array([picture.std() / picture.mean() for picture in pictures])


@pytest.mark.slow
def test_a_phase_section_is_invisible_in_focus_and_shows_most_two_half_depths_beside_it():
    """NA 0.374, condenser 0.6: PHYSICS of weak phase objects says 4 µm on either side."""
    steps = np.array([-5, -4, -3, -1, 0, 1, 3, 4, 5])
    contrast = contrast_over_focus(0.01j, steps)
    assert contrast[4] < 0.01 * contrast.max()
    assert contrast == pytest.approx(contrast[::-1], rel=0.02)
    for side in (slice(0, 3), slice(6, 9)):
        a, b, _ = np.polyfit(steps[side], contrast[side], 2)
        peak_m = abs(b / (2 * a)) * 1e-6
        assert peak_m == pytest.approx(4e-6, abs=0.5e-6)
        assert peak_m == pytest.approx(2 * HALF_DEPTH_M, rel=0.15)


def test_an_absorbing_section_shows_most_in_focus_and_alike_on_both_sides():
    contrast = contrast_over_focus(-0.05, [-4, -2, 0, 2, 4])
    assert contrast.argmax() == 2
    assert contrast == pytest.approx(contrast[::-1], rel=0.01)


@pytest.mark.parametrize("z_um", [-6, -3, 0, 2, 5])
def test_in_coherent_light_a_phase_grating_makes_the_sum_of_its_orders(z_um):
    """exp(i·b·cos) has the orders iⁿ·Jₙ(b), each delayed over the way from the section to the plane in focus."""
    depth, fraction, z_m = 1.2, 0.3, z_um * 1e-6
    shape = (220, 460)
    x, _ = places(shape)
    amplitude = np.exp(1j * depth * np.cos(2 * np.pi * fraction * CUTOFF * x)) * np.ones((shape[0], 1))
    seen = images(amplitude, coherence=0.02).picture(at(z_m), coherence=0.02).mean(axis=0)
    sensor = (np.arange(COLUMNS) - (COLUMNS - 1) / 2) * PITCH_M
    fine = (sensor[:, None] + (np.arange(9) - 4) / 9 * PITCH_M) * scale(z_m)
    forward = -z_m * (IN_FOCUS_M - z_m) / IN_FOCUS_M  # a section beyond the plane in focus is nearer to the lens by z
    wave = np.zeros(fine.shape, complex)
    for n in range(-3, 4):  # the aperture lets these pass
        f = n * fraction * CUTOFF
        wave += 1j**n * jv(n, depth) * np.exp(2j * np.pi * f * fine - 1j * np.pi * WAVE_M * forward * f**2)
    assert seen == pytest.approx((abs(wave) ** 2).mean(axis=1), abs=0.02)


@pytest.mark.parametrize(("nearer_um", "sign"), [(-3, 1), (3, -1)])
def test_what_delays_light_is_bright_when_the_plane_in_focus_is_between_it_and_the_lens(nearer_um, sign):
    x, y = places((300, 460))
    bump = np.exp(-(x**2 + y**2) / (2 * (1.2e-6) ** 2))
    seen = images(np.exp(0.5j * bump), coherence=0.6, rows=40).picture(at(nearer_um * 1e-6), coherence=0.6)
    assert sign * (seen[19:21, 79:81].mean() - 1) > 0.05


@pytest.mark.parametrize("coherence", [0.02, 0.3, 0.6, 1.0, 1.5, 2.0])
@pytest.mark.parametrize("z_um", [-6, 0, 5])
def test_a_clear_section_has_the_light_of_the_lamp_and_phase_loses_none(coherence, z_um):
    clear = images(np.ones((10, 10)), coherence=coherence).picture(at(z_um * 1e-6), coherence=coherence)
    assert clear == pytest.approx(np.full((ROWS, COLUMNS), min(1, coherence**-2)), rel=1e-5)
    x, y = places((160, 160))
    lens = 1.5 * np.exp(-(x**2 + y**2) / (2 * (3e-6) ** 2))  # smooth: all its light passes the aperture
    if coherence < 0.8:
        seen = images(np.exp(1j * lens), coherence=coherence, rows=100, columns=100)
        picture = seen.picture(at(z_um * 1e-6), coherence=coherence)
        assert picture.mean() == pytest.approx(1, abs=5e-4)
        assert abs(picture - 1).max() > (0.05 if z_um else 0)


def test_in_a_wide_cone_of_light_the_picture_is_that_of_incoherent_light():
    """(a + b·cos)² has the contrasts 2ab and b²/2, of which the lens transfers what the pupil's overlap says."""
    a, b, fraction = 0.7, 0.25, 0.55
    shape = (220, 460)
    x, _ = places(shape)
    amplitude = (a + b * np.cos(2 * np.pi * fraction * CUTOFF * x)) * np.ones((shape[0], 1))
    seen = images(amplitude, coherence=2.0).picture(at(0), coherence=2.0) * 2.0**2
    assert seen.mean() == pytest.approx(a**2 + b**2 / 2, rel=0.02)
    assert modulation(seen, 0)[1] == pytest.approx(2 * a * b * common_area(1, fraction) / np.pi, abs=0.01)


def test_a_pixel_does_not_depend_on_the_size_of_the_sensor_nor_on_what_is_beyond_the_guard_band():
    """What is left, 0.3 % of the contrast and no more at the border, is the aperture's edge on another grid."""
    amplitude = np.exp((0.6j - 0.2) * cell_texture((420, 480), seed=7))
    size = {"coherence": 0.6, "pitch_m": 20e-6}
    whole = images(amplitude, rows=50, columns=80, **size).picture(at(5e-6), coherence=0.6)
    part = images(amplitude, rows=30, columns=40, **size).picture(at(5e-6), coherence=0.6)
    wrong = (part - whole[10:40, 20:60]) / whole.std()
    assert wrong.std() < 0.006
    assert wrong[[0, -1]].std() < 0.009


@pytest.mark.slow
def test_far_from_focus_a_small_sensor_sees_the_middle_of_a_large_one():
    """A few points then sample a period whose spectrum has more than twice as many lines."""
    deep = replace(OBJECTIVE, travel_m=(-50e-6, 50e-6))
    amplitude = np.exp(0.6j * cell_texture((900, 900), seed=7))
    small, large = (
        images(amplitude, coherence=0.6, drive=deep, rows=n, columns=n, pitch_m=20e-6).picture(1.0, coherence=0.6)
        for n in (8, 64)
    )
    middle = large[28:36, 28:36]
    assert small.mean() == pytest.approx(middle.mean(), rel=0.02)
    assert (small - middle).std() < 0.15 * middle.std()


def test_the_picture_is_upright_and_its_scale_is_that_of_the_lens():
    x, y = places((300, 460))
    spot_m = (10e-6, 6e-6)
    amplitude = 1 - 0.9 * np.exp(-((x - spot_m[0]) ** 2 + (y - spot_m[1]) ** 2) / (2 * (1e-6) ** 2))
    for z_um in (-5, 0, 5):
        dark = 1 - images(amplitude, coherence=0.6, rows=60).picture(at(z_um * 1e-6), coherence=0.6)
        rows, columns = np.indices(dark.shape)
        dark = np.where(dark > 0.05 * dark.max(), dark, 0)
        found = [(dark * i).sum() / dark.sum() for i in (columns - (COLUMNS - 1) / 2, 29.5 - rows)]
        expected = np.array(spot_m) / scale(z_um * 1e-6) / PITCH_M
        assert found == pytest.approx(expected, abs=0.05)


def test_another_drive_shows_a_section_at_its_own_scale():
    drive = ImageDistanceDrive(0.05, 8, (0.0563, 0.0557))
    depth_m, texel_m = float(drive.focus_depth(0.5)), 2e-6
    x = (np.arange(400) - 199.5) * texel_m
    frequency = 0.2 * drive.aperture_radius_m / depth_m / WAVE_M
    amplitude = np.ones((200, 1)) * (1 - 0.05 * (1 - np.cos(2 * np.pi * frequency * x)))
    size = {"rows": 8, "columns": 100, "pitch_m": 20e-6, "depth_m": depth_m, "wavelength_m": WAVE_M}
    seen = SectionImages(amplitude, texel_m, drive=drive, coherence=0.5, **size)
    for position in (0.0, 0.5):
        line = seen.picture(position, coherence=0.5).mean(axis=0, dtype=np.float64)
        place = (np.arange(100) - 49.5) * 20e-6 * depth_m / float(drive.image_distance(position))
        waves = np.exp(2j * np.pi * np.outer(frequency * place, [1, 2])).view(float)
        design = np.hstack([np.ones((100, 1)), waves])
        fit, residual, *_ = np.linalg.lstsq(design, line, rcond=None)
        assert np.sqrt(residual[0] / 100) < 0.02 * fit[1]


REFUSED = {
    "coarse texels": ({"texel_m": 0.5e-6}, "texels of 0.5 µm | at most 0.45"),
    "no room for the stage": ({"depth_m": 5e-6}, "runs the section into the lens | travel_m"),
    "too many texels": ({"columns": 20_000}, "texels | at most 16,384"),
    "waves that vary": ({"drive": replace(OBJECTIVE, wavefront=Wavefront(coma_m=1e-7))}, "spherical aberration alone"),
    "vignetting": (
        {"drive": replace(OBJECTIVE, ring=Ring(0.01, 0.005))},
        "differs over the field | vignetting, out of scene.yaml",
    ),
    "distortion": ({"drive": replace(OBJECTIVE, distortion=Distortion(0.02, 0.004, 0.2))}, "differs over the field"),
    "curved field": (
        {"drive": replace(OBJECTIVE, wavefront=Wavefront(1e-7, field_curvature_m=1e-7))},
        "differs over the field",
    ),
}


@pytest.mark.parametrize(("change", "says"), REFUSED.values(), ids=REFUSED)
def test_what_one_pupil_cannot_show_is_refused_in_one_line(change, says):
    given = {
        "texel_m": TEXEL_M,
        "drive": OBJECTIVE,
        "rows": 40,
        "columns": 40,
        "pitch_m": 20e-6,
        "depth_m": IN_FOCUS_M,
        "wavelength_m": WAVE_M,
        "coherence": 0.6,
        **change,
    }
    assert_says(refusal(SectionImages, np.ones((20, 20)), **given), says)
