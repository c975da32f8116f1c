"""The two kinds of work of a dataset, as values that can be sent to another process."""

import errno
from dataclasses import dataclass
from pathlib import Path

from saf_gen.errors import BadInput
from saf_gen.generate.executor import ReportProgress
from saf_gen.generate.plan import PlannedSequence
from saf_gen.generate.recorder import Recorder
from saf_gen.scene.scene_folder import Scene
from saf_gen.stack.time_resolved import PlaneSource, TimeResolvedStack
from saf_gen.stream.stream_file import open_stream

__all__ = ["RecordJob", "RecordResult", "RenderJob"]


@dataclass(frozen=True)
class RenderJob:
    """Render what a time_stack lacks; gives the names of the pieces rendered. ``take`` says what is
    filmed."""

    label: str
    scene: Scene
    time_stack: TimeResolvedStack
    stacks: Path
    variant: str
    threads: int

    @property
    def name(self) -> str:
        return f"render {self.label}"

    @property
    def takes_all_cores(self) -> bool:
        return True

    def run(self, report: ReportProgress) -> list[str]:
        from saf_gen.render import render_missing  # only a process that renders pays for loading Mitsuba

        def told(piece: str, done: float) -> None:
            report(f"{self.name} · {piece}", done)

        try:
            return render_missing(
                self.scene,
                self.time_stack.specs,
                self.stacks,
                backend_name=self.variant,
                threads=self.threads,
                progress=told,
            )
        except OSError as error:
            raise _disk_error(error, self.stacks) from error


@dataclass(frozen=True)
class RecordResult:
    """What became of a sequence: its digest, and whether an earlier run had already made it."""

    content_sha256: str
    kept: bool


@dataclass(frozen=True)
class RecordJob:
    """Make one sequence, or find it made: same fingerprint, and a digest that still holds."""

    recorder: Recorder
    sequence: PlannedSequence
    time_stack: TimeResolvedStack
    stacks: Path
    path: Path
    fingerprint: str
    threads: int

    @property
    def name(self) -> str:
        return f"record {self.sequence.id}"

    @property
    def takes_all_cores(self) -> bool:
        return False

    def run(self, report: ReportProgress) -> RecordResult:
        report(self.name, 0.0)
        digest = _digest_if_whole(self.path, self.fingerprint)
        kept = digest is not None
        if digest is None:
            try:
                self.path.parent.mkdir(parents=True, exist_ok=True)
                digest = self.recorder.record(
                    self.sequence,
                    PlaneSource.from_folder(self.time_stack, self.stacks),
                    self.path,
                    fingerprint=self.fingerprint,
                    threads=self.threads,
                    progress=lambda done: report(self.name, done),
                )
            except OSError as error:
                raise _disk_error(error, self.path) from error
        report(self.name, 1.0)
        return RecordResult(digest, kept)


def _digest_if_whole(path: Path, fingerprint: str) -> str | None:
    """The digest of a finished file of this very sequence; None where there is none, or it is damaged."""
    if not path.is_file():
        return None
    try:
        with open_stream(path) as stream:
            if stream.metadata.provenance.get("fingerprint") != fingerprint:
                return None
            stream.verify()
            return stream.content_sha256
    except BadInput:
        return None


def _disk_error(error: OSError, path: Path) -> BadInput:
    if error.errno == errno.ENOSPC:
        return BadInput(
            f"no space left to write {path}", hint="free some and run the same command: it goes on"
        )
    return BadInput(f"{path} cannot be written: {error.strerror or error}")
