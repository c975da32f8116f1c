"""Selection, drawing and naming of the figures of an evaluation, and the viewer of the pictures of a sweep."""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite, nan
from typing import Any

import numpy as np

from saf_gen.benchmark.evaluate import DRAWN_SEQUENCES
from saf_gen.benchmark.judgement import judged_dof
from saf_gen.benchmark.records import Record
from saf_gen.benchmark.results import Evaluation, LensPath, SweepSummary
from saf_gen.benchmark.thumbnails import Thumbnails, select_to_show
from saf_gen.core.figure_style import PlotStyle, assign_styles, plot_to_svg
from saf_gen.leaderboard.figures.comparisons import (
    CONDITIONS,
    plot_condition,
    plot_errors,
    plot_neighbours,
    plot_profiles,
)
from saf_gen.leaderboard.figures.figure import PREDICTIONS_LABEL, Figure, split_method
from saf_gen.leaderboard.figures.pictures import ImageStrip, image_strip, plot_depth_of_focus, spike_strip
from saf_gen.leaderboard.figures.sweeps import Cursor, locate_cursor, plot_curves, plot_lens_paths, plot_steps
from saf_gen.leaderboard.method_comparison import MethodComparison
from saf_gen.leaderboard.outcomes import group_by
from saf_gen.leaderboard.ranking import LeaderboardRow

MAX_SEQUENCES = DRAWN_SEQUENCES
MAX_SCENES = 48
"""Largest number of scenes with a figure of errors; scenes whose sweeps are drawn come first."""
MAX_SEARCHES = 4
"""Largest number of searches with figures against a condition."""
MAX_TFP_BYTES, MAX_TFI_BYTES = 100_000, 80_000
"""Largest sizes of the image strips of a viewer. With spikes at 1 bit per pixel, about 55,000 bytes, twelve viewers
take 4 MB."""

OPENING = "depth-of-focus"
NO_COMPARISON = MethodComparison()


@dataclass(frozen=True)
class SequenceViewer:
    """The pictures of a sweep, each with its position on the curves and a description."""

    sequence: str
    strips: tuple[tuple[str, str, ImageStrip], ...]
    """Name, meaning and pictures of each way to display spikes; all show the same moments."""
    cursor: Cursor
    descriptions: tuple[str, ...]
    start: int
    """Number of the picture shown first: the nearest to the focus or, if the focus is unknown, the middle one."""
    region_box: tuple[float, float, float, float]
    """Top, left, bottom and right edges of the region where measures look, as fractions of the picture."""


@dataclass(frozen=True)
class ReportFigure:
    """A figure of the page."""

    name: str
    """Unique name of its file, and its id in the page."""
    scene: str
    """Scene, with its split, to which the figure belongs; '' for a figure of all scenes."""
    kind: str
    """A key of captions.FIGURE_CAPTIONS, or OPENING for the figure at the top of the page."""
    label: str
    """Description of the figure for readers who cannot see it."""
    svg: str
    figure: Figure = field(repr=False)
    viewer: SequenceViewer | None = None
    omission: str = ""
    """Sentence about the figures of this kind and scene that are left out; '' if there are none."""


def plot_figures(
    evaluation: Evaluation, rows: Sequence[LeaderboardRow], *, comparison: MethodComparison = NO_COMPARISON
) -> list[ReportFigure]:
    """Return all figures of an evaluation.

    The order is: the depth of focus, comparisons of methods, conditions, then errors, sweeps and paths by scene.
    """
    order = {row.method: number for number, row in enumerate(rows)}
    records = sorted(evaluation.records, key=lambda r: order.get(r.method, len(order)))
    paths = sorted(evaluation.lens_paths, key=lambda p: order.get(p.method, len(order)))
    styles = assign_styles([split_method(row.method)[0] for row in rows])
    drawn = [*((s.split, s.scene) for s in evaluation.sweeps), *((p.split, p.scene) for p in paths)]
    return _make_names_unique(
        [
            *_plot_opening(evaluation),
            *_plot_comparison(comparison),
            *_plot_conditions(records, styles),
            *_plot_errors_by_scene(records, first=drawn),
            *_plot_sweeps(evaluation.sweeps, records, styles=styles),
            *_plot_paths(paths, evaluation.records, styles=styles),
        ]
    )


def _make_names_unique(figures: Sequence[ReportFigure]) -> list[ReportFigure]:
    """Return the figures with a number appended to each repeated name.

    Different subjects can give the same name, because characters that a name may not contain become ``_``.
    """
    names: set[str] = set()
    renamed = []
    for figure in figures:
        name, number = figure.name, 2
        while name in names:
            name, number = f"{figure.name}-{number}", number + 1
        names.add(name)
        renamed.append(replace(figure, name=name))
    return renamed


def _plot_opening(evaluation: Evaluation) -> list[ReportFigure]:
    """Return the figure that explains the depth of focus; [] if no answer has an error in depths of focus."""
    if all(record.error_dof is None for record in evaluation.records):
        return []
    figure = plot_depth_of_focus(evaluation.sweeps)
    label = "Width of the blur against the distance from the true focus, with pictures of the target at some distances"
    return [ReportFigure(OPENING, "", OPENING, label, plot_to_svg(figure, name=OPENING), figure)]


def _plot_comparison(comparison: MethodComparison) -> list[ReportFigure]:
    """Return the figures of the profiles of each quantity and of the neighbours; [] for a single method."""
    if not comparison.neighbours:
        return []
    figures = []
    for quantity, title in (("error_dof", "Error profiles"), ("time_s", "Time profiles")):
        if group := [profile for profile in comparison.profiles if profile.quantity == quantity]:
            figure = plot_profiles(group, title=title)
            figures.append(_finish(figure, kind="profile", scene="", subject=quantity, label=title))
    title = "Probability of improvement, neighbours in rank"
    figure = plot_neighbours(comparison.neighbours, title=title)
    return [*figures, _finish(figure, kind="neighbours", scene="", subject="in-rank", label=title)]


def _plot_conditions(records: Sequence[Record], styles: Mapping[str, PlotStyle]) -> list[ReportFigure]:
    searches = list(dict.fromkeys(split_method(r.method)[1] for r in records))
    omission = ""
    if len(searches) > MAX_SEARCHES:
        omission = f"Drawn: the first {MAX_SEARCHES} of {len(searches)} searches, in the leaderboard's order."
    figures = []
    for condition in CONDITIONS:
        for search in searches[:MAX_SEARCHES]:
            group = [r for r in records if split_method(r.method)[1] == search]
            title = f"{condition.title}: {search or PREDICTIONS_LABEL}"
            if (figure := plot_condition(group, condition, styles=styles, title=title)) is not None:
                subject = search or PREDICTIONS_LABEL
                figures.append(
                    _finish(figure, kind=condition.name, scene="", subject=subject, label=title, omission=omission)
                )
    return figures


def _plot_errors_by_scene(records: Sequence[Record], *, first: Sequence[tuple[str | None, str]]) -> list[ReportFigure]:
    by_scene: dict[str, list[Record]] = {_label_scene(*names): [] for names in first}
    for record in records:
        by_scene.setdefault(_label_scene(record.split, record.scene), []).append(record)
    known = {scene: group for scene, group in by_scene.items() if any(r.error_dof is not None for r in group)}
    omission = f"{MAX_SCENES} of {len(known):,} scenes have this figure." if len(known) > MAX_SCENES else ""
    return [
        _finish(
            plot_errors(group, title=f"{scene}: errors"),
            kind="errors",
            scene=scene,
            subject=scene,
            label=f"Errors on {scene}",
            omission=omission,
        )
        for scene, group in list(known.items())[:MAX_SCENES]
    ]


def _plot_sweeps(
    sweeps: Sequence[SweepSummary], records: Sequence[Record], *, styles: Mapping[str, PlotStyle]
) -> list[ReportFigure]:
    """Return the figures of the chosen sweeps: curves (if any), light and answers; and the steps of the searches."""
    chosen = select_to_show([((s.split, s.scene), (s.light, s.scene_motion)) for s in sweeps], MAX_SEQUENCES)
    omissions = _describe_omissions_by_scene(records, [(sweeps[n].split, sweeps[n].scene) for n in chosen])
    figures = []
    for sweep in (sweeps[number] for number in chosen):
        group = [r for r in records if r.sequence == sweep.sequence]
        scene = _label_scene(sweep.split, sweep.scene)
        motion = ", dynamic" if sweep.scene_motion == "dynamic" else ""
        title = f"{scene}, {sweep.light or sweep.sequence}{motion}"
        truth = f"true focus at {sweep.truth:.3f} of the travel" if isfinite(sweep.truth) else "truth unknown"
        figure = plot_curves(sweep, group, styles=styles, title=title)
        viewer = None
        if sweep.thumbnails is not None:
            viewer = build_viewer(sweep, locate_cursor(figure, sweep, frames=sweep.thumbnails.frames))
        kind, content = ("curves", "Focus curves") if sweep.curves else ("sweep", "Light and answers")
        finished = _finish(
            figure,
            kind=kind,
            scene=scene,
            subject=sweep.sequence,
            label=f"{content} on {sweep.sequence}, {truth}",
            omission=omissions[sweep.split, sweep.scene],
        )
        figures.append(replace(finished, viewer=viewer))
        steps = plot_steps(sweep, group, styles=styles, title=f"{title}: steps of searches")
        if steps is not None:
            label = f"Steps of searches on {sweep.sequence}, {truth}"
            figures.append(_finish(steps, kind="steps", scene=scene, subject=sweep.sequence, label=label))
    return figures


def _plot_paths(
    paths: Sequence[LensPath], records: Sequence[Record], *, styles: Mapping[str, PlotStyle]
) -> list[ReportFigure]:
    by_sequence = group_by(paths, "sequence")
    firsts = [group[0] for group in by_sequence.values()]
    chosen = select_to_show([((p.split, p.scene), p.light) for p in firsts], MAX_SEQUENCES)
    omissions = _describe_omissions_by_scene(records, [(firsts[n].split, firsts[n].scene) for n in chosen])
    figures = []
    for first in (firsts[number] for number in chosen):
        scene = _label_scene(first.split, first.scene)
        title = f"{scene}, {first.light or first.sequence}: path of the lens"
        figure = plot_lens_paths(by_sequence[first.sequence], styles=styles, title=title)
        if figure is not None:
            finished = _finish(
                figure,
                kind="lens",
                scene=scene,
                subject=first.sequence,
                label=f"Path of the lens on {first.sequence}",
                omission=omissions[first.split, first.scene],
            )
            figures.append(finished)
    return figures


def _describe_omissions_by_scene(records: Sequence[Record], drawn: Sequence[tuple[str | None, str]]) -> dict[Any, str]:
    """Return, by scene, a sentence with the number of its sequences that are drawn; '' if all are drawn."""
    counts = Counter(scene for scene, _ in {((r.split, r.scene), r.sequence) for r in records})
    return {
        scene: f"Drawn: {number} of the scene's {counts[scene]} sequences." if number < counts[scene] else ""
        for scene, number in Counter(drawn).items()
    }


def _label_scene(split: str | None, scene: str) -> str:
    return f"{scene} ({split})" if split else scene


def _finish(figure: Figure, *, kind: str, scene: str, subject: str, label: str, omission: str = "") -> ReportFigure:
    """Return the figure as SVG, with a name made from its kind and subject."""
    name = re.sub(r"[^\w.-]+", "_", f"{kind}-{subject}").strip("._")
    return ReportFigure(name, scene, kind, label, plot_to_svg(figure, name=name), figure, omission=omission)


def build_viewer(sweep: SweepSummary, cursor: Cursor) -> SequenceViewer | None:
    """Return the viewer of a sweep, or None if the sweep has no pictures."""
    pictures = sweep.thumbnails
    if pictures is None:
        return None
    offsets = _focus_offsets(sweep, pictures)
    known = np.isfinite(offsets).any()
    return SequenceViewer(
        sweep.sequence,
        (
            ("TFP", "spikes counted", image_strip(pictures.images, max_bytes=MAX_TFP_BYTES)),
            ("TFI", "time between two spikes", image_strip(pictures.textures, max_bytes=MAX_TFI_BYTES)),
            ("spikes", "one readout, magnified", spike_strip(pictures.spikes)),
        ),
        cursor,
        tuple(_describe_picture(sweep, float(f), offset=o) for f, o in zip(pictures.frames, offsets, strict=True)),
        int(np.nanargmin(np.abs(offsets))) if known else len(offsets) // 2,
        pictures.box,
    )


def _focus_offsets(sweep: SweepSummary, pictures: Thumbnails) -> np.ndarray:
    """Return lens minus true focus at each picture, as a fraction of the travel; NaN if either is unknown."""
    lens = sweep.focus_position
    if lens is None:
        return np.full(len(pictures.frames), nan)
    frames = np.arange(len(lens))
    truth = sweep.truth if sweep.track is None else np.interp(pictures.frames, frames, sweep.track)
    return np.asarray(np.interp(pictures.frames, frames, lens) - truth)


def _describe_picture(sweep: SweepSummary, frame: float, *, offset: float) -> str:
    parts = [f"frame {frame:,.0f}"]
    if (lens := sweep.focus_position) is not None:
        parts.append(f"lens at {np.interp(frame, np.arange(len(lens)), lens):.3f}")
    if isfinite(offset) and (depth := judged_dof(sweep.depth_of_focus)) is not None:
        parts.append(f"{offset / depth:+.1f} DoF from the focus".replace("-", "−"))
    if len(sweep.rate):
        parts.append(f"{np.interp(frame, sweep.frames, sweep.rate):.3f} spikes per pixel and readout")
    return ", ".join(parts)
