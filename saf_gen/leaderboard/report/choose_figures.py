"""Which figures an evaluation has: chosen, drawn, named."""

import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from saf_gen.benchmark.records import Record
from saf_gen.benchmark.results import Evaluation, LensPath, SweepSummary
from saf_gen.benchmark.thumbnails import select_sequences_to_show
from saf_gen.leaderboard import LeaderboardRow
from saf_gen.leaderboard.figures import (
    CONDITIONS,
    PREDICTIONS_LABEL,
    Figure,
    PlotStyle,
    assign_styles,
    locate_cursor,
    plot_condition,
    plot_errors,
    plot_focus_curves,
    plot_lens_paths,
    plot_search_steps,
    split_method,
    to_svg,
)
from saf_gen.leaderboard.report.sequence_viewer import SequenceViewer, build_viewer

__all__ = ["MAX_SEQUENCES", "ReportFigure", "plot_report_figures"]

MAX_SEQUENCES = 48
"""Sequences whose sweeps are drawn; of more, some of every scene."""
MAX_SEARCHES = 4
"""Searches that have figures against a condition."""


@dataclass(frozen=True)
class ReportFigure:
    """A figure: its name, what it is of, its kind, what it shows in words, the SVG, its film."""

    name: str
    scene: str
    """'' for all scenes."""
    kind: str
    label: str
    svg: str
    viewer: SequenceViewer | None = None
    omission: str = ""
    """What figures of its kind leave out there, in a sentence."""


def plot_report_figures(evaluation: Evaluation, rows: Sequence[LeaderboardRow]) -> list[ReportFigure]:
    """All figures, those against conditions first, then scene by scene."""
    order = {row.method: number for number, row in enumerate(rows)}
    records = sorted(evaluation.records, key=lambda r: order.get(r.method, len(order)))
    styles = assign_styles([split_method(row.method)[0] for row in rows])
    pictures = _conditions(records, styles)
    pictures += _errors(records)
    pictures += _sweeps(evaluation.sweeps, records, styles)
    paths = sorted(evaluation.lens_paths, key=lambda p: order.get(p.method, len(order)))
    pictures += _paths(paths, styles)
    return _apart(pictures)


def _apart(pictures: Sequence[ReportFigure]) -> list[ReportFigure]:
    """The same under names that differ: what made them differ may be no sign of a file's name."""
    taken: set[str] = set()
    out = []
    for picture in pictures:
        name, number = picture.name, 2
        while name in taken:
            name, number = f"{picture.name}-{number}", number + 1
        taken.add(name)
        out.append(replace(picture, name=name))
    return out


def _conditions(records: Sequence[Record], styles: Mapping[str, PlotStyle]) -> list[ReportFigure]:
    searches = list(dict.fromkeys(split_method(r.method)[1] for r in records))
    omission = ""
    if len(searches) > MAX_SEARCHES:
        omission = (
            f"The first {MAX_SEARCHES} of {len(searches)} searches have a figure, in the leaderboard's order."
        )
    pictures = []
    for condition in CONDITIONS:
        for search in searches[:MAX_SEARCHES]:
            mine = [r for r in records if split_method(r.method)[1] == search]
            title = f"{condition.title}: {search or PREDICTIONS_LABEL}"
            if (figure := plot_condition(mine, condition, styles, title=title)) is not None:
                pictures.append(
                    _picture(figure, "", condition.name, title, search or PREDICTIONS_LABEL, omission)
                )
    return pictures


def _errors(records: Sequence[Record]) -> list[ReportFigure]:
    by_scene: dict[str, list[Record]] = {}
    for record in records:
        by_scene.setdefault(scene_label(record.split, record.scene), []).append(record)
    return [
        _picture(plot_errors(mine, title=f"{scene}: errors"), scene, "errors", f"Errors on {scene}", scene)
        for scene, mine in by_scene.items()
        if any(r.error_dof is not None for r in mine)
    ]


def _sweeps(
    sweeps: Sequence[SweepSummary], records: Sequence[Record], styles: Mapping[str, PlotStyle]
) -> list[ReportFigure]:
    """Of each sweep its curves, or without any its light, lens and truth; its film; the steps of searches."""
    chosen = select_sequences_to_show(
        [((s.split, s.scene), (s.light, s.scene_motion)) for s in sweeps], MAX_SEQUENCES
    )
    omission = _describe_omissions_by_scene([(s.split, s.scene) for s in sweeps], chosen)
    pictures = []
    for sweep in (sweeps[place] for place in chosen):
        mine = [r for r in records if r.sequence == sweep.sequence]
        scene, what = scene_label(sweep.split, sweep.scene), _condition(sweep)
        figure = plot_focus_curves(sweep, mine, styles, title=f"{scene}, {what}")
        viewer = None
        if sweep.thumbnails is not None:
            viewer = build_viewer(sweep, locate_cursor(figure, sweep, sweep.thumbnails.frames))
        kind, shows = ("curves", "Focus curves") if sweep.curves else ("sweep", "Light and answers")
        label, less = f"{shows} on {sweep.sequence}, {_truth(sweep)}", omission[sweep.split, sweep.scene]
        pictures.append(_picture(figure, scene, kind, label, sweep.sequence, less, viewer))
        steps = plot_search_steps(sweep, mine, styles, title=f"{scene}, {what}: steps of searches")
        if steps is not None:
            label = f"Steps of searches on {sweep.sequence}, {_truth(sweep)}"
            pictures.append(_picture(steps, scene, "steps", label, sweep.sequence))
    return pictures


def _paths(paths: Sequence[LensPath], styles: Mapping[str, PlotStyle]) -> list[ReportFigure]:
    firsts = list({p.sequence: p for p in paths}.values())
    chosen = select_sequences_to_show([((p.split, p.scene), p.light) for p in firsts], MAX_SEQUENCES)
    omission = _describe_omissions_by_scene([(p.split, p.scene) for p in firsts], chosen)
    pictures = []
    for first in (firsts[place] for place in chosen):
        scene = scene_label(first.split, first.scene)
        mine = [p for p in paths if p.sequence == first.sequence]
        figure = plot_lens_paths(
            mine, styles, title=f"{scene}, {first.light or first.sequence}: way of the lens"
        )
        if figure is not None:
            label, less = f"Way of the lens on {first.sequence}", omission[first.split, first.scene]
            pictures.append(_picture(figure, scene, "lens", label, first.sequence, less))
    return pictures


def _describe_omissions_by_scene(
    scenes: Sequence[tuple[str | None, str]], chosen: Sequence[int]
) -> dict[Any, str]:
    """By scene: how many of its sequences are drawn, where that is not all."""
    every, drawn = Counter(scenes), Counter(scenes[place] for place in chosen)
    return {
        scene: f"Drawn: {drawn[scene]} of the scene's {held} sequences." if drawn[scene] < held else ""
        for scene, held in every.items()
    }


def scene_label(split: str | None, scene: str) -> str:
    """What a scene is called on the page."""
    return f"{scene} ({split})" if split else scene


def _condition(sweep: SweepSummary) -> str:
    what = sweep.light or sweep.sequence
    return f"{what}, {sweep.scene_motion}" if sweep.scene_motion == "dynamic" else what


def _truth(sweep: SweepSummary) -> str:
    return f"true focus at {sweep.truth:.3f} of the travel" if math.isfinite(sweep.truth) else "truth unknown"


def _picture(
    figure: Figure,
    scene: str,
    kind: str,
    label: str,
    what: str,
    omission: str = "",
    viewer: SequenceViewer | None = None,
) -> ReportFigure:
    name = re.sub(r"[^\w.-]+", "_", f"{kind}-{what}").strip("._")
    return ReportFigure(name, scene, kind, label, to_svg(figure, name=name), viewer, omission)
