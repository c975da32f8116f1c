"""What a recipe asks for before anything is made: jobs, hours and disk, and how long machines take together.

A recipe of many sequences is not drawn whole. A few repeats of each scene, motion and split stand for all of them:
what they are recorded from costs the same, and their number is known.
"""

import heapq
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from saf_gen.generate.cost import MachineRates, plan_stack_bytes, plan_stream_bytes
from saf_gen.generate.job_order import validate_generated_slices_kept
from saf_gen.generate.recipe import Recipe, read_recipe
from saf_gen.generate.resolve import ResolvedRecipe, ResolvedSequence, resolve_recipe
from saf_gen.generate.shipped_recipes import find_recipe

MOST_DRAWN = 5_000
"""Most sequences that a plan draws one by one."""
REPEATS_THAT_STAND_FOR_ALL = 8


@dataclass(frozen=True)
class StackWork:
    """Stacks that cost the same, rendered one by one, and the recordings made from all of them together.

    ``render_s`` are the seconds of one stack, by one machine; the bytes are of all.
    """

    stacks: int
    render_s: float
    stack_bytes: int
    kept_bytes: int
    recordings: int


@dataclass(frozen=True)
class WorkPlan:
    """What a recipe takes, from nothing.

    Attributes
    ----------
    name : of the recipe.
    sequences, stacks, jobs : their numbers; a stack is a job, and so is a recording.
    render_s, record_s : seconds of work on one machine.
    seconds : from the start to the end, on all machines, with the scheduler.
    scheduler_s : seconds of one process that are in ``seconds``: to draw and list sequences, and to hand out jobs,
        the latter at the same time as the machines work.
    peak_bytes, disk_bytes : disk while it is made, and what stays in the end.
    drawn : sequences that were drawn; where they are fewer than ``sequences``, they stand for the others.
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


def plan_recipe_work(
    recipe_path: str | Path,
    *,
    part: tuple[int, int] = (1, 1),
    split: str | None = None,
    workers: int = 1,
    machines: int = 1,
    keep_slices: str = "all",
    rates: MachineRates | None = None,
) -> WorkPlan:
    """Return what a recipe takes; nothing is rendered or written, and what is there already is not looked at.

    Parameters
    ----------
    recipe_path, part, split : as in :func:`saf_gen.generate.resolve.resolve_recipe`.
    workers : sequences that a machine records at a time.
    machines : machines that one scheduler has.
    keep_slices : as in :func:`saf_gen.generate.run.generate`.
    rates : of each machine.

    Raises
    ------
    BadInput : for whatever does not fit, as ``generate`` would.
    """
    validate_generated_slices_kept(keep_slices)
    rates = rates or MachineRates()
    few = resolve_recipe(recipe_path, split=split, most_repeats=REPEATS_THAT_STAND_FOR_ALL)
    recipe = read_recipe(find_recipe(recipe_path))
    total = sum(_count_sequences(recipe, own) for own in _group(few).values())
    if total <= MOST_DRAWN:
        few = resolve_recipe(recipe_path, split=split, part=part)
        works = [_add_up(own, rates=rates, keep_slices=keep_slices) for own in _group(few).values()]
    else:
        works = [_scale(own, recipe, rates=rates, keep_slices=keep_slices, part=part) for own in _group(few).values()]
    pixel_frames = few.sensor.rows * few.sensor.columns * recipe.camera.frames
    record_s = pixel_frames / rates.recorded_per_s(workers)
    sequences, stacks = sum(work.recordings for work in works), sum(work.stacks for work in works)
    streams = plan_stream_bytes(pixel_frames * sequences)
    return WorkPlan(
        name=recipe.name,
        sequences=sequences,
        stacks=stacks,
        jobs=stacks + sequences,
        render_s=sum(work.stacks * work.render_s for work in works),
        record_s=sequences * record_s,
        seconds=simulate_plan_on_machines(works, record_s=record_s, machines=machines, rates=rates),
        scheduler_s=(stacks + sequences) * rates.job_s + sequences * rates.sequence_s,
        peak_bytes=streams + sum(work.stack_bytes for work in works),
        disk_bytes=streams + sum(work.kept_bytes for work in works),
        drawn=len(few.sequences),
    )


def simulate_plan_on_machines(
    works: Sequence[StackWork], *, record_s: float, machines: int, rates: MachineRates
) -> float:
    """Return the seconds from start to end where ``machines`` take their jobs from one scheduler, in their order.

    Stacks come first, and what is recorded from each waits until it is rendered. The scheduler hands out one job after
    the other, each in ``rates.job_s``.
    """
    free, scheduler, rendered = [0.0] * machines, 0.0, []
    for work in works:
        share, more = divmod(work.recordings, max(1, work.stacks))
        for number in range(work.stacks):
            scheduler = max(scheduler, free[0]) + rates.job_s
            heapq.heapreplace(free, scheduler + work.render_s)
            rendered.append((scheduler + work.render_s, share + (number < more)))
    for ready, recordings in sorted(rendered):
        for _ in range(recordings):
            scheduler = max(scheduler, free[0], ready) + rates.job_s
            heapq.heapreplace(free, scheduler + record_s)
    sequences = sum(work.recordings for work in works)
    return rates.start_s + max(free) + sequences * rates.sequence_s if rendered else 0.0


def _group(resolved: ResolvedRecipe) -> dict[tuple[str, str, str], list[ResolvedSequence]]:
    """Return the sequences by split, scene, and whether it moves."""
    groups: dict[tuple[str, str, str], list[ResolvedSequence]] = {}
    for sequence in resolved.sequences:
        planned = sequence.planned
        groups.setdefault((planned.split, planned.scene, planned.scene_motion), []).append(sequence)
    return groups


def _count_sequences(recipe: Recipe, own: Sequence[ResolvedSequence]) -> int:
    split = recipe.splits[own[0].planned.split]
    return len(split.lights) * split.repeats


def _add_up(own: Sequence[ResolvedSequence], *, rates: MachineRates, keep_slices: str) -> StackWork:
    """Return the work of these sequences of one scene."""
    recorded = {s.time_stack for s in own}
    moving = {stack for stack in recorded if stack.is_moving}
    whole = {s.closed_loop_slices for s in own if s.closed_loop_slices is not None and keep_slices != "none"}
    kept = (recorded if keep_slices == "all" else recorded - moving) | whole
    specs, kept_specs = ({spec for stack in some for spec in stack.specs} for some in (recorded | whole, kept))
    stacks = len(recorded | whole)
    seconds = sum(map(rates.render_seconds, specs))
    return StackWork(stacks, seconds / stacks, plan_stack_bytes(specs), plan_stack_bytes(kept_specs), len(own))


def _scale(
    own: Sequence[ResolvedSequence], recipe: Recipe, *, rates: MachineRates, keep_slices: str, part: tuple[int, int]
) -> StackWork:
    """Return the work of all sequences that these few stand for, or of one part of them.

    Stacks are as many as members of the scene's family; where things move and the lens moves otherwise each time, as
    many as repeats: an upper bound, since some of these may share their slices.
    """
    few = _add_up(own, rates=rates, keep_slices=keep_slices)
    split = recipe.splits[own[0].planned.split]
    repeats = len({s.planned.repeat for s in own})
    motions: list[dict[str, object]] = []
    for s in own:
        if s.planned.motion not in motions:
            motions.append(s.planned.motion)
    moves_anew = own[0].planned.scene_motion == "dynamic" and len(motions) == repeats > 1
    members = len({s.planned.member for s in own})
    times = split.repeats / repeats if moves_anew else split.variants / members
    recordings = _count_sequences(recipe, own)
    # A part takes every N-th recording, and so leaves a stack out only where fewer are made from each.
    needed = min(1.0, recordings / (few.stacks * times) / part[1])
    scaled = times * needed
    return replace(
        few,
        stacks=max(1, round(few.stacks * scaled)),
        stack_bytes=round(few.stack_bytes * scaled),
        kept_bytes=round(few.kept_bytes * scaled),
        recordings=round(recordings / part[1]),
    )
