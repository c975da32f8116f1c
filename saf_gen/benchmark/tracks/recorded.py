"""The recorded track, in which every method sees the same recording through a restricted view."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from saf_gen.benchmark.admission import run_method
from saf_gen.benchmark.judgement import Run
from saf_gen.benchmark.method_spec import Method
from saf_gen.benchmark.records import NO_INSIDE, Obstacle, Record, Who
from saf_gen.benchmark.results import FocusCurve, SweepSummary
from saf_gen.benchmark.strata import stratum_in
from saf_gen.benchmark.thumbnails import make_thumbnails
from saf_gen.benchmark.tracks.predictions import Prediction, PredictionSet
from saf_gen.benchmark.tracks.record_of_run import make_record
from saf_gen.benchmark.tracks.sequence_fields import describe_sequence, find_blank, measure_rate
from saf_gen.benchmark.tracks.tasks import SequenceTask, check_stream
from saf_gen.benchmark.view.operations import reference_rate
from saf_gen.benchmark.view.recording import RecordingView, WindowCounts
from saf_gen.core.cores import describe_machine
from saf_gen.errors import BadInput
from saf_gen.parts import Answer, commands
from saf_gen.plugins.searches import REJECT
from saf_gen.stream.measure_input import choose_region, has_region
from saf_gen.stream.optima import optima_of_stream
from saf_gen.stream.recorded_grain import grain_of_stream
from saf_gen.stream.recordings import Recording, open_recording
from saf_gen.stream.stream_file import SpikeStream


def check_leaves_lens(methods: Sequence[Method]) -> None:
    """Raise BadInput if a method commands the lens, which is impossible on a recording."""
    for method in methods:
        if commands(method.search):
            raise BadInput(
                f"method {method.name!r} commands the lens, which is impossible on a recording",
                allowed="searches that estimate on a recording",
                hint="run it with --track closed_loop, or use the search argmax, egs or sgfs_causal",
            )


def evaluate_recorded(
    task: SequenceTask,
    methods: Sequence[Method],
    *,
    region: str,
    rate_region: str,
    step: Callable[[int, str], None],
    predictions: PredictionSet | None = None,
    with_thumbnails: bool = False,
) -> tuple[list[Record], SweepSummary]:
    """Return the records of a sequence, and its data for charts.

    A method that raises an exception or gives an invalid answer gets a record, too, and so does one whose region the
    recording does not have: it does not run.

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
    step : callable
        Called with (methods done, name of the last method).
    predictions : PredictionSet, optional
        Answers that were made elsewhere.
    with_thumbnails : bool, default False
        Whether to make small pictures of the recording.

    Returns
    -------
    records : list of Record
        Records of all methods, followed by those of all predictions.
    sweep : SweepSummary
        Data for charts.

    Raises
    ------
    BadInput
        If the stream cannot be read, or is not the one that the manifest names.
    """
    records: list[Record] = []
    curves: dict[str, FocusCurve] = {}
    with open_recording(task.path) as stream:
        check_stream(task, stream)
        is_there = has_region(stream, region)
        box, region_name = choose_region(stream, region if is_there else "target")
        counts = WindowCounts(stream, box)
        rate = common_rate = measure_rate(counts)
        common_counts = counts
        if rate_region != region:
            usual = rate_region if has_region(stream, rate_region) else "target"
            common_counts = WindowCounts(stream, choose_region(stream, usual)[0])
            common_rate = measure_rate(common_counts)
        blank: Obstacle | None = find_blank(common_counts, common_rate)
        if not is_there:
            region_name, blank = region, blank or NO_INSIDE
        stratum = stratum_in(stream, rate_region)
        what = describe_sequence(task, stream, rate=common_rate, blank=blank, track="recorded", stratum=stratum)
        known: dict[str, Any] = {
            "truth": stream.truth,
            "end_s": lambda frames: (stream.metadata.readout_of(frames - 1) + 1) / stream.readout_hz,
            "optima": optima_of_stream(stream.metadata.provenance, region_name),
            "grain": grain_of_stream(stream.metadata.provenance),
        }
        rate_here = reference_rate(counts.shape)
        for done, method in enumerate(methods, start=1):
            view = RecordingView(counts, None if method.guest else method.measure)
            run = run_recorded(method, view, stream=stream, rate=rate_here) if is_there else _no_run(stream)
            records.append(make_record(run, who=method.who(region_name), what=what, **known))
            blocks_alone = is_there and method.search_name == "argmax" and REJECT not in method.search_options
            if blocks_alone and method.measure_name not in curves and not run.problem:
                curves[method.measure_name] = _make_curve(view, method.measure_name, answer=run.answer)
            step(done, method.name)
        if predictions is not None:
            made = {"parameters": "predicted elsewhere", "machine": describe_machine()}
            for prediction in predictions.for_sequence(task.id):
                who = Who(prediction.method, predictions.code, region_name, **made)
                records.append(make_record(run_of_prediction(prediction, stream), who=who, what=what, **known))
        sweep = SweepSummary(
            sequence=task.id,
            split=task.split,
            scene=task.scene,
            light=task.light,
            focus_position=stream.metadata.lens_position,
            frames=rate[0],
            rate=rate[1],
            truth=stream.truth.position,
            depth_of_focus=stream.truth.depth_of_focus,
            truth_frame=stream.truth.frame,
            curves=tuple(curves.values()),
            track=stream.truth.track,
            scene_motion=task.scene_motion,
            thumbnails=make_thumbnails(stream, box) if with_thumbnails and isinstance(stream, SpikeStream) else None,
        )
        return records, sweep


def run_recorded(method: Method, view: RecordingView, *, stream: Recording, rate: float) -> Run:
    """Let a method search on a recording, and return the run, whatever the method raises or answers."""
    answer, problem = run_method(method, view, scorer=view.scorer, stream_path=str(stream.path))
    if fault := _find_range_fault(answer, view.frames):
        answer, problem = Answer(None, answer.trace), fault
    return Run(
        answer,
        problem,
        _path_of(stream),
        frames_seen=view.now,
        windows=view.scorer.windows,
        seconds=view.scorer.seconds,
        operations=view.scorer.operations,
        reference_rate=rate,
    )


def run_of_prediction(prediction: Prediction, stream: Recording) -> Run:
    """Return the run of a method elsewhere, whose answer fails if it does not fit the recording."""
    frames = stream.shape[0]
    answer = Answer(prediction.frame, prediction.trace, prediction.note)
    problem = prediction.describe_frames_fault(frames) or _find_range_fault(answer, frames)
    return Run(
        Answer(None, answer.trace) if problem else answer,
        problem,
        _path_of(stream),
        frames_seen=min(prediction.frames_seen or frames, frames),
        windows=0,
        seconds=prediction.seconds,
    )


def _no_run(stream: Recording) -> Run:
    note = f"the recording has {NO_INSIDE}"
    return Run(Answer(note=note), "", _path_of(stream), frames_seen=0, windows=0, seconds=0.0)


def _path_of(stream: Recording) -> np.ndarray:
    path = stream.metadata.lens_position
    return np.empty(0) if path is None else path


def _find_range_fault(answer: Answer, frames: int) -> str:
    if answer.frame is None or -0.5 <= answer.frame <= frames - 0.5:
        return ""
    return f"answered frame {answer.frame}, which was not recorded"


def _make_curve(view: RecordingView, measure: str, *, answer: Answer) -> FocusCurve:
    """Return the focus curve that argmax looked at, from scores that have already been computed."""
    blocks = sorted(view.scorer.scores)
    return FocusCurve(
        measure=measure,
        frames=np.array([(first + stop - 1) / 2 for first, stop in blocks]),
        scores=np.array([view.scorer.scores[block] for block in blocks]),
        answer=answer.frame,
    )
