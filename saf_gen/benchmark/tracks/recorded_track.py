"""The recorded track: every method sees the same recording through a narrow view."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from saf_gen.benchmark.judgement import judge_answer
from saf_gen.benchmark.method_spec import Method
from saf_gen.benchmark.records import Record
from saf_gen.benchmark.results import FocusCurve, SweepSummary
from saf_gen.benchmark.thumbnails import make_thumbnails
from saf_gen.benchmark.tracks.predictions import Prediction, PredictionSet
from saf_gen.benchmark.tracks.search_run import run_search
from saf_gen.benchmark.tracks.sequence_tasks import (
    SequenceTask,
    check_stream_digest,
    choose_region,
    describe_sequence,
    measure_mean_rate,
)
from saf_gen.benchmark.view import RecordingView, WindowCounts
from saf_gen.errors import BadInput
from saf_gen.parts import Answer, Measure, commands
from saf_gen.stream.stream_file import SpikeStream, open_stream

__all__ = ["check_no_lens_commands", "run_recorded_sequence"]


def check_no_lens_commands(chosen: Sequence[Method]) -> None:
    for method in chosen:
        if commands(method.search):
            raise BadInput(
                f"method {method.name!r} commands the lens, and a recording is over",
                allowed="searches that estimate on a recording",
                hint="run it with --track closed_loop, or search with argmax, egs or sgfs_causal",
            )


class _Watched(RecordingView):
    """A recording that remembers what it was asked: the focus curves come from it at no cost."""

    def __init__(self, counts: WindowCounts, measure: Measure) -> None:
        super().__init__(counts, measure)
        self.asked: dict[tuple[int, int], float] = {}

    def score(self, first: int, stop: int, measure: str | None = None) -> float:
        score = super().score(first, stop, measure)
        if measure is None:
            self.asked[first, stop] = score
        return score


@dataclass(frozen=True)
class _Attempt:
    """What somebody made of a recording, and at what cost."""

    method: str
    code: str
    parameters: str
    answer: Answer
    problem: str
    frames_seen: int
    windows: int = 0
    seconds: float = 0.0
    tuning: str = ""


def run_recorded_sequence(
    task: SequenceTask,
    methods: Sequence[Method],
    region: str,
    step: Callable[[int, str], None],
    predictions: PredictionSet | None = None,
    *,
    light_in: str | None = None,
    film: bool = False,
) -> tuple[list[Record], SweepSummary]:
    """The records of a sequence, of all methods and then of all predictions, and what its figures need.

    ``light_in`` is the region whose mean counts are told of the sequence, by default ``region``.
    ``film``: with small pictures of the sweep.

    Whatever a method raises or answers is in its record. Raises BadInput for a stream that cannot be read or
    is not the one that is listed.
    """
    attempts, curves = [], {}
    with open_stream(task.path) as stream:
        check_stream_digest(task, stream)
        box, seen_region = choose_region(stream, region)
        counts = WindowCounts(stream, region=box)
        light = measure_mean_rate(counts)
        told = light
        if light_in is not None and light_in != region:
            told = measure_mean_rate(WindowCounts(stream, region=choose_region(stream, light_in)[0]))
        said = {"region": seen_region, **describe_sequence(task, stream, told, "recorded")}
        for done, method in enumerate(methods):
            watched = _Watched(counts, method.measure)
            attempt = _attempt(method, watched, str(stream.path))
            attempts.append(attempt)
            if method.search_name == "argmax" and method.measure_name not in curves and not attempt.problem:
                curves[method.measure_name] = _curve(method.measure_name, watched.asked, attempt.answer.frame)
            step(done + 1, method.name)
        for prediction in predictions.for_sequence(task.id) if predictions else ():
            attempts.append(_predicted(prediction, predictions.code if predictions else "", stream))
        records = [_record(task, attempt, stream, said) for attempt in attempts]
        sweep = _sweep(task, stream, light, curves)
        if film:
            sweep = replace(sweep, thumbnails=make_thumbnails(stream, box))
        return records, sweep


def _attempt(method: Method, recording: _Watched, data: str) -> _Attempt:
    answer, problem = run_search(method.search, recording, scorer=recording.scorer, data=data)
    if out := _out_of(answer, recording.frames):
        answer, problem = Answer(None, answer.trace), out
    return _Attempt(
        method=method.name,
        code=method.code,
        parameters=f"{method.measure!r} + {method.search!r}",
        answer=answer,
        problem=problem,
        frames_seen=recording.frames_seen,
        windows=recording.windows,
        seconds=recording.seconds,
        tuning=method.tuning,
    )


def _predicted(prediction: Prediction, code: str, stream: SpikeStream) -> _Attempt:
    answer = Answer(prediction.frame, prediction.trace, prediction.note)
    frames = stream.shape[0]
    problem = prediction.describe_frames_fault(frames) or _out_of(answer, frames)
    return _Attempt(
        method=prediction.method,
        code=code,
        parameters="predicted elsewhere",
        answer=answer if not problem else Answer(None, answer.trace),
        problem=problem,
        frames_seen=min(prediction.frames_seen or frames, frames),
        seconds=prediction.seconds,
    )


def _out_of(answer: Answer, frames: int) -> str:
    if answer.frame is None or -0.5 <= answer.frame <= frames - 0.5:
        return ""
    return f"answered frame {answer.frame}, which was not recorded"


def _record(task: SequenceTask, attempt: _Attempt, stream: SpikeStream, said: Mapping[str, Any]) -> Record:
    truth, answer = stream.truth, attempt.answer
    verdict = judge_answer(
        answer.frame,
        frames_seen=attempt.frames_seen,
        focus_position=stream.focus_position,
        truth=truth.position,
        track=truth.track,
        truth_frame=truth.frame,
        ends=truth.depth_of_focus,
    )
    # A failure must not pass for the abstention that is right where the focus lies outside the travel.
    half, one, two = (s and not attempt.problem for s in verdict.success)
    return Record(
        method=attempt.method,
        sequence=task.id,
        split=task.split,
        scene=task.scene,
        light=task.light,
        status="failed" if attempt.problem else "abstained" if answer.frame is None else "answered",
        position=verdict.position,
        frame=None if answer.frame is None else float(answer.frame),
        truth=verdict.truth,
        truth_frame=verdict.truth_frame,
        error=verdict.error,
        error_frames=verdict.error_frames,
        error_dof=verdict.error_dof,
        blur_px=verdict.blur_px,
        success_half_dof=half,
        success_1dof=one,
        success_2dof=two,
        trace=tuple(float(x) for x in answer.trace),
        frames=stream.shape[0],
        frames_seen=attempt.frames_seen,
        lens_travel=verdict.lens_travel,
        windows=attempt.windows,
        seconds=attempt.seconds,
        note=attempt.problem or answer.note,
        data=stream.content_sha256,
        code=attempt.code,
        time_to_focus_s=None if answer.frame is None else attempt.frames_seen / stream.readout_hz,
        parameters=attempt.parameters,
        tuning=attempt.tuning,
        **said,
    )


def _curve(measure: str, asked: Mapping[tuple[int, int], float], answer: float | None) -> FocusCurve:
    blocks = sorted(asked)
    return FocusCurve(
        measure,
        np.array([(first + stop - 1) / 2 for first, stop in blocks]),
        np.array([asked[block] for block in blocks]),
        answer,
    )


def _sweep(
    task: SequenceTask,
    stream: SpikeStream,
    light: tuple[np.ndarray, np.ndarray],
    curves: Mapping[str, FocusCurve],
) -> SweepSummary:
    return SweepSummary(
        sequence=task.id,
        split=task.split,
        scene=task.scene,
        light=task.light,
        focus_position=stream.focus_position,
        frames=light[0],
        rate=light[1],
        truth=stream.truth.position,
        depth_of_focus=stream.truth.depth_of_focus,
        truth_frame=stream.truth.frame,
        curves=tuple(curves.values()),
        track=stream.truth.track,
        scene_motion=task.scene_motion,
    )
