"""Cameras as they are: equal light on unequal pixels, biases of events, and the whole study on a small scene."""

import pytest
from written_scenes import needs_llvm

from saf_gen.benchmark.records import read_records
from studies.ranking import native


@pytest.mark.parametrize("name", list(native.METHODS))
def test_pixels_fire_as_often_as_those_of_the_spike_camera_in_equal_light(name):
    """Charge per second at a given irradiance, over the charge of the rate: the same for all; so is the field."""
    base, pixels = native.get_sensor(native.BASE), native.pixels_of(native.camera_of(name, 25.0))

    def rate(sensor):
        area = sensor.pitch_m**2 * sensor.fill_factor * sensor.quantum_efficiency
        return area / (sensor.readout_hz * sensor.threshold_e)

    assert rate(pixels) == pytest.approx(rate(base), rel=1e-12)
    assert pixels.columns * pixels.pitch_m == pytest.approx(native.FIELD_M, abs=pixels.pitch_m)
    assert pixels.threshold_e >= 25


def test_binned_pixels_of_the_frame_camera_hold_and_lose_as_many_electrons_as_sixteen():
    one, binned = native.get_sensor("imx273", kind="frames"), native.camera_of("imx273", 25.0)
    assert binned.electrons_per_level == pytest.approx(one.electrons_per_level, rel=1e-3)
    assert binned.full_well_e == 16 * one.full_well_e
    assert binned.read_noise_e == pytest.approx(16**0.5 * one.read_noise_e)
    assert binned.readout_hz == pytest.approx(453.9, abs=0.5)


@pytest.fixture
def small_study(test_scenes, monkeypatch):
    """Two cameras with a method each on a plane in small pictures for 20 ms."""

    def small(pixels, **asked):
        made = recipe(pixels, **asked)
        made["camera"]["frames"] = round(0.02 * pixels.readout_hz)
        made["focus"] = {"positions": 17, "motion": {"kind": "sweep"}}
        made["render"] = {"samples": 4}
        del made["scene_params"]
        made["splits"] = {asked["split"]: {"scenes": ["plane"], "lights": ["constant"]}}
        return made

    recipe = native.recipe
    monkeypatch.setattr(native, "recipe", small)
    monkeypatch.setattr(native, "FIELD_M", 0.64e-3)
    monkeypatch.setattr(native, "LOG_HZ", 5000)


CAMERAS = ["--camera", native.BASE, "imx273", "--members", "1", "--method", "sd+argmax:window=1"]


@needs_llvm
@pytest.mark.slow
def test_levels_of_light_share_stacks_and_keep_their_records_without_the_recordings(tmp_path, small_study, capsys):
    asked = ["--out", str(tmp_path), *CAMERAS, "--lux", "200", "400"]
    assert native.main(asked) == 0
    first = [line for line in capsys.readouterr().out.splitlines() if line.endswith(".jsonl")]
    assert len(first) == 8, "two cameras, levels and regions"
    assert native.main(asked) == 0
    assert capsys.readouterr().out.splitlines() == first, "nothing is made again"
    for camera in (native.BASE, "imx273"):
        assert len(list((tmp_path / camera / "stacks").iterdir())) == 1
        assert not list((tmp_path / camera).rglob("*.h5"))
    found = read_records(tmp_path / "imx273" / "test-200-lux-1-s-inside.jsonl")
    assert {(r.who.method, r.who.region) for r in found} == {("sd+argmax:window=1", "inside"), (native.GUESS, "inside")}
    assert all(r.what.sensor.startswith("imx273#") for r in found), "other rows, rate and wells than the preset"
    rates = [
        read_records(tmp_path / native.BASE / f"test-{lux}-lux-1-s-target.jsonl")[0].what.mean_rate
        for lux in (200, 400)
    ]
    dark = native.get_sensor(native.BASE).dark_rate
    assert (rates[1] - dark) / (rates[0] - dark) == pytest.approx(2, rel=0.05), "twice the light, twice the spikes"
    assert native.main([*asked[:-2], "200", "--method", "variance+argmax:window=1"]) == 0
    again = read_records(tmp_path / "imx273" / "test-200-lux-1-s-inside.jsonl")
    assert {r.who.method for r in again} == {"variance+argmax:window=1", native.GUESS}, "other methods are run"
    spikes = ["--out", str(tmp_path), *CAMERAS, "--camera", native.BASE, "--lux", "200", "--dark", "even"]
    assert native.main(spikes) == 0
    even = read_records(tmp_path / native.BASE / "test_dark_even-200-lux-1-s-inside.jsonl")
    usual = read_records(tmp_path / native.BASE / "test-200-lux-1-s-inside.jsonl")
    assert even[0].what.data != usual[0].what.data, "another dark current has records of its own"


def test_members_are_those_of_the_first_edition_with_one_light_each():
    made = native.recipe(native.get_sensor(native.BASE), split="train", members=5, lux=25.0, seconds=10.0)
    edition = native.yaml.safe_load(native.EDITION.read_text(encoding="utf-8"))
    assert (made["seed"], made["lights"]) == (edition["seed"], edition["lights"])
    assert made["splits"]["train"]["lights_each"] == 1
    assert made["splits"]["train"]["lights"] == edition["splits"]["train"]["lights"]
    assert made["camera"]["frames"] == 200_000


@pytest.mark.parametrize("lux", [1.0, 25.0, 625.0])
def test_lux_on_the_sensor_are_spikes_by_the_energy_of_their_photons(lux):
    """At 555 nm a watt is 683 lm; 2.79e18 photons a second carry it."""
    sensor = native.get_sensor(native.BASE)
    electrons_per_s = lux / 683 * 2.794e18 * sensor.pitch_m**2 * sensor.fill_factor * sensor.quantum_efficiency
    expected = electrons_per_s / sensor.readout_hz / sensor.threshold_e
    assert native.rate_at(lux) - native.rate_at(0.0) == pytest.approx(expected, rel=0.002)
    assert native.rate_at(0.0) == pytest.approx(sensor.mean_dark_e / sensor.threshold_e, rel=1e-3)


def test_a_spike_sensor_may_have_an_even_dark_current_or_none_in_the_same_light():
    sensor = native.camera_of(native.BASE, 1.0)
    even, none = (native.pixels_of(sensor, dark) for dark in ("even", "none"))
    assert (even.dark_log_sd, even.dark_hot_fraction, even.dark_rate) == (0.0, 0.0, sensor.dark_rate)
    assert even.noise.dark
    assert not none.noise.dark
    light = native.rate_at(1.0) - native.rate_at(0.0)
    assert native.rate_at(1.0, "none") == pytest.approx(light, rel=1e-3)
    assert native.rate_at(1.0, "even") == native.rate_at(1.0)


@pytest.mark.parametrize(("lux", "hz"), [(1.0, 10.0), (25.0, 5.0), (125.0, 1.0)])
def test_events_of_noise_are_those_published_for_the_light(lux, hz):
    assert native.camera_of("davis346", lux).shot_hz == hz


def test_noise_crosses_a_lower_threshold_more_often_by_the_law_of_rice():
    """In a band of B, the logarithm of the rate over B is as the square of the threshold; leaks are as its inverse."""
    rates = {c: native.camera_of("davis346", 1.0, threshold=c).shot_hz for c in (0.14, 0.2, 0.23)}
    assert rates[0.2] == 10
    assert rates[0.14] > 50 > 10 > rates[0.23] > 2
    band = native.camera_of("davis346", 1.0, threshold=0.141421356).shot_hz ** 2 / 10  # half the square: the root
    assert band == pytest.approx(275, abs=10), "300 Hz at 1 lux, and 3 kHz after it"
    low = native.camera_of("davis346", 1.0, threshold=0.14)
    assert low.leak_hz == pytest.approx(0.1 * 0.2 / 0.14)
    assert (low.threshold_on, low.threshold_off, low.threshold_rms) == (0.14, 0.14, 0.03)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--lux", "0"], "0.01 to 1500 lux"),
        (["--lux", "5", "1e9"], "0.01 to 1500 lux"),
        (["--seconds", "0"], "0.01 to 1500 lux"),
        (["--threshold", "0.1"], "0.14 to 0.23"),
        (["--threshold", "0.14"], "--camera davis346"),
        (["--dark", "even"], "--camera vidar_128x128"),
    ],
)
def test_light_and_time_that_no_camera_meets_are_one_line(tmp_path, more, words, capsys):
    assert native.main(["--out", str(tmp_path / "new"), *more]) == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(("out", "members"), [("file", "1"), ("file/x", "1"), ("x", "0"), ("x", "-3")])
def test_what_cannot_be_made_is_one_line(tmp_path, out, members, capsys):
    (tmp_path / "file").write_text("")
    assert native.main(["--out", str(tmp_path / out), "--members", members]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert len(printed.err.splitlines()) == 1


def test_a_camera_that_is_unknown_is_one_line(tmp_path, capsys):
    with pytest.raises(SystemExit, match="2"):
        native.main(["--out", str(tmp_path), "--camera", "camera"])
    assert "invalid choice" in capsys.readouterr().err
