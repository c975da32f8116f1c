"""The rays that are cast and the light that they bring, against closed forms of sensor, lens and edge."""

import math
from dataclasses import replace

import drjit as dr
import numpy as np
import pytest
from scipy.stats import chi2
from written_scenes import load_setup, needs_llvm, render_filtered, write_edge_scene, write_scene

from saf_gen.optics import FocalLengthDrive, ImageDistanceDrive, Stage
from saf_gen.render import camera_rays, one_pass
from saf_gen.render.ray_sampling import ray_coverage
from saf_gen.render.render_setup import SensorGrid
from saf_gen.scene.scene_folder import find_scene

pytestmark = needs_llvm

DRIVES = {  # with the radius of the aperture: f/(2N), or v/(2N) for a varifocal lens
    "image_distance": (ImageDistanceDrive(0.025, 2.0, (0.60, 0.42)), 0.025 / 4),
    "focal_length": (FocalLengthDrive(0.0263, 2.0, (0.60, 0.42)), 0.0263 / 4),
    "stage": (Stage(0.025, 2.0, 1 / 19, (-0.08, 0.10)), 0.025 / 4),
}
every_drive = pytest.mark.parametrize(("drive", "radius_m"), DRIVES.values(), ids=DRIVES)


def cast(setup, *, samples):
    """All rays of three positions over the travel: pixel numbers, and the paths as numpy arrays."""
    focus = np.linspace(0, 1, 3)
    pixels, paths = [], []
    for rays in camera_rays.cast_rays(setup, focus, samples=samples, seed=1):
        landed = camera_rays.land_on_sensor(rays, setup, focus=focus, seed=1)
        pixels.append(rays.pixel.numpy())
        paths.append(landed.to_host())
    return np.concatenate(pixels), [
        None if part[0] is None else np.concatenate(part) for part in zip(*paths, strict=True)
    ]


@pytest.mark.parametrize(
    "drives",
    [
        (ImageDistanceDrive(0.025, 2.0, (0.60, 0.42)), ImageDistanceDrive(0.05, 4.0, (0.7, 0.3))),
        (Stage(0.025, 2.0, 1 / 19, (-0.08, 0.10)), Stage(0.05, 4.0, 1 / 9, (-0.02, 0.03))),
    ],
    ids=["image_distance", "stage"],
)
def test_one_kernel_casts_the_rays_of_every_sensor_lens_and_number_of_samples(test_scenes, drives):
    """The kernel, which takes a tenth of a second to compile, reads them as data."""
    used = []
    choices = zip(drives, [(24, 40, 60e-6), (20, 33, 17e-6)], [16, 7], strict=True)
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        for drive, grid, samples in choices:
            setup = replace(load_setup(find_scene("plane"), drive=drive), grid=SensorGrid(*grid))
            dr.kernel_history_clear()
            cast(setup, samples=samples)
            used.append({kernel["hash"] for kernel in dr.kernel_history() if kernel["type"] is dr.KernelType.JIT})
    assert used[0] == used[1] != set()


@every_drive
def test_a_ray_meets_its_own_pixel_at_the_middle_of_the_travel(test_scenes, drive, radius_m):
    """Within 10⁻³ pixel, for single precision; rays are even over the pixel, and their mean is its centre."""
    setup = load_setup(find_scene("plane"), drive=drive)
    covered = ray_coverage(drive, setup.grid)
    pixel, (first_x, first_y, step_x, step_y, *_) = cast(setup, samples=16)
    row, column = np.divmod(pixel.astype(np.int64), setup.grid.columns + 2 * covered.columns)
    for landed, cell in ((first_x + step_x, column - covered.columns), (first_y + step_y, row - covered.rows)):
        inside = landed.astype(np.float64) - cell
        assert -1e-3 < inside.min() < 0.01
        assert 0.99 < inside.max() < 1 + 1e-3
        assert inside.mean() == pytest.approx(0.5, abs=1e-3)


@every_drive
@pytest.mark.parametrize("k", [0, 2])
def test_the_rays_of_a_position_fill_its_aperture_evenly(test_scenes, drive, radius_m, k):
    """Where paths cross the sensor at two positions determines where they pass the lens.

    No ray passes beyond R, and χ² of 8 rings of equal area by 8 sectors is below its bound at a significance of 10⁻⁶;
    at least 30,000 rays, seed 1. The test is one-sided, because Sobol's sequence is more even than chance.
    """
    setup = load_setup(find_scene("plane"), drive=drive)
    _, (first_x, first_y, step_x, step_y, _, begin, end, _) = cast(setup, samples=16)
    transfer, pitch, lens = drive.ray_transfer(np.array([0.0, 1.0])), setup.grid.pitch_m, []
    seen = np.ones(first_x.size, bool) if begin is None else (begin <= k) & (k < end)
    for first, step, pixels in ((first_x, step_x, setup.grid.columns), (first_y, step_y, setup.grid.rows)):
        ends = (first + np.array([[0], [2]]) * step.astype(np.float64) - pixels / 2) * pitch
        x, a = np.linalg.solve(transfer[:, 0], ends)  # at the middle position
        lens.append(transfer[k // 2, 1] @ np.stack([x, a]))
        seen &= abs(ends[k // 2]) < pixels / 2 * pitch
    a, b = np.array(lens)[:, seen] / radius_m
    area = a**2 + b**2
    assert area.size > 30_000
    assert 0.995 < area.max() < 1 + 2e-3
    cells, *_ = np.histogram2d(area, np.arctan2(b, a), bins=8, range=[(0, 1 + 2e-3), (-np.pi, np.pi)])
    expected = area.size / cells.size
    assert ((cells - expected) ** 2 / expected).sum() < chi2.ppf(1 - 1e-6, cells.size - 1)


def edge_of_a_disc(x, width):
    """Light at x across an edge blurred by an even disc of this diameter: the fraction of the disc on one side."""
    t = np.clip(2 * x / width, -1, 1)
    return 0.5 + (t * np.sqrt(1 - t**2) + np.arcsin(t)) / np.pi


@pytest.mark.slow
def test_the_profile_of_a_blurred_edge_is_that_of_a_disc(tmp_path, monkeypatch):
    """Means over four columns are within 0.003 of the edge of a disc of diameter c at its place.

    Two pictures of 40 rows of 768 samples; over six seeds the means scatter by 0.0003, and the largest error of 48 is
    0.0014. An aperture that is 3 % too wide would give an error of 0.009, a normal pupil of the same variance 0.037,
    and an edge shifted by a quarter of a pixel 0.015.
    """
    drive, height, distance = ImageDistanceDrive(0.025, 2.0, (0.60, 0.42)), 0.001, 0.5
    grid = SensorGrid(rows=40, columns=96, pitch_m=5e-6)
    card = "{focal_length_mm: 25, f_number: 2.0, focus_range_m: [0.60, 0.42]}"
    scene = write_edge_scene(tmp_path, monkeypatch, lens=card, distance_m=distance, edge_m=height)
    setup = load_setup(scene, ("glow",), grid=grid, drive=drive)
    stack, _ = one_pass.render_stack(setup, positions=3, samples=768, seed=3)
    fine = (np.arange(grid.columns * 16) + 0.5) / 16 - grid.columns / 2
    for position, image in zip((0.0, 1.0), stack[::2], strict=True):
        v, sharp = (1 / (1 / 0.025 - 1 / u) for u in (float(drive.object_distance(position)), distance))
        width = 0.0125 * abs(v / sharp - 1) / grid.pitch_m
        centre = -v / distance * height / grid.pitch_m
        assert width > 15
        profile = edge_of_a_disc(centre - fine, width).reshape(-1, 64).mean(axis=1)
        seen = image.astype(np.float64).mean(axis=0).reshape(-1, 4).mean(axis=1)
        assert seen == pytest.approx(profile, abs=3e-3)


BRIGHT, TEXELS = 500.0, 41


@pytest.mark.parametrize(("estimator", "bands"), [("plain", 1), ("plain", 20), ("filtered", 20)])
def test_a_small_lamp_keeps_its_light_in_focus_and_out_of_it(tmp_path, monkeypatch, estimator, bands):
    """A lamp of 500 times the radiance of its surroundings: the picture's sum is radiance times area, within 2 %.

    At each position the lamp covers (v/d·width/pitch)² pixels, spread over its blur. 64 samples; the sum scatters by
    0.4 %. With few rows at a time a trial of one sample per pixel bounds the light of paths.
    """
    drive, distance, grid = ImageDistanceDrive(0.025, 2.0, (0.55, 0.46)), 0.5, SensorGrid(40, 40, 60e-6)
    half = 0.06
    pattern = (
        f"np.where(np.add.outer(abs(np.arange({TEXELS}) - 20), abs(np.arange({TEXELS}) - 20)) == 0, {BRIGHT}, 1.0)"
    )
    shapes = (
        f"{{'lamp': {{'type': 'rectangle', 'to_world': t.rotate([0, 1, 0], 180).scale({half} * m), 'emitter':"
        " {'type': 'area', 'radiance': {'type': 'bitmap', 'raw': True, 'filter_type': 'nearest',"
        f" 'bitmap': mi.Bitmap({pattern}.astype(np.float32)[..., None])}}}}}}}}"
    )
    card = "{focal_length_mm: 25, f_number: 2.0, focus_range_m: [0.55, 0.46]}"
    scene = write_scene(
        tmp_path, monkeypatch, lens=card, distance_m=distance, shapes=shapes, light="lamp", target="lamp"
    )
    setup = load_setup(scene, ("lamp",), grid=grid, drive=drive)
    monkeypatch.setattr(camera_rays, "RAYS_PER_PASS", math.ceil(64 * 60 * 60 / bands))
    if estimator == "plain":
        stack, _ = one_pass.render_stack(setup, positions=3, samples=64, seed=3)
    else:
        stack = render_filtered({"lamp": setup}, samples=64, positions=3, seed=3)["lamp"]
    width = 2 * half / TEXELS * drive.image_distance(np.linspace(0, 1, 3)) / distance / grid.pitch_m
    excess = stack.astype(np.float64).sum(axis=(1, 2)) - grid.rows * grid.columns
    assert excess == pytest.approx((BRIGHT - 1) * width**2, rel=0.02)
