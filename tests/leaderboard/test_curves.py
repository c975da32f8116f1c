import csv

import numpy as np
import pytest
from handmade_evaluations import CENTRES, LENS, make_sweep, write_board

from saf_gen.benchmark.results import FocusCurve, SweepSummary
from saf_gen.benchmark.sequence_evaluation import assess_curves
from saf_gen.leaderboard.tables import rank_measures

BLOCK = 50 / 799  # of the travel


def with_scores(scores, **more):
    """A sweep with one measure, ``m``, and these scores."""
    one = make_sweep(measures=(), **more)
    return SweepSummary(**{**vars(one), "curves": (FocusCurve("m", CENTRES, np.asarray(scores), None),)})


def lines_of(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_a_curve_is_judged_over_the_lens_against_the_truth():
    (row, *_) = assess_curves([make_sweep()])  # sharpest near frame 300, the truth
    assert row.measure == "sd"
    assert row.quality.accuracy == pytest.approx(abs(row.quality.peak - 0.375))
    assert row.quality.accuracy < BLOCK
    assert row.quality.accuracy_dof == pytest.approx(row.quality.accuracy / 0.09)
    assert row.quality.width_50 == pytest.approx(2 * 90 * np.sqrt(np.log(2)) / 799, abs=BLOCK / 2)


def test_of_a_truth_that_moves_that_of_the_peak_counts():
    track = np.linspace(0.5, 0.3, 800)
    peak = np.exp(-(((CENTRES - 400) / 90) ** 2))
    (row,) = assess_curves([with_scores(peak, track=track)])
    at = CENTRES[peak.argmax()]
    assert row.quality.accuracy == pytest.approx(abs(at / 799 - np.interp(at, np.arange(800), track)), abs=1e-6)


def test_a_lens_that_comes_back_or_is_not_recorded_gives_no_quality_and_is_counted():
    there_and_back = np.concatenate([LENS[::2], LENS[::-2]])
    rows = assess_curves(
        [make_sweep(), make_sweep(lens=there_and_back), make_sweep(lens=None), with_scores(np.ones(16))]
    )
    assert [r.quality is None for r in rows if r.measure == "sd"] == [False, True, True]
    assert rows[-1].quality is None
    by_name = {row.measure: row for row in rank_measures(rows)}
    assert (by_name["sd"].curves, by_name["sd"].without) == (3, 2)
    assert (by_name["m"].curves, by_name["m"].without, by_name["m"].medians["range"]) == (1, 1, None)


def test_measures_stand_by_their_accuracy_and_have_medians():
    nan = float("nan")
    blind = make_sweep(truth=nan, truth_frame=nan, depth_of_focus=(nan, nan), measures=("sd",))
    rows = rank_measures(assess_curves([make_sweep(), make_sweep("ramp")]))
    assert [row.measure for row in rows] == ["sd", "sd_code", "er_count"]
    assert rows[2].medians["accuracy"] == pytest.approx(CENTRES[-1] / 799 - 0.375)
    assert rows[2].medians["width_50"] is None
    (unknown,) = rank_measures(assess_curves([blind]))
    assert (unknown.medians["accuracy"], unknown.medians["accuracy_dof"]) == (None, None)
    assert unknown.medians["range"] is not None


def test_the_files_contain_curves_and_measures(tmp_path):
    write_board(tmp_path, [], curves=assess_curves([make_sweep(), make_sweep("ramp", lens=None)]))
    curves, measures = (lines_of(tmp_path / name) for name in ("curves.csv", "measures.csv"))
    assert len(curves) == 6
    assert (curves[0]["measure"], curves[0]["sequence"], curves[0]["light"]) == ("sd", "camel-constant", "constant")
    assert float(curves[0]["truth"]) == 0.375
    assert float(curves[0]["depth_of_focus"]) == pytest.approx(0.09)
    assert curves[3]["range"] == curves[3]["peak"] == ""
    assert [m["measure"] for m in measures] == ["sd", "sd_code", "er_count"]
    assert measures[0]["without"] == "1"


def test_without_a_curve_nothing_is_written(tmp_path):
    write_board(tmp_path, [], curves=assess_curves([make_sweep(measures=())]))
    assert not {"curves.csv", "measures.csv"} & {path.name for path in tmp_path.iterdir()}


def test_figures_that_need_a_lens_or_track_with_gaps_are_unknown():
    lens, track = np.linspace(0, 1, 800), np.full(800, 0.375)
    lens[3] = track[3] = float("nan")
    (row,) = assess_curves([make_sweep(lens=lens, measures=("sd",))])
    assert row.quality is None
    (row,) = assess_curves([make_sweep(track=track, measures=("sd",))])
    assert (row.quality.accuracy, row.quality.accuracy_dof) == (None, None)
    assert row.quality.range is not None
