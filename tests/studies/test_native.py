"""Cameras as they are: equal light on unequal pixels, errors behind the lens, and the whole study on a small scene."""

import pytest
from written_scenes import needs_llvm

from saf_gen.benchmark.records import read_records
from saf_gen.optics import drive_from_dict
from studies.ranking import native

LENS = {"focal_length_m": 0.05, "f_number": 2.0, "transmission": 1.0}


def a_drive(kind):
    if kind == "stage":
        return drive_from_dict({"kind": "stage", "magnification": 0.5, "travel_m": (-0.01, 0.01), **LENS})
    return drive_from_dict({"kind": kind, "focus_range_m": (2.0, 0.5), **LENS})


@pytest.mark.parametrize("name", list(native.METHODS))
def test_pixels_fire_as_often_as_those_of_the_spike_camera_in_equal_light(name):
    """Charge per second at a given irradiance, over the charge of the rate: the same for all; so is the field."""
    base, pixels = native.get_sensor(native.BASE), native.pixels_of(native.camera_of(name))

    def rate(sensor):
        area = sensor.pitch_m**2 * sensor.fill_factor * sensor.quantum_efficiency
        return area / (sensor.readout_hz * sensor.threshold_e)

    assert rate(pixels) == pytest.approx(rate(base), rel=1e-12)
    assert pixels.columns * pixels.pitch_m == pytest.approx(native.FIELD_M, abs=pixels.pitch_m)
    assert pixels.threshold_e >= 25


def test_binned_pixels_of_the_frame_camera_hold_and_lose_as_many_electrons_as_sixteen():
    one, binned = native.get_sensor("imx273", kind="frames"), native.camera_of("imx273")
    assert binned.electrons_per_level == pytest.approx(one.electrons_per_level, rel=1e-3)
    assert binned.full_well_e == 16 * one.full_well_e
    assert binned.read_noise_e == pytest.approx(16**0.5 * one.read_noise_e)
    assert binned.readout_hz == pytest.approx(453.9, abs=0.5)


@pytest.mark.parametrize(("position", "truth"), [(0.3, 0.5), (0.5, 0.3), (0.0, 1.0), (0.4, 0.4)])
def test_the_error_behind_a_lens_that_moves_is_how_far_it_moved(position, truth):
    drive = a_drive("image_distance")
    expected = drive.image_distance(position) - drive.image_distance(truth)
    assert native.image_error_m(drive, position, truth=truth) == pytest.approx(float(expected), abs=1e-12)


@pytest.mark.parametrize(("position", "truth"), [(0.3, 0.5), (0.5, 0.3), (0.0, 1.0), (0.4, 0.4)])
def test_the_error_behind_a_stage_is_that_of_the_thin_lens(position, truth):
    """At a magnification of 0.5, sensor and plane in focus are at 1.5 f and 3 f, and the stage moves by 2 cm in all."""
    moved = float(a_drive("stage").shift(truth) - a_drive("stage").shift(position))
    image = 1 / (1 / 0.05 - 1 / (0.15 + moved))
    assert native.image_error_m(a_drive("stage"), position, truth=truth) == pytest.approx(0.075 - image, abs=1e-12)
    assert abs(moved) == pytest.approx(0.02 * abs(position - truth))


@pytest.fixture
def small_study(test_scenes, monkeypatch):
    """Two cameras with a method each on a plane in small pictures for 20 ms."""

    def small(members, pixels, **light):
        made = recipe(members, pixels, **light)
        made["camera"]["frames"] = round(0.02 * pixels.readout_hz)
        made["focus"] = {"positions": 17, "motion": {"kind": "sweep"}}
        made["render"] = {"samples": 4}
        made["splits"]["test"] = {"scenes": ["plane"], "lights": ["constant", "darker"]}
        return made

    recipe = native.recipe
    monkeypatch.setattr(native, "recipe", small)
    monkeypatch.setattr(native, "FIELD_M", 0.64e-3)
    monkeypatch.setattr(native, "METHODS", {native.BASE: ["sd+argmax"], "imx273": ["sd+argmax:window=1"]})
    monkeypatch.setattr(native, "LOG_HZ", 5000)


@needs_llvm
@pytest.mark.slow
def test_cameras_are_rendered_recorded_and_judged_and_a_second_run_reads_records(
    tmp_path, small_study, monkeypatch, capsys
):
    assert native.main(["--out", str(tmp_path), "--camera", native.BASE, "imx273"]) == 0
    first = capsys.readouterr().out.splitlines()[-6:]
    assert first[0].startswith("2 recordings of ")
    assert sum(line.startswith("| `imx273` | `sd+argmax:window=1` | ") for line in first) == 1
    found = read_records(tmp_path / "imx273" / "records.jsonl")
    assert all(
        record.what.sensor.startswith("imx273#") for record in found
    )  # other rows, rate and wells than the preset
    assert native.main(["--out", str(tmp_path), "--camera", native.BASE, "imx273"]) == 0
    assert capsys.readouterr().out.splitlines()[-6:] == first
    assert {record.who.region for record in found} == {"target"}
    assert native.main(["--out", str(tmp_path), "--camera", native.BASE, "imx273", "--region", "inside"]) == 0
    inside = read_records(tmp_path / "imx273" / "records.jsonl")
    assert {record.who.region for record in inside} == {"inside"}, "records of another region are not those asked for"
    monkeypatch.setattr(native, "METHODS", {native.BASE: ["sd+argmax"], "imx273": ["variance+argmax:window=1"]})
    assert native.main(["--out", str(tmp_path), "--camera", native.BASE, "imx273"]) == 0
    assert capsys.readouterr().out.splitlines()[-1].startswith("| `imx273` | `variance+argmax:window=1` | ")


@needs_llvm
@pytest.mark.slow
def test_levels_of_light_share_stacks_and_keep_their_answers_without_the_recordings(tmp_path, small_study, capsys):
    for lux in ("200", "400"):
        assert native.main(["--out", str(tmp_path), "--camera", native.BASE, "imx273", "--lux", lux]) == 0
        first = capsys.readouterr().out.splitlines()[-6:]
        assert native.main(["--out", str(tmp_path), "--camera", native.BASE, "imx273", "--lux", lux]) == 0
        assert capsys.readouterr().out.splitlines() == first, "nothing is made again"
    for camera in (native.BASE, "imx273"):
        assert len(list((tmp_path / camera / "stacks").iterdir())) == 1
        assert not list((tmp_path / camera).rglob("*.h5"))
    rates = [
        read_records(tmp_path / native.BASE / f"{lux}-lux-1-s-target.jsonl")[0].what.mean_rate for lux in (200, 400)
    ]
    dark = native.get_sensor(native.BASE).dark_rate
    assert (rates[1] - dark) / (rates[0] - dark) == pytest.approx(2, rel=0.05), "twice the light, twice the spikes"


@pytest.mark.parametrize("lux", [1.0, 25.0, 625.0])
def test_lux_on_the_sensor_are_spikes_by_the_energy_of_their_photons(lux):
    """At 555 nm a watt is 683 lm; 2.79e18 photons a second carry it."""
    sensor = native.get_sensor(native.BASE)
    electrons_per_s = lux / 683 * 2.794e18 * sensor.pitch_m**2 * sensor.fill_factor * sensor.quantum_efficiency
    expected = electrons_per_s / sensor.readout_hz / sensor.threshold_e
    assert native.rate_at(lux) - native.rate_at(0.0) == pytest.approx(expected, rel=0.002)
    assert native.rate_at(0.0) == pytest.approx(sensor.mean_dark_e / sensor.threshold_e, rel=1e-3)


@pytest.mark.parametrize(("lux", "hz"), [(1.0, 10.0), (25.0, 5.0), (125.0, 1.0), (None, 1.0)])
def test_events_of_noise_are_those_published_for_the_light(lux, hz):
    assert native.camera_of("davis346", lux).shot_hz == hz


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--lux", "0"], "0.01 to 1500 lux"),
        (["--lux", "1e9"], "0.01 to 1500 lux"),
        (["--lux", "5", "--seconds", "0"], "0.01 to 1500 lux"),
        (["--seconds", "10"], "--seconds 10 is given without --lux"),
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
