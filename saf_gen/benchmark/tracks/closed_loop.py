"""The closed-loop track, in which every method moves the lens of a running camera within a budget of time.

On each sequence, the lens starts at the same position for all methods, drawn with the seed of the sequence. A search
that commands the lens then moves it itself. A search that estimates on a recording is given a sweep: the lens goes to
the nearer end of its travel, then towards the other end until the last window that the search looks at, and back to the
answer. The run is judged by the final position of the lens.
"""

import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from saf_gen.benchmark.admission import run_method
from saf_gen.benchmark.judgement import SUCCESS_LIMITS_DOF, judged_dof
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
from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol
from saf_gen.benchmark.tracks.sequence_fields import describe_sequence, find_blank, grain_fields, measure_rate
from saf_gen.benchmark.tracks.tasks import SequenceTask, check_stream
from saf_gen.benchmark.view.captured_events import CapturedEvents
from saf_gen.benchmark.view.captured_exposures import CapturedExposures, clock_of
from saf_gen.benchmark.view.operations import reference_rate
from saf_gen.benchmark.view.recording import WindowCounts
from saf_gen.benchmark.view.running_camera import (
    BudgetSpentError,
    CapturedFrames,
    RunningCamera,
    SweepView,
    rows_in_view,
)
from saf_gen.camera.events import EventSensor
from saf_gen.camera.frames import FrameSensor
from saf_gen.core import seeds
from saf_gen.core.region import Region, region_shape, validate_region
from saf_gen.parts import Answer, commands
from saf_gen.stack.capture import Capture
from saf_gen.stack.charge_source import ChargeSource
from saf_gen.stack.event_capture import recorded_by
from saf_gen.stack.frame_capture import recorded_light
from saf_gen.stack.recapture import light_integrals
from saf_gen.stream.frame_file import FrameFile
from saf_gen.stream.measure_input import choose_region
from saf_gen.stream.metadata import Truth
from saf_gen.stream.recordings import EventRecording, Recording, open_recording

AnyCaptured = CapturedFrames | CapturedExposures | CapturedEvents
SETTLE_TOLERANCE = 1e-4
"""Distance from its last position, as a fraction of the travel, within which the lens counts as settled."""
ARRIVAL_TOLERANCE_DOF = 0.25
"""Distance from its last position, in depths of focus, within which the lens counts as arrived."""
DEFAULT_DEPTH_OF_FOCUS = 0.01
"""Depth of focus, as a fraction of the travel, that is assumed for ARRIVAL_TOLERANCE_DOF if it is unknown."""
PATH_POINTS = 400
"""Maximum number of points of a lens path that are kept for figures."""


@dataclass(frozen=True, eq=False)
class ClosedLoopRun:
    """The result of a method on a running camera.

    Attributes
    ----------
    answer : Answer
        Answer of the method.
    problem : str
        Why the method failed, or ''.
    answer_frame : int
        Frame at which the method was done.
    path : ndarray of float64, shape (n,)
        True lens position at each frame up to the end, as fractions of the travel.
    budget : int
        Budget in frames.
    windows : int
        Number of windows that the method scored or looked at.
    seconds : float
        Computing time of the method, in seconds.
    commanded_positions : tuple of float
        Initial position of the lens, followed by every position to which it was sent.
    operations : float
        Operations that the method declares, of all windows that it scored or looked at.
    """

    answer: Answer
    problem: str
    answer_frame: int
    path: np.ndarray
    budget: int
    windows: int
    seconds: float
    commanded_positions: tuple[float, ...] = ()
    operations: float = 0.0


def start_camera(
    captured: AnyCaptured,
    measure: Callable[..., float] | None,
    *,
    protocol: ClosedLoopProtocol,
    start: float | None = None,
) -> RunningCamera:
    """Return a camera before its first frame, with the lens at ``start``.

    By default, that is the start position of all methods on this sequence, which its seed draws. Raises BadInput if the
    protocol does not suit the recording.
    """
    capture = captured.capture
    if start is None:
        start = float(seeds.make_generator(capture.seed, "closed loop", "start").uniform(0, 1))
    return RunningCamera(
        captured,
        measure,
        actuator=protocol.actuator,
        start=start,
        seed=seeds.derive_seed(capture.seed, "closed loop", "lens"),
        budget=protocol.count_frames(capture)[0],
        clock=clock_of(capture),
        operations_per_s=protocol.operations_per_s,
    )


def finish_run(
    camera: RunningCamera, answer: Answer, *, to: float | None, budget: int, problem: str = ""
) -> ClosedLoopRun:
    """Let the lens settle at ``to`` (unless that is None), and return the run of a method that is done.

    If the focal stacks could not be read, the error of the camera is raised even if the method caught it.
    """
    if camera.stack_error is not None:
        raise camera.stack_error
    answer_frame = camera.now
    if to is not None:
        camera.move(to)
        with suppress(BudgetSpentError):  # the lens is then judged by its position at the end of the budget
            camera.settle(SETTLE_TOLERANCE)
    return ClosedLoopRun(
        answer=answer,
        problem=problem,
        answer_frame=answer_frame,
        path=camera.path[: camera.now].copy(),
        budget=budget,
        windows=camera.scorer.windows,
        seconds=camera.scorer.seconds,
        commanded_positions=tuple(camera.commanded_positions),
        operations=camera.scorer.operations,
    )


def explain_spent_budget(budget: int) -> str:
    """Return the reason for failure of a method that spent its budget, in frames, without an answer."""
    return f"the budget of {budget} frames was spent"


def run_closed_loop(
    captured: AnyCaptured, method: Method, *, protocol: ClosedLoopProtocol, start: float | None = None
) -> ClosedLoopRun:
    """Let a method search for the focus, and return the run, whatever the method raises or answers.

    ``captured`` may come from an earlier run, whose frames are reused as long as they are the same. ``start`` is that
    of :func:`start_camera`. Raises BadInput if the protocol does not suit the recording, and the error of the focal
    stacks if they cannot be read.
    """
    budget, sweep = protocol.count_frames(captured.capture)
    camera = start_camera(captured, None if method.guest else method.measure, protocol=protocol, start=start)
    try:
        if commands(method.search):
            answer, to, problem = _run_commanding_search(camera, method)
        else:
            answer, to, problem = _run_estimating_search(camera, method, sweep=sweep)
    except BudgetSpentError:
        return finish_run(camera, Answer(), to=None, budget=budget, problem=explain_spent_budget(budget))
    return finish_run(camera, answer, to=to, budget=budget, problem=problem)


def _run_commanding_search(camera: RunningCamera, method: Method) -> tuple[Answer, float | None, str]:
    """Run a search that moves the lens itself; return its answer, the final lens command, and the problem or ''."""
    answer, problem = run_method(method, camera, scorer=camera.scorer)
    return answer, _clip_to_travel(answer.position), problem


def _run_estimating_search(camera: RunningCamera, method: Method, *, sweep: int) -> tuple[Answer, float | None, str]:
    """Run a search on a sweep of ``sweep`` frames; return its answer, the final lens command, and the problem or ''."""
    begin, end = (0.0, 1.0) if camera.commanded_positions[0] < 0.5 else (1.0, 0.0)
    camera.move(begin)
    camera.settle()
    view = SweepView(camera, begin=begin, end=end, frames=sweep)
    answer, problem = run_method(method, view, scorer=camera.scorer)
    camera.commanded_trajectory = None
    if answer.frame is None:
        return answer, None, problem
    if not -0.5 <= answer.frame <= view.frames - 0.5:
        return Answer(), None, f"answered frame {answer.frame}, which is not in the sweep"
    return answer, _clip_to_travel(view.position_at(answer.frame)), ""


def _clip_to_travel(position: float | None) -> float | None:
    """Return a position clipped to 0...1, because a noisy position sensor may read a little outside the travel."""
    return None if position is None else min(max(float(position), 0.0), 1.0)


def judge_run(run: ClosedLoopRun, truth: Truth, *, readout_hz: float) -> dict[str, Any]:
    """Return the fields of a record that depend on the lens; None means unknown.

    Errors (in travels and in depths of focus) and blur compare the last position of the lens with the truth at that
    moment. An abstention is a success if no position in the travel is within the limit. ``time_to_focus_s`` ends when
    the lens has arrived for good, that is, within a quarter of the depth of focus of its last position.
    """
    path = run.path
    answered = not run.problem and (run.answer.position is not None or run.answer.frame is not None)
    last = len(path) - 1
    track = truth.track
    best = float(track[min(last, len(track) - 1)]) if track is not None and last >= 0 else truth.position
    best_known = math.isfinite(best)
    dof = judged_dof(truth.depth_of_focus)
    fields: dict[str, Any] = {
        "truth": best if best_known else None,
        "lens_travel": float(np.abs(np.diff(path)).sum()),
        "reversals": count_reversals(run.commanded_positions),
        "status": "failed" if run.problem else "answered" if answered else "abstained",
    }
    success: tuple[bool | None, ...] = (None,) * len(SUCCESS_LIMITS_DOF)
    if run.problem:
        success = (False,) * len(SUCCESS_LIMITS_DOF) if best_known and dof is not None else success
    elif not answered:
        if best_known and dof is not None:
            distance = max(0.0, -best, best - 1) / dof
            success = tuple(distance > limit for limit in SUCCESS_LIMITS_DOF)
    else:
        position = float(path[-1])
        fields["position"] = position
        near = ARRIVAL_TOLERANCE_DOF * (DEFAULT_DEPTH_OF_FOCUS if dof is None else dof)
        off = np.flatnonzero(np.abs(path[run.answer_frame :] - position) > near)
        arrived = run.answer_frame + (int(off[-1]) + 1 if off.size else 0)
        fields["time_to_focus_s"] = arrived / readout_hz
        if best_known:
            fields["error"] = position - best
            if dof is not None:
                fields["error_dof"] = fields["error"] / dof
                fields["blur_px"] = 2 * abs(fields["error_dof"])
                success = tuple(abs(fields["error_dof"]) <= limit for limit in SUCCESS_LIMITS_DOF)
    fields["success_half_dof"], fields["success_1dof"], fields["success_2dof"] = success
    return fields


def count_reversals(positions: Sequence[float]) -> int:
    """Return the number of times that a lens changes direction if it is sent to these positions in turn."""
    directions = np.sign(np.diff(positions))
    directions = directions[directions != 0]
    return int((directions[1:] != directions[:-1]).sum())


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
    light : sequence of callable
        Integrals of the gains of the lamps over time, in seconds, for a camera of frames or events; else empty.
    event_sensor : EventSensor or None
        The camera, if it is an event camera.
    """

    task: SequenceTask
    capture: Capture
    box: Region
    region: str
    charge_source: ChargeSource
    data: str
    light: Sequence[Callable[[np.ndarray], np.ndarray]] = ()
    event_sensor: EventSensor | None = None

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
        if isinstance(stream, EventRecording):
            groups, seconds = capture.plane_source.time_stack.specs[0].groups, stream.shape[0] / stream.readout_hz
            light, sensor = light_integrals(stream, groups, duration_s=seconds), recorded_by(stream)
            return cls(task, capture, box, region_name, capture.open_charge_source(), data, light, sensor)
        charge_source = capture.open_charge_source(rows_in_view(capture, box))
        light = recorded_light(stream, capture) if isinstance(stream, FrameFile) else []
        return cls(task, capture, box, region_name, charge_source, data, light)

    def make_captured_frames(self, *, threads: int | None = None) -> AnyCaptured:
        """Return an empty store for what the camera captures of the box, with ``threads``, by default one per core."""
        if self.event_sensor is not None:
            return CapturedEvents(
                self.capture, self.charge_source, sensor=self.event_sensor, integrals=self.light, region=self.box,
                threads=threads,
            )  # fmt: skip
        if isinstance(self.capture.sensor, FrameSensor):
            return CapturedExposures(self.capture, self.charge_source, integrals=self.light, region=self.box)
        return CapturedFrames(self.capture, self.charge_source, region=self.box, threads=threads)

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
    captured = {commanding: sequence.make_captured_frames() for commanding in (False, True)}  # sweeps share frames
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
