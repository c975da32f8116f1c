"""The computing time of a method: that of its search, measure and textures, by a simulated clock."""

from types import SimpleNamespace

import numpy as np
import pytest
from in_memory_stream import InMemory

from saf_gen.benchmark.method_spec import Method
from saf_gen.benchmark.search_run import run_search
from saf_gen.benchmark.tracks import closed_loop_run
from saf_gen.benchmark.view import recording
from saf_gen.benchmark.view.clock import Clock
from saf_gen.benchmark.view.recording import RecordingView, WindowCounts
from saf_gen.benchmark.view.restricted_view import BudgetSpentError
from saf_gen.benchmark.view.running_camera import RunningCamera
from saf_gen.core.stopwatch import Stopwatch
from saf_gen.optics.actuators import ActuatedLens, get_actuator
from saf_gen.parts import Answer
from saf_gen.plugins.measures import get_measure
from saf_gen.stream import interval_texture

THINKS, SCORES, LOOKS_UP, COUNTS, READS, ENCODES, DRIVES = 1.0, 16.0, 256.0, 4e3, 6e4, 1e6, 1.6e7
COMPILES = 2.5e8


@pytest.fixture
def clock(monkeypatch):
    """A clock that advances only when a test advances it."""

    class Clock:
        now = 0.0

        def takes(self, seconds, call):
            """Return a function that advances the clock and then calls ``call``."""

            def late(*arguments, **options):
                self.now += seconds
                return call(*arguments, **options)

            late.signatures = getattr(call, "signatures", [])  # if it is a compiled loop
            return late

    clock = Clock()
    monkeypatch.setattr("time.perf_counter", lambda: clock.now)
    monkeypatch.setattr(ActuatedLens, "run", clock.takes(DRIVES, ActuatedLens.run))
    return clock


@pytest.fixture
def replace_looks(monkeypatch):
    """Return a function that replaces the compiled loop of textures by what another one makes of it."""

    def replace(change):
        monkeypatch.setattr(interval_texture, "_look_back", change(interval_texture._look_back))

    return replace


def slow_counts(clock):
    stream = InMemory(800, 4, 6)
    stream.counts, stream.packed = clock.takes(COUNTS, stream.counts), clock.takes(READS, stream.packed)
    return WindowCounts(stream)


def slow_search(clock, *windows, answers=None):
    """Return a search that thinks before each look and before it answers."""

    def search(view):
        for first, stop in windows:
            clock.now += THINKS
            view.score(first, stop)
        clock.now += THINKS
        return answers or Answer(400.0)

    return search


class SlowCapture:
    """A slow camera without a scene."""

    shape, frames, textures_s = (4, 6), 0, 0.0

    def __init__(self, clock):
        self.clock = clock

    def encode_until(self, stop, position):
        self.clock.now += ENCODES
        self.frames = stop

    def window(self, first, stop):
        self.clock.now += COUNTS
        return np.ones(self.shape, np.uint32)


def slow_camera(clock, *, budget=800):
    return RunningCamera(
        SlowCapture(clock), clock.takes(SCORES, np.mean), actuator=get_actuator("ideal"), start=0.0, seed=1,
        budget=budget, clock=Clock(20_000.0),
    )  # fmt: skip


def test_a_stopwatch_adds_up_what_calls_took_those_that_raise_too(clock):
    watch = Stopwatch()
    assert watch.time(clock.takes(2, max), [3, 5], key=lambda x: -x) == 3
    with pytest.raises(ZeroDivisionError):
        watch.time(clock.takes(4, lambda: 1 / 0))
    clock.now += 8
    assert watch.seconds == 6


def test_on_a_recording_search_and_measure_are_paid_and_counting_is_not(clock):
    recording = RecordingView(slow_counts(clock), clock.takes(SCORES, np.mean))
    answer, problem = run_search(slow_search(clock, (0, 100), (50, 800)), recording, scorer=recording.scorer)
    assert (answer.frame, problem) == (400.0, "")
    assert clock.now > COUNTS
    assert recording.scorer.seconds == 3 * THINKS + 2 * SCORES


@pytest.mark.parametrize("breaks", ["search", "measure"])
def test_a_method_that_breaks_has_paid_until_then(clock, breaks):
    measure = clock.takes(SCORES, (lambda counts: 1 / 0) if breaks == "measure" else np.mean)
    recording = RecordingView(slow_counts(clock), measure)

    def search(view):
        slow_search(clock, (0, 100))(view)
        raise ValueError

    _, problem = run_search(search, recording, scorer=recording.scorer)
    assert problem.startswith("ZeroDivisionError" if breaks == "measure" else "ValueError")
    assert recording.scorer.seconds == (THINKS + SCORES if breaks == "measure" else 2 * THINKS + SCORES)


def test_each_method_pays_for_a_texture_but_not_for_reading_and_counting(clock, replace_looks):
    """The second method gets the cached texture of the first, but pays the same time."""
    replace_looks(lambda loop: clock.takes(LOOKS_UP, loop))
    counts, measure = slow_counts(clock), get_measure("sd_tfi")
    costs = []
    for _ in range(2):
        recording = RecordingView(counts, measure)
        run_search(slow_search(clock, (0, 100)), recording, scorer=recording.scorer)
        costs.append(recording.scorer.seconds)
    assert clock.now > READS
    assert costs[0] == costs[1]
    looks, rest = divmod(costs[0] - 2 * THINKS, LOOKS_UP)
    assert looks >= 1
    assert rest == 0


def test_the_time_to_compile_is_not_paid(clock, replace_looks):
    """The first look in a process compiles or loads the loop, which is not part of the method's time."""

    def compiled_late(loop):
        looks = clock.takes(LOOKS_UP, loop)

        def compiles(*arguments):
            if not compiles.signatures:
                compiles.signatures.append("a signature")
                clock.now += COMPILES
            return looks(*arguments)

        compiles.signatures = []
        return compiles

    replace_looks(compiled_late)
    counts = slow_counts(clock)
    image = counts.intervals(0, 100)
    assert clock.now > COMPILES
    assert LOOKS_UP <= counts.textures_s < COUNTS
    np.testing.assert_array_equal(image, WindowCounts(InMemory(800, 4, 6)).intervals(0, 100))


def test_a_texture_that_was_forgotten_is_timed_again(clock, monkeypatch, replace_looks):
    monkeypatch.setattr(recording, "WINDOW_BYTES", 0)
    replace_looks(lambda loop: clock.takes(LOOKS_UP, loop))
    counts = slow_counts(clock)
    for first in (0, 100, 0):
        counts.intervals(first, first + 100)
    assert counts.textures_s >= 3 * LOOKS_UP


@pytest.mark.parametrize("frames", [160, 10_000], ids=["in time", "out of time"])
@pytest.mark.parametrize("commands", [True, False])
def test_the_run_of_a_method_says_what_it_computed(clock, monkeypatch, commands, frames):
    """For commanding and estimating searches; if the budget runs out during a look, earlier time still counts."""
    camera = slow_camera(clock)
    answer = Answer(position=0.5) if commands else Answer(100.0)
    found = slow_search(clock, (0, 80), (80, 160), answers=answer)

    class Search:
        def __call__(self, view):
            done = found(view)
            if frames > 800:
                raise BudgetSpentError
            return done

    Search.commands = commands
    monkeypatch.setattr(closed_loop_run, "start_camera", lambda *_, **__: camera)
    protocol = SimpleNamespace(count_frames=lambda capture: (800, 320))
    captured = SimpleNamespace(capture=None)
    run = closed_loop_run.run_closed_loop(captured, Method("a+b", np.mean, Search(), "c"), protocol=protocol)
    assert run.problem == ("the budget of 800 frames was spent" if frames > 800 else "")
    assert clock.now > ENCODES + DRIVES
    assert (run.windows, run.seconds) == (2, 3 * THINKS + 2 * SCORES)
