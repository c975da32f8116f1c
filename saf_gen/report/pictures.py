"""Which figures an evaluation has: chosen, drawn, named."""

import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from saf_gen.contest.results import Evaluation, LensPath, Sweep
from saf_gen.figures import (
    CONDITIONS,
    PREDICTED,
    Figure,
    Look,
    against_figure,
    cursor,
    curves_figure,
    errors_figure,
    looks,
    paths_figure,
    split_method,
    to_svg,
    traces_figure,
)
from saf_gen.leaderboard import Row
from saf_gen.records import Record
from saf_gen.report.reel import Reel, reel_of
from saf_gen.rig.thumbnails import covering

__all__ = ["SEQUENCES", "Picture", "draw"]

SEQUENCES = 48
"""Sequences whose sweeps are drawn; of more, some of every scene."""
SEARCHES = 4
"""Searches that have figures against a condition."""


@dataclass(frozen=True)
class Picture:
    """A figure: its name, what it is of, its kind, what it shows in words, the SVG, its film."""

    name: str
    scene: str
    """'' for all scenes."""
    kind: str
    label: str
    svg: str
    reel: Reel | None = None
    beside: str = ""
    """What figures of its kind leave out there, in a sentence."""


def draw(evaluation: Evaluation, rows: Sequence[Row]) -> list[Picture]:
    """All figures, those against conditions first, then scene by scene."""
    order = {row.method: number for number, row in enumerate(rows)}
    records = sorted(evaluation.records, key=lambda r: order.get(r.method, len(order)))
    styles = looks([split_method(row.method)[0] for row in rows])
    pictures = _conditions(records, styles)
    pictures += _errors(records)
    pictures += _sweeps(evaluation.sweeps, records, styles)
    paths = sorted(evaluation.paths, key=lambda p: order.get(p.method, len(order)))
    pictures += _paths(paths, styles)
    return _apart(pictures)


def _apart(pictures: Sequence[Picture]) -> list[Picture]:
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


def _conditions(records: Sequence[Record], styles: Mapping[str, Look]) -> list[Picture]:
    searches = list(dict.fromkeys(split_method(r.method)[1] for r in records))
    beside = ""
    if len(searches) > SEARCHES:
        beside = (
            f"The first {SEARCHES} of {len(searches)} searches have a figure, in the leaderboard's order."
        )
    pictures = []
    for condition in CONDITIONS:
        for search in searches[:SEARCHES]:
            mine = [r for r in records if split_method(r.method)[1] == search]
            title = f"{condition.title}: {search or PREDICTED}"
            if (figure := against_figure(mine, condition, styles, title=title)) is not None:
                pictures.append(_picture(figure, "", condition.name, title, search or PREDICTED, beside))
    return pictures


def _errors(records: Sequence[Record]) -> list[Picture]:
    by_scene: dict[str, list[Record]] = {}
    for record in records:
        by_scene.setdefault(scene_name(record.split, record.scene), []).append(record)
    return [
        _picture(errors_figure(mine, title=f"{scene}: errors"), scene, "errors", f"Errors on {scene}", scene)
        for scene, mine in by_scene.items()
        if any(r.error_dof is not None for r in mine)
    ]


def _sweeps(sweeps: Sequence[Sweep], records: Sequence[Record], styles: Mapping[str, Look]) -> list[Picture]:
    """Of each sweep its curves, or without any its light, lens and truth; its film; the steps of searches."""
    chosen = covering([((s.split, s.scene), (s.light, s.scene_motion)) for s in sweeps], SEQUENCES)
    beside = _beside([(s.split, s.scene) for s in sweeps], chosen)
    pictures = []
    for sweep in (sweeps[place] for place in chosen):
        mine = [r for r in records if r.sequence == sweep.sequence]
        scene, what = scene_name(sweep.split, sweep.scene), _condition(sweep)
        figure = curves_figure(sweep, mine, styles, title=f"{scene}, {what}")
        reel = None
        if sweep.thumbnails is not None:
            reel = reel_of(sweep, cursor(figure, sweep, sweep.thumbnails.frames))
        kind, shows = ("curves", "Focus curves") if sweep.curves else ("sweep", "Light and answers")
        label, less = f"{shows} on {sweep.sequence}, {_truth(sweep)}", beside[sweep.split, sweep.scene]
        pictures.append(_picture(figure, scene, kind, label, sweep.sequence, less, reel))
        steps = traces_figure(sweep, mine, styles, title=f"{scene}, {what}: steps of searches")
        if steps is not None:
            label = f"Steps of searches on {sweep.sequence}, {_truth(sweep)}"
            pictures.append(_picture(steps, scene, "steps", label, sweep.sequence))
    return pictures


def _paths(paths: Sequence[LensPath], styles: Mapping[str, Look]) -> list[Picture]:
    firsts = list({p.sequence: p for p in paths}.values())
    chosen = covering([((p.split, p.scene), p.light) for p in firsts], SEQUENCES)
    beside = _beside([(p.split, p.scene) for p in firsts], chosen)
    pictures = []
    for first in (firsts[place] for place in chosen):
        scene = scene_name(first.split, first.scene)
        mine = [p for p in paths if p.sequence == first.sequence]
        figure = paths_figure(
            mine, styles, title=f"{scene}, {first.light or first.sequence}: way of the lens"
        )
        if figure is not None:
            label, less = f"Way of the lens on {first.sequence}", beside[first.split, first.scene]
            pictures.append(_picture(figure, scene, "lens", label, first.sequence, less))
    return pictures


def _beside(scenes: Sequence[tuple[str | None, str]], chosen: Sequence[int]) -> dict[Any, str]:
    """By scene: how many of its sequences are drawn, where that is not all."""
    every, drawn = Counter(scenes), Counter(scenes[place] for place in chosen)
    return {
        scene: f"Drawn: {drawn[scene]} of the scene's {held} sequences." if drawn[scene] < held else ""
        for scene, held in every.items()
    }


def scene_name(split: str | None, scene: str) -> str:
    """What a scene is called on the page."""
    return f"{scene} ({split})" if split else scene


def _condition(sweep: Sweep) -> str:
    what = sweep.light or sweep.sequence
    return f"{what}, {sweep.scene_motion}" if sweep.scene_motion == "dynamic" else what


def _truth(sweep: Sweep) -> str:
    return f"true focus at {sweep.truth:.3f} of the travel" if math.isfinite(sweep.truth) else "truth unknown"


def _picture(
    figure: Figure,
    scene: str,
    kind: str,
    label: str,
    what: str,
    beside: str = "",
    reel: Reel | None = None,
) -> Picture:
    name = re.sub(r"[^\w.-]+", "_", f"{kind}-{what}").strip("._")
    return Picture(name, scene, kind, label, to_svg(figure, name=name), reel, beside)
