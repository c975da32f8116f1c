import math
import re
import xml.etree.ElementTree as ET
from dataclasses import replace

import matplotlib
import numpy as np
import pytest
from handmade_evaluations import CENTRES, LENS, make_lens_path, make_records, make_sweep, make_thumbnails
from handmade_records import failed, record

from saf_gen.core.figure_style import MAX_MEASURES, VARIABLES, assign_styles, inline_svg, plot_to_svg
from saf_gen.leaderboard.figures.comparisons import CONDITIONS, MAX_ROWS, bin_sequences, plot_condition, plot_errors
from saf_gen.leaderboard.figures.depth_of_focus import plot_depth_of_focus
from saf_gen.leaderboard.figures.figure import add_paper, describe_omissions, shorten
from saf_gen.leaderboard.figures.sweeps import plot_curves, plot_lens_paths, plot_steps

pytestmark = pytest.mark.slow

LOOKS = assign_styles(["sd", "sd_code", "er_count"])
RATIO, BUDGET = CONDITIONS


def curves(one, records=(), styles=LOOKS):
    return plot_curves(one, records, styles=styles, title="camel")


def main(figure):
    return figure.axes[1]  # below the answers


def curves_of(axes):
    return [line for line in axes.get_lines() if len(line.get_xdata()) == CENTRES.size]


def legend(figure):
    return [text.get_text() for text in figure.legends[0].get_texts()]


def test_a_figure_is_well_formed_the_same_each_time_and_changes_no_setting_of_matplotlib():
    before = dict(matplotlib.rcParams)
    one, other = (plot_to_svg(curves(make_sweep()), name="a") for _ in range(2))
    assert one == other
    assert dict(matplotlib.rcParams) == before
    texts = {"".join(e.itertext()).strip() for e in ET.fromstring(one).iter("{http://www.w3.org/2000/svg}text")}
    assert {"camel", "sd = sd_code", "er_count"} <= texts
    paper = next(e for e in ET.fromstring(add_paper(one)) if e.tag.endswith("rect"))
    assert paper.get("fill") == "#ffffff"


def test_within_a_page_colours_are_the_pages_and_names_do_not_meet():
    parts = [inline_svg(plot_to_svg(curves(make_sweep()), name=name), label=name) for name in ("a", "b")]
    ids = [re.findall(r' id="([^"]+)"', text) for text in parts]
    assert all(len(i) == len(set(i)) for i in ids)
    assert ids[0]
    assert not set(ids[0]) & set(ids[1])
    for text in parts:
        ET.fromstring(text)
        assert not set(re.findall(r"#[0-9a-f]{6}\b", text))
        assert set(re.findall(r"var\((--\w+)\)", text)) <= set(VARIABLES.values())
        used = set(re.findall(r'(?:url\(#|href="#)([^)"]+)', text))
        assert used == set(re.findall(r' id="([^"]+)"', text))
        assert "xlink" not in text.replace("xmlns:xlink", "")


def test_looks_differ_and_are_the_same_in_every_figure():
    names = [f"m{i}" for i in range(MAX_MEASURES * MAX_MEASURES)]
    styles = assign_styles(names)
    assert len({(s.colour, s.marker) for s in styles.values()}) == MAX_MEASURES * MAX_MEASURES
    assert len({(s.colour, s.dashes) for s in styles.values()}) == MAX_MEASURES * MAX_MEASURES
    assert len({s.colour for s in list(styles.values())[:MAX_MEASURES]}) == MAX_MEASURES


def test_curves_run_over_the_focus_position_with_the_truth_among_them():
    axes = main(curves(make_sweep()))
    sd, count = curves_of(axes)  # sd_code is proportional to sd, so they share a line
    np.testing.assert_allclose(sd.get_xdata(), CENTRES / 799, atol=1e-6)
    assert (count.get_ydata().min(), count.get_ydata().max()) == (0, 1)
    assert 0.375 in [line.get_xdata()[0] for line in axes.get_lines()]


def test_measures_whose_curves_coincide_share_a_line_else_not():
    assert legend(curves(make_sweep()))[:2] == ["sd = sd_code", "er_count"]
    other = make_sweep()
    moved = tuple(replace(c, scores=c.scores[::-1]) if c.measure == "sd" else c for c in other.curves)
    assert legend(curves(replace(other, curves=moved)))[:3] == ["sd", "sd_code", "er_count"]


def test_every_search_has_a_row_with_the_answers_of_its_measures():
    records = [
        record("sd+argmax", "x", 0.0, frame=300.0),
        record("er_count+argmax", "x", 3.0, frame=700.0),
        record("sd+egs_code", "x", 0.0, frame=310.0),
        failed("er_count+egs_code", "x", "abstained"),
        record("other+argmax", "x", 0.0, frame=5.0),
    ]
    strip = curves(make_sweep(), records).axes[0]
    assert [t.get_text() for t in strip.get_yticklabels()] == ["argmax", "egs_code"]
    marks = [line for line in strip.get_lines() if line.get_marker() in ("o", "D", "s")]
    rows = sorted((round(float(m.get_ydata()[0])), float(m.get_xdata()[0]) * 799) for m in marks)
    assert [row for row, _ in rows] == [0, 0, 1]
    assert [frame for _, frame in rows] == pytest.approx([300, 700, 310], abs=0.01)


def note(figure):
    """The note of a figure on what it leaves out."""
    return figure.legends[0].get_title().get_text()


def test_a_sweep_without_curves_has_light_lens_truth_and_answers():
    records = [
        record("sd+egs_code", "x", 0.0, frame=310.0),
        record("my_net", "x", 1.0, frame=400.0),
        failed("er_count+egs_code", "x", "abstained"),
    ]
    styles = assign_styles(["sd", "my_net", "er_count"])
    bare = make_sweep(measures=())
    figure = curves(bare, records, styles)
    strip, axes, light = figure.axes[0], main(figure), figure.axes[-1]
    assert [t.get_text() for t in strip.get_yticklabels()] == ["egs_code", "predictions"]
    assert legend(figure)[:2] == ["sd", "my_net"]
    assert 0.375 in [line.get_xdata()[0] for line in axes.get_lines()]
    assert light.collections

    resting = make_sweep(measures=(), lens=np.concatenate([LENS[::2], LENS[::-2]]))
    figure = curves(resting, records, styles)
    (lens,) = (line for line in main(figure).get_lines() if len(line.get_xdata()) == 400)
    assert lens.get_ydata().max() == pytest.approx(1, abs=0.01)
    one_block = replace(bare, frames=np.array([399.5]), rate=np.array([0.2]))
    ET.fromstring(plot_to_svg(curves(one_block, records, styles), name="a"))


def test_a_figure_states_what_it_leaves_out():
    assert describe_omissions((9, 14, "searches"), (8, 20, "measures")) == (
        "Drawn: the first 9 of 14 searches, the first 8 of 20 measures"
    )
    assert describe_omissions((2, 2, "searches")) == ""
    names = [f"m{i}" for i in range(MAX_MEASURES + 3)]
    styles = assign_styles(names)
    searches = [f"s{i}" for i in range(11)]
    answered = [record(f"{m}+{s}", "x", 0.1, frame=300.0, trace=(1.0, 9.0, 300.0)) for s in searches for m in names]
    both = "Drawn: the first {} of 11 searches, the first 8 of 11 measures"
    assert note(curves(make_sweep(measures=()), answered, styles)) == both.format(6)
    assert note(plot_steps(make_sweep(), answered, styles=styles, title="t")) == both.format(9)
    paths = [make_lens_path(r.method) for r in answered]
    assert note(plot_lens_paths(paths, styles=styles, title="t")) == both.format(9)
    many = plot_errors([record(f"m{i}+s", "x", 0.1) for i in range(MAX_ROWS + 10)], title="t")
    assert len(many.axes[0].get_yticklabels()) == MAX_ROWS
    assert note(many) == f"Drawn: the first {MAX_ROWS} of {MAX_ROWS + 10} methods"
    against = [record(f"{m}+s", f"{ratio}", 0.1, light_ratio=float(ratio)) for m in names for ratio in (1, 2, 4)]
    condition = plot_condition(against, RATIO, styles=styles, title="t")
    assert note(condition) == "Drawn: the first 8 of 11 measures"
    few = [r for r in answered if r.method in ("m0+s0", "m1+s0")]
    for figure in (
        curves(make_sweep(measures=()), few, styles),
        plot_steps(make_sweep(), few, styles=styles, title="t"),
        plot_errors(few, title="t"),
    ):
        assert note(figure) == ""


def test_long_names_keep_their_ends_and_stay_in_the_figure():
    assert shorten("sd+argmax", 9) == "sd+argmax"
    assert shorten("sd:a=1+egs:final=20", 9) == "sd:a…l=20"
    assert len(shorten("x" * 99, 18)) == 18
    names = [f"a_measure_of_a_very_long_name:option={i},another_one=0.25" for i in range(3)]
    records = [record(f"{n}+a_search_of_a_long_name:{n}", "x", 0.1, frame=300.0) for n in names]
    figure = curves(make_sweep(measures=()), records, assign_styles(names))
    figure.draw_without_rendering()
    box = figure.legends[0].get_window_extent()
    assert 0 <= box.x0 < box.x1 <= figure.bbox.width
    figure = plot_errors(records, title="a scene of a long name (validation), flicker, dynamic: errors")
    figure.draw_without_rendering()
    assert figure.axes[0].get_position().width > 0.35
    assert figure._suptitle.get_window_extent().x1 <= figure.bbox.width


def test_a_sweep_with_less_than_everything_is_drawn_too():
    nan = float("nan")
    unknown = {"truth": nan, "truth_frame": nan, "depth_of_focus": (nan, nan)}
    back_and_forth = np.concatenate([LENS[::2], LENS[::-2]])
    sweeps = [
        make_sweep("blind", **unknown),
        make_sweep("no lens", lens=None),
        make_sweep("there and back", lens=back_and_forth),
        make_sweep("backwards", lens=LENS[::-1]),
        make_sweep("at rest", lens=np.full(800, 0.5, dtype=np.float32)),
        make_sweep("rests on its way", lens=np.repeat(np.linspace(0, 1, 8, dtype=np.float32), 100)),
        make_sweep("beyond", truth=1.4, depth_of_focus=(1.3, 1.5), truth_frame=nan),
    ]
    figures = {s.light: curves(s) for s in sweeps}
    over_frames = {light for light, f in figures.items() if main(f).get_xlabel() == "frame"}
    assert over_frames == {"no lens", "there and back", "at rest", "rests on its way"}
    ET.fromstring(plot_to_svg(figures["blind"], name="a"))
    assert main(figures["beyond"]).get_xlim() == (0, 1)
    assert "focus at 1.40 →" in [text.get_text() for text in main(figures["beyond"]).texts]


def test_over_frames_every_pass_of_the_truth_and_the_lens_are_drawn():
    back_and_forth = np.concatenate([LENS[::2], LENS[::-2]])
    figure = curves(make_sweep(lens=back_and_forth))
    (passed,) = (c for c in main(figure).collections if len(c.get_paths()) == 2)
    when = sorted(path.vertices[0, 0] for path in passed.get_paths())
    assert when == pytest.approx([0.375 * 399.5, 799 - 0.375 * 399.5], abs=1)
    (drawn,) = (line for line in main(figure).get_lines() if len(line.get_xdata()) == 400)
    assert drawn.get_ydata().max() == pytest.approx(1, abs=0.01)
    one = record("sd+egs", "x", 0.0, frame=299.0, trace=(400.0, 200.0, 299.0))
    (axes,) = plot_steps(make_sweep(lens=back_and_forth), [one], styles=LOOKS, title="t").axes
    flat = sorted(line.get_ydata()[0] for line in axes.get_lines() if line.get_xdata()[0] == 0)
    assert pytest.approx(flat, abs=1) == [150, 400, 649]


def test_errors_show_every_method_and_light_and_mark_what_gave_no_answer():
    records = [record("a+s", "x", 0.2), record("b+s", "x", -12.0), failed("c+s", "x", "abstained")]
    (axes,) = plot_errors(records, title="camel").axes
    assert [t.get_text() for t in axes.get_yticklabels()] == ["a+s", "b+s", "c+s"]
    marks = {line.get_marker(): line for line in axes.get_lines() if line.get_marker() in ("o", "x")}
    assert marks["o"].get_xdata().tolist() == [0.2, -12.0]
    assert marks["x"].get_xdata().tolist()[0] > 12
    assert marks["x"].get_ydata().round().tolist() == [2]


def test_few_values_of_a_condition_are_each_on_their_own():
    found = bin_sequences(make_records(), RATIO)
    assert [round(value, 6) for value, _ in found] == [1, 2.5, 4]
    assert [len(names) for _, names in found] == [3, 3, 6]


def test_many_values_make_bins_of_about_as_many_sequences():
    records = [record("sd+argmax", f"s{i}", 0.1, mean_rate=0.01 * 1.1**i) for i in range(36)]
    found = bin_sequences(records, BUDGET)
    assert [len(names) for _, names in found] == [6] * 6
    assert found[0][0] == pytest.approx(1.1**2.5)


def test_a_condition_that_hardly_differs_has_no_figure():
    same = [record("sd+argmax", f"s{i}", 0.1, light_ratio=1 + 0.01 * i, mean_rate=0.2) for i in range(9)]
    two = [record("sd+argmax", f"s{i}", 0.1, light_ratio=1.0 + i % 2) for i in range(9)]
    for records, condition in ((same, RATIO), (same, BUDGET), (two, RATIO), ([BLIND], RATIO), ([], RATIO)):
        assert plot_condition(records, condition, styles=LOOKS, title="t") is None


BLIND = record("sd+argmax", "x", None)


def test_success_and_error_against_a_condition_follow_the_leaderboards_rule():
    records = [
        record("sd+argmax", "a", 0.5, scene="a", light_ratio=1.0),
        record("sd+argmax", "b", 3.0, scene="a", light_ratio=2.0),
        record("sd+argmax", "c", 0.5, scene="b", light_ratio=2.0),
        record("sd+argmax", "d", 0.1, scene="b", light_ratio=2.0),
        record("sd+argmax", "e", 9.0, scene="b", light_ratio=8.0),
    ]
    above, below = plot_condition(records, RATIO, styles=LOOKS, title="t").axes
    assert above.get_lines()[0].get_ydata().tolist() == [1, 0.5, 0]
    assert below.get_lines()[0].get_ydata().tolist() == [0.5, 0.5, 9]
    assert above.get_lines()[0].get_xdata() == pytest.approx([1, 2, 8])


def test_steps_of_a_search_are_drawn_where_the_lens_was_in_frames_from_0():
    coded = record("sd+egs_code", "x", 0.0, frame=299.0, trace=(400.0, 200.0, 300.0))
    ours = record("sd+egs", "x", 0.0, frame=299.0, trace=(400.0, 200.0, 299.0))
    alone = record("sd+argmax", "x", 0.0, frame=299.0, trace=(299.0,))
    figure = plot_steps(make_sweep(), [coded, ours, alone], styles=LOOKS, title="t")
    assert [a.get_title(loc="left") for a in figure.axes] == ["egs_code", "egs"]
    ends = [next(line for line in a.get_lines() if len(line.get_xdata()) == 3) for a in figure.axes]
    assert [float(line.get_ydata()[-1]) * 799 for line in ends] == pytest.approx([299, 299], abs=0.01)
    assert 0.375 in [line.get_ydata()[0] for line in figure.axes[0].get_lines()]
    assert plot_steps(make_sweep(), [alone], styles=LOOKS, title="t") is None


def pictures_of(axes):
    """The grey pictures of a figure, from left to right."""
    return [image.get_array() for a in axes for image in a.get_images()]


def test_the_depth_of_focus_is_explained_with_what_the_camera_saw():
    steady, flicker = make_sweep(thumbnails=make_thumbnails()), make_sweep("ramp", thumbnails=make_thumbnails(8))
    flicker = replace(flicker, rate=np.linspace(0.1, 0.4, CENTRES.size))
    figure = plot_depth_of_focus([make_sweep("steps"), flicker, steady])
    labels = [axes.get_xlabel() for axes in figure.axes if axes.get_images()]
    # Pictures are 0.0625 of the travel apart, which is 0.7 of the depth of focus; the truth is between two of them.
    assert labels == ["−3.8", "−1.0", "+0.3", "+1.0", "+3.8"]
    means = [picture.mean() for picture in pictures_of(figure.axes)]
    assert means == sorted(means)  # make_thumbnails brightens from picture to picture
    plot = figure.axes[-1]
    line = next(line for line in plot.get_lines() if len(line.get_xdata()) == 3)
    assert np.interp([-1, -0.5, 0, 0.5, 1], line.get_xdata(), line.get_ydata()) == pytest.approx([2, 1, 0, 1, 2])


@pytest.mark.parametrize("change", [{"truth": math.nan}, {"track": np.full(800, 0.4)}, {"thumbnails": None}])
def test_without_a_known_resting_focus_and_pictures_the_depth_of_focus_is_drawn_alone(change):
    sweep = make_sweep(**{"thumbnails": make_thumbnails(), **change})
    figure = plot_depth_of_focus([sweep])
    assert pictures_of(figure.axes) == []
    assert len(figure.axes) == 1
