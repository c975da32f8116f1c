"""Rendered pictures of a lens with aberrations, against sums over its pupil and closed forms."""

import math
from dataclasses import replace

import numpy as np
import pytest
from refusals import refusal
from written_scenes import dispersion, load_setup, measure_edge, needs_llvm, render_stack_once, write_scene

from saf_gen.optics import FocalLengthDrive, ImageDistanceDrive, Stage, Wavefront
from saf_gen.optics.lens_card import Aberrations
from saf_gen.render import filtered_pass, render_missing
from saf_gen.render.camera_rays import cast_rays
from saf_gen.render.render_setup import SensorGrid
from saf_gen.render.scene_renderer import SceneRenderer
from saf_gen.scene.scene_folder import find_scene
from saf_gen.stack.focal_stack import StackSpec
from studies.laws.pupils import find_peak, pupil_transfer, seidel

WAVE_M, PITCH_M = 555e-9, 20e-6
GRID = SensorGrid(rows=24, columns=64, pitch_m=PITCH_M)
CARD = "{focal_length_mm: 50, f_number: 2, focus_range_m: [0.55, 0.45]}"  # replaced by the lens of each test
GLOW = "'emitter': {'type': 'area', 'radiance': {'type': 'rgb', 'value': 1.0}}"
SLANT = 1 / 8  # pixels across per row
TILT = math.degrees(math.atan(SLANT))
DRIVES = {
    "image_distance": ImageDistanceDrive(0.05, 2.0, (0.55, 0.45)),
    "focal_length": FocalLengthDrive(0.055, 2.0, (0.55, 0.45)),
    "stage": Stage(0.05, 2.0, 0.1, (-0.02, 0.02)),
}
every_drive = pytest.mark.parametrize("drive", DRIVES.values(), ids=DRIVES)


def aberrated(drive, *, height_m=1e-3, **waves):
    """The drive with aberrations in wavelengths of 555 nm at the edge of its aperture."""
    paths = {f"{name}_m": amount * WAVE_M for name, amount in waves.items()}
    return replace(drive, wavefront=Wavefront(**paths, radius_m=drive.aperture_radius_m, height_m=height_m))


def glowing(folder, monkeypatch, drive, *, shapes, grid=GRID, wavelength_m=0.0):
    """A scene of lamps at the depth that the middle of the travel focuses, written in millimetres."""
    distance = float(drive.focus_depth(0.5))
    scene = write_scene(
        folder, monkeypatch, lens=CARD, distance_m=distance, shapes=shapes, light="glow", target="glow", unit_m=0.001
    )
    return replace(load_setup(scene, ("glow",), grid=grid, drive=drive), wavelength_m=wavelength_m)


def edge_setup(folder, monkeypatch, drive, *, edge_m=0.0, tilt=TILT, **options):
    """A bright half plane whose edge crosses the picture, slanted unless ``tilt`` (degrees) says otherwise."""
    half = 0.5 * float(drive.focus_depth(0.5))
    shapes = (
        f"{{'glow': {{'type': 'rectangle', 'to_world': t.translate([{edge_m} * m, 0, 0]).rotate([0, 0, 1], {tilt})"
        f".translate([{half} * m, 0, 0]).rotate([0, 1, 0], 180).scale({half} * m), {GLOW}}}}}"
    )
    return glowing(folder, monkeypatch, drive, shapes=shapes, **options)


def edge_transfer(image, cycles_per_pixel):
    """The complex transfer across a slanted edge, from its profile (ISO 12233), divided by that of the pixels."""
    rows, columns = image.shape
    row, column = np.mgrid[:rows, :columns]
    step = np.rint(column / SLANT + row).astype(int)
    step -= step.min()
    profile = np.bincount(step.ravel(), image.ravel().astype(np.float64)) / np.bincount(step.ravel())
    slope = np.diff(profile[rows:-rows])
    slope /= slope.sum()
    x = np.arange(slope.size) * SLANT
    along_rows = cycles_per_pixel * math.cos(math.atan(SLANT))
    boxes = np.sinc(along_rows) * np.sinc(along_rows * SLANT) * np.sinc(along_rows * SLANT)
    return (slope * np.exp(-2j * np.pi * along_rows[:, None] * (x - (x * slope).sum()))).sum(axis=1) / boxes


@needs_llvm
@every_drive
def test_rays_are_turned_in_front_of_the_lens_and_nowhere_else(tmp_path, monkeypatch, drive):
    """Where each ray meets sensor and lens is that of the perfect lens; its slope differs by the gradient of W.

    The gradient is that of Seidel's sum by central differences; float32 keeps it to 1e-3 of its largest value.
    """
    waves = {"spherical": 3.0, "coma": 4.0, "astigmatism": 2.0, "field_curvature": -3.0}
    height = 5e-4
    lens = aberrated(drive, height_m=height, **waves)
    plain, bent = (
        next(cast_rays(edge_setup(tmp_path / str(n), monkeypatch, one), np.linspace(0, 1, 3), samples=4, seed=1))
        for n, one in enumerate(folder_of(tmp_path, drive, lens))
    )
    for name in ("x", "y"):
        assert np.array_equal(np.array(getattr(plain, name)), np.array(getattr(bent, name)))
    a, x = np.array(bent.lens, np.float64), np.stack([np.array(bent.x), np.array(bent.y)]).astype(np.float64)
    turned = np.stack(
        [np.array(bent.slope_x) - np.array(plain.slope_x), np.array(bent.slope_y) - np.array(plain.slope_y)]
    )
    radius, step = drive.aperture_radius_m, 1e-4

    def path(rho):
        return WAVE_M * seidel(**waves, eta=tuple(x / height))(*rho)

    rho = a / radius
    expected = np.stack(
        [(path(rho + step * unit) - path(rho - step * unit)) / (2 * step * radius) for unit in np.eye(2)[:, :, None]]
    )
    assert np.abs(expected).max() > 1e-4
    assert turned == pytest.approx(expected, abs=1e-3 * np.abs(expected).max())


def folder_of(tmp_path, *drives):
    for n in range(len(drives)):
        (tmp_path / str(n)).mkdir()
    return drives


EDGE_M, EDGE_HEIGHT_M = 0.036, 4e-3  # about, on the target and on the sensor
WIDE = SensorGrid(rows=24, columns=480, pitch_m=PITCH_M)
LENSES = [
    (2.0, {"spherical": 1.0, "astigmatism": 1.0}),
    *(
        pytest.param(f_number, waves, marks=pytest.mark.slow)
        for f_number in (1.4, 2.0, 4.0)
        for waves in (
            {"astigmatism": 2.0},
            {"spherical": 2.0, "coma": 1.0},
            {"spherical": 4.0, "astigmatism": 2.0},
            {"field_curvature": 1.0, "spherical": -1.0},
        )
    ),
]


@pytest.mark.slow
@pytest.mark.daily(3)
@needs_llvm
@pytest.mark.parametrize(("f_number", "waves"), LENSES)
def test_an_edge_shows_the_transfer_of_the_pupil(tmp_path, monkeypatch, f_number, waves):
    """Within 0.03 from 3 wavelengths of defocus on one side to 3 on the other, up to Nyquist, diffraction and all.

    The edge is 4 mm from the middle of the sensor, where the aberrations are stated. Seven positions, 1024 samples,
    4096 at f/4, fixed seed; between seeds the transfer scatters by 0.008 and 0.004.
    """
    drive = travelling(f_number, waves=3.0)
    lens = aberrated(drive, height_m=EDGE_HEIGHT_M, **waves)
    setup = edge_setup(tmp_path, monkeypatch, lens, edge_m=EDGE_M, grid=WIDE, wavelength_m=WAVE_M)
    stack = render_stack_once(setup, positions=7, samples=1024 if f_number < 4 else 4096, seed=3)
    cycles = np.linspace(0.05, 0.5, 10)
    radius = drive.aperture_radius_m
    for position, image in zip(np.linspace(0, 1, 7), stack, strict=True):
        middle = int(np.abs(np.diff(image.mean(axis=0))).argmax()) + 1
        eta = (middle - WIDE.columns / 2) * PITCH_M / EDGE_HEIGHT_M
        assert abs(eta) == pytest.approx(1, abs=0.1)
        v = float(drive.image_distance(position))
        defocus = float(drive.defocus(position, drive.focus_depth(0.5))) * radius**2 / 2 / WAVE_M
        expected = pupil_transfer(
            seidel(**waves, defocus=defocus, eta=(eta, 0.0)), fractions=cycles / PITCH_M * WAVE_M * v / (2 * radius)
        )
        seen = edge_transfer(image[:, middle - 40 : middle + 40], cycles)
        assert np.abs(seen) == pytest.approx(np.abs(expected), abs=0.03)


def travelling(f_number, *, waves):
    """A liquid lens whose travel goes from ``waves`` wavelengths of defocus at 0.5 m on one side to the other."""
    v = 0.055
    edge = waves * WAVE_M * 2 / (v / (2 * f_number)) ** 2
    return FocalLengthDrive(v, f_number, (1 / (2 + edge), 1 / (2 - edge)))


@needs_llvm
@pytest.mark.parametrize(("turned", "shift"), [(0, -(2.5 + 7.5)), (90, -2.5)])
def test_astigmatism_parts_the_foci_of_edges_across_and_along(tmp_path, monkeypatch, turned, shift):
    """An edge across the line to the axis is sharpest at W020 = -(W220 + W222)·η², one along it at -W220·η².

    The picture is turned instead of the edge: 4 mm from the middle of the sensor in x, or in y. Blur by rays, 21
    positions from -15 to 15 wavelengths, up to 5 pixels; the narrowest edge is
    within a fifth of a step.
    """
    drive = travelling(2.0, waves=15.0)
    lens = aberrated(drive, height_m=EDGE_HEIGHT_M, astigmatism=7.5, field_curvature=2.5)
    grid, edge_m = (WIDE, EDGE_M) if turned == 0 else (replace(WIDE, rows=464, columns=40), 0.0)
    setup = edge_setup(tmp_path, monkeypatch, lens, edge_m=edge_m, tilt=0, grid=grid)
    stack = render_stack_once(setup, positions=21, samples=96 if turned == 0 else 32, seed=3)
    if turned == 0:
        middle = int(np.abs(np.diff(stack[10].mean(axis=0))).argmax()) + 1
        images = stack[:, :, middle - 20 : middle + 20]
        eta = (middle - grid.columns / 2) * PITCH_M / EDGE_HEIGHT_M
    else:
        images, eta = stack[:, 20:44], (32 - grid.rows / 2) * PITCH_M / EDGE_HEIGHT_M
    widths = np.array([measure_edge(image, PITCH_M)[0] for image in images])
    waves = -15 + 30 * find_peak(-(widths**2)) / 20
    sign = np.sign(float(drive.defocus(1.0, drive.focus_depth(0.5))))
    assert sign * waves == pytest.approx(shift * eta**2, abs=0.3)


@pytest.mark.slow
@needs_llvm
def test_shared_shading_sees_the_lens_of_plain_paths(tmp_path, monkeypatch):
    """Both estimators show the sharpness of an edge alike at every position, in long windows and in short ones.

    Within 0.2 %; a lens without the aberrations differs by 0.9 % at an end.
    """
    drive = travelling(2.0, waves=3.0)
    lens = aberrated(drive, spherical=2.0)
    folders = [tmp_path / name for name in ("bent", "plain")]
    for folder in folders:
        folder.mkdir()
    setup, perfect = (edge_setup(f, monkeypatch, d) for f, d in zip(folders, (lens, drive), strict=True))
    plain = dispersion(render_stack_once(setup, positions=7, samples=512, seed=3))
    whole = dispersion(filtered(setup, positions=7))
    short = dispersion(filtered(setup, positions=7, window=(0, 2)))
    other = dispersion(render_stack_once(perfect, positions=7, samples=512, seed=3))
    assert whole == pytest.approx(plain, rel=2e-3)
    assert short == pytest.approx(plain[:3], rel=2e-3)
    assert np.abs(other / plain - 1).max() > 8e-3


def filtered(setup, **options):
    asked = {"samples": 512, "emitting": ["glow"]}
    shading = filtered_pass.estimate_shading([filtered_pass.gather_shading({"glow": setup}, seed=1001, **asked)])
    return filtered_pass.render_with_shading({"glow": setup}, shading, seed=1, **asked, **options)["glow"][0]


def test_scalar_refuses_a_lens_with_aberrations(test_scenes, tmp_path):
    plane = find_scene("plane")
    spec = StackSpec.from_scene(plane, GRID, positions=3, samples=1, max_depth=2, time_s=0.0, wavelength_m=0.0)
    spec = replace(spec, drive=aberrated(spec.drive, spherical=1.0))
    error = refusal(render_missing, plane, [spec], root=tmp_path, backend_name="scalar")
    assert error.problem == "variant scalar cannot render the aberrations of a lens"
    assert error.allowed == "llvm, cuda"
    assert not list(tmp_path.iterdir())


def test_stacks_of_a_perfect_lens_keep_their_names(test_scenes):
    """The name is that of version 2.0; aberrations give another one."""
    plane = find_scene("plane")
    spec = StackSpec.from_scene(plane, GRID, positions=3, samples=1, max_depth=2, time_s=0.0, wavelength_m=0.0)
    assert "wavefront" not in spec.as_dict()["drive"]
    assert replace(spec, drive=aberrated(spec.drive, spherical=1.0)).key != spec.key


def test_scalar_refuses_to_show_a_lens_with_aberrations_as_a_perfect_one(test_scenes):
    """Previews and checks, which take the lens of the card, too."""
    plane = find_scene("plane")
    lens = plane.card.lens.model_copy(update={"aberrations": Aberrations(spherical=1.0)})
    bent = replace(plane, card=plane.card.model_copy(update={"lens": lens}))
    assert refusal(SceneRenderer, bent, GRID, backend_name="scalar").allowed == "llvm, cuda"
    SceneRenderer(plane, GRID, backend_name="scalar")
