"""The answer of a recording without a truth: the densest place of the measures that do not follow the light."""

import json
import re

import numpy as np
import pytest
from handmade_evaluations import board_of
from handmade_records import change, failed, record
from refusals import assert_says, refusal

import saf_gen
from saf_gen.benchmark.tracks.tasks import SequenceTask
from saf_gen.leaderboard.agreement import agree, read_agreement
from saf_gen.leaderboard.report import write_evaluation
from saf_gen.leaderboard.report.pictures import picture_answers

MEASURES = ("sd", "sd_code", "cen", "gradient_code_n", "mfdct_lee_n", "octave_structure", "vollath_f4_n")
LIGHT = ("er_count", "er_sumsq", "gradient_code")
"""Measures whose scores grow with the light."""


def answer(method, position, *, lens=True, sequence="s"):
    where = {"position": position if lens else None, "frame": 800 * position}
    return record(method, sequence, None, scene=sequence, **where)


def answers(*positions, lens=True, sequence="s"):
    """Return the answers of measures at these positions, and of all that follow the light at the end of the travel."""
    made = [
        answer(f"{name}+argmax", at, lens=lens, sequence=sequence)
        for name, at in zip(MEASURES, positions, strict=False)
    ]
    return [*made, *(answer(f"{name}+argmax", 0.99, lens=lens, sequence=sequence) for name in LIGHT)]


@pytest.mark.parametrize(
    ("positions", "share", "places"),
    [
        ((0.40, 0.41, 0.42, 0.43), 1.0, (0.41,)),  # any two within 4 % of the middle one
        ((0.2, 0.22, 0.24, 0.9), 0.75, (0.22,)),  # the median of all is 0.23
        ((0.1, 0.12, 0.8, 0.82, 0.84), 0.6, (0.82, 0.1)),  # two depths: both, the denser first
        ((0.1, 0.3, 0.5, 0.7, 0.9), 0.2, (0.1, 0.3)),
    ],
)
@pytest.mark.parametrize("lens", [True, False])
def test_the_answer_is_the_densest_place_and_below_70_percent_the_next_stands_beside_it(positions, share, places, lens):
    agreement = agree(answers(*positions, lens=lens))
    assert agreement.share == pytest.approx(share)
    assert agreement.agrees == (len(places) == 1)
    assert [place.frame / 800 for place in agreement.places] == pytest.approx(places)
    assert [place.position for place in agreement.places] == (list(places) if lens else [None] * len(places))
    assert set(agreement.asked) == set(MEASURES[: len(positions)])


def test_each_measure_of_saf_gen_has_one_vote_that_of_argmax_first():
    others = [answer("sd+egs_code", 0.9), answer("sd+argmax:window=50", 0.4), answer("my.py:blur+argmax", 0.9)]
    votes = [answer("cen+egs", 0.41), answer("octave_structure+peak_fit", 0.42), answer("er_count_n_tfi+argmax", 0.4)]
    agreement = agree([*others, *votes])
    assert set(agreement.asked) == {"sd", "cen", "octave_structure", "er_count_n_tfi"}
    assert agreement.share == 1.0


def test_a_measure_that_gives_no_answer_has_a_vote_for_no_place():
    silent = [failed(f"{name}+argmax", "s", "abstained") for name in MEASURES[4:6]]
    assert agree([*answers(0.4, 0.4, 0.4, 0.4), *silent]).share == pytest.approx(4 / 6)


@pytest.mark.parametrize("obstacle", ["lens at rest", "no spikes"])
def test_a_recording_that_cannot_be_focused_has_no_answer(obstacle):
    agreement = agree([change(one, obstacle=obstacle) for one in answers(0.4, 0.4, 0.4)])
    assert (agreement.places, agreement.share) == ((), 0.0)
    assert agreement.describe() == "No answer: none of 3 measures found a focus in s."


def test_one_recording_without_a_truth_gives_answers_in_place_of_ranks():
    board = board_of(answers(0.40, 0.41, 0.42, 0.43))
    assert [column.header for column in board.ranking.shown] == ["method", "frame", "position", "seconds"]
    assert [row.method for row in board][:2] == ["sd+argmax", "sd_code+argmax"]  # in the order of their frames
    assert board.lead == [
        "s is sharpest at frame 328, position 0.410: 4 of 4 measures agree (100%): sd, sd_code, cen, gradient_code_n."
    ]
    assert board.notes[0] == "Not asked, because their scores grow with the light: er_count, er_sumsq, gradient_code."
    assert_says_how_to_add_a_truth(board)
    assert board.to_dicts()[0] | {"rank": None, "frame": 320.0, "position": 0.4} == board.to_dicts()[0]


def assert_says_how_to_add_a_truth(board):
    assert "--truth POSITION" in board.notes[-1]


def test_without_a_lens_log_positions_are_unknown():
    board = board_of(answers(0.40, 0.41, 0.42, lens=False))
    assert board.lead == ["s is sharpest at frame 328: 3 of 3 measures agree (100%): sd, sd_code, cen."]
    assert repr(board).splitlines()[2].split() == ["sd+argmax", "320", "–", "0.250"]


def test_measures_that_disagree_are_said_to_with_both_places():
    lead = board_of(answers(0.1, 0.12, 0.8, 0.82, 0.84)).lead[0]
    assert lead.startswith("The measures disagree on s: 3 of 5 measures (60%) agree on frame 656, position 0.820, 2 on")
    assert lead.endswith("The light leads some of them, or the scene has several depths.")


def test_several_recordings_have_a_table_of_agreement():
    board = board_of([*answers(0.4, 0.4, 0.4, sequence="a"), *answers(0.1, 0.5, 0.9, sequence="b")])
    assert board.lead == ["At least 70% of the measures agree on 1 of 2 recordings."]
    assert [[column.text(one) for column in board.agreement.columns] for one in board.agreements] == [
        ["a", "100%", "320", "0.400", "–", "–"],
        ["b", "33%", "80", "0.100", "400", "0.500"],
    ]


def test_fewer_than_three_measures_give_no_answer_of_all_and_a_truth_none_either():
    assert board_of(answers(0.4, 0.4)).lead == [
        "No answer of all: that takes 3 measures of saf_gen that do not follow the light. Add -m baselines."
    ]
    judged = board_of([record(f"{name}+argmax", "s", 0.0) for name in MEASURES])
    assert judged.lead[0].startswith("Right within 1 DoF: 7 of 7 methods.")
    assert (judged.agreements, judged.lacks_truth) == ([], False)


@pytest.fixture
def evaluated(tmp_path):
    """A recording, and beside it an evaluation in which the measures disagree."""
    path = tmp_path / "my desk.h5"
    digest = saf_gen.write_stream(path, np.random.default_rng(1).random((800, 8, 12)) < 0.3)
    board = board_of([change(one, data=digest) for one in answers(0.1, 0.12, 0.8, 0.82, 0.84, sequence="my desk")])
    task = SequenceTask("my desk", None, "my desk", None, path, None)
    write_evaluation(tmp_path / "my desk-evaluation", board, title="my desk", delivered=picture_answers([task], board))
    return path, digest


def test_the_agreement_is_read_from_the_evaluation_beside_a_recording(evaluated):
    path, digest = evaluated
    assert [place.frame for place in read_agreement(path, digest).places] == pytest.approx([656, 80])
    error = refusal(read_agreement, path, "another digest")
    assert_says(error, f"my desk-evaluation is of another content | run saf-gen evaluate '{path}'")
    alone = path.rename(path.with_name("alone.h5"))
    error = refusal(read_agreement, alone, digest)
    assert_says(error, f"no evaluation of {alone} lies beside it | run saf-gen evaluate {alone}")


@pytest.mark.slow
def test_the_answer_is_drawn_at_both_places_where_the_measures_disagree(evaluated, call):
    out = evaluated[0].with_name("answer.png")
    code, said, err = call("view", evaluated[0], "--at", "answer", "--out", out)
    assert (code, out.is_file(), err) == (0, True, "")
    assert said.startswith("2 pictures of 80 frames each in ")
    assert "The measures disagree on my desk" in said


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--at", "answr"), "--at is 'answr' | allowed: answer, truth, or a position"),
        (("--at", "1.5"), "--at is '1.5' | 0 to 1"),
        (("--at", "nan"), "--at is 'nan'"),
        (("--at", "0.4"), "--at is a position | no log of the lens"),
        (("--at", "truth"), "--at truth: no true focus is known"),
        (("--at", "answer", "--from", 8), "--at is given with --from, --to or --every | leave them out"),
    ],
)
def test_other_places_and_views_of_an_answer_are_refused(evaluated, call, options, words):
    out = evaluated[0].with_name("answer.png")
    code, _, err = call("view", evaluated[0], "--out", out, *options)
    assert (code, out.exists()) == (2, False)
    for word in words.split(" | "):
        assert word in err


@pytest.mark.slow
@pytest.mark.parametrize(("place", "first"), [("truth", 600), ("0.25", 200)])
def test_a_picture_is_drawn_at_the_truth_or_at_a_position_of_the_lens(tmp_path, call, place, first):
    spikes = np.random.default_rng(1).random((800, 8, 12)) < 0.3
    lens = np.linspace(0, 1, 800, dtype=np.float32)
    saf_gen.write_stream(tmp_path / "a.h5", spikes, focus_position=lens, truth={"position": 0.75, "frame": 600.0})
    code, said, err = call("view", tmp_path / "a.h5", "--at", place, "--window", 40, "--out", tmp_path / "a.svg")
    assert (code, err) == (0, "")
    assert said.startswith("1 picture of 40 frames in ")
    shown = int(re.search(r"frames? ([\d,]+)", (tmp_path / "a.svg").read_text())[1].replace(",", ""))
    assert max(first - 20, 0) <= shown <= first + 1


def test_a_stated_truth_far_from_where_the_measures_agree_is_doubted():
    def board(truth):
        here = [answer(f"{name}+argmax", 0.6) for name in MEASURES]
        return board_of([change(one, truth=truth) for one in here])

    assert any("The stated focus, 0.300, is far from position 0.600" in words for words in board(0.3).last_words)
    assert not any("The stated focus" in words for words in board(0.55).last_words)


def test_page_and_files_open_with_the_answer_and_both_pictures(evaluated):
    folder = evaluated[0].with_name("my desk-evaluation")
    page, markdown = ((folder / name).read_text() for name in ("index.html", "leaderboard.md"))
    opening = page[: page.index('<section id="leaderboard">')]
    assert "The measures disagree on my desk" in opening
    assert opening.count('<div class="picture"') == 2
    assert "where most agree" in opening
    assert "frame 656, position 0.820" in opening
    assert "--truth POSITION" in opening
    assert "Right: within one depth of focus" not in page
    assert "The measures disagree on my desk" in markdown
    stated = json.loads((folder / "leaderboard.json").read_text())["agreements"][0]
    assert (stated["share"], [place["frame"] for place in stated["places"]]) == (0.6, [656.0, 80.0])
