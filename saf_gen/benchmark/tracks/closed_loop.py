"""The closed-loop track, in which every method moves the lens of a running camera within a budget of time."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from saf_gen.benchmark.judgement import judged_dof
from saf_gen.benchmark.method_spec import Method
from saf_gen.benchmark.records import BLANK, Record
from saf_gen.benchmark.results import LensPath
from saf_gen.benchmark.search_run import withhold
from saf_gen.benchmark.tracks.beside_truth import (
    least_blur_fields,
    optimum_fields,
    sharpness_fields,
    whole_target_fields,
)
from saf_gen.benchmark.tracks.closed_loop_run import ClosedLoopRun, judge_run, run_closed_loop
from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol
from saf_gen.benchmark.tracks.sequence_fields import describe_sequence, find_blank, grain_fields, measure_rate
from saf_gen.benchmark.tracks.tasks import SequenceTask, check_stream
from saf_gen.benchmark.view.captured import Captured, CapturedReadouts
from saf_gen.benchmark.view.operations import reference_rate
from saf_gen.benchmark.view.recording import WindowCounts
from saf_gen.core.region import Region, region_shape, validate_region
from saf_gen.parts import commands
from saf_gen.stack.capture import Capture
from saf_gen.stack.light import SceneLight
from saf_gen.stream.measure_input import choose_region
from saf_gen.stream.metadata import Truth
from saf_gen.stream.recordings import Recording, open_recording

PATH_POINTS = 400
"""Maximum number of points of a lens path that are kept for charts."""


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
    light : SceneLight
        Light in the rows that the box needs.
    data : str
        content_sha256 of the stream, or a digest of stream and time slices if the recording has other time slices.
    """

    task: SequenceTask
    capture: Capture
    box: Region
    region: str
    light: SceneLight
    data: str

    @classmethod
    def from_stream(cls, task: SequenceTask, stream: Recording, *, region: str) -> "ClosedLoopSequence":
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
        return cls(task, capture, box, region_name, capture.open_light(capture.rows_for(box)), data)

    def make_captured(self, *, threads: int | None = None) -> Captured:
        """Return an empty store for what the camera captures of the box, with ``threads``, by default one per core."""
        return CapturedReadouts(self.capture, self.light, region=self.box, threads=threads)

    def make_record(self, run: ClosedLoopRun, protocol: ClosedLoopProtocol, *, known: Mapping[str, Any]) -> Record:
        """Return the record of a run; ``known`` has the fields of the method and those of describe_sequence."""
        obstacle = known["obstacle"]
        if obstacle in BLANK:
            run = replace(run, answer=withhold(run.answer, f"the recording has {obstacle}"))
        truth = self.capture.truth

        def judge_by(truth: Truth) -> dict[str, Any]:
            judged = judge_run(run, truth, readout_hz=self.capture.sensor.readout_hz)
            if obstacle in BLANK:
                judged |= dict.fromkeys(("success_half_dof", "success_1dof", "success_2dof"))
            return judged

        judged = judge_by(truth)
        if not run.windows and not judged["lens_travel"]:  # neither looked nor moved: there is no cost to compare
            judged |= dict.fromkeys(("lens_travel", "time_to_focus_s"))
        unknown = dict.fromkeys(("position", "error", "error_dof", "blur_px", "time_to_focus_s"))
        return Record(
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
            operations=run.operations if run.windows else None,
            note=run.problem or run.answer.note,
            region=self.region,
            data=self.data,
            terms=protocol.describe(self.capture),
            **{**unknown, **judged},
            **optimum_fields(
                truth,
                judged.get("position"),
                method=known["method"],
                region=self.region,
                optima=self.capture.optima if truth.track is None else {},
                here=truth.position,
            ),
            **sharpness_fields(truth, judged.get("position")),
            **whole_target_fields(truth, judged.get("error")),
            **least_blur_fields(truth, judge_by),
            **known,
        )


def evaluate_closed_loop(
    task: SequenceTask,
    methods: Sequence[Method],
    *,
    region: str,
    rate_region: str,
    protocol: ClosedLoopProtocol,
    step: Callable[[int, str], None],
) -> tuple[list[Record], list[LensPath]]:
    """Return the records of a sequence, and the path along which each method moved the lens.

    Parameters
    ----------
    task : SequenceTask
        The sequence.
    methods : sequence of Method
        Methods to run.
    region : str
        Region where the methods look.
    rate_region : str
        Region of the mean counts that are stored in the records as ``mean_rate``.
    protocol : ClosedLoopProtocol
        Protocol of the closed loop.
    step : callable
        Called with (methods done, name of the last method).

    Returns
    -------
    records : list of Record
        One record per method.
    paths : list of LensPath
        One lens path per method.
    """
    records, paths = [], []
    with open_recording(task.path) as stream:
        sequence = ClosedLoopSequence.from_stream(task, stream, region=region)
        counts = WindowCounts(stream, choose_region(stream, rate_region)[0])
        rate = measure_rate(counts)
        blank = find_blank(counts, rate)
        budget = protocol.count_frames(sequence.capture)[0]
        common = describe_sequence(task, stream, rate=rate, blank=blank, track="closed_loop", frames=budget)
        common["reference_rate"] = reference_rate(region_shape(sequence.box))
        if sequence.capture.truth.track is None:  # in a moving scene, the recording has other slices
            common["grain_rms"] = grain_fields(stream)["grain_rms"]
    if not all(commands(method.search) for method in methods):  # methods that do not command the lens need a sweep
        protocol.check_sweep(sequence.capture)
    captured = {commanding: sequence.make_captured() for commanding in (False, True)}  # sweeps share frames
    for done, method in enumerate(methods, start=1):
        run = run_closed_loop(captured[commands(method.search)], method, protocol=protocol)
        records.append(sequence.make_record(run, protocol, known={**method.record_fields, **common}))
        paths.append(_sample_path(sequence, run, method=method.name))
        step(done, method.name)
    return records, paths


def _sample_path(sequence: ClosedLoopSequence, run: ClosedLoopRun, *, method: str) -> LensPath:
    task, truth = sequence.task, sequence.capture.truth
    frames = np.unique(np.linspace(0, len(run.path) - 1, min(len(run.path), PATH_POINTS)).astype(int))
    return LensPath(
        method=method,
        sequence=task.id,
        split=task.split,
        scene=task.scene,
        light=task.light,
        seconds=(frames + 0.5) / sequence.capture.sensor.readout_hz,
        position=run.path[frames],
        truth=np.full(len(frames), truth.position) if truth.track is None else truth.track[frames],
        depth_of_focus=judged_dof(truth.depth_of_focus),
        problem=run.problem,
    )
