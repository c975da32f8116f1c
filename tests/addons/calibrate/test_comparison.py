"""``sensors compare``: its output and errors."""

import json

import numpy as np
import pytest
from small_dataset import HERE

from saf_gen import write_stream
from saf_gen.addons.calibrate.comparison import (
    as_published,
    compare_statistics,
    encode_again,
    mean_light,
    published_statistics,
    recording_statistics,
    sensor_statistics,
)
from saf_gen.addons.calibrate.recordings import EncodedRecording
from saf_gen.addons.calibrate.spike_statistics import measure_spikes
from saf_gen.camera import get_sensor

SMALL = HERE / "small_sensor.yaml"


@pytest.mark.slow
def test_two_sensors_differ_where_their_files_differ(tmp_path, call):
    noisy = tmp_path / "noisy.yaml"
    noisy.write_text(SMALL.read_text().replace("threshold_noise_rms: 0.0058", "threshold_noise_rms: 0.05"))
    code, shown, _ = call("sensors", "compare", SMALL, noisy, "--json")
    assert code == 0
    found = {row["key"]: (row["a"], row["b"]) for row in json.loads(shown)["statistics"]}
    assert found["flat.cv2"][1] > found["flat.cv2"][0]
    assert found["flat.halves_rms"][1] > 3 * found["moving.halves_rms"][0]
    for key in ("flat.column_rms", "flat.white_rms", "dark.median", "dark.log_sd"):  # the same device
        assert found[key][1] == pytest.approx(found[key][0], rel=0.03)


def test_a_sensor_is_compared_with_a_recording_under_its_light(tmp_path, call):
    """A recording has the statistics of its light encoded again by the same sensor, and not those of a noisier one.

    40 × 64 pixels, 2,000 readouts, seeds 4 and 1. CV2 agrees to 10 % and Fano factors to 5 %, because of smoothing.
    """
    sensor = get_sensor(SMALL, response_first_column=0, response_first_row=0)  # smoothing would remove these edges
    light = mean_light(sensor, 0.1) * np.broadcast_to(np.linspace(0.5, 1.5, 64), (1, 40, 64)).astype(np.float32)
    shown = EncodedRecording("shown", sensor, light, frames=2000, seed=4)
    frames = np.unpackbits(np.concatenate(list(shown.blocks()), axis=2), axis=2, bitorder="little").transpose(2, 0, 1)
    write_stream(tmp_path / "shown.h5", frames)
    same, noisy = (
        recording_statistics(encode_again(shown, s)) for s in (sensor, get_sensor(SMALL, threshold_noise_rms=0.05))
    )
    real = recording_statistics(shown)
    assert same["recording.rate"] == pytest.approx(real["recording.rate"], rel=0.01)
    assert same["recording.cv2"] == pytest.approx(real["recording.cv2"], rel=0.1)
    assert same["recording.fano_20"] == pytest.approx(real["recording.fano_20"], rel=0.05)
    assert noisy["recording.cv2"] > 1.3 * real["recording.cv2"]
    code, printed, _ = call("sensors", "compare", tmp_path / "shown.h5", SMALL)
    assert code == 0
    assert "recording: local variation" in printed


def test_light_encoded_again_follows_the_recording_in_time():
    """A lamp doubles halfway; rates of 10 windows agree to 3 %, except near the change."""
    sensor = get_sensor(SMALL, noise={"dark": False})
    light = np.full((2, 40, 64), 3000, np.float32) * np.array([1, 2], np.float32)[:, None, None]
    lamp = EncodedRecording(
        "lamp", sensor, light, frames=4000, seed=2, knots=lambda t: ((t >= 2000).astype(np.int64), np.zeros(t.size))
    )
    real, again = (measure_spikes(r).series.reshape(10, -1).mean(axis=1) for r in (lamp, encode_again(lamp, sensor)))
    assert real[7] == pytest.approx(2 * real[2], rel=0.01)
    far = [0, 1, 2, 3, 6, 7, 8, 9]
    assert again[far] == pytest.approx(real[far], rel=0.03)


def test_published_figures_are_compared_with_ours_of_the_same_kind(call):
    """Each published figure has one of ours; the array is small, so only the kinds of figures are compared."""
    real, sources = published_statistics()
    ours = as_published(get_sensor(SMALL))
    assert set(ours) == set(real)
    assert ours["stream.rate"] == pytest.approx(real["stream.rate"], rel=0.03)
    assert all(sources.values())
    rows = compare_statistics([real, ours])
    assert len({row.label for row in rows}) == len(rows) == len(real)
    code, shown, _ = call("sensors", "compare", "--published", SMALL)
    assert code == 0
    assert "SpikeNeRF" in shown


def test_a_sensor_without_dark_has_no_dark_figures():
    assert not any(key.startswith("dark.") for key in sensor_statistics(get_sensor("ideal"), shape=(8, 16)))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("vidar_400x250",), "1 name is given"),
        (("--published", "vidar_400x250", "ideal"), "1 name is given"),
        (("vidar_400x250", "vidar_400x251"), "unknown sensor 'vidar_400x251'"),
        (("vidar_400x250", "missing.dat"), "missing.dat: there is no such file"),
        (("vidar_400x250", "ideal", "--mean-rate", "0.95"), "the rate is 0.95"),
        (("vidar_400x250", "ideal", "--mean-rate", "0.004"), "above the dark rate 0.0045"),
    ],
)
def test_what_cannot_be_compared_is_refused_in_one_line(arguments, words, call):
    code, _, err = call("sensors", "compare", *arguments)
    assert code == 2
    assert words in err.splitlines()[-1]
