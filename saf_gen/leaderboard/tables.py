"""Every table of a leaderboard: its columns, with their names in files, headings, meanings, values and texts."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from math import inf
from operator import attrgetter, itemgetter
from typing import Any

from saf_gen.benchmark.curve_quality import AssessedCurve, CurveQuality
from saf_gen.benchmark.records import RECORDS_FILE, Record
from saf_gen.benchmark.view.operations import OVER_DECLARED
from saf_gen.core.plain_text import plural
from saf_gen.core.table import UNKNOWN, Column, Table, percent
from saf_gen.leaderboard.agreement import NEAR, Agreement
from saf_gen.leaderboard.ranking import (
    FALSE_ABSTENTION_COST,
    LEAST_TIMED_S,
    MAX_SHARPNESS_LOST,
    LeaderboardRow,
    NeighbourComparison,
    Profile,
    group_by,
    median_magnitude,
)
from saf_gen.leaderboard.results import AxisResults, Bin, SceneGrain

POSITION = "Position of the lens at the answer, as a fraction of the travel."
ESSENTIAL, USUAL, INTERVALS, ALL = range(4)
"""Levels of detail of the columns of a ranking; if space is short, columns of the highest level are left out first."""
MAX_GRAIN_ROWS = 100
_number = partial(Column, kind="number")
_hidden = partial(Column, "", for_programs=True)


def _interval(
    header: str,
    names: tuple[str, str],
    *,
    format: str | Callable[[Any], str],
    meaning: str = "",
    to: str = "–",
    **options: Any,
) -> tuple[Column, Column]:
    """Return the columns of both ends of an interval; the text of the first has both, the second is for programs."""
    low, high = names
    ends = Column("", low, format), _hidden(high, format, "Upper end of the interval.")

    def cell(row: Any) -> str:
        known = None not in [end.get(row) for end in ends]
        return to.join(end.text(row) for end in ends) if known else UNKNOWN

    return _number(header, low, meaning=meaning, cell=cell, **options), ends[1]


# --- ranking -------------------------------------------------------------------------------------------


def ranking(
    rows: Sequence[LeaderboardRow], *, answers: Mapping[str, Record] | None = None, judged: bool = True
) -> Table:
    """Return the leaderboard, with a column for each light schedule.

    Readers also see the ``answers`` of the methods, those on a single sequence; if nothing is ``judged``, because no
    truth is known, in place of ranks. If no depth of focus is known, they see errors as fractions of the travel.
    """
    lights = [light for light, _ in rows[0].success_by_light] if rows else []
    apart = any(row.success_least_blur is not None for row in rows)
    answerable = any(row.false_abstentions is not None for row in rows)  # then these say what abstentions were worth
    columns = (*_RANK, *((LEAST_BLUR,) if apart else ()), *map(_light, lights), *_ABSTAINING, *_ERROR, *_COST)
    shown = [replace(c, for_programs=True) if answerable and c.name == "abstained" else c for c in columns]
    if not judged:
        shown = _unjudged(shown, rows, answers=answers or {})
    elif answers:
        shown = _insert_answers(shown, answers)
    if judged and not answerable and any(row.median_error_travel is not None for row in rows):
        shown = [replace(c, optional=True, detail=min(c.detail, USUAL)) for c in shown]
    return Table(shown, rows, "Leaderboard", _mark)


def _insert_answers(columns: Sequence[Column], answers: Mapping[str, Record]) -> list[Column]:
    """Return the columns with frame and position of each method's answer after its name."""

    def answer(name: str, format: str, meaning: str) -> Column:
        return _number(name, lambda row: getattr(answers[row.method].judgement, name), format, meaning, detail=USUAL)

    found = answer("frame", ".0f", "Frame of the answer, counted from 0."), answer("position", ".3f", POSITION)
    at = next(number for number, column in enumerate(columns) if column.name == "method") + 1
    return [*columns[:at], *found, *columns[at:]]


def _unjudged(
    columns: Sequence[Column], rows: Sequence[LeaderboardRow], *, answers: Mapping[str, Record]
) -> list[Column]:
    """Return the columns for answers that nobody judged: readers see the method, its answer and its computing time."""
    seconds = next(replace(c, header="seconds", detail=ESSENTIAL, group="") for c in columns if c.name == "seconds")
    readable = ["method", *(["failed"] if any(row.failed for row in rows) else [])]
    others = [c if c.name in readable else replace(c, for_programs=True) for c in columns if c.name != "seconds"]
    at = next(number for number, column in enumerate(others) if column.name == "method") + 1
    others.insert(at, seconds)
    return _insert_answers(others, answers) if answers else others


def shade(board: Table) -> Table:
    """Return the leaderboard for a page, which shades what is level with the best, where other writers have a ``~``."""
    first = replace(board.columns[0], meaning=SHADED, cell=partial(_format_rank, shaded=True))
    return replace(board, columns=[first, *board.columns[1:]])


def _mark(row: LeaderboardRow) -> str:
    if row.rank is None:
        return ""
    return "first" if row.rank == 1 else "level" if row.level_with_best is not False else ""  # None: nobody can tell


def _light(light: str) -> Column:
    return _number(
        light,
        lambda row: dict(row.success_by_light).get(light),
        percent,
        f"Answerable success within 1 DoF under the light {light}.",
        key=f"answerable_1dof_light_{light}",  # unique, whatever a recipe calls its lights
        detail=USUAL,
        group="≤1 DoF by light",
        together="lights",
        fraction=True,
    )


def _format_rank(row: LeaderboardRow, *, shaded: bool = False) -> str:
    is_level = row.level_with_best and row.rank != 1 and not shaded
    marks = f"{'=' if row.tied else ''}{'~' if is_level else ''}{'!' if row.failed_check else ''}"
    return f"{UNKNOWN if row.rank is None else row.rank}{marks}"


def _count(number: int) -> str:
    return str(number or UNKNOWN)


SHADED = (
    "Rank by answerable success within 1 DoF; = marks a tie, ! a method that fails methods check. Shaded: methods that "
    "cannot be told apart from any better one."
)
_range = partial(_interval, detail=INTERVALS, optional=True)
_success = partial(Column, format=percent, group="success", fraction=True)
_error = partial(_number, detail=ALL, group="error")
_cost = partial(_number, detail=USUAL, group="cost")
_RANK = (
    _number(
        "#",
        "rank",
        meaning="Rank by answerable success within 1 DoF; = marks a tie, ~ a method that cannot be told apart from any "
        "better one, ! one that fails methods check.",
        cell=_format_rank,
    ),
    *_range(
        "# 95 %",
        ("rank_best", "rank_worst"),
        format="",
        meaning="95 % interval of the rank over all scenes of this kind, for all rivals at once.",
    ),
    Column("method", "method", meaning="Focus measure + search.", kind="name", link="#answers"),
    _hidden(
        "failed_check", meaning="First check of saf-gen methods check that a method that is not part of saf_gen fails."
    ),
    Column(
        "verified",
        "verified",
        meaning="Whether a repeated run gave the same answers: see saf-gen leaderboard verify.",
        detail=USUAL,
        optional=True,
    ),
    _hidden("level_with_best", meaning="Whether no better method can be told apart from this one."),
    _hidden(
        "behind_best_low",
        meaning="Answerable success within 1 DoF of the best method minus that of this method: 95 % interval of this "
        "pair alone.",
    ),
    _hidden("behind_best_high", meaning="Upper end of the interval."),
    _success(
        "≤½ DoF",
        "answerable_half_dof",
        meaning="Answers within ½ depth of focus (blur ≤ 1 px), over the same sequences as ≤1 DoF.",
        kind="number",
        detail=USUAL,
    ),
    _success(
        "≤1 DoF",
        "answerable_1dof",
        meaning="Answerable success: answers within 1 DoF (blur ≤ 2 px), over the sequences that have an answer. "
        "Methods are ranked by it.",
        kind="main",
        ends=attrgetter("answerable_1dof_low", "answerable_1dof_high"),
    ),
    *_range(
        "≤1 DoF 95 %",
        ("answerable_1dof_low", "answerable_1dof_high"),
        format=percent,
        meaning="95 % interval of answerable success within 1 DoF over all scenes of this kind.",
        group="success",
    ),
    _success(
        "≤2 DoF",
        "answerable_2dof",
        meaning="Answers within 2 DoF (blur ≤ 4 px), over the same sequences as ≤1 DoF.",
        kind="number",
        detail=ALL,
    ),
)
LEAST_BLUR = _success(
    "≤1 DoF of least blur",
    "success_least_blur",
    meaning="Answerable success within 1 DoF if, where a lens with aberrations has its least blur over 0.15 DoF from "
    "its largest contrast, which is the truth, the least blur were the truth. Tables of other data lack this column.",
    kind="number",
    detail=ESSENTIAL,
)


def _of_without(row: LeaderboardRow) -> str:
    return UNKNOWN if row.false_answers is None else f"{row.false_answers} of {row.without_answer}"


def _of_answerable(row: LeaderboardRow) -> str:
    return UNKNOWN if row.false_abstentions is None else f"{row.false_abstentions} of {row.answerable}"


_ABSTAINING = (
    _number(
        "false answers",
        "false_answers",
        meaning="Number of answers on sequences that have none, because the lens stays farther than 1 DoF from the "
        "focus. It does not rank.",
        cell=_of_without,
        detail=USUAL,
        group="no answer",
        optional=True,
    ),
    _number(
        "false abst.",
        "false_abstentions",
        meaning="Number of abstentions on sequences that have an answer; ≤1 DoF counts them as wrong.",
        cell=_of_answerable,
        detail=USUAL,
        group="no answer",
        optional=True,
    ),
    _hidden("answerable", meaning="Number of sequences that have an answer."),
    _hidden("without_answer", meaning="Number of sequences that have none."),
    _number(
        "abst.",
        "abstained",
        _count,
        "Number of sequences on which the search abstained; readers see it if the truth is unknown.",
        detail=USUAL,
        group="no answer",
    ),
    _number(
        "failed",
        "failed",
        _count,
        "Number of sequences on which the method raised an error; the records name the error.",
        detail=USUAL,
        group="no answer",
    ),
    _number(
        "cost",
        "error_cost",
        ".2f",
        f"Mean over all sequences of 1 for a wrong answer or a failure, {FALSE_ABSTENTION_COST:g} for a false "
        "abstention, 0 for a right answer or a right abstention; an answer where there is none is wrong. It does not "
        "rank.",
        detail=ALL,
        group="no answer",
    ),
)
_ERROR = (
    _error(
        "err DoF",
        "median_error_dof",
        ".2f",
        "Median |answer − truth| in depths of focus, like all errors of the answers on sequences that have one. "
        "1 DoF is a blur of 2 px.",
        detail=ESSENTIAL,
    ),
    *_range(
        "err DoF 95 %",
        ("median_error_dof_low", "median_error_dof_high"),
        format=".2f",
        meaning="95 % interval of the median error over all scenes of this kind.",
        group="error",
        detail=ALL,
    ),
    _error("err travel", "median_error_travel", ".4f", "Median |answer − truth| as a fraction of the travel."),
    _error(
        "err frames", "median_error_frames", ".0f", "Median |answer − truth| in frames of the recording.", optional=True
    ),
    _error("blur px", "median_blur_px", ".1f", "Median blur at the answer, in pixels."),
    _error(
        "lost",
        "median_sharpness_lost",
        percent,
        "Sharpness lost at the answer: 1 − S(answer)/S(best), with S the noise-free SD of the target's box at each "
        "rendered position; median. Scenes that move have none.",
        optional=True,
    ),
    _error(
        "lost, 90 %",
        "p90_sharpness_lost",
        percent,
        "Sharpness lost at the answer: nine of ten answers lose no more.",
        optional=True,
    ),
    _error(
        "lost ≤5 %",
        "answerable_lost_5",
        percent,
        f"Answers that lose at most {MAX_SHARPNESS_LOST:.0%} of the sharpness, over the sequences that have an answer "
        "and state their sharpness; another unit of success, which does not rank.",
        optional=True,
        fraction=True,
    ),
    _error(
        "err own, DoF",
        "median_error_optimum_dof",
        ".2f",
        "Median |answer − optimum| in depths of focus, with the optimum the peak of the measure's own curve without "
        "noise: what of an error is not the measure's.",
        optional=True,
    ),
)
_COST = (
    _cost(
        "seen",
        "frames_seen",
        percent,
        "Number of frames that the method waited for, divided by all frames of the sequence.",
        detail=ALL,
    ),
    _cost(
        "lens",
        "lens_travel",
        ".2f",
        "Distance that the lens moves, in travels, during the frames seen and then to the answer.",
        detail=ALL,
    ),
    _cost(
        "turns", "reversals", ".1f", "Number of times that the lens reversed, if the method moves it.", optional=True
    ),
    _cost(
        "hunts",
        "hunting",
        percent,
        "Fraction of sequences in which the lens reversed more than twice; a pass and return takes two.",
        optional=True,
    ),
    _cost(
        "to focus s",
        "time_to_focus_s",
        ".3f",
        "Seconds until the answer; on a recording, without the final move of the lens.",
        optional=True,
    ),
    *_range(
        "to focus s 95 %",
        ("time_to_focus_low_s", "time_to_focus_high_s"),
        format=".3f",
        meaning="95 % interval of the mean time until the answer over all scenes of this kind.",
        group="cost",
        detail=ALL,
    ),
    _cost("scores", "windows", ".0f", "Number of scores that the search requested.", detail=ALL),
    _cost(
        "s",
        "seconds",
        ".3f",
        "Computing time of search and measure per sequence, in seconds, without the counting of spikes.",
        detail=ALL,
    ),
    _cost(
        "Mop",
        "operations",
        lambda operations: f"{operations / 1e6:.3g}",
        "Operations that measure and search declare per sequence, in millions; in the closed loop, the clock advances "
        "by them at the rate that the protocol states.",
        detail=ALL,
        optional=True,
    ),
    _cost(
        "over declared",
        lambda row: row.over_declared if (row.over_declared or 0) > OVER_DECLARED else None,
        "{:.0f}×".format,
        f"Measured seconds divided by those of the declared operations, at the rate of a reference measure on the same "
        f"machine: the median over the sequences, where it is above {OVER_DECLARED:g} and a sequence takes at least "
        f"{LEAST_TIMED_S * 1e3:g} ms.",
        key="over_declared",
        optional=True,
    ),
)


# --- conditions ----------------------------------------------------------------------------------------


def by_bin(results: AxisResults) -> Table:
    """Return answerable success within 1 DoF and, in brackets, the median error of each method in each bin of an axis.

    In a bin whose sequences have no answer, it is the number of false answers. Where a bin has too few scenes, no
    method has a number.
    """
    methods = list(results.bins[0].results)
    title = f"{results.axis.title}: answerable success within 1 DoF, median error in DoF"
    return Table([Column("method", str, kind="name"), *map(_bin, results.bins)], methods, title)


def _bin(one: Bin) -> Column:
    def cell(method: str) -> str:
        found = one.results[method]
        if one.too_few:
            return "not ranked"
        if found.answerable_1dof is None:
            return f"{found.false_answers} of {one.without} false" if one.without else UNKNOWN
        error = "" if found.median_error_dof is None else f" ({found.median_error_dof:.2f})"
        return percent(found.answerable_1dof) + error

    size = f"{plural(one.scenes, 'scene')}, {plural(one.sequences, 'sequence')}"
    size += f", {one.without} without an answer" if one.without else ""
    size += f"; {one.too_few}" if one.too_few else ""
    return _number(one.name, lambda m: one.results[m].answerable_1dof, meaning=size, cell=cell, fraction=True)


def bin_lines(axes: Sequence[AxisResults]) -> Table:
    """Return one row for each axis, method and bin, for programs."""
    headers = "axis bin scenes sequences without method answerable_1dof median_error_dof false_answers"
    headers += " false_abstentions failed"
    rows = [
        (
            results.axis.name,
            one.name,
            one.scenes,
            one.sequences,
            one.without,
            method,
            *vars(one.results[method]).values(),
        )
        for results in axes
        for method in results.bins[0].results
        for one in results.bins
    ]
    return Table.of(headers.split(), rows)


# --- pairs and profiles of methods ---------------------------------------------------------------------


def neighbours(pairs: Sequence[NeighbourComparison]) -> Table:
    """Return the comparison of each method with the next in rank."""
    return Table(_NEIGHBOURS, pairs, "Neighbours in rank")


def _points(fraction: float) -> str:
    return f"{100 * fraction:+.0f}".replace("-", "−")


def _told_apart(pair: NeighbourComparison) -> str:
    return UNKNOWN if pair.difference_low is None else "yes" if pair.told_apart else "no"


_NEIGHBOURS = (
    Column("method", "first", kind="name"),
    Column("next in rank", "second", kind="name"),
    _number("difference, points", "difference", _points),
    *_interval("95 %", ("difference_low", "difference_high"), format=_points, to=" to "),
    _number("P(nearer)", "improvement", ".2f"),
    *_interval("95 % ", ("improvement_low", "improvement_high"), format=".2f", to=" to "),
    _number("told apart", "told_apart", cell=_told_apart),
)


def profiles(found: Sequence[Profile]) -> Table:
    """Return the fraction of answers within each limit, of profiles of one quantity."""
    limits = found[0].limits

    def column(n: int) -> Column:
        return _number(f"≤{limits[n]:.3g}", lambda one: one.fractions[n], percent)

    return Table([Column("method", "method", kind="name"), *map(column, range(len(limits)))], found)


def profile_lines(found: Sequence[Profile]) -> Table:
    """Return one row for each quantity, method and limit, for programs."""
    rows: list[tuple[Any, ...]] = []
    for one in found:
        unknown = [None] * len(one.limits)
        for values in zip(one.limits, one.fractions, one.low or unknown, one.high or unknown, strict=True):
            rows.append((one.quantity, one.method, *values))
    return Table.of(("quantity", "method", "limit", "fraction", "low", "high"), rows)


# --- focus curves --------------------------------------------------------------------------------------

QUALITY_MEANINGS = {
    "accuracy_dof": "Distance of the peak of the curve from the truth, in depths of focus.",
    "accuracy": "Distance of the peak of the curve from the truth, as a fraction of the travel.",
    "range": "Distance between the minima on both sides of the peak, as a fraction of the travel.",
    "false_maxima": "Number of local maxima other than the peak, however small.",
    "false_peaks": "Number of local maxima other than the peak that stand out by over a tenth of the curve's height.",
    "width_50": "Width of the peak at half its height, as a fraction of the travel.",
    "width_80": "Width of the peak at 80 % of its height, as a fraction of the travel.",
    "noise": "Standard deviation of the noise on the curve, as a fraction of the height of the curve.",
}
"""Criteria of the quality of a curve, in the order of the table of measures, which gives the median of each."""


@dataclass(frozen=True)
class MeasureRow:
    """Summary of all curves of one measure.

    The quality of a curve is undefined if the curve is constant or too short, or if the lens turned back or rested.
    """

    measure: str
    curves: int
    without: int
    """Number of curves whose quality is undefined."""
    medians: dict[str, float | None]
    """Median of each criterion, by the names of QUALITY_MEANINGS; None if unknown."""


def curves(found: Sequence[AssessedCurve]) -> Table:
    """Return the quality of each focus curve, for programs; the curves come from the search argmax."""

    def column(name: str) -> Column:
        return Column(name, lambda one: None if one.quality is None else getattr(one.quality, name))

    plain = ("measure", "sequence", "split", "scene", "light", "truth", "depth_of_focus")
    return Table([*(Column(name, name) for name in plain), *(column(f.name) for f in fields(CurveQuality))], found)


def measures(found: Sequence[AssessedCurve]) -> Table:
    """Return the quality of the curves of each measure, the most accurate first."""

    def column(name: str) -> Column:
        return _number(name.replace("_", " "), lambda row: row.medians[name], ".3g", QUALITY_MEANINGS[name])

    return Table(
        (*_MEASURES, *map(column, QUALITY_MEANINGS)),
        rank_measures(found),
        "Focus curves of each measure: medians over sequences",
    )


def _format_curves(row: MeasureRow) -> str:
    return f"{row.curves - row.without}" + (f" ({row.without})" if row.without else "")


_MEASURES = (
    Column("measure", "measure", kind="name"),
    _number(
        "curves",
        "curves",
        meaning="Curves of known quality; in brackets, those constant or too short, or whose lens turned back or "
        "rested.",
        cell=_format_curves,
    ),
    _hidden("without"),
)


def rank_measures(found: Sequence[AssessedCurve]) -> list[MeasureRow]:
    """Return one row per measure, the most accurate first; those of unknown accuracy come last, sorted by name."""
    rows = []
    for measure, group in group_by(found, "measure").items():
        known = [one.quality for one in group if one.quality is not None]
        medians = {name: median_magnitude(getattr(quality, name) for quality in known) for name in QUALITY_MEANINGS}
        rows.append(MeasureRow(measure, len(group), len(group) - len(known), medians))
    return sorted(rows, key=_accuracy)


def _accuracy(row: MeasureRow) -> tuple[float, str]:
    accuracy = row.medians["accuracy_dof"]
    return inf if accuracy is None else accuracy, row.measure


# --- agreement -----------------------------------------------------------------------------------------


def agreement(found: Sequence[Agreement]) -> Table:
    """Return the answer of all measures on each recording without a truth."""
    return Table(_AGREEMENT, found, "Where the measures agree")


def _of_place(number: int, name: str) -> Callable[[Agreement], Any]:
    return lambda one: getattr(one.places[number], name) if len(one.places) > number else None


_AGREEMENT = (
    Column("recording", "sequence", kind="name"),
    _number(
        "agree",
        "share",
        percent,
        f"Share of the measures whose answers are within {NEAR:.0%} of the travel, or of the frames where the lens is "
        "unknown, of the answer. Measures whose scores grow with the light are not asked.",
    ),
    _number("frame", _of_place(0, "frame"), ".0f", "Frame of the answer, counted from 0."),
    _number("position", _of_place(0, "position"), ".3f", POSITION),
    _number(
        "other frame", _of_place(1, "frame"), ".0f", "Where they disagree, the frame that most of the others chose."
    ),
    _number("other position", _of_place(1, "position"), ".3f", "Position of the lens there."),
)


# --- data ----------------------------------------------------------------------------------------------


def grain(found: Sequence[SceneGrain]) -> Table:
    """Return the grain of each scene; of more than MAX_GRAIN_ROWS rows, those with the most grain."""
    if len(found) > MAX_GRAIN_ROWS:
        found = sorted(found, key=lambda one: -one.rms[1] if one.rms else 1)[:MAX_GRAIN_ROWS]
    measures = dict.fromkeys(measure for one in found for measure in one.of_curve)
    energy = "Largest energy of the noise divided by the range of the curve."

    def column(measure: str) -> Column:
        return _number(measure, lambda one: one.of_curve.get(measure), ".3g", energy)

    return Table((*_GRAIN, *map(column, measures)), found, "Grain of the pictures")


_rms = "Rms of the noise divided by the mean, at best focus:"
_GRAIN = (
    Column("scene", "scene", kind="name"),
    Column("motion", "scene_motion"),
    _number(
        "sequences",
        lambda one: f"{one.sequences[1]} of {one.sequences[0]}",
        meaning="Sequences that state their grain, out of all sequences.",
    ),
    _number("rms", lambda one: f"{one.rms[0]:.2%}" if one.rms else "unknown", "", f"{_rms} median over sequences."),
    _number(
        "worst", lambda one: f"{one.rms[1]:.2%}" if one.rms else "unknown", "", f"{_rms} largest value of any sequence."
    ),
)


def answers(found: Sequence[Any]) -> Table:
    """Return single answers, each a record with the number of its line; the numbers link to the file of records."""
    return Table(_ANSWERS, found, "Single answers")


_ANSWERS = (
    Column("method", "record.who.method", kind="name"),
    Column("sequence", "record.what.sequence", kind="name"),
    Column("status", "record.judgement.status"),
    _number("answer", "record.judgement.position", ".4f"),
    _number("truth", "record.judgement.truth", ".4f"),
    _number("error, DoF", "record.judgement.error_dof", ".2f"),
    _number("blur px", "record.judgement.blur_px", ".1f"),
    _number("line", "line", meaning=f"The line of the answer in {RECORDS_FILE}.", link=RECORDS_FILE),
    Column("note", "record.judgement.note", kind="note"),
)


def digests(values: Mapping[str, str], name: str, *, value: str) -> Table:
    """Return a table of names and a text for each; ``name`` and ``value`` are the headings."""
    columns = Column(name, itemgetter(0), kind="name"), Column(value, itemgetter(1), kind="name")
    return Table(columns, list(values.items()), f"{value} of each {name}")
