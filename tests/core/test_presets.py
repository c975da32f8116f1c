"""Files of sensors and actuators: strict reading, changed fields, and errors with what is allowed."""

from dataclasses import replace

import pytest
from refusals import refusal

from saf_gen.camera import get_sensor, sensor_names
from saf_gen.camera.sensor_files import FOLDER, read_sensor
from saf_gen.optics.actuators import actuator, actuator_names, get_actuator

SENSORS, ACTUATORS = FOLDER, actuator.PRESETS.folder
EVERY_PRESET = [*((read_sensor, name) for name in sensor_names()), *((get_actuator, name) for name in actuator_names())]
DEVICES = pytest.mark.parametrize(
    ("get", "folder", "name"),
    [
        (read_sensor, SENSORS, "vidar_400x250"),
        (read_sensor, SENSORS, "swissspad3"),
        (read_sensor, SENSORS, "imx273"),
        (read_sensor, SENSORS, "davis346"),
        (get_actuator, ACTUATORS, "voice_coil"),
    ],
    ids=["spikes", "photons", "frames", "events", "actuator"],
)


@pytest.fixture
def write_copy(tmp_path):
    """A function that writes a copy of a preset's file with one text replaced, and returns its path."""

    def write(folder, name, old, new):
        text = (folder / f"{name}.yaml").read_text(encoding="utf-8")
        assert old in text
        path = tmp_path / "mine.yaml"
        path.write_text(text.replace(old, new), encoding="utf-8")
        return path

    return write


@pytest.mark.parametrize(("get", "name"), EVERY_PRESET, ids=[name for _, name in EVERY_PRESET])
def test_every_preset_loads_and_names_its_sources(get, name):
    device = get(name)
    assert device.name == name
    assert device.sources
    assert hash(device) == hash(get(name))


@DEVICES
def test_the_name_of_an_unknown_device_gets_the_next_step(get, folder, name):
    error = refusal(get, name[:-1])
    assert error.problem == f"unknown {'actuator' if get is get_actuator else 'sensor'} {name[:-1]!r}"
    assert error.nearest == name
    assert error.hint == "or give the path of a .yaml file"


@pytest.mark.parametrize("sources", ["", "[3]"])
@DEVICES
def test_a_device_names_its_sources(get, folder, name, sources, tmp_path):
    head = (folder / f"{name}.yaml").read_text(encoding="utf-8").split("sources:")[0]
    (tmp_path / "mine.yaml").write_text(f"{head}sources: {sources}\n", encoding="utf-8")
    error = refusal(get, tmp_path / "mine.yaml")
    assert error.problem.startswith("sources is ")
    assert error.allowed == "a list of at least one text"


SENSOR_MISTAKES = [
    ("pitch_m: 2.0e-5 ", "pitch_mm: 0.02 ", ":6", "unknown key 'pitch_mm'", "pitch_m"),
    ("pitch_m: 2.0e-5 ", "pitch_m: 20 ", ":6", "pitch_m is 20", "2e-07 to 0.001 metres"),
    ("pitch_m: 2.0e-5 ", "pitch_m: '2e-5' ", ":6", "pitch_m is '2e-5'", "without quotes"),
    ("rows: 250", "rows: 2.5", ":4", "rows is 2.5", "a whole number 1 to 16384 pixels"),
    ("rows: 250", "", "", "the key 'rows' is missing", ""),
    (
        "response_row_legendre: [0.9123, 0.0866]",
        "",
        "",
        "the key 'response_row_legendre' is missing",
        "fractions of the profile's variance in Legendre polynomials of degree 1, 2, …; the rest is white",
    ),
    ("[0.9123, 0.0866]", "[0.9, 0.2]", "", "response_row_legendre is [0.9, 0.2]", "each 0 to 1 and together at most 1"),
    ("reset: subtract", "reset: soft", "", "reset is 'soft'", "subtract, hard"),
    ("{shot: true, ", "{shots: true, ", "", "unknown key 'shots' in noise", "shot"),
    ("{shot: true, ", "{shot: 1, ", "", "noise.shot is 1", "true or false"),
    ("noise: {", "noise: 3 # {", "", "noise is 3", "shot, dark"),
    ("name: vidar_400x250", "name: 7", ":3", "name is 7", "a text"),
    ("kind: spikes\n", "", ":2", "the key 'kind' is missing", "spikes, photons, frames, events"),
    ("kind: spikes", "kind: spike", ":2", "kind is 'spike'", "spikes"),
    ("kind: spikes", "kind: [spikes]", ":2", "kind is ['spikes']", "spikes, photons, frames, events"),
    ("kind: spikes", "kind: frames", ":2", "kind is 'frames'", "spikes (ideal, "),
    ("sources:\n", "sources: []\nother:\n", "", "unknown key 'other'", ""),
]
DRIFT = "drift: {per_k: 0.003, ambient_k: 5, heating_k: 10, time_s: 60}"
ACTUATOR_MISTAKES = [
    ("damping: 0.10 ", "dampening: 0.10 ", ":8", "unknown key 'dampening'", "damping"),
    ("latency_s: 1.0e-4", "latency_s: 5", ":17", "latency_s is 5", "0 to 1 seconds"),
    ("speed: 10000 ", "speed: .inf ", ":4", "speed is inf", "0.001 to 1e+06 travels per second"),
    ("backlash: 0.01 ", "backlash: 1 ", "", "backlash is 1", "0 to 0.2 of the travel"),
    ("place_rms: 0\n", "", "", "the key 'place_rms' is missing", ""),
    ("reads: motor ", "reads: motr ", ":14", "reads is 'motr'", "motor"),
    *(
        ("place_rms: 0\n", f"place_rms: 0\n{line}\n", ":13", problem, expected)
        for line, problem, expected in [
            ("hysteresis: 13", "hysteresis is 13", "0 to 0.3 of the travel"),
            ("hysteresis: -0.1", "hysteresis is -0.1", "0 to 0.3 of the travel"),
            ("hysteresis: '0.1'", "hysteresis is '0.1'", "without quotes"),
            ("hysteresis: 13 %", "hysteresis is '13 %'", "0 to 0.3 of the travel"),
            ("hysteresis: [0.1]", "hysteresis is [0.1]", "0 to 0.3 of the travel"),
            ("hysteresis: true", "hysteresis is True", "0 to 0.3 of the travel"),
            ("hysteresis: .nan", "hysteresis is nan", "0 to 0.3 of the travel"),
            ("hysteresis:", "hysteresis is None", "0 to 0.3 of the travel"),
            ("histeresis: 0.1", "unknown key 'histeresis'", "hysteresis"),
            ("drift: 0.003", "drift is 0.003", "per_k, ambient_k, heating_k, time_s"),
            ("drift: {per_k: 0.003}", "the key 'drift.ambient_k' is missing", ""),
            (DRIFT.replace("0.003", "3"), "drift.per_k is 3", "-0.05 to 0.05 of the travel per kelvin"),
            (DRIFT.replace("60", "0"), "drift.time_s is 0", "0.1 to 100000 seconds"),
            (DRIFT.replace("10", "-10"), "drift.heating_k is -10", "0 to 100 kelvins"),
            (DRIFT.replace("5,", "293,"), "drift.ambient_k is 293", "-60 to 60 kelvins"),
            (DRIFT.replace("time_s", "tau_s"), "unknown key 'tau_s' in drift", "time_s"),
        ]
    ),
]


@pytest.mark.parametrize(
    ("device", "old", "new", "where", "problem", "expected"),
    [*(("sensor", *row) for row in SENSOR_MISTAKES), *(("actuator", *row) for row in ACTUATOR_MISTAKES)],
)
def test_a_file_that_does_not_fit_is_refused_with_its_line(write_copy, device, old, new, where, problem, expected):
    get, folder, name = {
        "sensor": (get_sensor, SENSORS, "vidar_400x250"),
        "actuator": (get_actuator, ACTUATORS, "voice_coil"),
    }[device]
    error = refusal(get, write_copy(folder, name, old, new))
    assert error.problem == problem
    assert f"mine.yaml{where}" in error.where
    assert expected in error.allowed or error.nearest == expected


@pytest.mark.parametrize(
    ("line", "absent"),
    [
        ("dust_fraction: 0.0006", {"dust_fraction": 0}),
        ("response_twist_rms: 0.0060", {"response_twist_rms": 0}),
        ("temperature_c: 25\n\n", {}),
        (", dust: true, dead: true, reset_jitter: false", {"noise": {"dust": False, "dead": False}}),
    ],
)
def test_newer_keys_that_an_older_file_lacks_have_no_effect(write_copy, line, absent):
    """A file older than dust, twist and temperature has no dust and no twist, and the reference temperature."""
    name = "vidar_400x250_40khz"
    assert get_sensor(write_copy(SENSORS, name, line, "")) == get_sensor(name, **absent)


def test_a_users_file_is_read(write_copy):
    assert get_sensor(str(write_copy(SENSORS, "vidar_400x250", "rows: 250", "rows: 64"))).rows == 64
    own = write_copy(ACTUATORS, "voice_coil", "damping: 0.10 ", "damping: 0.3 ")
    assert get_actuator(own).damping == 0.3


def test_a_changed_field_is_checked_like_a_file():
    error = refusal(get_sensor, "vidar_400x250", noise={"dark": 0})
    assert str(error) == "sensor vidar_400x250: noise.dark is 0; allowed: true or false"
    error = refusal(get_actuator, "voice_coil", reads="lense")
    assert str(error) == "actuator voice_coil: reads is 'lense'; allowed: lens, motor; did you mean 'lens'?"
    assert refusal(get_sensor, "ideal", treshold_e=400).nearest == "threshold_e"
    assert refusal(get_sensor("ideal").with_noise, shott=False).nearest == "shot"
    assert refusal(get_actuator, "ideal", dampng=0.2).nearest == "damping"


@pytest.mark.parametrize(("device", "field"), [(get_sensor("ideal"), "reset"), (get_actuator("ideal"), "reads")])
def test_a_replaced_value_is_checked_too(device, field):
    with pytest.raises(ValueError, match=f"{field}\n.*Input should be"):
        replace(device, **{field: "hrd"})
