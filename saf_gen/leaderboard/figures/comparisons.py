"""Figures that compare methods: profiles, neighbours in rank, errors in a scene, and success against a condition."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from saf_gen.benchmark.records import Record
from saf_gen.core.figure_style import (
    BAND,
    GREY,
    INK,
    MAX_MEASURES,
    PAPER,
    SOFT,
    PlotStyle,
    assign_styles,
    hide_spines,
    use_plot_style,
)
from saf_gen.leaderboard.axes import BLOCK_READOUTS
from saf_gen.leaderboard.figures.figure import (
    MAX_LABEL_CHARACTERS,
    add_legend,
    describe_omissions,
    legend_height,
    new_figure,
    shorten,
)
from saf_gen.leaderboard.method_comparison import NeighbourComparison, Profile
from saf_gen.leaderboard.outcomes import mean_over_scenes, median_magnitude, right_within
from saf_gen.leaderboard.sweep_lines import split_method

BANDS = 3
"""Number of methods, best first, that have a band; more bands would hide each other."""
MAX_PAIRS = 30
"""Largest number of pairs of neighbours in a figure; the first pairs are drawn."""
AXIS_LABELS: Mapping[str, str] = {
    "error_dof": "|answer − truth| at most, depths of focus",
    "time_s": "in focus within, seconds",
}


def plot_profiles(profiles: Sequence[Profile], *, title: str) -> Figure:
    """Return the figure of the profiles of one quantity: the fraction of answers within each limit.

    The first MAX_MEASURES methods are drawn, the first BANDS of them with a band for the interval. The figure says if
    methods are left out.
    """
    shown = list(profiles[:MAX_MEASURES])
    note = describe_omissions((len(shown), len(profiles), "methods"))
    styles = assign_styles([profile.method for profile in shown])
    names = list(styles)
    with use_plot_style():
        figure = new_figure(2.7 + legend_height(names, note=note), title=title)
        axes = figure.subplots()
        for number, profile in enumerate(shown):
            style = styles[profile.method]
            look = {"color": style.colour, "ls": style.dashes, "marker": style.marker, "lw": 1.3, "ms": 3.5}
            axes.plot(profile.limits, profile.fractions, **look)
            if number < BANDS and profile.low is not None and profile.high is not None:
                axes.fill_between(profile.limits, profile.low, profile.high, color=style.colour, alpha=0.1, lw=0)
        axes.set_ylim(-0.02, 1.02)
        axes.set_yticks([0, 0.25, 0.5, 0.75, 1], ["0 %", "25 %", "50 %", "75 %", "100 %"])
        quantity = shown[0].quantity
        if quantity == "error_dof":
            axes.axvline(1, color=INK, lw=0.8)
            axes.set_xscale("log")
            axes.set_xticks([0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10])
            axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
            axes.xaxis.set_minor_locator(NullLocator())
        axes.set_xlabel(AXIS_LABELS[quantity])
        axes.grid(color=GREY, lw=0.6)
        axes.set_axisbelow(True)
        hide_spines(axes, "top", "right")
        add_legend(figure, [styles[n].legend_handle() for n in names], names=names, note=note)
    return figure


def plot_neighbours(neighbours: Sequence[NeighbourComparison], *, title: str) -> Figure:
    """Return the figure of the probability of improvement between neighbours in rank, with intervals."""
    shown = list(neighbours[:MAX_PAIRS])
    note = describe_omissions((len(shown), len(neighbours), "pairs"))
    with use_plot_style():
        figure = new_figure(0.9 + 0.33 * len(shown), title=title)
        axes = figure.subplots()
        axes.axvline(0.5, color=INK, lw=1.1)
        for row, pair in enumerate(shown):
            if pair.improvement_low is not None and pair.improvement_high is not None:
                axes.plot([pair.improvement_low, pair.improvement_high], [row, row], color=SOFT, lw=1.3)
            axes.plot(pair.improvement, row, "o", color=INK, ms=4)
        labels = [
            "\n".join(shorten(name, MAX_LABEL_CHARACTERS) for name in (pair.first, pair.second)) for pair in shown
        ]
        axes.set_yticks(range(len(shown)), labels, fontsize=7.5)
        axes.set_ylim(len(shown) - 0.5, -0.5)
        axes.set_xlim(0, 1)
        axes.set_xticks([0, 0.25, 0.5, 0.75, 1], ["0", "¼", "½", "¾", "1"])
        words = "probability that the upper method is nearer" + (f" ({note})" if note else "")
        axes.set_xlabel(words, loc="right")  # it may be wider than the axes, which leave half of the width to names
        axes.grid(axis="x", color=GREY, lw=0.6)
        axes.set_axisbelow(True)
        hide_spines(axes, "top", "right")
    return figure


NO_LIGHT = "recording"
MANY_ROWS, MAX_ROWS = 30, 80
"""Numbers of methods above which rows are drawn closer together, and above which further methods are left out."""
ROW, CLOSE_ROW = 0.2, 0.14  # inches
MAX_MARKS = 600
"""Largest number of answers in a scene for which every answer has its own mark."""


def plot_errors(records: Sequence[Record], *, title: str) -> Figure:
    """Return the figure of the errors in one scene: one row per method, in the order of ``records``.

    Each answer has a mark in the style of its light schedule. If there are more than MAX_MARKS answers, a mark is the
    median of the answers of a method under one light, and a line covers the middle 90 %. At most the first
    MAX_ROWS methods are drawn. A note in the figure says if either limit applies.
    """
    all_methods = list(dict.fromkeys(r.method for r in records))
    methods = all_methods[:MAX_ROWS]
    records = [r for r in records if r.method in methods]
    note = describe_omissions((len(methods), len(all_methods), "methods"))
    many = len(records) > MAX_MARKS
    if many:
        note = "; ".join([*([note] if note else []), "marks are medians, lines the middle 90 %"])
    row_inches = ROW if len(methods) <= MANY_ROWS else CLOSE_ROW
    lights = assign_styles([r.light or NO_LIGHT for r in records])
    known = [abs(r.error_dof) for r in records if r.error_dof is not None]
    reach = max([3.0, *known]) * 1.3
    size = 4.5 if len(methods) <= MANY_ROWS else 3.6
    marks: list[Any] = [style.legend_handle(ls="") for style in lights.values()]
    marks += [Patch(color=BAND, alpha=0.3), Line2D([], [], ls="", marker="x", color=SOFT, mew=1.3)]
    names = [*lights, "success: within 1", "no answer"]
    with use_plot_style():
        below = legend_height(names, columns=3, note=note)
        figure = new_figure(row_inches * len(methods) + 0.95 + below, title=title)
        axes = figure.subplots()
        axes.axvspan(-1, 1, color=BAND, alpha=0.3, lw=0)
        axes.axvline(0, color=INK, lw=1.1)
        for row in range(len(methods)):
            axes.axhline(row, color=GREY, lw=0.6, zorder=0)
        for number, (light, style) in enumerate(lights.items()):
            group = [r for r in records if (r.light or NO_LIGHT) == light]
            offset = (number - (len(lights) - 1) / 2) * 0.66 / max(len(lights), 3)
            answered = [(r.error_dof, methods.index(r.method) + offset) for r in group if r.error_dof is not None]
            silent = [(reach, methods.index(r.method) + offset) for r in group if r.status != "answered"]
            if many:
                silent = sorted(set(silent))
                answered = _draw_spread(axes, answered, colour=style.colour)
            for points, marker, more in ((answered, style.marker, {"mec": PAPER}), (silent, "x", {"mew": 1.3})):
                if points:
                    xy = np.array(points, dtype=np.float64).T
                    options: dict[str, Any] = {"ms": size, "mew": 0.5, "ls": "", "clip_on": False, **more}
                    axes.plot(*xy, marker=marker, color=style.colour, **options)
        _set_signed_error_axis(axes, reach)
        axes.set_yticks(range(len(methods)), [shorten(m, MAX_LABEL_CHARACTERS) for m in methods])
        axes.set_ylim(len(methods) - 0.4, -0.6)
        axes.tick_params(axis="y", length=0, labelsize=7.5)
        hide_spines(axes, "left", "right", "top")
        add_legend(figure, marks, names=names, columns=3, note=note)
    return figure


def _draw_spread(axes: Axes, points: Sequence[tuple[float, float]], *, colour: str) -> list[tuple[float, float]]:
    """Draw a line over the middle 90 % of the errors at each height, and return the medians at these heights."""
    by_height: dict[float, list[float]] = {}
    for error, height in points:
        by_height.setdefault(height, []).append(error)
    medians = []
    for height, errors in by_height.items():
        low, median, high = np.quantile(errors, [0.05, 0.5, 0.95])
        axes.plot([low, high], [height, height], color=colour, lw=1.1, solid_capstyle="butt")
        medians.append((float(median), height))
    return medians


def _set_signed_error_axis(axes: Axes, reach: float) -> None:
    axes.set_xscale("symlog", linthresh=1, linscale=0.8)
    axes.set_xlim(-reach, reach)
    powers = 10.0 ** np.arange(0, int(math.log10(reach)) + 1)
    axes.xaxis.set_major_locator(FixedLocator([*-powers[::-1], 0, *powers]))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:+g}".replace("-", "−") if x else "0"))
    axes.set_xlabel("answer − truth, depths of focus")


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


def bin_sequences(records: Sequence[Record], condition: Condition) -> list[tuple[float, frozenset[str]]]:
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


def plot_condition(
    records: Sequence[Record], condition: Condition, *, styles: Mapping[str, PlotStyle], title: str
) -> Figure | None:
    """Return the figure of one search: answerable success within 1 DoF above, median error below, a line per measure.

    ``styles`` gives the order of the measures, of which the first MAX_MEASURES are drawn; the figure says if
    others are left out. The result is None if bin_sequences returns no group or no error is known.
    """
    groups = bin_sequences(records, condition)
    present = {split_method(r.method)[0] for r in records}
    known = [m for m in styles if m in present]
    measures = known[:MAX_MEASURES]
    note = describe_omissions((len(measures), len(known), "measures"))
    if not groups or all(r.error_dof is None for r in records):
        return None
    with use_plot_style():
        figure = new_figure(3.35 + legend_height(measures, note=note), title=title)
        above, below = figure.subplots(2, sharex=True, gridspec_kw={"height_ratios": [1, 1.3]})
        below.axhspan(0, 1, color=BAND, alpha=0.3, lw=0)
        for measure in measures:
            own = [r for r in records if split_method(r.method)[0] == measure]
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
        add_legend(figure, [styles[m].legend_handle() for m in measures], names=measures, note=note)
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
    success = [(x, mean_over_scenes(group, right_within())) for x, group in members]
    error = [(x, median_magnitude(r.error_dof for r in group if r.answerable is not False)) for x, group in members]
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
