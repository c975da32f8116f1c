"""Diffraction at the aperture, against the exact transfer of a round lens out of focus."""

import math
from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from refusals import refusal
from written_scenes import JIT, load_setup, needs_llvm, render_stack_once, write_scene

from saf_gen.optics import FocalLengthDrive, ImageDistanceDrive, Stage
from saf_gen.render import backend, camera_rays, mitsuba_scene, one_pass, render_missing
from saf_gen.render.diffraction import find_waves, place_bends
from saf_gen.render.ray_sampling import place_samples, ray_coverage
from saf_gen.render.render_setup import SensorGrid
from saf_gen.scene.scene_folder import find_scene
from saf_gen.stack.focal_stack import StackSpec
from studies.laws.theory import exact_otf

WAVE_M, PITCH_M = 555e-9, 20e-6
GRID = SensorGrid(rows=24, columns=48, pitch_m=PITCH_M)
# R/v is 0.024 or 0.025; the ends of the travel are 1.5 wavelengths from its middle.
DRIVES = {
    "image_distance": ImageDistanceDrive(0.05, 15.63, (0.2313, 0.1777)),
    "focal_length": FocalLengthDrive(0.0667, 20.83, (0.2299, 0.1770)),
    "stage": Stage(0.018, 1.8, 10, (-26e-6, 26e-6)),
}
every_drive = pytest.mark.parametrize("drive", DRIVES.values(), ids=DRIVES)


def aperture_of(drive, position):
    """R/v at a position."""
    return drive.aperture_radius_m / float(drive.image_distance(position))


def defocus_waves(drive, position):
    """The wavefront error at the edge of the aperture, in wavelengths: a quarter of c·R/(λ·v)."""
    return float(drive.blur_diameter(position, drive.focus_depth(0.5))) * aperture_of(drive, position) / (4 * WAVE_M)


def expected_transfer(drive, position, cycles_per_pixel):
    fraction = cycles_per_pixel / PITCH_M * WAVE_M / (2 * aperture_of(drive, position))
    return exact_otf(fraction, defocus_waves(drive, position))


@pytest.mark.parametrize("waves", [0.0, 0.3, 1.5])
def test_the_reference_agrees_with_the_fourier_transform_of_the_pupil(waves):
    """Within 0.001: the other transfer comes from two transforms, on a grid of 256 points across the pupil."""
    across, padded = 256, 1024
    x = (np.arange(padded) - padded // 2) / (across / 2)
    radius2 = x[:, None] ** 2 + x**2
    pupil = (radius2 <= 1) * np.exp(2j * np.pi * waves * radius2)
    transfer = np.fft.ifft2(np.abs(np.fft.fft2(pupil)) ** 2)[0, : across + 1].real
    assert exact_otf(np.arange(across + 1) / across, waves) == pytest.approx(transfer / transfer[0], abs=1e-3)


def bend_paths(image_side_aperture, *, pixels=4096, samples=64):
    """Points on a lens (fractions of R), the angles (rad) of paths bent there, the waves, and the image distance."""
    backend.activate_backend(JIT)
    drive = FocalLengthDrive(0.1, 1 / (2 * image_side_aperture), (0.9, 0.4))
    waves = find_waves(drive, GRID, wavelength_m=WAVE_M)
    index = dr.arange(mi.UInt32, pixels * samples)
    pixel, sample = index // samples, index % samples
    _, _, lens = place_samples(pixel, sample, samples=samples, seed=5)
    point = mi.warp.square_to_uniform_disk_concentric(lens)
    angle = waves.bend(mi.Point2f(point * waves.radius_m), place_bends(pixel, sample, seed=5))
    return np.array(point, dtype=np.float64), np.array(angle, dtype=np.float64), waves, 0.1


def transfer_of_bent_paths(image_side_aperture, cycles_per_pixel, *, defocus):
    point, angle, _, image_distance = bend_paths(image_side_aperture, pixels=1024)
    x = image_distance * angle[0] + 2 * defocus[:, None] * WAVE_M / image_side_aperture * point[0]
    return np.array([[np.cos(2 * np.pi * nu * one).mean() for nu in cycles_per_pixel / PITCH_M] for one in x])


@needs_llvm
@pytest.mark.parametrize(("aperture", "bound"), [(0.25, 0.02), (0.024, 0.05), (0.015, 0.07)])
def test_bent_paths_have_the_transfer_of_the_lens(aperture, bound):
    """0 to 1.5 wavelengths of defocus, up to Nyquist; 65,536 paths, fixed seed, noise below 0.004.

    The first lens, at f/2, hardly feels waves. The largest errors of the others are 0.038 and 0.052; without bending
    they are 0.36 and 0.57.
    """
    cycles, defocus = np.linspace(0.05, 0.5, 10), np.linspace(0, 1.5, 16)
    seen = transfer_of_bent_paths(aperture, cycles, defocus=defocus)
    fraction = cycles / PITCH_M * WAVE_M / (2 * aperture)
    assert seen == pytest.approx(np.array([exact_otf(fraction, waves) for waves in defocus]), abs=bound)


@needs_llvm
def test_angles_spread_by_heisenbergs_relation():
    """σ = λ/(4π·d) along the radius and across it, and never more than 2σ; 262,144 paths in five rings.

    A variance of n angles that are even on an ellipse scatters by √(1/n) of itself; each of ten variances is within 5
    standard deviations (6e-7).
    """
    point, angle, waves, _ = bend_paths(0.024)
    r = np.hypot(*point)
    outward = point / r
    along, across = (outward * angle).sum(axis=0), outward[0] * angle[1] - outward[1] * angle[0]
    radius = waves.radius_m
    radial = WAVE_M / (4 * np.pi * radius * (1 - r))
    tangential = WAVE_M / (4 * np.pi * radius * np.sqrt(1 - r**2))
    for low, high in np.array([(0, 0.3), (0.3, 0.5), (0.5, 0.7), (0.7, 0.85), (0.85, 0.95)]):
        ring = (low <= r) & (r < high)
        for seen, sigma in ((along, radial), (across, tangential)):
            assert abs(np.mean((seen[ring] / sigma[ring]) ** 2) - 1) < 5 / np.sqrt(ring.sum())
    inner = r < 0.95
    assert ((along / radial) ** 2 + (across / tangential) ** 2)[inner].max() < 4 + 1e-3
    assert np.hypot(*angle).max() * 0.1 < waves.reach_m * (1 + 1e-5)


def test_no_light_reaches_farther_than_the_guard_band():
    """The nearest edge is a twentieth of the radius away: the reach is 3.2·λ·v/R, but at least one pixel."""
    waves = find_waves(DRIVES["stage"], GRID, wavelength_m=WAVE_M)
    assert waves.nearest_edge_m == pytest.approx(DRIVES["stage"].aperture_radius_m / 20)
    assert waves.reach_m == pytest.approx(20 / (2 * np.pi) * WAVE_M * 0.198 / 0.005)
    macro = ImageDistanceDrive(0.035, 2.0, (0.61, 0.38))
    assert find_waves(macro, GRID, wavelength_m=WAVE_M).reach_m == pytest.approx(PITCH_M)
    assert find_waves(macro, GRID, wavelength_m=0.0) is None


CYCLES = np.linspace(0.05, 0.5, 10)  # per pixel, up to Nyquist
SLANT = 1 / 8  # pixels across per row: distances to the edge fall on eighths of a pixel
CARD = "{focal_length_mm: 50, f_number: 15, focus_range_m: [0.24, 0.17]}"  # replaced by the lens of each test
BRIGHT = "'emitter': {'type': 'area', 'radiance': {'type': 'rgb', 'value': 1.0}}"


def glowing(folder, monkeypatch, drive, *, shapes, grid=GRID, wavelength_m=WAVE_M):
    """A scene of lamps at the depth that the middle of the travel focuses, written in millimetres."""
    distance = float(drive.focus_depth(0.5))
    scene = write_scene(
        folder, monkeypatch, lens=CARD, distance_m=distance, shapes=shapes, light="glow", target="glow", unit_m=0.001
    )
    return replace(load_setup(scene, ("glow",), grid=grid, drive=drive), wavelength_m=wavelength_m)


def edge_setup(folder, monkeypatch, drive, **options):
    """A bright half plane whose edge crosses the middle of the picture, slanted."""
    half = 0.5 * float(drive.focus_depth(0.5))
    tilt = math.degrees(math.atan(SLANT))
    shapes = (
        f"{{'glow': {{'type': 'rectangle', 'to_world': t.rotate([0, 0, 1], {tilt}).translate([{half} * m, 0, 0])"
        f".rotate([0, 1, 0], 180).scale({half} * m), {BRIGHT}}}}}"
    )
    return glowing(folder, monkeypatch, drive, shapes=shapes, **options)


def edge_transfer(image, cycles_per_pixel):
    """The transfer across a slanted edge, from its profile (ISO 12233), divided by that of the pixels' boxes.

    Along the rows, distances to the edge are multiples of an eighth of a pixel. The frequencies are along the normal
    of the edge.
    """
    rows, columns = image.shape
    row, column = np.mgrid[:rows, :columns]
    step = np.rint(column / SLANT + row).astype(int)
    step -= step.min()
    profile = np.bincount(step.ravel(), image.ravel().astype(np.float64)) / np.bincount(step.ravel())
    slope = np.diff(profile[rows:-rows])
    slope /= slope.sum()
    x = np.arange(slope.size) * SLANT
    along_rows = cycles_per_pixel * math.cos(math.atan(SLANT))
    down = cycles_per_pixel * math.sin(math.atan(SLANT))
    boxes = np.sinc(along_rows) * np.sinc(down) * np.sinc(along_rows * SLANT)
    wave = np.cos(2 * np.pi * along_rows[:, None] * (x - (x * slope).sum()))
    return (slope * wave).sum(axis=1) / boxes


@needs_llvm
@pytest.mark.slow
def test_a_slanted_edge_shows_the_transfer_of_the_lens(tmp_path, monkeypatch):
    """Within 0.05 of the exact transfer at seven positions, from 1.5 wavelengths on one side to 1.5 on the other.

    Seven million paths, fixed seed; between seeds the transfer scatters by 0.006.
    """
    drive = DRIVES["stage"]
    stack = render_stack_once(edge_setup(tmp_path, monkeypatch, drive), positions=7, samples=2048, seed=3)
    for position, image in zip(np.linspace(0, 1, 7), stack, strict=True):
        assert edge_transfer(image, CYCLES) == pytest.approx(expected_transfer(drive, position, CYCLES), abs=0.05)


@pytest.mark.slow
@needs_llvm
def test_without_waves_an_edge_shows_the_geometric_transfer(tmp_path, monkeypatch):
    """In focus it is 1 within 0.03; with waves it would be 0.64 at Nyquist."""
    setup = edge_setup(tmp_path, monkeypatch, DRIVES["focal_length"], wavelength_m=0.0)
    stack = render_stack_once(setup, positions=7, samples=1024, seed=3)
    assert edge_transfer(stack[3], CYCLES) == pytest.approx(1, abs=0.03)


def bent_paths_of(setup, *, positions=5, samples=64):
    """All paths of a stack on the sensor, as (position, path) arrays of pixels, and which of them count there."""
    focus = np.linspace(0, 1, positions)
    traced = [band.to_host() for _, band in one_pass.trace_paths(setup, focus, samples=samples, seed=1)]
    k = np.arange(positions)[:, None]
    joined = [None if part[0] is None else np.concatenate(part) for part in zip(*traced, strict=True)]
    first_x, first_y, step_x, step_y, radiance, begin, end = joined[:7]
    counts = np.ones((positions, first_x.size), bool) if begin is None else (begin <= k) & (k < end)
    return first_x + k * step_x, first_y + k * step_y, radiance, counts


STRONG = {  # waves move paths by five pixels and more, defocus by less than one
    "image_distance": ImageDistanceDrive(0.05, 30.0, (0.201, 0.199)),
    "focal_length": FocalLengthDrive(0.0667, 40.0, (0.201, 0.199)),
    "stage": Stage(0.018, 3.0, 10, (-3e-6, 3e-6)),
}


@needs_llvm
@pytest.mark.slow
def test_bent_paths_fall_as_densely_on_the_border_as_on_the_middle(tmp_path, monkeypatch):
    """The outermost pixels get the mean within 1 %; 140,000 paths, which scatter by 0.3 %.

    With a guard band that is not widened they would lack every fiftieth path, which is bent onto them from outside.
    """
    drive = STRONG["stage"]
    setup = edge_setup(tmp_path, monkeypatch, drive)
    assert find_waves(drive, GRID, wavelength_m=WAVE_M).reach_m > 5 * PITCH_M
    x, y, _, counts = bent_paths_of(setup, samples=1024)
    for k in range(5):
        seen = counts[k] & (x[k] >= 0) & (x[k] < GRID.columns) & (y[k] >= 0) & (y[k] < GRID.rows)
        inner = seen & (x[k] >= 1) & (x[k] < GRID.columns - 1) & (y[k] >= 1) & (y[k] < GRID.rows - 1)
        pixels, inside = GRID.rows * GRID.columns, (GRID.rows - 2) * (GRID.columns - 2)
        border = (seen.sum() - inner.sum()) / (pixels - inside)
        assert border == pytest.approx(inner.sum() / inside, rel=0.01)


@pytest.mark.parametrize("drive", STRONG.values(), ids=STRONG)
def test_every_bent_ray_of_a_position_is_covered(drive):
    """No ray of a position, with the largest possible bend, comes from outside the sampled region."""
    waves = find_waves(drive, GRID, wavelength_m=WAVE_M)
    covered = ray_coverage(drive, GRID, bend_reach_m=waves.reach_m)
    half = GRID.columns / 2 * PITCH_M
    for position in (0.0, 0.5, 1.0):
        corners = np.array([(x, a) for x in (-1, 1) for a in (-1, 1)]) * (half + waves.reach_m, drive.aperture_radius_m)
        x, a = np.linalg.inv(drive.ray_transfer(position)) @ corners.T
        assert np.abs(x).max() <= half + covered.columns * PITCH_M
        assert np.abs(a).max() <= covered.radius_m


@needs_llvm
def test_waves_leave_an_even_light_even(tmp_path, monkeypatch):
    setup = edge_setup(tmp_path, monkeypatch, STRONG["image_distance"])
    sky, integrator = mitsuba_scene.load_lit_scene(
        {"sky": {"type": "constant", "radiance": 3.0}}, ("sky",), max_depth=2
    )
    setup = replace(setup, mitsuba_scene=sky, integrator=integrator)
    assert render_stack_once(setup, positions=5, samples=32, seed=1) == pytest.approx(3.0, rel=1e-5)


@needs_llvm
@every_drive
def test_a_bend_moves_paths_by_v_times_an_angle(tmp_path, monkeypatch, drive):
    """With one guard band for both wavelengths, points differ by v/v_mid times the difference at the middle.

    The path in front of the lens does not change, and neither does its radiance.
    """
    setup = edge_setup(tmp_path, monkeypatch, drive)
    reach = find_waves(drive, GRID, wavelength_m=WAVE_M).reach_m
    covered = ray_coverage(drive, GRID, bend_reach_m=reach)
    monkeypatch.setattr(camera_rays, "ray_coverage", lambda *_, **__: covered)
    (x, y, radiance, counts), (x0, y0, radiance0, counts0) = (
        bent_paths_of(replace(setup, wavelength_m=wave)) for wave in (WAVE_M, 0.0)
    )
    assert np.array_equal(radiance, radiance0)
    assert np.array_equal(counts, counts0)
    v = drive.image_distance(np.linspace(0, 1, 5))[:, None]
    for bent, straight in ((x, x0), (y, y0)):
        angle = (bent - straight) * PITCH_M / v
        assert np.abs(angle).max() > 3 * PITCH_M / v[0]
        assert np.abs(angle - angle[2]).max() < 1e-4 * PITCH_M / v[0]


@needs_llvm
def test_bends_are_the_same_however_many_bands_are_traced(tmp_path, monkeypatch):
    setup = edge_setup(tmp_path, monkeypatch, DRIVES["stage"])
    one_band = bent_paths_of(setup)
    monkeypatch.setattr(camera_rays, "RAYS_PER_PASS", 1 << 14)
    for one, several in zip(one_band[:2], bent_paths_of(setup)[:2], strict=True):
        assert np.array_equal(np.sort(one, axis=1), np.sort(several, axis=1))


def test_scalar_refuses_a_stack_with_diffraction(test_scenes, tmp_path):
    plane = find_scene("plane")
    spec = StackSpec.from_scene(plane, GRID, positions=3, samples=1, max_depth=2, time_s=0.0, wavelength_m=WAVE_M)
    error = refusal(render_missing, plane, [spec], root=tmp_path, backend_name="scalar")
    assert error.problem == "variant scalar cannot render diffraction"
    assert error.allowed == "llvm, cuda"
    assert not list(tmp_path.iterdir())
