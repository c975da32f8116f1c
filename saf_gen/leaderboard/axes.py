"""Tables by condition: how methods do under each light, motion, photon budget, place of the focus.

What sorts a sequence is a property of the sequence alone, so that all methods meet the same ones in a bin.
"""

from bisect import bisect_right
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from saf_gen.benchmark.judgement import SUCCESS_LIMITS_DOF
from saf_gen.benchmark.records import Record
from saf_gen.leaderboard.averages import mean_over_scenes, median_magnitude

__all__ = ["AXES", "Axis", "AxisTable", "BinSummary", "group_by_bin", "tabulate_by_axis"]

BLOCK_READOUTS = 100
"""Readouts of the block that the photon budget is told for: the default of argmax."""


@dataclass(frozen=True)
class Axis:
    """What sequences are sorted by. ``bin_of`` names the bin of a record, None where it is unknown."""

    name: str
    title: str
    meaning: str
    bin_of: Callable[[Record], str | None]
    order: tuple[str, ...] = ()
    """Of the bins; without, that of their names."""


@dataclass(frozen=True)
class BinSummary:
    """One method in one bin. None is unknown."""

    success_1dof: float | None
    median_error_dof: float | None
    abstained: int
    failed: int


@dataclass(frozen=True)
class AxisTable:
    """All methods on one axis: cells by method, one for each bin."""

    axis: Axis
    bins: tuple[str, ...]
    scenes: tuple[int, ...]
    sequences: tuple[int, ...]
    cells: Mapping[str, tuple[BinSummary, ...]]


def tabulate_by_axis(records: Sequence[Record], methods: Sequence[str]) -> tuple[AxisTable, ...]:
    """A table for each of AXES that is known of some sequence, methods in the order given."""
    tables = (_tabulate(axis, records, methods) for axis in AXES)
    return tuple(table for table in tables if table.bins)


def group_by_bin(records: Sequence[Record], axis: Axis) -> dict[str, list[Record]]:
    """Return the records of each bin, bins in the axis's order; records of unknown bin are left out."""
    members: dict[str, list[Record]] = {}
    for record in records:
        if (name := axis.bin_of(record)) is not None:
            members.setdefault(name, []).append(record)
    return {name: members[name] for name in axis.order or sorted(members) if name in members}


def _tabulate(axis: Axis, records: Sequence[Record], methods: Sequence[str]) -> AxisTable:
    bins = group_by_bin(records, axis)
    return AxisTable(
        axis,
        tuple(bins),
        scenes=tuple(len({r.scene for r in members}) for members in bins.values()),
        sequences=tuple(len({r.sequence for r in members}) for members in bins.values()),
        cells={
            method: tuple(_summarise([r for r in members if r.method == method]) for members in bins.values())
            for method in methods
        },
    )


def _summarise(records: Sequence[Record]) -> BinSummary:
    return BinSummary(
        mean_over_scenes(records, lambda r: r.success_1dof),
        median_magnitude(r.error_dof for r in records),
        abstained=sum(r.status == "abstained" for r in records),
        failed=sum(r.status == "failed" for r in records),
    )


def _binned(
    value: Callable[[Record], float | None], edges: Sequence[float], names: Sequence[str]
) -> Callable[[Record], str | None]:
    """The bin between two edges that the value lies in; a value at an edge is in the bin above it."""

    def name(record: Record) -> str | None:
        held = value(record)
        return None if held is None else names[bisect_right(edges, held)]

    return name


def _budget(record: Record) -> float | None:
    return None if record.mean_rate is None else BLOCK_READOUTS * record.mean_rate


def _place(record: Record) -> str | None:
    place, off = record.focus_place, record.focus_off_dof
    if off is not None and off > SUCCESS_LIMITS_DOF[1]:
        return _PLACES[3]
    if place is None:
        return None
    return _PLACES[0] if place < 0.1 else _PLACES[2] if place > 0.9 else _PLACES[1]


_BUDGETS = ("below 1", "1 to 3", "3 to 10", "10 to 30", "30 and more")
_RATIOS = ("up to 1.1", "1.1 to 2", "2 to 5", "5 and more")
_PLACES = ("first 10 %", "middle", "last 10 %", "outside")
AXES = (
    Axis("light", "Light schedule", "As the recipe names it.", lambda r: r.light),
    Axis(
        "light_ratio",
        "Light ratio",
        "Brightest over darkest light of the recording.",
        _binned(lambda r: r.light_ratio, (1.1, 2, 5), _RATIOS),
        _RATIOS,
    ),
    Axis("scene_motion", "Scene motion", "Whether anything in the scene moves.", lambda r: r.scene_motion),
    Axis("lens_motion", "Lens motion", "How the lens moved in the recording.", lambda r: r.lens_motion),
    Axis(
        "photon_budget",
        "Photon budget",
        f"Mean counts a pixel in a block of {BLOCK_READOUTS} readouts, where measures look.",
        _binned(_budget, (1, 3, 10, 30), _BUDGETS),
        _BUDGETS,
    ),
    Axis(
        "focus_position",
        "Focus position",
        "Where in the recording, in the closed loop in the travel, the lens first meets the true focus; "
        "outside, it never comes within 1 DoF.",
        _place,
        _PLACES,
    ),
    Axis("scene", "Scene", "Each scene alone.", lambda r: r.scene),
)
