"""Sequences recorded again by a single-photon array: the same scene, lens, light and truth, at rest and moving."""

import json

import numpy as np
import pytest
import yaml
from refusals import refusal

import saf_gen
from saf_gen.camera import get_sensor, parse_sensor
from saf_gen.stack.capture import Capture
from saf_gen.stack.recapture import Recapture

pytestmark = pytest.mark.slow

NAMES = ["plane-constant-00", "plane-lamp_only-00", "plane-dynamic-lamp_only-00"]
QUIET = {"dark": False, "response": False, "dead_time": False, "afterpulsing": False}


@pytest.fixture(scope="module")
def dataset(captured_dataset):
    return captured_dataset


def record(dataset, name, path, **changes):
    """Record photons, and return the sensor as it was exposed."""
    sensor = get_sensor("swissspad3", kind="photons", **{"noise": QUIET, "readout_hz": 50_000, **changes})
    with saf_gen.open_stream(dataset / "test" / f"{name}.h5") as stream:
        Recapture(sensor).record(stream, dataset / "stacks", path=path)
    with saf_gen.open_stream(path) as photons:
        return parse_sensor(photons.metadata.provenance["sensor"], "", kind="photons")


def photons_per_s(stream, stacks):
    """Return the light of each pixel in the middle of each readout, photons per second, float64 (T, H, W)."""
    capture = Capture.from_stream(stream, stacks)
    source = capture.open_charge_source()
    light = [
        np.einsum("g,ghw->hw", capture.gain[t].astype(np.float64), source.charge_image(t, float(position)))
        for t, position in enumerate(stream.metadata.lens_position[: capture.frames])
    ]
    return np.array(light) * stream.readout_hz


@pytest.mark.parametrize(("name", "hz"), [*((name, 50_000) for name in NAMES), (NAMES[2], 48_300), (NAMES[2], 2_500)])
def test_as_many_photons_are_detected_as_the_light_has(dataset, tmp_path, name, hz):
    """In each of ten parts, over all pixels: within 4.4 standard deviations and 0.1 % for the interpolated light.

    The slices of the moving scene are 200 frames apart, and 193.2 or 10 in the last two cases.
    """
    exposed = record(dataset, name, tmp_path / "photons.h5", readout_hz=hz)
    with saf_gen.open_stream(dataset / "test" / f"{name}.h5") as stream:
        light, ratio = photons_per_s(stream, dataset / "stacks"), hz / stream.readout_hz
    with saf_gen.open_stream(tmp_path / "photons.h5") as photons:
        frames = photons.shape[0]
        assert frames == round(len(light) * ratio)
        at = (np.arange(frames) + 0.5) / ratio - 0.5
        before = np.clip(at.astype(int), 0, len(light) - 2)
        weight = np.clip(at - before, 0, 1)[:, None, None]
        p = -np.expm1(-((1 - weight) * light[before] + weight * light[before + 1]) * exposed.exposure_s)
        for part in range(10):
            first, stop = frames * part // 10, frames * (part + 1) // 10
            seen, wanted = photons.counts(first, stop).sum(), p[first:stop].sum()
            assert abs(seen - wanted) < 4.4 * np.sqrt((p * (1 - p))[first:stop].sum()) + 1e-3 * wanted


@pytest.mark.parametrize("name", NAMES)
def test_the_truth_is_that_of_the_same_moment(dataset, tmp_path, name):
    record(dataset, name, tmp_path / "photons.h5")
    with (
        saf_gen.open_stream(dataset / "test" / f"{name}.h5") as spikes,
        saf_gen.open_stream(tmp_path / "photons.h5") as photons,
    ):
        photons.verify()
        assert photons.readout_hz == 50_000
        assert photons.truth.position == spikes.truth.position
        moments = [(stream.truth.frame + 0.5) / stream.readout_hz for stream in (spikes, photons)]
        assert moments[0] == pytest.approx(moments[1]) or np.isnan(moments).all()
        for name_of in ("focus_position", "lens_position", "image_distance"):
            of_spikes, of_photons = (getattr(stream.metadata, name_of) for stream in (spikes, photons))
            middles = [(np.arange(len(log)) + 0.5) / hz for log, hz in ((of_spikes, 20_000), (of_photons, 50_000))]
            np.testing.assert_allclose(np.interp(middles[1], middles[0], of_spikes), of_photons, atol=2e-5)
        assert (photons.truth.track is None) == (spikes.truth.track is None)
        assert photons.metadata.provenance["spikes_content"] == spikes.content_sha256


@pytest.mark.parametrize("name", NAMES)
def test_a_running_array_sees_what_was_recorded(dataset, tmp_path, name):
    record(dataset, name, tmp_path / "photons.h5", noise={"dark": True, "response": True, "afterpulsing": True})
    with saf_gen.open_stream(tmp_path / "photons.h5") as photons:
        capture = Capture.from_stream(photons, dataset / "stacks")
        source, camera = capture.open_charge_source(slice(5, 9)), capture.start_camera(slice(5, 9))
        position, parts = photons.metadata.lens_position, []
        for run in source.time_stack.split_at_slices(0, 800):
            parts.append(camera.encode(**source.encoder_inputs(run, position=position, gain=capture.gain)))
        again = np.unpackbits(np.concatenate(parts, axis=-1), axis=-1, bitorder="little")
        for first, stop in ((0, 800), (3, 5), (90, 210)):
            seen = photons.counts(first, stop, region=(slice(5, 9), slice(0, photons.shape[2])))
            np.testing.assert_array_equal(again[..., first:stop].sum(-1), seen)


def test_the_gate_opens_until_half_of_the_frames_hold_a_photon(dataset, tmp_path):
    record(dataset, NAMES[0], tmp_path / "photons.h5")
    with saf_gen.open_stream(tmp_path / "photons.h5") as photons:
        frame, target = round(photons.truth.frame), photons.truth.target
        assert photons.counts(frame - 20, frame + 20)[target].mean() / 40 == pytest.approx(0.5, abs=0.03)


def test_the_command_makes_a_dataset_resumes_and_repairs(dataset, tmp_path, call):
    target = tmp_path / "photons"
    arguments = ("recapture", dataset, "--sensor", "qvga_spad", "--out", target)
    code, output, _ = call(*arguments, "--sequence", NAMES[0])
    assert code == 0
    assert "1 sequence recorded with qvga_spad" in output
    assert [entry["id"] for entry in json.loads((target / "manifest.json").read_text())["sequences"]] == NAMES[:1]
    path = target / f"test/{NAMES[0]}.h5"
    made = path.read_bytes()
    code, output, _ = call(*arguments)
    assert code == 0
    assert "3 sequences recorded with qvga_spad, 1 kept" in output
    assert "next: saf-gen evaluate" in output
    assert path.read_bytes() == made
    damaged = bytearray(made)
    damaged[len(made) // 2] ^= 0xFF
    path.write_bytes(damaged)
    code, output, error = call(*arguments)
    assert (code, "1 sequence recorded" in output) == (0, True), error
    assert path.read_bytes() == made
    assert call("verify", target) == (0, "4 of 4 sequences are intact\n", "")
    card = json.loads((target / "croissant.json").read_text())
    assert card["license"] == json.loads((dataset / "croissant.json").read_text())["license"]
    code, output, _ = call("inspect", path)
    assert (code, "16000 Hz" in output) == (0, True)


def test_the_dataset_is_judged_on_both_tracks_by_measures_without_the_law_of_spikes(dataset, tmp_path, call):
    target = tmp_path / "photons"
    assert call("recapture", dataset, "--sensor", "swissspad3", "--out", target, "--sequence", NAMES[0])[0] == 0
    for track in ("recorded", "closed_loop"):
        out = tmp_path / track
        code, _, error = call(
            "evaluate", target, "--track", track, "--method", "sd+hill_climb" if track != "recorded" else "sd+argmax",
            "--out", out,
        )  # fmt: skip
        assert code == 0, error
        record_of = json.loads((out / "records.jsonl").read_text().splitlines()[0])
        assert record_of["sensor"] == "swissspad3"
        assert 0 <= record_of["position"] <= 1, record_of
    code, _, error = call("evaluate", target, "--method", "structure_calibrated+argmax", "--out", tmp_path / "none")
    assert (code, len(error.splitlines())) == (2, 1)
    assert "corrects for the noise of spikes" in error
    with saf_gen.open_stream(target / f"test/{NAMES[0]}.h5") as stream:
        assert stream.metadata.kind == "photons"
    assert not (tmp_path / "none").exists()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--sensor", "swisspad3"), "did you mean 'swissspad3'?"),
        (("--sensor", "swissspad3", "--split", "tst"), "did you mean 'test'?"),
        (("--sensor", "swissspad3", "--exposure-us", "11"), "exposure_s is 1.1e-05"),
        (("--sensor", "swissspad3", "--exposure-us", "0"), "seconds"),
        (("--sensor", "swissspad3", "--exposure-us", "nan"), "seconds"),
        (("--sensor", "davis346", "--exposure-us", "1"), "exposed frame by frame"),
        (("--sensor", "nothing.yaml"), "nothing.yaml"),
        (("--sensor", "vidar_400x250"), "the sensor vidar_400x250 is of kind spikes"),
    ],
)
def test_what_is_wrong_is_refused_before_anything_is_written(dataset, tmp_path, call, options, words):
    code, _, error = call("recapture", dataset, "--out", tmp_path / "photons", *options)
    assert (code, len(error.splitlines())) == (2, 1)
    assert words in error
    assert not (tmp_path / "photons").exists()


def test_what_another_has_made_is_not_overwritten(dataset, tmp_path, call):
    path = tmp_path / "photons/test/plane-constant-00.h5"
    saf_gen.write_stream(path, np.zeros((16, 4, 4), np.uint8))
    before = path.read_bytes()
    code, _, error = call("recapture", dataset, "--sensor", "swissspad3", "--out", tmp_path / "photons")
    assert (code, "did not record it" in error) == (2, True)
    assert path.read_bytes() == before
    code, _, error = call("recapture", dataset, "--sensor", "swissspad3", "--out", dataset)
    assert (code, "the dataset itself" in error) == (2, True)


def test_photons_are_not_recorded_again(dataset, tmp_path):
    record(dataset, NAMES[0], tmp_path / "photons.h5")
    sensor = get_sensor("qvga_spad", kind="photons")
    with saf_gen.open_stream(tmp_path / "photons.h5") as photons:
        error = refusal(Recapture(sensor).record, photons, dataset / "stacks", path=tmp_path / "again.h5")
        assert "no spike camera recorded it" in str(error)
    assert not (tmp_path / "again.h5").exists()


def test_a_users_file_is_a_camera_of_the_kind_that_it_says(tmp_path, dataset, call):
    fields = get_sensor("swissspad3", kind="photons").as_dict() | {"kind": "photons", "name": "mine", "sources": ["me"]}
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(fields))
    arguments = ("recapture", dataset, "--sensor", tmp_path / "mine.yaml", "--out", tmp_path / "out")
    code, _, error = call(*arguments, "--sequence", NAMES[0])
    assert code == 0, error
    with saf_gen.open_stream(tmp_path / f"out/test/{NAMES[0]}.h5") as photons:
        assert parse_sensor(photons.metadata.provenance["sensor"], "", kind="photons").name == "mine"
