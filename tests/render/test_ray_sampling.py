"""Which rays are sampled: every position must find all of its rays among them, evenly."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from scipy.stats import chi2
from written_scenes import needs_llvm

from saf_gen.optics import FocalLengthDrive, ImageDistanceDrive, Stage
from saf_gen.render import backend, one_pass
from saf_gen.render.ray_sampling import compute_ray_coverage
from saf_gen.render.render_setup import SensorGrid

GRID = SensorGrid(rows=12, columns=20, pitch_m=100e-6)
DRIVES = {
    "image_distance": ImageDistanceDrive(0.05, 2.0, (0.4, 0.25)),
    "focal_length": FocalLengthDrive(0.06, 2.0, (0.4, 0.25)),
    "stage": Stage(0.05, 2.0, 0.25, (0.06, -0.04)),
}
every_drive = pytest.mark.parametrize("drive", DRIVES.values(), ids=DRIVES)


def on_a_disc(random, count, radius):
    angle, r = random.uniform(0, 2 * np.pi, count), radius * np.sqrt(random.random(count))
    return r * np.cos(angle), r * np.sin(angle)


def transfer(drive, position, x, a):
    m = drive.ray_transfer(position)
    return m[0, 0] * x + m[0, 1] * a, m[1, 0] * x + m[1, 1] * a


@every_drive
@pytest.mark.parametrize("position", [0.0, 0.3, 1.0])
def test_every_ray_of_a_position_is_covered(drive, position):
    """20,000 rays over sensor and aperture, traced back to the reference: none is outside at any position."""
    random = np.random.default_rng(2)
    covered = compute_ray_coverage(drive, GRID)
    half_x, half_y = GRID.columns / 2 * GRID.pitch_m, GRID.rows / 2 * GRID.pitch_m
    x, y = random.uniform(-half_x, half_x, 20_000), random.uniform(-half_y, half_y, 20_000)
    a, b = on_a_disc(random, 20_000, drive.aperture_radius_m)
    back = np.linalg.inv(drive.ray_transfer(position))
    (x, a), (y, b) = back @ np.array([x, a]), back @ np.array([y, b])
    assert np.abs(x).max() <= half_x + covered.columns * GRID.pitch_m
    assert np.abs(y).max() <= half_y + covered.rows * GRID.pitch_m
    assert np.hypot(a, b).max() <= covered.radius_m * (1 + 1e-12)


def test_a_lens_that_stays_in_the_rays_needs_no_more_than_its_aperture():
    assert compute_ray_coverage(DRIVES["image_distance"], GRID).radius_m == DRIVES["image_distance"].aperture_radius_m
    assert compute_ray_coverage(DRIVES["focal_length"], GRID).radius_m == DRIVES["focal_length"].aperture_radius_m
    assert compute_ray_coverage(DRIVES["stage"], GRID).radius_m > DRIVES["stage"].aperture_radius_m


@every_drive
@pytest.mark.parametrize("position", [0.0, 0.3, 1.0])
def test_what_a_position_sees_is_even_over_sensor_and_aperture(drive, position):
    """χ² of counts in 240 cells of equal measure (3 × 5 sensor, 4 × 4 aperture), from 600,000 even rays.

    Bound at a significance of 1e-6 each. Were the aperture's window left out, or the border too narrow, cells
    would differ by tens of percent; 1 % in one row of cells would be found.
    """
    random = np.random.default_rng(7)
    covered, count = compute_ray_coverage(drive, GRID), 600_000
    half_x = (GRID.columns / 2 + covered.columns) * GRID.pitch_m
    half_y = (GRID.rows / 2 + covered.rows) * GRID.pitch_m
    x, y = random.uniform(-half_x, half_x, count), random.uniform(-half_y, half_y, count)
    a, b = on_a_disc(random, count, covered.radius_m)
    (x, a), (y, b) = transfer(drive, position, x, a), transfer(drive, position, y, b)
    x, y = x / (GRID.columns * GRID.pitch_m) + 0.5, y / (GRID.rows * GRID.pitch_m) + 0.5
    area, turn = (a**2 + b**2) / drive.aperture_radius_m**2, np.arctan2(b, a) / (2 * np.pi) + 0.5
    seen = np.stack([x, y, area, turn], axis=1)
    seen = seen[((seen >= 0) & (seen < 1)).all(axis=1)]
    cells, _ = np.histogramdd(seen, bins=(5, 3, 4, 4), range=[(0, 1)] * 4)
    expected = len(seen) / cells.size
    assert expected > 100
    assert ((cells - expected) ** 2 / expected).sum() < chi2.ppf(1 - 1e-6, cells.size - 1)


@needs_llvm
def test_a_path_counts_at_the_positions_that_have_it_in_the_aperture():
    """4,000 lines across the lens against asking each of 33 positions; a border may round to either side."""
    backend.activate_render_backend("llvm")
    drive, random = DRIVES["stage"], np.random.default_rng(3)
    radius = drive.aperture_radius_m
    first, step = random.normal(0, radius, (2, 4000)), random.normal(0, radius / 12, (2, 4000))
    step[:, :400] *= 1e-6  # hardly move
    step[:, 400:500] = 0
    begin, end = one_pass.positions_through_aperture(mi.Point2f(first), mi.Vector2f(step), radius=radius, positions=33)
    dr.eval(begin, end)
    k = np.arange(33)[:, None]
    counts = (np.array(begin) <= k) & (k < np.array(end))
    inside = np.hypot(first[0] + k * step[0], first[1] + k * step[1]) <= radius
    assert 0.1 < inside.mean() < 0.9
    assert (counts == inside).mean() > 0.9999
    assert np.array(begin).min() >= 0
