"""The closed-loop track, in which every method moves the lens of a running camera within a budget of time."""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from saf_gen.benchmark.judgement import Run, judged_dof
from saf_gen.benchmark.method_spec import Method
from saf_gen.benchmark.records import NO_INSIDE, UNJUDGED, Record, What, Who
from saf_gen.benchmark.results import LensPath
from saf_gen.benchmark.strata import stratum_in
from saf_gen.benchmark.tracks.closed_loop_run import run_closed_loop
from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol
from saf_gen.benchmark.tracks.record_of_run import make_record
from saf_gen.benchmark.tracks.sequence_fields import describe_sequence, find_blank, measure_rate
from saf_gen.benchmark.tracks.tasks import SequenceTask, check_stream
from saf_gen.benchmark.view.captured import Captured, CapturedReadouts
from saf_gen.benchmark.view.operations import reference_rate
from saf_gen.benchmark.view.recording import WindowCounts
from saf_gen.core.region import Region, region_shape, validate_region
from saf_gen.parts import Answer, commands
from saf_gen.stack.capture import Capture
from saf_gen.stack.light import SceneLight
from saf_gen.stream.measure_input import choose_region, has_region
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
    def from_stream(
        cls, task: SequenceTask, stream: Recording, *, region: str, protocol: ClosedLoopProtocol | None = None
    ) -> "ClosedLoopSequence":
        """Return the sequence of an open stream, for as long as the budget of a protocol where it has no end.

        Raises BadInput if the stream is not the one that the manifest names, or if it cannot be captured again.
        """
        check_stream(task, stream)
        capture = Capture.from_stream(stream, Path(str(task.path)).parent.parent / "stacks")
        if protocol is not None:
            capture = capture.lasting(protocol.longest_frames(capture))
        data = stream.content_sha256
        if capture.slices:
            data = hashlib.sha256(f"{data} {capture.slices}".encode()).hexdigest()
        chosen, region_name = choose_region(stream, region)
        box = validate_region(chosen, stream.shape[1:])
        return cls(task, capture, box, region_name, capture.open_light(capture.rows_for(box)), data)

    def make_captured(self, *, threads: int | None = None) -> Captured:
        """Return an empty store for what the camera captures of the box, with ``threads``, by default one per core."""
        return CapturedReadouts(self.capture, self.light, region=self.box, threads=threads)

    def make_record(self, run: Run, *, who: Who, what: What) -> Record:
        """Return the record of a run."""
        truth, hz = self.capture.truth, self.capture.sensor.readout_hz
        optima = self.capture.optima.get(who.region, {}) if truth.track is None else {}  # the lens takes its own course
        return make_record(run, who=who, what=what, truth=truth, end_s=lambda frames: frames / hz, optima=optima)

    def describe(self, stream: Recording, protocol: ClosedLoopProtocol, *, region: str) -> What:
        """Return what the records of this sequence have in common; ``region`` is that of mean counts and stratum.

        Without a region ``inside``, counts are those of the target, and there is no stratum.
        """
        counts = WindowCounts(stream, choose_region(stream, region if has_region(stream, region) else "target")[0])
        rate = measure_rate(counts)
        return describe_sequence(
            self.task,
            stream,
            rate=rate,
            blank=find_blank(counts, rate),
            track="closed_loop",
            frames=protocol.count_frames(self.capture)[0],
            data=self.data,
            terms=protocol.describe(self.capture),
            stratum=stratum_in(stream, region),
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
        Region of the evaluation, which decides on the mean counts and the stratum in the records.
    protocol : ClosedLoopProtocol
        Protocol of the closed loop.
    step : callable
        Called with (methods done, name of the last method).

    Returns
    -------
    records : list of Record
        One record per method.
    paths : list of LensPath
        One lens path per method; none, and no method runs, if the recording does not have the region.
    """
    records, paths = [], []
    with open_recording(task.path) as stream:
        is_there = has_region(stream, region)
        seen = region if is_there else "target"
        sequence = ClosedLoopSequence.from_stream(task, stream, region=seen, protocol=protocol)
        what = sequence.describe(stream, protocol, region=rate_region)
    if not is_there:
        what = replace(what, obstacle=what.obstacle if what.obstacle in UNJUDGED else NO_INSIDE)
        answer = Answer(note=f"the recording has {NO_INSIDE}")
        run = Run(answer, "", np.zeros(1), frames_seen=0, windows=0, seconds=0.0, commands=(0.0,))
        return [sequence.make_record(run, who=method.who(region), what=what) for method in methods], []
    if not all(commands(method.search) for method in methods):  # methods that do not command the lens need a sweep
        protocol.check_sweep(sequence.capture)
    rate_here = reference_rate(region_shape(sequence.box))
    captured = {commanding: sequence.make_captured() for commanding in (False, True)}  # sweeps share frames
    for done, method in enumerate(methods, start=1):
        run = run_closed_loop(captured[commands(method.search)], method, protocol=protocol)
        run = replace(run, reference_rate=rate_here)
        records.append(sequence.make_record(run, who=method.who(sequence.region), what=what))
        paths.append(_sample_path(sequence, run, method=method.name))
        step(done, method.name)
    return records, paths


def _sample_path(sequence: ClosedLoopSequence, run: Run, *, method: str) -> LensPath:
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
