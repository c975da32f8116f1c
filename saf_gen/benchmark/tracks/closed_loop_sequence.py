"""One sequence of the closed loop, ready to be filmed again, and the record of a run on it."""

import hashlib
from dataclasses import dataclass
from typing import Any

from saf_gen.benchmark.records import Record
from saf_gen.benchmark.tracks.closed_loop_judgement import judge_closed_loop_run
from saf_gen.benchmark.tracks.closed_loop_run import ClosedLoopRun
from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol
from saf_gen.benchmark.tracks.sequence_tasks import SequenceTask, check_stream_digest, choose_region
from saf_gen.benchmark.view.captured_frames import rows_to_encode
from saf_gen.core.region import Region, validate_region
from saf_gen.stack.capture import Capture
from saf_gen.stack.charge_source import ChargeSource
from saf_gen.stream.stream_file import SpikeStream

__all__ = ["ClosedLoopSequence"]


@dataclass(frozen=True, eq=False)
class ClosedLoopSequence:
    """What was in front of the camera, and where methods look: the same for all of them.

    ``box`` has both ends filled in; ``region`` is its name in records, ``data`` the content_sha256,
    and where the time slices are others than those of the recording, a digest of that and theirs.
    ``exposed`` is of the rows that the box needs. Nothing of it holds the stream open.
    """

    task: SequenceTask
    take: Capture
    box: Region
    region: str
    exposed: ChargeSource
    data: str

    @classmethod
    def from_stream(cls, task: SequenceTask, stream: SpikeStream, region: str) -> "ClosedLoopSequence":
        """The setting of an open stream. Raises BadInput where it is not the one that the manifest names, or
        cannot be filmed again."""
        check_stream_digest(task, stream)
        take = Capture.from_stream(stream, task.path.parent.parent / "stacks")
        data = stream.content_sha256
        if take.slices:
            data = hashlib.sha256(f"{data} {take.slices}".encode()).hexdigest()
        found, seen = choose_region(stream, region)
        box = validate_region(found, stream.shape[1:])
        return cls(task, take, box, seen, take.open_charge_source(rows_to_encode(take, box)), data)

    def make_record(
        self,
        run: ClosedLoopRun,
        protocol: ClosedLoopProtocol,
        *,
        method: str,
        code: str,
        parameters: str,
        tuning: str = "",
        said: dict[str, Any],
    ) -> Record:
        """The record of a method's run. ``said``: see
        :func:`saf_gen.benchmark.tracks.sequence_tasks.given`."""
        verdict = judge_closed_loop_run(run, self.take.truth, self.take.sensor.readout_hz)
        absent = dict.fromkeys(("position", "error", "error_dof", "blur_px", "time_to_focus_s"))
        return Record(
            method=method,
            sequence=self.task.id,
            split=self.task.split,
            scene=self.task.scene,
            light=self.task.light,
            frame=None if run.problem else float(run.answer_frame),
            truth_frame=None,
            error_frames=None,
            trace=tuple(float(x) for x in run.answer.trace),
            frames=run.budget,
            frames_seen=run.answer_frame,
            windows=run.windows,
            seconds=run.seconds,
            note=run.problem or run.answer.note,
            region=self.region,
            data=self.data,
            code=code,
            terms=protocol.describe(self.take),
            parameters=parameters,
            tuning=tuning,
            **{**absent, **verdict},
            **said,
        )
