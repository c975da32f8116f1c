"""How many scenes tell two methods apart: draws smaller benchmarks from the records of a large one.

Each drawn benchmark has some of the scenes of an evaluation, without repetition, with all their lights, and is ranked
as a benchmark of its own. Printed for each number of scenes and each method: how often the method is told apart from a
better one, and the mean half width of the interval of its difference to the best.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from saf_gen.benchmark.records import Record, read_records
from saf_gen.core.table import Column, Table, percent
from saf_gen.errors import BadInput
from saf_gen.leaderboard import rank_methods
from saf_gen.leaderboard.ranking import LeaderboardRow
from studies.ranking.packed_records import read_packed_records

COUNTS = 5, 10, 20, 40, 80, 120, 240
DRAWS, SEED = 40, 1
METHODS = (
    "fine_structure+bell_vote",
    "fine_structure+argmax_light",
    "octave_structure+argmax:window=300",
    "vollath_f4_n+argmax:window=300",
    "gradient_code_n+egs_code",
    "sd_code+egs_code",
    "sd+sgfs_causal",
    "er_sumsq+argmax",
)
"""The best of saf_bench, and methods that are behind it by 3 to 68 points."""


def draw_tables(records: Sequence[Record], count: int, *, draws: int, seed: int = SEED) -> list[list[LeaderboardRow]]:
    """Return the rankings of ``draws`` benchmarks of ``count`` scenes of the records."""
    scenes = sorted({record.what.scene for record in records})
    random = np.random.default_rng(seed)
    tables = []
    for _ in range(draws if count < len(scenes) else 1):
        chosen = {scenes[number] for number in random.choice(len(scenes), min(count, len(scenes)), replace=False)}
        drawn = [record for record in records if record.what.scene in chosen]
        tables.append(list(rank_methods(drawn)))
    return tables


def summarise(records: Sequence[Record], counts: Sequence[int], *, draws: int) -> Table:
    """Return one row for each method but the first: its gap and, for each number of scenes, how it is told apart."""
    whole = {row.method: row.answerable_1dof or 0.0 for row in rank_methods(records)}
    best = max(whole, key=lambda method: whole[method])
    tables = {count: draw_tables(records, count, draws=draws) for count in counts}

    def cell(method: str, count: int) -> str:
        found = [next(row for row in rows if row.method == method) for rows in tables[count]]
        apart = np.mean([not row.level_with_best for row in found])
        widths = [
            (row.behind_best_high - row.behind_best_low) / 2
            for row in found
            if row.behind_best_low is not None and row.behind_best_high is not None
        ]
        return f"{percent(float(apart))} (±{100 * np.mean(widths):.0f})" if widths else percent(float(apart))

    columns = [
        Column("method", str, kind="name"),
        Column("behind, points", lambda method: f"{100 * (whole[best] - whole[method]):.0f}", kind="number"),
        *(Column(f"{n} scenes", str, cell=lambda method, n=n: cell(method, n), kind="number") for n in counts),  # type: ignore[misc]
    ]
    return Table(columns, [method for method in sorted(whole, key=whole.__getitem__, reverse=True) if method != best])


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table, and return the exit code."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("records", type=Path, help="records.jsonl, or packed records, .xz")
    options.add_argument("--draws", type=int, default=DRAWS, help=f"benchmarks of each size (default: {DRAWS})")
    given = options.parse_args(argv)
    packed = given.records.suffix == ".xz"
    try:
        held = read_packed_records(given.records) if packed else read_records(given.records)
    except BadInput as error:
        print(error, file=sys.stderr)
        return 2
    records = [record for record in held if record.who.method in METHODS]
    print(summarise(records, COUNTS, draws=given.draws).to_markdown())
    return 0


if __name__ == "__main__":
    sys.exit(main())
