"""Show how much the ranking of methods depends on a condition: Kendall's τ between its bins, with intervals.

    python -m studies.ranking.agreement EVALUATION... [--by sensor]

Several evaluations may differ in the sensor of their datasets and in the region where methods look.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from saf_gen.benchmark.records import Record, read_records
from saf_gen.core.region import REGIONS
from saf_gen.core.table import UNKNOWN, Column, Table
from saf_gen.errors import BadInput, unknown
from saf_gen.leaderboard.merging import merge_records
from studies.ranking.rank_agreement import CONDITIONS, RankAgreement, compare_rankings

NOTE = (
    "τ is 1 if both rankings order the methods alike. By chance: the τ to expect if the condition had no effect."
    " p: the probability that τ would then be as low, for this pair alone."
)


def agreement(evaluations: Sequence[Path], *, by: str | None = None) -> list[RankAgreement]:
    """Return the agreement of the rankings of evaluations under each pair of bins of a condition, or of all conditions.

    Raises BadInput if there is no such condition, if an evaluation cannot be read, or if evaluations differ in data,
    code or track.
    """
    names = [axis.name for axis in CONDITIONS]
    if by is not None and by not in names:
        raise unknown("condition", by, allowed=names)
    runs = {str(one): read_records(one) for one in evaluations}
    named = iter(_name_regions([record for group in runs.values() for record in group]))
    merged = merge_records({run: [next(named) for _ in group] for run, group in runs.items()})
    return [one for one in compare_rankings(merged) if by in (None, one.condition)]


def _name_regions(records: Sequence[Record]) -> list[Record]:
    """Return the records with ``@REGION`` appended to each method name without a region, if regions differ.

    Evaluations of one dataset with different ``--region`` can then be compared in one table.
    """
    named = tuple(f"@{region}" for region in REGIONS)
    if len({r.who.region for r in records if not r.who.method.endswith(named)}) < 2:
        return list(records)
    return [
        r if r.who.method.endswith(named) else replace(r, who=replace(r.who, method=f"{r.who.method}@{r.who.region}"))
        for r in records
    ]


def agreement_table(found: Sequence[RankAgreement]) -> Table:
    """Return the table of agreements."""
    columns = (
        Column("condition", "condition", lambda name: name.replace("_", " ")),
        Column("first", "first"),
        Column("second", "second"),
        Column("methods", "methods", kind="number"),
        Column("scenes", "scenes", cell=_format_scenes, kind="number"),
        Column("τ", "tau", ".2f", kind="number"),
        Column("95 %", "low", cell=_format_interval, kind="number"),
        Column("by chance", "by_chance", ".2f", kind="number"),
        Column("p", "p_value", ".3f", kind="number"),
        Column("most moved", "most_moved", cell=_format_most_moved),
    )
    return Table(columns, found, "Agreement of ranks under two conditions")


def _format_scenes(one: RankAgreement) -> str:
    return str(one.scenes) if one.shared == one.scenes else f"{one.scenes} ({one.shared} in both)"


def _format_interval(one: RankAgreement) -> str:
    return UNKNOWN if one.low is None or one.high is None else f"{one.low:.2f} to {one.high:.2f}"


def _format_most_moved(one: RankAgreement) -> str:
    name, before, after = one.most_moved
    return "none" if before == after else f"{name}: {before} to {after}"


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table, and return the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("evaluations", nargs="+", type=Path, help="evaluation folders, or their records.jsonl")
    parser.add_argument("--by", help="one condition, such as sensor, region or grain (default: all)")
    given = parser.parse_args(argv)
    try:
        found = agreement(given.evaluations, by=given.by)
    except BadInput as error:
        print(error, file=sys.stderr)
        return 2
    if not found:
        print("nothing to compare: one bin, or fewer than three methods have answers under two bins", file=sys.stderr)
        return 1
    print(agreement_table(found).to_markdown())
    print(NOTE)
    return 0


if __name__ == "__main__":
    sys.exit(main())
