"""The shards of a job array: which of them renders which pictures, and what that costs.

Who does what depends only on the resolved recipe and the number of shards, never on the disk, the clock or the speed of
this machine, so a shard that starts late, or again, is cut as it was before. Whole stacks are dealt out first, the
dearest to the shard with the least to do. Only if that leaves a shard with too much are moving scenes cut, into as few
runs of neighbouring time slices as possible, because each run must trace the light paths of the moments before it.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import fsum
from typing import TypeVar

from saf_gen.generate.cost import PIXEL_FRAMES_PER_S, grain_seconds, load_seconds, render_seconds, start_seconds
from saf_gen.generate.resolve import ResolvedRecipe, ResolvedSequence
from saf_gen.stack.focal_stack import StackSpec
from saf_gen.stack.time_resolved import TimeResolvedStack

_T = TypeVar("_T")
UNEVEN = 1.1
"""Largest shard divided by the mean up to which no stack is cut."""


@dataclass(frozen=True)
class Shard:
    """What one shard makes.

    Attributes
    ----------
    part : tuple of int
        The shard (I, N), with I from 1.
    specs : frozenset of StackSpec
        Stacks and time slices that it renders. The grain of those among them that are measured is its work, too.
    whole : tuple of TimeResolvedStack
        Stacks of which it renders everything. It also records what is recorded from them.
    cut : tuple of TimeResolvedStack
        Stacks of which other shards render slices, too. They are recorded by a shard that sees them whole, or by the
        run that closes the array.
    seconds : float
        Cost of its work on two cores with LLVM. A cut stack's recordings count where its last slices are rendered.
    all_seconds : float
        Cost of the whole recipe in one run.
    all_specs : int
        Number of stacks and time slices of the recipe.
    """

    part: tuple[int, int]
    specs: frozenset[StackSpec]
    whole: tuple[TimeResolvedStack, ...]
    cut: tuple[TimeResolvedStack, ...]
    seconds: float
    all_seconds: float
    all_specs: int


@dataclass(frozen=True, eq=False)
class _Family:
    """Stacks with slices in common, and all that is recorded from them; a whole family is made by one shard."""

    stacks: tuple[TimeResolvedStack, ...]
    recordings: tuple[ResolvedSequence, ...]

    @cached_property
    def specs(self) -> tuple[StackSpec, ...]:
        return tuple(dict.fromkeys(spec for stack in self.stacks for spec in stack.specs))

    @cached_property
    def firsts(self) -> frozenset[int]:
        """Indices of the specs with which a stack begins."""
        return frozenset(self.specs.index(stack.specs[0]) for stack in self.stacks)

    @cached_property
    def costs(self) -> list[float]:
        """Seconds of each spec, with a part of the grain; the last one has the recordings, too."""
        recorded = {s.time_stack for s in self.recordings}
        grain = fsum(map(grain_seconds, recorded)) / len(self.specs)
        costs = [render_seconds(spec) + grain for spec in self.specs]
        for k in self.firsts:
            costs[k] += start_seconds(self.specs[k])
        costs[-1] += fsum(s.pixel_frames for s in self.recordings) / PIXEL_FRAMES_PER_S
        return costs

    @cached_property
    def seconds(self) -> float:
        return fsum(self.costs)

    @property
    def dearest_run_s(self) -> float:
        """Seconds of the dearest run of a single slice."""
        return max(self.run_seconds(k, k + 1) for k in range(len(self.specs)))

    def run_seconds(self, first: int, stop: int) -> float:
        """Return the seconds of a run of slices.

        It begins with the light paths of the moments before it. The slices of a cut family are loaded once more, for
        depth and target.
        """
        if (first, stop) == (0, len(self.specs)):
            return self.seconds
        start = 0.0 if first in self.firsts else start_seconds(self.specs[first])
        again = fsum(map(load_seconds, self.specs[first:stop]))
        return fsum(self.costs[first:stop]) + start + again


_Run = tuple[_Family, int, int]
"""Specs first <= k < stop of a family."""


def partition(resolved: ResolvedRecipe, count: int) -> list[Shard]:
    """Return the shares of ``count`` shards, which together make the sequences of a recipe or of one of its splits.

    Nothing is made twice, and nothing is left out. What nothing is recorded from, all-in-focus pictures and the slices
    that only a closed-loop run needs, is dealt out last, so that shards that leave these slices out (``--keep-slices
    none``) render the same pictures of the recordings.
    """
    recorded, for_loop = _find_families(resolved.sequences)
    runs: list[list[_Run]] = [[] for _ in range(count)]
    loads = [0.0] * count
    for families in (recorded, for_loop):
        for mine, more in zip(runs, _deal(families, loads), strict=True):
            mine += more
        loads = [fsum(family.run_seconds(first, stop) for family, first, stop in mine) for mine in runs]
    all_seconds = fsum(family.seconds for family in (*recorded, *for_loop))
    all_specs = sum(len(family.specs) for family in (*recorded, *for_loop))
    return [
        _to_shard((n + 1, count), mine, seconds=loads[n], all_seconds=all_seconds, all_specs=all_specs)
        for n, mine in enumerate(runs)
    ]


def _to_shard(part: tuple[int, int], runs: list[_Run], *, seconds: float, all_seconds: float, all_specs: int) -> Shard:
    specs = frozenset(spec for family, first, stop in runs for spec in family.specs[first:stop])
    whole = [family for family, first, stop in runs if stop - first == len(family.specs)]
    cut = dict.fromkeys(family for family, first, stop in runs if stop - first < len(family.specs))
    return Shard(part, specs, _stacks_of(whole), _stacks_of(cut), seconds, all_seconds, all_specs)


def _stacks_of(families: Iterable[_Family]) -> tuple[TimeResolvedStack, ...]:
    return tuple(stack for family in families for stack in family.stacks)


def _find_families(sequences: Iterable[ResolvedSequence]) -> tuple[list[_Family], list[_Family]]:
    """Return the families from which something is recorded, and the others."""
    users: dict[TimeResolvedStack, list[ResolvedSequence]] = {}
    for sequence in sequences:
        users.setdefault(sequence.time_stack, []).append(sequence)
    for stack in [stack for made in users.values() for s in made for stack in s.stacks]:
        users.setdefault(stack, [])
    families = [
        _Family(tuple(stacks), tuple(s for stack in stacks for s in users[stack]))
        for stacks in join_by_stacks(users, lambda stack: stack.specs)
    ]
    return [one for one in families if one.recordings], [one for one in families if not one.recordings]


def join_by_stacks(items: Iterable[_T], specs_of: Callable[[_T], Iterable[StackSpec]]) -> list[list[_T]]:
    """Return items in groups, so that no stack or time slice belongs to two groups."""
    group_of: dict[StackSpec, list[_T]] = {}
    for item in items:
        group = [item]
        for spec in specs_of(item):
            other = group_of.get(spec, group)
            if other is not group:
                other += group
                group_of |= dict.fromkeys((spec for one in group for spec in specs_of(one)), other)
                group = other
        group_of |= dict.fromkeys(specs_of(item), group)
    return list({id(group): group for group in group_of.values()}.values())


def _deal(families: Sequence[_Family], loads: Sequence[float]) -> list[list[_Run]]:
    """Return the runs that each of several shards gets, in addition to the seconds that it has already."""
    dearest_first = sorted(families, key=lambda family: -family.seconds)  # stable, so ties keep the order of the recipe
    mean = (fsum(loads) + fsum(family.seconds for family in families)) / len(loads)
    runs, longest = _deal_whole(dearest_first, loads)
    indivisible = [family for family in dearest_first if len(family.specs) == 1]
    if longest <= max(UNEVEN * mean, *(family.seconds for family in indivisible), 0.0):
        return runs
    runs, longest = _deal_whole(indivisible, loads)
    moving = [family for family in dearest_first if len(family.specs) > 1]
    level = max(mean, longest, *(family.dearest_run_s for family in moving))
    while (found := _fill(moving, runs=runs, loads=loads, level=level)) is None:
        level *= 1.002
    return found


def _deal_whole(families: Iterable[_Family], loads: Sequence[float]) -> tuple[list[list[_Run]], float]:
    """Deal out whole families, each to the shard with the least to do; return them, and the seconds of the largest."""
    loads, runs = list(loads), [list[_Run]() for _ in loads]
    for family in families:
        n = loads.index(min(loads))
        runs[n].append((family, 0, len(family.specs)))
        loads[n] += family.seconds
    return runs, max(loads)


def _fill(
    families: Iterable[_Family], *, runs: Sequence[Sequence[_Run]], loads: Sequence[float], level: float
) -> list[list[_Run]] | None:
    """Deal out families so that no shard has more than ``level`` seconds; return None if that is too little.

    Families that fit stay whole. Each of the others is cut into runs, the longest that fit where the least is to do.
    The last slices come first: what remains is then the beginning of the recording, whose run is the cheapest to start,
    and it goes where it fits best.
    """
    filled = [list(mine) for mine in runs]
    loads = [s + fsum(family.run_seconds(*run) for family, *run in mine) for s, mine in zip(loads, runs, strict=True)]
    too_large = []
    for family in families:
        n = loads.index(min(loads))
        if loads[n] + family.seconds <= level:
            filled[n].append((family, 0, len(family.specs)))
            loads[n] += family.seconds
        else:
            too_large.append(family)
    for family in too_large:
        stop = len(family.specs)
        while stop:
            rest_s = family.run_seconds(0, stop)
            n = loads.index(max((load for load in loads if load + rest_s <= level), default=min(loads)))
            first = stop
            while first and loads[n] + family.run_seconds(first - 1, stop) <= level:
                first -= 1
            if first == stop:
                return None
            filled[n].append((family, first, stop))
            loads[n] += family.run_seconds(first, stop)
            stop = first
    return filled
