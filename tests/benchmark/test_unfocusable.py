"""Recordings in which nobody can find the focus, and answers that rest on nothing, count for no method."""

import numpy as np
import pytest
from handmade_records import record

from saf_gen import write_stream
from saf_gen.benchmark.evaluate import evaluate
from saf_gen.benchmark.records import read_records, write_records
from saf_gen.core.seeds import make_generator
from saf_gen.errors import BadInput
from saf_gen.leaderboard.ranking import rank_methods
from saf_gen.leaderboard.results import warnings_on
from saf_gen.parts import Answer

FRAMES = 800
SWEEP = np.linspace(0, 1, FRAMES, dtype=np.float32)
NOISE = (make_generator("unfocusable", 1).random((FRAMES, 8, 16)) < 0.2).astype(np.uint8)
NONE, ALL = np.zeros_like(NOISE), np.ones_like(NOISE)
ONE_SPIKE, ONE_GAP = NONE.copy(), ALL.copy()
ONE_SPIKE[-1, -1, -1], ONE_GAP[-1, -1, -1] = 1, 0  # in the last readout, which no block of the mean rate holds

RECORDINGS = {
    "without a spike": (NONE, SWEEP, 0.25, "no spikes"),
    "a spike in every readout": (ALL, SWEEP, 0.25, "all spikes"),
    "one spike at the end": (ONE_SPIKE, SWEEP, 0.25, None),
    "one gap at the end": (ONE_GAP, SWEEP, 0.25, None),
    "lens at rest": (NOISE, 0 * SWEEP + 0.3, 0.25, "lens at rest"),
    "lens at rest, its log noisy": (NOISE, 0.3 + 1e-3 * np.sin(np.arange(FRAMES)), 0.25, "lens at rest"),
    "lens moves by a quarter of the depth of focus": (NOISE, 0.3 + SWEEP / 40, 0.25, None),
    "truth outside the log": (NOISE, 0.5 + SWEEP / 2, 0.25, "focus not reached"),
    "truth just outside the log, within a depth of focus": (NOISE, 0.3 + 0.7 * SWEEP, 0.25, None),
    "no log": (NOISE, None, 0.25, None),
    "no truth": (NOISE, SWEEP, None, None),
    "dark and at rest": (NONE, 0 * SWEEP, 0.25, "no spikes"),
}
METHODS = ("sd_code+sgfs_code", "sd_code+egs_code", "sd+argmax", "vollath_f4_n+argmax", "sd+sgfs_causal")


def record_of(tmp_path, frames, lens, truth, methods, **options):
    more = {} if truth is None else {"truth": {"position": truth, "depth_of_focus": (truth - 0.05, truth + 0.05)}}
    write_stream(tmp_path / "a.h5", frames, focus_position=lens, **more)
    return evaluate(tmp_path / "a.h5", methods=methods, **options).records


@pytest.mark.parametrize(("frames", "lens", "truth", "obstacle"), RECORDINGS.values(), ids=RECORDINGS)
def test_what_keeps_every_method_from_the_focus_is_named(tmp_path, frames, lens, truth, obstacle):
    (found,) = record_of(tmp_path, frames, lens, truth, ["sd+argmax"])
    assert found.what.obstacle == obstacle


@pytest.mark.slow
@pytest.mark.parametrize("frames", [NONE, ALL], ids=["none", "all"])
def test_no_method_answers_a_blank_recording_and_none_is_judged_on_it(tmp_path, frames):
    (tmp_path / "p.jsonl").write_text('{"method": "guess", "sequence": "a", "frame": 200.0}\n')
    found = record_of(tmp_path, frames, SWEEP, 0.25, METHODS, predictions=tmp_path / "p.jsonl")
    assert len(found) == len(METHODS) + 1
    for one in found:
        assert (one.judgement.status, one.success(), one.judgement.error) == ("abstained", None, None), one.who.method
        assert one.judgement.note.startswith("no answer: ")
    rows = rank_methods(
        [
            *found,
            *(record(r.who.method, "other", 0.1, code=r.who.code, rig=r.what.rig, region=r.who.region) for r in found),
        ]
    )
    assert {row.answerable_1dof for row in rows} == {1.0}


@pytest.mark.parametrize("region", ["target", "frame"])
def test_an_answer_from_equal_scores_is_no_answer(tmp_path, region):
    """A pixel alone has no contrast: every score of a measure of contrast is 0."""
    found = record_of(tmp_path, NOISE[:, :1, :1], SWEEP, 0.25, ["sd+argmax", "er_count+argmax"], region=region)
    by_method = {r.who.method: r for r in found}
    assert by_method["sd+argmax"].judgement.note == "no answer: all 8 scores are equal"
    assert by_method["sd+argmax"].success() is False
    assert by_method["er_count+argmax"].judgement.status == "answered"


def two_scores(view):
    view.score(0, 400), view.score(400, 800)
    return Answer(200.0)


def scores_and_a_picture(view):
    view.counts(0, 400)
    return two_scores(view)


def two_measures(view):
    for measure in ("sd", "er_count"):
        view.score(0, 400, measure), view.score(400, 800, measure)
    return Answer(200.0)


SEARCHES = {
    "two scores of 0": (two_scores, "abstained"),
    "one score": (lambda view: Answer(200.0 + view.score(0, 400)), "answered"),
    "no score, but a picture": (lambda view: Answer(200.0 + view.counts(0, 400).min()), "answered"),
    "equal scores and a picture": (scores_and_a_picture, "answered"),
    "another measure whose scores differ": (two_measures, "answered"),
    "nothing seen": (lambda view: Answer(200.0), "answered"),
    "nothing said": (lambda view: Answer(note=f"{view.score(0, 9)} {view.score(9, 18)}"), "abstained"),
}


@pytest.mark.parametrize(("call", "status"), SEARCHES.values(), ids=SEARCHES)
def test_only_scores_that_a_method_asked_for_take_its_answer(tmp_path, register, call, status):
    register("searches", "mine", call)
    (found,) = record_of(tmp_path, NOISE[:, :1, :1], SWEEP, 0.25, ["sd+mine"])
    assert found.judgement.status == status


def test_a_search_that_never_looked_has_no_costs(tmp_path, register):
    register("searches", "mine", lambda view: Answer(200.0))
    (found,) = record_of(tmp_path, NOISE, SWEEP, 0.25, ["sd+mine"])
    cost = found.judgement
    assert (cost.frames_seen, cost.time_to_focus_s, cost.lens_travel) == (0, None, None)


def test_a_leaderboard_counts_what_cannot_be_focused_apart_and_names_it():
    blank = dict.fromkeys(("frame", "position"))
    records = [
        record("sd+argmax", "good", 0.1),
        *(record("sd+argmax", f"dark{n}", None, status="abstained", obstacle="no spikes", **blank) for n in range(5)),
        record("sd+argmax", "still", 0.1, obstacle="lens at rest"),
    ]
    (note,) = (text for text in warnings_on(rank_methods(records), records) if "cannot be focused" in text)
    assert note.startswith("6 of 7 sequences cannot be focused: 5 with no spikes")
    assert "(dark0, dark1, dark2 and 2 more); 1 with a lens at rest" in note


def test_a_record_that_answers_a_blank_recording_contradicts_itself(tmp_path):
    write_records(tmp_path / "records.jsonl", [record("sd+argmax", "a", None, obstacle="no spikes")])
    with pytest.raises(BadInput, match="a recording of no spikes"):
        read_records(tmp_path)
