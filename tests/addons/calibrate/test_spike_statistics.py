"""Statistics of recordings, compared with a slow reference, spike by spike, and with planted numbers."""

import numpy as np
import pytest
from refusals import assert_says, refusal

from saf_gen import write_stream
from saf_gen.addons.calibrate import spike_statistics as kernel
from saf_gen.addons.calibrate.recordings import open_recording
from saf_gen.addons.calibrate.spike_statistics import measure_spikes
from saf_gen.camera import get_sensor
from saf_gen.core.seeds import make_generator
from saf_gen.stream.interop import export_raw_frames
from saf_gen.stream.stream_writer import StreamWriter
from studies.published_sensors import EncodedRecording


def random_stream(path, *, frames=4517, rate=0.06, shape=(6, 9)):
    """Write and return independent spikes whose rate rises from pixel to pixel; the first pixel never fires."""
    random = make_generator("spike statistics").random((frames, *shape))
    spikes = (random < rate * np.arange(np.prod(shape)).reshape(shape) / 20).astype(np.uint8)
    write_stream(path, spikes, readout_hz=20_000)
    return spikes


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    path = tmp_path_factory.mktemp("statistics") / "random.h5"
    spikes = random_stream(path)
    with open_recording(path) as recording:
        return spikes.reshape(len(spikes), -1), measure_spikes(recording)


def test_counts_intervals_and_halves_are_those_of_each_pixel(measured):
    spikes, found = measured
    assert found.counts.ravel() == pytest.approx(spikes.sum(axis=0))
    for p, train in enumerate(spikes.T):
        times = np.flatnonzero(train)
        if len(times) < 2:
            assert np.isnan(found.interval.ravel()[p])
            continue
        assert found.interval.ravel()[p] == pytest.approx(np.diff(times).mean())
        for half, part in enumerate((times[times < len(spikes) // 2], times[times >= len(spikes) // 2])):
            rate = found.half_rates.reshape(2, -1)[half, p]
            assert np.isnan(rate) if len(part) < 2 else rate == pytest.approx(1 / np.diff(part).mean())


def test_the_series_is_the_mean_of_all_pixels(measured):
    spikes, found = measured
    runs = spikes[: len(spikes) // 8 * 8].reshape(-1, 8, spikes.shape[1])
    assert found.series == pytest.approx(runs.mean(axis=(1, 2)))
    expected = runs.sum(axis=1).var(axis=0, ddof=1).mean() / 64 / spikes.shape[1]
    assert found.series_variance == pytest.approx(expected)


def test_second_differences_are_those_of_every_so_many_spikes(measured):
    spikes, found = measured
    for p, train in enumerate(spikes.T):
        times = np.flatnonzero(train)
        for lag in range(kernel.LAGS):
            second = np.diff(times[:: 1 << lag].astype(float), 2)
            assert found.numbers.reshape(-1, kernel.LAGS)[p, lag] == second.size
            assert found.squares.reshape(-1, kernel.LAGS)[p, lag] == pytest.approx((second**2).sum())


@pytest.mark.slow
def test_a_recording_that_is_encoded_as_it_is_read_is_that_of_the_stream(tmp_path):
    """A raw file of another camera also gives the bits of the recording from which it was made."""
    sensor = get_sensor("vidar_400x250")
    charge = np.full((1, 250, 400), 0.2 * sensor.threshold_e, np.float32)
    encoded = EncodedRecording("flat", sensor, charge, frames=2100, seed=3)
    blocks = list(encoded.blocks())
    with StreamWriter(tmp_path / "flat.h5", shape=encoded.shape, readout_hz=encoded.readout_hz) as stream:
        for block in blocks:
            stream.write(block)
    export_raw_frames(tmp_path / "flat.h5", tmp_path / "flat.dat", layout="416")
    for name in ("flat.h5", "flat.dat"):
        with open_recording(tmp_path / name) as recording:
            assert (recording.shape, recording.readout_hz) == (encoded.shape, encoded.readout_hz)
            assert all(np.array_equal(there, here) for there, here in zip(recording.blocks(), blocks, strict=True))
    assert all(np.array_equal(again, here) for again, here in zip(encoded.blocks(), blocks, strict=True))


def test_what_is_no_recording_is_refused(tmp_path):
    (tmp_path / "sensor.yaml").write_text("name: mine")
    write_stream(tmp_path / "short.h5", np.ones((15, 4, 4), np.uint8))

    def open_(name):
        with open_recording(tmp_path / name) as recording:
            measure_spikes(recording)

    assert_says(refusal(open_, "sensor.yaml"), "is a sensor file | a stream (.h5) or raw frames")
    assert_says(refusal(open_, "none.dat"), "there is no such file")
    assert_says(refusal(open_, "short.h5"), "short.h5: has 15 readouts | at least 16")
