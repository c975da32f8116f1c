"""The page of an evaluation: one HTML file that contains its style, script and figures, and needs no network."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

from saf_gen import __version__
from saf_gen.benchmark.curve_quality import AssessedCurve
from saf_gen.benchmark.plugin_description import PluginDescription
from saf_gen.benchmark.records import Record
from saf_gen.benchmark.results import SequenceFailure
from saf_gen.leaderboard import (
    Axis,
    LeaderboardRow,
    compose_leaderboard_notes,
    keep_leaderboard_bins,
    list_shown_leaderboard_columns,
)
from saf_gen.leaderboard.leaderboard_tables import LeaderboardTables, compute_leaderboard_tables
from saf_gen.leaderboard.report import page_tables
from saf_gen.leaderboard.report.captions import (
    AGREEMENT_CAPTION,
    FIGURE_CAPTIONS,
    GRAIN_CAPTION,
    MEASURES_CAPTION,
    NEIGHBOUR_CAPTION,
    OPENING_CAPTION,
    OPENING_PICTURES,
)
from saf_gen.leaderboard.report.choose_figures import OPENING, ReportFigure
from saf_gen.leaderboard.report.page_answers import MAX_ANSWERS, choose_answers_for_report
from saf_gen.leaderboard.report.page_tables import PageTable
from saf_gen.leaderboard.report.page_templates import hash_report_script, load_report_templates, read_report_asset
from saf_gen.leaderboard.report.selections import list_report_selections
from saf_gen.leaderboard.table_formats import format_leaderboard_count

SCRIPTS = ("tables.js", "board.js", "compare.js", "viewer.js")
MAX_FAILURES = 100
COMPARISONS = ("profile", "neighbours")
"""Kinds of figures that compare methods on all sequences."""


@dataclass(frozen=True)
class FigureGroup:
    """The figures of one kind in a section, under a heading and a caption."""

    heading: str
    caption: str
    figures: Sequence[ReportFigure]


@dataclass(frozen=True)
class PageSection:
    """A section between the leaderboard and the meanings of its columns; empty parts are not shown."""

    id: str
    heading: str
    figures: Sequence[FigureGroup] = ()
    axes: Sequence[tuple[Axis, PageTable]] = ()
    table: PageTable | None = None
    caption: str = ""


def build_report_page(
    rows: Sequence[LeaderboardRow],
    *,
    title: str,
    records: Sequence[Record],
    curves: Sequence[AssessedCurve] = (),
    failures: Sequence[SequenceFailure] = (),
    report_figures: Sequence[ReportFigure] = (),
    plugins: Sequence[PluginDescription] = (),
    tables: LeaderboardTables | None = None,
) -> str:
    """Return the page of an evaluation as HTML, which is readable without its script.

    Parameters
    ----------
    rows : sequence of LeaderboardRow
        Leaderboard of ``records``, best first.
    title : str
        Heading, such as the name of the dataset.
    records : sequence of Record
        One record for each method and sequence.
    curves : sequence of AssessedCurve, optional
        Focus curves, which the table of measures summarises.
    failures : sequence of SequenceFailure, optional
        Sequences that could not be read.
    report_figures : sequence of ReportFigure, optional
        Figures of the page.
    plugins : sequence of PluginDescription, optional
        Measures and searches that the page describes.
    tables : LeaderboardTables, optional
        Tables of ``rows`` and ``records``, if they have been computed already.

    Returns
    -------
    str
        The page.
    """
    script = read_report_asset(*SCRIPTS)
    selections = list_report_selections(records)
    ranked = list(dict.fromkeys([tuple(rows), *(s.rows for s in selections)]))
    held = choose_answers_for_report(records)
    answers = page_tables.list_answers_for_report(held)
    methods = [row.method for row in rows]
    digests = {r.sequence: r.data for r in records}
    numbers = {name: number for number, name in enumerate(held.sequences)}
    grouped = groupby(enumerate(selections, start=1), key=lambda item: item[1].axis)
    shown = list_shown_leaderboard_columns(rows)
    opening = next((figure for figure in report_figures if figure.kind == OPENING), None)
    return (
        load_report_templates()
        .get_template("page.html")
        .render(
            title=title,
            script=script,
            script_hash=hash_report_script(script),
            style=read_report_asset("page.css"),
            summary=_summarise(rows, records),
            judged=_say_what_is_judged(records),
            opening=opening,
            opening_caption=[OPENING_CAPTION, *([OPENING_PICTURES] if opening and "<image" in opening.svg else [])],
            leaders=[row for row in rows if row.rank == 1],
            failures=failures[:MAX_FAILURES],
            more_failures=max(0, len(failures) - MAX_FAILURES),
            sections=_list_sections(
                tables or compute_leaderboard_tables(rows, records),
                curves=curves,
                records=records,
                report_figures=report_figures,
            ),
            selections=[(axis, [(n, s.name) for n, s in options]) for axis, options in grouped],
            board=page_tables.tabulate_leaderboard(ranked) if rows else None,
            notes=" ".join(compose_leaderboard_notes(rows, records)),
            answers=page_tables.tabulate_answers_for_report(answers[:MAX_ANSWERS]),
            plugins=_group_plugins(plugins),
            code=_list_code(plugins),
            columns=shown,
            held=held,
            data_digests=page_tables.tabulate_names_for_report(
                {name: digests[name] for name in held.sequences}, name="sequence", value="content_sha256"
            ),
            method_digests=page_tables.tabulate_names_for_report(
                {r.method: f"{r.code}, constants of {r.tuning}" if r.tuning else r.code for r in records},
                name="method",
                value="code",
            ),
            data={
                "methods": methods,
                "sequences": list(held.sequences),
                "compared": held.compared,
                "total": held.total,
                "selections": [
                    {
                        "body": ranked.index(s.rows),
                        "sequences": [numbers[name] for name in s.sequences if name in numbers],
                        "total": len(s.sequences),
                    }
                    for s in selections
                ],
                "answers": [[methods.index(m), numbers[s], *texts] for m, s, *texts in answers],
            },
            version=__version__,
        )
    )


def _summarise(rows: Sequence[LeaderboardRow], records: Sequence[Record]) -> str:
    scenes, sequences = len({r.scene for r in records}), len({r.sequence for r in records})
    tracks = {"recorded": "recorded sweeps", "closed_loop": "closed loop"}
    return ", ".join(
        [
            f"{format_leaderboard_count(len(rows), 'method')} on {format_leaderboard_count(sequences, 'sequence')} of "
            f"{format_leaderboard_count(scenes, 'scene')}",
            *sorted({tracks[r.track] + (f" ({r.terms})" if r.terms else "") for r in records}),
            *(f"region {name}" for name in sorted({r.region for r in records})),
        ]
    )


def _say_what_is_judged(records: Sequence[Record]) -> str:
    """Return sentences about the task of the methods and what is judged."""
    if {record.track for record in records} == {"closed_loop"}:
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


def _list_sections(
    tables: LeaderboardTables,
    *,
    curves: Sequence[AssessedCurve],
    records: Sequence[Record],
    report_figures: Sequence[ReportFigure],
) -> list[PageSection]:
    """Return the sections that are not empty: comparison of methods, scenes, conditions, measures and grain."""
    by_scene: dict[str, list[ReportFigure]] = {"": []}
    for figure in report_figures:
        by_scene.setdefault(figure.scene, []).append(figure)
    general = by_scene.pop("")
    conditions = _group_figures([figure for figure in general if figure.kind not in COMPARISONS])
    compared = _group_figures([figure for figure in general if figure.kind in COMPARISONS])
    shown = [keep_leaderboard_bins(table) for table in tables.axes if len(table.bins) > 1]
    by_axis = [(table.axis, page_tables.tabulate_axis_for_report(table)) for table in shown]
    sections = []
    if neighbours := page_tables.tabulate_ranked_neighbours(tables.comparison.neighbours):
        sections.append(
            PageSection("neighbours", "Methods compared", compared, table=neighbours, caption=NEIGHBOUR_CAPTION)
        )
    sections += [
        PageSection(f"scene-{number}", scene, _group_figures(figures))
        for number, (scene, figures) in enumerate(by_scene.items(), start=1)
    ]
    if by_axis or conditions:
        agreed = page_tables.tabulate_rank_agreement(tables.agreement)
        sections.append(PageSection("conditions", "By condition", conditions, by_axis, agreed, AGREEMENT_CAPTION))
    if measures := page_tables.tabulate_measures_for_report(curves):
        sections.append(PageSection("measures", "Curves of the measures", table=measures, caption=MEASURES_CAPTION))
    if grain := page_tables.tabulate_grain_for_report(records):
        sections.append(PageSection("grain", "Grain of the pictures", table=grain, caption=GRAIN_CAPTION))
    return sections


def _group_figures(report_figures: Sequence[ReportFigure]) -> list[FigureGroup]:
    groups = []
    for kind, (heading, caption) in FIGURE_CAPTIONS.items():
        if figures := [figure for figure in report_figures if figure.kind == kind]:
            omissions = dict.fromkeys(figure.omission for figure in figures if figure.omission)
            groups.append(FigureGroup(heading, " ".join([caption, *omissions]), figures))
    return groups
