"""The peak of a measure's own noise-free curve, the least blur of a lens with aberrations, and the sharpness lost."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from handmade_records import BLANK, record
from planted_sweeps import SHAPE, list_streams, make_spikes, make_truth

from saf_gen.benchmark.evaluate import evaluate
from saf_gen.benchmark.judgement import Run
from saf_gen.benchmark.records import Who
from saf_gen.benchmark.tracks.closed_loop import ClosedLoopSequence
from saf_gen.benchmark.tracks.record_of_run import find_optimum
from saf_gen.leaderboard.ranking import rank_methods
from saf_gen.leaderboard.results import warnings_on
from saf_gen.leaderboard.tables import ranking
from saf_gen.parts import Answer
from saf_gen.stream.metadata import Truth
from saf_gen.stream.stream_writer import write_stream

FRAMES, TARGET = SHAPE[0], np.ones(SHAPE[1:], bool)
NEAR = Truth(position=0.5, depth_of_focus=(0.45, 0.55))


def curve(peak, positions=33, *, width=0.1):
    return np.exp(-(((np.linspace(0, 1, positions) - peak) / width) ** 2))


def optimum(truth, *, method="sd+argmax", region="target", optima=None, position=0.5):
    return run_to(position, truth, region=region, method=method, optima=optima).judgement.optimum


@pytest.mark.parametrize("peak", [0.1, 0.4321, 0.5, 0.77])
def test_the_optimum_is_the_peak_of_the_curve_in_the_recording(peak):
    """The error of a parabola through three values of this bell at this step is at most 0.05 steps."""
    assert optimum(replace(NEAR, sharpness=curve(peak))) == pytest.approx(peak, abs=0.05 / 32)


@pytest.mark.parametrize(
    ("truth", "asked"),
    {
        "no curve": (NEAR, {}),
        "no truth": (Truth(sharpness=curve(0.5)), {}),
        "a flat curve": (replace(NEAR, sharpness=np.ones(33)), {}),
        "a black picture": (replace(NEAR, sharpness=np.zeros(33)), {}),
        "two positions": (replace(NEAR, sharpness=np.array([1.0, 2.0])), {}),
        "a step of 1.25 depths of focus": (replace(NEAR, sharpness=curve(0.5, 9)), {}),
        "a peak at the end": (replace(NEAR, sharpness=curve(1.2)), {}),
        "a peak beside positions that are unknown": (
            replace(NEAR, sharpness=np.where(np.arange(33) > 16, math.nan, curve(0.7))),
            {},
        ),
        "unknown everywhere": (replace(NEAR, sharpness=np.full(33, math.nan)), {}),
        "a scene that moves": (replace(NEAR, sharpness=curve(0.5), track=np.full(8, 0.5)), {}),
        "a measure of another kind": (replace(NEAR, sharpness=curve(0.5)), {"method": "brenner+argmax"}),
        "a measure of a user": (replace(NEAR, sharpness=curve(0.5)), {"method": "mine.py+argmax"}),
        "the whole frame": (replace(NEAR, sharpness=curve(0.5)), {"region": "frame"}),
    }.values(),
)
def test_an_optimum_that_nothing_shows_is_unknown(truth, asked):
    assert optimum(truth, **asked) is None


@pytest.mark.parametrize(
    ("method", "peak"),
    {
        "as stated": ("brenner+argmax", 0.53),
        "normalised": ("brenner_n+argmax", 0.53),
        "of intervals": ("brenner_n_tfi+peak_fit:top=0.5", 0.53),
        "of the kind of sd, from its curve": ("sd_calibrated:dark=0.1+argmax", 0.4),
        "not stated": ("tenengrad+argmax", None),
        "with an option": ("octave_structure:longest=8+argmax", None),
        "of a user": ("brenner.py:mine+argmax", None),
    }.values(),
)
def test_the_optimum_of_other_measures_is_what_the_recording_states(method, peak):
    stated = {"brenner": 0.03, "octave_structure": 0.01, "sd": 0.2}
    found = optimum(replace(NEAR, sharpness=curve(0.4)), method=method, optima=stated)
    assert found == (None if peak is None else pytest.approx(peak, abs=1e-3))
    assert optimum(NEAR, method=method, optima=stated, region="frame") is None


def test_the_optimum_of_a_moving_scene_moves_with_its_truth():
    moving = replace(NEAR, sharpness=curve(0.4), track=np.linspace(0.3, 0.6, 8))
    stated = {"optima": {"sd": -0.02}, "method": "sd+argmax"}
    assert find_optimum(moving, 0.45, **stated) == pytest.approx(0.43)
    assert find_optimum(moving, None, **stated) is None
    assert optimum(moving, optima={"sd": -0.02}) is None  # the lens takes its own course
    assert optimum(NEAR, method="brenner+argmax", optima={"brenner": 0.02}) == pytest.approx(0.52)


KNOTS = np.array([0.0, 0.5, 1.0, 0.5, 0.0] + [0.0] * 26)  # positions 1/30 apart, a third of a depth of focus


@pytest.mark.parametrize(
    ("truth", "position", "lost"),
    {
        "at its best": (replace(NEAR, sharpness=KNOTS), 2 / 30, 0.0),
        "between two positions": (replace(NEAR, sharpness=4 * KNOTS), 1.5 / 30, 0.25),
        "all of it": (replace(NEAR, sharpness=KNOTS), 0.5, 1.0),
        "unknown there": (replace(NEAR, sharpness=np.where(np.arange(31) == 20, np.nan, KNOTS)), 20 / 30, None),
        "no answer": (replace(NEAR, sharpness=KNOTS), None, None),
        "no curve": (NEAR, 0.5, None),
        "too coarse a curve": (replace(NEAR, sharpness=KNOTS[::5]), 0.5, None),
        "a dark one": (replace(NEAR, sharpness=0 * KNOTS), 0.5, None),
        "a scene that moves": (replace(NEAR, sharpness=KNOTS, track=np.full(8, 0.5)), 0.5, None),
        "no depth of focus": (replace(NEAR, sharpness=KNOTS, depth_of_focus=(np.nan, np.nan)), 0.5, None),
    }.values(),
)
def test_the_sharpness_lost_at_an_answer_is_that_of_the_curve_without_noise(truth, position, lost):
    found = run_to(position, truth).judgement.sharpness_lost
    assert found == (None if lost is None else pytest.approx(lost))


INSIDE = replace(NEAR, sharpness=curve(0.4), sharpness_inside=curve(0.52))


@pytest.mark.parametrize(("region", "peak"), [("target", 0.4), ("inside", 0.52), ("half", None)])
def test_a_method_that_looks_inside_the_target_has_the_optimum_and_the_sharpness_of_that_place(region, peak):
    """A box that a camera may choose instead has no optimum, and loses the sharpness of the box around the target."""
    found = run_to(0.52, INSIDE, region=region).judgement
    assert found.optimum == (None if peak is None else pytest.approx(peak, abs=0.05 / 32))
    lost = 0.0 if region == "inside" else 1 - np.exp(-((0.12 / 0.1) ** 2))
    assert found.sharpness_lost == pytest.approx(lost, abs=0.02)


def test_optima_that_a_recording_states_are_those_of_the_region():
    stated = {"target": {"brenner": 0.03}, "inside": {"brenner": -0.01}}
    capture = SimpleNamespace(truth=NEAR, sensor=SimpleNamespace(readout_hz=20_000.0), optima=stated)
    sequence = ClosedLoopSequence(None, capture, (slice(0, 1), slice(0, 1)), "", None, "d")
    run = Run(Answer(position=0.5), "", np.full(9, 0.5), 9, windows=3, seconds=0.1, commands=(0.5,))
    found = {
        region: sequence.make_record(run, who=Who("brenner+argmax", "c", region), what=BLANK.what).judgement.optimum
        for region in ("target", "inside", "half")
    }
    assert found == {"target": pytest.approx(0.53), "inside": pytest.approx(0.49), "half": None}


def test_an_abstention_has_an_optimum():
    assert optimum(replace(NEAR, sharpness=curve(0.4)), position=None) == pytest.approx(0.4, abs=1e-3)


@pytest.fixture
def answered(tmp_path):
    """A function that evaluates methods on a sweep, sharp at frame 300, whose truth has more fields than usual."""

    def run(*methods, predicted="", **truth):
        path = tmp_path / "test" / "a.h5"
        path.parent.mkdir()
        lens = np.linspace(0, 1, FRAMES, dtype=np.float32)
        write_stream(
            path, make_spikes(300), focus_position=lens, truth=make_truth(300.0, target=TARGET, dof=0.1, **truth)
        )
        (tmp_path / "p.jsonl").write_text(predicted)
        more = {"predictions": tmp_path / "p.jsonl"} if predicted else {}
        return {r.who.method: r for r in evaluate(list_streams(tmp_path, {"id": "a"}), methods=methods, **more).records}

    return run


def test_the_recorded_track_gives_the_optimum_beside_the_truth(answered):
    found = answered("sd+argmax", "brenner+argmax", sharpness=curve(0.41))
    assert found["sd+argmax"].judgement.optimum == pytest.approx(0.41, abs=1e-3)
    assert found["brenner+argmax"].judgement.optimum is None


def test_a_record_states_the_sharpness_lost_where_it_is_known(answered):
    found = answered("sd+argmax", sharpness=curve(0.41))["sd+argmax"].judgement
    here = np.interp(found.position, np.linspace(0, 1, 33), curve(0.41))
    assert found.sharpness_lost == pytest.approx(1 - here / curve(0.41).max())


@pytest.mark.parametrize(("apart", "right"), [(0.0149, None), (-0.0151, True), (0.2, False)])
def test_success_is_given_against_the_least_blur_where_it_is_far_from_the_truth(answered, apart, right):
    """The depth of focus is 0.1 of the travel; 0.15 of it is far."""
    found = answered("sd+argmax", least_blur=300 / 799 + apart)["sd+argmax"]
    assert found.success() is True
    assert found.success_least_blur == right


@pytest.mark.slow
def test_no_answer_is_no_success_by_the_least_blur(answered):
    nothing = '{"method": "elsewhere", "sequence": "a", "frame": null}\n'
    one = answered("sd+argmax", predicted=nothing, least_blur=1.5)["elsewhere"]
    assert (one.judgement.status, one.success(), one.success_least_blur) == ("abstained", False, False)


def test_in_a_moving_scene_the_least_blur_moves_with_the_truth(answered):
    """The answer is at 0.437. The truth has moved beyond it, and the least blur, which began far below, towards it."""
    track = np.full(FRAMES, 300 / 799 + 0.21, np.float32)
    found = answered("sd+argmax", track=track, least_blur=300 / 799 - 0.2)["sd+argmax"]
    assert (found.success(), found.success_least_blur) == (False, True)


def run_to(position, truth, *, region="target", method="sd+golden_section", optima=None):
    """The record of a method that moved the lens to ``position`` in the closed loop, None for an abstention."""
    capture = SimpleNamespace(truth=truth, sensor=SimpleNamespace(readout_hz=20_000.0), optima={region: optima or {}})
    sequence = ClosedLoopSequence(None, capture, (slice(0, 1), slice(0, 1)), region, None, "d")
    path = np.linspace(0, position or 0, 100)
    run = Run(Answer(position=position), "", path, 100, windows=3, seconds=0.1, commands=(0.0, position or 0.0))
    return sequence.make_record(run, who=Who(method, "c", region), what=BLANK.what)


def test_the_leaderboard_gives_both_successes_only_where_some_lens_needs_them():
    sharp = [record(m, "s1", 0.2) for m in ("a+argmax", "b+argmax")]
    apart = [
        record(method, "s2", error, scene="fan", least_blur=0.05)
        for method, error in (("a+argmax", 0.2), ("b+argmax", 1.2))
    ]
    plain, both = rank_methods(sharp), rank_methods(sharp + apart)
    assert "success_least_blur" not in ranking(plain).to_csv()
    assert {r.method: (r.answerable_1dof, r.success_least_blur) for r in both} == {
        "a+argmax": (1.0, 1.0),
        "b+argmax": (0.5, 1.0),
    }
    assert "≤1 DoF of least blur" in ranking(both).to_markdown()
    assert "success_least_blur" in ranking(both).to_csv()
    assert not any("least blur" in note for note in warnings_on(plain, sharp))
    assert any(note.startswith("On 1 of 2 sequences") for note in warnings_on(both, sharp + apart))
