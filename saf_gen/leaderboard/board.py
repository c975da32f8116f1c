"""A leaderboard: ranked methods, and everything that tables and pages say of them, each computed when first needed."""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from html import escape
from pathlib import Path
from typing import overload

from saf_gen.benchmark.records import Record, read_records
from saf_gen.benchmark.results import Evaluation
from saf_gen.core.plain_text import plural
from saf_gen.core.table import Table
from saf_gen.errors import BadInput, escape_controls
from saf_gen.leaderboard import tables
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
    notes_on,
    spell_out_names,
)
from saf_gen.leaderboard.verification import CLAIMED, DIFFERS, RERUN_ELSEWHERE, RERUN_HERE, read_row_states

WEIGHT_OF_STATE = (CLAIMED, RERUN_ELSEWHERE, RERUN_HERE, DIFFERS)
"""States in ascending order of weight. If evaluations give the same records several states, the last of these counts;
the state of a row is the first of its records' states, but differs if one of them does."""


@dataclass(frozen=True)
class Leaderboard(Sequence[LeaderboardRow]):
    """Methods in the order of their rank, with the evaluation from which the ranking was computed.

    A leaderboard is a sequence of rows: ``board[0].method`` is the first method. As the last line of a notebook cell it
    is shown as a table. Results beyond the rows are computed once, when they are first needed.
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
        return cls(rank(by_method, outcomes), evaluation, outcomes)

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
        return tables.ranking(self.rows)

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
        return notes_on(self.rows, self.records)

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
        first = ", ".join(row.method for row in self.rows if row.rank == 1)
        return escape_controls(f"<Leaderboard: {self.size}; first: {first}>")

    def to_dicts(self) -> list[dict[str, object]]:
        """Return one dictionary per row with the keys of ``leaderboard.csv``; ``pandas.DataFrame`` accepts the list."""
        return self.ranking.to_dicts()

    @property
    def size(self) -> str:
        """Numbers of methods and sequences, as text."""
        return f"{plural(len(self.rows), 'method')}, {describe_size(self.records)}"

    def _repr_html_(self) -> str:
        """Return the table for a notebook, without the most detailed columns; tooltips explain the headings."""
        shown = self.ranking.up_to(tables.INTERVALS).shown
        head = "".join(f'<th title="{escape(c.meaning)}">{escape(c.header)}</th>' for c in shown)
        body = "".join(
            "<tr>" + "".join(f'<td style="text-align: {c.justify}">{escape(c.text(row))}</td>' for c in shown) + "</tr>"
            for row in self.rows
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


def _join_states(states: Collection[str]) -> str:
    return DIFFERS if DIFFERS in states else min(states, key=WEIGHT_OF_STATE.index)
