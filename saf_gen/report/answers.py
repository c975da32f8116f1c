"""The worst answers as a table, each with its line in records.jsonl; ``answers.js`` does it for a choice."""

from collections.abc import Sequence

from saf_gen.records import FILE, Record
from saf_gen.report._html import Cell, Head, grid

__all__ = ["ANSWERS", "answers", "counted"]

ANSWERS = 100
"""Rows of the table; of more answers the worst."""
HEADS = (
    Head("method", left=True),
    Head("sequence", left=True),
    Head("status", left=True),
    Head("answer"),
    Head("truth"),
    Head("error, DoF"),
    Head("blur px"),
    Head("record", f"The answer's line in {FILE}."),
    Head("note", left=True),
)


def answers(records: Sequence[Record]) -> str:
    """The table, the worst first: no answer before any, and then as the records come."""
    worst = sorted(range(len(records)), key=lambda place: (-_size(records[place]), place))
    return grid(HEADS, [_row(records[at], at + 1) for at in worst[:ANSWERS]], caption="Single answers")


def counted(count: int) -> str:
    """How many of ``count`` answers the table has."""
    return (
        f"The {ANSWERS} worst of {count} answers."
        if count > ANSWERS
        else f"{count} answers, the worst first."
    )


def _size(record: Record) -> float:
    return float("inf") if record.error_dof is None else abs(record.error_dof)


def _row(record: Record, line: int) -> list[Cell]:
    return [
        Cell(record.method, kind="method"),
        Cell(record.sequence, kind="method"),
        Cell(record.status),
        _number(record.position, 4),
        _number(record.truth, 4),
        _number(record.error_dof, 2),
        _number(record.blur_px, 1),
        Cell(f"line {line}", line, link=FILE),
        Cell(record.note, kind="note"),
    ]


def _number(value: float | None, digits: int) -> Cell:
    return Cell("–", None) if value is None else Cell(f"{value:.{digits}f}", value)
