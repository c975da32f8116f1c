"""``sensors list``, ``show`` and ``check``: their output and errors."""

import pytest
import yaml
from small_dataset import HERE

from saf_gen.camera import get_sensor, sensor_names
from saf_gen.camera.sensor_files import implausible_keys, nominal_keys, sensor_text

SMALL = HERE / "small_sensor.yaml"


def test_every_sensor_is_listed_with_its_array_and_nominal_keys(call):
    code, shown, _ = call("sensors", "list")
    assert code == 0
    for name in sensor_names():
        line = next(line for line in shown.splitlines() if f" {name} " in line)
        assert f"{get_sensor(name).columns}×{get_sensor(name).rows}" in line
    assert nominal_keys(sensor_text("vidar_400x250"))[:2] == ["threshold_e", "quantum_efficiency"]
    assert nominal_keys(sensor_text("ideal")) == []


@pytest.mark.parametrize("name", [*sensor_names(), SMALL])
def test_a_sensor_is_shown_as_its_file_is_written(name, call):
    """The printed text is a sensor file of the same sensor."""
    code, shown, _ = call("sensors", "show", name)
    assert code == 0
    assert yaml.safe_load(shown)["dark_rate"] == get_sensor(name).dark_rate
    assert "sources:" in shown


@pytest.mark.parametrize("name", sensor_names())
def test_sensors_that_come_along_have_nothing_unlikely(name):
    assert list(implausible_keys(get_sensor(name))) == []


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"pitch_m": 2e-4}, "pitch_m is 200 µm; usual: 5 to 50"),
        ({"dark_rate": 0.2}, "dark_rate is 0.2 spikes per readout"),
        ({"dark_rate": 0.0}, "noise.dark is on, but dark_rate is 0"),
        ({"noise": {"response": False}}, "noise.response is off: response_column_rms"),
        ({"dark_log_sd": 0.9}, "dark_log_sd of 0.9 alone has 0.062"),
        ({"reset": "hard"}, "rates are wrong by"),
        ({"threshold_e": 100}, "lux"),
    ],
)
def test_each_unlikely_number_has_a_line(change, words):
    assert any(words in line for line in implausible_keys(get_sensor("vidar_400x250", **change)))


def test_a_sensor_file_is_checked(call, tmp_path):
    code, shown, _ = call("sensors", "check", SMALL)
    assert (code, shown.splitlines()[0]) == (0, "unlikely: pitch_m is 60 µm; usual: 5 to 50")
    broken = tmp_path / "mine.yaml"
    broken.write_text(SMALL.read_text().replace("dark_rate:", "dark_rte:"))
    code, _, err = call("sensors", "check", broken)
    assert code == 2
    assert "dark_rate" in err
    assert err.count("\n") == 1
