"""A leaderboard: ranked methods, and everything that tables and pages say of them, each computed when first needed."""

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from html import escape
from inspect import isfunction
from math import inf
from pathlib import Path
from textwrap import fill
from typing import Any, get_args, overload
from warnings import warn

from saf_gen.benchmark.evaluate import evaluate as run_methods
from saf_gen.benchmark.method_spec import has_view_parameter
from saf_gen.benchmark.records import Record, Track, read_records
from saf_gen.benchmark.results import Evaluation
from saf_gen.core.config.registry import add_plugin
from saf_gen.core.plain_text import plural
from saf_gen.core.table import TEXT_WIDTH, Table
from saf_gen.errors import BadInput, escape_controls, unknown
from saf_gen.leaderboard import tables
from saf_gen.leaderboard.agreement import Agreement, contradicts_truth, find_agreements, lacks_truth
from saf_gen.leaderboard.merging import merge_records
from saf_gen.leaderboard.ranking import (
    LeaderboardRow,
    MethodComparison,
    Outcomes,
    collect_outcomes,
    compare_methods,
    describe_size,
    group_by,
    rank,
)
from saf_gen.leaderboard.results import (
    Axis,
    AxisResults,
    SceneGrain,
    by_axis,
    grain_by_scene,
    keep_largest,
    lead_without_truth,
    notes_on,
    notes_without_truth,
    rule_of,
    spell_out_names,
    verdict_on,
    warnings_on,
)
from saf_gen.leaderboard.verification import CLAIMED, DIFFERS, RERUN_ELSEWHERE, RERUN_HERE, read_row_states
from saf_gen.stream.sample_dataset import find_data

WEIGHT_OF_STATE = (CLAIMED, RERUN_ELSEWHERE, RERUN_HERE, DIFFERS)
"""States in ascending order of weight. If evaluations give the same records several states, the last of these counts;
the state of a row is the first of its records' states, but differs if one of them does."""


@dataclass(frozen=True)
class Leaderboard(Sequence[LeaderboardRow]):
    """Methods in the order of their rank, with the evaluation from which the ranking was computed.

    A leaderboard is a sequence of rows: ``board[0].method`` is the first method. It is shown as the table of
    ``saf-gen evaluate``. Results beyond the rows are computed once, when they are first needed.
    """

    rows: tuple[LeaderboardRow, ...]
    """One row per method, best first."""
    evaluation: Evaluation
    outcomes: Outcomes
    """Outcomes of the methods of known success."""

    @classmethod
    def of(cls, evaluation: Evaluation) -> "Leaderboard":
        """Return the leaderboard of an evaluation; raises BadInput if its records cannot be compared."""
        by_method = group_by(merge_records({"": evaluation.records}), "who.method")
        outcomes = collect_outcomes(by_method)
        board = cls(rank(by_method, outcomes), evaluation, outcomes)
        if not (board.lacks_truth and board.answers):
            return board
        frames = {name: record.judgement.frame for name, record in board.answers.items()}
        return replace(board, rows=tuple(sorted(board.rows, key=lambda row: frames[row.method] or inf)))

    @property
    def records(self) -> tuple[Record, ...]:
        """One record per method and sequence."""
        return self.evaluation.records

    @cached_property
    def methods(self) -> list[str]:
        """Names of the methods, best first."""
        return [row.method for row in self.rows]

    @cached_property
    def ranking(self) -> Table:
        """The rows as a table."""
        return tables.ranking(self.rows, answers=self.answers, judged=not self.lacks_truth)

    @cached_property
    def lacks_truth(self) -> bool:
        """Whether no recording has a truth, so that nothing is judged."""
        return bool(self.records) and all(map(lacks_truth, self.records))

    @cached_property
    def answers(self) -> dict[str, Record]:
        """The record of each method, if all are of a single sequence; otherwise empty."""
        of_one = len({record.what.sequence for record in self.records}) == 1
        return {record.who.method: record for record in self.records} if of_one else {}

    @cached_property
    def agreements(self) -> list[Agreement]:
        """The answers of all measures on the recordings without a truth."""
        return find_agreements(self.records)

    @cached_property
    def agreement(self) -> Table:
        """These answers as a table."""
        return tables.agreement(self.agreements)

    @property
    def printed(self) -> Table:
        """The table for a terminal: the ranking or, if several recordings have no truth, where measures agree."""
        several = self.lacks_truth and not self.answers and self.agreements
        return self.agreement if several else self.ranking

    @cached_property
    def lead(self) -> list[str]:
        """Sentences with the verdict or, where nothing is judged, with the answer of all measures."""
        return lead_without_truth(self.agreements) if self.lacks_truth else [*filter(None, self.verdict)]

    @cached_property
    def axes(self) -> tuple[AxisResults, ...]:
        """Results by condition."""
        return by_axis(self.records, self.methods)

    @cached_property
    def conditions(self) -> list[tuple[Axis, Table]]:
        """Tables, for readers, of the axes along which sequences differ."""
        shown = [keep_largest(results) for results in self.axes if len(results.bins) > 1]
        return [(results.axis, tables.by_bin(results)) for results in shown]

    @cached_property
    def comparison(self) -> MethodComparison:
        """Profiles of the methods, and comparisons of neighbours in rank."""
        known = set(self.outcomes.methods)
        return compare_methods(self.outcomes.select({name: name for name in self.methods if name in known}))

    @cached_property
    def neighbours(self) -> Table:
        """The comparisons of neighbours as a table."""
        return tables.neighbours(self.comparison.neighbours)

    @cached_property
    def measures(self) -> Table:
        """Summaries of the focus curves of each measure as a table."""
        return tables.measures(self.evaluation.curves)

    @cached_property
    def grain(self) -> list[SceneGrain]:
        """Grain of each scene; empty if it is unknown."""
        return grain_by_scene(self.records)

    @cached_property
    def notes(self) -> list[str]:
        """Notes that a reader needs to interpret the numbers."""
        if self.lacks_truth:
            return notes_without_truth(self.records, self.agreements)
        return [*notes_on(self.records), *self.warnings]

    @cached_property
    def warnings(self) -> list[str]:
        """What is wrong with methods, recordings or machines."""
        doubts = contradicts_truth(self.records) if self.answers else []
        return [*doubts, *warnings_on(self.rows, self.records)]

    @cached_property
    def verdict(self) -> tuple[str, str]:
        """Whether the ranking is decided, and for whom; the first text may be empty."""
        return verdict_on(self.rows, self.records)

    @property
    def last_words(self) -> list[str]:
        """What a terminal shows below the table: what is wrong, and then the verdict and its rule."""
        if self.lacks_truth:
            return [*self.lead, *self.notes]
        return [*self.warnings, *self.lead, *rule_of(self.records)]

    @cached_property
    def names(self) -> dict[str, str]:
        """Words for each short name in the names of the methods."""
        return spell_out_names(self.methods)

    def __len__(self) -> int:
        return len(self.rows)

    @overload
    def __getitem__(self, index: int) -> LeaderboardRow: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[LeaderboardRow]: ...
    def __getitem__(self, index: int | slice) -> LeaderboardRow | Sequence[LeaderboardRow]:
        return self.rows[index]

    def __iter__(self) -> Iterator[LeaderboardRow]:
        return iter(self.rows)

    def __repr__(self) -> str:
        words = (fill(escape_controls(text), TEXT_WIDTH, break_on_hyphens=False) for text in self.last_words)
        return "\n".join([self.printed.to_text(), *words])

    def to_dicts(self) -> list[dict[str, object]]:
        """Return one dictionary per row with the keys of ``leaderboard.csv``; ``pandas.DataFrame`` accepts the list."""
        return self.ranking.to_dicts()

    @property
    def size(self) -> str:
        """Numbers of methods and sequences, as text."""
        return f"{plural(len(self.rows), 'method')}, {describe_size(self.records)}"

    def _repr_html_(self) -> str:
        """Return the table for a notebook, without the most detailed columns; tooltips explain the headings."""
        table = self.printed.up_to(tables.INTERVALS)
        shown = table.shown
        head = "".join(f'<th title="{escape(c.meaning)}">{escape(c.header)}</th>' for c in shown)
        body = "".join(
            "<tr>" + "".join(f'<td style="text-align: {c.justify}">{escape(c.text(row))}</td>' for c in shown) + "</tr>"
            for row in table.rows
        )
        caption = f"<caption>{self.size}</caption>"
        return f"<table>{caption}<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def read_leaderboard(*evaluations: str | Path) -> Leaderboard:
    """Rank the methods of one or several evaluations, as ``saf-gen leaderboard`` does, without writing files.

    Parameters
    ----------
    *evaluations : str or Path
        Folders that ``saf-gen evaluate`` wrote, or their ``records.jsonl``.

    Returns
    -------
    Leaderboard
        The rows, best first, and the merged records.

    Raises
    ------
    BadInput
        If no evaluation is given, if one cannot be read, or if evaluations differ in data, code or track.
    """
    if not evaluations:
        raise BadInput("no evaluation is named", hint='read_leaderboard("datasets/quickstart/evaluation")')
    runs = {str(one): read_records(Path(one)) for one in evaluations}
    states_in = {run: read_row_states(Path(run), group) for run, group in runs.items()}
    board = Leaderboard.of(Evaluation(tuple(merge_records(runs)), (), ()))
    if any(states_in.values()):
        states: dict[str, dict[str, str]] = {}  # of each record, by method and data
        for run, group in runs.items():
            for record in group:
                state, of_row = states_in[run].get(record.who.method, CLAIMED), states.setdefault(record.who.method, {})
                of_row[record.what.data] = max(state, of_row.get(record.what.data, state), key=WEIGHT_OF_STATE.index)
        rows = (replace(row, verified=_join_states(states[row.method].values())) for row in board)
        return replace(board, rows=tuple(rows))
    return board


def evaluate(
    dataset: str | Path,
    methods: Sequence[str | Callable[..., Any]] | None = None,
    *,
    split: str | None = None,
    region: str = "target",
    track: str = "recorded",
) -> Leaderboard:
    """Run methods on a dataset or a recording and rank them, as ``saf-gen evaluate`` does, without writing files.

    Parameters
    ----------
    dataset : str or Path
        Dataset folder or stream file; ``sample`` comes with saf_gen, and a name stands for a folder in ``datasets``.
    methods : sequence of str or callable, optional
        Names of methods, ``baselines`` for those that run by default, or functions of this process: a focus measure,
        which runs with the search ``argmax``, or a search, whose first parameter is ``view``, which runs with ``sd``.
    split : str, optional
        Split of the dataset, or ``all``; the default is ``test``, or the only split.
    region : str, default 'target'
        Where methods look, as for ``saf-gen evaluate``.
    track : str, default 'recorded'
        ``recorded``, or ``closed_loop`` with the default protocol.

    Returns
    -------
    Leaderboard
        The rows, best first; printed, it is the table.

    Raises
    ------
    BadInput
        If the dataset cannot be read, or if a method, split, region or track is unknown.
    """
    if track not in get_args(Track):
        raise unknown("track", track, allowed=get_args(Track))
    protocol = None
    if track == "closed_loop":
        from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol
        from saf_gen.optics.actuators import get_actuator

        protocol = ClosedLoopProtocol(get_actuator("voice_coil"))
    named = None if methods is None else [name if isinstance(name, str) else _add_function(name) for name in methods]
    result = run_methods(
        find_data(Path(dataset)),
        methods=named,
        split=split,
        region=region,
        protocol=protocol,
        draw=False,
        tell=partial(warn, stacklevel=2),
    )
    return Leaderboard.of(result)


def _add_function(function: Callable[..., Any]) -> str:
    """Register a measure or a search of this process, and return the name of a method with it."""
    name = getattr(function, "__name__", repr(function))
    if (isinstance(function, type) or isfunction(function)) and has_view_parameter(function):
        add_plugin("searches", function, name=name)
        return f"sd+{name}"
    add_plugin("measures", function, name=name)
    return f"{name}+argmax"


def _join_states(states: Collection[str]) -> str:
    return DIFFERS if DIFFERS in states else min(states, key=WEIGHT_OF_STATE.index)
