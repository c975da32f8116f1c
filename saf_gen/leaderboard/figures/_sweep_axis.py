"""Common parts of the figures of a sweep: the horizontal axis, and the truth on it."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from saf_gen.benchmark.judgement import lens_position
from saf_gen.benchmark.results import SweepSummary
from saf_gen.core.figure_style import BAND, GREY, INK, SOFT
from saf_gen.optics.focus_crossings import focus_crossings

LENS_LINE: dict[str, Any] = {"color": SOFT, "lw": 0.9, "ls": (0, (7, 2))}


def find_figure_position_axis(sweep: SweepSummary) -> np.ndarray | None:
    """Return the focus position (T,) if it can be the axis, because the lens never turns back or rests; else None."""
    lens = sweep.focus_position
    if lens is None or len(lens) < 2:
        return None
    moves = np.sign(float(lens[-1]) - float(lens[0])) * np.diff(lens)
    centres = np.interp(sweep.frames, np.arange(len(lens)), lens)
    steps = np.abs(np.diff(centres)) if centres.size > 1 else np.abs(moves)
    return lens if moves.min() >= 0 and moves.any() and steps.min() > 0.02 * steps.mean() else None


def frames_to_figure_axis(sweep: SweepSummary) -> Callable[[np.ndarray], np.ndarray]:
    """Return the function that maps frames to the axis: the focus position if it can be the axis, else the frame."""
    lens = find_figure_position_axis(sweep)
    if lens is None:
        return lambda frames: frames
    return lambda frames: np.interp(frames, np.arange(len(lens)), lens)


def plot_figure_truth(axes: Axes, sweep: SweepSummary, *, note: bool = True) -> None:
    """Draw the truth as a line in a band that shows its depth of focus; on an axis of frames, at every crossing.

    With ``note``, an axis of frames also gets the position of the lens, and an axis of positions gets a text if the
    truth is outside it.
    """
    over_frames = find_figure_position_axis(sweep) is None
    if over_frames and sweep.focus_position is not None:
        _draw_truth_over_frames(axes, sweep, lens=sweep.focus_position, draw_lens=note)
        return
    truth = sweep.truth_frame if over_frames else sweep.truth
    if not math.isfinite(truth):
        return
    limits = axes.get_xlim()
    if not over_frames and all(map(math.isfinite, sweep.depth_of_focus)):
        axes.axvspan(*sorted(sweep.depth_of_focus), color=BAND, alpha=0.45, lw=0, zorder=0.5)
    axes.axvline(truth, color=INK, lw=1.1, zorder=0.6)
    axes.set_xlim(limits)
    if note and not min(limits) <= truth <= max(limits):
        is_right = (truth > max(limits)) == (limits[0] < limits[1])
        text = f"focus at {truth:.2f} →" if is_right else f"← focus at {truth:.2f}"
        x, side = (0.99, "right") if is_right else (0.01, "left")
        axes.text(x, 0.9, text, transform=axes.get_yaxis_transform(), ha=side)


def find_figure_frames_in_focus(sweep: SweepSummary, lens: np.ndarray) -> np.ndarray:
    """Return whether the lens is within the depth of focus in each frame, bool (T,); False if that is unknown."""
    offset = _focus_offset(sweep, lens)
    near, far = sorted(sweep.depth_of_focus)
    return np.asarray((offset >= near - sweep.truth) & (offset <= far - sweep.truth))


def find_figure_runs(where: np.ndarray) -> list[tuple[int, int]]:
    """Return the first and the stop index of each run of True in ``where``, bool (T,)."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], where.astype(int), [0]))))
    return [(int(first), int(stop)) for first, stop in edges.reshape(-1, 2)]


def find_figure_truth_crossings(sweep: SweepSummary, lens: np.ndarray) -> np.ndarray:
    """Return the frames at which the lens crosses the truth."""
    return focus_crossings(_focus_offset(sweep, lens), 0.0)


def _focus_offset(sweep: SweepSummary, lens: np.ndarray) -> np.ndarray:
    """Return lens minus truth in each frame, float64 (T,), as a fraction of the travel."""
    return np.asarray(np.asarray(lens, dtype=np.float64) - (sweep.truth if sweep.track is None else sweep.track))


def _draw_truth_over_frames(axes: Axes, sweep: SweepSummary, *, lens: np.ndarray, draw_lens: bool) -> None:
    """Draw each crossing of the truth and the frames in which the lens is in focus.

    With ``draw_lens``, also draw the position of the lens and, if the truth moves, the position of the truth.
    """
    all_frames, height = np.arange(len(lens)), axes.get_xaxis_transform()
    frames = np.linspace(0, len(lens) - 1, min(len(lens), 400))
    if draw_lens:
        axes.plot(frames, np.interp(frames, all_frames, lens), **LENS_LINE, zorder=0.7)
        if sweep.track is not None:
            moving = np.interp(frames, all_frames, sweep.track)
            axes.plot(frames, moving, color=INK, lw=0.9, ls=":", zorder=0.7)
    for first, stop in find_figure_runs(find_figure_frames_in_focus(sweep, lens)):
        axes.axvspan(first, stop, color=BAND, alpha=0.45, lw=0, zorder=0.5)
    axes.vlines(find_figure_truth_crossings(sweep, lens), 0, 1, color=INK, lw=1.1, zorder=0.6, transform=height)


def add_figure_frame_axis(axes: Axes, sweep: SweepSummary, *, label: Axes) -> None:
    """Set the limits and label of the horizontal axis; an axis of positions gets frames along the top."""
    lens = find_figure_position_axis(sweep)
    if lens is None:
        label.set_xlim(0, sweep.frames[-1] + sweep.frames[0])
        label.set_xlabel("frame")
        return
    label.set_xlim(float(lens.min()), float(lens.max()))
    label.set_xlabel("focus position, fraction of travel")
    ticks = [t for t in MaxNLocator(4, steps=[1, 2, 2.5, 5, 10]).tick_values(0, len(lens) - 1) if 0 <= t <= len(lens)]
    upper = axes.secondary_xaxis("top")
    upper.set_xticks([lens_position(t, lens) for t in ticks], [f"{t:,.0f}" for t in ticks])
    upper.tick_params(colors=SOFT, labelcolor=SOFT, labelsize=7.5, pad=1, length=2.5)
    upper.spines["top"].set_color(GREY)
    upper.set_xlabel("frame", fontsize=7.5, color=SOFT, labelpad=4)
