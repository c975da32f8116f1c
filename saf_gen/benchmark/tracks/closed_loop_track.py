"""The records of the closed-loop track: every method moves the lens of a running camera."""

from collections.abc import Callable, Sequence

import numpy as np

from saf_gen.benchmark.judgement import depth_of_focus
from saf_gen.benchmark.method_spec import Method
from saf_gen.benchmark.records import Record
from saf_gen.benchmark.results import LensPath
from saf_gen.benchmark.tracks.closed_loop_run import ClosedLoopRun, run_closed_loop_method
from saf_gen.benchmark.tracks.closed_loop_sequence import ClosedLoopSequence
from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol
from saf_gen.benchmark.tracks.sequence_tasks import (
    SequenceTask,
    choose_region,
    describe_sequence,
    measure_mean_rate,
)
from saf_gen.benchmark.view import WindowCounts
from saf_gen.parts import commands
from saf_gen.stack.capture import Capture
from saf_gen.stream.stream_file import open_stream

__all__ = ["run_closed_loop_sequence"]

PATH_POINTS = 400


def run_closed_loop_sequence(
    task: SequenceTask,
    methods: Sequence[Method],
    region: str,
    protocol: ClosedLoopProtocol,
    step: Callable[[int, str], None],
    *,
    light_in: str,
) -> tuple[list[Record], list[LensPath]]:
    """The records of a sequence, and where each method took the lens.

    ``light_in`` is the region whose mean counts are told of the sequence.
    """
    records, paths = [], []
    with open_stream(task.path) as stream:
        setting = ClosedLoopSequence.from_stream(task, stream, region)
        light = measure_mean_rate(WindowCounts(stream, region=choose_region(stream, light_in)[0]))
        said = describe_sequence(
            task, stream, light, "closed_loop", frames=protocol.count_frames(setting.take)[0]
        )
    if not all(commands(method.search) for method in methods):  # the others are given a sweep
        protocol.check_sweep(setting.take)
    for done, method in enumerate(methods):
        run = run_closed_loop_method(setting.take, setting.exposed, setting.box, method, protocol)
        records.append(
            setting.make_record(
                run,
                protocol,
                method=method.name,
                code=method.code,
                parameters=f"{method.measure!r} + {method.search!r}",
                tuning=method.tuning,
                said=said,
            )
        )
        paths.append(_lens_path(task, method.name, run, setting.take))
        step(done + 1, method.name)
    return records, paths


def _lens_path(task: SequenceTask, method: str, run: ClosedLoopRun, take: Capture) -> LensPath:
    frames = np.unique(np.linspace(0, len(run.path) - 1, min(len(run.path), PATH_POINTS)).astype(int))
    truth = take.truth
    best = np.full(len(frames), truth.position) if truth.track is None else truth.track[frames]
    return LensPath(
        method=method,
        sequence=task.id,
        split=task.split,
        scene=task.scene,
        light=task.light,
        seconds=(frames + 0.5) / take.sensor.readout_hz,
        position=run.path[frames],
        truth=best,
        depth_of_focus=depth_of_focus(truth.depth_of_focus),
        problem=run.problem,
    )
