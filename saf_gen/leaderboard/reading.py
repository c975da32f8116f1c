"""Reads evaluations back as one leaderboard, which shows itself in a notebook."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path
from typing import overload

from saf_gen.benchmark.records import Record, read_records
from saf_gen.errors import BadInput, escape_controls
from saf_gen.leaderboard.columns import ALL, list_leaderboard_columns, list_shown_leaderboard_columns
from saf_gen.leaderboard.merging import merge_leaderboard_records
from saf_gen.leaderboard.rank_agreement import RankAgreement, compare_rankings, name_regions_to_rank
from saf_gen.leaderboard.rows import LeaderboardRow, rank_methods
from saf_gen.leaderboard.verification import CLAIMED, DIFFERS, ELSEWHERE, HERE, read_leaderboard_row_states

WEIGHT_OF_STATE = (CLAIMED, ELSEWHERE, HERE, DIFFERS)
"""Of several verdicts on a row, which stand with the same answers in several evaluations, the last of these counts."""


@dataclass(frozen=True)
class Leaderboard(Sequence[LeaderboardRow]):
    """Methods in the order of their rank, and the records that it was found from.

    A sequence of rows: ``board[0].method`` is the first. The last line of a notebook's cell shows it as a table.
    """

    rows: tuple[LeaderboardRow, ...]
    """One row per method, best first."""
    records: tuple[Record, ...]
    """One answer per method and sequence."""

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
        """Return a dictionary per row with the keys of ``leaderboard.csv``, as ``pandas.DataFrame`` takes them."""
        columns = list_leaderboard_columns(self.rows)
        return [{column.key: column.value(row) for column in columns} for row in self.rows]

    @property
    def size(self) -> str:
        """The numbers of methods and sequences, in words."""
        return f"{len(self.rows)} methods, {len({record.sequence for record in self.records})} sequences"

    def _repr_html_(self) -> str:
        """Return the table for a notebook, without the most detailed columns; a heading explains itself when held."""
        shown = [column for column in list_shown_leaderboard_columns(self.rows) if column.detail < ALL]
        head = "".join(f'<th title="{escape(c.meaning)}">{escape(c.header)}</th>' for c in shown)
        body = "".join(
            "<tr>"
            + "".join(f'<td style="text-align: {c.justify}">{escape(c.format_value(row))}</td>' for c in shown)
            + "</tr>"
            for row in self.rows
        )
        caption = f"<caption>{self.size}</caption>"
        return f"<table>{caption}<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def read_rank_agreement(*evaluations: str | Path, by: str | None = None) -> list[RankAgreement]:
    """Compare the rankings of one or several evaluations under different conditions; nothing is written.

    Evaluations may differ in the region where methods look, and in the sensor of their datasets.

    Parameters
    ----------
    evaluations : folders that ``saf-gen evaluate`` wrote, or their ``records.jsonl``.
    by : a condition, such as ``sensor``, ``region`` or ``grain``; all by default.

    Returns
    -------
    list of RankAgreement : one for each pair of bins of a condition.

    Raises
    ------
    BadInput : no such condition, an evaluation that cannot be read, or several whose data, code or track differ.
    """
    runs = {str(one): read_records(Path(one)) for one in evaluations}
    named = iter(name_regions_to_rank([record for own in runs.values() for record in own]))
    runs = {run: [next(named) for _ in own] for run, own in runs.items()}
    return compare_rankings(merge_leaderboard_records(runs), by=by)


def read_leaderboard(*evaluations: str | Path) -> Leaderboard:
    """Rank the methods of one or several evaluations, as ``saf-gen leaderboard`` does; nothing is written.

    Parameters
    ----------
    evaluations : folders that ``saf-gen evaluate`` wrote, or their ``records.jsonl``.

    Returns
    -------
    Leaderboard

    Raises
    ------
    BadInput : no evaluation, one that cannot be read, or several whose data, code or track differ.
    """
    if not evaluations:
        raise BadInput("no evaluation is named", hint='read_leaderboard("datasets/quickstart/evaluation")')
    runs = {str(one): read_records(Path(one)) for one in evaluations}
    states: dict[str, str] = {}
    for run, own in runs.items():
        for method, state in read_leaderboard_row_states(Path(run), own).items():
            states[method] = max(state, states.get(method, state), key=WEIGHT_OF_STATE.index)
    records = merge_leaderboard_records(runs)
    rows = rank_methods(records)
    if states:
        rows = tuple(replace(row, verified=states.get(row.method, CLAIMED)) for row in rows)
    return Leaderboard(rows, tuple(records))
