"""Figures that compare methods: performance profiles, and pairs of neighbours in rank."""

from collections.abc import Mapping, Sequence

from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullLocator

from saf_gen.core.figure_style import GREY, INK, MAX_MEASURES, SOFT, assign_styles, hide_spines, use_plot_style
from saf_gen.leaderboard.figures._figure import (
    MAX_LABEL_CHARACTERS,
    create_leaderboard_figure,
    describe_figure_omissions,
    shorten_figure_label,
)
from saf_gen.leaderboard.figures._legend import add_figure_legend, figure_legend_height
from saf_gen.leaderboard.method_comparison import NeighbourComparison, Profile

BANDS = 3
"""Number of methods, best first, that have a band; more bands would hide each other."""
MAX_PAIRS = 30
"""Largest number of pairs of neighbours in a figure; the first pairs are drawn."""
AXIS_LABELS: Mapping[str, str] = {
    "error_dof": "|answer − truth| at most, depths of focus",
    "time_s": "in focus within, seconds",
}


def plot_profile_figure(profiles: Sequence[Profile], *, title: str) -> Figure:
    """Return the figure of the profiles of one quantity: the fraction of answers within each limit.

    The first MAX_MEASURES methods are drawn, the first BANDS of them with a band for the interval. The figure says if
    methods are left out.
    """
    shown = list(profiles[:MAX_MEASURES])
    note = describe_figure_omissions((len(shown), len(profiles), "methods"))
    styles = assign_styles([profile.method for profile in shown])
    names = list(styles)
    with use_plot_style():
        figure = create_leaderboard_figure(2.7 + figure_legend_height(names, note=note), title=title)
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
        add_figure_legend(figure, [styles[n].legend_handle() for n in names], names=names, note=note)
    return figure


def plot_neighbour_figure(neighbours: Sequence[NeighbourComparison], *, title: str) -> Figure:
    """Return the figure of the probability of improvement between neighbours in rank, with intervals."""
    shown = list(neighbours[:MAX_PAIRS])
    note = describe_figure_omissions((len(shown), len(neighbours), "pairs"))
    with use_plot_style():
        figure = create_leaderboard_figure(0.9 + 0.33 * len(shown), title=title)
        axes = figure.subplots()
        axes.axvline(0.5, color=INK, lw=1.1)
        for row, pair in enumerate(shown):
            if pair.improvement_low is not None and pair.improvement_high is not None:
                axes.plot([pair.improvement_low, pair.improvement_high], [row, row], color=SOFT, lw=1.3)
            axes.plot(pair.improvement, row, "o", color=INK, ms=4)
        labels = [
            "\n".join(shorten_figure_label(name, MAX_LABEL_CHARACTERS) for name in (pair.first, pair.second))
            for pair in shown
        ]
        axes.set_yticks(range(len(shown)), labels, fontsize=7.5)
        axes.set_ylim(len(shown) - 0.5, -0.5)
        axes.set_xlim(0, 1)
        axes.set_xticks([0, 0.25, 0.5, 0.75, 1], ["0", "¼", "½", "¾", "1"])
        axes.set_xlabel("probability that the upper method is nearer" + (f" ({note})" if note else ""))
        axes.grid(axis="x", color=GREY, lw=0.6)
        axes.set_axisbelow(True)
        hide_spines(axes, "top", "right")
    return figure
