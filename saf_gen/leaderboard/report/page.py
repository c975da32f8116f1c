"""The page of an evaluation: one HTML file that contains its style, script and charts, and needs no network."""

import base64
import hashlib
import json
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from importlib.metadata import PackageNotFoundError, metadata
from importlib.resources import files
from itertools import groupby
from math import inf
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from saf_gen import __version__
from saf_gen.benchmark.method_spec import measure_and_search
from saf_gen.benchmark.plugin_description import PluginDescription
from saf_gen.benchmark.records import Record
from saf_gen.core.plain_text import plural
from saf_gen.core.table import Column, Table, percent
from saf_gen.errors import escape_controls
from saf_gen.leaderboard import tables
from saf_gen.leaderboard.board import Leaderboard
from saf_gen.leaderboard.ranking import LeaderboardRow, describe_size, group_by, rank_methods
from saf_gen.leaderboard.report.charts import Chart, plot_times
from saf_gen.leaderboard.report.pictures import Delivered
from saf_gen.leaderboard.results import AXES, Axis, group_by_bin, largest_bins

SCRIPTS = ("uplot/uPlot.iife.min.js", "tables.js", "board.js", "charts.js", "viewer.js")
STYLES = ("uplot/uPlot.min.css", "page.css")
MAX_FAILURES = 100
MAX_ANSWERS = 100
"""Largest number of rows in the table of single answers, with and without the script."""
MAX_HELD = 5000
"""Number of answers above which the page holds only a selection for its script, so that its size stays limited."""
LOOKING = {
    "target": "looking at the target",
    "inside": "looking inside the target",
    "frame": "looking at the whole frame",
}
"""What the first line of a page says of the regions where methods look."""
MAX_OPENING = 3
"""Largest number of recordings whose curves open a page on which nothing is ranked."""
MAX_TOGETHER_CHARACTERS = 60
"""Largest total length of the headings of columns that are shown together, at which they are shown at first.

The tables by condition and the view of all columns always show them.
"""
OURS = "This project"
"""Beginning of the source of a measure or search that was published here."""
EVERYBODYS = "Exhaustive search"
"""In the source of a search that needs no reference."""
SOURCE_MEANING = (
    "First author and year of the measure and, if it has a source, of the search; here: this project. "
    "The link leads to them."
)
_DOI = re.compile(r"doi:\S+")
_AUTHOR = re.compile(r"([A-Z][\w-]+)(?: et al\.|,| and [A-Z])")
SPLIT = Axis("split", "Split", "Split of the dataset.", lambda r: r.what.split)
_SWEEP = (
    "Grey: the light, as mean counts. Yellow: the depth of focus around the true focus. At the top: the "
    "answers of each search with each measure. Each picture shows a part of the sweep: TFP counts its spikes, TFI "
    "shows the time between two spikes in its middle, and spikes is one readout of a part of the sensor, magnified. "
    "Measures look inside the outlined box."
)
CHART_CAPTIONS = {
    "profile": (
        "Performance profiles",
        "Fraction of answers within each limit, over the sequences that have one: a higher line is better."
        " profiles.csv has the intervals of all methods, which are ranked by their fractions at one depth of focus.",
    ),
    "curves": (
        "Focus curves",
        "The curve of each measure, scaled by its minimum and maximum. Upright: the true focus or, if unknown, where "
        f"measures agree. A curve that follows the grey area follows the light, not the focus. {_SWEEP}",
    ),
    "sweep": ("Sweeps", f"No method computed a complete focus curve of these, as the search argmax would. {_SWEEP}"),
    "lens": (
        "Path of the lens",
        "The position of the lens over time, and the true focus in its depth of focus. A line ends where the lens was "
        "judged.",
    ),
}
"""Heading and caption of each kind of chart."""
NEIGHBOUR_CAPTION = (
    "Methods that follow each other in rank: their difference in answerable success within 1 DoF, and the probability"
    " that the first is nearer to the truth on a sequence, with 95 % intervals of each pair alone. Told apart:"
    " whether the difference is too large for chance, among all pairs at once."
)
GRAIN_CAPTION = (
    "Noise that the renderer left in the pictures: its root mean square divided by the mean, in the box around the"
    " target at best focus, and its largest energy divided by the range of each measure's focus curve. An energy above"
    " a tenth of the range may move the peak of the curve. Only measures for which the recordings state this energy are"
    " listed."
)
MEASURES_CAPTION = (
    "Quality of the focus curve of each measure, regardless of the search: medians over the sequences. The"
    " criteria are common in microscopy; curves.csv has every sequence."
)


@dataclass(frozen=True)
class Answer:
    """A record and its line in ``records.jsonl``, counted from 1."""

    line: int
    record: Record


@dataclass(frozen=True)
class HeldAnswers:
    """The answers in the page, the worst first, and their sequences.

    Attributes
    ----------
    answers : tuple of Answer
        The answers.
    sequences : tuple of str
        Names of the sequences.
    total : int
        Number of all sequences of the evaluation.
    """

    answers: tuple[Answer, ...]
    sequences: tuple[str, ...]
    total: int


@dataclass(frozen=True)
class Selection:
    """The sequences in one bin of an axis, and the methods ranked on them alone."""

    axis: str
    name: str
    sequences: tuple[str, ...]
    rows: tuple[LeaderboardRow, ...]


@dataclass(frozen=True)
class ChartGroup:
    """The charts of one kind in a section, under a heading and a caption."""

    heading: str
    caption: str
    charts: Sequence[Chart]


@dataclass(frozen=True)
class PageSection:
    """A section between the leaderboard and the meanings of its columns; empty parts are not shown."""

    id: str
    heading: str
    charts: Sequence[ChartGroup] = ()
    axes: Sequence[tuple[Axis, Table]] = ()
    table: Table | None = None
    caption: str = ""


def build_page(
    board: Leaderboard, *, title: str, charts: Sequence[Chart] = (), delivered: Delivered | None = None
) -> str:
    """Return the page of an evaluation as HTML, which is readable without its script.

    Parameters
    ----------
    board : Leaderboard
        The leaderboard of the evaluation.
    title : str
        Heading, such as the name of the dataset.
    charts : sequence of Chart, optional
        Charts of the page.
    delivered : Delivered, optional
        What some methods delivered.

    Returns
    -------
    str
        The page.
    """
    rows, records, methods = board.rows, board.records, board.methods
    failures, plugins = board.evaluation.failures, board.evaluation.plugins
    selections = list_selections(records)
    ranked = list(dict.fromkeys([rows, *(s.rows for s in selections)]))
    held = choose_answers(records)
    answers = tables.answers(held.answers)
    digests = {r.what.sequence: r.what.data for r in records}
    codes = {
        r.who.method: f"{r.who.code}, constants of {r.who.tuning}" if r.who.tuning else r.who.code for r in records
    }
    numbers = {name: number for number, name in enumerate(held.sequences)}
    grouped = groupby(enumerate(selections, start=1), key=lambda item: item[1].axis)
    script = _read_asset(*SCRIPTS)
    sweeps = ("curves", "sweep") if board.lacks_truth else ()  # where nothing is ranked, these open the page
    opened = [chart for chart in charts if chart.kind in sweeps][:MAX_OPENING]
    return (
        load_templates()
        .get_template("page.html")
        .render(
            title=title,
            script=script,
            script_hash=_hash_script(script),
            style=_read_asset(*STYLES),
            summary=_summarise(rows, records),
            judged=_say_what_is_judged(records),
            verdict=("", " ".join(board.lead)) if board.lacks_truth else board.verdict,
            unjudged=board.lacks_truth,
            opening=_group_charts(opened),
            agreement=board.agreement if len(board.agreements) > 1 else None,
            scatter=plot_times(rows),
            delivered=delivered,
            failures=failures[:MAX_FAILURES],
            more_failures=max(0, len(failures) - MAX_FAILURES),
            sections=_list_sections(board, [chart for chart in charts if chart not in opened]),
            selections=[(axis, [(n, s.name) for n, s in options]) for axis, options in grouped],
            board=add_sources(tables.shade(board.ranking), plugins),
            ranked=ranked,
            names=board.names,
            notes=" ".join(board.notes),
            answers=replace(answers, rows=answers.rows[:MAX_ANSWERS]),
            plugins=_group_plugins(plugins),
            code=_list_code(plugins),
            held=held,
            digests=(
                tables.digests({name: digests[name] for name in held.sequences}, "sequence", value="content_sha256"),
                tables.digests(codes, "method", value="code"),
            ),
            data={
                "methods": methods,
                "sequences": list(held.sequences),
                "total": held.total,
                "selections": [
                    {
                        "body": ranked.index(s.rows),
                        "sequences": [numbers[name] for name in s.sequences if name in numbers],
                        "total": len(s.sequences),
                    }
                    for s in selections
                ],
                "answers": [
                    [
                        methods.index(one.record.who.method),
                        numbers[one.record.what.sequence],
                        *(column.text(one) for column in answers.columns[2:]),
                    ]
                    for one in held.answers
                ],
            },
            version=__version__,
            project=_address_of_project(),
        )
    )


def _summarise(rows: Sequence[LeaderboardRow], records: Sequence[Record]) -> str:
    scenes = len({r.what.scene for r in records})
    tracks = {"recorded": "recorded sweeps", "closed_loop": "closed loop"}
    return ", ".join(
        [
            f"{plural(len(rows), 'autofocus method')} (focus measure + search) on {plural(scenes, 'scene')}",
            describe_size(records),
            *sorted({tracks[r.what.track] + (f" ({r.what.terms})" if r.what.terms else "") for r in records}),
            *(LOOKING.get(name, f"looking at the box {name!r}") for name in sorted({r.who.region for r in records})),
        ]
    )


def _address_of_project() -> str:
    """Return the address of the repository; '' if this package was not built where it is known."""
    try:
        stated = metadata("saf_gen").get_all("Project-URL") or []
    except PackageNotFoundError:
        return ""
    return next((url for name, _, url in (line.partition(", ") for line in stated) if name == "Repository"), "")


def add_sources(board: Table, plugins: Sequence[PluginDescription]) -> Table:
    """Return the leaderboard with authors and years of each measure and search, which lead to their papers and code."""
    sources = {(one.plugin_kind, one.name): dict(one.facts).get("source", "") for one in plugins}

    def source(row: LeaderboardRow) -> str | None:
        measure, search = measure_and_search(row.method)
        known = [_author_and_year(sources.get(key, "")) for key in (("measures", measure), ("searches", search))]
        return " + ".join(dict.fromkeys(filter(None, known))) or None

    at = next(number for number, column in enumerate(board.columns) if column.name == "method") + 1
    column = Column("from", source, meaning=SOURCE_MEANING, detail=tables.USUAL, link="#methods", optional=True)
    return replace(board, columns=[*board.columns[:at], column, *board.columns[at:]])


def _author_and_year(source: str) -> str:
    """Return first author and year of the first reference of a source; "here" for our own, '' for none.

    A reference without authors is named by its venue.
    """
    first = _DOI.sub("", source.partition("[2]")[0])
    author, year = _AUTHOR.search(first), re.search(r"\b(?:[A-Z]{3,} )?(?:19|20)\d\d\b", first)
    if first.startswith(OURS):
        return "here"
    return "" if EVERYBODYS in first or not year else f"{author[1]} {year[0][-4:]}" if author else year[0]


def _say_what_is_judged(records: Sequence[Record]) -> str:
    """Return sentences about the task of the methods and what is judged."""
    if {record.what.track for record in records} == {"closed_loop"}:
        return (
            "Each method commands the lens of a running spike camera, sees only its spikes, and moves the lens to the"
            " position where the target is sharp. The final position of the lens is judged."
        )
    return (
        "While its lens sweeps through the focus, a spike camera records the light. Each method, a focus measure with a"
        " search for its peak, estimates from the spikes alone where the lens was when the target was sharp."
        " The distance between this answer and the true focus, which is known from the optics, is judged."
    )


def _group_plugins(plugins: Sequence[PluginDescription]) -> list[tuple[str, list[PluginDescription]]]:
    headings = {"measures": "Focus measures", "searches": "Searches"}
    return [(headings[kind], list(group)) for kind, group in groupby(plugins, key=lambda plugin: plugin.plugin_kind)]


def _list_code(plugins: Sequence[PluginDescription]) -> dict[tuple[str, str], str]:
    """Return the page's id of each file of code (name, text), files of measures first."""
    files = dict.fromkeys(file for plugin in plugins for file in plugin.code)
    return {file: f"code-{number}" for number, file in enumerate(files, start=1)}


def _list_sections(board: Leaderboard, charts: Sequence[Chart]) -> list[PageSection]:
    """Return the sections that are not empty: comparison of methods, scenes, conditions, measures and grain."""
    by_scene = group_by(charts, "scene")
    compared = _group_charts(by_scene.pop("", []))
    sections = []
    if board.comparison.neighbours:
        sections.append(
            PageSection("neighbours", "Which methods differ", compared, (), board.neighbours, NEIGHBOUR_CAPTION)
        )
    sections += [
        PageSection(f"scene-{number}", scene, _group_charts(own))
        for number, (scene, own) in enumerate(by_scene.items(), start=1)
    ]
    if board.conditions:
        sections.append(PageSection("conditions", "By light, motion and scene", axes=board.conditions))
    if board.evaluation.curves:
        sections.append(
            PageSection("measures", "How the focus measures peak", table=board.measures, caption=MEASURES_CAPTION)
        )
    if board.grain:
        grain = tables.grain(board.grain)
        sections.append(PageSection("grain", "Noise of the renderer", table=grain, caption=GRAIN_CAPTION))
    return sections


def _group_charts(charts: Sequence[Chart]) -> list[ChartGroup]:
    groups = []
    for kind, (heading, caption) in CHART_CAPTIONS.items():
        if own := [chart for chart in charts if chart.kind == kind]:
            omissions = dict.fromkeys(chart.omission for chart in own if chart.omission)
            groups.append(ChartGroup(heading, " ".join([caption, *omissions]), own))
    return groups


def choose_answers(records: Sequence[Record], *, max_answers: int = MAX_HELD) -> HeldAnswers:
    """Return the answers that the page holds, the worst first.

    If there are more than ``max_answers`` answers, the page holds the worst of each method, as many of every method,
    and the MAX_ANSWERS worst of all.
    """
    methods = {record.who.method for record in records}
    each = len(records) if len(records) <= max_answers else max(1, max_answers // len(methods))
    sizes = [inf if record.judgement.error_dof is None else abs(record.judgement.error_dof) for record in records]
    of_method: Counter[str] = Counter()
    held: list[Answer] = []
    for at in sorted(range(len(records)), key=lambda at: -sizes[at]):
        of_method[records[at].who.method] += 1
        if len(held) < MAX_ANSWERS or of_method[records[at].who.method] <= each:
            held.append(Answer(at + 1, records[at]))
    known = {answer.record.what.sequence for answer in held}
    names = list(dict.fromkeys(record.what.sequence for record in records))
    return HeldAnswers(tuple(held), tuple(name for name in names if name in known), len(names))


def list_selections(records: Sequence[Record]) -> list[Selection]:
    """Return one selection for each bin of each axis along which sequences differ.

    If an axis has many bins, only the largest get a selection (see largest_bins). Bins with too few scenes to rank
    methods get none. Selections of the same sequences have the same rows.
    """
    ranked: dict[tuple[str, ...], tuple[LeaderboardRow, ...]] = {}
    selections = []
    for axis in (SPLIT, *AXES):
        bins = group_by_bin(records, axis)
        members = {name: tuple(dict.fromkeys(r.what.sequence for r in group)) for name, group in bins.items()}
        for name in largest_bins({name: len(group) for name, group in members.items()}) if len(bins) > 1 else ():
            sequences = members[name]
            if len({r.what.scene for r in bins[name]}) < axis.min_scenes:
                continue
            if sequences not in ranked:
                ranked[sequences] = rank_methods(bins[name])
            selections.append(Selection(axis.title, name, sequences, ranked[sequences]))
    return selections


@cache
def load_templates() -> Environment:
    """Return the templates of the page, with their filters; every text that is not marked as HTML is escaped."""
    templates = Environment(
        loader=PackageLoader("saf_gen.leaderboard.report", "assets"),
        autoescape=True,
        finalize=lambda value: value if isinstance(value, Markup) else _escape_steering(value),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    templates.filters["base64"] = lambda data: base64.b64encode(data).decode()
    templates.filters["css_percent"] = lambda fraction: f"{100 * fraction:.4g}%"
    templates.filters["fold_rules"] = _format_fold_rules
    templates.filters["link_sources"] = _link_sources
    templates.filters["percent"] = percent
    templates.filters["breakable"] = lambda method: Markup(re.sub("([+:,])", r"\1<wbr>", str(_to_html(method))))
    templates.filters["lines"] = partial(_to_html, keep="\n\t")
    templates.policies["json.dumps_function"] = _to_json
    templates.policies["json.dumps_kwargs"] = {}
    return templates


def _to_html(text: str, *, keep: str = "") -> Markup:
    return escape(escape_controls(text, keep=keep))


def _escape_steering(item: Any) -> Any:
    """Return a text, or the texts of lists and mappings, with escapes in place of characters that reorder letters."""
    if isinstance(item, str):
        return escape_controls(item)
    if isinstance(item, Mapping):
        return {key: _escape_steering(value) for key, value in item.items()}
    return list(map(_escape_steering, item)) if isinstance(item, list | tuple) else item


def _to_json(item: Any) -> str:
    return json.dumps(_escape_steering(item), ensure_ascii=False, allow_nan=False, separators=(",", ":"))


def _read_asset(*names: str) -> Markup:
    """Return the joined text of files in ``assets``, for a style or script element."""
    folder = files("saf_gen.leaderboard.report") / "assets"
    return Markup("\n".join((folder / name).read_text(encoding="utf-8") for name in names))


def _hash_script(script: str) -> str:
    """Return the base64-encoded SHA-256 by which the content security policy of a page allows its script."""
    return base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()


def _format_fold_rules(table: Table, id: str) -> Markup:
    """Return the style rules that hide the columns of a folded table for which the screen has no space."""
    shown = table.shown
    is_long = sum(len(column.header) + 3 for column in shown if column.together) > MAX_TOGETHER_CHARACTERS

    def narrowest(column: Column) -> str:
        """Return the screens that have no space for a column; '' for one that is always shown."""
        if column.detail > tables.USUAL or (column.together and is_long):
            return "all"
        rarely_told = column.name in ("false_abstentions", "failed")
        return (
            "screen and (max-width: 90rem)" if rarely_told else "screen and (max-width: 40rem)" if column.detail else ""
        )

    rules = []
    for where in ("all", "screen and (max-width: 90rem)", "screen and (max-width: 40rem)"):
        cells = ", ".join(
            f"#{id}.folded tr:not(.groups) > :nth-child({number})"
            for number, column in enumerate(shown, start=1)
            if narrowest(column) == where
        )
        rules += [f"@media {where} {{ {cells} {{ display: none; }} }}"] if cells else []
    return Markup("\n".join(rules))


def _link_sources(text: str) -> Markup:
    """Return the text as HTML with a link for each DOI."""
    linked = re.sub(
        r"\bdoi:(10\.\S+?)(?=[.,;)]*(?:\s|$))", r'<a href="https://doi.org/\1">doi:\1</a>', str(_to_html(text))
    )
    return Markup(linked)
