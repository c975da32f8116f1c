"""How often the answer of all measures is right, by how many of them agree: what a recording without a truth gets.

    python -m studies.ranking.answers_without_truth studies/results/saf_bench/box-records.xz

The records of the methods that run by default are taken, as if the truth were unknown; it then judges the answer.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from saf_gen.benchmark.method_spec import DEFAULT_RECORDED_METHODS
from saf_gen.benchmark.records import Record
from saf_gen.core.table import Table, percent
from saf_gen.errors import BadInput
from saf_gen.leaderboard.agreement import agree
from saf_gen.leaderboard.ranking import group_by
from studies.ranking.packed_records import read_packed_records

BINS = ((0.9, "90 % and more"), (0.7, "70 to 90 %"), (0.5, "50 to 70 %"), (0.0, "below"))
"""Least share of the measures that agree, and its name in the table."""


def count_right_answers(records: Sequence[Record]) -> dict[str, list[bool]]:
    """Return, by the share that agrees, whether the answer is within one depth of focus, on what has an answer."""
    right: dict[str, list[bool]] = {name: [] for _, name in BINS}
    answerable = [r for r in records if r.answerable and r.who.method in DEFAULT_RECORDED_METHODS]
    for group in group_by(answerable, "what.sequence").values():
        agreement = agree(group)
        if agreement.places:
            place, name = agreement.places[0], next(name for least, name in BINS if agreement.share >= least)
            answer = next(r for r in group if r.judgement.frame == place.frame)
            right[name].append(answer.success() is True)
    return right


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table, and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("records", type=Path, help="packed records of an evaluation")
    try:
        right = count_right_answers(read_packed_records(parser.parse_args(argv).records))
    except BadInput as error:
        print(error, file=sys.stderr)
        return 2
    rows = [(name, len(found), percent(sum(found) / len(found)) if found else "–") for name, found in right.items()]
    print(Table.of(("agreement", "recordings", "answers within one depth of focus"), rows).to_markdown())
    return 0


if __name__ == "__main__":
    sys.exit(main())
