"""The truth is that of the target's pixels: two depths in a mask, and a third depth in the rest of the frame."""

from dataclasses import replace

import numpy as np
import pytest

from saf_gen.optics import FocalLengthDrive, ImageDistanceDrive, Stage
from saf_gen.stack.focal_stack import StackSpec
from saf_gen.stack.time_resolved import PlaneSource, TimeResolvedStack
from saf_gen.stack.true_focus import find_true_focus

FRAMES, AT = 400, (0, 160, 320, 480)
SWEEP = (np.arange(FRAMES) + 0.5) / FRAMES
POSITIONS = np.linspace(0, 1, 100_001)
DRIVES = {
    "image_distance": ImageDistanceDrive(0.025, 2.0, (0.6, 0.42)),
    "focal_length": FocalLengthDrive(0.025, 2.0, (0.6, 0.42)),
    "stage": Stage(0.025, 2.0, 1 / 19, (-0.08, 0.10)),
}
each_drive = pytest.mark.parametrize("drive", DRIVES.values(), ids=DRIVES)


def scene_at(n=0):
    """Depth and target at moment n: 9 pixels at 0.53 m and 5 at 0.47 m; the rest of the frame is at 0.58 m.

    From moment to moment the target comes 1 cm nearer and moves down by a row; the rest moves away by 5 mm.
    """
    depth, target = np.full((9, 12), 0.58 + 0.005 * n), np.zeros((9, 12), bool)
    target[n : n + 2, 0:7] = True
    depth[n, 0:7], depth[n + 1, 0:7] = 0.53 - 0.01 * n, 0.47 - 0.01 * n
    depth[n + 1, 0:2] = 0.53 - 0.01 * n
    return depth.astype(np.float32), target


def sources(drive, moments):
    """A static scene, or several moments of a moving one, without light."""
    spec = StackSpec("plane", "0" * 64, ("lamp",), drive, 9, 12, 60e-6, 9, 16, 4)
    specs = [replace(spec, time_s=at / 20_000, window=(0, 8)) for at in AT[:moments]] if moments > 1 else [spec]
    return PlaneSource(TimeResolvedStack(AT[:moments], tuple(specs)), lambda *which: np.empty(0), scene_at, "d", "llvm")


def sharpest(drive, n=0):
    """The position with the smallest mean of c² over the target's pixels, by exhaustive search, to 10⁻⁵."""
    depth, target = scene_at(n)
    depths, counts = np.unique(depth[target], return_counts=True)
    squares = [drive.blur_diameter(POSITIONS, float(one)) ** 2 for one in depths]
    return POSITIONS[np.argmin(np.average(squares, axis=0, weights=counts))]


def assert_depth_of_focus_is_round(drive, truth):
    """Assert that a point that is sharp at the true position is blurred equally at both ends."""
    low, high = truth.depth_of_focus
    assert low < truth.position < high
    sharp = float(drive.focus_depth(truth.position))
    near, far = drive.blur_diameter(np.array([low, high]), sharp)
    assert near == pytest.approx(far, rel=1e-6)


@each_drive
def test_the_truth_of_a_still_target_is_the_compromise_of_its_own_depths(drive):
    depth, target = scene_at()
    truth, _ = find_true_focus(sources(drive, 1), SWEEP)
    best = sharpest(drive)
    assert truth.position == pytest.approx(best, abs=2e-5)
    assert truth.frame == pytest.approx(best * FRAMES - 0.5, abs=0.01)
    assert truth.track is None
    assert_depth_of_focus_is_round(drive, truth)
    assert np.array_equal(truth.target, target)
    assert truth.best_position == pytest.approx(drive.best_position(depth), abs=1e-6)
    # The truth of any other set of pixels is at least 0.05 of the travel away.
    others = [depth, depth[4:5, 6:7], depth[0:1], depth[1:2, 2:7], np.array([0.47, 0.53])]
    apart = [abs(drive.least_blur(np.ravel(one)) - best) for one in others]
    assert min(apart[:4]) > 0.05
    assert apart[4] > 0.01


@each_drive
def test_the_truth_of_a_moving_target_follows_its_own_depths(drive):
    truth, _ = find_true_focus(sources(drive, 4), SWEEP)
    best = np.array([sharpest(drive, n) for n in range(4)])
    assert (np.abs(np.diff(best)) > 0.03).all()
    assert truth.track == pytest.approx(np.interp(np.arange(FRAMES) + 0.5, AT, best), abs=3e-5)
    assert truth.position == pytest.approx(np.interp(truth.frame, np.arange(FRAMES), SWEEP), abs=1e-6)
    n = int(np.argmin(np.abs(np.array(AT) - truth.frame - 0.5)))
    assert n > 0
    depth, target = scene_at(n)
    assert np.array_equal(truth.target, target)
    assert np.array_equal(truth.depth, depth)


@each_drive
def test_the_depth_of_focus_of_a_moving_target_is_round_about_its_own_depths(drive):
    """At the moment whose mask the truth has, the one nearest to the frame of the truth."""
    truth, _ = find_true_focus(sources(drive, 4), SWEEP)
    n = int(np.argmin(np.abs(np.array(AT) - truth.frame - 0.5)))
    assert_depth_of_focus_is_round(drive, replace(truth, position=sharpest_exactly(drive, n)))


def sharpest_exactly(drive, n):
    """The result of ``sharpest`` to the last digit, from the formula of the drive."""
    depth, target = scene_at(n)
    exact = drive.least_blur(depth[target])
    assert exact == pytest.approx(sharpest(drive, n), abs=2e-5)
    return exact
