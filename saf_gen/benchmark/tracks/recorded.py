"""The recorded track, in which every method sees the same recording through a restricted view."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from saf_gen.benchmark.admission import run_method
from saf_gen.benchmark.judgement import judge
from saf_gen.benchmark.method_spec import Method
from saf_gen.benchmark.records import BLANK, Record
from saf_gen.benchmark.results import FocusCurve, SweepSummary
from saf_gen.benchmark.search_run import withhold
from saf_gen.benchmark.thumbnails import make_thumbnails
from saf_gen.benchmark.tracks.beside_truth import (
    least_blur_fields,
    optimum_fields,
    sharpness_fields,
    whole_target_fields,
)
from saf_gen.benchmark.tracks.predictions import Prediction, PredictionSet
from saf_gen.benchmark.tracks.sequence_fields import describe_sequence, find_blank, grain_fields, measure_rate
from saf_gen.benchmark.tracks.tasks import SequenceTask, check_stream
from saf_gen.benchmark.view.operations import reference_rate
from saf_gen.benchmark.view.recording import RecordingView, WindowCounts
from saf_gen.errors import BadInput
from saf_gen.parts import Answer, commands
from saf_gen.plugins.searches import REJECT
from saf_gen.stream.measure_input import choose_region
from saf_gen.stream.metadata import Truth
from saf_gen.stream.optima import optima_of_stream
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


@dataclass(frozen=True)
class _Attempt:
    """The answer of a method or a prediction; ``fields`` of its record say whose it is and what it cost."""

    answer: Answer
    problem: str
    fields: dict[str, Any]


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

    A method that raises an exception or gives an invalid answer gets a record, too.

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
    attempts: list[_Attempt] = []
    curves: dict[str, FocusCurve] = {}
    with open_recording(task.path) as stream:
        check_stream(task, stream)
        box, region_name = choose_region(stream, region)
        counts = WindowCounts(stream, box)
        rate = common_rate = measure_rate(counts)
        common_counts = counts
        if rate_region != region:
            common_counts = WindowCounts(stream, choose_region(stream, rate_region)[0])
            common_rate = measure_rate(common_counts)
        common = describe_sequence(
            task, stream, rate=common_rate, blank=find_blank(common_counts, common_rate), track="recorded"
        )
        for done, method in enumerate(methods, start=1):
            view = RecordingView(counts, None if method.guest else method.measure)
            attempt = _run_method(method, view, rate=reference_rate(counts.shape), stream_path=str(stream.path))
            attempts.append(attempt)
            blocks_alone = method.search_name == "argmax" and REJECT not in method.search_options
            if blocks_alone and method.measure_name not in curves and not attempt.problem:
                curves[method.measure_name] = _make_curve(view, method.measure_name, answer=attempt.answer)
            step(done, method.name)
        if predictions is not None:
            attempts += [
                _attempt_from_prediction(prediction, code=predictions.code, frames=stream.shape[0])
                for prediction in predictions.for_sequence(task.id)
            ]
        records = [
            _make_record(
                task,
                attempt,
                stream=stream,
                common={
                    "region": region_name,
                    **grain_fields(stream, attempt.fields["method"], region=region_name),
                    **common,
                },
            )
            for attempt in attempts
        ]
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


def _run_method(method: Method, view: RecordingView, *, rate: float, stream_path: str) -> _Attempt:
    answer, problem = run_method(method, view, scorer=view.scorer, stream_path=stream_path)
    if fault := _find_range_fault(answer, view.frames):
        answer, problem = Answer(None, answer.trace), fault
    fields = {
        **method.record_fields,
        "frames_seen": view.now,
        "windows": view.scorer.windows,
        "seconds": view.scorer.seconds,
        "operations": view.scorer.operations,
        "reference_rate": rate,
    }
    return _Attempt(answer, problem, fields)


def _attempt_from_prediction(prediction: Prediction, *, code: str, frames: int) -> _Attempt:
    answer = Answer(prediction.frame, prediction.trace, prediction.note)
    problem = prediction.describe_frames_fault(frames) or _find_range_fault(answer, frames)
    fields = {
        "method": prediction.method,
        "code": code,
        "parameters": "predicted elsewhere",
        "frames_seen": min(prediction.frames_seen or frames, frames),
        "windows": 0,
        "seconds": prediction.seconds,
    }
    return _Attempt(answer if not problem else Answer(None, answer.trace), problem, fields)


def _find_range_fault(answer: Answer, frames: int) -> str:
    if answer.frame is None or -0.5 <= answer.frame <= frames - 0.5:
        return ""
    return f"answered frame {answer.frame}, which was not recorded"


def _make_record(task: SequenceTask, attempt: _Attempt, *, stream: Recording, common: Mapping[str, Any]) -> Record:
    truth, seen, obstacle = stream.truth, attempt.fields["frames_seen"], common["obstacle"]
    is_blank = obstacle in BLANK
    answer = withhold(attempt.answer, f"the recording has {obstacle}" if is_blank else "")

    def judge_by(truth: Truth, truth_frame: float = math.nan) -> dict[str, Any]:
        judged = asdict(
            judge(
                answer.frame,
                frames_seen=seen,
                focus_position=stream.metadata.lens_position,
                truth=truth.position,
                track=truth.track,
                truth_frame=truth_frame,
                ends=truth.depth_of_focus,
            )
        )
        # A failure must not count as an abstention, which is a success if the focus is out of reach.
        success = (success and not attempt.problem for success in judged.pop("success"))
        half, one, two = (None,) * 3 if is_blank else success
        return judged | {"success_half_dof": half, "success_1dof": one, "success_2dof": two}

    judged = judge_by(truth, truth.frame)
    if not seen:  # the lens of the recording moved, but not for this method
        judged["lens_travel"] = None
    return Record(
        sequence=task.id,
        split=task.split,
        scene=task.scene,
        light=task.light,
        status="failed" if attempt.problem else "abstained" if answer.frame is None else "answered",
        frame=None if answer.frame is None else float(answer.frame),
        trace=tuple(float(x) for x in answer.trace),
        frames=stream.shape[0],
        note=attempt.problem or answer.note,
        data=stream.content_sha256,
        time_to_focus_s=None if answer.frame is None or not seen else _end_s(stream, seen - 1),
        **judged,
        **optimum_fields(
            truth,
            judged["position"],
            method=attempt.fields["method"],
            region=common["region"],
            optima=optima_of_stream(stream.metadata.provenance),
            here=judged["truth"],
        ),
        **sharpness_fields(truth, judged["position"]),
        **whole_target_fields(truth, judged["error"]),
        **least_blur_fields(truth, judge_by),
        **attempt.fields,
        **common,
    )


def _end_s(stream: Recording, frame: int) -> float:
    """Return the seconds from the beginning of a recording to the end of a frame."""
    return (stream.metadata.readout_of(frame) + 1) / stream.readout_hz


def _make_curve(view: RecordingView, measure: str, *, answer: Answer) -> FocusCurve:
    """Return the focus curve that argmax looked at, from scores that have already been computed."""
    blocks = sorted(view.scorer.scores)
    return FocusCurve(
        measure=measure,
        frames=np.array([(first + stop - 1) / 2 for first, stop in blocks]),
        scores=np.array([view.scorer.scores[block] for block in blocks]),
        answer=answer.frame,
    )
