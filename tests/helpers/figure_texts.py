"""Finds texts of a figure that overlap, or that its sides cut off."""

import itertools

from matplotlib.axes._base import _AxesBase
from matplotlib.figure import Figure
from matplotlib.text import Text

from saf_gen.core.figure_style import use_plot_style

SLACK_PX = 0.5  # boxes of texts include some room around their letters


def overlapping_texts(figure: Figure) -> list[tuple[str, str]]:
    """Return pairs of texts of a figure whose boxes overlap, and texts that reach beyond its sides."""
    with use_plot_style():
        figure.draw_without_rendering()
        hidden = hidden_labels(figure)
        boxes = [
            (text.get_text(), text.get_window_extent())
            for text in figure.findobj(Text)
            if text.get_visible() and text.get_text().strip() and text not in hidden
        ]
    overlaps = [
        (one, other)
        for (one, a), (other, b) in itertools.combinations(boxes, 2)
        if min(a.x1, b.x1) - max(a.x0, b.x0) > SLACK_PX and min(a.y1, b.y1) - max(a.y0, b.y0) > SLACK_PX
    ]
    beyond = [(text, "edge") for text, box in boxes if box.x0 < -SLACK_PX or box.x1 > figure.bbox.width + SLACK_PX]
    return overlaps + beyond


def hidden_labels(figure: Figure) -> set[Text]:
    """Return the texts that axes keep and do not draw: of ticks beyond their limits or unused, and of hidden axes."""
    hidden: set[Text] = set()
    for axes in figure.findobj(_AxesBase):
        if not axes.get_visible():
            hidden |= set(axes.findobj(Text))
        for axis, limits, at in ((axes.xaxis, axes.get_xlim(), 0), (axes.yaxis, axes.get_ylim(), 1)):
            low, high = sorted(limits)
            used = {label for label in axis.get_ticklabels(which="both") if low <= label.get_position()[at] <= high}
            kept = {label for tick in (*axis.majorTicks, *axis.minorTicks) for label in (tick.label1, tick.label2)}
            hidden |= kept - used if axis.get_visible() and axes.axison else {*kept, *used, axis.label}
    return hidden
