"""The closed loop: the running camera whose lens a method moves, the protocol, failures and judgement."""

import math
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from handmade_records import BLANK
from refusals import refusal

import saf_gen
from saf_gen.benchmark import evaluate as evaluate_module
from saf_gen.benchmark.judgement import Run, count_reversals, judge
from saf_gen.benchmark.method_spec import Method
from saf_gen.benchmark.records import Record
from saf_gen.benchmark.tracks.closed_loop_run import run_closed_loop
from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol
from saf_gen.benchmark.view.captured import CapturedReadouts
from saf_gen.benchmark.view.clock import Clock
from saf_gen.benchmark.view.restricted_view import BudgetSpentError
from saf_gen.benchmark.view.running_camera import RunningCamera, SweepView
from saf_gen.errors import BadInput
from saf_gen.optics.actuators import get_actuator
from saf_gen.parts import Answer, View
from saf_gen.plugins.measures import get_measure
from saf_gen.stack.capture import Capture
from saf_gen.stack.light import SceneLight
from saf_gen.stream.metadata import Truth

IDEAL = get_actuator(
    "voice_coil", speed=1e4, acceleration=1e9, resonance_hz=1e5, damping=1.0, backlash=0, step=0, place_rms=0,
    position_noise_rms=0, latency_s=0, reads="lens",
)  # fmt: skip
WHOLE = (slice(0, 40), slice(0, 64))


@pytest.fixture(scope="module")
def dataset(captured_dataset):
    return captured_dataset


@pytest.fixture
def capture(dataset):
    with saf_gen.open_stream(dataset / "test" / "plane-constant-00.h5") as stream:
        yield Capture.from_stream(stream, dataset / "stacks")


def start(capture, *, at=0.0, budget=800, actuator=IDEAL):
    light = capture.open_light(capture.rows_for(WHOLE))
    return RunningCamera(
        CapturedReadouts(capture, light, region=WHOLE), get_measure("sd"), actuator=actuator,
        start=at, seed=1, budget=budget, clock=Clock(capture.sensor.readout_hz),
    )  # fmt: skip


class Commands:
    """A lens-commanding search that calls a function."""

    commands = True

    def __init__(self, function):
        self.function = function

    def __call__(self, view):
        return self.function(view)


def go_to(position, *, looks=3):
    """Return a search that looks some times, and sends the lens to a position."""

    def search(view):
        for _ in range(looks):
            view.score(view.now, view.now + 40)
        return Answer(position=position)

    return Commands(search)


def at_frame(frame):
    """Return an estimating search that looks at the sweep up to a frame, and answers with that frame."""

    def search(view):
        view.score(0, math.ceil(frame) + 1)
        return Answer(frame)

    return search


def raises(error):
    """Return an estimating search or a measure that raises an error."""

    def part(view_or_counts):
        raise error

    return part


def method(search, measure=None):
    return Method("sd+x", measure or get_measure("sd"), search, "0" * 12)


def run(capture, search, **protocol):
    protocol = ClosedLoopProtocol(**{"actuator": IDEAL, **protocol})
    return run_method(capture, method(search), protocol=protocol)


def run_method(capture, method, *, protocol=None, light=None):
    captured = CapturedReadouts(capture, light or capture.open_light(), region=WHOLE)
    return run_closed_loop(captured, method, protocol=protocol or ClosedLoopProtocol(IDEAL))


def judged(run, truth):
    """Return the record of a run."""
    judgement = judge(run, truth, end_s=lambda frames: frames / 20_000)
    return Record(BLANK.who, replace(BLANK.what, track="closed_loop"), judgement)


def test_the_camera_sees_the_stack_at_the_position_of_the_lens(capture):
    """The SD of 320 frames at the truth equals that of a recording made there, and is smaller away from it."""
    sharp = start(capture, at=capture.truth.position).score(0, 320)
    blurred = start(capture).score(0, 320)
    captured = CapturedReadouts(capture, capture.open_light(), region=WHOLE)
    captured.encode_until(320, np.full(800, capture.truth.position))
    assert sharp == get_measure("sd")(captured.window(0, 320))
    assert blurred < 0.9 * sharp


def test_the_lens_is_on_its_way_while_the_camera_runs(capture):
    camera = start(capture, actuator=get_actuator("voice_coil"))
    assert camera.now == 0
    camera.move(1.0)
    assert camera.now == 0
    camera.score(0, 100)
    assert camera.now == 104  # a multiple of eight frames
    assert 0 < camera.path[103] < 1
    assert refusal(camera.position, 104).allowed == "0 to 103"


def test_a_search_looks_at_the_counts_of_a_running_camera_as_a_measure_does(capture):
    """The sum of the counts is the score of er_count; reading counts makes the camera run, as scoring does."""
    camera, other = start(capture), start(capture)
    picture = camera.counts(16, 100)
    assert camera.now >= 100
    assert picture.sum() == other.score(16, 100, "er_count")
    assert camera.scorer.windows == other.scorer.windows == 1
    with pytest.raises(ValueError, match="read-only"):
        picture += 1
    sweep = SweepView(start(capture), begin=0.0, end=1.0, frames=320)
    assert sweep.counts(0, 80).sum() > 0
    assert sweep.now >= 80
    assert "0 to 321" in refusal(sweep.counts, 0, 321).problem


def test_the_camera_does_not_run_longer_than_the_budget(capture):
    camera = start(capture, budget=400)
    with pytest.raises(BudgetSpentError):
        camera.score(390, 410)
    with pytest.raises(BudgetSpentError):
        camera.wait(1000)
    assert camera.now == 400


@pytest.mark.parametrize("to", [-0.1, 1.1, math.nan])
def test_the_lens_is_not_sent_out_of_its_travel(capture, to):
    assert "0 to 1" in refusal(start(capture).move, to).allowed


def test_a_search_that_commands_ends_where_it_says(capture):
    done = run(capture, go_to(0.625))
    assert done.problem == ""
    assert done.frames_seen == 120
    assert done.path[-1] == pytest.approx(0.625, abs=1e-4)


@pytest.mark.parametrize("frame", [100.0, 250.5])
def test_a_search_that_estimates_gets_a_sweep_that_stops_where_it_answers(capture, frame):
    done = run(capture, at_frame(frame), sweep_s=0.016)
    assert done.problem == ""
    moves = np.diff(done.path[: done.frames_seen])
    begin = int(np.argmax(np.abs(done.path - done.path[done.frames_seen - 1]) > 0.02))
    assert done.frames_seen < 450
    assert (np.sign(moves[begin + 60 :]) != -np.sign(moves[begin + 60 :].sum())).all()
    swept = (frame + 0.5) / 320
    assert done.path[-1] == pytest.approx(swept, abs=0.03) or done.path[-1] == pytest.approx(1 - swept, abs=0.03)


class Unprintable(Exception):
    def __str__(self):
        raise RuntimeError("and no words")


@pytest.mark.parametrize(
    ("search", "problem"),
    [
        (raises(Unprintable()), "Unprintable"),
        (go_to(0.5, looks=30), "the budget of 800 frames was spent"),
        (Commands(raises(AssertionError())), "AssertionError"),
        (Commands(raises(SystemExit(3))), "CodeStopped: its code called exit(3)"),
        (raises(GeneratorExit()), "CodeStopped: its code raised GeneratorExit"),
        (raises(BadInput("no light", where="x")), "BadInput: x: no light"),
        (raises(ValueError("a" * 400)), f"ValueError: {'a' * 287}…"),
        (lambda view: Answer(1e6), "answered frame 1000000.0, which is not in the sweep"),
        (lambda view: Answer(position=0.5), "it answers with a position, but does not command the lens; answer"),
        (go_to(math.nan), "it answers position nan; give a finite number, or None to abstain"),
        (Commands(lambda view: Answer(5.0)), "it answers with a frame, but commands the lens; answer"),
        (Commands(lambda view: None), "it answers with NoneType None; return"),
    ],
)
def test_a_broken_method_fails_with_the_reason(capture, search, problem):
    """Other errors and answers, which both tracks treat alike, are tested in test_evaluate.py."""
    done = run(capture, search)
    assert problem in done.problem
    assert len(done.problem.splitlines()) == 1
    record = judged(done, capture.truth)
    assert (record.judgement.status, record.judgement.position, record.success(2)) == ("failed", None, False)


def test_a_broken_measure_is_reported_like_a_broken_search(capture):
    done = run_method(capture, method(go_to(0.5), raises(RuntimeError("no light"))))
    assert done.problem == "RuntimeError: no light"


def test_an_interrupt_stops_the_evaluation(capture):
    with pytest.raises(KeyboardInterrupt):
        run(capture, Commands(raises(KeyboardInterrupt())))


class Nowhere:
    commands = True

    def __call__(self, view):
        return go_to(math.nan)(view)


class Sound:
    commands = True

    def __call__(self, view):
        return go_to(0.5)(view)


@pytest.mark.slow
def test_broken_methods_do_not_affect_others(dataset, register):
    """Each broken method has a failed record of each sequence; the sound one answers on all."""
    searches = {
        "nowhere": Nowhere,
        "float_": lambda view: 1234.5,
        "trace": lambda view: Answer(5, trace=None),
        "sound": Sound,
        "disk": raises(OSError("no weights")),
        "exits": raises(SystemExit(0)),
    }
    for name, search in searches.items():
        register("searches", name, search)
    methods = [f"sd+{name}" for name in searches]
    result = evaluate_module.evaluate(dataset, methods=methods, protocol=ClosedLoopProtocol(IDEAL))
    assert result.failures == ()
    assert len(result.records) == 4 * len(searches)
    grain = {record.what.scene_motion: record.what.grain_rms for record in result.records}
    assert 0.005 < grain["static"] < 0.5
    assert grain["dynamic"] is None  # the file states only the grain of the recording's slices
    for record in result.records:
        assert record.judgement.status == ("answered" if record.who.method == "sd+sound" else "failed")
        assert bool(record.judgement.note) == (record.who.method != "sd+sound")


def ignore_errors(view):
    """Look, ignore any error, and answer."""
    with suppress(Exception):
        view.score(0, 40)
    return Answer(position=0.5)


@pytest.mark.parametrize(
    ("search", "error"),
    [
        (go_to(0.5), OSError("no such disk")),
        (at_frame(200.0), BadInput("is cut short", where="a.exr")),
        (Commands(ignore_errors), OSError("no such disk")),
    ],
)
def test_stacks_that_cannot_be_read_are_no_fault_of_a_method(capture, search, error):
    class Torn(SceneLight):
        """Light whose disk fails."""

        def weighted(self, span, lens):
            raise error

    light = capture.open_light()
    with pytest.raises(type(error), match=str(error)):
        run_method(capture, method(search), light=Torn(light.source, light.gain))


@pytest.mark.slow
def test_both_regions_are_seen(dataset):
    steps = []
    protocol = ClosedLoopProtocol(IDEAL, budget_s=0.02)
    found = evaluate_module.evaluate(
        dataset, methods=["sd+golden_section", "sd+argmax:window=20@frame"], protocol=protocol, region="both",
        scene_motion="static", progress=lambda *step: steps.append(step),
    )  # fmt: skip
    assert found.failures == ()
    names = ["sd+golden_section", "sd+golden_section@frame", "sd+argmax:window=20@frame"]
    assert sorted({r.who.method for r in found.records}) == sorted(names)
    assert {r.who.method: r.who.region for r in found.records}["sd+golden_section@frame"] == "frame"
    assert [path.method for path in found.lens_paths] == [r.who.method for r in found.records]
    assert len({(r.what.sequence, r.what.mean_rate) for r in found.records}) == 2
    assert sorted({done for done, _, _ in steps}) == [1, 2, 3, 4, 5, 6]  # one more as a sequence ends


@pytest.mark.parametrize("kind", [Commands, lambda does: does], ids=["commands", "estimates"])
def test_a_view_has_only_the_promised_members_and_they_are_read_only(capture, kind):
    held = []

    def looks(view):
        view.score(0, 40)
        held.append(view)
        return Answer()

    assert run(capture, kind(looks)).problem == ""
    (view,) = held
    promised = {name for name in vars(View) if not name.startswith("_")}
    assert {name for name in dir(view) if not name.startswith("_")} == promised
    for name in (*promised, "path", "sent", "course"):
        with pytest.raises(AttributeError):
            setattr(view, name, 0)


@pytest.mark.parametrize("window", [(-50, 50), (10, 10), (300, 321), (0.5, 10)])
def test_a_window_outside_the_sweep_is_refused(capture, window):
    camera = start(capture)
    camera.wait(80)
    view = SweepView(camera, begin=0.0, end=1.0, frames=320)
    assert refusal(view.score, *window).allowed.endswith("<= 320")
    assert (view.now, camera.scorer.windows) == (0, 0)


def test_the_lens_before_a_sweep_is_hidden_from_its_view(capture):
    camera = start(capture)
    camera.wait(80)
    view = SweepView(camera, begin=0.0, end=1.0, frames=320)
    assert "no frame" in refusal(view.position, 0).allowed
    view.score(0, 40)
    for frame in (-1, 40, math.nan):
        assert refusal(view.position, frame).allowed == "0 to 39"
    assert 0 <= view.position(0) < view.position(39) == pytest.approx(40 / 320, rel=1e-3)


@pytest.mark.parametrize("name", ["voice_coil_hall", "liquid_lens"])
def test_a_sweep_ends_where_the_lens_is_at_the_far_end(capture, name):
    """If the command moved at the speed of the sweep, the lens would end 3 and 12 % short of the far end."""
    camera = start(capture, actuator=get_actuator(name, position_noise_rms=0))
    SweepView(camera, begin=0.0, end=1.0, frames=800).wait(800)
    assert camera.path[-1] == pytest.approx(1, abs=0.01)
    assert camera.path[400] == pytest.approx(0.5, abs=0.1)


def test_an_answer_is_the_position_of_the_lens_even_if_the_sensor_is_at_the_motor(capture):
    """After its first 12 ms a liquid lens follows its current 4 ms late, which is 13 % of the travel in this sweep."""
    drive = get_actuator("liquid_lens", position_noise_rms=0, place_rms=0)
    camera = start(capture, actuator=drive)
    view = SweepView(camera, begin=0.0, end=1.0, frames=800)
    view.wait(800)
    for frame in (300, 400.5, 500):
        truly = float(np.interp(frame, np.arange(800), camera.path))
        assert view.position(int(frame)) > truly + 0.05
        assert view.position_at(frame) == pytest.approx(truly, abs=0.01)


def test_a_piezo_is_judged_by_where_it_stands_and_its_search_sees_what_it_was_told(capture):
    """Sent down from the far end to the middle, it is half its hysteresis above the middle."""
    told, seen = (0.2, 1.0, 0.7, 0.5), []

    def search(view):
        for to in told:
            view.move(to)
            view.score(view.now + 80, view.now + 120)
            seen.append(view.position(view.now - 1))
        return Answer(position=0.5)

    done = run(capture, Commands(search), actuator=replace(IDEAL, hysteresis=0.13, reads="motor"))
    judgement = judged(done, capture.truth).judgement
    assert seen == pytest.approx(told, abs=1e-9)
    assert judgement.position == done.path[-1] == pytest.approx(0.565, abs=1e-3)
    assert judgement.error == pytest.approx(0.565 - capture.truth.position, abs=1e-3)


@pytest.mark.parametrize("frame", [60, 160, 250])
def test_a_piezo_comes_to_the_answer_from_where_its_sweep_began_so_that_it_stands_where_it_was_seen(capture, frame):
    """Sent back to the answer from the other side, it would stand up to its hysteresis away."""
    piezo = replace(IDEAL, hysteresis=0.13, reads="motor")
    done = run(capture, at_frame(frame), actuator=piezo, sweep_s=0.016)
    assert done.problem == ""
    assert done.commands[-2] == done.commands[1] in (0.0, 1.0)
    seen = float(done.path[done.frames_seen - 1])
    assert done.path[-1] == pytest.approx(seen, abs=0.01)
    assert abs(done.commands[-1] - seen) > 0.02, "where it stands is not what it was told"


@pytest.mark.parametrize(("frames", "passed"), [(0, 0), (0.2, 8), (8, 8), (8.5, 16)])
def test_a_wait_is_never_shorter_than_was_asked(capture, frames, passed):
    camera = start(capture)
    camera.wait(frames)
    assert camera.now == passed


def test_an_answer_without_a_look_is_the_current_lens_position(capture):
    camera = start(capture)
    camera.wait(80)
    assert SweepView(camera, begin=0.0, end=1.0, frames=320).position_at(100.0) == pytest.approx(0, abs=1e-6)


def ran(path, *, answered=0, answer=None):
    path = np.asarray(path, float)
    return Run(answer or Answer(position=0.5), "", path, answered, windows=1, seconds=0.0, commands=(0.2, 0.5))


TRUTH = Truth(position=0.5, depth_of_focus=(0.48, 0.52))


def test_the_verdict_compares_the_last_position_with_the_truth_at_that_time():
    moving = Truth(0.5, (0.48, 0.52), track=np.linspace(0.4, 0.6, 800))
    path = np.concatenate([np.linspace(0, 0.53, 100), np.full(300, 0.53)])
    still, then = judged(ran(path), TRUTH), judged(ran(path), moving)
    assert still.judgement.error_dof == pytest.approx(0.75)
    assert still.judgement.blur_px == pytest.approx(1.5)
    assert [still.success(limit) for limit in (0.5, 1, 2)] == [False, True, True]
    assert still.judgement.lens_travel == pytest.approx(0.53)
    assert then.judgement.truth == pytest.approx(0.4 + 0.2 * 399 / 799)


def test_time_to_focus_is_when_the_lens_is_in_its_last_place_for_good():
    """In place means within a quarter of the depth of focus, 0.01: from 0.2 to 0.5 in 100 frames, that is at 97."""
    path = np.concatenate([np.full(100, 0.2), np.linspace(0.2, 0.5, 101), np.full(99, 0.5)])
    judgement = judged(ran(path, answered=100), TRUTH).judgement
    assert judgement.time_to_focus_s == pytest.approx((100 + 97) / 20_000, abs=1.5 / 20_000)


@pytest.mark.parametrize(("best", "right"), [(0.5, False), (1.01, False), (1.2, True), (-0.5, True)])
def test_an_abstention_is_right_where_the_focus_is_out_of_reach(best, right):
    truth = Truth(best, (best - 0.02, best + 0.02))
    abstained = judged(ran(np.full(10, 0.3), answer=Answer()), truth)
    assert (abstained.judgement.status, abstained.success()) == ("abstained", right)
    unknown = judged(ran(np.full(10, 0.3)), Truth())
    assert (unknown.judgement.truth, unknown.success()) == (None, None)
    assert unknown.judgement.position == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("positions", "turns"), [([], 0), ([0.5], 0), ([0.5, 0.0, 0.2, 1.0, 1.0, 0.6], 2), ([0.1, 0.1, 0.3, 0.2], 1)]
)
def test_reversals_are_those_of_the_commands_and_not_the_ringing_of_the_lens(positions, turns):
    assert count_reversals(positions) == turns


@pytest.mark.parametrize(
    ("protocol", "problem", "allowed"),
    [
        ({"budget_s": 30.0}, "a budget of 30000 ms", "0.8 to 20000 ms"),
        ({"budget_s": 1e-5}, "a budget of", "0.8 to 20000 ms"),
        ({"budget_s": 0.02, "sweep_s": 0.03}, "a sweep of 30 ms", "0.8 ms to the budget of 20 ms"),
    ],
)
def test_a_protocol_that_cannot_be_kept_is_refused(capture, protocol, problem, allowed):
    error = refusal(run, capture.lasting(400_000), go_to(0.5), **protocol)
    assert problem in error.problem
    assert allowed in error.allowed


@pytest.mark.parametrize("light", ["constant", "lamp_only"])
def test_a_scene_at_rest_goes_on_after_the_recording_and_what_was_recorded_stays(dataset, light):
    """After the ramp of lamp_only the gain stays at 2."""
    with saf_gen.open_stream(dataset / "test" / f"plane-{light}-00.h5") as stream:
        recorded = Capture.from_stream(stream, dataset / "stacks")
    longer = recorded.lasting(1600)
    assert (longer.frames, longer.gain.shape) == (1600, (1600, recorded.gain.shape[1]))
    assert np.array_equal(longer.gain[:800], recorded.gain)
    assert set(longer.gain[800:, 0]) == {1.0 if light == "constant" else 2.0}
    assert longer.lasting(400) is longer
    before, after = (CapturedReadouts(one, one.open_light(), region=WHOLE) for one in (recorded, longer))
    before.encode_until(800, np.full(800, 0.5))
    after.encode_until(1600, np.full(1600, 0.5))
    assert np.array_equal(before.window(0, 800), after.window(0, 800))
    brighter = after.window(1200, 1600).mean() / after.window(0, 400).mean()
    assert brighter == pytest.approx(1.0, rel=0.02) if light == "constant" else brighter > 1.3


def test_a_moving_scene_ends_with_its_recording(dataset):
    with saf_gen.open_stream(dataset / "test" / "plane-dynamic-constant-00.h5") as stream:
        capture = Capture.from_stream(stream, dataset / "stacks")
    assert capture.end == "as long as was recorded"
    assert capture.lasting(1600) is capture


def test_light_that_is_defined_for_the_recording_alone_ends_with_it(capture, tmp_path):
    (tmp_path / "lamp.py").write_text(
        "from dataclasses import dataclass\n@dataclass(frozen=True)\nclass Lamp:\n"
        "    def integral(self, seconds, duration_s):\n        return seconds\n"
    )
    own = replace(capture, schedule={"": {"kind": f"{tmp_path / 'lamp.py'}:Lamp"}})
    assert own.end.startswith("as long as was recorded, where the light '")
    assert own.lasting(1600) is own


def test_a_protocol_that_no_sequence_can_keep_writes_nothing(dataset, tmp_path, call):
    loop = ("evaluate", dataset, "--track", "closed_loop", "--budget", 30_000, "--out", tmp_path / "o")
    code, _, err = call(*loop)
    assert code == 2
    assert "none of 4 sequences can be evaluated" in err
    assert "a budget of 30000 ms" in err
    assert not (tmp_path / "o").exists()
