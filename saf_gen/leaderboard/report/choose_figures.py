"""Selection, drawing and naming of the printed figures of an evaluation."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from saf_gen.benchmark.evaluate import DRAWN_SEQUENCES
from saf_gen.benchmark.records import Record
from saf_gen.benchmark.results import Evaluation, LensPath, SweepSummary
from saf_gen.benchmark.thumbnails import select_to_show
from saf_gen.core.figure_style import PlotStyle, assign_styles, plot_to_svg
from saf_gen.leaderboard.figures.comparisons import (
    CONDITIONS,
    plot_condition,
    plot_errors,
    plot_neighbours,
    plot_profiles,
)
from saf_gen.leaderboard.figures.depth_of_focus import plot_depth_of_focus
from saf_gen.leaderboard.figures.figure import Figure
from saf_gen.leaderboard.figures.sweeps import plot_curves, plot_lens_paths, plot_steps
from saf_gen.leaderboard.method_comparison import MethodComparison
from saf_gen.leaderboard.outcomes import group_by
from saf_gen.leaderboard.ranking import LeaderboardRow
from saf_gen.leaderboard.report.charts import label_scene
from saf_gen.leaderboard.sweep_lines import PREDICTIONS_LABEL, split_method

MAX_SEQUENCES = DRAWN_SEQUENCES
MAX_SCENES = 48
"""Largest number of scenes with a figure of errors; scenes whose sweeps are drawn come first."""
MAX_SEARCHES = 4
"""Largest number of searches with figures against a condition."""

OPENING = "depth-of-focus"
NO_COMPARISON = MethodComparison()


@dataclass(frozen=True)
class ReportFigure:
    """A figure of an evaluation."""

    name: str
    """Unique name of its file."""
    scene: str
    """Scene, with its split, to which the figure belongs; '' for a figure of all scenes."""
    kind: str
    svg: str
    figure: Figure = field(repr=False)


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
            *_plot_paths(paths, styles=styles),
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
    return [ReportFigure(OPENING, "", OPENING, plot_to_svg(figure, name=OPENING), figure)]


def _plot_comparison(comparison: MethodComparison) -> list[ReportFigure]:
    """Return the figures of the profiles of each quantity and of the neighbours; [] for a single method."""
    if not comparison.neighbours:
        return []
    figures = []
    for quantity, title in (("error_dof", "Error profiles"), ("time_s", "Time profiles")):
        if group := [profile for profile in comparison.profiles if profile.quantity == quantity]:
            figure = plot_profiles(group, title=title)
            figures.append(_finish(figure, kind="profile", scene="", subject=quantity))
    title = "Probability of improvement, neighbours in rank"
    figure = plot_neighbours(comparison.neighbours, title=title)
    return [*figures, _finish(figure, kind="neighbours", scene="", subject="in-rank")]


def _plot_conditions(records: Sequence[Record], styles: Mapping[str, PlotStyle]) -> list[ReportFigure]:
    searches = list(dict.fromkeys(split_method(r.method)[1] for r in records))
    figures = []
    for condition in CONDITIONS:
        for search in searches[:MAX_SEARCHES]:
            group = [r for r in records if split_method(r.method)[1] == search]
            title = f"{condition.title}: {search or PREDICTIONS_LABEL}"
            if (figure := plot_condition(group, condition, styles=styles, title=title)) is not None:
                subject = search or PREDICTIONS_LABEL
                figures.append(_finish(figure, kind=condition.name, scene="", subject=subject))
    return figures


def _plot_errors_by_scene(records: Sequence[Record], *, first: Sequence[tuple[str | None, str]]) -> list[ReportFigure]:
    by_scene: dict[str, list[Record]] = {label_scene(*names): [] for names in first}
    for record in records:
        by_scene.setdefault(label_scene(record.split, record.scene), []).append(record)
    known = {scene: group for scene, group in by_scene.items() if any(r.error_dof is not None for r in group)}
    return [
        _finish(plot_errors(group, title=f"{scene}: errors"), kind="errors", scene=scene, subject=scene)
        for scene, group in list(known.items())[:MAX_SCENES]
    ]


def _plot_sweeps(
    sweeps: Sequence[SweepSummary], records: Sequence[Record], *, styles: Mapping[str, PlotStyle]
) -> list[ReportFigure]:
    """Return the figures of the chosen sweeps: curves (if any), light and answers; and the steps of the searches."""
    chosen = select_to_show([((s.split, s.scene), (s.light, s.scene_motion)) for s in sweeps], MAX_SEQUENCES)
    figures = []
    for sweep in (sweeps[number] for number in chosen):
        group = [r for r in records if r.sequence == sweep.sequence]
        scene = label_scene(sweep.split, sweep.scene)
        motion = ", dynamic" if sweep.scene_motion == "dynamic" else ""
        title = f"{scene}, {sweep.light or sweep.sequence}{motion}"
        figure = plot_curves(sweep, group, styles=styles, title=title)
        kind = "curves" if sweep.curves else "sweep"
        figures.append(_finish(figure, kind=kind, scene=scene, subject=sweep.sequence))
        steps = plot_steps(sweep, group, styles=styles, title=f"{title}: steps of searches")
        if steps is not None:
            figures.append(_finish(steps, kind="steps", scene=scene, subject=sweep.sequence))
    return figures


def _plot_paths(paths: Sequence[LensPath], *, styles: Mapping[str, PlotStyle]) -> list[ReportFigure]:
    by_sequence = group_by(paths, "sequence")
    firsts = [group[0] for group in by_sequence.values()]
    figures = []
    for number in select_to_show([((p.split, p.scene), p.light) for p in firsts], MAX_SEQUENCES):
        first = firsts[number]
        scene = label_scene(first.split, first.scene)
        title = f"{scene}, {first.light or first.sequence}: path of the lens"
        figure = plot_lens_paths(by_sequence[first.sequence], styles=styles, title=title)
        if figure is not None:
            figures.append(_finish(figure, kind="lens", scene=scene, subject=first.sequence))
    return figures


def _finish(figure: Figure, *, kind: str, scene: str, subject: str) -> ReportFigure:
    """Return the figure as SVG, with a name made from its kind and subject."""
    name = re.sub(r"[^\w.-]+", "_", f"{kind}-{subject}").strip("._")
    return ReportFigure(name, scene, kind, plot_to_svg(figure, name=name), figure)
