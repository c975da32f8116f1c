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


@needs_llvm
@pytest.mark.slow
def test_cameras_are_rendered_recorded_and_judged_and_a_second_run_reads_records(
    tmp_path, test_scenes, monkeypatch, capsys
):
    def small(members, pixels):
        made = recipe(members, pixels)
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
    monkeypatch.setattr(native, "METHODS", {native.BASE: ["sd+argmax"], "imx273": ["variance+argmax:window=1"]})
    assert native.main(["--out", str(tmp_path), "--camera", native.BASE, "imx273"]) == 0
    assert capsys.readouterr().out.splitlines()[-1].startswith("| `imx273` | `variance+argmax:window=1` | ")


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
