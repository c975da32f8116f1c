"""The plan of a run: what a dataset lacks, and what making it takes in bytes and seconds.

A plan looks at the disk once and makes nothing; ``generate --dry-run`` prints it.
"""

import heapq
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import fsum
from pathlib import Path

from saf_gen.core.files import check_on_disk
from saf_gen.errors import BadInput, unknown
from saf_gen.generate.cost import PIXEL_FRAMES_PER_S, grain_seconds, render_seconds, start_seconds
from saf_gen.generate.record import has_recording
from saf_gen.generate.resolve import ResolvedRecipe, ResolvedSequence
from saf_gen.generate.shards import Shard, partition
from saf_gen.stack.focal_stack import PICTURES, StackSpec
from saf_gen.stack.time_resolved import TimeResolvedStack
from saf_gen.stream.manifest import MANIFEST_NAME, Manifest, read_manifest

KEEP_SLICES = ("all", "closed-loop", "none")
"""Time slices to keep: all; those that a closed-loop run needs; or none, in which case none are rendered for it."""
SLICE_BYTES_PER_VALUE = {"filtered": 1.3, "plain": 1.5}
"""Bytes per stored value of a time slice, by estimator; upper bounds. Filtered, with 16 samples: 1.15 to 1.29 in the
middle 200 × 125 pixels of fan, crossroad and cardiac_muscle, under each of their lights, at three positions and at all
129. Plain, with 15 % of noise: 1.3 to 1.5."""
SLICE_GEOMETRY_BYTES = 3.0  # per pixel, an upper bound: up to 2.8 in the middle of fan
STREAM_BITS_PER_PIXEL_FRAME = 0.4  # an upper bound for a stream on disk


@dataclass(frozen=True)
class MachineRates:
    """The speed of a machine at what follows rendering; the defaults are for two cores of 2.8 GHz.

    Attributes
    ----------
    cores : float
        Cores that rendering uses, and that parallel recordings share.
    pixel_frames_per_s : float
        Pixels times frames that one worker encodes, stores and verifies per second.
    pixel_frames_per_core_s : float
        Pixels times frames per second of processor time, a limit that many parallel workers cannot exceed.
    job_s : float
        Seconds that the scheduler spends on any job, measured on 100,000 jobs that do nothing.
    sequence_s : float
        Seconds that one process needs to draw a sequence and, at the end, to list its file in the manifest.
    start_s : float
        Seconds to start processes, load kernels and draw contact sheets; of the 25 s of quickstart, only 9 s are work.
    """

    cores: float = 2
    pixel_frames_per_s: float = PIXEL_FRAMES_PER_S
    pixel_frames_per_core_s: float = 0.97e9
    job_s: float = 0.00024
    sequence_s: float = 0.004
    start_s: float = 15.0

    def recorded_per_s(self, workers: int) -> float:
        """Return the pixels times frames that ``workers`` workers on this machine record per second."""
        return min(workers * self.pixel_frames_per_s, max(1.0, self.cores) * self.pixel_frames_per_core_s)


@dataclass(frozen=True)
class WorkEstimate:
    """The seconds that a run takes.

    Attributes
    ----------
    render_s, record_s : float
        Seconds of all rendering and of all recording on one machine.
    seconds : float
        Seconds from start to end on all machines, including the scheduler; 0 without a job.
    """

    render_s: float
    record_s: float
    seconds: float


def simulate_machines(
    works: Sequence[tuple[float, int]], *, record_s: float, machines: int, rates: MachineRates
) -> float:
    """Return the seconds from start to end if ``machines`` machines get jobs from one scheduler, in order.

    Stacks come first, and the recordings from a stack wait until it is rendered. The scheduler hands out one job after
    the other, each in ``rates.job_s`` seconds.

    Parameters
    ----------
    works : sequence of (float, int)
        Seconds to render each stack, 0 if it exists, and the number of recordings to make from it.
    record_s : float
        Seconds of one recording.
    machines : int
        Number of machines.
    rates : MachineRates
        Rates of each machine.
    """
    free, scheduler, rendered = [0.0] * machines, 0.0, []
    for render_s, recordings in works:
        if render_s:
            scheduler = max(scheduler, free[0]) + rates.job_s
            heapq.heapreplace(free, scheduler + render_s)
        rendered.append((scheduler + render_s if render_s else 0.0, recordings))
    for ready, recordings in sorted(rendered):
        for _ in range(recordings):
            scheduler = max(scheduler, free[0], ready) + rates.job_s
            heapq.heapreplace(free, scheduler + record_s)
    sequences = sum(recordings for _, recordings in works)
    return rates.start_s + max(free) + sequences * rates.sequence_s if max(free) else 0.0


def bytes_of_stacks(specs: Iterable[StackSpec]) -> int:
    """Return the approximate disk space of stacks, including their depth maps and targets, in bytes."""
    return sum(map(_stored_bytes, specs))


def bytes_of_streams(sequences: Iterable[ResolvedSequence]) -> int:
    """Return the approximate disk space of the streams of these sequences, in bytes."""
    return int(sum(s.pixel_frames for s in sequences) * STREAM_BITS_PER_PIXEL_FRAME / 8)


def _stored_bytes(spec: StackSpec) -> int:
    pixels = spec.rows * spec.columns
    values = len(spec.groups) * spec.rendered_count * pixels
    if spec.window:
        return int(values * SLICE_BYTES_PER_VALUE[spec.estimator] + pixels * SLICE_GEOMETRY_BYTES)
    return values * 4 + pixels * 8


@dataclass(frozen=True)
class Plan:
    """The work that is left of a dataset, and the files that are there.

    Attributes
    ----------
    resolved : ResolvedRecipe
        The recipe.
    target : Path
        Folder of the dataset, as the user wrote it.
    folder : Path
        The same as an absolute path without links.
    keep_slices : str
        One of KEEP_SLICES.
    manifest : Manifest or None
        Manifest of the folder; None if it has none yet.
    made : frozenset of str
        Ids of the sequences whose file exists in the folder, judged by its name.
    sequences : tuple of ResolvedSequence
        Sequences to make or to verify: of a shard, those whose stacks it renders alone.
    by_stack : dict of TimeResolvedStack to list of ResolvedSequence
        Every stack of these recordings once, with the sequences that are recorded from it.
    to_render : dict of TimeResolvedStack to tuple of StackSpec
        Stacks to render, those of recordings first, with the parts that are missing; no part is missing where only the
        grain must be measured. Of a shard, cut stacks come before all others, with the parts that are its own.
    shard : Shard, optional
        The shard; None for a run that makes everything.
    by_cut_stack : mapping of TimeResolvedStack to list of ResolvedSequence
        Stacks of recordings of which the shard renders some slices, with the sequences to record from them if they are
        complete when it has done its own work.
    """

    resolved: ResolvedRecipe
    target: Path
    folder: Path
    keep_slices: str
    manifest: Manifest | None
    made: frozenset[str]
    sequences: tuple[ResolvedSequence, ...]
    by_stack: dict[TimeResolvedStack, list[ResolvedSequence]]
    to_render: dict[TimeResolvedStack, tuple[StackSpec, ...]]
    shard: Shard | None = None
    by_cut_stack: Mapping[TimeResolvedStack, list[ResolvedSequence]] = field(default_factory=dict)

    @cached_property
    def users(self) -> dict[TimeResolvedStack, ResolvedSequence]:
        """The first sequence that needs each stack, for its recording or for the closed loop."""
        makes = self.sequences if self.shard is None else self.resolved.sequences
        pairs = [(stack, s) for s in makes for stack in s.stacks]
        return dict(reversed(pairs))

    @property
    def labels(self) -> list[str]:
        """Names of the stacks to render, with the number of slices where a shard renders only some."""
        return [self.users[stack].stack_label(stack) + self._describe_cut(stack) for stack in self.to_render]

    def _describe_cut(self, stack: TimeResolvedStack) -> str:
        if self.shard is None or stack not in self.shard.cut:
            return ""
        mine = sum(spec in self.shard.specs for spec in stack.specs)
        if mine == len(stack.specs):
            return ""
        return f", {mine} of {len(stack.specs)} slices"

    @property
    def renders(self) -> bool:
        """Whether anything must be rendered; stacks that were photographed are taken in without a renderer."""
        return any(spec.estimator != PICTURES for stack in self.to_render for spec in stack.specs)

    @cached_property
    def unrecorded(self) -> frozenset[str]:
        """Ids of the sequences that have no file yet."""
        return frozenset(s.planned.id for s in self.sequences if not (self.folder / s.planned.file).exists())

    @property
    def disk_bytes(self) -> int:
        """Approximate disk space on this machine that the work takes while it runs, in bytes, rounded up."""
        missing = {spec for specs in self.to_render.values() for spec in specs}
        return bytes_of_stacks(missing) + bytes_of_streams(s for s in self.sequences if s.planned.id in self.unrecorded)

    def kept_bytes(self, keep_slices: str) -> int:
        """Return the approximate size of the time slices that ``keep_slices`` keeps in the end, in bytes.

        All-in-focus slices are always kept.
        """
        stacks = {s.time_stack for s in self.sequences if keep_slices == "all" and s.time_stack.is_moving}
        if keep_slices != "none":
            stacks |= {s.closed_loop_slices for s in self.sequences if s.closed_loop_slices}
        stacks |= {s.sharp_stack for s in self.sequences if s.sharp_stack and s.sharp_stack.is_moving}
        return bytes_of_stacks({spec for stack in stacks for spec in stack.specs})

    @cached_property
    def deletable(self) -> dict[frozenset[str], list[StackSpec]]:
        """The slices that are not kept, by the ids of all sequences of the recipe that are recorded from them.

        There are none in a shard.
        """
        if self.keep_slices == "all" or self.shard is not None:  # another shard may need them
            return {}
        users: defaultdict[StackSpec, set[str]] = defaultdict(set)
        for sequence in self.resolved.all_sequences:
            for spec in sequence.time_stack.specs if sequence.time_stack.is_moving else ():
                users[spec].add(sequence.planned.id)
        slices = [s.closed_loop_slices for s in self.resolved.all_sequences if s.closed_loop_slices]
        of_loop = dict.fromkeys(spec for stack in slices for spec in stack.specs)
        groups: defaultdict[frozenset[str], list[StackSpec]] = defaultdict(list)
        for spec in dict.fromkeys([*users, *of_loop]):
            if self.keep_slices == "none" or spec not in of_loop:
                groups[frozenset(users.get(spec, ()))].append(spec)
        return groups

    def estimate(self, *, workers: int = 1, machines: int = 1) -> WorkEstimate:
        """Return the time of the work, with ``workers`` workers on each of ``machines`` machines.

        The machines have two cores with LLVM, and get their jobs from one scheduler.
        """
        rates, works = MachineRates(), list[tuple[float, int]]()
        counted = set[StackSpec]()
        for stack in self.to_render | self.by_stack:
            missing = [spec for spec in self.to_render.get(stack, ()) if spec not in counted]
            counted.update(missing)  # several stacks may have slices in common
            recordings = sum(s.planned.id in self.unrecorded for s in self.by_stack.get(stack, ()))
            render_s = fsum(render_seconds(spec) for spec in missing)
            if render_s:
                render_s += start_seconds(missing[0])
                render_s += 0.0 if stack == self.users[stack].sharp_stack else grain_seconds(stack)
            works.append((render_s, recordings))
        record_s = self.resolved.pixel_frames / rates.recorded_per_s(workers)
        return WorkEstimate(
            render_s=sum(render_s for render_s, _ in works),
            record_s=len(self.unrecorded) * record_s,
            seconds=simulate_machines(works, record_s=record_s, machines=machines, rates=rates),
        )


def make_plan(resolved: ResolvedRecipe, target: Path, *, keep_slices: str = "all") -> Plan:
    """Return what a dataset lacks, without making or writing anything.

    Time slices that were deleted after all their recordings had been made are not rendered again, unless the closed
    loop needs them and ``keep_slices`` is not "none".

    Raises BadInput if ``keep_slices`` is not one of KEEP_SLICES, or if the target cannot be read or holds another
    dataset.
    """
    if keep_slices not in KEEP_SLICES:
        raise unknown("choice of time slices to keep:", keep_slices, allowed=KEEP_SLICES)
    check_on_disk(target)
    manifest, shard = check_same_dataset(resolved, target), None
    folder, sequences = target.resolve(), resolved.sequences
    made = frozenset(s.planned.id for s in sequences if (folder / s.planned.file).exists())
    if resolved.part[1] > 1:
        shard = partition(resolved, resolved.part[1])[resolved.part[0] - 1]
        sequences = tuple(s for s in sequences if s.time_stack in shard.whole)
    by_stack = _group_by_stack(sequences)
    cut = _group_by_stack(s for s in resolved.sequences if shard and s.time_stack in shard.cut)
    makes = sequences if shard is None else resolved.sequences
    more = [s.closed_loop_slices for s in makes if keep_slices != "none"] + [s.sharp_stack for s in makes]
    unrecorded = dict.fromkeys(stack for stack in more if stack)
    to_render = _stacks_to_render(cut | by_stack, unrecorded, folder=folder, shard=shard)
    for stack, users in by_stack.items():
        unmade = any(s.planned.id not in made for s in users)
        if stack not in to_render and unmade and not stack.has_grain(folder / "stacks"):  # as after a stopped run
            to_render[stack] = ()
    return Plan(resolved, target, folder, keep_slices, manifest, made, sequences, by_stack, to_render, shard, cut)


def _group_by_stack(sequences: Iterable[ResolvedSequence]) -> dict[TimeResolvedStack, list[ResolvedSequence]]:
    by_stack: dict[TimeResolvedStack, list[ResolvedSequence]] = {}
    for sequence in sequences:
        by_stack.setdefault(sequence.time_stack, []).append(sequence)
    return by_stack


def _stacks_to_render(
    by_stack: dict[TimeResolvedStack, list[ResolvedSequence]],
    unrecorded: Iterable[TimeResolvedStack],
    *,
    folder: Path,
    shard: Shard | None,
) -> dict[TimeResolvedStack, tuple[StackSpec, ...]]:
    """Return the stacks that are incomplete in a folder, with their missing parts.

    ``unrecorded`` holds those from which nothing is recorded: all-in-focus pictures, and what the closed loop needs,
    unless no slices are kept for it. Parts that another shard renders are not missing.
    """

    def missing(stack: TimeResolvedStack) -> tuple[StackSpec, ...]:
        mine = stack if shard is None else replace(stack, specs=tuple(s for s in stack.specs if s in shard.specs))
        return tuple(mine.find_missing(folder / "stacks"))

    found = {
        stack: specs
        for stack, users in by_stack.items()
        if (specs := missing(stack)) and not _is_recorded(stack, users, folder=folder)
    }
    return found | {stack: specs for stack in unrecorded if stack not in found and (specs := missing(stack))}


def _is_recorded(stack: TimeResolvedStack, users: list[ResolvedSequence], *, folder: Path) -> bool:
    """Return whether time slices all have notes and all recordings are made; spikes are not read."""
    if not (stack.is_moving and stack.has_all_notes(folder / "stacks")):
        return False
    digest = stack.digest(folder / "stacks")
    return all(has_recording(folder / s.planned.file, s.fingerprint(digest)) for s in users)


def check_same_dataset(resolved: ResolvedRecipe, folder: Path) -> Manifest | None:
    """Return the manifest in a folder, or None if it is missing; raise BadInput if it describes another dataset."""
    if not (folder / MANIFEST_NAME).exists():
        return None
    manifest = read_manifest(folder)
    if manifest.name != resolved.recipe.name:
        raise BadInput(
            f"{folder} holds the dataset {manifest.name!r}, but the recipe makes {resolved.recipe.name!r}",
            hint="give another folder with --out",
        )
    return manifest


def stacks_of(sequences: Iterable[ResolvedSequence]) -> list[StackSpec]:
    """Return all stacks of these sequences, with all-in-focus pictures and slices for the closed loop, each once."""
    return list(dict.fromkeys(spec for sequence in sequences for stack in sequence.stacks for spec in stack.specs))
