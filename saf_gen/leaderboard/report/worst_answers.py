"""The worst answers as a table, each with its line in records.jsonl; ``answers.js`` does it for a choice."""

from collections.abc import Sequence

from saf_gen.benchmark.records import RECORDS_FILE, Record
from saf_gen.leaderboard.report._html import HeaderCell, TableCell, format_table

__all__ = ["MAX_ANSWERS", "describe_answer_count", "format_answers"]

MAX_ANSWERS = 100
"""Rows of the table; of more answers the worst."""
HEADS = (
    HeaderCell("method", left=True),
    HeaderCell("sequence", left=True),
    HeaderCell("status", left=True),
    HeaderCell("answer"),
    HeaderCell("truth"),
    HeaderCell("error, DoF"),
    HeaderCell("blur px"),
    HeaderCell("record", f"The answer's line in {RECORDS_FILE}."),
    HeaderCell("note", left=True),
)


def format_answers(records: Sequence[Record]) -> str:
    """The table, the worst first: no answer before any, and then as the records come."""
    worst = sorted(range(len(records)), key=lambda place: (-_size(records[place]), place))
    return format_table(
        HEADS, [_row(records[at], at + 1) for at in worst[:MAX_ANSWERS]], caption="Single answers"
    )


def describe_answer_count(count: int) -> str:
    """How many of ``count`` answers the table has."""
    return (
        f"The {MAX_ANSWERS} worst of {count} answers."
        if count > MAX_ANSWERS
        else f"{count} answers, the worst first."
    )


def _size(record: Record) -> float:
    return float("inf") if record.error_dof is None else abs(record.error_dof)


def _row(record: Record, line: int) -> list[TableCell]:
    return [
        TableCell(record.method, kind="method"),
        TableCell(record.sequence, kind="method"),
        TableCell(record.status),
        _number(record.position, 4),
        _number(record.truth, 4),
        _number(record.error_dof, 2),
        _number(record.blur_px, 1),
        TableCell(f"line {line}", line, link=RECORDS_FILE),
        TableCell(record.note, kind="note"),
    ]


def _number(value: float | None, digits: int) -> TableCell:
    return TableCell("–", None) if value is None else TableCell(f"{value:.{digits}f}", value)
