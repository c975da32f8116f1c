"""The protocol of the closed loop: frames of budget and sweep, limits of slow actuators, and its description."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from refusals import refusal

from saf_gen.benchmark.evaluate import evaluate
from saf_gen.benchmark.records import read_records
from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol
from saf_gen.benchmark.view.clock import Clock
from saf_gen.camera import get_sensor
from saf_gen.errors import BadInput
from saf_gen.optics.actuators import ActuatedLens, actuator_names, get_actuator
from saf_gen.stack.capture import Capture
from saf_gen.stream.metadata import Truth

STEPPER = 5151  # frames of a sweep: 1 ms of latency, 250 ms from end to end, 6.5 ms for the lens to follow
STEPPER_RESTS = 3040  # frames from the middle until it rests at an end


def recorded(frames):
    """Return a capture of this number of frames at 20 kHz, of a scene that moves."""
    gain, stacks = np.ones((frames, 1), np.float32), SimpleNamespace(time_stack=SimpleNamespace(is_moving=True))
    return Capture(stacks, get_sensor("vidar_400x250"), gain, 1.0, 1, 1, Truth(), len(gain))


@pytest.fixture
def recording(captured_dataset):
    """A stream of 40 ms in a dataset."""
    return captured_dataset / "test" / "plane-constant-00.h5"


@pytest.mark.parametrize(
    ("name", "frames", "times", "expected"),
    [
        ("voice_coil", 4000, {}, (4000, 2000)),
        ("voice_coil", 800, {}, (800, 200)),  # 600 until it rests
        ("voice_coil", 4000, {"budget_s": 0.1, "sweep_s": 0.07}, (2000, 1400)),
        ("stepper", 9000, {}, (9000, STEPPER)),
        ("stepper", STEPPER_RESTS + STEPPER, {}, (STEPPER_RESTS + STEPPER, STEPPER)),
        ("hand", 55_000, {}, (55_000, 29_785)),
    ],
)
def test_the_usual_sweep_is_half_the_budget_or_what_the_drive_needs(name, frames, times, expected):
    protocol, capture = ClosedLoopProtocol(get_actuator(name), **times), recorded(frames)
    protocol.check_sweep(capture)
    assert protocol.count_frames(capture) == expected
    budget, sweep = (f"{frames / 20:g}" for frames in expected)
    assert protocol.describe(capture) == f"{name}, {budget} ms, sweep {sweep} ms"


def test_a_drive_needs_its_latency_the_whole_travel_and_the_lens_that_follows():
    drive = get_actuator("hand")
    _, sweep = ClosedLoopProtocol(drive).count_frames(recorded(60_000))
    assert sweep == 30_000
    _, sweep = ClosedLoopProtocol(drive).count_frames(recorded(55_000))
    follows = (math.pi + 6 * drive.damping) / (2 * math.pi * drive.resonance_hz)
    seconds = drive.latency_s + drive.speed**-1 + drive.speed / drive.acceleration + follows
    assert sweep == math.ceil(seconds * 20_000)


def shortest_recording(protocol):
    """Return the smallest number of frames in which a sweep fits."""
    too_short, fits = 16, 1 << 20
    protocol.check_sweep(recorded(fits))
    while fits - too_short > 1:
        middle = (too_short + fits) // 2
        try:
            protocol.check_sweep(recorded(middle))
        except BadInput:
            too_short = middle
        else:
            fits = middle
    return fits


@pytest.mark.parametrize("name", sorted(set(actuator_names()) - {"ideal"}))
def test_the_shortest_sweep_comes_to_the_far_end_from_wherever_the_lens_was(name):
    """The middle of the travel is farthest from the ends. Half the play is out of reach."""
    drive = get_actuator(name, place_rms=0)
    protocol = ClosedLoopProtocol(drive)
    frames = shortest_recording(protocol)
    _, sweep = protocol.count_frames(recorded(frames))
    before = frames - sweep
    for start in (0.0, 0.5):
        lens = ActuatedLens(drive, start=start, readout_hz=20_000, seed=1)
        lens.command(0.0)
        lens.run(before)
        assert lens.is_settled(1e-3)
        command_frames = drive.command_sweep_s(sweep / 20_000) * 20_000
        for frame in range(0, sweep, 8):
            lens.command(min((frame + 8) / command_frames, 1.0))
            positions = lens.run(8)
        assert positions[-1] > 0.97 - drive.backlash / 2


@pytest.mark.parametrize(
    ("name", "frames", "times", "problem", "allowed"),
    [
        ("stepper", 4000, {}, "stepper needs 409.55 ms for a sweep: 152 ", ["200 ms"]),
        ("stepper", 20_000, {"sweep_s": 0.1}, "100 ms with the actuator stepper", ["257.55 ms", "848 ms"]),
        ("stepper", STEPPER_RESTS + STEPPER - 1, {}, "stepper needs 409.55 ms", ["409.5 ms"]),
        ("stepper", 20_000, {"sweep_s": 0.2575}, "257.5 ms with the actuator stepper", ["257.55 ms"]),
        ("hand", 20_000, {"sweep_s": 0.5}, "hand needs 2520.75 ms", ["1000 ms"]),
        ("voice_coil", 16, {}, "voice_coil needs 36.2 ms", ["0.8 ms"]),
    ],
)
def test_a_sweep_that_shows_a_part_of_the_travel_is_refused(name, frames, times, problem, allowed):
    protocol, capture = ClosedLoopProtocol(get_actuator(name), **times), recorded(frames)
    protocol.count_frames(capture)  # it is allowed for lens-commanding methods
    error = refusal(protocol.check_sweep, capture)
    assert problem in error.problem
    assert all(time in error.allowed for time in allowed)
    assert ("--actuator" in error.hint) == (frames > 16)  # in 0.8 ms nothing sweeps
    assert protocol.describe(capture).endswith("no sweep")


def test_what_gives_a_method_more_time_is_named():
    """A moving scene ends with its recording, or with the slices of all its positions; a resting one does not end."""
    stepper, moving = ClosedLoopProtocol(get_actuator("stepper"), budget_s=0.5), recorded(4000)
    in_time = "or take an --actuator that sweeps in time (ideal, liquid_lens, liquid_lens_warm, piezo, voice_coil, "
    too_long = refusal(stepper.count_frames, moving)
    assert too_long.hint.startswith(f"state camera: {{frames: 10000}} in the recipe, {in_time}")
    too_long = refusal(stepper.count_frames, replace(moving, gain=np.ones((10_000, 1), np.float32)))
    assert too_long.hint.startswith("state render: {whole_slices: 0.5} in the recipe, ")
    at_rest = SimpleNamespace(time_stack=SimpleNamespace(is_moving=False, specs=[SimpleNamespace(groups=("lamp",))]))
    resting = replace(moving, plane_source=at_rest, light_s=0.2)
    assert stepper.count_frames(resting.lasting(stepper.longest_frames(resting)))[0] == 10_000
    slow = refusal(ClosedLoopProtocol(get_actuator("stepper")).check_sweep, resting)
    assert slow.hint.startswith(f"choose a --budget of 409.55 or more, {in_time}")


@pytest.mark.parametrize(
    ("name", "frames", "budget"),
    [("voice_coil", 800, 800), ("voice_coil", 640, 20_000), ("stepper", 4000, 20_000), ("hand", 4000, 100_830)],
)
def test_a_recording_too_short_for_a_sweep_is_followed_by_the_time_for_one(name, frames, budget):
    assert ClosedLoopProtocol(get_actuator(name)).usual_frames(frames, Clock(20_000.0)) == budget


@pytest.mark.parametrize("value", [1e308, 86_401.0, math.nan, 0.0, -1.0])
@pytest.mark.parametrize("name", ["budget", "sweep"])
def test_times_that_no_recording_could_keep_are_refused(name, value):
    error = refusal(ClosedLoopProtocol, get_actuator("ideal"), **{f"{name}_s": value})
    assert error.problem == f"the {name} is {value:g} s"
    assert "at most 86400" in error.allowed
    ClosedLoopProtocol(get_actuator("ideal"), **{f"{name}_s": 86_400})


def test_records_distinguish_a_users_drive_from_the_preset_of_its_name():
    own, other = (ClosedLoopProtocol(get_actuator("voice_coil", damping=d)).describe(recorded(4000)) for d in (1, 0.9))
    assert own.startswith("voice_coil (own, ")
    assert own.endswith("), 200 ms, sweep 100 ms")
    assert own != other


def test_a_slow_drive_runs_methods_that_command_it_and_no_sweep(recording, tmp_path, call):
    """In recordings of 40 ms sweeps are refused before any method runs, and nothing is written."""
    loop = ["evaluate", recording, "--track", "closed_loop", "--actuator", "stepper"]
    loop += ["--budget", 40, "--method", "sd+golden_section", "--out", tmp_path / "out"]
    code, _, message = call(*loop, "--method", "sd+argmax")
    assert code == 2
    assert "the actuator stepper needs 409.55 ms for a sweep" in message
    assert not (tmp_path / "out").exists()
    assert call(*loop)[0] == 0
    assert {r.what.terms for r in read_records(tmp_path / "out")} == {"stepper, 40 ms, no sweep, 1e+09 op/s"}


def test_a_drive_too_slow_for_half_the_budget_sweeps_from_end_to_end(recording):
    """A sweep takes 25 of 40 ms, and covers the entire travel."""
    slow = ClosedLoopProtocol(get_actuator("ideal", speed=1 / 0.025))
    result = evaluate(recording, methods=["sd+argmax"], protocol=slow)
    (record,), (path,) = result.records, result.lens_paths
    assert record.what.terms.endswith(", 40 ms, sweep 25.05 ms")
    assert record.judgement.status == "answered"
    seen = path.position[path.seconds < record.judgement.frames_seen / 20_000]
    assert seen.min() < 0.01
    assert seen.max() > 0.99
