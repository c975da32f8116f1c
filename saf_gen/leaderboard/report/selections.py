"""The groups of sequences that a reader of the page can choose, with the leaderboard of each."""

from collections.abc import Sequence
from dataclasses import dataclass

from saf_gen.benchmark.records import Record
from saf_gen.leaderboard import AXES, Axis, LeaderboardRow, group_by_bin, rank_methods

SPLIT = Axis("split", "Split", "Split of the dataset.", lambda r: r.split)


@dataclass(frozen=True)
class Selection:
    """The sequences in one bin of an axis, and the methods ranked on them alone."""

    axis: str
    name: str
    sequences: tuple[str, ...]
    rows: tuple[LeaderboardRow, ...]


def list_page_selections(records: Sequence[Record]) -> list[Selection]:
    """Return a selection for each bin of each axis along which the sequences differ, axis by axis.

    Selections of the same sequences have the same rows.
    """
    ranked: dict[tuple[str, ...], tuple[LeaderboardRow, ...]] = {}
    selections = []
    for axis in (SPLIT, *AXES):
        bins = group_by_bin(records, axis)
        for name, members in bins.items() if len(bins) > 1 else ():
            sequences = tuple(dict.fromkeys(r.sequence for r in members))
            if sequences not in ranked:
                ranked[sequences] = rank_methods(members)
            selections.append(Selection(axis.title, name, sequences, ranked[sequences]))
    return selections
