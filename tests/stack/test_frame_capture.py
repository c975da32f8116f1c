"""Frames of a sequence: the light of an exposure, at rest and moving, with both shutters, and the command."""

import json

import h5py
import numpy as np
import pytest
import yaml
from refusals import refusal

import saf_gen
from saf_gen.camera import get_sensor, parse_sensor
from saf_gen.stack.capture import Capture
from saf_gen.stack.light import lamp_integrals
from saf_gen.stack.recapture import Recapture
from saf_gen.stream.recordings import open_recording

pytestmark = pytest.mark.slow

NAMES = ["plane-constant-00", "plane-lamp_only-00", "plane-dynamic-lamp_only-00"]
QUIET = {"shot": False, "read": False, "dark": False, "response": False}
HZ, EXPOSURE_S = 500.0, 0.0008


@pytest.fixture(scope="module")
def dataset(captured_dataset):
    return captured_dataset


def record(dataset, name, path, *, chosen=False, **changes):
    """Record frames, and return the sensor as it was exposed."""
    fields = {"noise": QUIET, "readout_hz": HZ, "exposure_s": EXPOSURE_S, "bits": 16, "full_well_e": 1e6}
    sensor = get_sensor("imx273", kind="frames", **fields | changes)
    with saf_gen.open_stream(dataset / "test" / f"{name}.h5") as stream:
        Recapture(sensor, chosen).record(stream, dataset / "stacks", path=path)
    with saf_gen.open_frames(path) as held:
        return parse_sensor(held.metadata.provenance["sensor"], "", kind="frames")


def electrons(dataset, name, begin_s, *, steps=2000):
    """Return the electrons of an exposure, (H, W), as a plain sum over 2,000 moments: a slow twin."""
    with saf_gen.open_stream(dataset / "test" / f"{name}.h5") as stream:
        capture = Capture.from_stream(stream, dataset / "stacks")
        source = capture.open_charge_source()
        groups = capture.plane_source.time_stack.specs[0].groups
        duration_s, texts = len(capture.gain) / stream.readout_hz, stream.metadata.provenance
        integrals = lamp_integrals(texts, groups, duration_s=duration_s, where=name)
        edges = begin_s + EXPOSURE_S * np.linspace(0, 1, steps + 1)
        light = np.stack([np.diff(integral(edges)) for integral in integrals], axis=1)
        lens, hz = stream.metadata.lens_position.astype(float), stream.readout_hz
        total = np.zeros(stream.shape[1:])
        for moment, gains in zip((edges[1:] + edges[:-1]) / 2, light, strict=True):
            at = moment * hz - 0.5
            charge = source.charge_image(at, float(np.interp(at, np.arange(len(lens)), lens)))
            total += np.einsum("g,ghw->hw", gains, charge.astype(float)) * hz
    return total


@pytest.mark.parametrize("name", NAMES)
def test_a_frame_holds_the_light_of_its_exposure(dataset, tmp_path, name):
    """To a level, and 0.1 % for the steps of the lens; exposures of moving scenes here lie between two slices."""
    exposed = record(dataset, name, tmp_path / "frames.h5")
    with open_recording(tmp_path / "frames.h5") as held:
        assert held.shape[0] == 20
        held.verify()
        for frame in (0, 7, 19):
            wanted = electrons(dataset, name, frame / HZ) / exposed.electrons_per_level
            np.testing.assert_allclose(held.counts(frame, frame + 1), wanted, rtol=1e-3, atol=0.6)


def test_rows_of_a_rolling_shutter_are_exposed_one_after_the_other(dataset, tmp_path):
    row_s = 1e-5
    exposed = record(dataset, NAMES[1], tmp_path / "frames.h5", shutter="rolling", row_s=row_s)
    with open_recording(tmp_path / "frames.h5") as held:
        seen = held.counts(9, 10)
        for row in (0, 17, 39):
            wanted = electrons(dataset, NAMES[1], 9 / HZ + row * row_s)[row] / exposed.electrons_per_level
            np.testing.assert_allclose(seen[row], wanted, rtol=1e-3, atol=0.6)
        late = electrons(dataset, NAMES[1], 9 / HZ)[39] / exposed.electrons_per_level
        assert np.abs(seen[39] / late - 1).max() > 5e-3  # so that a skew that is left out would be seen


def test_in_rising_light_the_lower_rows_of_a_rolling_shutter_are_brighter(dataset, tmp_path):
    record(dataset, NAMES[1], tmp_path / "global.h5")
    record(dataset, NAMES[1], tmp_path / "rolling.h5", shutter="rolling", row_s=1e-5)
    with open_recording(tmp_path / "global.h5") as all_at_once, open_recording(tmp_path / "rolling.h5") as rolling:
        ratio = rolling.counts(5, 12).sum(axis=1) / all_at_once.counts(5, 12).sum(axis=1)
    assert ratio[0] == pytest.approx(1, abs=1e-3)
    assert ratio[-8:].mean() > ratio[:8].mean() + 2e-3


def test_the_truth_is_that_of_the_middle_of_each_exposure(dataset, tmp_path):
    record(dataset, NAMES[0], tmp_path / "frames.h5")
    with (
        saf_gen.open_stream(dataset / "test" / f"{NAMES[0]}.h5") as spikes,
        saf_gen.open_frames(tmp_path / "frames.h5") as held,
    ):
        moment = (spikes.truth.frame + 0.5) / spikes.readout_hz
        assert (held.truth.frame / HZ) + EXPOSURE_S / 2 == pytest.approx(moment)
        middles = np.arange(held.shape[0]) / HZ + EXPOSURE_S / 2
        lens = np.interp(middles * spikes.readout_hz - 0.5, np.arange(spikes.shape[0]), spikes.focus_position)
        np.testing.assert_allclose(held.focus_position, lens, atol=1e-6)


def test_the_exposure_fills_half_of_the_well_of_the_target(dataset, tmp_path):
    record(dataset, NAMES[0], tmp_path / "frames.h5", chosen=True, full_well_e=1e5)
    with open_recording(tmp_path / "frames.h5") as held:
        best = held.counts(round(held.truth.frame), round(held.truth.frame) + 1)
        assert best[held.truth.target].mean() == pytest.approx(0.5 * (65_535 - 240), rel=0.03)


def test_windows_are_of_the_light_above_the_black_level_that_the_file_keeps(dataset, tmp_path, call):
    """What a measure that divides by the mean gives in changing light would else depend on the black level."""
    light = {}
    for black in (0, 240, 3000):
        path = tmp_path / f"{black}.h5"
        record(dataset, NAMES[1], path, black_level_dn=black, full_well_e=1e6 * (65_535 - black) / 65_535)
        with saf_gen.open_frames(path) as held:
            assert held.black_level_dn == black
            numbers, light[black] = held.frames(3, 8), held.counts(3, 8)
            assert numbers.min() >= black
            np.testing.assert_array_equal(light[black], (numbers.astype(int) - black).sum(axis=0))
        code, output, _ = call("inspect", path)
        assert (code, f"black level {black}," in " ".join(output.split())) == (0, True)
    np.testing.assert_allclose(light[240].astype(int), light[0].astype(int), atol=5)
    np.testing.assert_allclose(light[3000].astype(int), light[0].astype(int), atol=5)


def test_a_number_below_the_black_level_counts_as_no_light(dataset, tmp_path):
    dim = {"noise": QUIET | {"read": True}, "full_well_e": 1e7, "read_noise_e": 1e4, "black_level_dn": 30}
    record(dataset, NAMES[0], tmp_path / "dim.h5", exposure_s=2e-6, **dim)
    with saf_gen.open_frames(tmp_path / "dim.h5") as held:
        numbers = held.frames(0, 20).astype(int)
        assert (numbers < 30).mean() > 0.1
        np.testing.assert_array_equal(held.counts(0, 20), np.maximum(numbers - 30, 0).sum(axis=0))
        parts = sum(held.counts(first, first + 5).astype(int) for first in range(0, 20, 5))
        np.testing.assert_array_equal(parts, held.counts(0, 20))


def test_the_command_makes_a_dataset_that_is_judged_resumes_and_repairs(dataset, tmp_path, call):
    target = tmp_path / "frames"
    arguments = ("recapture", dataset, "--sensor", "imx273", "--out", target)
    code, output, _ = call(*arguments, "--sequence", NAMES[0])
    assert code == 0
    assert "next: saf-gen evaluate" in output
    path = target / f"test/{NAMES[0]}.h5"
    made = path.read_bytes()
    code, output, _ = call(*arguments)
    assert (code, "3 sequences recorded with imx273, 1 kept" in output) == (0, True)
    with h5py.File(path, "r") as file:
        at = file["frames"].id.get_chunk_info(3).byte_offset
    damaged = bytearray(made)
    damaged[at + 100] ^= 0xFF
    path.write_bytes(damaged)
    code, output, error = call(*arguments)
    assert (code, "1 sequence recorded" in output) == (0, True), error
    with saf_gen.open_frames(path) as held:
        held.verify()
    assert call("verify", target)[0] == 0
    code, output, _ = call("inspect", path)
    assert (code, "at 640 Hz" in output) == (0, True)
    code, _, error = call("evaluate", target, "--method", "sd+argmax:window=1", "--out", tmp_path / "judged")
    assert code == 0, error
    judged = json.loads((tmp_path / "judged" / "records.jsonl").read_text().splitlines()[0])
    assert judged["sensor"] == "imx273"
    for options, words in (
        ((), "--method sd+argmax:window=3"),
        (("--method", "sd_tfi+argmax:window=3"), "needs intervals between spikes"),
        (("--method", "sd_debiased+argmax:window=3"), "corrects for the noise of spikes"),
    ):
        code, _, error = call("evaluate", target, *options, "--out", tmp_path / "none")
        assert (code, words in error) == (2, True), error
        assert not (tmp_path / "none").exists()


def test_frames_are_viewed_one_by_one(dataset, tmp_path, call, readable_figures):
    record(dataset, NAMES[0], tmp_path / "frames.h5")
    code, output, error = call("view", tmp_path / "frames.h5", "--measure", "sd", "--out", tmp_path / "view.png")
    assert (code, output) == (0, f"6 pictures of 1 frame each in {tmp_path / 'view.png'}\n"), error
    assert call("view", tmp_path / "frames.h5", "--window", "2", "--out", tmp_path / "view.html")[0] == 0
    assert "levels per frame" in (tmp_path / "view.html").read_text()
    for kind in ("tfi", "spikes"):
        code, _, error = call("view", tmp_path / "frames.h5", "--as", kind, "--out", tmp_path / "none.png")
        assert (code, "of a recording of frames" in error, len(error.splitlines())) == (2, True, 1)
    assert not (tmp_path / "none.png").exists()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda file: file.attrs.update(format="another"), "format is 'another'"),
        (lambda file: file.attrs.update(layout=1), "layout version is"),
        (lambda file: file.attrs.pop("black_level_dn"), "black level"),
        (lambda file: file.attrs.update(black_level_dn=-1), "black level"),
        (lambda file: file.attrs.update(black_level_dn=0.5), "black level"),
        (lambda file: file.attrs.pop("readout_hz"), "frames per second"),
        (lambda file: file.attrs.update(readout_hz=-1.0), "frames per second"),
        (lambda file: file.create_dataset("more", data=1), "more"),
        (lambda file: file.pop("frames"), "holds no frames of ours"),
        (lambda file: (file.pop("frames"), file.create_dataset("frames", data=np.zeros((2, 3), "u2"))), "/frames is"),
        (
            lambda file: (file.pop("frames"), file.create_dataset("frames", (20, 40, 64), "u2", chunks=(1, 40, 64))),
            "end",
        ),
    ],
)
def test_what_is_no_file_of_frames_is_refused_in_one_line(dataset, tmp_path, change, words):
    record(dataset, NAMES[0], tmp_path / "frames.h5")
    with h5py.File(tmp_path / "frames.h5", "r+") as file:
        change(file)
    assert words in str(refusal(saf_gen.open_frames, tmp_path / "frames.h5"))


def test_a_changed_number_is_found(dataset, tmp_path):
    record(dataset, NAMES[0], tmp_path / "frames.h5")
    with h5py.File(tmp_path / "frames.h5", "r+") as file:
        file["frames"][3, 5, 7] ^= 1
    with saf_gen.open_frames(tmp_path / "frames.h5") as held:
        refusal(held.verify)
    with h5py.File(tmp_path / "frames.h5", "r+") as file:
        file["frames"][3, 5, 7] ^= 1
        file.attrs["black_level_dn"] = 239
    with saf_gen.open_frames(tmp_path / "frames.h5") as held:
        refusal(held.verify)
    assert "saf_gen.open_frames" in str(refusal(saf_gen.open_stream, tmp_path / "frames.h5"))


def test_a_sequence_that_is_shorter_than_a_frame_is_refused(dataset, tmp_path):
    with saf_gen.open_stream(dataset / "test" / f"{NAMES[0]}.h5") as stream:
        sensor = get_sensor("imx273", kind="frames", readout_hz=2, exposure_s=0.3)
        record, path = Recapture(sensor, chosen=False).record, tmp_path / "frames.h5"
        assert "at least a frame" in str(refusal(record, stream, dataset / "stacks", path=path))
    assert not (tmp_path / "frames.h5").exists()


def test_a_users_file_says_its_kind(dataset, tmp_path, call):
    fields = get_sensor("imx273", kind="frames").as_dict() | {"kind": "frames", "name": "mine", "sources": ["me"]}
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(fields))
    arguments = ("recapture", dataset, "--sensor", tmp_path / "mine.yaml", "--out", tmp_path / "out")
    assert call(*arguments, "--sequence", NAMES[0])[0] == 0
    code, _, error = call(*arguments, "--sequence", NAMES[0], "--exposure-us", "2000")
    assert (code, "exposure_s is 0.002" in error) == (2, True)
