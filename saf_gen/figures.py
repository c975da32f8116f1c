"""Focus curves and errors as pictures, one scene a figure.

Figures are drawn on the Agg canvas of their own Figure, so nothing depends on a screen or on pyplot's state.
"""

import io
import math
from collections.abc import Callable, Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.legend_handler import HandlerTuple
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator

from saf_gen.evaluate import Sweep
from saf_gen.passes import passes
from saf_gen.scores import Record, position_at

__all__ = ["WIDTH_PX", "curves_figure", "errors_figure", "normalised", "to_png"]

WIDTH_PX = 1600
_DPI = 160
_INK, _SOFT, _BAND, _GREY = "#1f2328", "#6b7280", "#e8c547", "#d5d8dc"
# Okabe and Ito's colours can be told apart with any colour vision; dashes and markers say the same again.
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#000000", "#E69F00", "#8c6d31")
_DASHES: tuple[str | tuple[float, tuple[float, ...]], ...] = (
    "-",
    (0, (5, 1.5)),
    (0, (1.2, 1.2)),
    (0, (6, 1.5, 1.2, 1.5)),
    (0, (3, 1.2)),
    (0, (8, 2)),
    (0, (4, 1, 1, 1, 1, 1)),
    (0, (1, 2)),
)
_MARKERS = "osD^vPX*"
_STYLE: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 8.5,
    "axes.edgecolor": _SOFT,
    "axes.labelcolor": _INK,
    "axes.linewidth": 0.8,
    "axes.titlesize": 10,
    "text.color": _INK,
    "xtick.color": _SOFT,
    "ytick.color": _SOFT,
    "xtick.labelcolor": _INK,
    "ytick.labelcolor": _INK,
    "legend.frameon": False,
    "figure.facecolor": "white",
}
_LENS_LINE: dict[str, Any] = {"color": _SOFT, "lw": 0.9, "ls": (0, (7, 2))}
_ROW = 0.062  # height of one measure's row in the strip of argmax marks, in units of the score


def normalised(scores: np.ndarray) -> np.ndarray:
    """Scores (B,) moved and scaled to 0…1, as in the paper's Fig. 4; a flat curve is 0, NaN stays NaN."""
    values = np.asarray(scores, dtype=np.float64)
    finite = values[np.isfinite(values)]
    if finite.size == 0 or finite.max() == finite.min():
        return np.where(np.isfinite(values), 0.0, np.nan)
    return (values - finite.min()) / (finite.max() - finite.min())


def to_png(figure: Figure) -> bytes:
    """The figure as a PNG, WIDTH_PX wide; the same figure gives the same bytes."""
    buffer = io.BytesIO()
    with matplotlib.rc_context(_STYLE):
        figure.savefig(buffer, format="png", dpi=_DPI, metadata={"Software": ""})
    return buffer.getvalue()


def curves_figure(sweeps: Sequence[Sweep], *, title: str) -> Figure:
    """Focus curves of one scene: a panel for each sweep (light schedule), all measures in each.

    Curves run over the focus position, or over frames with the position as a line where the lens comes back
    or rests. Each is normalised by its own range, with the light (mean counts) as a grey area under them, the
    truth as a line in a band, its depth of focus, and above the curves a row for each measure with its
    argmax. Measures whose curves coincide in every panel share a line.
    """
    across = min(len(sweeps), 3)
    down = math.ceil(len(sweeps) / across)
    groups = _coincident(sweeps)
    with matplotlib.rc_context(_STYLE):
        figure = _figure(3.55 * down + 1.25)
        grid = figure.subplots(down, across, squeeze=False, sharey=True)
        brightest = max(float(np.nanmax(s.rate, initial=0.0)) for s in sweeps) or 1.0
        for number, (axes, sweep) in enumerate(zip(grid.flat, sweeps, strict=False)):
            last = number % across == across - 1 or number == len(sweeps) - 1
            _panel(axes, sweep, groups, brightest=brightest, first=number % across == 0, last=last)
        for axes in grid.flat[len(sweeps) :]:
            axes.set_visible(False)
        figure.suptitle(title, x=0.012, ha="left", fontsize=12, fontweight="bold")
        handles: list = [_line(i) for i in range(len(groups))]
        names = [" = ".join(group) for group in groups]
        extra = [Patch(color=_GREY), (Patch(color=_BAND, alpha=0.45), Line2D([], [], color=_INK, lw=1.2))]
        extra_names = ["light (mean counts)", "true focus in its depth of focus"]
        if any(_lens(s) is None and s.focus_position is not None for s in sweeps):
            extra.append(Line2D([], [], **_LENS_LINE))
            extra_names.append("focus position, 0 to 1")
        figure.legend(
            handles + extra,
            names + extra_names,
            handler_map={tuple: HandlerTuple(ndivide=1, pad=0)},
            loc="outside lower center",
            ncols=min(len(names + extra_names), 5),
            handlelength=3.2,
            columnspacing=1.6,
        )
    return figure


def errors_figure(records: Sequence[Record], *, title: str) -> Figure:
    """Errors of one scene: a row for each method in the order given, a mark for each light schedule."""
    methods = list(dict.fromkeys(r.method for r in records))
    lights = list(dict.fromkeys(r.light or "recording" for r in records))
    known = [abs(r.error_dof) for r in records if r.error_dof is not None]
    reach = max([3.0, *known]) * 1.3
    with matplotlib.rc_context(_STYLE):
        figure = _figure(0.26 * len(methods) + 1.7)
        axes = figure.subplots()
        axes.axvspan(-1, 1, color=_BAND, alpha=0.3, lw=0)
        axes.axvline(0, color=_INK, lw=1.2)
        for row in range(len(methods)):
            axes.axhline(row, color=_GREY, lw=0.6, zorder=0)
        for record in records:
            number = lights.index(record.light or "recording")
            offset = (number - (len(lights) - 1) / 2) * 0.66 / max(len(lights), 3)
            height = methods.index(record.method) + offset
            colour, marker = _COLOURS[number % 8], _MARKERS[number % 8]
            if record.error_dof is not None:
                axes.plot(record.error_dof, height, marker, color=colour, ms=5, mec="white", mew=0.5)
            elif record.status != "answered":
                axes.plot(reach, height, "x", color=colour, ms=5, mew=1.4, clip_on=False)
        axes.set_xscale("symlog", linthresh=1, linscale=0.8)
        axes.set_xlim(-reach, reach)
        axes.xaxis.set_major_locator(_decades(reach))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:+g}".replace("-", "−") if x else "0"))
        axes.set_yticks(range(len(methods)), methods)
        axes.set_ylim(len(methods) - 0.4, -0.6)
        axes.tick_params(axis="y", length=0)
        for side in ("left", "right", "top"):
            axes.spines[side].set_visible(False)
        axes.set_xlabel("answer − truth, depths of focus (linear within ±1, logarithmic beyond)")
        figure.suptitle(title, x=0.012, ha="left", fontsize=12, fontweight="bold")
        marks: list[Any] = [
            Line2D([], [], ls="", marker=_MARKERS[i % 8], color=_COLOURS[i % 8], mec="white", ms=7)
            for i in range(len(lights))
        ]
        marks += [Patch(color=_BAND, alpha=0.3), Line2D([], [], ls="", marker="x", color=_SOFT, mew=1.4)]
        figure.legend(
            marks,
            [*lights, "success: within 1", "no answer"],
            loc="outside lower center",
            ncols=min(len(marks), 6),
        )
    return figure


def _figure(inches: float) -> Figure:
    figure = Figure(figsize=(WIDTH_PX / _DPI, inches), dpi=_DPI, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def _decades(reach: float) -> FixedLocator:
    powers = 10.0 ** np.arange(0, math.floor(math.log10(reach)) + 1)
    return FixedLocator([*-powers[::-1], 0, *powers])


def _line(number: int) -> Line2D:
    style = number % 8
    return Line2D(
        [],
        [],
        color=_COLOURS[style],
        ls=_DASHES[style],
        lw=1.5,
        marker=_MARKERS[style],
        ms=6,
        mec="white",
        mew=0.6,
    )


def _coincident(sweeps: Sequence[Sweep]) -> list[list[str]]:
    """Measures in their order, those whose curves cannot be told apart in any panel together."""
    drawn = [{c.measure: normalised(c.scores) for c in s.curves} for s in sweeps]
    groups: list[list[str]] = []
    for measure in dict.fromkeys(m for curves in drawn for m in curves):
        for group in groups:
            if all(_same(curves.get(measure), curves.get(group[0])) for curves in drawn):
                group.append(measure)
                break
        else:
            groups.append([measure])
    return groups


def _same(a: np.ndarray | None, b: np.ndarray | None) -> bool:
    return (
        a is not None
        and b is not None
        and a.shape == b.shape
        and np.allclose(a, b, atol=1e-3, equal_nan=True)
    )


def _panel(
    axes: Axes, sweep: Sweep, groups: list[list[str]], *, brightest: float, first: bool, last: bool
) -> None:
    place = _places(sweep)
    light = axes.twinx()
    axes.set_zorder(light.get_zorder() + 1)
    axes.patch.set_visible(False)
    light.fill_between(place(sweep.frames), sweep.rate, color=_GREY, lw=0, step="mid")
    top = 1.08 + _ROW * len(groups)
    light.set_ylim(0, brightest * top)  # the brightest light reaches a score of 1
    light.set_yticks([t for t in MaxNLocator(4).tick_values(0, brightest) if 0 <= t <= brightest * 1.01])
    light.tick_params(axis="y", right=last, labelright=last)
    if last:
        light.set_ylabel("light, spikes a pixel and readout", color=_SOFT)
    by_name = {c.measure: c for c in sweep.curves}
    for number, group in enumerate(groups):
        if (curve := by_name.get(group[0])) is None:
            continue
        style = number % 8
        axes.plot(
            place(curve.frames), normalised(curve.scores), color=_COLOURS[style], ls=_DASHES[style], lw=1.4
        )
        if curve.answer is not None:
            row = top - _ROW * (number + 0.7)
            x = place(np.array([curve.answer]))
            axes.plot(
                x, row, _MARKERS[style], color=_COLOURS[style], ms=6, mec="white", mew=0.6, clip_on=False
            )
    axes.axhline(1.04, color=_GREY, lw=0.8)
    axes.set_ylim(0, top)
    axes.set_yticks([0, 0.25, 0.5, 0.75, 1, 1.06 + _ROW * len(groups) / 2])
    axes.set_yticklabels(["0", "", "0.5", "", "1", "argmax"])
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
        light.spines[side].set_visible(False)
    light.spines["left"].set_visible(False)
    if first:
        axes.set_ylabel("focus score, normalised")
    axes.set_title(sweep.light or sweep.sequence, fontweight="bold", pad=8)
    _frames_on_top(axes, sweep)
    _truth(axes, sweep)


def _lens(sweep: Sweep) -> np.ndarray | None:
    """The focus position (T,) where it can be an axis: the lens never comes back and never rests."""
    lens = sweep.focus_position
    if lens is None or len(lens) < 2:
        return None
    way = np.sign(float(lens[-1]) - float(lens[0])) * np.diff(lens)
    centres = np.interp(sweep.frames, np.arange(len(lens)), lens)
    steps = np.abs(np.diff(centres)) if centres.size > 1 else np.abs(way)
    return lens if way.min() >= 0 and way.any() and steps.min() > 0.02 * steps.mean() else None


def _places(sweep: Sweep) -> Callable[[np.ndarray], np.ndarray]:
    """Frames to the horizontal axis: the focus position where it can be one, else the frame."""
    lens = _lens(sweep)
    if lens is None:
        return lambda frames: frames
    return lambda frames: np.interp(frames, np.arange(len(lens)), lens)


def _truth(axes: Axes, sweep: Sweep) -> None:
    over_frames = _lens(sweep) is None
    if over_frames and sweep.focus_position is not None:
        _truth_over_frames(axes, sweep, sweep.focus_position)
        return
    truth = sweep.truth_frame if over_frames else sweep.truth
    if not math.isfinite(truth):
        return
    if not over_frames and all(map(math.isfinite, sweep.depth_of_focus)):
        axes.axvspan(*sorted(sweep.depth_of_focus), color=_BAND, alpha=0.45, lw=0, zorder=0.5)
    axes.axvline(truth, color=_INK, lw=1.2, zorder=0.6)
    left, right = axes.get_xlim()
    if not left <= truth <= right:
        side, note = (1, f"focus at {truth:.2f} →") if truth > right else (0, f"← focus at {truth:.2f}")
        axes.text(
            side,
            0.9,
            note,
            transform=axes.get_yaxis_transform(),
            ha="right" if side else "left",
            backgroundcolor="white",
        )


def _truth_over_frames(axes: Axes, sweep: Sweep, lens: np.ndarray) -> None:
    """The lens, the truth where it moves, each pass of it, and when the lens is within the depth of focus."""
    frames = np.linspace(0, len(lens) - 1, min(len(lens), 4000))
    axes.plot(frames, np.interp(frames, np.arange(len(lens)), lens), **_LENS_LINE, zorder=0.7)
    height = axes.get_xaxis_transform()
    truth = np.full(len(lens), sweep.truth) if sweep.track is None else sweep.track
    if sweep.track is not None:
        axes.plot(
            frames, np.interp(frames, np.arange(len(lens)), truth), color=_INK, lw=0.9, ls=":", zorder=0.7
        )
    near, far = sorted(sweep.depth_of_focus)
    away = np.asarray(lens, dtype=np.float64) - truth
    within = (away >= near - sweep.truth) & (away <= far - sweep.truth)  # nowhere, where they are unknown
    everywhere = np.arange(len(lens))
    axes.fill_between(
        everywhere, 0, 1, where=within, color=_BAND, alpha=0.45, transform=height, lw=0, zorder=0.5
    )
    axes.vlines(passes(away, 0.0), 0, 1, color=_INK, lw=1.2, zorder=0.6, transform=height)


def _frames_on_top(axes: Axes, sweep: Sweep) -> None:
    lens = _lens(sweep)
    if lens is None:
        axes.set_xlim(0, sweep.frames[-1] + sweep.frames[0])
        axes.set_xlabel("frame")
        return
    axes.set_xlim(float(lens.min()), float(lens.max()))
    axes.set_xlabel("focus position, fraction of travel")
    nice = MaxNLocator(4, steps=[1, 2, 2.5, 5, 10]).tick_values(0, len(lens) - 1)
    ticks = [t for t in nice if 0 <= t <= len(lens)]
    upper = axes.secondary_xaxis("top")
    upper.set_xticks([position_at(t, lens) for t in ticks], [f"{t:,.0f}" for t in ticks])
    upper.tick_params(colors=_SOFT, labelcolor=_SOFT, labelsize=7.5, pad=1)
    upper.spines["top"].set_color(_GREY)
    upper.set_xlabel("frame", fontsize=7.5, color=_SOFT, labelpad=2)
