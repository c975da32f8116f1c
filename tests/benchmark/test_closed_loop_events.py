"""The closed loop of an event camera: its events along a commanded path, its clock, and what it refuses."""

import json
from dataclasses import replace
from itertools import pairwise

import h5py
import numpy as np
import pytest
import yaml
from refusals import refusal

import saf_gen
from saf_gen.benchmark.judgement import judge
from saf_gen.benchmark.method_spec import parse_method
from saf_gen.benchmark.tracks.closed_loop import ClosedLoopSequence
from saf_gen.benchmark.tracks.closed_loop_run import run_closed_loop, start_camera
from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol
from saf_gen.benchmark.tracks.tasks import SequenceTask
from saf_gen.benchmark.view.clock import clock_of
from saf_gen.camera import get_sensor
from saf_gen.camera.camera import LensCourse
from saf_gen.optics.actuators import get_actuator
from saf_gen.stack.light import record
from saf_gen.stack.recapture import Recapture
from saf_gen.stream.recordings import open_recording

pytestmark = pytest.mark.slow

STILL, MOVING = ("plane-constant-00", "plane-lamp_only-00"), "plane-dynamic-lamp_only-00"
HZ = 20_000.0
FAST = get_actuator(
    "voice_coil", speed=1e4, acceleration=1e9, resonance_hz=1e5, damping=1.0, backlash=0, step=0, place_rms=0,
    position_noise_rms=0, latency_s=0, reads="lens",
)  # fmt: skip


@pytest.fixture(scope="module")
def recorded(captured_dataset, tmp_path_factory):
    """The tasks of a dataset of events, by name."""
    folder, tasks = tmp_path_factory.mktemp("events"), {}
    (folder / "test").mkdir()
    (folder / "stacks").symlink_to(captured_dataset / "stacks", target_is_directory=True)
    for name in (*STILL, MOVING):
        path = folder / "test" / f"{name}.h5"
        with saf_gen.open_stream(captured_dataset / "test" / f"{name}.h5") as stream:
            Recapture(get_sensor("davis346", kind="events")).record(stream, captured_dataset / "stacks", path=path)
        tasks[name] = SequenceTask(name, "test", "plane", None, path, None)
    return tasks


def sequence(task):
    with open_recording(task.path) as stream:
        return ClosedLoopSequence.from_stream(task, stream, region="frame")


def logged_path(task):
    with open_recording(task.path) as stream:
        return stream.focus_position.astype(np.float64)


class Pieces:
    def __init__(self, pieces):
        self.write = pieces.append


def all_events(captured):
    return tuple(np.concatenate(column) for column in zip(*captured.held.parts, strict=True))


@pytest.mark.parametrize("name", [*STILL, MOVING])
def test_a_lens_on_the_recorded_path_gives_the_recorded_events(recorded, name):
    """Cells of time are 200 µs instead of 250, so that a pixel's light is taken as even over other times.

    The photoreceptor is slower in dim light, and its slowness is that of the mean light of a cell. So a few instants
    move, and of a thousand events one or two come or stay away.
    """
    running = sequence(recorded[name])
    captured = running.make_captured()
    frames = running.capture.frames // 8 * 8
    captured.encode_until(frames, logged_path(recorded[name]))
    with open_recording(recorded[name].path) as recording:
        for first, stop in ((0, frames), (0, 100), (240, 255), (frames - 100, frames)):
            wanted, found = recording.counts(first, stop).astype(int), captured.window(first, stop).astype(int)
            assert wanted.sum() > 20
            assert np.abs(wanted - found).sum() <= 2 + 0.01 * wanted.sum()
    with saf_gen.open_events(recorded[name].path) as file:
        wanted = file.events(0, frames / HZ)
    t, pixel, rises = all_events(captured)
    apart = []
    for where in range(captured.shape[0] * captured.shape[1]):
        found, held = pixel == where, wanted.y.astype(int) * captured.shape[1] + wanted.x == where
        if found.sum() == held.sum():
            apart.append(t[found] - wanted.t[held].astype(int))
            np.testing.assert_array_equal(rises[found], wanted.p[held].astype(bool))
    apart = np.abs(np.concatenate(apart))
    assert np.mean(apart <= 1) > 0.85
    assert np.mean(apart <= 10) > 0.98


@pytest.mark.parametrize("name", [STILL[0], MOVING])
def test_events_are_those_of_the_recording_where_cells_are_cut_alike(recorded, name):
    """Bit for bit, with one course for the whole recording, as a recording has."""
    running = sequence(recorded[name])
    frames, lens = running.capture.frames // 8 * 8, LensCourse(logged_path(recorded[name]), HZ)
    events = []
    record(running.light, running.capture.start_camera(), sink=Pieces(events), lens=lens, frames=frames)
    with saf_gen.open_events(recorded[name].path) as file:
        wanted = file.events(0, file.seconds)
    for column in ("t", "x", "y", "p"):
        np.testing.assert_array_equal(
            np.concatenate([getattr(part, column) for part in events]), getattr(wanted, column)
        )


@pytest.mark.parametrize("name", [STILL[1], MOVING])
def test_events_do_not_depend_on_how_often_a_method_looks(recorded, name):
    running = sequence(recorded[name])
    at_once, in_steps = running.make_captured(), running.make_captured(threads=1)
    path = logged_path(recorded[name])
    at_once.encode_until(400, path)
    windows = []
    for first, stop in pairwise((0, 8, 16, 120, 200, 208, 400)):
        in_steps.encode_until(stop, path)
        windows.append(in_steps.polarities(first, stop))
    for wanted, found in zip(all_events(at_once), all_events(in_steps), strict=True):
        np.testing.assert_array_equal(found, wanted)
    np.testing.assert_array_equal(np.sum(windows, axis=0), at_once.polarities(0, 400))  # what has passed never changed
    np.testing.assert_array_equal(at_once.polarities(0, 400).sum(axis=0), at_once.window(0, 400))


def test_a_region_holds_the_events_that_the_whole_array_has_there(recorded):
    whole = sequence(recorded[STILL[0]])
    part = replace(whole, box=(slice(7, 31), slice(12, 51)))
    path, counts = logged_path(recorded[STILL[0]]), []
    for running in (whole, part):
        captured = running.make_captured()
        captured.encode_until(240, path)
        counts.append(captured.window(3, 237))
    np.testing.assert_array_equal(counts[0][part.box], counts[1])


def test_another_path_begins_anew_and_the_same_one_keeps_its_events(recorded):
    running = sequence(recorded[STILL[0]])
    shared, alone = running.make_captured(), running.make_captured()
    there = np.linspace(0, 1, 320)
    back = np.where(np.arange(320) < 160, there, there[159])
    shared.encode_until(320, there)
    kept = shared.held.parts
    shared.encode_until(160, back)  # as far as that, it is the same path
    assert shared.held.parts is kept
    shared.encode_until(320, back)
    assert shared.held.parts is not kept
    alone.encode_until(320, back)
    np.testing.assert_array_equal(shared.polarities(0, 320), alone.polarities(0, 320))


def test_the_clock_is_that_of_the_readouts_by_which_lens_and_truth_are_logged(recorded):
    running = sequence(recorded[STILL[0]])
    clock = clock_of(running.capture)
    assert (clock.readout_hz, clock.packet, clock.steps) == (HZ, 8, 1)
    camera = start_camera(running.make_captured(), None, protocol=ClosedLoopProtocol(FAST), start=0.25)
    camera.move(0.75)
    camera.wait(3)
    assert camera.now == 8


def test_a_lens_at_rest_sees_the_events_of_noise_alone(recorded):
    running = sequence(recorded[STILL[0]])
    captured = running.make_captured()
    captured.encode_until(800, np.full(800, 0.5))
    swept = running.make_captured()
    swept.encode_until(800, np.linspace(0, 1, 800))
    assert captured.window(0, 800).sum() < 0.1 * swept.window(0, 800).sum()


def test_a_search_finds_the_focus_in_events(recorded):
    running = sequence(recorded[STILL[0]])
    protocol = ClosedLoopProtocol(FAST)
    run = run_closed_loop(running.make_captured(), parse_method("er_count+egs_code"), protocol=protocol)
    assert run.problem == ""
    found = judge(run, running.capture.truth, end_s=lambda frames: frames / HZ)
    assert abs(found.error_dof) < 4


def test_the_command_judges_scenes_at_rest_and_moving(captured_dataset, tmp_path, call):
    target = tmp_path / "events"
    assert call("recapture", captured_dataset, "--sensor", "davis346", "--out", target)[0] == 0
    methods = ("--method", "er_count+egs_code", "--method", "er_count+argmax:window=40")
    code, output, error = call("evaluate", target, "--track", "closed_loop", *methods, "--out", tmp_path / "judged")
    assert code == 0, output + error
    records = [json.loads(line) for line in (tmp_path / "judged" / "records.jsonl").read_text().splitlines()]
    assert len({record["sequence"] for record in records}) == 4
    assert all(record["sensor"] == "davis346" for record in records)
    code, output, error = call("evaluate", target, "--track", "closed_loop", "--out", tmp_path / "defaults")
    assert code == 0, output + error
    assert "left out, because these recordings hold events: " in output + error


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, "does not say which camera recorded its events"),
        ("", "/provenance/event_sensor"),
        ("{", "/provenance/event_sensor"),
        ("[1, 2]", "/provenance/event_sensor"),
        ("{}", "/provenance/event_sensor"),
        ('{"name": "davis346"}', "/provenance/event_sensor"),
        ("threshold_on=9", "/provenance/event_sensor"),
        ("noise=3", "/provenance/event_sensor"),
    ],
)
def test_a_file_that_does_not_say_which_camera_recorded_it_is_refused(recorded, tmp_path, text, words):
    task = recorded[STILL[0]]
    path = tmp_path / "test" / task.path.name
    path.parent.mkdir()
    (tmp_path / "stacks").symlink_to(task.path.parent.parent / "stacks", target_is_directory=True)
    path.write_bytes(task.path.read_bytes())
    with h5py.File(path, "r+") as file:
        stated = yaml.safe_load(file["provenance/event_sensor"].asstr()[()])
        del file["provenance/event_sensor"]
        if text is not None:
            key, _, value = text.partition("=")
            text = json.dumps({**stated, key: json.loads(value)}) if value else text
            file["provenance/event_sensor"] = text
    error = str(refusal(sequence, SequenceTask(task.id, "test", "plane", None, path, None)))
    assert words in error
    assert "\n" not in error
