"""Figure of success and error against a condition of the recordings: the light ratio or the photon budget."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullLocator

from saf_gen.benchmark.records import Record
from saf_gen.core.figure_style import BAND, GREY, MAX_MEASURES, PAPER, PlotStyle, hide_spines, use_plot_style
from saf_gen.leaderboard.averages import mean_over_scenes_for_ranking, median_magnitude_for_ranking
from saf_gen.leaderboard.axes import BLOCK_READOUTS
from saf_gen.leaderboard.figures._figure import create_leaderboard_figure, describe_figure_omissions, split_figure_label
from saf_gen.leaderboard.figures._legend import add_figure_legend, figure_legend_height

BINS = 6
POINTS = 240
"""Largest number of single errors in a figure; if there are more, only medians are drawn."""


@dataclass(frozen=True)
class Condition:
    """A property of recordings; its ``value`` is a number above 0, or None if it is unknown."""

    name: str
    title: str
    axis_label: str
    value: Callable[[Record], float | None]
    min_ratio: float
    """Smallest ratio of the largest to the smallest value for which a figure is drawn."""


CONDITIONS = (
    Condition(
        "light-ratio",
        "Error against light ratio",
        "brightest light of the recording divided by its darkest",
        lambda r: r.light_ratio,
        1.2,
    ),
    Condition(
        "photon-budget",
        "Error against photon budget",
        f"mean counts per pixel in a block of {BLOCK_READOUTS} readouts",
        lambda r: None if r.mean_rate is None or r.mean_rate <= 0 else BLOCK_READOUTS * r.mean_rate,
        2.0,
    ),
)


def bin_sequences_for_figure(records: Sequence[Record], condition: Condition) -> list[tuple[float, frozenset[str]]]:
    """Return groups of sequences with similar values of a condition, in ascending order.

    Each group is the geometric mean of its values and the names of its sequences. If there are at most BINS distinct
    values, each is a group; more are divided into BINS groups of about equal size. The list is empty if there are fewer
    than three values or if the ratio of the largest to the smallest is below ``condition.min_ratio``.
    """
    values = {r.sequence: value for r in records if (value := condition.value(r)) is not None}
    distinct = sorted(set(values.values()))
    if len(distinct) < 3 or distinct[-1] < condition.min_ratio * distinct[0]:
        return []
    if len(distinct) > BINS:
        edges = np.quantile(list(values.values()), np.linspace(0, 1, BINS + 1)[1:-1])
        bin_of = {name: int(np.searchsorted(edges, value)) for name, value in values.items()}
    else:
        bin_of = {name: distinct.index(value) for name, value in values.items()}
    groups = []
    for number in sorted(set(bin_of.values())):
        names = frozenset(name for name, own in bin_of.items() if own == number)
        groups.append((math.exp(np.mean([math.log(values[name]) for name in names])), names))
    return groups


def plot_condition_figure(
    records: Sequence[Record], condition: Condition, *, styles: Mapping[str, PlotStyle], title: str
) -> Figure | None:
    """Return the figure of one search: success within 1 DoF above, median error below, with one line per measure.

    ``styles`` gives the order of the measures, of which the first MAX_MEASURES are drawn; the figure says if
    others are left out. The result is None if bin_sequences_for_figure returns no group or no error is known.
    """
    groups = bin_sequences_for_figure(records, condition)
    present = {split_figure_label(r.method)[0] for r in records}
    known = [m for m in styles if m in present]
    measures = known[:MAX_MEASURES]
    note = describe_figure_omissions((len(measures), len(known), "measures"))
    if not groups or all(r.error_dof is None for r in records):
        return None
    with use_plot_style():
        figure = create_leaderboard_figure(3.35 + figure_legend_height(measures, note=note), title=title)
        above, below = figure.subplots(2, sharex=True, gridspec_kw={"height_ratios": [1, 1.3]})
        below.axhspan(0, 1, color=BAND, alpha=0.3, lw=0)
        for measure in measures:
            own = [r for r in records if split_figure_label(r.method)[0] == measure]
            _draw(above, below, records=own, groups=groups, style=styles[measure])
            if len(measures) * len(own) <= POINTS:
                _scatter(below, own, condition=condition, style=styles[measure])
        above.set_ylim(-0.06, 1.06)
        above.set_yticks([0, 0.5, 1], ["0 %", "50 %", "100 %"])
        above.set_ylabel("within 1 DoF")
        _set_absolute_error_axis(below, [abs(r.error_dof) for r in records if r.error_dof is not None])
        below.set_xscale("log")
        low, high = groups[0][0], groups[-1][0]
        below.set_xticks([g[0] for g in _spread(groups)], [_short(g[0]) for g in _spread(groups)])
        below.xaxis.set_minor_locator(NullLocator())
        margin = (high / low) ** 0.06
        below.set_xlim(low / margin, high * margin)
        below.set_xlabel(condition.axis_label)
        for axes in (above, below):
            axes.grid(axis="y", color=GREY, lw=0.6)
            axes.set_axisbelow(True)
            hide_spines(axes, "top", "right")
        add_figure_legend(figure, [styles[m].legend_handle() for m in measures], names=measures, note=note)
    return figure


def _draw(
    above: Axes,
    below: Axes,
    *,
    records: Sequence[Record],
    groups: Sequence[tuple[float, frozenset[str]]],
    style: PlotStyle,
) -> None:
    """Draw the success and the median error of each group as a line."""
    members = [(x, [r for r in records if r.sequence in names]) for x, names in groups]
    success = [(x, mean_over_scenes_for_ranking(group, lambda r: r.success_1dof)) for x, group in members]
    error = [(x, median_magnitude_for_ranking(r.error_dof for r in group)) for x, group in members]
    for axes, points in ((above, success), (below, error)):
        known = np.array([(x, y) for x, y in points if y is not None])
        if known.size:
            axes.plot(
                *known.T,
                color=style.colour,
                ls=style.dashes,
                lw=1.3,
                marker=style.marker,
                ms=4.5,
                mec=PAPER,
                mew=0.5,
                clip_on=False,
            )


def _scatter(axes: Axes, records: Sequence[Record], *, condition: Condition, style: PlotStyle) -> None:
    points = [
        (condition.value(r), abs(r.error_dof))
        for r in records
        if r.error_dof is not None and condition.value(r) is not None
    ]
    if points:
        axes.plot(*np.array(points).T, ".", color=style.colour, ms=4, alpha=0.5, mew=0, zorder=1)


def _set_absolute_error_axis(axes: Axes, errors: Sequence[float]) -> None:
    """Make the error axis linear up to one depth of focus and logarithmic beyond it."""
    reach = max([3.0, *errors]) * 1.2
    axes.set_yscale("symlog", linthresh=1, linscale=0.6)
    axes.set_ylim(0, reach)
    axes.set_yticks([0, *[10.0**n for n in range(int(math.log10(reach)) + 1)]])
    axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{y:g}"))
    axes.set_ylabel("|answer − truth|, DoF")


def _spread(groups: Sequence[tuple[float, frozenset[str]]]) -> list[tuple[float, frozenset[str]]]:
    """Return the groups whose values can be labelled without overlap."""
    total = math.log(groups[-1][0] / groups[0][0])
    kept = [groups[0]]
    for group in groups[1:]:
        if math.log(group[0] / kept[-1][0]) > 0.08 * total:
            kept.append(group)
    return kept


def _short(value: float) -> str:
    return f"{value:.0f}" if value >= 20 else f"{value:.1f}".removesuffix(".0") if value >= 0.95 else f"{value:.2g}"
