"""Sensor files: strict reading, changes, and the arithmetic behind derived numbers."""

from dataclasses import asdict, replace

import numpy as np
import pytest

import saf_gen.camera.sensor as sensor_module
from saf_gen.camera import electrons_per_irradiance, get_sensor, sensor_names
from saf_gen.errors import BadInput

VIDAR = sensor_module._FOLDER / "vidar_400x250.yaml"


@pytest.fixture
def own(tmp_path):
    """A copy of the real sensor's file with one text replaced: path."""

    def write(old, new):
        text = VIDAR.read_text(encoding="utf-8")
        assert old in text
        path = tmp_path / "mine.yaml"
        path.write_text(text.replace(old, new), encoding="utf-8")
        return path

    return write


@pytest.mark.parametrize("name", sensor_names())
def test_every_sensor_that_comes_along_loads_and_names_its_sources(name):
    sensor = get_sensor(name)
    assert sensor.name == name
    assert sensor.sources
    assert hash(sensor) == hash(get_sensor(name))


def test_ideal_has_no_noise_at_all():
    ideal = get_sensor("ideal")
    assert not any(asdict(ideal.noise).values())
    assert ideal.loss == 0
    assert ideal.mean_dark_e == 0


def test_the_threshold_is_capacitance_times_voltage():
    vidar = get_sensor("vidar_400x250")
    assert vidar.threshold_e == pytest.approx(4.35e-15 * 1.1 / 1.602176634e-19, rel=0.002)


def test_the_fill_factor_gives_rate_one_half_at_1700_lux():
    vidar = get_sensor("vidar_400x250")
    assert electrons_per_irradiance(vidar) * 1_700 / 683 == pytest.approx(vidar.threshold_e, rel=0.002)


def test_the_white_spread_of_rates_is_counted_once():
    vidar = get_sensor("vidar_400x250")
    assert np.hypot(vidar.response_white_rms, vidar.threshold_spread_rms) == pytest.approx(0.026, rel=0.002)
    parts = (vidar.response_column_rms, vidar.response_row_rms, 0.026)
    assert np.linalg.norm(parts) == pytest.approx(0.057, abs=0.002)


def test_a_noise_term_is_switched_alone():
    vidar = get_sensor("vidar_400x250")
    quiet = vidar.with_noise(shot=False)
    assert not quiet.noise.shot
    assert quiet.with_noise(shot=True) == vidar
    assert get_sensor("vidar_400x250", noise={"shot": False}) == quiet


def test_changes_are_checked_like_a_file():
    assert get_sensor("vidar_400x250", threshold_e=400).threshold_e == 400
    with pytest.raises(BadInput, match=r"pitch_m is 20; allowed: 2e-07 to 0.001 metres"):
        get_sensor("vidar_400x250", pitch_m=20)
    with pytest.raises(BadInput, match=r"unknown sensor key 'treshold_e'.*did you mean 'threshold_e'\?"):
        get_sensor("vidar_400x250", treshold_e=400)
    with pytest.raises(BadInput, match=r"unknown noise term 'shott'.*did you mean 'shot'\?"):
        get_sensor("vidar_400x250").with_noise(shott=False)
    with pytest.raises(BadInput, match=r"noise\.dark is 0; allowed: true or false"):
        get_sensor("vidar_400x250", noise={"dark": 0})


def test_a_replaced_value_is_checked_too():
    with pytest.raises(BadInput, match=r"reset is 'hrd'; allowed: subtract, hard; did you mean 'hard'\?"):
        replace(get_sensor("ideal"), reset="hrd")


def test_shot_noise_needs_electrons_enough_to_be_normal():
    with pytest.raises(BadInput, match="threshold_e is 4 with shot noise on; allowed: at least 20"):
        get_sensor("vidar_400x250", threshold_e=4)
    assert get_sensor("vidar_400x250", threshold_e=4, noise={"shot": False}).threshold_e == 4


def test_an_unknown_sensor_is_told_with_the_next_step():
    with pytest.raises(BadInput, match=r"unknown sensor 'vidar_400x25'.*'vidar_400x250'\?; or give the path"):
        get_sensor("vidar_400x25")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("pitch_m: 2.0e-5 ", "pitch_mm: 0.02 ", r"mine.yaml:5: unknown sensor key 'pitch_mm'.*'pitch_m'\?"),
        ("pitch_m: 2.0e-5 ", "pitch_m: 20 ", r"mine.yaml:5: pitch_m is 20; allowed: .* metres"),
        ("pitch_m: 2.0e-5 ", "pitch_m: 2e-5 ", r"pitch_m is '2e-5'.*write 1.0e-5"),
        ("rows: 250", "rows: true", r"mine.yaml:3: rows is True; allowed: a whole number"),
        ("rows: 250", "", r"the sensor key 'rows' is missing"),
        ("reset: subtract", "reset: soft", r"reset is 'soft'; allowed: subtract, hard"),
        ("{shot: true, ", "{shots: true, ", r"unknown noise term 'shots'.*'shot'\?"),
        ("{shot: true, ", "{", r"the noise term 'shot' is missing"),
        ("noise: {", "noise: 3 # {", r"noise is 3; allowed: shot, dark"),
    ],
)
def test_a_file_that_does_not_fit_is_told_by_line(own, old, new, message):
    with pytest.raises(BadInput, match=message):
        get_sensor(own(old, new))


def test_ones_own_file_is_read(own):
    assert get_sensor(str(own("rows: 250", "rows: 64"))).rows == 64


def test_a_file_that_is_missing_or_empty_is_told(tmp_path):
    with pytest.raises(BadInput, match="does not exist"):
        get_sensor(tmp_path / "none.yaml")
    (tmp_path / "empty.yaml").write_text("")
    with pytest.raises(BadInput, match="the file holds no keys"):
        get_sensor(tmp_path / "empty.yaml")
