"""The jobs that make a dataset, as values that can be sent to another process, and the order in which they run."""

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from saf_gen.core.cores import defer_interrupts, usable_cores
from saf_gen.core.execution import Job, ReportProgress
from saf_gen.core.files import undeletable, unwritable
from saf_gen.generate.plan import Plan
from saf_gen.generate.record import Recorder, recording_digest
from saf_gen.generate.resolve import PlannedSequence, ResolvedSequence
from saf_gen.scene.scene_folder import Scene
from saf_gen.stack.focal_stack import PICTURES, StackSpec, StackStore
from saf_gen.stack.grain import read_grain
from saf_gen.stack.picture_stack import PictureStack
from saf_gen.stack.same_scene import require_same_scene
from saf_gen.stack.second_render import stacks_to_repeat
from saf_gen.stack.time_resolved import PlaneSource, TimeResolvedStack

COMPUTED_FRACTION = 0.99
"""Progress of a piece of work once everything is computed; it becomes 1 when its files have their final names."""
MAX_OTHERS = 8
"""Stacks of a scene and its parameters with which each further one is compared; more would not show more."""


@dataclass(frozen=True)
class RenderJob:
    """Renders the pieces of a time-resolved stack that are missing on disk, and returns their names.

    Attributes
    ----------
    label : str
        Name of the stack in messages.
    scene : Scene or PictureStack
        Scene of the stack, or the pictures that are taken in instead of being rendered.
    time_stack : TimeResolvedStack
        The stack.
    stacks : Path
        Folder of stacks.
    backend : str
        Rendering backend.
    measure_grain : bool, default True
        Whether to measure the grain of the stored pictures too.
    wanted : tuple of StackSpec, optional
        The slices that are rendered, if other shards render the rest; by default all.
    others : tuple of StackSpec, optional
        Other stacks of the scene with the same parameters, which must show the same.
    """

    label: str
    scene: Scene | PictureStack
    time_stack: TimeResolvedStack
    stacks: Path
    backend: str
    measure_grain: bool = True
    wanted: tuple[StackSpec, ...] | None = None
    others: tuple[StackSpec, ...] = ()

    @property
    def name(self) -> str:
        return f"{'take in' if isinstance(self.scene, PictureStack) else 'render'} {self.label}"

    @property
    def takes_all_cores(self) -> bool:
        return True

    @property
    def wants_gpu(self) -> bool:
        return self.backend == "cuda"

    def run(self, report: ReportProgress) -> list[str]:
        if isinstance(self.scene, PictureStack):
            return self._take_in(self.scene, report)
        from saf_gen.render import render_missing  # so that only a process that renders loads Mitsuba
        from saf_gen.render.grain import measure_by_repeat

        building, reported = f"{self.name} · build", set[str]()
        report(building, 0.0)  # the code of a scene may take any time, and should not do so in silence

        def progress(piece: str, done: float) -> None:
            if not reported:
                report(building, 1.0)
            reported.add(f"{self.name} · {piece}")
            report(f"{self.name} · {piece}", COMPUTED_FRACTION * done)

        def report_done() -> None:
            for piece in sorted(reported):
                report(piece, 1.0)

        options: dict[str, Any] = {"root": self.stacks, "backend_name": self.backend}
        try:
            pieces = render_missing(
                self.scene,
                self.time_stack.specs,
                **options,
                wanted=self.wanted,
                others=self.others,
                geometry_first=self.wanted is not None,
                progress=progress,
            )
            report_done()
            if self.measure_grain:
                measure_by_repeat(self.scene, self.time_stack.specs, **options, progress=progress)
                report_done()
            return pieces
        except OSError as error:
            raise unwritable(self.stacks, error) from error

    def _take_in(self, photographed: PictureStack, report: ReportProgress) -> list[str]:
        report(self.name, 0.0)
        try:
            pieces = photographed.take_in(self.time_stack.specs[0], self.stacks)
        except OSError as error:
            raise unwritable(self.stacks, error) from error
        report(self.name, 1.0)
        return pieces


@dataclass(frozen=True)
class MeasureGrainJob:
    """Measures the grain of some slices of a stack of which depth and target of all slices exist."""

    label: str
    scene: Scene
    time_stack: TimeResolvedStack
    stacks: Path
    backend: str
    wanted: tuple[StackSpec, ...]

    @property
    def name(self) -> str:
        return f"measure the grain of {self.label}"

    @property
    def takes_all_cores(self) -> bool:
        return True

    @property
    def wants_gpu(self) -> bool:
        return self.backend == "cuda"

    def run(self, report: ReportProgress) -> None:
        from saf_gen.render.grain import measure_by_repeat

        report(self.name, 0.0)
        try:
            measure_by_repeat(
                self.scene,
                self.time_stack.specs,
                root=self.stacks,
                backend_name=self.backend,
                wanted=self.wanted,
                progress=lambda name, done: report(self.name, COMPUTED_FRACTION * done),
            )
        except OSError as error:
            raise unwritable(self.stacks, error) from error
        report(self.name, 1.0)


@dataclass(frozen=True)
class RecordResult:
    """The result of a job that records a sequence.

    Attributes
    ----------
    content_sha256 : str
        Digest of the content of the recording; '' if it lacks slices.
    kept : bool
        Whether an earlier run had already made the recording.
    lacks_slices : bool, default False
        Whether the recording is not finished, because its file is missing or damaged and its time slices have been
        deleted.
    """

    content_sha256: str
    kept: bool
    lacks_slices: bool = False


@dataclass(frozen=True)
class RecordJob:
    """Records one sequence, unless a recording with the same fingerprint exists and its content matches its digest.

    ``side_by_side`` is the number of recordings that share the cores of a machine, and ``others`` are other stacks of
    the scene with the same parameters. The job fails if their pictures and its own do not show the same scene.
    """

    recorder: Recorder
    sequence: PlannedSequence
    time_stack: TimeResolvedStack
    stacks: Path
    path: Path
    fingerprint: str
    side_by_side: int
    others: tuple[StackSpec, ...] = ()
    wants_gpu = False

    @property
    def name(self) -> str:
        return f"record {self.sequence.id}"

    @property
    def takes_all_cores(self) -> bool:
        return False

    def run(self, report: ReportProgress) -> RecordResult:
        report(self.name, 0.0)
        digest = recording_digest(self.path, self.fingerprint)
        kept = digest is not None
        if digest is None:
            if self.time_stack.is_moving and self.time_stack.find_missing(self.stacks):
                return RecordResult("", kept=False, lacks_slices=True)
            require_same_scene(self.stacks, [*self.time_stack.specs, *self.others])
            try:
                self.path.parent.mkdir(parents=True, exist_ok=True)
                digest = self.recorder.record(
                    self.sequence,
                    PlaneSource.from_folder(self.time_stack, self.stacks),
                    path=self.path,
                    fingerprint=self.fingerprint,
                    threads=max(1, usable_cores() // self.side_by_side),
                    progress=lambda done: report(self.name, COMPUTED_FRACTION * done),
                )
            except OSError as error:
                raise unwritable(self.path, error) from error
        report(self.name, 1.0)
        return RecordResult(digest, kept)


@dataclass(frozen=True)
class DeleteJob:
    """Deletes time slices if every recording made from them can be read back undamaged; returns the bytes freed.

    ``needed_by`` holds the path and fingerprint of each of these recordings, in all shards and splits of the recipe. If
    one of them is missing, damaged or has another fingerprint, nothing is deleted and the result is 0. The notes of the
    slices stay, to show that the recordings were made from them; without recordings, the notes are deleted too.
    """

    label: str
    specs: tuple[StackSpec, ...]
    stacks: Path
    needed_by: tuple[tuple[Path, str], ...]
    wants_gpu = False

    @property
    def name(self) -> str:
        return f"delete time slices of {self.label}"

    @property
    def takes_all_cores(self) -> bool:
        return False

    def run(self, report: ReportProgress) -> int:
        report(self.name, 0.0)
        freed, stores = 0, [StackStore(self.stacks, spec) for spec in self.specs]
        if all(recording_digest(path, fingerprint) for path, fingerprint in self.needed_by):
            try:
                freed = sum(store.delete_pictures() if self.needed_by else store.delete() for store in stores)
            except OSError as error:
                raise undeletable(self.stacks, error) from error
        report(self.name, 1.0)
        return freed


@dataclass(frozen=True)
class ChooseBackendJob:
    """Chooses the backend to render with on the machine on which the job runs.

    ``requested`` is the name of a backend or "auto". The result is the name of the chosen backend, and whether it
    renders diffraction.
    """

    requested: str
    name = "choose the renderer"
    takes_all_cores = False

    @property
    def wants_gpu(self) -> bool:
        return self.requested in ("auto", "cuda")

    def run(self, report: ReportProgress) -> tuple[str, bool]:
        with defer_interrupts():
            from saf_gen.render import backend  # loads Mitsuba, so only when something must be rendered

        chosen = backend.choose_backend(self.requested)
        return chosen, backend.can_render_waves(chosen)


class JobOrder:
    """The order of the jobs that a dataset folder still needs.

    Missing stacks are rendered, and the recordings from each stack follow. A recording whose time slices were deleted
    is read first, and the slices are rendered again only if its file is damaged. Slices that are not to be kept are
    deleted once every recording of the recipe that needs them is made, in all splits.

    A shard renders its slices of cut stacks first. When it has rendered everything, it looks at these stacks again: it
    measures the grain of its own slices if all slices have depth and target, and records what can be recorded.

    Parameters
    ----------
    plan : Plan
        What is missing.
    recorder : Recorder
        Records the sequences.
    workers : int
        Number of sequences that are recorded at a time.
    choose_backend : callable
        Returns the backend to render with; called at most once, when something must be rendered.
    """

    def __init__(self, plan: Plan, recorder: Recorder, *, workers: int, choose_backend: Callable[[], str]) -> None:
        self._plan, self._stacks = plan, plan.folder / "stacks"
        self._recorder, self._workers, self._choose_backend = recorder, workers, choose_backend
        self._ids = frozenset(s.planned.id for s in plan.sequences)
        self._finished: set[str] = set()
        self._rendered_again: set[TimeResolvedStack] = set()
        self._unrendered = set(plan.to_render)

    def first_jobs(self) -> list[Job]:
        """Return the jobs that do not wait for another job."""
        jobs: list[Job] = [self._render_job(stack) for stack in self._plan.to_render]
        for stack in self._plan.by_stack:
            if stack not in self._plan.to_render:
                jobs += self._record_jobs(stack)
        if not self._unrendered:
            jobs += self._jobs_on_cut_stacks()
        return [*jobs, *self._jobs_that_delete_unrecorded()]

    def jobs_after(self, job: Job, result: Any) -> list[Job]:
        """Return the jobs that may start now that ``job`` has succeeded with ``result``."""
        if isinstance(job, RenderJob):
            was_last = self._unrendered == {job.time_stack}
            self._unrendered.discard(job.time_stack)
            return [*self._record_jobs(job.time_stack), *(self._jobs_on_cut_stacks() if was_last else ())]
        if isinstance(job, MeasureGrainJob):
            return self._record_if_whole(job.time_stack)
        if not isinstance(job, RecordJob):
            return []
        if result.lacks_slices:
            if job.time_stack in self._rendered_again or job.time_stack in self._plan.by_cut_stack:
                return []
            self._rendered_again.add(job.time_stack)
            return [self._render_job(job.time_stack)]
        self._finished.add(job.sequence.id)
        return self._jobs_that_delete(job.sequence.id)

    @cached_property
    def _backend(self) -> str:
        return self._choose_backend()

    def _render_job(self, stack: TimeResolvedStack) -> Job:
        user, share = self._plan.users[stack], self._plan.share
        label, measure_grain = user.stack_label(stack), stack in self._plan.by_stack
        backend = PICTURES if isinstance(user.scene, PictureStack) else self._backend
        wanted = self._plan.to_render[stack] if share and stack in share.cut else None
        others = self._others(stack)
        return RenderJob(label, user.scene, stack, self._stacks, backend, measure_grain, wanted, others)

    def _others(self, stack: TimeResolvedStack) -> tuple[StackSpec, ...]:
        """Return the first slices of a few other stacks of the recipe with the scene and parameters of this one."""
        first = stack.specs[0]
        alike = self._alike[first.scene, first.scene_digest, first.params][:MAX_OTHERS]
        return tuple(spec for spec in alike if spec != first)

    @cached_property
    def _alike(self) -> dict[tuple[str, str, str], list[StackSpec]]:
        alike = defaultdict[tuple[str, str, str], list[StackSpec]](list)
        for spec in dict.fromkeys(stack.specs[0] for s in self._plan.resolved.all_sequences for stack in s.stacks):
            alike[spec.scene, spec.scene_digest, spec.params].append(spec)
        return alike

    def _jobs_on_cut_stacks(self) -> list[Job]:
        jobs: list[Job] = []
        for stack in self._plan.by_cut_stack:
            user = self._plan.users[stack]
            if (mine := self._own_slices_without_grain(stack)) and isinstance(user.scene, Scene):
                jobs.append(
                    MeasureGrainJob(user.stack_label(stack), user.scene, stack, self._stacks, self._backend, mine)
                )
            else:
                jobs += self._record_if_whole(stack)
        return jobs

    def _own_slices_without_grain(self, stack: TimeResolvedStack) -> tuple[StackSpec, ...]:
        """Return the slices of this shard whose grain is to be measured; none if that cannot be known yet."""
        if self._plan.share is None or not stack.has_geometry(self._stacks):
            return ()
        mine = [spec for spec in stacks_to_repeat(stack.specs, self._stacks) if spec in self._plan.share.specs]
        return tuple(spec for spec in mine if read_grain(self._stacks, spec) is None)

    def _record_if_whole(self, stack: TimeResolvedStack) -> list[Job]:
        """Return jobs that record from a cut stack if no other shard has slices or grain of it to make any more.

        Two shards that see this at once begin with different sequences, and keep those that the other has made.
        """
        if stack.find_missing(self._stacks) or not stack.has_grain(self._stacks):
            return []
        jobs = self._record_jobs(stack, self._plan.by_cut_stack[stack])
        first = self._plan.resolved.part[0] % max(len(jobs), 1)
        return [*jobs[first:], *jobs[:first]]

    def _record_jobs(self, stack: TimeResolvedStack, users: Sequence[ResolvedSequence] | None = None) -> list[Job]:
        users = self._plan.by_stack.get(stack, []) if users is None else users
        self._finished -= {s.planned.id for s in users}
        digest = stack.digest(self._stacks) if users else ""
        others = self._others(stack) if users else ()
        return [
            RecordJob(
                self._recorder,
                s.planned,
                stack,
                self._stacks,
                self._plan.folder / s.planned.file,
                s.fingerprint(digest),
                self._workers,
                others,
            )
            for s in users
        ]

    def _jobs_that_delete(self, just_finished: str) -> list[Job]:
        """Return jobs that delete each group of slices whose recordings in this run are all made."""
        return [
            self._delete_job(users, specs)
            for users, specs in self._plan.deletable.items()
            if just_finished in users and users & self._ids <= self._finished
        ]

    def _jobs_that_delete_unrecorded(self) -> list[Job]:
        """Return jobs that delete slices of an earlier run that only a closed-loop run would need."""
        specs = [spec for spec in self._plan.deletable.get(frozenset(), []) if (self._stacks / spec.key).exists()]
        return [self._delete_job(frozenset(), specs)] if specs else []

    def _delete_job(self, users: frozenset[str], specs: list[StackSpec]) -> Job:
        needed_by = [s for s in self._plan.resolved.all_sequences if s.planned.id in users]
        label = needed_by[0].planned.label if needed_by else "the closed loop"
        digests = {stack: stack.digest(self._stacks) for stack in {s.time_stack for s in needed_by}}
        files = tuple((self._plan.folder / s.planned.file, s.fingerprint(digests[s.time_stack])) for s in needed_by)
        return DeleteJob(label, tuple(specs), self._stacks, files)
