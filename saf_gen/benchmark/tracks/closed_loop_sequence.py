"""One sequence of the closed loop, ready to be captured again, and the records of runs on it."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from saf_gen.benchmark.records import Record
from saf_gen.benchmark.tracks.closed_loop_judgement import judge_run
from saf_gen.benchmark.tracks.closed_loop_run import ClosedLoopRun
from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol
from saf_gen.benchmark.tracks.sequence_tasks import SequenceTask, check_stream
from saf_gen.benchmark.view.captured_frames import CapturedFrames, rows_in_view
from saf_gen.core.region import Region, validate_region
from saf_gen.stack.capture import Capture
from saf_gen.stack.charge_source import ChargeSource
from saf_gen.stream.measure_input import choose_region
from saf_gen.stream.stream_file import SpikeStream


@dataclass(frozen=True, eq=False)
class ClosedLoopSequence:
    """The scene in front of the camera, and the region where methods look; both are equal for all methods.

    It does not keep the stream open.

    Attributes
    ----------
    task : SequenceTask
        The sequence.
    capture : Capture
        Everything that is needed to record the sequence again.
    box : Region
        Where methods look; both ends of its slices are numbers.
    region : str
        Name of the box in records.
    charge_source : ChargeSource
        Charge of the rows that the box needs.
    data : str
        content_sha256 of the stream, or a digest of stream and time slices if the recording has other time slices.
    """

    task: SequenceTask
    capture: Capture
    box: Region
    region: str
    charge_source: ChargeSource
    data: str

    @classmethod
    def from_stream(cls, task: SequenceTask, stream: SpikeStream, *, region: str) -> "ClosedLoopSequence":
        """Return the sequence of an open stream.

        Raises BadInput if the stream is not the one that the manifest names, or if it cannot be captured again.
        """
        check_stream(task, stream)
        capture = Capture.from_stream(stream, Path(str(task.path)).parent.parent / "stacks")
        data = stream.content_sha256
        if capture.slices:
            data = hashlib.sha256(f"{data} {capture.slices}".encode()).hexdigest()
        chosen, region_name = choose_region(stream, region)
        box = validate_region(chosen, stream.shape[1:])
        charge_source = capture.open_charge_source(rows_in_view(capture, box))
        return cls(task, capture, box, region_name, charge_source, data)

    def make_captured_frames(self, *, threads: int | None = None) -> CapturedFrames:
        """Return an empty store for captured frames of the box; ``threads`` encode them, by default one per core."""
        return CapturedFrames(self.capture, self.charge_source, region=self.box, threads=threads)

    def make_record(
        self,
        run: ClosedLoopRun,
        protocol: ClosedLoopProtocol,
        *,
        method: str,
        code: str,
        parameters: str,
        common: Mapping[str, Any],
        tuning: str = "",
    ) -> Record:
        """Return the record of a method's run.

        Parameters
        ----------
        run : ClosedLoopRun
            The run.
        protocol : ClosedLoopProtocol
            Protocol of the closed loop.
        method, code, parameters : str
            Name of the method, digest of its code, and all its options.
        common : mapping of str to any
            Fields from describe_sequence.
        tuning : str, optional
            Digest of the tuned file that named the method.

        Returns
        -------
        Record
            The record.
        """
        judged = judge_run(run, self.capture.truth, readout_hz=self.capture.sensor.readout_hz)
        unknown = dict.fromkeys(("position", "error", "error_dof", "blur_px", "time_to_focus_s"))
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
            terms=protocol.describe(self.capture),
            parameters=parameters,
            tuning=tuning,
            **{**unknown, **judged},
            **common,
        )
