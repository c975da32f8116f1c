"""The focus position of a sequence, with planted sweeps and truths for every bin of the axis, on both tracks."""

import math
from dataclasses import replace

import numpy as np
import pytest
from handmade_records import BLANK
from planted_sweeps import make_spikes

from saf_gen.benchmark.evaluate import evaluate
from saf_gen.benchmark.judgement import Run, judge
from saf_gen.benchmark.records import SUCCESS_LIMITS_DOF, Record
from saf_gen.benchmark.tracks.sequence_fields import describe_sequence, judge_crossing, judge_location, truncate_truth
from saf_gen.benchmark.tracks.tasks import select_sequences_to_evaluate
from saf_gen.core.seeds import make_generator
from saf_gen.leaderboard.results import by_axis
from saf_gen.optics.focus_crossings import focus_crossings
from saf_gen.parts import Answer
from saf_gen.stream.metadata import Truth
from saf_gen.stream.stream_file import open_stream
from saf_gen.stream.stream_writer import write_stream

FRAMES = 800
UP = np.linspace(0, 1, FRAMES, dtype=np.float32)
PART = np.linspace(0.5, 1, FRAMES, dtype=np.float32)  # of the travel
THERE_AND_BACK = np.concatenate([UP[::2], UP[::-2]]) * np.float32(0.5)


def truth(best, dof=0.02, *, lens=None, track=None):
    crossing = math.nan
    if lens is not None:
        found = focus_crossings(lens - (best if track is None else track), 0.0)
        crossing = float(found[0]) if found.size else math.nan
    return Truth(position=best, depth_of_focus=(best - dof / 2, best + dof / 2), frame=crossing, track=track)


PLANTED = [
    ("early in a part of the travel", PART, 0.52, "first 10 %"),
    ("the middle of the travel, the beginning of the sweep", PART, 0.501, "first 10 %"),
    ("in the middle of a part of the travel", PART, 0.72, "middle"),
    ("where the sweep went in the other direction", PART[::-1].copy(), 0.98, "first 10 %"),
    ("just before the beginning", PART, 0.485, "first 10 %"),
    ("before the beginning", PART, 0.4, "outside"),
    ("beyond the turn, and near it", THERE_AND_BACK, 0.51, "middle"),
    ("beyond the turn", THERE_AND_BACK, 0.6, "outside"),
    ("where the lens rests", np.full(FRAMES, 0.5, np.float32), 0.51, "first 10 %"),
]


def successes(run, known, **what):
    """Return whether a run is a success within each limit."""
    judgement = judge(run, known, end_s=lambda frames: frames / 20_000)
    return tuple(map(Record(BLANK.who, replace(BLANK.what, **what), judgement).success, SUCCESS_LIMITS_DOF))


def binned(records):
    (table,) = (t for t in by_axis(records, [records[0].who.method]) if t.axis.name == "focus_position")
    (found,) = table.bins
    return found.name


@pytest.mark.parametrize(("lens", "best", "where"), [p[1:] for p in PLANTED], ids=[p[0] for p in PLANTED])
def test_on_a_recording_it_lies_where_the_sweep_meets_it(tmp_path, lens, best, where):
    """The bin does not depend on the answer, and is "outside" exactly if an abstention succeeds."""
    known = truth(best, lens=lens)
    write_stream(tmp_path / "a.h5", make_spikes(400, shape=(FRAMES, 8, 8)), focus_position=lens, truth=known)
    lines = (f'{{"method": "m{f}", "sequence": "a", "frame": {f}}}\n' for f in ("null", 5, 700))
    (tmp_path / "p.jsonl").write_text("".join(lines))
    abstained, *answered = evaluate(
        tmp_path / "a.h5", methods=[], predictions=tmp_path / "p.jsonl", region="frame"
    ).records
    assert binned([abstained]) == where
    assert {binned([r]) for r in answered} == {where}
    assert abstained.success() is (where == "outside")
    assert not (where == "outside" and any(r.success() for r in answered))


@pytest.mark.parametrize(("best", "where"), [(0.5, (0.5, 0.0)), (-0.015, (0.0, 0.75)), (-0.03, (None, 1.5))])
def test_in_the_closed_loop_the_focus_position_is_that_in_the_travel(best, where):
    """An abstention succeeds if the focus is more than 1 depth of focus outside the travel."""
    known = truth(best, lens=PART)
    location, off = judge_location(known)
    assert (location, off) == (where[0], pytest.approx(where[1]))
    run = Run(Answer(), "", np.full(10, 0.3), frames_seen=10, windows=1, seconds=0.0, commands=(0.3,))
    assert tuple(off > limit for limit in SUCCESS_LIMITS_DOF) == successes(run, known, track="closed_loop")


def test_a_focus_that_moves_lies_where_the_lens_first_meets_it():
    """The focus goes from 0.9 to 0.1 of the travel while the lens goes from 0 to 1: they meet in the middle."""
    track = np.linspace(0.9, 0.1, FRAMES)
    known = truth(0.5, lens=UP, track=track)
    location, off = judge_crossing(known, UP)
    assert location == pytest.approx(0.5, abs=1e-3)
    assert off == pytest.approx(0, abs=0.1)
    assert judge_location(known) == (0.5, 0.0)
    away = truth(1.5, lens=UP, track=np.linspace(1.6, 1.4, FRAMES))
    assert judge_crossing(away, UP)[0] is None
    assert judge_location(away) == (None, pytest.approx(20))


def test_the_pass_that_the_stream_names_is_the_first():
    """The target was not visible at earlier crossings; see saf_gen.stack.true_focus."""
    both = replace(truth(0.3), frame=700.0)
    assert judge_crossing(both, THERE_AND_BACK)[0] == pytest.approx(700.5 / FRAMES)


@pytest.mark.parametrize(
    ("known", "lens"),
    [
        (Truth(), UP),
        (truth(0.5), None),
        (truth(0.5), np.zeros(0, np.float32)),
        (truth(0.5), np.where(UP > 0.9, np.nan, UP)),
        (truth(0.5, track=np.full(FRAMES, np.nan)), UP),
    ],
    ids=["no truth", "no lens", "no frame", "a lens with gaps", "a track with gaps"],
)
def test_without_truth_lens_or_track_the_location_is_unknown(known, lens):
    assert judge_crossing(known, lens) == (None, None)
    assert judge_location(Truth()) == judge_location(truth(0.5, track=np.full(9, np.nan))) == (None, None)


def test_without_a_depth_of_focus_only_what_is_met_is_known():
    met, never = Truth(position=0.75), Truth(position=0.2)
    assert judge_crossing(met, PART) == (pytest.approx(0.5, abs=1e-3), None)
    assert judge_crossing(never, PART) == (None, None)
    assert judge_location(met) == (0.75, 0.0)
    assert judge_location(Truth(position=1.2)) == (None, None)


def test_outside_is_where_an_abstention_is_right_for_any_lens_and_truth():
    """300 random lenses, truths and tracks agree with saf_gen.benchmark.judgement.judge; seed below."""
    random, seen = make_generator("test_reach", "judge"), set()
    for _ in range(300):
        lens = np.cumsum(random.normal(0, 0.01, 60)) + random.uniform(0, 1)
        lens = lens.astype(np.float32)
        drift = np.linspace(0, random.uniform(-0.3, 0.3), 60)
        track = random.uniform(0, 1) + drift if random.random() < 0.3 else None
        known = truth(float(random.uniform(-0.3, 1.3)), dof=float(random.uniform(0.01, 0.2)), track=track)
        location, off = judge_crossing(known, lens)
        run = Run(Answer(), "", lens, frames_seen=60, windows=1, seconds=0.0)
        right = successes(run, known, focus_off_dof=off)
        nearest = np.abs(lens - (known.position if track is None else track)).min() / (
            2 * known.position - 2 * known.depth_of_focus[0]
        )
        assert right == tuple(nearest > limit for limit in SUCCESS_LIMITS_DOF)
        assert (location is None) == right[1]
        seen.add(right)
    assert len(seen) == 4


def test_of_a_closed_loop_only_its_frames_count(tmp_path):
    """The light rises from 1 to 4 and the focus drifts from 0.2 to 0.8; the closed loop uses 200 of the 800 frames."""
    drift, ramp = np.linspace(0.2, 0.8, FRAMES), np.linspace(1, 4, FRAMES, dtype=np.float32)
    known = Truth(position=0.5, frame=400.0, depth_of_focus=(0.49, 0.51), track=drift)
    write_stream(
        tmp_path / "a.h5", np.zeros((FRAMES, 8, 8), np.uint8), focus_position=UP, truth=known,
        gain=ramp[:, None], light_names=("lamp",),
    )  # fmt: skip
    (task,) = select_sequences_to_evaluate(tmp_path / "a.h5").tasks
    light = np.arange(FRAMES) + 0.5, ramp / 10
    with open_stream(task.path) as stream:
        recorded = describe_sequence(task, stream, rate=light, blank=None, track="recorded")
        every, first = (
            describe_sequence(task, stream, rate=light, blank=None, track="closed_loop", frames=n) for n in (None, 200)
        )
    assert (recorded.track, first.track) == ("recorded", "closed_loop")
    assert recorded.focus_place == pytest.approx(400.5 / FRAMES)
    assert (every.focus_place, every.light_ratio) == (0.5, pytest.approx(4, rel=1e-3))
    assert first.focus_place == pytest.approx(drift[199])  # the recorded lens meets it later
    assert first.light_ratio == pytest.approx(ramp[199], rel=1e-3)
    assert first.mean_rate == pytest.approx(ramp[:200].mean() / 10)


def test_a_focus_that_comes_into_reach_later_is_outside_until_then():
    approaching = truth(0.9, track=np.linspace(1.3, 0.9, FRAMES))
    assert judge_location(approaching) == (0.9, 0.0)
    location, off = judge_location(truncate_truth(approaching, 200))
    assert location is None
    assert off > SUCCESS_LIMITS_DOF[1]
    assert truncate_truth(approaching, FRAMES) is approaching
    met = replace(approaching, frame=100.0)
    assert truncate_truth(met, 200).position == 0.9
