"""The spikes of complete recordings against optics written out here: where they are sharp, and how light changes.

The stacks are made by hand. The target, to one side of the frame's centre, is a chequered pattern that is blurred
according to its own depth; its surroundings are 10 to 18 cm farther away.
"""

import numpy as np
import pytest
from scipy.ndimage import fourier_gaussian
from small_dataset import make_sequence

import saf_gen
from saf_gen.camera import get_sensor
from saf_gen.generate.recorder import Recorder
from saf_gen.optics import ImageDistanceDrive
from saf_gen.stack.focal_stack import StackSpec
from saf_gen.stack.time_resolved import PlaneSource, TimeResolvedStack

F_M, F_NUMBER, PITCH_M = 0.025, 1.2, 60e-6
ROWS, COLUMNS, POSITIONS, FRAMES = 40, 60, 33, 1_920
DRIVE = ImageDistanceDrive(F_M, F_NUMBER, (0.75, 0.42))
SENSOR = get_sensor("ideal", rows=ROWS, columns=COLUMNS, pitch_m=PITCH_M)
TARGET = np.s_[6:34, 4:24]
FAR_M = 0.66
MOMENTS = 9  # every 240 frames, the last at the end


def best_position(depth_m):
    """The position that focuses a depth: v = 1/(1/f − 1/u), between those at the ends of the travel."""
    first, last, here = (1 / (1 / F_M - 1 / u) for u in (*DRIVE.focus_range_m, depth_m))
    return (here - first) / (last - first)


def blur_px(depth_m, position):
    """c = 2R·v·|1/u_o − 1/u| in pixels: D·|v/v_o − 1| with D = f/N."""
    first, last, sharp = (1 / (1 / F_M - 1 / u) for u in (*DRIVE.focus_range_m, depth_m))
    return F_M / F_NUMBER * abs((first + position * (last - first)) / sharp - 1) / PITCH_M


def picture(depth_m, position):
    """Light and dark checks of two pixels, blurred to the second moment of a disc, whose σ is c/4."""
    y, x = np.mgrid[:ROWS, :COLUMNS] // 2
    waves = np.fft.fft2(np.where((x + y) % 2, 1.0, 0.2))
    near, far = (np.fft.ifft2(fourier_gaussian(waves, blur_px(d, position) / 4)).real for d in (depth_m, FAR_M))
    far[TARGET] = near[TARGET]
    return far


def depth_and_target(depth_m):
    """Depth and target of a scene whose target is at this depth."""
    depth, target = np.full((ROWS, COLUMNS), FAR_M, np.float32), np.zeros((ROWS, COLUMNS), bool)
    depth[TARGET], target[TARGET] = depth_m, True
    return depth, target


def plane_source(stacks, views):
    """A plane source of one stack of a static scene, or of one stack per moment; stacks are (focus, row, col)."""
    at = tuple(range(0, FRAMES + 1, FRAMES // (MOMENTS - 1)))[: len(stacks)]
    specs = tuple(
        StackSpec(
            "plane", "0" * 64, ("lamp",), DRIVE, ROWS, COLUMNS, PITCH_M, POSITIONS, 16, 4, time_s=frame / 20_000,
            window=(0, POSITIONS - 1) if len(stacks) > 1 else None,
        )
        for frame in at
    )  # fmt: skip
    light = [np.asarray(stack, np.float32)[None] for stack in stacks]
    return PlaneSource(
        TimeResolvedStack(at, specs), lambda j, first, stop: light[j][:, first:stop], lambda j: views[j], "d", "llvm"
    )


def scene(depths_m):
    """The scene with its target at this one depth, or at one depth per moment."""
    stacks = [[picture(depth, position) for position in np.linspace(0, 1, POSITIONS)] for depth in depths_m]
    return plane_source(stacks, [depth_and_target(depth) for depth in depths_m])


def record(tmp_path, source, **changes):
    Recorder(SENSOR, FRAMES, device_seed=1, provenance={}).record(
        make_sequence(**{"mean_rate": 0.3, **changes}), source, path=tmp_path / "s.h5", fingerprint="f"
    )
    return saf_gen.open_stream(tmp_path / "s.h5")


def contrast(stream, first, stop):
    counts = stream.counts(first, stop)[TARGET].astype(np.float64)
    return counts.var() / counts.mean() ** 2


COMES_M = 0.54 - 0.08 * np.arange(MOMENTS) / (MOMENTS - 1)  # the target comes 8 cm nearer


@pytest.mark.parametrize("depths_m", [[0.5], COMES_M], ids=["still", "moving"])
def test_a_recording_is_sharpest_in_the_frame_of_its_truth(tmp_path, depths_m):
    """There the lens focuses the target. Windows of 100 frames, a parabola around the highest: within 5 frames.

    There is no noise; counts of 30 and the parabola leave 0.2 frames. The lens passes the focus of the frame's centre
    900 frames earlier, and that of the compromise of all pixels 700 frames earlier.
    """
    with record(tmp_path, scene(depths_m)) as stream:
        truth = stream.truth
        middles = np.arange(50, FRAMES - 50, 25)
        curve = np.array([contrast(stream, t - 50, t + 50) for t in middles])
    near = abs(middles - middles[curve.argmax()]) <= 150
    parabola = np.polynomial.Polynomial.fit(middles[near], curve[near], 2)
    assert truth.frame == pytest.approx(float(parabola.deriv().roots()[0]), abs=5)
    depth = np.interp(truth.frame, np.linspace(0, FRAMES, len(depths_m)), depths_m)
    assert truth.position == pytest.approx(best_position(depth), abs=2e-3)


def test_a_target_is_blurred_alike_by_a_pixel_at_both_ends_of_its_depth_of_focus(tmp_path):
    """c is symmetric in v, and so is the contrast: within 3 % in 100 frames around each end, where c is one pixel.

    If the depth of focus were that of the compromise of all pixels, both ends would be on one side, 2 to 4 pixels out.
    """
    with record(tmp_path, scene([0.5])) as stream:
        low, high = stream.truth.depth_of_focus
        ends = [round(p * FRAMES) for p in (low, high)]
        before, after = (contrast(stream, t - 50, t + 50) for t in ends)
    assert [blur_px(0.5, p) for p in (low, high)] == pytest.approx([1, 1], rel=1e-6)
    assert before == pytest.approx(after, rel=0.03)


def test_light_that_grows_evenly_from_slice_to_slice_grows_evenly_in_spikes(tmp_path):
    """A ramp without steps: the number of spikes up to any frame is the integral of a straight line.

    An even field has radiance 1 at the first moment, 2 at the second, and so on; the lens is at rest. Without noise a
    pixel's count is exact to one spike of phase, and the mean over 2,400 pixels to 0.05 of 600 spikes.
    """
    stacks = [np.full((POSITIONS, ROWS, COLUMNS), 1.0 + n) for n in range(MOMENTS)]
    frames = np.arange(0, FRAMES + 1, 25)
    source = plane_source(stacks, [depth_and_target(0.5)] * MOMENTS)
    # The lens never meets the focus and is nearest to it from the first frame on, where the light is lowest.
    with record(tmp_path, source, motion={"kind": "hold", "position": 0.4}, mean_rate=0.06) as stream:
        seen = np.array([stream.counts(0, t).mean() if t else 0.0 for t in frames])
    per_slice = FRAMES / (MOMENTS - 1)
    ramp = frames + frames**2 / (2 * per_slice)  # the integral of 1 + t/240
    assert seen == pytest.approx(ramp * seen[-1] / ramp[-1], abs=0.1)
    assert seen[-1] > 500
