"""The picture of curves in README: its texts are large enough where it is shown, and do not overlap."""

import sys
from contextlib import ExitStack

import pytest
from figure_texts import hidden_labels, overlapping_texts
from matplotlib.text import Text
from PIL import Image
from small_dataset import HERE

from saf_gen.stream.sample_dataset import sample
from saf_gen.stream.stream_file import open_stream

ROOT = HERE.parent
LEAST_PX = 9
"""Smallest size of a letter's body where README shows the picture, in pixels."""


@pytest.fixture(scope="module")
def tool():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "tools"))
        import draw_curves

        yield draw_curves
        del sys.modules["draw_curves"]


@pytest.fixture(scope="module")
def figure(tool):
    lights = ("constant", "continuous", "sudden")
    with ExitStack() as opened:
        streams = [open_stream(sample() / f"test/usaf_target-{light}-00.h5") for light in lights]
        return tool.draw_curves([opened.enter_context(stream) for stream in streams])


def test_every_text_can_be_read_where_the_picture_is_shown_and_none_overlap(tool, figure):
    assert overlapping_texts(figure) == []
    scale = tool.SHOWN_WIDTH_PX / figure.bbox.width
    hidden = hidden_labels(figure)
    shown = [text for text in figure.findobj(Text) if text.get_text().strip() and text not in hidden]
    assert len(shown) > 15
    assert min(text.get_fontsize() * figure.dpi / 72 * scale for text in shown) >= LEAST_PX


def test_it_has_a_title_one_legend_and_a_panel_for_each_light(tool, figure):
    assert figure.get_suptitle() == tool.TITLE
    assert [axes.get_title(loc="left") for axes in figure.axes] == list(tool.LIGHTS.values())
    assert len(figure.legends) == 1
    assert not any(axes.get_legend() for axes in figure.axes)


def test_the_picture_in_the_repository_was_drawn_by_the_tool(tool):
    with Image.open(ROOT / "docs/pictures/curves-usaf_target.png") as picture:
        width, height = picture.size
    assert (width, height) == tuple(round(inches * tool.DOTS_PER_INCH) for inches in tool.SIZE_INCHES)
    assert width == 2 * tool.SHOWN_WIDTH_PX
