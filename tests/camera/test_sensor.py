"""Sensors: changes, the arithmetic behind derived numbers, the laws of each sensor, and sensor files in recipes."""

from dataclasses import asdict, replace

import numpy as np
import pytest
import yaml
from refusals import refusal
from small_dataset import SMALL_RECIPE

from saf_gen.camera import electrons_per_irradiance, encode, get_sensor, parse_sensor, sensor_names
from saf_gen.errors import BadInput
from saf_gen.generate.resolve import resolve_recipe


def test_the_noisy_one_is_the_nominal_one_but_for_the_noise_of_its_thresholds():
    nominal, noisy = get_sensor("vidar_400x250"), get_sensor("vidar_400x250_noisy")
    assert (nominal.threshold_noise_rms, noisy.threshold_noise_rms) == (0.0058, 0.035)
    differ = {key: getattr(nominal, key) for key in ("name", "threshold_noise_rms", "sources")}
    assert replace(noisy, **differ) == nominal


def test_the_fast_mode_is_the_same_chip_read_twice_as_often():
    """Light, dark current and the time of a reset are the same per second."""
    slow, fast = get_sensor("vidar_400x250"), get_sensor("vidar_400x250_40khz")
    assert electrons_per_irradiance(fast) == pytest.approx(electrons_per_irradiance(slow) / 2)
    assert fast.mean_dark_e * fast.readout_hz == pytest.approx(slow.mean_dark_e * slow.readout_hz)
    assert fast.reset_loss / fast.readout_hz == pytest.approx(slow.reset_loss / slow.readout_hz)
    per_readout = ("name", "readout_hz", "dark_rate", "reset_loss", "sources")
    assert replace(fast, **{key: getattr(slow, key) for key in per_readout}) == slow


def test_ideal_counts_charge_to_the_last_spike():
    """Each of 1,000 pixels counts charge over threshold in any window, to one spike because of the phase."""
    charge = np.linspace(0, 0.99, 1_000, dtype=np.float32).reshape(1, 20, 50) * 29_900
    spikes = encode(charge, "ideal", frames=2_000, seed=4)
    for frames in (8, 800, 2_000):
        counted = np.bitwise_count(spikes[..., : frames // 8]).sum(axis=-1)
        assert abs(counted - charge[0] / 29_900 * frames).max() < 1


@pytest.mark.parametrize("name", sensor_names("spikes"))
@pytest.mark.parametrize("saturation", ["subtract", "dead_readout"])
@pytest.mark.parametrize("reset", ["subtract", "hard"])
def test_every_sensor_obeys_the_law_of_its_reset_and_saturation(name, saturation, reset):
    """1,000 pixels, 2,000 readouts, no noise; the loss after a spike is ℓ, which is 1 for a dead readout.

    subtract: a spike costs θ + ℓ·q, so rate = q/(θ + ℓ·q). hard: the next spike is in the first readout n
    with (n - ℓ)·q at least θ, so rate = 1/⌈θ/q + ℓ⌉. The phase leaves an error below 1/2,000.
    """
    off = dict.fromkeys(asdict(get_sensor(name).noise), False)
    sensor = get_sensor(name, saturation=saturation, reset=reset, noise=off)
    theta = sensor.threshold_e
    ratio = np.array([0.013, 0.11, 0.23, 0.437, 0.6, 0.77, 0.93])  # of charge to threshold
    rates = np.bitwise_count(
        encode(np.broadcast_to(np.float32(ratio * theta), (1, 143, 7)), sensor, frames=2_000, seed=1)
    ).sum(axis=-1).mean(axis=0) / 2_000  # fmt: skip
    loss = 1.0 if saturation == "dead_readout" else sensor.reset_loss
    law = ratio / (1 + loss * ratio) if reset == "subtract" else 1 / np.ceil(1 / ratio + loss)
    assert rates == pytest.approx(law, abs=6e-4)


def test_the_threshold_is_capacitance_times_voltage():
    vidar = get_sensor("vidar_400x250")
    assert vidar.threshold_e == pytest.approx(4.35e-15 * 1.1 / 1.602176634e-19, rel=0.002)


def test_the_fill_factor_gives_rate_one_half_at_1700_lux():
    vidar = get_sensor("vidar_400x250")
    assert electrons_per_irradiance(vidar) * 1_700 / 683 == pytest.approx(vidar.threshold_e, rel=0.002)


def test_the_white_spread_of_rates_is_counted_once():
    vidar = get_sensor("vidar_400x250")
    assert np.hypot(vidar.response_white_rms, vidar.threshold_spread_rms) == pytest.approx(0.021, rel=0.005)


def test_a_noise_term_is_switched_alone():
    vidar = get_sensor("vidar_400x250")
    quiet = vidar.with_noise(shot=False)
    assert not quiet.noise.shot
    assert quiet.with_noise(shot=True) == vidar
    assert get_sensor("vidar_400x250", noise={"shot": False}) == quiet


def test_shot_noise_needs_electrons_enough_to_be_normal():
    message = str(refusal(get_sensor, "vidar_400x250", threshold_e=4))
    assert "threshold_e is 4 with shot noise on" in message
    assert "at least 25" in message
    assert get_sensor("vidar_400x250", threshold_e=4, noise={"shot": False}).threshold_e == 4


# --- a sensor file in a recipe -----------------------------------------------------------------------


@pytest.fixture
def recipe(tmp_path, test_scenes, small_sensor):
    """The path of the small recipe, whose sensor is recipes/cameras/mine.yaml, a copy of the small sensor."""
    path = tmp_path / "recipes" / "small.yaml"
    (path.parent / "cameras").mkdir(parents=True)
    (path.parent / "cameras" / "mine.yaml").write_text(small_sensor.read_text())
    text = SMALL_RECIPE.replace(str(small_sensor), "cameras/mine.yaml")
    assert text != SMALL_RECIPE
    path.write_text(text)
    return path


def test_a_recipe_finds_its_sensor_from_its_own_folder(recipe, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert resolve_recipe("recipes/small.yaml").sensor.rows == 40
    monkeypatch.chdir("/")
    assert resolve_recipe(recipe).sensor == get_sensor(recipe.parent / "cameras" / "mine.yaml")


def test_the_content_of_a_sensor_file_decides_and_not_its_name(recipe):
    def fingerprints():
        work = resolve_recipe(recipe)
        return [s.fingerprint("a stack") for s in work.sequences]

    before, mine = fingerprints(), recipe.parent / "cameras" / "mine.yaml"
    renamed = mine.rename(mine.with_name("other.yaml"))
    recipe.write_text(recipe.read_text().replace("mine", "other"))
    renamed.write_text(renamed.read_text().replace("name: small", "name: other") + "# a remark\n")
    assert fingerprints() == before
    text = renamed.read_text()
    for key in ("dark_rate: 0.0045", "threshold_e: 29900", "readout_hz: 20000", "{shot: true"):
        assert key in text
        renamed.write_text(text.replace(key, key.replace("5", "6").replace("2", "3").replace("true", "false")))
        assert not set(fingerprints()) & set(before), key


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("cameras/mine.yaml", "cameras/mein.yaml", r"cameras/mein.yaml does not exist; did you mean .*mine.yaml"),
        ("cameras/mine.yaml", "mine.yaml", r"recipes/mine.yaml does not exist"),
        ("cameras/mine.yaml", "vidar", r"unknown sensor 'vidar'.*or give the path of a .yaml file"),
    ],
)
def test_a_recipe_with_a_missing_sensor_is_refused_in_one_line(recipe, old, new, message):
    recipe.write_text(recipe.read_text().replace(old, new))
    with pytest.raises(BadInput, match=message) as caught:
        resolve_recipe(recipe)
    assert "\n" not in str(caught.value)
    assert caught.value.exit_code == 2


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"filter": "bg39"}, "none, ir_cut, or [[400, 0.1]"),
        ({"filter": True}, "none, ir_cut, or"),
        ({"filter": [[400, 1.0]]}, "none, ir_cut, or"),
        ({"filter": [[400, 1.0], [390, 1.0]]}, "rising wavelength"),
        ({"filter": [[400, 1.0], [500, 1.1]]}, "a fraction"),
        ({"filter": [[0.4, 1.0], [0.5, 1.0]]}, "wavelength in nm"),
        ({"filter": [[400, 1.0], [500, "1"]]}, "a fraction"),
        ({"filter": [[400, 1.0], 500]}, "pairs"),
        ({"spectral_qe": "ir_cut"}, "silicon, or"),
        ({"spectral_qe": {"400": 0.1}}, "silicon, or"),
        ({"spectral_qe": None}, "silicon, or"),
    ],
)
def test_a_curve_that_is_none_is_refused_in_one_line(changes, said):
    assert said in str(refusal(get_sensor, "vidar_400x250", **changes))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"spectral_qe": [[400, 0.0], [600, 0.0]]}, "0 at wavelength_m"),
        ({"spectral_qe": [[600, 0.1], [700, 0.9]]}, "0 at wavelength_m"),
        ({"spectral_qe": [[400, 0.1], [555, 0.1], [800, 0.9]], "quantum_efficiency": 0.5}, "at most 1 electron"),
    ],
)
def test_a_curve_that_fits_no_quantum_efficiency_is_refused_where_it_is_used(changes, said):
    assert said in str(refusal(get_sensor("vidar_400x250", **changes).spectral_response))


def test_curves_are_part_of_a_sensor_s_text_only_if_it_states_them():
    plain, filtered = get_sensor("vidar_400x250"), get_sensor("vidar_400x250", filter=[[400, 0], [500, 1]])
    assert not {"filter", "spectral_qe"} & set(plain.as_dict())
    assert parse_sensor(yaml.safe_dump(filtered.as_dict(), sort_keys=False), "here") == filtered
    assert plain.spectral_response()[555 - 380] == pytest.approx(1)
    assert filtered.spectral_response()[450 - 380] == pytest.approx(plain.spectral_response()[450 - 380] / 2)
