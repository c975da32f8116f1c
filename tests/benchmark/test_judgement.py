"""The judgement of runs on recordings; that of runs that move the lens is in test_closed_loop.py."""

import math
from dataclasses import replace

import numpy as np
import pytest
from handmade_records import BLANK

from saf_gen.benchmark.judgement import Run, judge, judged_dof, lens_position, light_ratio, travel_to_answer
from saf_gen.benchmark.records import SUCCESS_LIMITS_DOF, Record
from saf_gen.benchmark.tracks.sequence_fields import judge_crossing
from saf_gen.parts import Answer
from saf_gen.stream.metadata import Truth

SWEEP = np.linspace(0, 1, 801, dtype=np.float32)  # frame t is at t / 800


def judged(frame, *, path=SWEEP, frame_of_truth=400.0, **truth):
    """Return the record of an answer at a frame, None for an abstention, after the whole recording was seen."""
    known = Truth(**{"position": 0.5, "frame": frame_of_truth, "depth_of_focus": (0.45, 0.55), **truth})
    run = Run(Answer(frame), "", path, frames_seen=801, windows=8, seconds=0.0)
    what = replace(BLANK.what, focus_off_dof=judge_crossing(known, path)[1])
    return Record(BLANK.who, what, judge(run, known, end_s=lambda frames: frames / 20_000))


def success(frame, **changes):
    return tuple(map(judged(frame, **changes).success, SUCCESS_LIMITS_DOF))


def test_an_error_is_answer_minus_truth_in_every_unit():
    late = judged(480.0).judgement
    assert late.error == pytest.approx(0.1)
    assert late.error_frames == pytest.approx(80)
    assert late.error_dof == pytest.approx(1.0)
    early = judged(320.0).judgement
    assert (early.error, early.error_frames) == (pytest.approx(-0.1), pytest.approx(-80))
    assert early.error_dof == pytest.approx(-1.0)
    back = judged(480.0, path=SWEEP[::-1]).judgement
    assert (back.error, back.error_frames) == (pytest.approx(-0.1), pytest.approx(80))


def test_the_blur_is_one_pixel_at_the_ends_of_the_depth_of_focus():
    assert judged(360.0).judgement.blur_px == pytest.approx(1.0)
    assert judged(440.0).judgement.blur_px == pytest.approx(1.0)
    assert judged(400.0).judgement.blur_px == pytest.approx(0.0)
    assert judged(560.0).judgement.blur_px == pytest.approx(4.0)


@pytest.mark.parametrize(
    ("frame", "expected"),
    [(400.0, (True, True, True)), (460.0, (False, True, True)), (520.0, (False, False, True)), (600.0, (False,) * 3)],
)
def test_success_is_judged_within_half_one_and_two_depths_of_focus(frame, expected):
    assert SUCCESS_LIMITS_DOF == (0.5, 1.0, 2.0)
    assert success(frame) == expected


def test_an_abstention_has_no_error_and_is_no_success_where_the_focus_was_there():
    nothing = judged(None).judgement
    assert (nothing.error, nothing.error_frames, nothing.error_dof, nothing.blur_px) == (None,) * 4
    assert success(None) == (False, False, False)


def test_outside_the_travel_an_answer_has_an_error_but_none_in_frames_and_an_abstention_is_right():
    assert success(None, position=1.15, frame_of_truth=math.nan, depth_of_focus=(1.1, 1.2)) == (True, True, False)
    end = judged(800.0, position=1.15, frame_of_truth=math.nan, depth_of_focus=(1.1, 1.2)).judgement
    assert end.error == pytest.approx(-0.15)
    assert end.error_frames is None
    assert success(800.0, position=1.15, frame_of_truth=math.nan, depth_of_focus=(1.1, 1.2)) == (False, False, True)


@pytest.mark.parametrize("ends", [(math.nan, math.nan), (0.5, 0.5), (0.4, math.inf)])
def test_without_a_depth_of_focus_the_error_stands_and_success_is_unknown(ends):
    assert judged_dof(ends) is None
    one = judged(480.0, depth_of_focus=ends).judgement
    assert one.error == pytest.approx(0.1)
    assert (one.error_dof, one.blur_px) == (None, None)
    assert success(480.0, depth_of_focus=ends) == (None,) * 3
    assert success(None, depth_of_focus=ends) == (None,) * 3


def test_the_ends_of_the_depth_of_focus_may_come_in_either_order():
    assert judged(480.0, depth_of_focus=(0.55, 0.45)) == judged(480.0, depth_of_focus=(0.45, 0.55))


THERE_AND_BACK = np.concatenate([SWEEP, SWEEP[-2::-1]])  # frame t is at t/800, then at (1600 - t)/800


@pytest.mark.parametrize(("frame", "crossing"), [(430.0, 400.0), (799.0, 400.0), (801.0, 1200.0), (1150.0, 1200.0)])
def test_an_error_in_frames_is_to_the_crossing_nearest_to_the_answer(frame, crossing):
    verdict = judged(frame, path=THERE_AND_BACK).judgement
    assert verdict.truth_frame == crossing
    assert verdict.error_frames == frame - crossing
    assert verdict.error == pytest.approx(lens_position(frame, THERE_AND_BACK) - 0.5)


def test_without_an_answer_the_frame_of_truth_is_the_first_pass():
    assert judged(None, path=THERE_AND_BACK).judgement.truth_frame == 400.0
    assert judged(None, path=THERE_AND_BACK, frame_of_truth=math.nan).judgement.truth_frame == 400.0
    assert judged(None, position=math.nan, frame_of_truth=math.nan).judgement.truth_frame is None


@pytest.mark.parametrize(("position", "error"), [(0.5, 0.0), (0.9, 0.4)])
def test_a_lens_that_holds_is_judged_by_its_position(position, error):
    still = np.full(801, position)
    verdict = judged(300.0, path=still, frame_of_truth=math.nan).judgement
    assert verdict.error == pytest.approx(error)
    assert verdict.error_dof == pytest.approx(error / 0.1)
    answered = success(300.0, path=still, frame_of_truth=math.nan)
    assert answered == tuple(abs(error) <= limit * 0.1 for limit in SUCCESS_LIMITS_DOF)
    assert verdict.error_frames == (0.0 if error == 0 else None)
    assert verdict.lens_travel == 0
    assert success(None, path=still, frame_of_truth=math.nan) == tuple(
        error > limit * 0.1 for limit in SUCCESS_LIMITS_DOF
    )


def test_at_rest_in_the_focus_every_frame_is_right():
    lens = np.concatenate([np.linspace(0, 0.5, 100), np.full(100, 0.5), np.linspace(0.5, 1, 100)])
    for frame in (99.0, 150.3, 200.0):
        assert judged(frame, path=lens, frame_of_truth=99.0).judgement.error_frames == 0
    assert judged(210.0, path=lens, frame_of_truth=99.0).judgement.error_frames == 10


def test_a_truth_that_moves_is_followed():
    """The truth goes from 0.75 of the travel to 0.25 while the lens sweeps: they meet at frame 400."""
    track = np.linspace(0.75, 0.25, 801)
    late = judged(480.0, track=track).judgement
    assert (late.truth, late.truth_frame) == (pytest.approx(0.45), 400.0)
    assert late.error == pytest.approx(0.6 - 0.45)
    assert late.error_frames == 80
    assert judged(480.0, track=track, frame_of_truth=math.nan).judgement.truth_frame == pytest.approx(400)
    assert judged(None, track=track).judgement.truth == 0.5
    still = judged(300.0, path=np.full(801, 0.3), track=track, frame_of_truth=math.nan).judgement
    assert still.error == pytest.approx(0.3 - (0.75 - 0.5 * 300 / 800))
    assert still.truth_frame == pytest.approx(720)  # the truth reaches the lens: 0.75 - 0.5·t/800 = 0.3
    assert success(None, path=np.zeros(801), track=track) == (True, True, True)


@pytest.mark.parametrize(
    ("seen", "answer", "lens", "travel"),
    [
        (801, 400.0, SWEEP, 1.5),
        (501, 400.0, SWEEP, 0.625 + 0.125),  # METHODS.md 11: stopping at p0 / 0.8 is about twice as cheap at p0 = 0.5
        (1601, None, THERE_AND_BACK, 2.0),
        (801, None, SWEEP, 1.0),
        (0, None, SWEEP, 0.0),
    ],
    ids=["full sweep", "early stop", "reversal", "abstention", "nothing seen"],
)
def test_lens_travel_is_the_way_of_the_lens_while_it_was_seen_and_back_to_the_answer(seen, answer, lens, travel):
    assert travel_to_answer(seen, answer, focus_position=lens) == pytest.approx(travel)


@pytest.mark.parametrize(
    ("gain", "ratio"),
    [
        ([[1.0], [1.0]], 1.0),
        ([[0.5], [2.0], [1.0]], 4.0),
        ([[1.0, 3.0], [0.5, 1.0]], 3.0),  # the light that changes more
        ([[0.0], [1.0]], 1000.0),  # a light that goes out
        ([[0.0, 2.0], [0.0, 1.0]], 2.0),  # a light that is never on
        ([[0.0], [0.0]], None),
        (np.zeros((0, 1)), None),
        ([[1.0], [math.nan]], None),
        ([[1.0, 1.0], [2.0, math.inf]], None),
    ],
    ids=str,
)
def test_the_light_ratio_is_brightest_over_darkest_if_it_is_known(gain, ratio):
    assert light_ratio(np.array(gain, dtype=np.float32)) == (None if ratio is None else pytest.approx(ratio))
    assert light_ratio(None) is None


def with_gaps(array, value):
    out = np.array(array, dtype=np.float64)
    out[[10, 700]] = value
    return out


@pytest.mark.parametrize("frame", [700.0, 480.0, None])
@pytest.mark.parametrize(
    "change",
    [
        {"position": math.nan},
        {"position": math.nan, "frame_of_truth": math.nan, "track": np.full(801, 0.5)},
        *({"track": with_gaps(np.full(801, 0.5), value)} for value in (math.nan, math.inf)),
        *({"path": with_gaps(SWEEP, value)} for value in (math.nan, math.inf)),
        {"path": np.empty(0)},
    ],
    ids=lambda change: "-".join(change),
)
def test_without_all_of_the_truth_or_of_the_lens_record_no_error_is_known(frame, change):
    """This holds for answers near a gap and far from it, and for abstentions."""
    verdict = judged(frame, **change).judgement
    assert (verdict.error, verdict.error_frames, verdict.error_dof, verdict.blur_px) == (None,) * 4
    assert success(frame, **change) == (None, None, None)
    if "path" in change:
        assert (verdict.position, verdict.lens_travel) == (None, None)
        assert (verdict.truth, verdict.truth_frame) == (0.5, 400.0)
    else:
        assert verdict.position == (None if frame is None else pytest.approx(frame / 800))
        assert verdict.lens_travel == travel_to_answer(801, frame, focus_position=SWEEP)
        assert verdict.truth is None


def test_a_share_within_half_a_depth_of_focus_may_exceed_that_within_one():
    """The focus is 0.8 depths of focus outside the travel; an abstention is right if no answer could be right."""
    beyond = {"position": 1.08, "frame_of_truth": math.nan, "depth_of_focus": (1.03, 1.13)}
    assert success(None, **beyond) == (True, False, False)
    assert success(800.0, **beyond) == (False, True, True)
