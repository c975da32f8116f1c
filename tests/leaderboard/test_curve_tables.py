import csv

import numpy as np
import pytest

from saf_gen.benchmark.results import FocusCurve, SweepSummary
from saf_gen.leaderboard import assess_curves, summarise_measures, write_curve_tables
from saf_gen.leaderboard.curve_tables import QUALITY_MEANINGS

LENS = np.linspace(0, 1, 800, dtype=np.float32)
CENTRES = np.arange(0, 800, 50) + 24.5
BLOCK = 50 / 799  # of the travel


def sweep(light="constant", *, lens=LENS, measures=("sd", "sd_code", "er_count"), **more):
    """A sweep with the focus at frame 300, and a light that grows."""
    bump = np.exp(-(((CENTRES - 300) / 90) ** 2))
    scores = {"sd": bump, "sd_code": 1e5 * bump, "er_count": np.linspace(1, 2, CENTRES.size)}
    known = {"truth": 0.375, "depth_of_focus": (0.33, 0.42), "truth_frame": 300.0}
    return SweepSummary(
        sequence=f"camel-{light}",
        split="test",
        scene="camel",
        light=light,
        focus_position=lens,
        frames=CENTRES,
        rate=np.full(CENTRES.size, 0.2),
        curves=tuple(FocusCurve(m, CENTRES, scores[m], float(CENTRES[scores[m].argmax()])) for m in measures),
        **{**known, **more},
    )


def with_scores(scores, **more):
    """A sweep with one measure, ``m``, that scores so."""
    one = sweep(measures=(), **more)
    return SweepSummary(**{**vars(one), "curves": (FocusCurve("m", CENTRES, np.asarray(scores), None),)})


def lines_of(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_a_curve_is_judged_over_the_lens_against_the_truth():
    (row, *_) = assess_curves([sweep()])  # sharpest in the block at 274.5 or 324.5, the truth at frame 300
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
    assert row.quality.accuracy == pytest.approx(
        abs(at / 799 - np.interp(at, np.arange(800), track)), abs=1e-6
    )


def test_a_lens_that_comes_back_or_is_not_recorded_gives_no_quality_and_is_counted():
    there_and_back = np.concatenate([LENS[::2], LENS[::-2]])
    rows = assess_curves([sweep(), sweep(lens=there_and_back), sweep(lens=None), with_scores(np.ones(16))])
    assert [r.quality is None for r in rows if r.measure == "sd"] == [False, True, True]
    assert rows[-1].quality is None
    by_name = {row.measure: row for row in summarise_measures(rows)}
    assert (by_name["sd"].curves, by_name["sd"].without_quality) == (3, 2)
    assert (by_name["m"].curves, by_name["m"].without_quality, by_name["m"].medians["range"]) == (1, 1, None)


def test_measures_stand_by_their_accuracy_and_have_medians():
    nan = float("nan")
    blind = sweep(truth=nan, truth_frame=nan, depth_of_focus=(nan, nan), measures=("sd",))
    rows = summarise_measures(assess_curves([sweep(), sweep("ramp")]))
    assert [row.measure for row in rows] == ["sd", "sd_code", "er_count"]
    assert rows[2].medians["accuracy"] == pytest.approx(CENTRES[-1] / 799 - 0.375)
    assert rows[2].medians["width_50"] is None
    (unknown,) = summarise_measures(assess_curves([blind]))
    assert (unknown.medians["accuracy"], unknown.medians["accuracy_dof"]) == (None, None)
    assert unknown.medians["range"] is not None


def test_the_files_tell_curves_and_measures(tmp_path):
    paths = write_curve_tables(tmp_path, [sweep(), sweep("ramp", lens=None)])
    assert [p.name for p in paths] == ["curves.csv", "measures.csv"]
    curves, measures = map(lines_of, paths)
    assert len(curves) == 6
    assert (curves[0]["measure"], curves[0]["sequence"], curves[0]["light"]) == (
        "sd",
        "camel-constant",
        "constant",
    )
    assert float(curves[0]["truth"]) == 0.375
    assert float(curves[0]["depth_of_focus"]) == pytest.approx(0.09)
    assert curves[3]["range"] == curves[3]["peak"] == ""
    assert [m["measure"] for m in measures] == ["sd", "sd_code", "er_count"]
    assert set(measures[0]) == {"measure", "curves", "without", *QUALITY_MEANINGS}
    assert measures[0]["without"] == "1"


def test_without_a_curve_nothing_is_written(tmp_path):
    assert write_curve_tables(tmp_path, [sweep(measures=())]) == []
    assert list(tmp_path.iterdir()) == []


def test_a_lens_or_a_track_that_is_not_known_in_every_frame_gives_nothing_that_hangs_on_it():
    lens, track = np.linspace(0, 1, 800), np.full(800, 0.375)
    lens[3] = track[3] = float("nan")
    (row,) = assess_curves([sweep(lens=lens, measures=("sd",))])
    assert row.quality is None
    (row,) = assess_curves([sweep(track=track, measures=("sd",))])
    assert (row.quality.accuracy, row.quality.accuracy_dof) == (None, None)
    assert row.quality.range is not None
