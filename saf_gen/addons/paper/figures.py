"""Figures 4 to 7 of the paper, and a figure of its Section 4.3: success against the Δt of naive SAF."""

from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from saf_gen.addons.paper.claims import success_by_window
from saf_gen.addons.paper.conditions import EGS, LIGHTS, MEASURES, MOTIONS, SGFS, PaperRun, positions, stop_frame
from saf_gen.benchmark.results import SweepSummary
from saf_gen.core.figure_style import BAND, COLOURS, DASHES, GREY, INK, STYLE, hide_spines, use_plot_style
from saf_gen.leaderboard.report.charts import normalise

WIDTH_INCHES, DOTS_PER_INCH = 8.4, 200
AXIS = "position of the lens, fraction of its travel"
LIGHT_TITLES = {"constant": "constant light", "continuous": "continuous variations", "sudden": "sudden changes"}
TURQUOISE, RED = COLOURS[2], COLOURS[1]
STYLES = dict(zip(MEASURES, zip(COLOURS, DASHES, strict=True), strict=False))
ANSWERS = {
    "SD": "sd_code+argmax", "SD, SGFS": SGFS, **{MEASURES[m]: f"{m}+argmax" for m in MEASURES if m != "sd_code"},
}  # fmt: skip
"""Methods whose answers Figure 6 marks, by their label."""


CURVES = (
    "Focus scores against the position of the lens, each scaled to its range: {}. Grey: the light; black: the true "
    "focus, with one depth of focus in yellow; triangles: the largest score of each measure."
)


def draw_figures(run: PaperRun) -> dict[str, tuple[Figure, str]]:
    """Return the figures, each with its caption, by the name of its file."""
    makers: dict[str, tuple[Callable[[], Figure], str]] = {
        "figure-4": (lambda: draw_curves(run, "figure-4"), CURVES),
        "figure-5": (lambda: draw_curves(run, "figure-5"), CURVES),
        "figure-6": (
            lambda: draw_answers(run),
            "Continuous variations: {}. Above: focus scores. Below: answers as arrows from the true focus, with their "
            "positions.",
        ),
        "figure-7": (
            lambda: draw_search(run),
            "SGFS beside EGS: {}. Left: SD, and SD in real time, whose largest value stops the sweep (dot); the grey "
            "part need not be seen. Right: positions during the search.",
        ),
        "naive": (
            lambda: draw_windows(run),
            "Answers within one depth of focus of naive SAF against its Δt, with EGS and SGFS, which choose none.",
        ),
    }
    names = {name: " and ".join(f"{s} ({m})" for s, m in shown) for name, shown in run.scenes.items()} | {"naive": ""}
    with use_plot_style({**STYLE, "figure.facecolor": "white"}):
        return {name: (make(), text.format(names[name])) for name, (make, text) in makers.items() if name in names}


def _make_figure(height: float) -> Figure:
    figure = Figure(figsize=(WIDTH_INCHES, height), dpi=DOTS_PER_INCH, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def _plot_sweep(axes: Axes, sweep: SweepSummary) -> None:
    """Draw the light, the truth and the curves of a sweep, over the position of the lens."""
    axes.fill_between(positions(sweep, sweep.frames), sweep.rate / sweep.rate.max(), color=GREY, lw=0, step="mid")
    _plot_truth(axes, sweep)
    for curve in sweep.curves:
        colour, dashes = STYLES[curve.measure]
        lens, scores = positions(sweep, curve.frames), normalise(curve.scores)
        axes.plot(lens, scores, color=colour, ls=dashes, lw=1.4, label=curve.measure)
        axes.plot(lens[scores.argmax()], 1.06, marker="v", ms=4, color=colour, ls="", clip_on=False)
    _set_axes(axes)


def _plot_truth(axes: Axes, sweep: SweepSummary) -> None:
    if all(np.isfinite(sweep.depth_of_focus)):
        axes.axvspan(*sorted(sweep.depth_of_focus), color=BAND, alpha=0.45, lw=0)
    axes.axvline(sweep.truth, color=INK, lw=1.0)


def _set_axes(axes: Axes) -> None:
    axes.set(xlim=(0, 1), ylim=(0, 1.03), yticks=[0, 1])
    axes.set_xticks([0, 0.5, 1], ["0", "0.5", "1"])
    hide_spines(axes, "top", "right")


def _legend(*more: Line2D | Patch) -> list[Line2D | Patch]:
    lines = [Line2D([], [], color=STYLES[m][0], ls=STYLES[m][1], lw=1.4, label=label) for m, label in MEASURES.items()]
    return [*lines, *more, Line2D([], [], color=INK, lw=1.0, label="true focus")]


def draw_curves(run: PaperRun, name: str) -> Figure:
    """Return Figure 4 or 5: the curves of the measures under three lights, a row for each motion."""
    figure = _make_figure(4.2)
    panels = figure.subplots(2, len(LIGHTS), sharex=True, sharey=True)
    for line, (scene, motion) in zip(panels, run.scenes[name], strict=True):
        for axes, light in zip(line, LIGHTS, strict=True):
            _plot_sweep(axes, run.sweep(scene, motion=motion, light=light))
            if motion == MOTIONS[0]:
                axes.set_title(LIGHT_TITLES[light], loc="left", pad=9)
        line[0].set_ylabel(f"{scene}\n{motion}: score")
    panels[-1][1].set_xlabel(AXIS)
    figure.legend(handles=_legend(Patch(color=GREY, label="light")), loc="outside lower center", ncols=6)
    return figure


def draw_answers(run: PaperRun) -> Figure:
    """Return Figure 6: curves of two scenes under varying light, and the answers of five methods as arrows."""
    figure = _make_figure(4.4)
    panels = figure.subplots(2, len(run.scenes["figure-6"]), sharex=True, squeeze=False)
    for column, (scene, motion) in enumerate(run.scenes["figure-6"]):
        sweep = run.sweep(scene, motion=motion, light="continuous")
        above, below = panels[:, column]
        _plot_sweep(above, sweep)
        above.set_title(f"{scene}, {motion}: true focus {sweep.truth:.3f}", loc="left", pad=9)
        _plot_truth(below, sweep)
        for row, (label, method) in enumerate(ANSWERS.items()):
            position = run.record(sweep.sequence, method).judgement.position
            if position is None:
                continue
            colour = STYLES[next(m for m, name in MEASURES.items() if label.startswith(name))][0]
            arrow = {"arrowstyle": "-|>", "color": colour, "lw": 1.4, "shrinkA": 0, "shrinkB": 0}
            below.annotate("", (position, row), (sweep.truth, row), arrowprops=arrow)
            is_right = position < sweep.truth  # a number stands behind a short arrow, above the head of a long one
            is_long = abs(position - sweep.truth) > 0.15
            below.annotate(
                f"{position:.3f}", (position if is_long else sweep.truth, row),
                (0 if is_long else 10 if is_right else -10, 3 if is_long else 0), textcoords="offset points",
                ha="left" if is_right else "right", va="bottom" if is_long else "center", fontsize=7.5,
            )  # fmt: skip
        _set_axes(below)
        below.set_yticks(range(len(ANSWERS)), list(ANSWERS) if column == 0 else [""] * len(ANSWERS))
        below.set(ylim=(len(ANSWERS) - 0.4, -0.6), xlabel=AXIS)
    panels[0][0].set_ylabel("score")
    figure.legend(handles=_legend(Patch(color=GREY, label="light")), loc="outside lower center", ncols=6)
    return figure


def draw_search(run: PaperRun) -> Figure:
    """Return Figure 7: where SGFS stops on two scenes, and the positions during its search beside those of EGS."""
    figure = _make_figure(4.6)
    panels = figure.subplots(len(run.scenes["figure-7"]), 2, squeeze=False)
    for line, (scene, motion) in zip(panels, run.scenes["figure-7"], strict=True):
        sweep = run.sweep(scene, motion=motion, light="constant")
        records = {name: run.record(sweep.sequence, method) for name, method in (("EGS", EGS), ("SGFS", SGFS))}
        ends, feedback = run.feedback[sweep.sequence]
        left, right = line
        stop = stop_frame(records["SGFS"])
        _plot_truth(left, sweep)
        left.axvspan(float(positions(sweep, [stop - 1])[0]), 1, color=GREY, lw=0)
        sd = next(curve for curve in sweep.curves if curve.measure == "sd_code")
        left.plot(positions(sweep, sd.frames), normalise(sd.scores), color=COLOURS[0], lw=1.4, label="sd_code")
        heights = normalise(feedback)
        left.plot(positions(sweep, ends - 1), heights, color=TURQUOISE, ls=DASHES[1], lw=1.4, label="sd_rt")
        top = float(np.interp(stop, ends, heights))
        left.plot(positions(sweep, [stop - 1]), [top], "o", color=RED, ms=5, clip_on=False, zorder=3)
        _set_axes(left)
        left.set_title(f"{scene}, {motion}", loc="left")
        left.set_ylabel("score")
        for (name, record), colour, dashes in zip(records.items(), COLOURS, DASHES, strict=False):
            path = positions(sweep, np.array(record.judgement.trace) - 1)
            right.plot(path, color=colour, ls=dashes, lw=1.2, marker="o", ms=2.5, label=name)
        right.axhline(sweep.truth, color=INK, ls="--", lw=1.0)
        right.set(ylim=(0, 1), ylabel="position")
        right.set_yticks([0, 0.5, 1], ["0", "0.5", "1"])
        hide_spines(right, "top", "right")
    panels[-1][0].set_xlabel(AXIS)
    panels[-1][1].set_xlabel("step of the search")
    handles = [
        Line2D([], [], color=COLOURS[0], lw=1.4, label="SD; EGS"),
        Line2D([], [], color=TURQUOISE, ls=DASHES[1], lw=1.4, label="SD in real time"),
        Line2D([], [], color=COLOURS[1], ls=DASHES[1], marker="o", ms=2.5, lw=1.2, label="SGFS"),
        Line2D([], [], color=RED, marker="o", ls="", ms=5, label="stop"),
        Patch(color=GREY, label="never seen"),
        Line2D([], [], color=INK, lw=1.0, label="true focus"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=6)
    return figure


def draw_windows(run: PaperRun) -> Figure:
    """Return the figure of Section 4.3: success of naive SAF against Δt, with EGS and SGFS as levels."""
    figure = _make_figure(3.0)
    axes = figure.subplots()
    rates = {method: rate for method, (rate, _) in success_by_window(run).items()}
    windows = list(run.naive)
    axes.plot(windows, [100 * rates[m] for m in run.naive.values()], color=COLOURS[0], marker="o", ms=4, label="naive")
    for name, method, place in (("EGS", EGS, 1), ("SGFS", SGFS, 2)):
        axes.axhline(100 * rates[method], color=COLOURS[place], ls=DASHES[place], lw=1.4, label=name)
    axes.set_xscale("log")
    axes.set_xticks(windows, [str(dt) for dt in windows])
    axes.minorticks_off()
    axes.set(xlabel="Δt, frames", ylabel="within one depth of focus, %", ylim=(0, 105), yticks=[0, 50, 100])
    hide_spines(axes, "top", "right")
    figure.legend(loc="outside lower center", ncols=3)
    return figure
