"""The data of the page's charts, and the pictures of its viewers."""

import io
import json
from dataclasses import replace

import numpy as np
import pytest
from handmade_evaluations import CENTRES, LENS, make_lens_path, make_sweep, make_thumbnails
from handmade_records import record
from PIL import Image

from saf_gen.benchmark.results import Evaluation, FocusCurve
from saf_gen.leaderboard import Leaderboard
from saf_gen.leaderboard.report.charts import INK, MAX_LINES, SOFT, chart_sweep, make_charts, normalise
from saf_gen.leaderboard.report.pictures import build_viewer, image_strip, spike_strip

MEASURES = ("sd", "sd_code", "er_count")


def charts_of(made):
    return make_charts(Leaderboard.of(made))


def labels(chart):
    return [(line["label"], line["style"]) for line in chart.data["lines"]]


def test_normalised_scores_run_from_0_to_1_and_a_flat_curve_is_0():
    assert normalise(np.array([3.0, 5.0, 4.0])).tolist() == [0, 1, 0.5]
    assert normalise(np.array([2.0, 2.0])).tolist() == [0, 0]
    assert np.isnan(normalise(np.array([np.nan, 1.0, 2.0]))[0])


def test_a_chart_holds_curves_light_truth_and_answers_on_the_axis_of_the_lens():
    answers = [
        record("sd_code+egs_code", "camel-constant", 0.1, frame=300.0),
        record("er_count+egs_code", "camel-constant", 0.1, frame=799.0),
        record("sd+argmax", "camel-constant", None, frame=None),
        record("my_net", "camel-constant", 0.1, frame=0.0),
    ]
    chart = chart_sweep(make_sweep(), answers, measures=[*MEASURES, "my_net"])
    json.dumps(chart.data, allow_nan=False)
    assert chart.data["x"] == "focus position, fraction of travel"
    assert labels(chart) == [("sd = sd_code", 0), ("er_count", 1)]  # sd and sd_code have one curve up to a factor
    first = chart.data["lines"][0]
    assert first["x"] == pytest.approx(np.interp(CENTRES, np.arange(800), LENS), rel=1e-3)
    assert (min(first["y"]), max(first["y"])) == (0, 1)
    assert chart.data["area"]["y"] == [1.0] * CENTRES.size
    assert (chart.data["at"], chart.data["bands"]) == ([0.375], [[0.33, 0.42]])
    assert chart.data["rows"] == ["egs_code", "predictions"]
    assert [(mark[0], mark[3], mark[4]) for mark in chart.data["marks"]] == [
        (0, 0, "sd_code+egs_code"),
        (0, 1, "er_count+egs_code"),
        (1, 2, "my_net"),
    ]
    assert [mark[2] for mark in chart.data["marks"]] == pytest.approx([300 / 799, 1.0, 0.0], abs=1e-3)


def test_a_sweep_from_the_far_end_has_its_points_in_ascending_order():
    """The script joins lines by their x, which must ascend and be there once."""
    backwards = make_sweep(lens=LENS[::-1].copy(), truth=0.625, depth_of_focus=(0.58, 0.67))
    (line, _) = chart_sweep(backwards, [], measures=MEASURES).data["lines"]
    assert line["x"] == sorted(set(line["x"]))
    assert line["x"][int(np.argmax(line["y"]))] == pytest.approx(1 - 0.375, abs=0.05)


def test_a_lens_that_returns_is_a_line_over_frames_with_the_truth_at_each_crossing():
    lens = np.concatenate([LENS[::2], LENS[::-2]])
    chart = chart_sweep(make_sweep(lens=lens), [], measures=MEASURES)
    assert chart.data["x"] == "frame"
    assert labels(chart)[-1] == ("focus position", SOFT)
    assert chart.data["at"] == pytest.approx([150, 649], abs=1.5)
    assert len(chart.data["bands"]) == 2
    moving = make_sweep(lens=lens, track=np.linspace(0.3, 0.5, 800))
    assert labels(chart_sweep(moving, [], measures=MEASURES))[-1] == ("true focus", INK)


def test_unknown_numbers_are_none_and_a_truth_that_is_unknown_is_not_drawn():
    gap = FocusCurve("sd", CENTRES, np.where(CENTRES < 100, np.nan, CENTRES), 1.0)
    nowhere = make_sweep(truth=np.nan, truth_frame=np.nan, depth_of_focus=(np.nan, np.nan), measures=())
    chart = chart_sweep(replace(nowhere, curves=(gap,)), [], measures=MEASURES)
    assert chart.data["lines"][0]["y"][0] is None
    assert (chart.data["at"], chart.data["bands"]) == ([], [])
    json.dumps(chart.data, allow_nan=False)


def test_the_path_of_the_lens_is_a_line_for_each_method_in_the_depth_of_focus():
    methods = [f"m{number}+s" for number in range(MAX_LINES + 2)]
    records = tuple(record(m, "camel-constant", 0.1, track="closed_loop", terms="t") for m in methods)
    paths = tuple(make_lens_path(m, problem="late" if m == "m1+s" else "") for m in methods)
    *_, chart = charts_of(Evaluation(records, (), (), paths))
    assert chart.kind == "lens"
    assert labels(chart)[:2] == [("m0+s", 0), ("m1+s (failed)", 1)]
    assert labels(chart)[-1] == ("true focus", INK)
    assert chart.data["levels"] == [pytest.approx([0.33, 0.42])]
    assert chart.omission == f"Drawn: the first {MAX_LINES} of {MAX_LINES + 2} methods."


def test_profiles_are_lines_of_the_first_methods():
    records = tuple(record(f"m{n}+s", f"s{i}", 0.3 * n, scene=f"s{i}") for n in range(3) for i in range(4))
    (chart,) = charts_of(Evaluation(records, (), ()))
    assert (chart.kind, chart.data["log"], chart.data["percent"], chart.data["at"]) == ("profile", True, True, [1])
    assert labels(chart) == [("m0+s", 0), ("m1+s", 1), ("m2+s", 2)]
    assert chart.data["lines"][0]["y"] == [1.0] * len(chart.data["lines"][0]["x"])


def test_a_viewer_knows_where_each_picture_is_on_the_axis_of_its_chart():
    viewer = build_viewer(make_sweep(thumbnails=make_thumbnails()))
    assert viewer.x == pytest.approx((np.arange(16) + 0.5) / 16, abs=1e-3)
    assert viewer.start == 6
    assert viewer.descriptions[0].startswith("frame 24, lens at 0.031, −3.8 DoF from the focus")
    assert build_viewer(make_sweep()) is None


def test_an_image_strip_holds_its_pictures_in_order_within_its_bytes():
    made = image_strip(make_thumbnails(12).images, max_bytes=20_000)
    sheet = np.asarray(Image.open(io.BytesIO(made.file)).convert("L"), dtype=float)
    assert (made.columns, made.rows, made.size, made.count) == (8, 2, (32, 20), 12)
    assert sheet.shape == (40, 256)
    grey = [sheet[y : y + 20, x : x + 32].mean() for y in (0, 20) for x in range(0, 256, 32)]
    assert grey[:12] == sorted(grey[:12])
    assert grey[12:] == pytest.approx([0] * 4, abs=3)
    noise = np.random.default_rng(1).integers(0, 9, (8, 88, 140)).astype(np.uint32)
    large, small = (image_strip(noise, max_bytes=most) for most in (10**9, 4_000))
    assert len(large.file) > 20_000
    assert len(small.file) <= 4_000  # first with lower quality, then with smaller pictures
    assert (large.size, small.count) == ((140, 88), 8)
    assert small.size[0] < 140


def test_single_readouts_are_shown_bit_for_bit():
    spikes = np.random.default_rng(2).integers(0, 2, (10, 20, 32)).astype(np.uint8)
    made = spike_strip(spikes)
    sheet = np.asarray(Image.open(io.BytesIO(made.file)))
    assert (made.columns, made.rows, made.size, made.count) == (8, 2, (32, 20), 10)
    for number, frame in enumerate(spikes):
        row, column = divmod(number, 8)
        assert (sheet[20 * row : 20 * row + 20, 32 * column : 32 * column + 32] == frame).all()
