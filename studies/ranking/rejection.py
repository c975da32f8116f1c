"""Rejection as a curve: false answers against false abstentions, if answers of little confidence are withdrawn.

    python -m studies.ranking.rejection EVALUATION

Methods abstain at one point each, and a right to abstain is worth little if it is bought with right answers. A curve
compares methods at the same price: for each threshold, answers whose confidence is below it count as abstentions. The
one figure of a method is its false answers at 2 % false abstentions. A record states a confidence if its note contains
``confidence NUMBER``, of any range, where larger is surer. Without it, a method has one point and no curve. Printed for
the ten best methods; rates are averaged as in the leaderboard.
"""

import argparse
import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf, isfinite
from pathlib import Path

from saf_gen.benchmark.records import Record, read_records
from saf_gen.core.table import UNKNOWN, Column, Table
from saf_gen.errors import BadInput
from saf_gen.leaderboard import rank_methods
from saf_gen.leaderboard.ranking import group_by, mean_over_scenes

BEST = 10
FALSE_ABSTENTIONS = 0.02
"""Rate of false abstentions at which methods are compared."""
STATED = re.compile(r"\bconfidence ([-+]?[0-9.]+(?:e[-+]?[0-9]+)?)\b", re.IGNORECASE)


@dataclass(frozen=True)
class Point:
    """A point of the curve: the threshold, below which an answer is withdrawn, and both rates, 0 to 1."""

    threshold: float
    false_abstentions: float
    false_answers: float


def stated_confidence(record: Record) -> float | None:
    """Return the confidence in the note of a record, None if it states none that is finite."""
    found = STATED.search(record.judgement.note)
    try:
        value = float(found[1]) if found else inf
    except ValueError:
        return None
    return value if isfinite(value) else None


def point_at(records: Sequence[Record], confidence: Callable[[Record], float | None], threshold: float) -> Point | None:
    """Return the rates of one method at a threshold; None unless there are sequences with an answer and without.

    Failures are no answers. An answer without a confidence is withdrawn at no threshold.
    """

    def rate(of_answerable: bool) -> float | None:
        def value(record: Record) -> float | None:
            if record.answerable is not of_answerable:
                return None
            sure = confidence(record)
            answers = record.judgement.status == "answered" and (sure is None or sure >= threshold)
            return float(answers is not of_answerable)

        return mean_over_scenes(records, value)

    abstains, answers = rate(True), rate(False)
    return None if abstains is None or answers is None else Point(threshold, abstains, answers)


def rejection_curve(
    records: Sequence[Record], confidence: Callable[[Record], float | None] = stated_confidence
) -> list[Point]:
    """Return the curve of one method, from no answer withdrawn to all.

    Parameters
    ----------
    records : sequence of Record
        Records of one method.
    confidence : callable, optional
        Returns the confidence of a record in its answer, larger for a surer one; None if there is none.

    Returns
    -------
    list of Point
        False abstentions rise from point to point, and false answers fall. A single point if no answer has a
        confidence; empty if all sequences have an answer, or none has.
    """
    stated = (confidence(r) for r in records if r.judgement.status == "answered")
    known = sorted({value for value in stated if value is not None})
    thresholds = [-inf, *known, inf] if known else [-inf]
    points = (point_at(records, confidence, threshold) for threshold in thresholds)
    return [point for point in points if point is not None]


def false_answers_at(curve: Sequence[Point], rate: float = FALSE_ABSTENTIONS) -> float | None:
    """Return the fewest false answers with at most ``rate`` false abstentions; None if there is no curve so low."""
    affordable = [point.false_answers for point in curve if point.false_abstentions <= rate]
    return min(affordable) if affordable and len(curve) > 1 else None


def rejection_table(records: Sequence[Record]) -> Table:
    """Return the rates of the best methods as they are, and their one figure."""
    of_method = group_by(records, "who.method")
    best = [row.method for row in rank_methods(records) if row.rank is not None][:BEST]
    curves = {method: rejection_curve(of_method[method]) for method in best}

    def text(value: float | None) -> str:
        return UNKNOWN if value is None else f"{value:.1%}".replace("%", " %")

    def first(name: str) -> Callable[[str], str]:
        return lambda method: text(getattr(curves[method][0], name) if curves[method] else None)

    columns = (
        Column("method", str),
        Column("false abstentions", first("false_abstentions")),
        Column("false answers", first("false_answers")),
        Column("false answers at 2 %", lambda method: text(false_answers_at(curves[method]))),
    )
    return Table(columns, best, "Rejection")


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table of an evaluation, and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("evaluation", type=Path, help="folder of an evaluation, or its records.jsonl")
    try:
        table = rejection_table(read_records(parser.parse_args(argv).evaluation))
    except BadInput as error:
        print(error, file=sys.stderr)
        return 2
    print(table.to_markdown(), end="")
    return 0


if __name__ == "__main__":
    sys.exit(main())
