"""Colours, dashes and SVG of plots, in a file and on a page."""

import re
import xml.etree.ElementTree as ET

import matplotlib
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from saf_gen.core.figure_style import (
    BAND,
    MAX_MEASURES,
    VARIABLES,
    assign_styles,
    inline_svg,
    plot_to_svg,
    use_plot_style,
)


def draw(title="camel"):
    """A figure with lines, an area, marks and texts."""
    with use_plot_style():
        figure = Figure()
        FigureCanvasSVG(figure)
        axes = figure.subplots()
        for number, (name, style) in enumerate(assign_styles(["sd", "er_count"]).items()):
            axes.plot([0, 1], [number, 1], color=style.colour, ls=style.dashes, label=name, marker="o")
        axes.axvspan(0.3, 0.4, color=BAND, lw=0)
        axes.legend()
        axes.set_title(title)
    return figure


def test_a_plot_is_well_formed_the_same_each_time_and_changes_no_setting_of_matplotlib():
    before = dict(matplotlib.rcParams)
    one, other = (plot_to_svg(draw(), name="a") for _ in range(2))
    assert one == other
    assert dict(matplotlib.rcParams) == before
    texts = {"".join(e.itertext()).strip() for e in ET.fromstring(one).iter("{http://www.w3.org/2000/svg}text")}
    assert {"camel", "sd", "er_count"} <= texts


def test_names_in_other_scripts_are_text_in_a_plot_and_warn_of_nothing():
    assert ">焦点<" in plot_to_svg(draw("焦点"), name="a")


def test_within_a_page_colours_are_the_pages_and_names_do_not_meet():
    parts = [inline_svg(plot_to_svg(draw(), name=name), label=name) for name in ("a", "b")]
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


def test_as_many_styles_differ_as_there_are_pairs_of_colour_and_dashes():
    names = [f"m{i}" for i in range(MAX_MEASURES * MAX_MEASURES)]
    styles = list(assign_styles(names).values())
    assert len({(s.colour, s.dashes) for s in styles}) == MAX_MEASURES * MAX_MEASURES
    assert len({s.colour for s in styles[:MAX_MEASURES]}) == MAX_MEASURES
