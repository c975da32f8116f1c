"""The page of an evaluation: one HTML file that contains its style, script and figures, and needs no network."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from math import inf

from saf_gen import __version__
from saf_gen.benchmark.plugin_description import PluginDescription
from saf_gen.benchmark.records import Record
from saf_gen.benchmark.results import Evaluation
from saf_gen.core.plain_text import plural
from saf_gen.core.table import Table
from saf_gen.leaderboard import tables
from saf_gen.leaderboard.axes import AXES, BLOCK_READOUTS, Axis, group_by_bin, keep_largest, largest_bins
from saf_gen.leaderboard.files import Results, compute_results
from saf_gen.leaderboard.notes import grain_by_scene, notes_on
from saf_gen.leaderboard.outcomes import describe_size, group_by
from saf_gen.leaderboard.ranking import LeaderboardRow, rank_methods
from saf_gen.leaderboard.report.choose_figures import OPENING, ReportFigure
from saf_gen.leaderboard.report.html import hash_script, load_templates, read_asset

SCRIPTS = ("tables.js", "board.js", "compare.js", "viewer.js")
MAX_FAILURES = 100
COMPARISONS = ("profile", "neighbours")
"""Kinds of figures that compare methods on all sequences."""
MAX_ANSWERS = 100
"""Largest number of rows in the table of single answers, with and without the script."""
MAX_HELD = 5000
"""Number of answers above which the page holds only a selection for its script, so that its size stays limited."""
WORST_OF_METHOD = 20
SPLIT = Axis("split", "Split", "Split of the dataset.", lambda r: r.split)
_SWEEP = (
    "Grey: the light, as mean counts. Yellow: the depth of focus around the true focus. At the top: the "
    "answers of each search with each measure. Each picture shows a part of the sweep: TFP counts its spikes, TFI "
    "shows the time between two spikes in its middle, and spikes is one readout of a part of the sensor, magnified. "
    "Measures look inside the outlined box."
)
OPENING_CAPTION = (
    "Width of the target's blur against the distance of the lens from the true focus. Inside the yellow band the blur"
    " is at most one pixel wide."
)
OPENING_PICTURES = (
    "Above: a detail of the target as the camera saw it at the dots, with their distances in depths of focus."
)
FIGURE_CAPTIONS = {
    "curves": (
        "Focus curves",
        "The curve of each measure, scaled by its minimum and maximum. A curve that follows the grey area follows the "
        f"light, not the focus. {_SWEEP}",
    ),
    "sweep": ("Sweeps", f"No method computed a complete focus curve of these, as the search argmax would. {_SWEEP}"),
    "errors": (
        "Errors",
        "Answer minus truth of each method, with one mark per sequence; if there are many, a mark shows their median "
        "and a line the middle 90 %. The yellow band is success within one depth of focus.",
    ),
    "steps": ("Steps of the searches", "The position that a search examined at each step, and the true focus."),
    "lens": (
        "Path of the lens",
        "The position of the lens over time, and the true focus. A line ends where the lens was judged; "
        "a cross marks a method that failed.",
    ),
    "profile": (
        "Performance profiles",
        "Fraction of answers within each limit, over the sequences that have one: a higher line is better. The bands,"
        " for the first three methods, are 95 % intervals of each point alone; profiles.csv has them for all methods."
        " Methods are ranked by their fractions at the line at one depth of focus.",
    ),
    "neighbours": (
        "Probability of improvement",
        "Probability that the upper of two neighbours in rank is nearer to the truth on a sequence (ties count"
        " half), with 95 % intervals of each pair alone. One half means no improvement; because methods are ranked by"
        " success, the probability may be lower.",
    ),
    "light-ratio": (
        "Against the light ratio",
        "Answerable success within one depth of focus (above) and median error (below) against the light ratio "
        "(brightest divided by darkest light). Dots are single answers.",
    ),
    "photon-budget": (
        "Against the photon budget",
        "Answerable success within one DoF (above) and median error (below) against the mean counts per pixel in a "
        f"block of {BLOCK_READOUTS} readouts. Dots are single answers.",
    ),
}
"""Heading and caption of each kind of figure."""
NEIGHBOUR_CAPTION = (
    "Methods that follow each other in rank: their difference in answerable success within 1 DoF, and the probability"
    " that the first is nearer to the truth on a sequence, with 95 % intervals of each pair alone. Told apart:"
    " whether the difference is too large for chance, among all pairs at once."
)
AGREEMENT_CAPTION = (
    "How much the ranking depends on a condition: Kendall's τ of the rankings under two of its bins is 1 if both order"
    " the methods alike. The table also gives the interval of τ over scenes, the τ to expect if the condition had no"
    " effect, and the probability that τ would then be as low (p, for this pair alone)."
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
        Names of the sequences. The first ``compared`` of them have the answers of every method.
    compared : int
        Number of sequences that have the answers of every method.
    total : int
        Number of all sequences of the evaluation.
    """

    answers: tuple[Answer, ...]
    sequences: tuple[str, ...]
    compared: int
    total: int

    @property
    def are_all(self) -> bool:
        """Whether every answer is in the page."""
        return self.compared == self.total


@dataclass(frozen=True)
class Selection:
    """The sequences in one bin of an axis, and the methods ranked on them alone."""

    axis: str
    name: str
    sequences: tuple[str, ...]
    rows: tuple[LeaderboardRow, ...]


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
    axes: Sequence[tuple[Axis, Table]] = ()
    table: Table | None = None
    caption: str = ""


def build_page(
    evaluation: Evaluation,
    rows: Sequence[LeaderboardRow],
    *,
    title: str,
    figures: Sequence[ReportFigure] = (),
    results: Results | None = None,
) -> str:
    """Return the page of an evaluation as HTML, which is readable without its script.

    Parameters
    ----------
    evaluation : Evaluation
        The evaluation.
    rows : sequence of LeaderboardRow
        Rows of its leaderboard, best first.
    title : str
        Heading, such as the name of the dataset.
    figures : sequence of ReportFigure, optional
        Figures of the page.
    results : Results, optional
        Results of the evaluation, if they have been computed already.

    Returns
    -------
    str
        The page.
    """
    records, failures, plugins = evaluation.records, evaluation.failures, evaluation.plugins
    selections = list_selections(records)
    ranked = list(dict.fromkeys([tuple(rows), *(s.rows for s in selections)]))
    held = choose_answers(records)
    answers = tables.answers(held.answers)
    methods = [row.method for row in rows]
    digests = {r.sequence: r.data for r in records}
    codes = {r.method: f"{r.code}, constants of {r.tuning}" if r.tuning else r.code for r in records}
    numbers = {name: number for number, name in enumerate(held.sequences)}
    grouped = groupby(enumerate(selections, start=1), key=lambda item: item[1].axis)
    opening = next((figure for figure in figures if figure.kind == OPENING), None)
    script = read_asset(*SCRIPTS)
    return (
        load_templates()
        .get_template("page.html")
        .render(
            title=title,
            script=script,
            script_hash=hash_script(script),
            style=read_asset("page.css"),
            summary=_summarise(rows, records),
            judged=_say_what_is_judged(records),
            opening=opening,
            opening_caption=[OPENING_CAPTION, *([OPENING_PICTURES] if opening and "<image" in opening.svg else [])],
            leaders=[row for row in rows if row.rank == 1],
            failures=failures[:MAX_FAILURES],
            more_failures=max(0, len(failures) - MAX_FAILURES),
            sections=_list_sections(evaluation, results or compute_results(rows, records), figures=figures),
            selections=[(axis, [(n, s.name) for n, s in options]) for axis, options in grouped],
            board=tables.ranking(rows),
            ranked=ranked,
            notes=" ".join(notes_on(rows, records)),
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
                "answers": [
                    [
                        methods.index(one.record.method),
                        numbers[one.record.sequence],
                        *(column.text(one) for column in answers.columns[2:]),
                    ]
                    for one in held.answers
                ],
            },
            version=__version__,
        )
    )


def _summarise(rows: Sequence[LeaderboardRow], records: Sequence[Record]) -> str:
    scenes = len({r.scene for r in records})
    tracks = {"recorded": "recorded sweeps", "closed_loop": "closed loop"}
    return ", ".join(
        [
            f"{plural(len(rows), 'method')} on {plural(scenes, 'scene')}",
            describe_size(records),
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


def _list_sections(evaluation: Evaluation, results: Results, *, figures: Sequence[ReportFigure]) -> list[PageSection]:
    """Return the sections that are not empty: comparison of methods, scenes, conditions, measures and grain."""
    by_scene = group_by(figures, "scene")
    general = by_scene.pop("", [])
    conditions = _group_figures([figure for figure in general if figure.kind not in COMPARISONS])
    compared = _group_figures([figure for figure in general if figure.kind in COMPARISONS])
    by_axis = [(one.axis, tables.by_bin(one)) for one in map(keep_largest, results.axes) if len(one.bins) > 1]
    sections = []
    if pairs := results.comparison.neighbours:
        sections.append(
            PageSection("neighbours", "Methods compared", compared, (), tables.neighbours(pairs), NEIGHBOUR_CAPTION)
        )
    sections += [
        PageSection(f"scene-{number}", scene, _group_figures(own))
        for number, (scene, own) in enumerate(by_scene.items(), start=1)
    ]
    if conditions or by_axis:
        agreed = tables.agreement(results.agreement) if results.agreement else None
        sections.append(PageSection("conditions", "By condition", conditions, by_axis, agreed, AGREEMENT_CAPTION))
    if curves := evaluation.curves:
        table = tables.measures(curves)
        sections.append(PageSection("measures", "Curves of the measures", table=table, caption=MEASURES_CAPTION))
    if grain := grain_by_scene(evaluation.records):
        table = tables.grain(grain)
        sections.append(PageSection("grain", "Grain of the pictures", table=table, caption=GRAIN_CAPTION))
    return sections


def _group_figures(report_figures: Sequence[ReportFigure]) -> list[FigureGroup]:
    groups = []
    for kind, (heading, caption) in FIGURE_CAPTIONS.items():
        if figures := [figure for figure in report_figures if figure.kind == kind]:
            omissions = dict.fromkeys(figure.omission for figure in figures if figure.omission)
            groups.append(FigureGroup(heading, " ".join([caption, *omissions]), figures))
    return groups


def choose_answers(records: Sequence[Record], *, max_answers: int = MAX_HELD) -> HeldAnswers:
    """Return the answers that the page holds, the worst first.

    If there are at most ``max_answers`` answers, all are held. Otherwise the page holds the answers of every method on
    sequences that are spread evenly over all, the MAX_ANSWERS worst answers of all, and the WORST_OF_METHOD worst of
    each method, or fewer if there are many methods, so that at most about twice ``max_answers`` are held.
    """
    names = list(dict.fromkeys(record.sequence for record in records))
    methods = len({record.method for record in records})
    sizes = [inf if record.error_dof is None else abs(record.error_dof) for record in records]
    worst_first = sorted(range(len(records)), key=lambda at: -sizes[at])
    compared, worst = names, set(worst_first[:MAX_ANSWERS])
    if len(records) > max_answers:
        count = max(1, max_answers // methods)
        compared = [names[i * len(names) // count] for i in range(count)]
        of_method: Counter[str] = Counter()
        for at in worst_first:
            if of_method[records[at].method] < min(WORST_OF_METHOD, count):
                of_method[records[at].method] += 1
                worst.add(at)
    chosen = set(compared)
    held = [at for at in worst_first if at in worst or records[at].sequence in chosen]
    sequences = tuple(dict.fromkeys([*compared, *(records[at].sequence for at in held)]))
    return HeldAnswers(tuple(Answer(at + 1, records[at]) for at in held), sequences, len(compared), len(names))


def list_selections(records: Sequence[Record]) -> list[Selection]:
    """Return one selection for each bin of each axis along which sequences differ.

    If an axis has many bins, only the largest get a selection (see largest_bins). Selections of the same
    sequences have the same rows.
    """
    ranked: dict[tuple[str, ...], tuple[LeaderboardRow, ...]] = {}
    selections = []
    for axis in (SPLIT, *AXES):
        bins = group_by_bin(records, axis)
        members = {name: tuple(dict.fromkeys(r.sequence for r in group)) for name, group in bins.items()}
        for name in largest_bins({name: len(group) for name, group in members.items()}) if len(bins) > 1 else ():
            sequences = members[name]
            if sequences not in ranked:
                ranked[sequences] = rank_methods(bins[name])
            selections.append(Selection(axis.title, name, sequences, ranked[sequences]))
    return selections
