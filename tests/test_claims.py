"""The results of docs/explanation/claims.md on the paper's claims, on sweeps with a known focus, without a renderer."""

import shutil
import subprocess
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from planted_sweeps import list_streams
from scipy.special import j1

from saf_gen import encode, get_measure, get_search, get_sensor
from saf_gen.benchmark.evaluate import evaluate
from saf_gen.benchmark.tracks.closed_loop_run import finish_run
from saf_gen.benchmark.view.captured_spikes import CapturedSpikes
from saf_gen.benchmark.view.clock import Clock
from saf_gen.benchmark.view.running_camera import RunningCamera, SweepView
from saf_gen.optics import ImageDistanceDrive
from saf_gen.optics.actuators import get_actuator
from saf_gen.stack.capture import Capture
from saf_gen.stack.focal_stack import FocalStack, StackSpec
from saf_gen.stack.time_resolved import PlaneSource
from saf_gen.stream.metadata import Truth
from saf_gen.stream.stream_writer import write_stream

SHAPE = (160, 200)
FRAMES, BLOCK = 8_000, 100
FOCUS = 0.3
BOARD = np.where(np.add.outer(np.arange(SHAPE[0]) // 4, np.arange(SHAPE[1]) // 4) % 2, 1.0, -1.0)
RAMPS = {"brighter": (0.5, 2.0), "darker": (2.0, 0.5)}


@cache
def encode_halves(rate, ramp, *, contrast, width, shade=0.5):
    """Counts of the halves of 80 windows of a sweep whose light changes fourfold: (80, 2, h, w) uint32.

    A chequered field with a gradient of ± ``shade`` across it, whose contrast is a Gaussian of this width at 0.3 of the
    sweep. The noise is that of the sensor without dark current; one seed; 32,000 pixels. Cached: do not change it.
    """
    sensor = get_sensor("vidar_400x250").with_noise(dark=False)
    knots = np.linspace(0, 1, 65)
    sharp = contrast * np.exp(-(((knots - FOCUS) / width) ** 2) / 2)
    light = rate * sensor.threshold_e * np.linspace(*ramp, len(knots))
    across = np.linspace(1 - shade, 1 + shade, SHAPE[1])
    charge = (light[:, None, None] * across * (1 + sharp[:, None, None] * BOARD)).astype(np.float32)
    spikes = np.unpackbits(encode(charge, sensor, frames=FRAMES, seed=1), axis=2, bitorder="little")
    counts = spikes.reshape(*SHAPE, -1, 2, BLOCK // 2).sum(axis=4, dtype=np.uint32)
    return counts.transpose(2, 3, 0, 1)


def find_peak(curve):
    """The fraction of the sweep at which a curve is largest."""
    return (int(np.argmax(curve)) + 0.5) / len(curve)


@pytest.mark.parametrize("ramp", RAMPS.values(), ids=RAMPS)
@pytest.mark.parametrize("name", ["gradient_code", "tenengrad", "brenner", "mfdct_lee", "variance"])
@pytest.mark.slow
def test_divided_by_brightness_the_baselines_stand_a_fourfold_ramp_as_sd_does(name, ramp):
    """25 counts per window: normalised measures err by up to 0.03 of the sweep, the others follow the light."""
    windows = encode_halves(0.25, ramp, contrast=0.3, width=0.25).sum(axis=1)
    raw, normalised, sd = ([get_measure(m)(c) for c in windows] for m in (name, f"{name}_n", "sd"))
    assert find_peak(sd) == pytest.approx(FOCUS, abs=0.03)
    assert find_peak(normalised) == pytest.approx(FOCUS, abs=0.03)
    lead = find_peak(raw) - find_peak(normalised)
    assert lead > 0.03 if ramp[0] < ramp[1] else lead < -0.03


@pytest.mark.parametrize(("ramp", "dark_end"), [((0.5, 2.0), 0.0), ((2.0, 0.5), 1.0)])
@pytest.mark.slow
def test_at_three_counts_a_window_sd_goes_to_the_dark_end_and_the_debiased_does_not(ramp, dark_end):
    """Contrast 0.1 and 3 counts per window at the dark end: counting adds about 1/(6·ū²) = 0.02 to SD there.

    Both use the same windows of 100 frames, without averaging. A gradient of a fifth soon makes pixels fire at
    different times; in an even field all of them would fire in step.
    """
    pairs = encode_halves(0.06, ramp, contrast=0.1, width=0.15, shade=0.2)
    sd, debiased = get_measure("sd"), get_measure("sd_debiased")
    assert find_peak([sd(pair.sum(axis=0)) for pair in pairs]) == pytest.approx(dark_end, abs=0.05)
    assert find_peak([debiased(pair) for pair in pairs]) == pytest.approx(FOCUS, abs=0.1)


def planted_capture(frames):
    """A camera without noise, in front of a texture that is in focus in the middle of the travel, without files.

    Amplitudes of the texture fall with the root of the frequency. A disc of radius 20·|2p − 1| pixels blurs
    it through its transfer function, 2·J₁(x)/x, which is exact for periodic images. One seed.
    """
    size, positions = 96, np.linspace(0, 1, 129)
    frequency = np.hypot(np.fft.fftfreq(size)[:, None], np.fft.fftfreq(size))
    texture = np.fft.fft2(np.random.default_rng(4).normal(size=(size, size)))
    texture /= np.sqrt(np.maximum(frequency, 1 / size))
    texture[0, 0] = 0
    x = np.maximum(2 * np.pi * 20 * np.abs(2 * positions - 1)[:, None, None] * frequency, 1e-6)
    images = np.fft.ifft2(texture * 2 * j1(x) / x).real
    radiance = (1 + 0.2 * images / images[64].std()).clip(0).astype(np.float32)
    drive = ImageDistanceDrive(0.05, 2.8, (2.0, 1.0))
    spec = StackSpec("planted", "", ("lamp",), drive, size, size, 20e-6, positions.size, 1, 1)
    stack = FocalStack(spec, radiance[None], np.ones((size, size)), np.ones((size, size), bool), "none")
    sensor = replace(get_sensor("ideal"), rows=size, columns=size)
    gain, truth = np.ones((frames, 1), np.float32), Truth(0.5, (0.48, 0.52), None)
    capture = Capture(PlaneSource.from_stack(stack), sensor, gain, 1.0, 1, 1, truth, len(gain))
    charge = float(capture.open_charge_source().charge_image(0, 0.5).mean())
    return replace(capture, exposure=0.3 * sensor.threshold_e / charge)


def time_to_focus(capture, search, sweep):
    """The number of frames from the start of a sweep until the lens is back at the answer, and the answer."""
    charge_source = capture.open_charge_source()
    frame = (slice(0, capture.sensor.rows), slice(0, capture.sensor.columns))
    drive = get_actuator("ideal", speed=capture.sensor.readout_hz / sweep)
    camera = RunningCamera(
        CapturedSpikes(capture, charge_source, region=frame), get_measure("sd"), actuator=drive,
        start=0.0, seed=1, budget=capture.frames, clock=Clock(capture.sensor.readout_hz),
    )  # fmt: skip
    view = SweepView(camera, begin=0.0, end=1.0, frames=sweep)
    answer = search(view)
    camera.commanded_trajectory = None
    run = finish_run(camera, answer, to=view.position_at(answer.frame), budget=capture.frames)
    assert run.path[-1] == pytest.approx(0.5, abs=0.02)
    return int(np.flatnonzero(np.abs(run.path - run.path[-1]) > 1e-3)[-1]) + 1, answer


def test_a_golden_fast_search_is_back_in_focus_twice_as_fast():
    """EGS over SGFS is 2.08 ± 0.1 if the focus is in the middle; EGS takes a sweep and half a sweep back.

    200 blocks per sweep. ``sgfs_causal`` stops while the lens moves, as the paper describes; the released code searches
    the complete sweep for the stop, as if the lens had stopped there.
    """
    capture, sweep = planted_capture(8_000), 4_000
    slow, _ = time_to_focus(capture, get_search("egs"), sweep)
    fast, _ = time_to_focus(capture, get_search("sgfs_causal", dt=sweep // 200), sweep)
    assert slow / sweep == pytest.approx(1.5, abs=0.02)
    assert slow / fast == pytest.approx(2.08, abs=0.1)
    late, answer = time_to_focus(capture, get_search("sgfs_code", dt=sweep // 200), sweep)
    assert late == pytest.approx(slow, rel=0.02)
    stop = int(answer.note.split()[2]) / sweep
    assert 1.5 / (stop + stop - 0.5) == pytest.approx(2.08, abs=0.1)


PROGRAM = r"""
#include <stdio.h>
int main(int argc, char **argv) {
  for (int i = 1; i < argc; i++)
    printf("{\"method\": \"middle_in_c\", \"sequence\": \"%s\", \"frame\": %.1f}\n", argv[i], 99.5);
  return 0;
}
"""


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler here")
@pytest.mark.slow
def test_predictions_of_a_program_in_c_go_through(tmp_path):
    (tmp_path / "d" / "test").mkdir(parents=True)
    for name in ("one", "two"):
        write_stream(
            tmp_path / "d" / "test" / f"{name}.h5",
            np.eye(8, dtype=np.uint8)[None].repeat(200, axis=0),
            focus_position=np.linspace(0, 1, 200, dtype=np.float32),
            truth=Truth(position=0.5, depth_of_focus=(0.45, 0.55), frame=99.5),
        )
    list_streams(tmp_path / "d", *({"id": name, "scene": name} for name in ("one", "two")))
    (tmp_path / "middle.c").write_text(PROGRAM)
    subprocess.run(["cc", "-o", tmp_path / "middle", tmp_path / "middle.c"], check=True)
    printed = subprocess.run([tmp_path / "middle", "one", "two"], check=True, capture_output=True).stdout
    (tmp_path / "middle.jsonl").write_bytes(printed)
    records = evaluate(tmp_path / "d", methods=[], predictions=tmp_path / "middle.jsonl").records
    assert [(r.method, r.success_half_dof) for r in records] == [("middle_in_c", True)] * 2
