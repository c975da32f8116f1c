"""The kinds of work of a dataset, as values that can be sent to another process."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from saf_gen.core.cores import defer_interrupts, usable_cores
from saf_gen.core.execution import ReportProgress
from saf_gen.core.files import undeletable_file_error, unwritable_file_error
from saf_gen.generate.plan import PlannedSequence
from saf_gen.generate.recorder import Recorder
from saf_gen.generate.recordings import digest_generated_recording
from saf_gen.scene.scene_folder import Scene
from saf_gen.stack.focal_stack import StackSpec, StackStore
from saf_gen.stack.time_resolved import PlaneSource, TimeResolvedStack

ALMOST = 0.99
"""How far a piece of work is when all is computed; it is done, 1, when its files have their names."""


@dataclass(frozen=True)
class RenderJob:
    """Renders what a time-resolved stack lacks on disk, and returns the names of the pieces rendered.

    ``label`` names the stack in messages, ``stacks`` is the folder of stacks, ``backend`` renders. ``measure_grain``
    measures the grain of what is stored, too.
    """

    label: str
    scene: Scene
    time_stack: TimeResolvedStack
    stacks: Path
    backend: str
    measure_grain: bool = True

    @property
    def name(self) -> str:
        return f"render {self.label}"

    @property
    def takes_all_cores(self) -> bool:
        return True

    @property
    def wants_gpu(self) -> bool:
        return self.backend == "cuda"

    def run(self, report: ReportProgress) -> list[str]:
        from saf_gen.render import render_missing_stacks  # only a process that renders pays for loading Mitsuba
        from saf_gen.render.second_render import measure_grain_by_second_render

        told: set[str] = set()

        def progress(piece: str, done: float) -> None:
            told.add(f"{self.name} · {piece}")
            report(f"{self.name} · {piece}", ALMOST * done)

        def tell_done() -> None:
            for piece in sorted(told):
                report(piece, 1.0)

        options: dict[str, Any] = {"root": self.stacks, "backend_name": self.backend}
        try:
            pieces = render_missing_stacks(self.scene, self.time_stack.specs, **options, progress=progress)
            tell_done()
            if self.measure_grain:
                measure_grain_by_second_render(self.scene, self.time_stack.specs, **options, progress=progress)
                tell_done()
            return pieces
        except OSError as error:
            raise unwritable_file_error(self.stacks, error) from error


@dataclass(frozen=True)
class RecordResult:
    """A finished sequence: the digest of its content, and whether an earlier run had already made it.

    With ``lacks_slices`` it is not finished: its file is damaged, and the time slices have been deleted meanwhile.
    """

    content_sha256: str
    kept: bool
    lacks_slices: bool = False


@dataclass(frozen=True)
class RecordJob:
    """Records one sequence, or finds it recorded: same fingerprint, and content that matches its digest.

    ``side_by_side`` jobs have the cores of the machine that runs them.
    """

    recorder: Recorder
    sequence: PlannedSequence
    time_stack: TimeResolvedStack
    stacks: Path
    path: Path
    fingerprint: str
    side_by_side: int
    wants_gpu = False

    @property
    def name(self) -> str:
        return f"record {self.sequence.id}"

    @property
    def takes_all_cores(self) -> bool:
        return False

    def run(self, report: ReportProgress) -> RecordResult:
        report(self.name, 0.0)
        digest = digest_generated_recording(self.path, self.fingerprint)
        kept = digest is not None
        if digest is None:
            if self.time_stack.is_moving and self.time_stack.find_missing(self.stacks):
                return RecordResult("", kept=False, lacks_slices=True)
            try:
                self.path.parent.mkdir(parents=True, exist_ok=True)
                digest = self.recorder.record(
                    self.sequence,
                    PlaneSource.from_folder(self.time_stack, self.stacks),
                    path=self.path,
                    fingerprint=self.fingerprint,
                    threads=max(1, usable_cores() // self.side_by_side),
                    progress=lambda done: report(self.name, ALMOST * done),
                )
            except OSError as error:
                raise unwritable_file_error(self.path, error) from error
        report(self.name, 1.0)
        return RecordResult(digest, kept)


@dataclass(frozen=True)
class DeleteJob:
    """Deletes time slices once every recording made from them has been read back and is whole; returns the bytes freed.

    ``needed_by`` are path and fingerprint of these recordings: of the whole recipe, not of one shard or split alone.
    If one of them is missing, damaged or another, nothing is deleted and the result is 0. The notes of slices stay, so
    that their recordings are known to be made from them; where there are no recordings, notes go too.
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
        if all(digest_generated_recording(path, fingerprint) for path, fingerprint in self.needed_by):
            try:
                freed = sum(store.delete_pictures() if self.needed_by else store.delete() for store in stores)
            except OSError as error:
                raise undeletable_file_error(self.stacks, error) from error
        report(self.name, 1.0)
        return freed


@dataclass(frozen=True)
class ChooseBackendJob:
    """Chooses the backend to render with, of those ``requested``, where it runs.

    Returns its name, and whether it renders diffraction.
    """

    requested: str
    name = "choose the renderer"
    takes_all_cores = False

    @property
    def wants_gpu(self) -> bool:
        return self.requested in ("auto", "cuda")

    def run(self, report: ReportProgress) -> tuple[str, bool]:
        with defer_interrupts():
            from saf_gen.render import backend  # loads Mitsuba: only where something must be rendered

        chosen = backend.choose_render_backend(self.requested)
        return chosen, backend.can_render_waves(chosen)
