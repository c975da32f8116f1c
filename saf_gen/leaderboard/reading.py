"""Reading of evaluations as one leaderboard, which a notebook shows as a table."""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path
from typing import overload

from saf_gen.benchmark.records import Record, read_records
from saf_gen.core.plain_text import plural
from saf_gen.errors import BadInput, escape_controls
from saf_gen.leaderboard.merging import merge_records
from saf_gen.leaderboard.outcomes import describe_size
from saf_gen.leaderboard.ranking import LeaderboardRow, rank_methods
from saf_gen.leaderboard.tables import INTERVALS, ranking
from saf_gen.leaderboard.verification import CLAIMED, DIFFERS, RERUN_ELSEWHERE, RERUN_HERE, read_row_states

WEIGHT_OF_STATE = (CLAIMED, RERUN_ELSEWHERE, RERUN_HERE, DIFFERS)
"""States in ascending order of weight. If evaluations give the same records several states, the last of these counts;
the state of a row is the first of its records' states, but differs if one of them does."""


@dataclass(frozen=True)
class Leaderboard(Sequence[LeaderboardRow]):
    """Methods in the order of their rank, with the records from which the ranking was computed.

    A leaderboard is a sequence of rows: ``board[0].method`` is the first method. As the last line of a notebook cell it
    is shown as a table.
    """

    rows: tuple[LeaderboardRow, ...]
    """One row per method, best first."""
    records: tuple[Record, ...]
    """One record per method and sequence."""

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
        return ranking(self.rows).to_dicts()

    @property
    def size(self) -> str:
        """Numbers of methods and sequences, as text."""
        return f"{plural(len(self.rows), 'method')}, {describe_size(self.records)}"

    def _repr_html_(self) -> str:
        """Return the table for a notebook, without the most detailed columns; tooltips explain the headings."""
        shown = ranking(self.rows).up_to(INTERVALS).shown
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
    records = merge_records(runs)
    rows = rank_methods(records)
    if any(states_in.values()):
        states: dict[str, dict[str, str]] = {}  # of each record, by method and data
        for run, group in runs.items():
            for record in group:
                state, of_row = states_in[run].get(record.method, CLAIMED), states.setdefault(record.method, {})
                of_row[record.data] = max(state, of_row.get(record.data, state), key=WEIGHT_OF_STATE.index)
        rows = tuple(replace(row, verified=_join_states(states[row.method].values())) for row in rows)
    return Leaderboard(rows, tuple(records))


def _join_states(states: Collection[str]) -> str:
    return DIFFERS if DIFFERS in states else min(states, key=WEIGHT_OF_STATE.index)
