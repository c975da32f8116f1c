"""No two texts of a printed figure overlap, whatever it shows and however many panels it has."""

import itertools

import numpy as np
import pytest
from figure_texts import overlapping_texts
from handmade_evaluations import make_lens_path, make_sweep, make_thumbnails
from handmade_records import record

from saf_gen.benchmark.results import Evaluation
from saf_gen.core.figure_style import assign_styles
from saf_gen.leaderboard import rank_methods
from saf_gen.leaderboard.figures.depth_of_focus import plot_depth_of_focus
from saf_gen.leaderboard.figures.sweeps import plot_curves, plot_lens_paths, plot_steps
from saf_gen.leaderboard.files import compute_results
from saf_gen.leaderboard.report.choose_figures import plot_figures

pytestmark = pytest.mark.slow

LONG = "structure_calibrated:dark=false"


def records_of(*, searches, measures, lights=3, scenes=4):
    return tuple(
        record(
            f"{measure}+{search}",
            f"scene{scene}-light{light}",
            0.3 * number,
            scene=f"scene{scene}",
            light=f"light{light}",
            frame=300.0 + number,
            trace=(1.0, 700.0, 300.0, 310.0 + number),
            light_ratio=1.0 + 2.0 * light,
            mean_rate=0.02 * 4**light,
            time_to_focus_s=0.1,
        )
        for number, (search, measure) in enumerate(itertools.product(searches, measures))
        for scene in range(scenes)
        for light in range(lights)
    )


@pytest.mark.parametrize("panels", range(5, 13))
def test_no_texts_overlap_in_figures_of_many_panels(panels):
    searches = [f"search_number_{number}" for number in range(panels)]
    measures = ["sd", LONG, "er_count"]
    styles = assign_styles(measures)
    records = records_of(searches=searches, measures=measures, lights=1, scenes=1)
    sweep = make_sweep(measures=("sd", "er_count"))
    paths = [make_lens_path(f"{measure}+{search}") for search in searches for measure in measures]
    figures = [
        plot_steps(sweep, records, styles=styles, title="camel (test), constant: steps of searches"),
        plot_curves(sweep, records, styles=styles, title="camel (test), constant"),
        plot_lens_paths(paths, styles=styles, title="camel (test), constant: path of the lens"),
    ]
    assert [overlapping_texts(figure) for figure in figures] == [[], [], []]


@pytest.mark.parametrize("methods", [2, 9, 22])
def test_no_texts_overlap_in_the_figures_of_an_evaluation(methods):
    measures = [f"measure_{number}" for number in range(-(-methods // 2))]
    records = records_of(searches=("argmax", "golden_section"), measures=[*measures[:-1], LONG])
    sweeps = (
        make_sweep("light0", scene="scene0", thumbnails=make_thumbnails(48)),
        make_sweep("light1", scene="scene1", lens=np.concatenate([np.linspace(0, 1, 400), np.linspace(1, 0, 400)])),
        make_sweep("light2", scene="scene2", truth=1.4, depth_of_focus=(1.35, 1.45)),
    )
    made = Evaluation(records, sweeps, ())
    rows = rank_methods(records)
    figures = plot_figures(made, rows, comparison=compute_results(rows, records).comparison)
    assert {figure.kind for figure in figures} >= {"depth-of-focus", "profile", "neighbours", "light-ratio", "errors"}
    found = {figure.name: overlapping_texts(figure.figure) for figure in figures}
    assert {name: texts for name, texts in found.items() if texts} == {}


def test_an_overlap_is_found():
    figure = plot_depth_of_focus((make_sweep(thumbnails=make_thumbnails(48)),))
    assert overlapping_texts(figure) == []
    figure.text(0.5, 0.5, "one")
    figure.text(0.5, 0.5, "other")
    figure.text(0.95, 0.1, "beyond the edge")
    assert {"one", "other"} <= set(itertools.chain(*overlapping_texts(figure)))
    assert ("beyond the edge", "edge") in overlapping_texts(figure)
