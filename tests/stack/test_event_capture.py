"""Events of a sequence: the same scene, lens and light as its spikes, at rest and moving."""

import json

import numpy as np
import pytest
import yaml
from refusals import refusal

import saf_gen
from saf_gen.camera import get_sensor
from saf_gen.stack.capture import Capture
from saf_gen.stack.recapture import Recapture

pytestmark = pytest.mark.slow

QUIET = dict.fromkeys(("mismatch", "bandwidth", "refractory", "leak", "shot", "hot", "readout"), False)


@pytest.fixture(scope="module")
def dataset(captured_dataset):
    return captured_dataset


def logarithms(stream, stacks):
    """Return the logarithm of the light of each pixel in the middle of each readout, float64 (T, H, W)."""
    capture = Capture.from_stream(stream, stacks)
    source = capture.open_charge_source()
    light = [
        np.einsum("g,ghw->hw", capture.gain[t].astype(np.float64), source.charge_image(t, float(position)))
        for t, position in enumerate(stream.metadata.lens_position[: capture.frames])
    ]
    return np.log(np.array(light) * stream.readout_hz)


@pytest.mark.parametrize("name", ["plane-constant-00", "plane-lamp_only-00", "plane-dynamic-lamp_only-00"])
def test_events_add_up_to_the_change_of_the_light(dataset, tmp_path, name):
    """Without imperfections, the sum of the events so far is never a threshold away from the logarithm of the light."""
    sensor = get_sensor("davis346", kind="events", dark_e_per_s=1e-3, noise=QUIET)
    with saf_gen.open_stream(dataset / "test" / f"{name}.h5") as stream:
        Recapture(sensor).record(stream, dataset / "stacks", path=tmp_path / "events.h5")
        light = logarithms(stream, dataset / "stacks")
        hz = stream.readout_hz
    with saf_gen.open_events(tmp_path / "events.h5") as events:
        assert events.count > 1000
        assert events.truth.position == pytest.approx(stream.truth.position)
        for frame in (100, 399, 700):
            held = events.events(0.5 / hz, (frame + 0.5) / hz)
            total = np.zeros(events.shape[1:])
            np.add.at(total, (held.y, held.x), 0.2 * np.where(held.p, 1.0, -1.0))
            assert np.abs(light[frame] - light[0] - total).max() < 0.2 + 0.02


def test_the_command_records_resumes_and_repairs(dataset, tmp_path, call):
    target = tmp_path / "events"
    arguments = ("recapture", dataset, "--sensor", "davis346", "--out", target)
    code, output, _ = call(*arguments, "--sequence", "plane-constant-00")
    assert code == 0
    assert "1 sequence recorded with davis346" in output
    path = target / "test/plane-constant-00.h5"
    made = path.read_bytes()
    code, output, _ = call(*arguments)
    assert code == 0
    assert "3 sequences recorded with davis346, 1 kept" in output
    assert path.read_bytes() == made
    with saf_gen.open_events(path) as events:
        digest = events.content_sha256
        assert yaml.safe_load(events.metadata.provenance["event_sensor"])["name"] == "davis346"
    damaged = bytearray(made)
    damaged[len(made) // 3] ^= 0xFF
    path.write_bytes(damaged)
    code, output, error = call(*arguments)
    assert (code, "1 sequence recorded" in output) == (0, True), error
    with saf_gen.open_events(path) as events:
        assert events.content_sha256 == digest
    code, output, _ = call("inspect", path)
    assert code == 0
    assert "events in 0.04 s" in output


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--sensor", "davis"), "did you mean 'davis346'?"),
        (("--split", "tst"), "did you mean 'test'?"),
        (("--sequence", "plane-constant-01"), "did you mean 'plane-constant-00'?"),
        (("--sensor", "nothing.yaml"), "nothing.yaml"),
    ],
)
def test_what_is_wrong_is_refused_before_anything_is_written(dataset, tmp_path, call, options, words):
    code, _, error = call("recapture", dataset, "--out", tmp_path / "events", *options)
    assert code == 2
    assert words in error
    assert not (tmp_path / "events").exists()


def test_a_stream_in_the_way_is_not_overwritten(dataset, tmp_path, call):
    path = tmp_path / "events/test/plane-constant-00.h5"
    saf_gen.write_stream(path, np.zeros((16, 4, 4), np.uint8))
    before = path.read_bytes()
    code, _, error = call("recapture", dataset, "--out", tmp_path / "events")
    assert code == 2
    assert "saf-gen recapture" in error
    assert path.read_bytes() == before


def test_a_stream_without_its_stacks_is_named(dataset, tmp_path):
    sensor = get_sensor("evk4", kind="events")
    with saf_gen.open_stream(dataset / "test/plane-constant-00.h5") as stream:
        refusal(Recapture(sensor).record, stream, tmp_path, path=tmp_path / "events.h5")
    assert not (tmp_path / "events.h5").exists()


def test_events_are_viewed_by_their_counts(dataset, tmp_path, call, readable_figures):
    arguments = ("--sensor", "davis346", "--out", tmp_path, "--sequence", "plane-constant-00")
    assert call("recapture", dataset, *arguments)[0] == 0
    path = tmp_path / "test" / "plane-constant-00.h5"
    code, output, error = call("view", path, "--out", tmp_path / "view.png")
    assert (code, "6 pictures of 80 frames each" in output) == (0, True), error
    assert call("view", path, "--out", tmp_path / "view.html")[0] == 0
    assert "events per readout" in (tmp_path / "view.html").read_text()
    code, _, error = call("view", path, "--as", "spikes", "--out", tmp_path / "none.png")
    assert (code, "of a recording of events; allowed: tfp" in error) == (2, True)


def test_events_are_judged_on_the_recorded_track(dataset, tmp_path, call):
    target = tmp_path / "events"
    code, output, _ = call("recapture", dataset, "--out", target, "--sequence", "plane-constant-00")
    assert code == 0
    assert "next: saf-gen evaluate" in output
    assert call("verify", target)[0] == 0
    code, _, error = call("evaluate", target, "--method", "er_count+argmax", "--out", tmp_path / "judged")
    assert code == 0, error
    judged = json.loads((tmp_path / "judged" / "records.jsonl").read_text().splitlines()[0])
    assert judged["sensor"] == "davis346"
    assert 0 <= judged["position"] <= 1
    code, output, error = call("evaluate", target, "--out", tmp_path / "defaults")
    assert code == 0, error
    assert "left out, because these recordings hold events: " in output + error
    for options, words in (
        (("--method", "sd_debiased+argmax"), "corrects for the noise of spikes"),
        (("--method", "sd_tfi+argmax"), "needs intervals between spikes"),
        (("--method", "change_rate+valley"), "makes events of spikes"),
    ):
        code, _, error = call("evaluate", target, *options, "--out", tmp_path / "none")
        assert (code, words in error) == (2, True), error
        assert not (tmp_path / "none").exists()
