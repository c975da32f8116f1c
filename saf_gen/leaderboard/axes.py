"""Tables by condition: results under each light, motion, photon budget, focus position, grain, sensor and scene.

The bin of a sequence depends only on the sequence, so all methods have the same sequences in a bin.
"""

from bisect import bisect_right
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from saf_gen.benchmark.judgement import SUCCESS_LIMITS_DOF
from saf_gen.benchmark.records import Record
from saf_gen.leaderboard.outcomes import group_by, mean_over_scenes, median_magnitude, right_within

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

    answerable_1dof: float | None
    median_error_dof: float | None
    false_answers: int
    false_abstentions: int
    failed: int


@dataclass(frozen=True)
class Bin:
    """A bin: its name, its numbers of scenes, sequences and those without an answer, and the result of each method."""

    name: str
    scenes: int
    sequences: int
    without: int
    results: Mapping[str, BinSummary]


@dataclass(frozen=True)
class AxisResults:
    """Results in the bins of an axis."""

    axis: Axis
    bins: tuple[Bin, ...]


def by_axis(records: Sequence[Record], methods: Sequence[str]) -> tuple[AxisResults, ...]:
    """Return the results along each axis for which the bin of at least one sequence is known; methods keep order."""
    found = []
    for axis in AXES:
        bins = (_summarise(name, members, methods=methods) for name, members in group_by_bin(records, axis).items())
        found.append(AxisResults(axis, tuple(bins)))
    return tuple(one for one in found if one.bins)


def largest_bins(sizes: Mapping[str, int], limit: int = MAX_SHOWN_BINS) -> list[str]:
    """Return the ``limit`` bins with the most sequences, in their original order; ``sizes`` are their numbers."""
    largest = sorted(sizes, key=lambda name: -sizes[name])[:limit]
    return [name for name in sizes if name in largest]


def keep_largest(results: AxisResults) -> AxisResults:
    """Return the results in the largest_bins; the meaning of the axis says if bins are left out."""
    shown = largest_bins({one.name: one.sequences for one in results.bins})
    if len(shown) == len(results.bins):
        return results
    note = f"Shown: the {len(shown)} of {len(results.bins):,} bins with the most sequences; axes.csv has all."
    axis = replace(results.axis, meaning=f"{results.axis.meaning} {note}")
    return AxisResults(axis, tuple(one for one in results.bins if one.name in set(shown)))


def group_by_bin(records: Sequence[Record], axis: Axis) -> dict[str, list[Record]]:
    """Return the records of each bin, in the order of the axis; records whose bin is unknown are left out."""
    members: dict[str, list[Record]] = {}
    for record in records:
        if (name := axis.bin_of(record)) is not None:
            members.setdefault(name, []).append(record)
    return {name: members[name] for name in axis.order or sorted(members) if name in members}


def _summarise(name: str, members: Sequence[Record], *, methods: Sequence[str]) -> Bin:
    by_method = group_by(members, "method")
    results = {method: _average(by_method.get(method, [])) for method in methods}
    without = len({r.sequence for r in members if r.answerable is False})
    return Bin(name, len({r.scene for r in members}), len({r.sequence for r in members}), without, results)


def _average(records: Sequence[Record]) -> BinSummary:
    return BinSummary(
        mean_over_scenes(records, right_within()),
        median_magnitude(r.error_dof for r in records if r.answerable is not False),
        false_answers=sum(r.answerable is False and r.status == "answered" for r in records),
        false_abstentions=sum(r.answerable is True and r.status == "abstained" for r in records),
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
