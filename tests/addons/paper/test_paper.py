"""The command ``paper``: its figures hold the curves of its table, and a dataset without a condition is refused."""

import csv
import shutil

import numpy as np
import pytest
from figure_texts import overlapping_texts
from matplotlib.text import Text
from PIL import Image
from planted_sweeps import SHAPE, list_streams, write_sweep
from small_dataset import HERE

from saf_gen.addons.paper.claims import judge_claims
from saf_gen.addons.paper.conditions import choose_scenes, run_methods, select_sequences, stop_frame
from saf_gen.addons.paper.figures import draw_figures
from saf_gen.addons.paper.page import FILES
from saf_gen.benchmark.kept_sequences import KeptSequences
from saf_gen.benchmark.records import read_records
from saf_gen.cli import main

pytestmark = pytest.mark.slow
GAINS = {"constant": np.ones(SHAPE[0]), "continuous": np.linspace(0.2, 1.8, SHAPE[0]),
         "sudden": np.repeat([1.0, 0.3, 1.8, 0.6], SHAPE[0] // 4)}  # fmt: skip
PEAKS = {"chart": 300.0, "bottle": 420.0}


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """A dataset of two scenes, at rest and moving by name, under the lights of the paper."""
    folder, sequences = tmp_path_factory.mktemp("data") / "data", []
    for scene, peak in PEAKS.items():
        for motion in ("static", "dynamic"):
            for light, gain in GAINS.items():
                name = f"{scene}-{motion}-{light}"
                write_sweep(folder / "test" / f"{name}.h5", peak, gain=gain)
                sequences.append({"id": name, "scene": scene, "light": light, "scene_motion": motion})
    return list_streams(folder, *sequences)


@pytest.fixture(scope="module")
def tasks(data):
    return select_sequences(data)


@pytest.fixture(scope="module")
def run(data, tasks):
    return run_methods(tasks, keep=KeptSequences(), stacks=data / "stacks", progress=lambda done, total, what: None)


@pytest.fixture(scope="module")
def figures(run):
    return {name: figure for name, (figure, _) in draw_figures(run).items()}


@pytest.fixture(scope="module")
def written(data, tmp_path_factory):
    folder = tmp_path_factory.mktemp("out") / "paper"
    with pytest.raises(SystemExit) as ended:
        main(["paper", str(data), "--out", str(folder)])
    assert ended.value.code == 0
    return folder


def curves(folder):
    """The curves in the table: normalised scores by sequence and measure."""
    found = {}
    with (folder / "curves.csv").open(newline="") as file:
        for row in csv.DictReader(file):
            point = float(row["position"]), float(row["normalised"])
            found.setdefault((row["sequence"], row["measure"]), []).append(point)
    return {key: np.array(points) for key, points in found.items()}


def drawn(figure):
    """The curves in a figure by the measure that its line is labelled with, one list for each."""
    lines = {}
    for axes in figure.axes:
        for line in axes.get_lines():
            lines.setdefault(line.get_label(), []).append(np.column_stack(line.get_data()))
    return lines


def test_figures_hold_the_curves_of_the_table(figures, written):
    table = curves(written)
    measures = ("sd_code", "gradient_code", "mfdct_code", "er_sumsq")
    order = [f"{{scene}}-{motion}-{light}" for motion in ("static", "dynamic") for light in GAINS]
    for name, scene in (("figure-4", "bottle"), ("figure-5", "chart")):
        lines = drawn(figures[name])
        for measure in measures:
            assert len(lines[measure]) == len(order)
            for line, sequence in zip(lines[measure], order, strict=True):
                np.testing.assert_allclose(line, table[sequence.format(scene=scene), measure], atol=1e-9)
    for measure in ("sd_code", "sd_rt"):
        for line, scene in zip(drawn(figures["figure-7"])[measure], ("bottle", "chart"), strict=True):
            np.testing.assert_allclose(line, table[f"{scene}-dynamic-constant", measure], atol=1e-9)


def test_no_labels_overlap(figures):
    assert {name: overlapping_texts(figure) for name, figure in figures.items()} == {name: [] for name in figures}


def test_readme_shows_figure_5_at_half_its_pixels_where_every_text_can_be_read(figures):
    figure = figures["figure-5"]
    assert min(text.get_fontsize() for text in figure.findobj(Text)) * figure.dpi / 72 / 2 >= 9
    with Image.open(HERE.parent / "docs/pictures/paper-figure-5.png") as picture:
        assert picture.size == tuple(np.round(figure.get_size_inches() * figure.dpi))


def test_answers_and_traces_are_those_of_the_records(figures, written):
    records = {(r.what.sequence, r.who.method): r.judgement for r in read_records(written)}
    lens = np.linspace(0, 1, SHAPE[0], dtype=np.float32)
    for scene, line in zip(("bottle", "chart"), drawn(figures["figure-7"])["SGFS"], strict=False):
        trace = np.array(records[f"{scene}-dynamic-constant", "sd_code+sgfs_code"].trace)
        np.testing.assert_allclose(line[:, 1], np.interp(trace - 1, np.arange(len(lens)), lens), atol=1e-6)
    texts = {text.get_text() for text in figures["figure-6"].axes[2].texts}
    for measure in ("sd_code", "mfdct_code", "er_sumsq"):
        assert f"{records['chart-dynamic-continuous', f'{measure}+argmax'].position:.3f}" in texts


def test_sd_in_real_time_is_largest_where_the_search_stopped(run):
    for sequence, (ends, scores) in run.feedback.items():
        assert ends[scores.argmax()] == stop_frame(run.record(sequence, "sd_code+sgfs_code"))


def test_claims_name_what_holds_and_what_fails(run):
    claims = {claim.text: claim for claim in judge_claims(run).rows}
    assert claims["under continuous variations, SD stays functional"].verdict == "holds"
    follow = claims["under continuous variations, all other measures follow the light"]
    assert (follow.verdict, "ER 0% (0% to" in follow.found) == ("in part", True)  # the gradient works here
    assert "ER: median error 4.9 depths of focus, correlation of curve and light +0.98" in follow.why
    assert claims["under sudden changes, only SD works"].verdict == "holds"


def test_a_page_with_all_of_it_can_be_printed(written):
    assert sorted(path.name for path in written.iterdir()) == sorted(FILES)
    page = (written / "paper.html").read_text()
    assert page.count("<svg") == 5
    assert page.count("<tr>") == 13
    assert "src=" not in page  # it loads nothing


def test_without_a_condition_one_line_names_it_and_the_recipe(data, call, tmp_path):
    shutil.copytree(data, folder := tmp_path / "data")
    light = {(task.scene, task.scene_motion, task.light) for task in select_sequences(folder)}
    kept = [(s, m, x) for s, m, x in sorted(light) if (m, x) != ("dynamic", "sudden")]
    list_streams(folder, *({"id": f"{s}-{m}-{x}", "scene": s, "light": x, "scene_motion": m} for s, m, x in kept))
    code, out, err = call("paper", folder)
    assert (code, out) == (2, "")
    assert "no dynamic scene under sudden light" in err
    assert "paper_small" in err
    assert not (folder / "paper").exists()


def test_files_of_others_are_not_replaced(data, call, tmp_path):
    (tmp_path / "curves.csv").write_text("mine")
    code, _, err = call("paper", data, "--out", tmp_path)
    assert code == 2
    assert "holds files that saf-gen paper did not write" in err
    assert (tmp_path / "curves.csv").read_text() == "mine"


def test_other_scenes_take_the_place_of_those_that_the_dataset_lacks(tasks):
    shown = choose_scenes(tasks)
    assert shown["figure-4"] == (("bottle", "static"), ("bottle", "dynamic"))
    assert shown["figure-5"] == (("chart", "static"), ("chart", "dynamic"))
    assert shown["figure-7"] == (("bottle", "dynamic"), ("chart", "dynamic"))
    alone = choose_scenes([task for task in tasks if task.scene == "chart"])
    assert (list(alone), alone["figure-7"]) == (["figure-5", "figure-6", "figure-7"], (("chart", "dynamic"),))
