"""One recorded sequence against closed forms: exposure, truth, light, and noise switched off."""

import numpy as np
import pytest
from refusals import assert_says, refusal
from small_dataset import DRIVE, SPEC, make_sequence

import saf_gen
from saf_gen.camera import get_sensor
from saf_gen.generate.record import Recorder
from saf_gen.optics.focus_crossings import focus_crossings
from saf_gen.plugins.motions import lens_positions
from saf_gen.stack.focal_stack import FocalStack
from saf_gen.stack.time_resolved import PlaneSource

SWITCHED_OFF = {name: False for name in ("shot", "dark", "response", "threshold_spread", "threshold_noise", "dust")}


def stack(depth=0.5, radiance=1.0):
    """An even field at one depth; a quarter of its light comes from the lamp."""
    field = (
        np.full((2, 9, 16, 24), radiance, dtype=np.float32) * np.array([0.25, 0.75], np.float32)[:, None, None, None]
    )
    target = np.ones((16, 24), dtype=bool)
    return FocalStack(SPEC, field, np.full((16, 24), depth, np.float32), target, "llvm")


SWEEP = {"kind": "sweep"}
CONSTANT = {"": {"kind": "constant"}}


def record(tmp_path, schedule, *, motion=SWEEP, mean_rate=0.2, frames=2000, pictures=None, **laws):
    sensor = get_sensor("vidar_400x250", rows=16, columns=24, pitch_m=60e-6, reset_loss=0.0, **laws)
    recorder = Recorder(sensor.with_noise(**SWITCHED_OFF), frames, device_seed=1, provenance={})
    sequence = make_sequence(schedule=schedule, motion=motion, mean_rate=mean_rate)
    recorder.record(sequence, PlaneSource.from_stack(pictures or stack()), path=tmp_path / "s.h5", fingerprint="f")
    return saf_gen.open_stream(tmp_path / "s.h5")


def test_the_mean_rate_is_the_one_asked_for_at_best_focus(tmp_path):
    """Without noise a count is exact to one spike: 0.2 % over 400 frames × 384 pixels around the focus."""
    with record(tmp_path, CONSTANT) as stream:
        frame = round(stream.truth.frame)
        counts = stream.counts(frame - 200, frame + 200)
    assert counts.mean() / 400 == pytest.approx(0.2, rel=0.002)


def test_the_mean_rate_is_that_of_this_very_device(tmp_path):
    """With response, thresholds and dark current on; over 400 frames × 384 pixels shot noise is below 0.1 %.

    Over so few pixels the mean of one device differs by a few percent from that of all devices.
    """
    sensor = get_sensor("vidar_400x250", rows=16, columns=24, pitch_m=60e-6)
    sequence = make_sequence()
    for device in (1, 2):
        path = tmp_path / f"{device}.h5"
        Recorder(sensor, 2000, device_seed=device, provenance={}).record(
            sequence, PlaneSource.from_stack(stack()), path=path, fingerprint=""
        )
        with saf_gen.open_stream(path) as stream:
            frame = round(stream.truth.frame)
            counts = stream.counts(frame - 200, frame + 200)
        assert counts.mean() / 400 == pytest.approx(0.2, rel=0.005)


def test_the_rate_over_the_sweep_follows_bellows_and_the_fourth_power_of_the_cosine(tmp_path):
    """E is proportional to cos⁴θ/v²: each pixel's rate in 500 frames at both ends of the sweep, to one spike in 100."""
    with record(tmp_path, CONSTANT, frames=8000) as stream:
        best = float(DRIVE.image_distance(stream.truth.position))
        ends = [stream.counts(0, 500), stream.counts(7500, 8000)]
        distances = [stream.metadata.image_distance[a : a + 500].mean() for a in (0, 7500)]
    y, x = np.meshgrid(np.arange(16) - 7.5, np.arange(24) - 11.5, indexing="ij")
    r2 = (x**2 + y**2) * 60e-6**2

    def light(v):
        return v**2 / (v**2 + r2) ** 2  # cos⁴θ/v² with cos²θ = v²/(v² + r²)

    for counts, v in zip(ends, distances, strict=True):
        expected = 0.2 * light(v) / light(best).mean()
        assert counts.mean() / 500 == pytest.approx(expected.mean(), rel=0.002)
        assert np.abs(counts - 500 * expected).max() <= 1.001


def test_one_light_group_gives_its_fraction_of_the_light(tmp_path):
    with record(tmp_path, {"lamp": {"kind": "constant", "level": 0.0}}) as stream:
        frame = round(stream.truth.frame)
        rate = stream.counts(frame - 200, frame + 200).mean() / 400
        assert stream.gain[:, 0].max() == 0
    assert rate == pytest.approx(0.75 * 0.2, rel=0.003)


def test_truth_is_the_optical_focus_of_the_target(tmp_path):
    with record(tmp_path, CONSTANT) as stream:
        truth = stream.truth
        assert truth.position == pytest.approx(float(DRIVE.best_position(0.5)), rel=1e-6)
        assert truth.best_position == pytest.approx(truth.position, rel=1e-4)
        at_truth = np.interp(truth.frame, np.arange(2000), stream.focus_position)
        assert at_truth == pytest.approx(truth.position, abs=1e-6)


def test_a_target_out_of_reach_has_a_truth_that_no_frame_passes(tmp_path):
    with record(tmp_path, CONSTANT, pictures=stack(depth=0.8)) as stream:
        assert stream.truth.position < 0
        assert np.isnan(stream.truth.frame)


MOTIONS = {
    "backwards": {"kind": "sweep", "from": 1.0, "to": 0.0},
    "there and back": {"kind": "sweep_and_return", "dwell_s": 0.02},
    "hand": {"kind": "hand", "bandwidth_hz": 60.0, "reversals": True, "irregularity": 1.0, "seed": 3},
    "hold": {"kind": "hold", "position": 0.3},
}


@pytest.mark.parametrize("motion", MOTIONS.values(), ids=MOTIONS)
def test_the_lens_is_where_its_motion_says(tmp_path, motion):
    """In the file, and in the spikes of a field that grows brighter over the travel, in windows of 200 readouts."""
    expected = lens_positions(motion, 2000, readout_hz=20_000)
    pictures = stack()
    pictures.radiance[:] *= np.linspace(0.5, 1.5, 9, dtype=np.float32)[:, None, None]
    with record(tmp_path, CONSTANT, motion=motion, pictures=pictures) as stream:
        assert np.array_equal(stream.focus_position, expected)
        v, u = DRIVE.image_distance(expected), DRIVE.object_distance(expected)
        assert stream.metadata.image_distance == pytest.approx(v, rel=1e-6)
        assert stream.metadata.object_distance == pytest.approx(u, rel=1e-6)
        best = stream.truth.position
        counts = [stream.counts(t, t + 200)[4:12, 8:16].mean() for t in range(0, 2000, 200)]
    light = (0.5 + expected) / v**2  # and cos⁴θ is 1 within 1e-3 so near the axis
    rate = 0.2 * light / ((0.5 + best) / DRIVE.image_distance(best) ** 2)
    assert counts == pytest.approx(rate.reshape(-1, 200).sum(axis=1), rel=0.01)


def test_the_frame_of_truth_is_the_first_pass(tmp_path):
    with record(tmp_path, CONSTANT, motion=MOTIONS["there and back"]) as stream:
        truth, lens = stream.truth, stream.focus_position
    assert focus_crossings(lens, truth.position) == pytest.approx([truth.frame, 1999 - truth.frame], abs=1e-2)
    assert truth.frame == pytest.approx(truth.position * 800 - 0.5, abs=1e-2)  # 0.04 s one way, at 20 kHz
    assert np.interp(truth.frame, np.arange(2000), lens) == pytest.approx(truth.position, abs=1e-6)


def test_a_lens_held_out_of_focus_never_passes_the_focus(tmp_path):
    with record(tmp_path, CONSTANT, motion=MOTIONS["hold"]) as stream:
        assert stream.truth.known
        assert np.isnan(stream.truth.frame)
        halves = stream.counts(0, 1000), stream.counts(1000, 2000)
    assert np.abs(halves[0].astype(int) - halves[1]).max() <= 1  # nothing moves: one spike of rounding


def test_absolute_exposure_counts_the_scenes_own_electrons(tmp_path):
    """Q = τπR²/v²·L·A·FF·QE·λ/(hc)·t on the axis, written out independently here."""
    sensor = get_sensor("vidar_400x250")
    v = float(DRIVE.image_distance(DRIVE.least_blur(np.array([0.5]))))
    flux = np.pi * DRIVE.aperture_radius_m**2 / v**2 * 60e-6**2 * sensor.fill_factor
    electrons = flux * sensor.quantum_efficiency * sensor.wavelength_m / (6.62607015e-34 * 299792458) / 20_000
    pictures = stack(radiance=0.2 * sensor.threshold_e / electrons)
    with record(tmp_path, CONSTANT, mean_rate=None, pictures=pictures) as stream:
        frame = round(stream.truth.frame)
        rate = stream.counts(frame - 200, frame + 200)[7:9, 11:13].mean() / 400
    assert rate == pytest.approx(0.2, rel=0.005)


def test_a_rate_below_the_dark_current_is_refused(tmp_path):
    sensor = get_sensor("vidar_400x250", rows=16, columns=24, pitch_m=60e-6)
    recorder = Recorder(sensor, 200, device_seed=1, provenance={})
    sequence = make_sequence(mean_rate=0.002)
    assert_says(
        refusal(recorder.record, sequence, PlaneSource.from_stack(stack()), path=tmp_path / "s.h5", fingerprint="f"),
        "mean_rate",
    )
    assert not (tmp_path / "s.h5").exists()
