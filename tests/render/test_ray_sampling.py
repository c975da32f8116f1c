"""The sampled rays: they must contain all rays of every position, evenly."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from scipy.stats import chi2
from written_scenes import JIT, needs_llvm

from saf_gen.optics import FocalLengthDrive, ImageDistanceDrive, Stage
from saf_gen.render import backend, camera_rays
from saf_gen.render.ray_sampling import permute_samples, place_samples, ray_coverage
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


@every_drive
@pytest.mark.parametrize("position", [0.0, 1.0])
def test_every_ray_of_a_position_is_covered(drive, position):
    """20,000 rays over sensor and aperture, traced back to the reference position: none is outside."""
    random = np.random.default_rng(2)
    covered = ray_coverage(drive, GRID)
    half_x, half_y = GRID.columns / 2 * GRID.pitch_m, GRID.rows / 2 * GRID.pitch_m
    x, y = random.uniform(-half_x, half_x, 20_000), random.uniform(-half_y, half_y, 20_000)
    a, b = on_a_disc(random, 20_000, drive.aperture_radius_m)
    back = np.linalg.inv(drive.ray_transfer(position))
    (x, a), (y, b) = back @ np.array([x, a]), back @ np.array([y, b])
    assert np.abs(x).max() <= half_x + covered.columns * GRID.pitch_m
    assert np.abs(y).max() <= half_y + covered.rows * GRID.pitch_m
    assert np.hypot(a, b).max() <= covered.radius_m * (1 + 1e-12)


def test_a_lens_that_stays_in_the_rays_needs_no_more_than_its_aperture():
    assert ray_coverage(DRIVES["image_distance"], GRID).radius_m == DRIVES["image_distance"].aperture_radius_m
    assert ray_coverage(DRIVES["focal_length"], GRID).radius_m == DRIVES["focal_length"].aperture_radius_m
    assert ray_coverage(DRIVES["stage"], GRID).radius_m > DRIVES["stage"].aperture_radius_m


@needs_llvm
def test_a_path_counts_at_the_positions_that_have_it_in_the_aperture():
    """4,000 lines across the lens against a test at each of 33 positions; at a border rounding may differ."""
    backend.activate_backend(JIT)
    drive, random = DRIVES["stage"], np.random.default_rng(3)
    radius = drive.aperture_radius_m
    first, step = random.normal(0, radius, (2, 4000)), random.normal(0, radius / 12, (2, 4000))
    step[:, :400] *= 1e-6  # barely move
    step[:, 400:500] = 0
    line = mi.Point2f(first), mi.Vector2f(step)
    begin, end = camera_rays.through_aperture(*line, radius=radius, positions=33)
    dr.eval(begin, end)
    k = np.arange(33)[:, None]
    counts = (np.array(begin) <= k) & (k < np.array(end))
    inside = np.hypot(first[0] + k * step[0], first[1] + k * step[1]) <= radius
    assert 0.1 < inside.mean() < 0.9
    assert (counts == inside).mean() > 0.9999
    assert np.array(begin).min() >= 0


def samples_of(samples, *, pixels=64, seed=5):
    """Offsets in the pixel and points on the lens of each pixel's samples, (4, pixel, sample)."""
    backend.activate_backend(JIT)
    index = dr.arange(mi.UInt32, pixels * samples)
    across, down, lens = place_samples(index // samples, index % samples, samples=samples, seed=seed)
    return np.array([across, down, lens.x, lens.y], dtype=np.float64).reshape(4, pixels, samples)


@needs_llvm
@pytest.mark.parametrize("samples", [16, 64])
def test_every_box_of_one_samples_area_holds_one_sample(samples):
    """Elementary intervals of every shape, 1 × 1/N to 1/N × 1, over pixel and lens of each of 64 pixels."""
    placed, bits = samples_of(samples), samples.bit_length() - 1
    assert (placed >= 0).all()
    assert (placed < 1).all()
    for first, second in (placed[:2], placed[2:]):
        for across in range(bits + 1):
            box = np.int64(first * 2**across) * 2 ** (bits - across) + np.int64(second * 2 ** (bits - across))
            assert (np.sort(box, axis=1) == np.arange(samples)).all()


@needs_llvm
@pytest.mark.parametrize("samples", [1, 3, 100])
def test_counts_that_are_no_power_of_two_are_even_too(samples):
    """Every box anchored at the corner holds its fraction of all points within (log₂N + 2)/N, as a (0,2)-sequence.

    H. Niederreiter, Random Number Generation and Quasi-Monte Carlo Methods (1992), theorem 4.12: N·D* is at most
    log₂(N)/2 + 3/2 in base 2 and two dimensions; flipping digits keeps the net. The lens has the same points.
    """
    placed, corner = samples_of(samples, pixels=8), np.linspace(0, 1, 21)
    for first, second in (placed[:2], placed[2:]):
        for a in corner:
            for b in corner:
                inside = ((first < a) & (second < b)).mean(axis=1)
                assert np.abs(inside - a * b).max() * samples <= np.log2(samples) + 2


@needs_llvm
@pytest.mark.parametrize("samples", [1, 2, 3, 24, 1025])
def test_samples_are_permuted_as_mitsuba_does_it(samples):
    """Bit for bit for 4,096 words; the order of each word is a permutation."""
    backend.activate_backend(JIT)
    word = dr.repeat(mi.sample_tea_32(dr.arange(mi.UInt32, 4096), mi.UInt32(11), 4)[0], samples)
    index = dr.arange(mi.UInt32, 4096 * samples) % samples
    own = permute_samples(index, samples, word=word).numpy()
    assert (own == mi.permute_kensler(index, samples, word).numpy()).all()
    assert (np.sort(own.reshape(4096, samples), axis=1) == np.arange(samples)).all()


@needs_llvm
def test_pixel_and_lens_are_independent():
    """Samples of a pixel are matched to parts of the lens at random: χ² of 4 × 4 × 4 × 4 boxes, 2,048 pixels of 64.

    Significance 1e-6. The bound is one-sided, because the nets make counts in either half more even than chance.
    """
    placed = samples_of(64, pixels=2048)
    boxes, _ = np.histogramdd(placed.reshape(4, -1).T, bins=4, range=[(0, 1)] * 4)
    expected = placed[0].size / boxes.size
    assert ((boxes - expected) ** 2 / expected).sum() < chi2.ppf(1 - 1e-6, boxes.size - 1)


@needs_llvm
def test_every_pixel_and_every_seed_has_points_of_its_own():
    placed = samples_of(16, pixels=256)
    assert np.array_equal(placed, samples_of(16, pixels=256))
    for other in (samples_of(16, pixels=256, seed=6), samples_of(16, pixels=256, seed=7)):
        assert (placed != other).mean() > 0.999
    for axis in placed:
        assert len(np.unique(axis[:, 0])) > 250  # 256 pixels: chance alone repeats none of 2^24 values
    # The order on the lens also differs between pixels: the 16 boxes of the lens, sample by sample. Orders are drawn
    # from a few thousand, so that some of 256 are equal.
    box = np.int64(placed[2] * 4) * 4 + np.int64(placed[3] * 4)
    assert len(np.unique(np.bitwise_xor(box, box[:, :1]), axis=0)) > 230


@needs_llvm
def test_samples_are_the_same_whatever_backend_was_used_before():
    llvm = samples_of(16)
    backend.activate_backend("scalar")
    assert np.array_equal(samples_of(16), llvm)
