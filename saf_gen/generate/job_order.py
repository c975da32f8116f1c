"""The jobs of one run of ``generate``: some may start at once, and others follow when a job has ended."""

from collections import defaultdict
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import Any

from saf_gen.core.execution import Job
from saf_gen.errors import unknown
from saf_gen.generate.jobs import DeleteJob, RecordJob, RenderJob
from saf_gen.generate.recorder import Recorder
from saf_gen.generate.resolve import ResolvedRecipe, ResolvedSequence
from saf_gen.stack.focal_stack import StackSpec
from saf_gen.stack.time_resolved import TimeResolvedStack

KEEP_SLICES = ("all", "closed-loop", "none")
"""Time slices to keep: all; those that a closed-loop run needs; or none, in which case none are rendered for it."""


def validate_keep_slices(keep_slices: str) -> str:
    """Return ``keep_slices``; raise BadInput if it is not one of KEEP_SLICES."""
    if keep_slices not in KEEP_SLICES:
        raise unknown("choice of time slices to keep:", keep_slices, allowed=KEEP_SLICES)
    return keep_slices


def stacks_to_generate(
    resolved: ResolvedRecipe, folder: Path, *, keep_slices: str
) -> dict[TimeResolvedStack, list[ResolvedSequence]]:
    """Return the stacks that lack pieces, or the measured grain that a recording needs, each with its sequences."""
    found = resolved.stacks_to_render(folder, keep_slices)
    for stack, users in resolved.sequences_by_stack().items():
        if stack not in found and _lacks_grain(stack, users, folder=folder):
            found[stack] = users
    return found


def _lacks_grain(stack: TimeResolvedStack, users: list[ResolvedSequence], *, folder: Path) -> bool:
    """Return whether a stack lacks measured grain, as after a stopped run, and sequences are to be recorded from it."""
    missing = any(not (folder / sequence.planned.file).exists() for sequence in users)
    return missing and not stack.has_grain(folder / "stacks")


class JobOrder:
    """The order of the jobs that a dataset folder still needs.

    Missing stacks are rendered, and the recordings from each stack follow. A recording whose time slices were deleted
    is read first, and the slices are rendered again only if its file is damaged. Slices that are not to be kept are
    deleted once every recording of the recipe that needs them is made, in all splits and shards.

    Parameters
    ----------
    resolved : ResolvedRecipe
        The recipe.
    folder : Path
        The dataset folder.
    to_render : dict of TimeResolvedStack to list of ResolvedSequence
        Result of :func:`stacks_to_generate`.
    recorder : Recorder
        Records the sequences.
    keep_slices : str
        One of KEEP_SLICES.
    workers : int
        Number of sequences that are recorded at a time.
    choose_backend : callable
        Returns the backend to render with; called at most once, when something must be rendered.
    """

    def __init__(
        self,
        resolved: ResolvedRecipe,
        folder: Path,
        *,
        to_render: dict[TimeResolvedStack, list[ResolvedSequence]],
        recorder: Recorder,
        keep_slices: str,
        workers: int,
        choose_backend: Callable[[], str],
    ) -> None:
        self._resolved, self._folder, self._stacks = resolved, folder, folder / "stacks"
        self._recorder, self._workers, self._choose_backend = recorder, workers, choose_backend
        self._keep_slices = keep_slices
        self._by_stack = resolved.sequences_by_stack()
        self._to_render = to_render
        self._finished: set[str] = set()
        self._rendered_again: set[TimeResolvedStack] = set()

    def first_jobs(self) -> list[Job]:
        """Return the jobs that do not wait for another job."""
        jobs: list[Job] = [self._render_job(stack, users[0]) for stack, users in self._to_render.items()]
        for stack in self._by_stack:
            if stack not in self._to_render:
                jobs += self._record_jobs(stack)
        return [*jobs, *self._jobs_that_delete_unrecorded()]

    def jobs_after(self, job: Job, result: Any) -> list[Job]:
        """Return the jobs that may start now that ``job`` has succeeded with ``result``."""
        if isinstance(job, RenderJob):
            return self._record_jobs(job.time_stack)
        if not isinstance(job, RecordJob):
            return []
        if result.lacks_slices:
            if job.time_stack in self._rendered_again:
                return []
            self._rendered_again.add(job.time_stack)
            return [self._render_job(job.time_stack, self._by_stack[job.time_stack][0])]
        self._finished.add(job.sequence.id)
        return self._jobs_that_delete(job.sequence.id)

    @cached_property
    def _backend(self) -> str:
        return self._choose_backend()

    def _render_job(self, stack: TimeResolvedStack, user: ResolvedSequence) -> Job:
        label = user.stack_label(stack)
        measure_grain = stack in self._by_stack
        return RenderJob(label, user.scene, stack, self._stacks, self._backend, measure_grain)

    def _record_jobs(self, stack: TimeResolvedStack) -> list[Job]:
        users = self._by_stack.get(stack, [])
        self._finished -= {s.planned.id for s in users}
        digest = stack.digest(self._stacks) if users else ""
        return [
            RecordJob(
                self._recorder,
                s.planned,
                stack,
                self._stacks,
                self._folder / s.planned.file,
                s.fingerprint(digest),
                self._workers,
            )
            for s in users
        ]

    @cached_property
    def _deletable(self) -> dict[frozenset[str], list[StackSpec]]:
        """The slices that are not kept, by the ids of all sequences of the recipe that are recorded from them."""
        if self._keep_slices == "all":
            return {}
        users: defaultdict[StackSpec, set[str]] = defaultdict(set)
        kept: set[StackSpec] = set()
        for sequence in self._resolved.plan:
            of_recording = sequence.time_stack.specs if sequence.time_stack.is_moving else ()
            for spec in of_recording:
                users[spec].add(sequence.planned.id)
            for spec in sequence.closed_loop_slices.specs if sequence.closed_loop_slices else ():
                users[spec] |= set()
                if self._keep_slices == "closed-loop":
                    kept.add(spec)
        groups: defaultdict[frozenset[str], list[StackSpec]] = defaultdict(list)
        for spec in users:
            if spec not in kept:
                groups[frozenset(users[spec])].append(spec)
        return groups

    @cached_property
    def _deletable_by_user(self) -> dict[str, list[frozenset[str]]]:
        """The keys of ``_deletable``, by the id of each sequence in them."""
        found: defaultdict[str, list[frozenset[str]]] = defaultdict(list)
        for users in self._deletable:
            for user in users:
                found[user].append(users)
        return found

    @cached_property
    def _ids_of_this_run(self) -> frozenset[str]:
        return frozenset(s.planned.id for s in self._resolved.sequences)

    def _jobs_that_delete(self, just_finished: str) -> list[Job]:
        """Return jobs that delete each group of slices whose recordings in this run are all made."""
        return [
            self._delete_job(users, self._deletable[users])
            for users in self._deletable_by_user.get(just_finished, ())
            if users & self._ids_of_this_run <= self._finished
        ]

    def _jobs_that_delete_unrecorded(self) -> list[Job]:
        """Return jobs that delete slices of an earlier run that only a closed-loop run would need."""
        specs = [spec for spec in self._deletable.get(frozenset(), []) if (self._stacks / spec.key).exists()]
        return [self._delete_job(frozenset(), specs)] if specs else []

    def _delete_job(self, users: frozenset[str], specs: list[StackSpec]) -> Job:
        needed_by = [s for s in self._resolved.plan if s.planned.id in users] if users else []
        label = needed_by[0].planned.label if needed_by else "the closed loop"
        digests = {stack: stack.digest(self._stacks) for stack in {s.time_stack for s in needed_by}}
        files = tuple((self._folder / s.planned.file, s.fingerprint(digests[s.time_stack])) for s in needed_by)
        return DeleteJob(label, tuple(specs), self._stacks, files)
