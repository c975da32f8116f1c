import base64
import re
import struct
from html.parser import HTMLParser

import matplotlib
import numpy as np
import pytest
from test_leaderboard import failed, record

from saf_gen.errors import BadInput
from saf_gen.evaluate import Curve, Evaluation, Failure, Sweep
from saf_gen.figures import WIDTH_PX, curves_figure, errors_figure, normalised, to_png
from saf_gen.leaderboard import columns, table
from saf_gen.report import page, scenes, write_report

LENS = np.linspace(0, 1, 800, dtype=np.float32)
CENTRES = np.arange(0, 800, 50) + 24.5


def sweep(
    light="constant",
    *,
    scene="camel",
    split="test",
    lens=LENS,
    measures=("sd", "sd_code", "er_count"),
    **more,
):
    bump = np.exp(-(((CENTRES - 300) / 90) ** 2))
    scores = {"sd": bump, "sd_code": 1e5 * bump, "er_count": np.linspace(1, 2, CENTRES.size)}
    known = {"truth": 0.375, "depth_of_focus": (0.33, 0.42), "truth_frame": 300.0}
    return Sweep(
        sequence=f"{scene}-{light}",
        split=split,
        scene=scene,
        light=light,
        focus_position=lens,
        frames=CENTRES,
        rate=np.full(CENTRES.size, 0.2),
        curves=tuple(Curve(m, CENTRES, scores[m], float(CENTRES[scores[m].argmax()])) for m in measures),
        **{**known, **more},
    )


def size(png):
    assert png.startswith(b"\x89PNG\r\n\x1a\n")
    return struct.unpack(">II", png[16:24])


def curves_of(axes):
    return [line for line in axes.get_lines() if len(line.get_xdata()) == CENTRES.size]


def test_normalised_scores_run_from_0_to_1_and_a_flat_curve_is_0():
    assert normalised(np.array([3.0, 5.0, 4.0])).tolist() == [0, 1, 0.5]
    assert normalised(np.array([2.0, 2.0])).tolist() == [0, 0]
    assert np.isnan(normalised(np.array([np.nan, 1.0, 2.0]))[0])


def test_a_picture_is_1600_pixels_wide_and_holds_ink():
    png = to_png(curves_figure([sweep("constant"), sweep("ramp")], title="camel"))
    width, height = size(png)
    assert width == WIDTH_PX == 1600
    assert 500 < height < 1200
    assert len(png) > 20_000


def test_the_same_figure_gives_the_same_bytes():
    one, other = (to_png(curves_figure([sweep()], title="camel")) for _ in range(2))
    assert one == other


def test_each_light_has_a_panel_named_after_it():
    figure = curves_figure([sweep(light) for light in ("a", "b", "c", "d")], title="camel")
    shown = [axes.get_title() for axes in figure.axes if axes.get_visible() and axes.get_title()]
    assert shown == ["a", "b", "c", "d"]


def test_curves_run_over_the_focus_position_with_the_truth_among_them():
    figure = curves_figure([sweep()], title="camel")
    axes = next(a for a in figure.axes if a.get_title())
    sd, count = curves_of(axes)  # sd_code is sd times a number: they share a line
    np.testing.assert_allclose(sd.get_xdata(), CENTRES / 799, atol=1e-6)
    assert (count.get_ydata().min(), count.get_ydata().max()) == (0, 1)
    assert 0.375 in [line.get_xdata()[0] for line in axes.get_lines()]
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert names[:2] == ["sd = sd_code", "er_count"]


def test_measures_that_differ_under_one_light_have_a_line_each():
    other = sweep("ramp")
    moved = tuple(
        Curve(c.measure, c.frames, c.scores[::-1] if c.measure == "sd" else c.scores, 1.0)
        for c in other.curves
    )
    figure = curves_figure([sweep(), Sweep(**{**vars(other), "curves": moved})], title="camel")
    assert [t.get_text() for t in figure.legends[0].get_texts()][:3] == ["sd", "sd_code", "er_count"]


def test_a_sweep_with_less_than_everything_is_drawn_too():
    nan = float("nan")
    unknown = {"truth": nan, "truth_frame": nan, "depth_of_focus": (nan, nan)}
    there_and_back = np.concatenate([LENS[::2], LENS[::-2]])
    figure = curves_figure(
        [
            sweep("blind", **unknown),
            sweep("no lens", lens=None),
            sweep("there and back", lens=there_and_back),
            sweep("backwards", lens=LENS[::-1]),
            sweep("at rest", lens=np.full(800, 0.5, dtype=np.float32)),
            sweep(None, truth=1.4, depth_of_focus=(1.3, 1.5), truth_frame=nan),
        ],
        title="camel",
    )
    assert size(to_png(figure))[0] == WIDTH_PX
    over = {axes.get_title(): axes.get_xlabel() for axes in figure.axes if axes.get_title()}
    assert {name for name, label in over.items() if label == "frame"} == {
        "no lens",
        "there and back",
        "at rest",
    }


def test_over_frames_every_pass_of_the_truth_and_the_lens_are_drawn():
    there_and_back = np.concatenate([LENS[::2], LENS[::-2]])
    figure = curves_figure([sweep(lens=there_and_back)], title="camel")
    axes = next(a for a in figure.axes if a.get_title())
    (passed,) = (c for c in axes.collections if len(c.get_paths()) == 2 and "Line" in type(c).__name__)
    when = sorted(path.vertices[0, 0] for path in passed.get_paths())
    assert when == pytest.approx([0.375 * 399.5, 799 - 0.375 * 399.5], abs=1)
    (drawn,) = (line for line in axes.get_lines() if len(line.get_xdata()) == 800)
    np.testing.assert_allclose(drawn.get_ydata(), there_and_back, atol=1e-6)
    assert "focus position, 0 to 1" in [text.get_text() for text in figure.legends[0].get_texts()]


def test_a_lens_that_rests_on_its_way_is_drawn_over_frames():
    stop_and_go = np.repeat(np.linspace(0, 1, 8, dtype=np.float32), 100)
    slow_and_fast = LENS**2
    figure = curves_figure(
        [sweep("stop", lens=stop_and_go), sweep("hand", lens=slow_and_fast)], title="camel"
    )
    over = {axes.get_title(): axes.get_xlabel() for axes in figure.axes if axes.get_title()}
    assert over == {"stop": "frame", "hand": "focus position, fraction of travel"}


def test_a_truth_outside_the_travel_does_not_stretch_the_axis():
    figure = curves_figure([sweep(truth=1.4, depth_of_focus=(1.3, 1.5))], title="camel")
    axes = next(a for a in figure.axes if a.get_title())
    assert axes.get_xlim() == (0, 1)
    assert "focus at 1.40 →" in [text.get_text() for text in axes.texts]


def test_errors_show_every_method_and_light_and_mark_what_gave_no_answer():
    records = [record("a+s", "x", 0.2), record("b+s", "x", -12.0), failed("c+s", "x", "abstained")]
    figure = errors_figure(records, title="camel")
    (axes,) = figure.axes
    assert [t.get_text() for t in axes.get_yticklabels()] == ["a+s", "b+s", "c+s"]
    marks = {
        line.get_marker(): line.get_xdata()[0] for line in axes.get_lines() if len(line.get_xdata()) == 1
    }
    assert marks["x"] > 12
    assert size(to_png(figure))[0] == WIDTH_PX


def test_pictures_leave_matplotlib_as_it_was():
    before = dict(matplotlib.rcParams)
    to_png(curves_figure([sweep()], title="camel"))
    assert dict(matplotlib.rcParams) == before


def test_a_scene_is_drawn_once_a_light_and_only_with_curves():
    drawn = scenes([sweep("a"), sweep("b"), sweep("a"), sweep("c", measures=()), sweep("a", scene="fan")])
    assert {key: [s.light for s in some] for key, some in drawn.items()} == {
        ("test", "camel"): ["a", "b"],
        ("test", "fan"): ["a"],
    }


class Reader(HTMLParser):
    """Every tag is closed, and nothing outside the page is asked for."""

    def __init__(self):
        super().__init__()
        self.open, self.tags, self.links = [], [], []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.links += [value for name, value in attrs if name in ("src", "href")]
        if tag not in ("meta", "img", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def read(text):
    reader = Reader()
    reader.feed(text)
    assert reader.open == []
    return reader


@pytest.fixture
def evaluation():
    records = (record("sd+argmax", "a", 0.2), record("er+argmax", "a", 6.0))
    return Evaluation(records, (sweep(),), (Failure("bad", "truncated"),))


def test_the_page_is_one_file_without_script_that_asks_for_nothing(tmp_path, evaluation):
    paths = write_report(tmp_path, evaluation=evaluation, rows=table(evaluation.records), title="small")
    assert [str(p.relative_to(tmp_path)) for p in paths] == [
        "index.html",
        "curves/test-camel.png",
        "errors/test-camel.png",
    ]
    reader = read((tmp_path / "index.html").read_text(encoding="utf-8"))
    assert "script" not in reader.tags
    assert all(link.startswith("data:image/png;base64,") for link in reader.links)
    embedded = [base64.b64decode(link.split(",")[1]) for link in reader.links]
    assert embedded == [
        (tmp_path / p).read_bytes() for p in ("curves/test-camel.png", "errors/test-camel.png")
    ]


def test_the_page_tells_the_table_the_columns_the_failures_and_the_digests(evaluation):
    rows = table(evaluation.records)
    text = page(rows, title="small", records=evaluation.records, failures=evaluation.failures)
    read(text)
    for row in rows:
        assert row.method in text
    for column in columns(rows):
        assert f"<dt>{column.header}</dt>" in text
    assert "sha-a" in text
    assert "truncated" in text
    assert "<code>sd+argmax</code> leads" in text
    assert "prefers-color-scheme: dark" in text


def test_text_from_files_cannot_break_the_page():
    nasty = "<script>alert('$x')</script>&\""
    records = [record(f"{nasty}+s", nasty, 0.1, light=nasty, scene=nasty)]
    text = page(table(records), title=nasty, records=records, failures=[Failure(nasty, nasty)])
    assert "script" not in read(text).tags


def test_a_page_without_truth_says_that_nothing_ranks():
    records = [record("a+s", "x", None)]
    text = page(table(records), title="blind", records=records)
    assert "nothing is ranked" in text
    assert not re.search(r"\bnan\b", text, re.IGNORECASE)


def test_an_empty_evaluation_still_makes_a_page(tmp_path):
    failures = (Failure("bad", "truncated"),)
    write_report(tmp_path, evaluation=Evaluation((), (), failures), rows=(), title="none")
    assert "truncated" in (tmp_path / "index.html").read_text(encoding="utf-8")


def test_a_report_that_cannot_be_written_is_bad_input(tmp_path, evaluation):
    (tmp_path / "curves").write_text("in the way")
    with pytest.raises(BadInput, match="cannot be written"):
        write_report(tmp_path, evaluation=evaluation, rows=table(evaluation.records), title="small")
