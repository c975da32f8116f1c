"""Tables by condition: results under each light, motion, photon budget, focus position, grain, sensor and scene.

The bin of a sequence depends only on the sequence, so all methods have the same sequences in a bin.
"""

from bisect import bisect_right
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from saf_gen.benchmark.judgement import SUCCESS_LIMITS_DOF
from saf_gen.benchmark.records import Record
from saf_gen.leaderboard.averages import mean_over_scenes_for_ranking, median_magnitude_for_ranking

MAX_SHOWN_BINS = 40
"""Largest number of bins of an axis, such as scenes, in tables for readers."""
BLOCK_READOUTS = 100
"""Number of readouts over which the photon budget is counted: the default window of argmax."""


@dataclass(frozen=True)
class Axis:
    """A property that sorts sequences into bins; ``bin_of`` returns the bin of a record, None if unknown."""

    name: str
    title: str
    meaning: str
    bin_of: Callable[[Record], str | None]
    order: tuple[str, ...] = ()
    """Names of the bins in order; if empty, bins are sorted by name."""


@dataclass(frozen=True)
class BinSummary:
    """Result of one method in one bin; None means unknown."""

    success_1dof: float | None
    median_error_dof: float | None
    abstained: int
    failed: int


@dataclass(frozen=True)
class AxisTable:
    """Results along one axis: the numbers of scenes and sequences in each bin, and one cell per method and bin."""

    axis: Axis
    bins: tuple[str, ...]
    scenes: tuple[int, ...]
    sequences: tuple[int, ...]
    cells: Mapping[str, tuple[BinSummary, ...]]


def tabulate_leaderboard_by_axis(records: Sequence[Record], methods: Sequence[str]) -> tuple[AxisTable, ...]:
    """Return one table per axis for which the bin of at least one sequence is known; methods keep their order."""
    return tuple(table for table in (_tabulate(axis, records, methods=methods) for axis in AXES) if table.bins)


def list_leaderboard_bins(sequences: Mapping[str, int]) -> list[str]:
    """Return the MAX_SHOWN_BINS bins with the most sequences, in their original order; if there are fewer, all.

    ``sequences`` gives the number of sequences of each bin.
    """
    shown = sorted(sequences, key=lambda name: -sequences[name])[:MAX_SHOWN_BINS]
    return [name for name in sequences if name in shown]


def keep_leaderboard_bins(table: AxisTable) -> AxisTable:
    """Return the table reduced to list_leaderboard_bins; the meaning of its axis says if bins are left out."""
    shown = set(list_leaderboard_bins(dict(zip(table.bins, table.sequences, strict=True))))
    if len(shown) == len(table.bins):
        return table
    note = f"Shown: the {len(shown)} of {len(table.bins):,} bins with the most sequences; axes.csv has all."

    def keep(values: Sequence[Any]) -> tuple[Any, ...]:
        return tuple(value for name, value in zip(table.bins, values, strict=True) if name in shown)

    return AxisTable(
        replace(table.axis, meaning=f"{table.axis.meaning} {note}"),
        keep(table.bins),
        scenes=keep(table.scenes),
        sequences=keep(table.sequences),
        cells={method: keep(cells) for method, cells in table.cells.items()},
    )


def group_by_leaderboard_bin(records: Sequence[Record], axis: Axis) -> dict[str, list[Record]]:
    """Return the records of each bin, in the order of the axis; records whose bin is unknown are left out."""
    members: dict[str, list[Record]] = {}
    for record in records:
        if (name := axis.bin_of(record)) is not None:
            members.setdefault(name, []).append(record)
    return {name: members[name] for name in axis.order or sorted(members) if name in members}


def _tabulate(axis: Axis, records: Sequence[Record], *, methods: Sequence[str]) -> AxisTable:
    bins = group_by_leaderboard_bin(records, axis)
    by_method: dict[str, dict[str, list[Record]]] = {name: {} for name in bins}
    for name, members in bins.items():
        for record in members:
            by_method[name].setdefault(record.method, []).append(record)
    return AxisTable(
        axis,
        tuple(bins),
        scenes=tuple(len({r.scene for r in members}) for members in bins.values()),
        sequences=tuple(len({r.sequence for r in members}) for members in bins.values()),
        cells={method: tuple(_summarise(by_method[name].get(method, [])) for name in bins) for method in methods},
    )


def _summarise(records: Sequence[Record]) -> BinSummary:
    return BinSummary(
        mean_over_scenes_for_ranking(records, lambda r: r.success_1dof),
        median_magnitude_for_ranking(r.error_dof for r in records),
        abstained=sum(r.status == "abstained" for r in records),
        failed=sum(r.status == "failed" for r in records),
    )


def _bin_between(
    edges: Sequence[float], names: Sequence[str], *, value: Callable[[Record], float | None]
) -> Callable[[Record], str | None]:
    """Return a function that names the bin of a record's value; a value on an edge belongs to the bin above."""

    def name_bin(record: Record) -> str | None:
        number = value(record)
        return None if number is None else names[bisect_right(edges, number)]

    return name_bin


def _photon_budget(record: Record) -> float | None:
    return None if record.mean_rate is None else BLOCK_READOUTS * record.mean_rate


def _focus_position(record: Record) -> str | None:
    position, distance = record.focus_place, record.focus_off_dof
    if distance is not None and distance > SUCCESS_LIMITS_DOF[1]:
        return _POSITIONS[3]
    if position is None:
        return None
    return _POSITIONS[0] if position < 0.1 else _POSITIONS[2] if position > 0.9 else _POSITIONS[1]


_BUDGETS = ("below 1", "1 to 3", "3 to 10", "10 to 30", "30 and more")
_RATIOS = ("up to 1.1", "1.1 to 2", "2 to 5", "5 and more")
_POSITIONS = ("first 10 %", "middle", "last 10 %", "outside")
_GRAINS = ("below 1 %", "1 to 2 %", "2 to 4 %", "4 % and more")
AXES = (
    Axis("light", "Light schedule", "Name of the light schedule in the recipe.", lambda r: r.light),
    Axis(
        "light_ratio",
        "Light ratio",
        "Brightest light of the recording divided by its darkest.",
        _bin_between((1.1, 2, 5), _RATIOS, value=lambda r: r.light_ratio),
        _RATIOS,
    ),
    Axis("scene_motion", "Scene motion", "Whether anything in the scene moves.", lambda r: r.scene_motion),
    Axis("lens_motion", "Lens motion", "Motion of the lens in the recording.", lambda r: r.lens_motion),
    Axis(
        "photon_budget",
        "Photon budget",
        f"Mean counts per pixel in a block of {BLOCK_READOUTS} readouts, in the region where measures look.",
        _bin_between((1, 3, 10, 30), _BUDGETS, value=_photon_budget),
        _BUDGETS,
    ),
    Axis(
        "focus_position",
        "Focus position",
        "Part of the recording (closed loop: of the travel) in which the lens first meets the true focus, or "
        "comes nearest to it; outside: the lens never comes within 1 DoF.",
        _focus_position,
        _POSITIONS,
    ),
    Axis(
        "grain",
        "Grain",
        "Noise of the renderer in the pictures: rms divided by the mean, in the box around the target, at best focus.",
        _bin_between((0.01, 0.02, 0.04), _GRAINS, value=lambda r: r.grain_rms),
        _GRAINS,
    ),
    Axis(
        "sensor",
        "Sensor",
        "Name of the sensor, followed by # and six digits if its parameters were changed.",
        lambda r: r.sensor,
    ),
    Axis("scene", "Scene", "Name of the scene.", lambda r: r.scene),
)
"""The conditions of the leaderboard, in the order of its tables."""
