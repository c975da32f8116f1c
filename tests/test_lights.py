"""Light schedules, against the integrals they stand for."""

import numpy as np
import pytest
from scipy.integrate import quad

from saf_gen import get_light, registry
from saf_gen.errors import BadInput
from saf_gen.lights import readout_gains

EXAMPLES = {
    "constant": {"level": 0.7},
    "ramp": {"from": 0.5, "to": 2.0},
    "steps": {"every_s": 0.1, "levels": [1.0, 0.4, 2.0]},
    "sine": {"hz": 3.0, "swing": 0.4, "phase": 1.0},
}


def test_every_registered_light_has_an_example_here():
    assert set(EXAMPLES) == set(registry.names("lights"))


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_integral_starts_at_zero_and_never_falls(name):
    times = np.linspace(0, 1, 501)
    integral = get_light(name, **EXAMPLES[name]).integral(times, 1.0)
    assert integral.shape == times.shape
    assert integral[0] == pytest.approx(0, abs=1e-15)
    assert (np.diff(integral) >= 0).all()


@pytest.mark.parametrize("name", EXAMPLES)
def test_gains_do_not_depend_on_how_finely_time_is_cut(name):
    light = get_light(name, **EXAMPLES[name])
    fine = readout_gains(light, 4000, 4000.0).reshape(-1, 4).mean(axis=1)
    assert np.allclose(fine, readout_gains(light, 1000, 1000.0), rtol=1e-5)


def test_a_ramp_runs_from_one_end_of_the_recording_to_the_other():
    gains = readout_gains(get_light("ramp", **{"from": 0.5, "to": 2.0}), 1000, 20_000)
    assert np.allclose(gains, 0.5 + 1.5 * (np.arange(1000) + 0.5) / 1000, rtol=1e-5)


def test_a_ramp_with_a_length_stays_at_its_end():
    gains = readout_gains(get_light("ramp", **{"from": 1, "to": 3, "over_s": 0.5}), 100, 100)
    assert gains[:50] == pytest.approx(1 + 4 * (np.arange(50) + 0.5) / 100, rel=1e-5)
    assert gains[50:] == pytest.approx(3)


def test_steps_take_their_levels_in_turn():
    gains = readout_gains(get_light("steps", every_s=0.1, levels=[1.0, 0.4, 2.0]), 20, 20.0)
    assert gains == pytest.approx([1, 1, 0.4, 0.4, 2, 2] * 3 + [1, 1], rel=1e-5)


def test_a_step_within_a_readout_counts_by_its_share():
    gains = readout_gains(get_light("steps", every_s=0.15, levels=[0.0, 1.0]), 2, 10.0)
    assert gains == pytest.approx([0, 0.5], abs=1e-6)


def test_a_sine_is_the_integral_of_what_its_docstring_says():
    light = get_light("sine", hz=3.0, swing=0.4, level=1.5, phase=1.0)
    expected, _ = quad(lambda t: 1.5 * (1 + 0.4 * np.sin(2 * np.pi * 3.0 * t + 1.0)), 0, 0.37)
    assert float(light.integral(np.array(0.37), 1.0)) == pytest.approx(expected, rel=1e-9)


def test_flicker_of_100_hz_vanishes_in_200_readouts_at_20_khz():
    gains = readout_gains(get_light("sine", hz=100.0, swing=0.9), 2000, 20_000)
    assert gains.reshape(-1, 200).mean(axis=1) == pytest.approx(1.0, abs=1e-6)
    assert np.ptp(gains) > 1.7


@pytest.mark.parametrize(
    ("name", "options", "told"),
    [
        ("constant", {"level": -1}, "level is -1; allowed: a gain of 0 or more"),
        ("ramp", {"from": -0.5, "to": 1}, "allowed: gains of 0 or more"),
        ("ramp", {"from": 0.5, "to": 1, "over_s": 0}, "over_s is 0; allowed: seconds above 0"),
        ("steps", {"every_s": 0, "levels": [1]}, "every_s is 0"),
        ("steps", {"every_s": 1, "levels": []}, "levels are"),
        ("sine", {"hz": 0}, "hz is 0; allowed: a frequency above 0 in Hz"),
        ("sine", {"hz": 1, "swing": 1.5}, "swing is 1.5; allowed: 0 to 1: there is no negative light"),
        ("constant", {"level": "bright"}, "light schedule 'constant'"),
    ],
)
def test_an_impossible_light_is_refused(name, options, told):
    with pytest.raises(BadInput, match=told):
        get_light(name, **options)
