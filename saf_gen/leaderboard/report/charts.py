"""The charts of a page: data of curves, lens paths and profiles, which the page's script draws, and the choice of them.

Numbers have four significant digits. Nothing here draws, so that a page costs little.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from math import isfinite
from typing import Any

import numpy as np

from saf_gen.benchmark.evaluate import DRAWN_SEQUENCES
from saf_gen.benchmark.method_spec import measure_and_search
from saf_gen.benchmark.records import Record
from saf_gen.benchmark.results import LensPath, SweepSummary
from saf_gen.benchmark.thumbnails import select_to_show
from saf_gen.core.cores import usable_cores
from saf_gen.leaderboard.agreement import Agreement
from saf_gen.leaderboard.board import Leaderboard
from saf_gen.leaderboard.ranking import LeaderboardRow, Profile, group_by
from saf_gen.leaderboard.report.pictures import SequenceViewer, build_viewer, frames_to_axis, position_axis
from saf_gen.optics.focus_crossings import focus_crossings

MAX_LINES = 8
"""Largest number of lines in a chart: more colours could not be distinguished."""
MAX_SEARCHES = 6
"""Largest number of rows of answers above the curves."""
MAX_NAMES = 3
"""Largest number of measures that are named for one line; the number of others is given."""
LENS_POINTS = 300
PREDICTIONS_LABEL = "predictions"
"""Label in place of a search, for answers of another program."""
INK, SOFT = -1, -2
"""Styles of lines that belong to no method: the truth, and the lens."""
PROFILE_LABELS: Mapping[str, tuple[str, str]] = {
    "error_dof": ("Error profiles", "|answer − truth| at most, depths of focus"),
    "time_s": ("Time profiles", "in focus within, seconds"),
}


@dataclass(frozen=True)
class Chart:
    """A chart of the page; ``data`` is what the script draws (see charts.js)."""

    kind: str
    """A key of the page's captions."""
    scene: str
    """Scene, with its split, to which the chart belongs; '' for a chart of all scenes."""
    title: str
    data: Mapping[str, Any]
    viewer: SequenceViewer | None = None
    omission: str = ""
    """Sentence about what this chart or its scene leaves out; '' if nothing."""


NAMED_DOTS = 4
LABEL_LETTER, LABEL_LINE, LABEL_GAP = 0.0175, 0.08, 0.03
"""Width of a letter, height of a line and gap to the dot of a name, as fractions of the plot of times."""


@dataclass(frozen=True)
class Times:
    """Success against time to focus: the places of the methods as fractions of a plot, and the ticks of its axis."""

    points: tuple[tuple[LeaderboardRow, float, float], ...]
    """Row, and place from the left and from below."""
    ticks: tuple[tuple[float, str], ...]
    """Place from the left, and seconds."""
    labels: tuple[tuple[str, float, float, float, float], ...]
    """Names of the best methods: where each begins and its dot is, from the left and from below."""


def plot_times(rows: Sequence[LeaderboardRow]) -> Times | None:
    """Return success within 1 DoF against the seconds until the answer, computing included; None without both.

    On a recording, measured computing follows the last frame that a method saw. In the closed loop, the clock went on
    while the method computed, so nothing is added.
    """
    known = [
        (row, row.answerable_1dof, row.time_to_focus_s + (0.0 if row.reversals is not None else row.seconds or 0.0))
        for row in rows
        if row.answerable_1dof is not None and row.time_to_focus_s is not None
    ]
    if len(known) < 2:
        return None
    longest = max(seconds for _, _, seconds in known) * 1.05
    step = next(size for size in (1e-3 * m * 10**n for n in range(9) for m in (1, 2, 5)) if longest / size <= 6)
    ticks = [number * step for number in range(int(longest / step) + 1)]
    points = tuple((row, seconds / longest, success) for row, success, seconds in known)
    return Times(points, tuple((tick / longest, f"{tick:.6g}") for tick in ticks), tuple(_name_best(points)))


def _name_best(
    points: Sequence[tuple[LeaderboardRow, float, float]],
) -> Iterator[tuple[str, float, float, float, float]]:
    """Yield the labels of the best methods, each below those that it would cover; see :class:`Times`."""
    dots = [(across - LABEL_GAP / 2, across + LABEL_GAP / 2, up) for _, across, up in points]
    names: list[tuple[float, float, float]] = []
    for row, across, up in points[:NAMED_DOTS]:
        width = len(row.method) * LABEL_LETTER
        left = min(across + LABEL_GAP, 1 - width)
        lines = [up - n * LABEL_LINE for n in range(int(up / LABEL_LINE))]

        def free(at: float, taken: Sequence[tuple[float, float, float]], ends: tuple[float, float]) -> bool:
            return all(abs(at - y) >= 0.99 * LABEL_LINE or ends[1] <= x or right <= ends[0] for x, right, y in taken)

        ends = left, left + width
        clear = [at for at in lines if free(at, names, ends)]
        if not clear:
            continue
        at = next((at for at in clear if free(at, dots, ends)), clear[0])
        names.append((*ends, at))
        yield row.method, left, at, across, up


def make_charts(board: Leaderboard) -> list[Chart]:
    """Return the charts of a leaderboard: profiles, then sweeps or paths of the lens by scene."""
    order = {method: number for number, method in enumerate(board.methods)}
    records = sorted(board.records, key=lambda r: order.get(r.who.method, len(order)))
    paths = sorted(board.evaluation.lens_paths, key=lambda p: order.get(p.method, len(order)))
    asked = {measure for agreement in board.agreements for measure in agreement.asked}
    measures = list(dict.fromkeys(measure_and_search(method)[0] for method in board.methods))
    measures.sort(key=lambda measure: measure not in asked)
    return [
        *_chart_profiles(board.comparison.profiles),
        *_chart_sweeps(board.evaluation.sweeps, records, measures=measures, agreements=board.agreements),
        *_chart_paths(paths, board.records),
    ]


def _chart_profiles(profiles: Sequence[Profile]) -> list[Chart]:
    charts = []
    for quantity, (title, label) in PROFILE_LABELS.items():
        if found := [profile for profile in profiles if profile.quantity == quantity]:
            lines = [
                _line(profile.method, (profile.limits, profile.fractions), style=number)
                for number, profile in enumerate(found[:MAX_LINES])
            ]
            in_dof = quantity == "error_dof"
            data = {"x": label, "y": "of the answers", "log": in_dof, "percent": True, "at": [1] if in_dof else []}
            omission = _describe_omission(len(lines), len(found), noun="methods")
            charts.append(Chart("profile", "", title, {**data, "lines": lines}, omission=omission))
    return charts


def _chart_sweeps(
    sweeps: Sequence[SweepSummary], records: Sequence[Record], *, measures: list[str], agreements: Sequence[Agreement]
) -> list[Chart]:
    frames_of = {one.sequence: [place.frame for place in one.places] for one in agreements}
    chosen = select_to_show([((s.split, s.scene), (s.light, s.scene_motion)) for s in sweeps], DRAWN_SEQUENCES)
    omissions = _describe_omissions_by_scene(records, [(sweeps[n].split, sweeps[n].scene) for n in chosen])
    by_sequence = group_by(records, "what.sequence")
    with ThreadPoolExecutor(usable_cores()) as pool:  # encoding pictures leaves Python's lock
        shown = [sweeps[number] for number in chosen]
        places = [frames_of.get(sweep.sequence, []) for sweep in shown]
        viewers = pool.map(build_viewer, shown, [frames[0] if frames else None for frames in places])
        return [
            replace(
                chart_sweep(sweep, by_sequence.get(sweep.sequence, []), measures=measures, places=frames),
                viewer=viewer,
                omission=omissions[sweep.split, sweep.scene],
            )
            for sweep, frames, viewer in zip(shown, places, viewers, strict=True)
        ]


def chart_sweep(
    sweep: SweepSummary, records: Sequence[Record], *, measures: Sequence[str], places: Sequence[float] = ()
) -> Chart:
    """Return the chart of the focus curves of a sweep, with the answers in ``records`` above them.

    There is one row of answers per search. The axis is the focus position or, if the lens turns back or rests, the
    frame, with the position as a line. Each curve is scaled to its range. The light (mean counts) is an area,
    scaled to its largest value; the truth is a line in a band that shows its depth of focus. Without a truth, there is
    a line at each of the frames ``places`` where measures agree. Measures whose curves
    coincide share a line. At most MAX_LINES lines are drawn, in the order of ``measures``, and the answers of the first
    MAX_SEARCHES searches.
    """
    to_axis, over_frames = frames_to_axis(sweep), position_axis(sweep) is None
    answers = _group_answers(records, measures)
    curves = {curve.measure: curve for curve in sweep.curves}
    groups = _group_coincident(sweep, measures)[:MAX_LINES]
    answered = {measure for by_measure in answers.values() for measure in by_measure}
    uncurved = [m for m in measures if m in answered and m not in curves][: MAX_LINES - len(groups)]
    styles = {measure: number for number, group in enumerate([*groups, *([m] for m in uncurved)]) for measure in group}
    rows = _choose_answers(answers, list(styles), most=MAX_SEARCHES)
    brightest = float(np.nanmax(sweep.rate, initial=0.0)) or 1.0
    lines = [
        _line(_name_group(group), (to_axis(curves[group[0]].frames), normalise(curves[group[0]].scores)), style=number)
        for number, group in enumerate(groups)
    ]
    if over_frames and (lens := sweep.focus_position) is not None:
        frames = np.linspace(0, len(lens) - 1, min(len(lens), LENS_POINTS))
        lines.append(_line("focus position", (frames, np.interp(frames, np.arange(len(lens)), lens)), style=SOFT))
        if sweep.track is not None:
            moving = np.interp(frames, np.arange(len(lens)), sweep.track)
            lines.append(_line("true focus", (frames, moving), style=INK))
    area, unit = (to_axis(sweep.frames), sweep.rate / brightest), f"{brightest:.3g} spikes per pixel and readout"
    marks: list[list[Any]] = []
    for row, (search, by_measure) in enumerate(rows.items()):
        for place, (measure, frame) in enumerate(sorted(by_measure.items(), key=lambda item: styles[item[0]])):
            name, height = f"{measure}+{search}" if search else measure, (place + 0.5) / len(by_measure)
            marks.append([row, height, *_short(to_axis(np.array([frame]))), styles[measure], name])
    data = {
        "x": "frame" if over_frames else "focus position, fraction of travel",
        "y": "focus score, normalised" if groups else "",
        "area": _line(f"light, 1 is {unit}", area, style=SOFT),
        "lines": lines,
        "rows": [search or PREDICTIONS_LABEL for search in rows],
        "marks": marks,
        **_mark_truth(sweep, over_frames=over_frames),
    }
    if places and not data["at"]:
        data["at"] = _short(to_axis(np.array(places)))
    motion = ", dynamic" if sweep.scene_motion == "dynamic" else ""
    title = f"{label_scene(sweep.split, sweep.scene)}, {sweep.light or sweep.sequence}{motion}"
    return Chart("curves" if sweep.curves else "sweep", label_scene(sweep.split, sweep.scene), title, data)


def _mark_truth(sweep: SweepSummary, *, over_frames: bool) -> dict[str, list[Any]]:
    """Return the places of the truth on the axis (``at``), and the depths of focus around them (``bands``)."""
    lens = sweep.focus_position
    if over_frames and lens is not None:
        bands = [[first, stop] for first, stop in _find_runs(_frames_in_focus(sweep, lens))]
        return {"at": _short(_truth_crossings(sweep, lens)), "bands": bands}
    truth = sweep.truth_frame if over_frames else sweep.truth
    if not isfinite(truth):
        return {"at": [], "bands": []}
    has_depth = not over_frames and all(map(isfinite, sweep.depth_of_focus))
    return {"at": _short([truth]), "bands": [_short(sorted(sweep.depth_of_focus))] if has_depth else []}


def _frames_in_focus(sweep: SweepSummary, lens: np.ndarray) -> np.ndarray:
    """Return whether the lens is within the depth of focus in each frame, bool (T,); False if that is unknown."""
    offset = _focus_offset(sweep, lens)
    near, far = sorted(sweep.depth_of_focus)
    return np.asarray((offset >= near - sweep.truth) & (offset <= far - sweep.truth))


def _find_runs(where: np.ndarray) -> list[tuple[int, int]]:
    """Return the first and the stop index of each run of True in ``where``, bool (T,)."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], where.astype(int), [0]))))
    return [(int(first), int(stop)) for first, stop in edges.reshape(-1, 2)]


def _truth_crossings(sweep: SweepSummary, lens: np.ndarray) -> np.ndarray:
    """Return the frames at which the lens crosses the truth."""
    return focus_crossings(_focus_offset(sweep, lens), 0.0)


def _focus_offset(sweep: SweepSummary, lens: np.ndarray) -> np.ndarray:
    """Return lens minus truth in each frame, float64 (T,), as a fraction of the travel."""
    return np.asarray(np.asarray(lens, dtype=np.float64) - (sweep.truth if sweep.track is None else sweep.track))


def normalise(scores: np.ndarray) -> np.ndarray:
    """Return scores (B,) scaled to the range 0 to 1; constant scores become 0, and NaN stays NaN."""
    values = np.asarray(scores, dtype=np.float64)
    finite = values[np.isfinite(values)]
    if finite.size == 0 or finite.max() == finite.min():
        return np.where(np.isfinite(values), 0.0, np.nan)
    return np.asarray((values - finite.min()) / (finite.max() - finite.min()))


def _group_answers(records: Sequence[Record], measures: Sequence[str]) -> dict[str, dict[str, float]]:
    """Return the frame of each answer of these measures by search and measure, in the order of ``records``."""
    answers: dict[str, dict[str, float]] = {}
    for record in records:
        measure, search = measure_and_search(record.who.method)
        if measure in measures and record.judgement.frame is not None:
            answers.setdefault(search, {})[measure] = record.judgement.frame
    return answers


def _group_coincident(sweep: SweepSummary, measures: Sequence[str]) -> list[list[str]]:
    """Return groups of measures with the same curve, in the order of ``measures``."""
    drawn = {c.measure: normalise(c.scores) for c in sweep.curves}
    groups: list[list[str]] = []
    for measure in (name for name in measures if name in drawn):
        for group in groups:
            a, b = drawn[measure], drawn[group[0]]
            if a.shape == b.shape and np.allclose(a, b, atol=1e-3, equal_nan=True):
                group.append(measure)
                break
        else:
            groups.append([measure])
    return groups


def _choose_answers(
    answers: Mapping[str, Mapping[str, float]], shown: Sequence[str], *, most: int
) -> dict[str, dict[str, float]]:
    """Return the answers of the measures in ``shown``, of the first ``most`` searches that have any."""
    chosen = {s: {m: f for m, f in frames.items() if m in shown} for s, frames in answers.items()}
    return dict([(search, frames) for search, frames in chosen.items() if frames][:most])


def _name_group(measures: Sequence[str]) -> str:
    rest = len(measures) - MAX_NAMES
    return " = ".join(measures[:MAX_NAMES]) + (f" = {rest} more" if rest > 0 else "")


def _chart_paths(paths: Sequence[LensPath], records: Sequence[Record]) -> list[Chart]:
    by_sequence = group_by([path for path in paths if len(path.seconds)], "sequence")
    firsts = [group[0] for group in by_sequence.values()]
    chosen = select_to_show([((p.split, p.scene), p.light) for p in firsts], DRAWN_SEQUENCES)
    omissions = _describe_omissions_by_scene(records, [(firsts[n].split, firsts[n].scene) for n in chosen])
    charts = []
    for first in (firsts[number] for number in chosen):
        group = by_sequence[first.sequence]
        longest = max(group, key=lambda path: path.seconds[-1])
        lines = [
            _line(
                f"{path.method} (failed)" if path.problem else path.method, (path.seconds, path.position), style=number
            )
            for number, path in enumerate(group[:MAX_LINES])
        ]
        lines.append(_line("true focus", (longest.seconds, longest.truth), style=INK))
        half = (longest.depth_of_focus or 0.0) / 2
        resting = half and np.ptp(longest.truth) == 0  # False for NaN, too
        levels = [_short([longest.truth[0] - half, longest.truth[0] + half])] if resting else []
        data = {"x": "seconds", "y": "focus position", "lines": lines, "levels": levels}
        omission = [
            omissions[first.split, first.scene],
            _describe_omission(min(len(group), MAX_LINES), len(group), noun="methods"),
        ]
        scene = label_scene(first.split, first.scene)
        title = f"{scene}, {first.light or first.sequence}: path of the lens"
        charts.append(Chart("lens", scene, title, data, omission=" ".join(filter(None, omission))))
    return charts


def _line(label: str, points: tuple[Any, Any], *, style: int) -> dict[str, Any]:
    """Return a line with its points in ascending order of x, one for each x: charts join lines by their x."""
    x, y = np.asarray(_short(points[0]), dtype=np.float64), np.asarray(points[1])
    x, first = np.unique(x, return_index=True)
    return {"label": label, "style": style, "x": x.tolist(), "y": _short(y[first])}


def _short(values: Any) -> list[float | None]:
    """Return numbers to four significant digits; None in place of NaN and infinity, which JSON lacks."""
    return [float(f"{value:.4g}") if isfinite(value) else None for value in np.asarray(values, dtype=np.float64)]


def _describe_omission(drawn: int, total: int, *, noun: str) -> str:
    return f"Drawn: the first {drawn} of {total} {noun}." if drawn < total else ""


def _describe_omissions_by_scene(records: Sequence[Record], drawn: Sequence[tuple[str | None, str]]) -> dict[Any, str]:
    """Return, by scene, a sentence with the number of its sequences that are drawn; '' if all are drawn."""
    counts = Counter(scene for scene, _ in {((r.what.split, r.what.scene), r.what.sequence) for r in records})
    return {
        scene: f"Drawn: {number} of the scene's {counts[scene]} sequences." if number < counts[scene] else ""
        for scene, number in Counter(drawn).items()
    }


def label_scene(split: str | None, scene: str) -> str:
    """Return the name of a scene with its split."""
    return f"{scene} ({split})" if split else scene
