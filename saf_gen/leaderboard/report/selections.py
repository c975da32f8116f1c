"""The groups of sequences that a reader of the page can choose, each with its leaderboard."""

from collections.abc import Sequence
from dataclasses import dataclass

from saf_gen.benchmark.records import Record
from saf_gen.leaderboard import (
    AXES,
    Axis,
    LeaderboardRow,
    group_by_leaderboard_bin,
    list_leaderboard_bins,
    rank_methods,
)

SPLIT = Axis("split", "Split", "Split of the dataset.", lambda r: r.split)


@dataclass(frozen=True)
class Selection:
    """The sequences in one bin of an axis, and the methods ranked on them alone."""

    axis: str
    name: str
    sequences: tuple[str, ...]
    rows: tuple[LeaderboardRow, ...]


def list_report_selections(records: Sequence[Record]) -> list[Selection]:
    """Return one selection for each bin of each axis along which sequences differ.

    If an axis has many bins, only the largest get a selection (see list_leaderboard_bins). Selections of the same
    sequences have the same rows.
    """
    ranked: dict[tuple[str, ...], tuple[LeaderboardRow, ...]] = {}
    selections = []
    for axis in (SPLIT, *AXES):
        bins = group_by_leaderboard_bin(records, axis)
        members = {name: tuple(dict.fromkeys(r.sequence for r in group)) for name, group in bins.items()}
        for name in (
            list_leaderboard_bins({name: len(group) for name, group in members.items()}) if len(bins) > 1 else ()
        ):
            sequences = members[name]
            if sequences not in ranked:
                ranked[sequences] = rank_methods(bins[name])
            selections.append(Selection(axis.title, name, sequences, ranked[sequences]))
    return selections
