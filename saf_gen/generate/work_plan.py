"""Estimates of the work that a recipe needs: jobs, hours, disk space, and the time on several machines.

For a recipe with many sequences, only a few repeats of each scene, motion and split are drawn. They represent the other
repeats, whose stacks cost the same and whose number is known.
"""

import heapq
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from saf_gen.generate.cost import MachineRates, bytes_of_stacks, bytes_of_streams
from saf_gen.generate.job_order import validate_keep_slices
from saf_gen.generate.recipe import Recipe, read_recipe
from saf_gen.generate.resolve import ResolvedRecipe, ResolvedSequence, resolve_recipe
from saf_gen.generate.shipped_recipes import find_recipe

MAX_DRAWN = 5_000
"""Largest number of sequences that a plan draws one by one."""
SAMPLED_REPEATS = 8


@dataclass(frozen=True)
class StackWork:
    """A group of stacks that take equally long to render, and the recordings that are made from them.

    Attributes
    ----------
    stacks : int
        Number of stacks, which are rendered one by one.
    render_s : float
        Seconds that one machine takes to render one stack.
    stack_bytes, kept_bytes : int
        Bytes of all these stacks, and of those that are kept.
    recordings : int
        Number of recordings made from all these stacks together.
    """

    stacks: int
    render_s: float
    stack_bytes: int
    kept_bytes: int
    recordings: int


@dataclass(frozen=True)
class WorkPlan:
    """The work, time and disk space that it takes to make a recipe from nothing.

    Attributes
    ----------
    name : str
        Name of the recipe.
    sequences, stacks, jobs : int
        Numbers of sequences, stacks and jobs; each stack and each recording is a job.
    render_s, record_s : float
        Seconds of rendering and recording on one machine.
    seconds : float
        Seconds from start to end on all machines, including the scheduler.
    scheduler_s : float
        Seconds of the process that draws and lists sequences and, while the machines work, hands out jobs; included in
        ``seconds``.
    peak_bytes, disk_bytes : int
        Bytes on disk while the dataset is made, and when it is finished.
    drawn : int
        Number of sequences that were drawn; if it is less than ``sequences``, they represent the other sequences.
    """

    name: str
    sequences: int
    stacks: int
    jobs: int
    render_s: float
    record_s: float
    seconds: float
    scheduler_s: float
    peak_bytes: int
    disk_bytes: int
    drawn: int


def plan_work(
    recipe_path: str | Path,
    *,
    part: tuple[int, int] = (1, 1),
    split: str | None = None,
    workers: int = 1,
    machines: int = 1,
    keep_slices: str = "all",
    rates: MachineRates | None = None,
) -> WorkPlan:
    """Return the work that a recipe needs; nothing is rendered or written, and existing files are not counted.

    Parameters
    ----------
    recipe_path : str or Path
        YAML file of the recipe, or the name of a recipe that comes with saf_gen.
    part : tuple of int, default (1, 1)
        Shard (I, N), with I from 1, of the sequences.
    split : str, optional
        Use only the sequences of this split.
    workers : int, default 1
        Number of sequences that a machine records at a time.
    machines : int, default 1
        Number of machines that share one scheduler.
    keep_slices : str, default "all"
        Time slices to keep, one of KEEP_SLICES in :mod:`saf_gen.generate.job_order`.
    rates : MachineRates, optional
        Rates of each machine; by default those of two cores with LLVM.

    Returns
    -------
    WorkPlan
        Numbers of jobs, seconds and bytes.

    Raises
    ------
    BadInput
        If ``keep_slices`` is unknown, or if the recipe cannot be resolved (see ``resolve_recipe``).
    """
    validate_keep_slices(keep_slices)
    rates = rates or MachineRates()
    few = resolve_recipe(recipe_path, split=split, most_repeats=SAMPLED_REPEATS)
    recipe = read_recipe(find_recipe(recipe_path))
    total = sum(_count_sequences(recipe, group) for group in _group(few).values())
    if total <= MAX_DRAWN:
        few = resolve_recipe(recipe_path, split=split, part=part)
        works = [_sum_work(group, rates=rates, keep_slices=keep_slices) for group in _group(few).values()]
    else:
        works = [
            _scale_work(group, recipe, rates=rates, keep_slices=keep_slices, part=part)
            for group in _group(few).values()
        ]
    pixel_frames = few.sensor.rows * few.sensor.columns * recipe.camera.frames
    record_s = pixel_frames / rates.recorded_per_s(workers)
    sequences, stacks = sum(work.recordings for work in works), sum(work.stacks for work in works)
    streams = bytes_of_streams(pixel_frames * sequences)
    return WorkPlan(
        name=recipe.name,
        sequences=sequences,
        stacks=stacks,
        jobs=stacks + sequences,
        render_s=sum(work.stacks * work.render_s for work in works),
        record_s=sequences * record_s,
        seconds=simulate_machines(works, record_s=record_s, machines=machines, rates=rates),
        scheduler_s=(stacks + sequences) * rates.job_s + sequences * rates.sequence_s,
        peak_bytes=streams + sum(work.stack_bytes for work in works),
        disk_bytes=streams + sum(work.kept_bytes for work in works),
        drawn=len(few.sequences),
    )


def simulate_machines(works: Sequence[StackWork], *, record_s: float, machines: int, rates: MachineRates) -> float:
    """Return the seconds from start to end if ``machines`` machines get jobs from one scheduler, in order.

    Stacks come first, and the recordings from a stack wait until it is rendered. The scheduler hands out one job after
    the other, each in ``rates.job_s`` seconds.
    """
    free, scheduler, rendered = [0.0] * machines, 0.0, []
    for work in works:
        per_stack, more = divmod(work.recordings, max(1, work.stacks))
        for number in range(work.stacks):
            scheduler = max(scheduler, free[0]) + rates.job_s
            heapq.heapreplace(free, scheduler + work.render_s)
            rendered.append((scheduler + work.render_s, per_stack + (number < more)))
    for ready, recordings in sorted(rendered):
        for _ in range(recordings):
            scheduler = max(scheduler, free[0], ready) + rates.job_s
            heapq.heapreplace(free, scheduler + record_s)
    sequences = sum(work.recordings for work in works)
    return rates.start_s + max(free) + sequences * rates.sequence_s if rendered else 0.0


def _group(resolved: ResolvedRecipe) -> dict[tuple[str, str, str], list[ResolvedSequence]]:
    """Return the sequences by split, scene, and scene motion."""
    groups: dict[tuple[str, str, str], list[ResolvedSequence]] = {}
    for sequence in resolved.sequences:
        planned = sequence.planned
        groups.setdefault((planned.split, planned.scene, planned.scene_motion), []).append(sequence)
    return groups


def _count_sequences(recipe: Recipe, group: Sequence[ResolvedSequence]) -> int:
    split = recipe.splits[group[0].planned.split]
    return len(split.lights) * split.repeats


def _sum_work(group: Sequence[ResolvedSequence], *, rates: MachineRates, keep_slices: str) -> StackWork:
    """Return the work for these sequences of one scene."""
    recorded = {s.time_stack for s in group}
    moving = {stack for stack in recorded if stack.is_moving}
    closed_loop = {s.closed_loop_slices for s in group if s.closed_loop_slices is not None and keep_slices != "none"}
    kept = (recorded if keep_slices == "all" else recorded - moving) | closed_loop
    specs, kept_specs = ({spec for stack in some for spec in stack.specs} for some in (recorded | closed_loop, kept))
    stacks = len(recorded | closed_loop)
    seconds = sum(map(rates.render_seconds, specs))
    return StackWork(stacks, seconds / stacks, bytes_of_stacks(specs), bytes_of_stacks(kept_specs), len(group))


def _scale_work(
    group: Sequence[ResolvedSequence], recipe: Recipe, *, rates: MachineRates, keep_slices: str, part: tuple[int, int]
) -> StackWork:
    """Return the work for all sequences that these few represent, or for one part of them.

    There are as many stacks as members of the scene's family or, if the scene moves and the lens moves differently in
    each repeat, as many as repeats; this is an upper bound, because repeats may share slices.
    """
    few = _sum_work(group, rates=rates, keep_slices=keep_slices)
    split = recipe.splits[group[0].planned.split]
    repeats = len({s.planned.repeat for s in group})
    motions: list[dict[str, object]] = []
    for s in group:
        if s.planned.motion not in motions:
            motions.append(s.planned.motion)
    has_own_motions = group[0].planned.scene_motion == "dynamic" and len(motions) == repeats > 1
    members = len({s.planned.member for s in group})
    times = split.repeats / repeats if has_own_motions else split.variants / members
    recordings = _count_sequences(recipe, group)
    # A part takes every N-th recording, so it leaves a stack out only if fewer than N recordings are made from each.
    needed = min(1.0, recordings / (few.stacks * times) / part[1])
    scaled = times * needed
    return replace(
        few,
        stacks=max(1, round(few.stacks * scaled)),
        stack_bytes=round(few.stack_bytes * scaled),
        kept_bytes=round(few.kept_bytes * scaled),
        recordings=round(recordings / part[1]),
    )
