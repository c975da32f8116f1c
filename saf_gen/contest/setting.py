"""One sequence of the closed loop, ready to be filmed again, and the record of a run on it."""

import hashlib
from dataclasses import dataclass
from typing import Any

from saf_gen.contest.jobs import Job, box_of, check_digest
from saf_gen.contest.loop import Run
from saf_gen.contest.terms import Terms
from saf_gen.contest.verdict import judge_run
from saf_gen.exposed import Exposed
from saf_gen.records import Record
from saf_gen.region import Region, checked_region
from saf_gen.rig.film import rows_of
from saf_gen.stream import SpikeStream
from saf_gen.take import Take

__all__ = ["Setting"]


@dataclass(frozen=True, eq=False)
class Setting:
    """What was in front of the camera, and where methods look: the same for all of them.

    ``box`` has both ends filled in; ``region`` is its name in records, ``data`` the content_sha256,
    and where the time slices are others than those of the recording, a digest of that and theirs.
    ``exposed`` is of the rows that the box needs. Nothing of it holds the stream open.
    """

    job: Job
    take: Take
    box: Region
    region: str
    exposed: Exposed
    data: str

    @classmethod
    def of(cls, job: Job, stream: SpikeStream, region: str) -> "Setting":
        """The setting of an open stream. Raises BadInput where it is not the one that the manifest names, or
        cannot be filmed again."""
        check_digest(job, stream)
        take = Take.of(stream, job.path.parent.parent / "stacks")
        data = stream.content_sha256
        if take.slices:
            data = hashlib.sha256(f"{data} {take.slices}".encode()).hexdigest()
        found, seen = box_of(stream, region)
        box = checked_region(found, stream.shape[1:])
        return cls(job, take, box, seen, take.exposed(rows_of(take, box)), data)

    def record(
        self,
        run: Run,
        terms: Terms,
        *,
        method: str,
        code: str,
        parameters: str,
        tuning: str = "",
        said: dict[str, Any],
    ) -> Record:
        """The record of a method's run. ``said``: see :func:`saf_gen.contest.jobs.given`."""
        verdict = judge_run(run, self.take.truth, self.take.sensor.readout_hz)
        absent = dict.fromkeys(("position", "error", "error_dof", "blur_px", "time_to_focus_s"))
        return Record(
            method=method,
            sequence=self.job.id,
            split=self.job.split,
            scene=self.job.scene,
            light=self.job.light,
            frame=None if run.problem else float(run.answered),
            truth_frame=None,
            error_frames=None,
            trace=tuple(float(x) for x in run.answer.trace),
            frames=run.budget,
            frames_seen=run.answered,
            windows=run.windows,
            seconds=run.seconds,
            note=run.problem or run.answer.note,
            region=self.region,
            data=self.data,
            code=code,
            terms=terms.describe(self.take),
            parameters=parameters,
            tuning=tuning,
            **{**absent, **verdict},
            **said,
        )
