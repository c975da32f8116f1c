"""``sensors list``, ``show`` and ``check``: their output and errors."""

import numpy as np
import pytest
import yaml
from small_dataset import HERE

from saf_gen.camera import sensor_names
from saf_gen.camera.kinds import kinds_of_cameras
from saf_gen.camera.sensor_files import FOLDER, implausible_keys, nominal_keys, read_sensor, sensor_text

SMALL = HERE / "small_sensor.yaml"


def test_every_sensor_is_listed_with_its_kind_its_array_and_nominal_keys(call):
    code, shown, _ = call("sensors", "list")
    assert code == 0
    for kind in kinds_of_cameras():
        for name in sensor_names(kind):
            line = next(line for line in shown.splitlines() if f" {name} " in line)
            sensor = read_sensor(name)
            assert f" {kind} " in line
            assert f"{sensor.columns}×{sensor.rows}" in line
    assert sorted(name for kind in kinds_of_cameras() for name in sensor_names(kind)) == sensor_names()
    assert nominal_keys(sensor_text("vidar_400x250"))[:2] == ["threshold_e", "quantum_efficiency"]
    assert nominal_keys(sensor_text("ideal")) == []


@pytest.mark.parametrize("name", [*sensor_names(), SMALL])
def test_a_sensor_of_any_kind_is_shown_as_its_file_is_written(name, call, tmp_path):
    """The printed text is a sensor file of the same sensor."""
    code, shown, _ = call("sensors", "show", name)
    assert code == 0
    assert yaml.safe_load(shown)["kind"] == read_sensor(name).kind
    (tmp_path / "mine.yaml").write_text(shown)
    assert read_sensor(tmp_path / "mine.yaml") == read_sensor(name)


@pytest.mark.parametrize("name", sensor_names())
def test_every_sensor_that_comes_along_is_one_with_nothing_unlikely(name, call):
    for given in (name, FOLDER / f"{name}.yaml"):
        code, shown, _ = call("sensors", "check", given)
        assert (code, shown) == (0, f"{name} is a sensor of kind {read_sensor(name).kind}\n")


@pytest.mark.parametrize("command", ["show", "check"])
@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("deep:\n" + "- []\n" * 5000, "the key 'kind' is missing"),
        ("- []\n" * 5000, "the key 'kind' is missing"),
        ("kind: events\ndeep:\n" + "- []\n" * 5000, "unknown key 'deep'"),
        ('!!python/object/apply:os.system ["touch ran"]\n', "the key 'kind' is missing"),
        ('kind: frames\nname: !!python/object/apply:os.system ["touch ran"]\n', "name is ['touch ran']"),
        ("kind: frames\nname: [\n", "this is not YAML"),
        (f"kind: photons\n{SMALL.read_text().partition('kind: spikes')[2]}", "unknown key 'shot' in noise"),
        ("kind: evnts\n", "did you mean 'events'?"),
    ],
)
def test_what_is_no_sensor_file_is_neither_shown_nor_checked(command, text, words, call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.yaml").write_text(text)
    code, shown, error = call("sensors", command, "mine.yaml")
    assert (code, shown, error.count("\n")) == (2, "", 1)
    assert words in error
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("recapture", "data", "--sensor", "ideal"), "sensor ideal is of kind spikes; allowed: photons (qvga_spad"),
        (("recapture", "data", "--sensor", SMALL), "small_sensor.yaml:2: kind is 'spikes'; allowed: photons (qvga_spa"),
        (("recapture", "data", "--sensor", "davis364"), "allowed: davis346, evk4, imx273, "),
        (("scenes", "check", "letters", "--sensor", "evk4"), "sensor evk4 is of kind events; allowed: spikes (ideal"),
        (("encode", HERE / "p.npy", "--out", "y.h5", "--rate", "9", "--linear", "--sensor", "imx273"), "kind frames"),
    ],
)
def test_a_sensor_of_the_wrong_kind_is_refused_in_one_line(arguments, words, call, tmp_path):
    np.save(tmp_path / "p.npy", np.ones((4, 8, 8), np.float32))
    code, _, error = call(*(tmp_path / "p.npy" if one == HERE / "p.npy" else one for one in arguments))
    assert (code, error.count("\n")) == (2, 1)
    assert words in error


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
        ({"name": "swissspad3", "dark_hz": 0}, "noise.dark is on, but dark_hz is 0"),
        ({"name": "imx273", "noise": {"read": False}}, "noise.read is off: read_noise_e has no effect"),
        ({"name": "evk4", "pitch_m": 2e-4}, "pitch_m is 200 µm; usual: 1 to 50"),
        ({"name": "davis346", "noise": {"hot": False}}, "noise.hot is off: hot_fraction has no effect"),
    ],
)
def test_each_unlikely_number_has_a_line(change, words):
    name = {"name": "vidar_400x250", **change}.pop("name")
    changes = {key: value for key, value in change.items() if key != "name"}
    assert any(words in line for line in implausible_keys(read_sensor(name, **changes)))


def test_a_sensor_file_is_checked(call, tmp_path):
    code, shown, _ = call("sensors", "check", SMALL)
    assert (code, shown.splitlines()[0]) == (0, "unlikely: pitch_m is 60 µm; usual: 5 to 50")
    broken = tmp_path / "mine.yaml"
    broken.write_text(SMALL.read_text().replace("dark_rate:", "dark_rte:"))
    code, _, err = call("sensors", "check", broken)
    assert code == 2
    assert "dark_rate" in err
    assert err.count("\n") == 1
