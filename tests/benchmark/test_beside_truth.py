"""Errors from the peak of a measure's own noise-free curve, and from the least blur of a lens with aberrations."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from handmade_records import record
from planted_sweeps import SHAPE, list_streams, make_spikes, make_truth
from refusals import assert_says, refusal

from saf_gen.benchmark.evaluate import evaluate
from saf_gen.benchmark.records import KEYS_WHERE_KNOWN, format_records, read_records, record_to_json
from saf_gen.benchmark.tracks.beside_truth import optimum_fields, sharpness_fields
from saf_gen.benchmark.tracks.closed_loop import ClosedLoopSequence
from saf_gen.benchmark.tracks.closed_loop_run import ClosedLoopRun
from saf_gen.leaderboard.ranking import rank_methods
from saf_gen.leaderboard.results import notes_on
from saf_gen.leaderboard.tables import ranking
from saf_gen.parts import Answer
from saf_gen.stream.metadata import Truth
from saf_gen.stream.stream_writer import write_stream

FRAMES, TARGET = SHAPE[0], np.ones(SHAPE[1:], bool)
NEAR = Truth(position=0.5, depth_of_focus=(0.45, 0.55))


def curve(peak, positions=33, *, width=0.1):
    return np.exp(-(((np.linspace(0, 1, positions) - peak) / width) ** 2))


def optimum(truth, *, method="sd+argmax", region="target", position=0.5, optima=None, here=0.5):
    return optimum_fields(truth, position, method=method, region=region, optima=optima or {}, here=here)


@pytest.mark.parametrize("peak", [0.1, 0.4321, 0.5, 0.77])
def test_the_optimum_is_the_peak_of_the_curve_in_the_recording(peak):
    """The error of a parabola through three values of this bell at this step is at most 0.05 steps."""
    found = optimum(replace(NEAR, sharpness=curve(peak)), position=0.6)
    assert found["optimum"] == pytest.approx(peak, abs=0.05 / 32)
    assert found["error_optimum_dof"] == pytest.approx((0.6 - found["optimum"]) / 0.1)


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
    assert optimum(truth, **asked) == {"optimum": None, "error_optimum_dof": None}


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
    found = optimum(replace(NEAR, sharpness=curve(0.4)), method=method, optima=stated, position=0.6)
    assert found["optimum"] == (None if peak is None else pytest.approx(peak, abs=1e-3))
    assert found["error_optimum_dof"] == (None if peak is None else pytest.approx((0.6 - peak) / 0.1, abs=0.01))
    assert optimum(NEAR, method=method, optima=stated, region="frame")["optimum"] is None


def test_the_optimum_of_a_moving_scene_moves_with_its_truth():
    moving = replace(NEAR, sharpness=curve(0.4), track=np.linspace(0.3, 0.6, 8))
    assert optimum(moving, optima={"sd": -0.02}, here=0.45, position=0.45) == {
        "optimum": pytest.approx(0.43),
        "error_optimum_dof": pytest.approx(0.2),
    }
    assert optimum(moving, optima={"sd": -0.02}, here=None)["optimum"] is None
    assert run_to(0.62, moving, optima={"sd": -0.02}).optimum is None  # the lens takes its own course
    assert run_to(0.62, NEAR, method="brenner", optima={"brenner": 0.02}).optimum == pytest.approx(0.52)


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
    found = sharpness_fields(truth, position)["sharpness_lost"]
    assert found == (None if lost is None else pytest.approx(lost))


def test_a_record_states_the_sharpness_lost_where_it_is_known():
    known = run_to(1.5 / 30, replace(NEAR, sharpness=KNOTS))
    assert record_to_json(known)["sharpness_lost"] == pytest.approx(0.25)
    assert "sharpness_lost" not in record_to_json(run_to(0.5, NEAR))


TILTED = {"best_position": np.linspace(0.2, 0.55, TARGET.size, dtype=np.float32).reshape(TARGET.shape)}


def test_records_say_whether_something_of_a_tilted_target_is_in_focus(answered):
    """Its middle 80 % focus from 0.235 to 0.515, each over 0.05 on either side; the answer is at 0.375."""
    found = answered("sd+argmax", **TILTED)["sd+argmax"]
    assert found.in_focus is True
    assert "in_focus" in record_to_json(found)
    truth = replace(NEAR, target=TARGET, **TILTED)
    assert [run_to(p, truth).in_focus for p in (0.17, 0.2, 0.56, 0.58)] == [False, True, True, False]
    assert run_to(0.5, truth, problem="broke").in_focus is None
    assert run_to(0.5, replace(truth, best_position=np.full(TARGET.shape, 0.5))).in_focus is None
    assert run_to(0.5, replace(NEAR, in_focus=(0.3, 0.6))).in_focus is True


def test_an_abstention_has_an_optimum_and_no_error():
    found = optimum(replace(NEAR, sharpness=curve(0.4)), position=None)
    assert found == {"optimum": pytest.approx(0.4, abs=1e-3), "error_optimum_dof": None}


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
        return {r.method: r for r in evaluate(list_streams(tmp_path, {"id": "a"}), methods=methods, **more).records}

    return run


def test_a_method_is_judged_from_its_measures_own_peak_beside_the_truth(answered):
    found = answered("sd+argmax", "brenner+argmax", sharpness=curve(0.41))
    assert found["sd+argmax"].optimum == pytest.approx(0.41, abs=1e-3)
    one = found["sd+argmax"]
    assert one.error_optimum_dof == pytest.approx((one.position - one.optimum) / 0.1)
    assert one.error_dof == pytest.approx((one.position - 300 / 799) / 0.1)
    assert found["brenner+argmax"].optimum is None


@pytest.mark.parametrize(("apart", "right"), [(0.0149, None), (-0.0151, True), (0.2, False)])
def test_success_is_given_against_the_least_blur_where_it_is_far_from_the_truth(answered, apart, right):
    """The depth of focus is 0.1 of the travel; 0.15 of it is far."""
    found = answered("sd+argmax", least_blur=300 / 799 + apart)["sd+argmax"]
    assert found.success_1dof is True
    assert found.success_least_blur == right


def test_an_abstention_is_right_by_the_least_blur_if_the_lens_does_not_come_near_it(answered):
    nothing = '{"method": "elsewhere", "sequence": "a", "frame": null}\n'
    one = answered("sd+argmax", predicted=nothing, least_blur=1.5)["elsewhere"]
    assert (one.status, one.success_1dof, one.success_least_blur) == ("abstained", False, True)


def test_in_a_moving_scene_the_least_blur_moves_with_the_truth(answered):
    """The answer is at 0.437. The truth has moved beyond it, and the least blur, which began far below, towards it."""
    track = np.full(FRAMES, 300 / 799 + 0.21, np.float32)
    found = answered("sd+argmax", track=track, least_blur=300 / 799 - 0.2)["sd+argmax"]
    assert (found.success_1dof, found.success_least_blur) == (False, True)


def run_to(position, truth, *, region="target", problem="", method="sd", optima=None):
    """The record of a method that moved the lens to ``position`` in the closed loop, and what the sequence knows."""
    capture = SimpleNamespace(truth=truth, sensor=SimpleNamespace(readout_hz=20_000.0), optima=optima or {})
    task = SimpleNamespace(id="a", split="test", scene="board", light="constant")
    sequence = ClosedLoopSequence(task, capture, (slice(0, 1), slice(0, 1)), region, None, "d")
    run = ClosedLoopRun(
        Answer(position=position), problem, 100, np.linspace(0, position or 0, 100), 4000, 3, 0.1, (0.0, position)
    )
    known = {"method": f"{method}+golden_section", "code": "c", "obstacle": None, "track": "closed_loop"}
    return sequence.make_record(run, SimpleNamespace(describe=lambda capture: "terms"), known=known)


def test_the_closed_loop_judges_by_both_as_well():
    truth = replace(NEAR, sharpness=curve(0.45), least_blur=0.52)
    found = run_to(0.62, truth)
    assert found.optimum == pytest.approx(0.45, abs=1e-3)
    assert found.error_optimum_dof == pytest.approx(1.7, abs=0.02)
    assert found.error_dof == pytest.approx(1.2)
    assert (found.success_1dof, found.success_least_blur) == (False, True)
    assert run_to(0.62, truth, region="frame").optimum is None
    assert run_to(0.62, truth, problem="broke").success_least_blur is False
    assert run_to(0.62, replace(truth, least_blur=0.51)).success_least_blur is None


def test_lines_have_the_keys_only_where_they_are_known(answered, tmp_path):
    (plain,) = answered("sd+argmax").values()
    assert set(record_to_json(plain)) & set(KEYS_WHERE_KNOWN) == {"operations", "reference_rate"}
    full = replace(plain, optimum=0.4, success_least_blur=False)
    (tmp_path / "records.jsonl").write_text(format_records([plain, full]))
    assert read_records(tmp_path) == [plain, full]


NO_ERROR = dict.fromkeys(("error_dof", "blur_px"))
SUCCESSES = ("success_half_dof", "success_1dof", "success_2dof")


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        (NO_ERROR | dict.fromkeys(SUCCESSES), "success_least_blur is known, and success_1dof is not"),
        (
            NO_ERROR
            | {"status": "failed", "frame": None, "position": None, "error": None, "error_frames": None}
            | dict.fromkeys(SUCCESSES, False),
            "failed, but success_least_blur is true",
        ),
        ({"status": "abstained", "frame": None}, "abstained, but position is"),
        ({"status": "failed", "frame": None, "position": None}, "failed, but error is"),
        ({"error_optimum_dof": "near"}, "error_optimum_dof"),
        ({"success_least_blur": 1}, "success_least_blur"),
    ],
)
def test_a_line_that_contradicts_itself_is_refused(tmp_path, changes, says):
    (tmp_path / "records.jsonl").write_text(
        format_records([replace(record("sd+argmax", "s", 0.0), success_least_blur=True)])
    )
    assert read_records(tmp_path)[0].success_least_blur
    (tmp_path / "records.jsonl").write_text(
        format_records([replace(record("sd+argmax", "s", 0.0), **{"success_least_blur": True, **changes})])
    )
    assert_says(refusal(read_records, tmp_path), says)


def test_the_leaderboard_gives_both_successes_only_where_some_lens_needs_them():
    sharp = [record(m, "s1", 0.2) for m in ("a+argmax", "b+argmax")]
    apart = [
        record(method, "s2", error, scene="fan", success_least_blur=True)
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
    assert not any("least blur" in note for note in notes_on(plain, sharp))
    assert any(note.startswith("On 1 of 2 sequences") for note in notes_on(both, sharp + apart))
