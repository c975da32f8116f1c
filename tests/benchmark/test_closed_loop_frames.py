"""The closed loop of a frame camera: its frames along a commanded path, its clock, and what it refuses."""

import json
from dataclasses import replace

import h5py
import numpy as np
import pytest
from refusals import refusal

import saf_gen
from saf_gen.benchmark.judgement import judge
from saf_gen.benchmark.method_spec import parse_method
from saf_gen.benchmark.tracks.closed_loop import ClosedLoopSequence
from saf_gen.benchmark.tracks.closed_loop_run import run_closed_loop, start_camera
from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol
from saf_gen.benchmark.tracks.tasks import SequenceTask
from saf_gen.benchmark.view.clock import LENS_HZ, clock_of
from saf_gen.camera import get_sensor
from saf_gen.optics.actuators import get_actuator
from saf_gen.stack.light import SceneLight
from saf_gen.stack.recapture import Recapture
from saf_gen.stream.frame_file import open_frames

pytestmark = pytest.mark.slow

STILL, MOVING = ("plane-constant-00", "plane-lamp_only-00"), "plane-dynamic-lamp_only-00"
HZ = 640.0
FAST = get_actuator(
    "voice_coil", speed=1e4, acceleration=1e9, resonance_hz=1e5, damping=1.0, backlash=0, step=0, place_rms=0,
    position_noise_rms=0, latency_s=0, reads="lens",
)  # fmt: skip


def record(dataset, folder, name, **changes):
    """Record a sequence into a dataset folder of its own, and return its task."""
    path = folder / "test" / f"{name}.h5"
    path.parent.mkdir(parents=True, exist_ok=True)
    if not (folder / "stacks").exists():
        (folder / "stacks").symlink_to(dataset / "stacks", target_is_directory=True)
    sensor = get_sensor("imx273", kind="frames", **{"exposure_s": 4e-4} | changes)
    with saf_gen.open_stream(dataset / "test" / f"{name}.h5") as stream:
        Recapture(sensor, chosen=False).record(stream, dataset / "stacks", path=path)
    return SequenceTask(name, "test", "plane", None, path, None)


def sequence(task):
    with open_frames(task.path) as frames:
        return ClosedLoopSequence.from_stream(task, frames, region="frame")


@pytest.mark.parametrize("name", STILL)
def test_a_lens_on_the_recorded_path_gives_the_recorded_frames(captured_dataset, tmp_path, name):
    """But for the rounding of a float32 charge, which turns a few draws of the noise."""
    task = record(captured_dataset, tmp_path, name)
    running = sequence(task)
    captured, clock = running.make_captured(), clock_of(running.capture)
    with saf_gen.open_stream(captured_dataset / "test" / f"{name}.h5") as spikes, open_frames(task.path) as recorded:
        readouts = (np.arange(recorded.shape[0] * clock.steps) + 0.5) / clock.lens_hz * spikes.readout_hz - 0.5
        path = np.interp(readouts, np.arange(spikes.shape[0]), spikes.focus_position.astype(float))
        captured.encode_until(20, path)
        for frame in (0, 7, 19):
            wanted, found = recorded.counts(frame, frame + 1).astype(int), captured.window(frame, frame + 1).astype(int)
            assert (wanted == found).mean() > 0.98
            assert np.abs(wanted.mean() - found.mean()) < 1e-3 * wanted.mean()


def test_frames_before_a_turn_of_the_lens_are_kept_and_all_others_exposed_anew(captured_dataset, tmp_path):
    running = sequence(record(captured_dataset, tmp_path, STILL[0]))
    shared, alone = running.make_captured(), running.make_captured()
    steps = clock_of(running.capture).steps
    there, back = np.linspace(0, 1, 20 * steps), np.linspace(0, 1, 20 * steps)
    back[8 * steps :] = back[8 * steps - 1]
    shared.encode_until(20, there)
    kept = shared.window(0, 8)
    shared.encode_until(12, back)
    alone.encode_until(12, back)
    np.testing.assert_array_equal(shared.window(0, 8), kept)
    np.testing.assert_array_equal(shared.window(8, 12), alone.window(8, 12))
    shared.encode_until(20, there)  # the later frames of the first path were not kept
    alone.encode_until(20, there)
    np.testing.assert_array_equal(shared.window(8, 20), alone.window(8, 20))


def test_frames_go_on_after_a_stack_that_could_not_be_read(captured_dataset, tmp_path):
    running = sequence(record(captured_dataset, tmp_path, STILL[0]))

    class Torn(SceneLight):
        reads = 0

        def charge(self, span, positions):
            Torn.reads += 1
            if Torn.reads == 7:
                raise OSError(5, "Input/output error")
            return super().charge(span, positions)

    light = running.light
    torn = replace(running, light=Torn(light.source, light.gain, light.lamps)).make_captured()
    whole = running.make_captured()
    path = np.linspace(0, 1, 20 * clock_of(running.capture).steps)
    with pytest.raises(OSError, match="Input/output"):
        torn.encode_until(20, path)
    for captured in (torn, whole):
        captured.encode_until(20, path)
    np.testing.assert_array_equal(torn.window(9, 12), whole.window(9, 12))


def test_the_clock_of_a_frame_camera_follows_the_lens_within_a_frame(captured_dataset, tmp_path):
    running = sequence(record(captured_dataset, tmp_path, STILL[0]))
    clock = clock_of(running.capture)
    assert (clock.readout_hz, clock.packet, clock.rest_check) == (HZ, 1, 1)
    assert clock.lens_hz >= LENS_HZ
    assert (clock.moment + 0.5) / clock.lens_hz == pytest.approx(2e-4, abs=1 / clock.lens_hz)  # amid the exposure
    camera = start_camera(running.make_captured(), None, protocol=ClosedLoopProtocol(FAST), start=0.25)
    camera.move(0.75)
    camera.wait(3)
    assert camera.now == 3
    assert camera.path[:3] == pytest.approx([0.75] * 3, abs=1e-3)
    assert camera.position(2) == pytest.approx(0.75, abs=1e-3)


def test_a_search_finds_the_focus_in_frames(captured_dataset, tmp_path):
    running = sequence(record(captured_dataset, tmp_path, STILL[0]))
    protocol = ClosedLoopProtocol(FAST)
    for method in ("tenengrad+argmax:window=1", "tenengrad+golden_section:dt=1"):
        run = run_closed_loop(running.make_captured(), parse_method(method), protocol=protocol)
        assert run.problem == "", method
        found = judge(run, running.capture.truth, end_s=lambda frames: frames / HZ)
        assert abs(found.error_dof) < 2, method
        assert found.time_to_focus_s <= running.capture.frames / HZ


def test_the_command_judges_still_scenes_and_names_those_that_move(captured_dataset, tmp_path, call):
    target = tmp_path / "frames"
    assert call("recapture", captured_dataset, "--sensor", "imx273", "--out", target)[0] == 0
    arguments = ("--track", "closed_loop", "--method", "sd+hill_climb:dt=1", "--out", tmp_path / "judged")
    code, _, error = call("evaluate", target, *arguments)
    assert code == 1
    assert "frames of a moving scene cannot be captured again" in error
    records = [json.loads(line) for line in (tmp_path / "judged" / "records.jsonl").read_text().splitlines()]
    assert {record["sequence"] for record in records} == set(STILL)
    assert all(record["sensor"] == "imx273" for record in records)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"shutter": "rolling", "row_s": 5e-5}, "ms after a frame begins"),
        ({"shutter": "rolling", "row_s": 3.2e-5}, "ms after a frame begins"),
        ({"exposure_s": 1e-3, "shutter": "rolling", "row_s": 2e-5}, "ms after a frame begins"),
    ],
)
def test_rows_that_are_exposed_when_the_next_frame_begins_are_refused(captured_dataset, tmp_path, changes, words):
    running = sequence(record(captured_dataset, tmp_path, STILL[0], **changes))
    assert words in str(refusal(clock_of, running.capture))


def test_a_file_that_does_not_say_how_long_its_light_lasts_is_refused(captured_dataset, tmp_path):
    task = record(captured_dataset, tmp_path, STILL[0])
    with h5py.File(task.path, "r+") as file:
        del file["provenance/light_s"]
    assert "record it again" in str(refusal(sequence, task))
