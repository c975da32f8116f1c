"""The closed-loop track, in which every method moves the lens of a running camera."""

from collections.abc import Callable, Sequence

import numpy as np

from saf_gen.benchmark.judgement import judged_dof
from saf_gen.benchmark.method_spec import Method
from saf_gen.benchmark.records import Record
from saf_gen.benchmark.results import LensPath
from saf_gen.benchmark.tracks.closed_loop_run import ClosedLoopRun, run_closed_loop
from saf_gen.benchmark.tracks.closed_loop_sequence import ClosedLoopSequence
from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol
from saf_gen.benchmark.tracks.recorded_grain_fields import grain_fields
from saf_gen.benchmark.tracks.sequence_tasks import SequenceTask, describe_sequence, measure_rate
from saf_gen.benchmark.view import WindowCounts
from saf_gen.parts import commands
from saf_gen.stream.measure_input import choose_region
from saf_gen.stream.stream_file import open_stream

PATH_POINTS = 400
"""Maximum number of points of a lens path that are kept for figures."""


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
    with open_stream(task.path) as stream:
        sequence = ClosedLoopSequence.from_stream(task, stream, region=region)
        rate = measure_rate(WindowCounts(stream, choose_region(stream, rate_region)[0]))
        budget = protocol.count_frames(sequence.capture)[0]
        common = describe_sequence(task, stream, rate=rate, track="closed_loop", frames=budget)
        if sequence.capture.truth.track is None:  # in a moving scene, the recording has other slices
            common["grain_rms"] = grain_fields(stream)["grain_rms"]
    if not all(commands(method.search) for method in methods):  # methods that do not command the lens need a sweep
        protocol.check_sweep(sequence.capture)
    captured = {commanding: sequence.make_captured_frames() for commanding in (False, True)}  # sweeps share frames
    for done, method in enumerate(methods, start=1):
        run = run_closed_loop(captured[commands(method.search)], method, protocol=protocol)
        records.append(
            sequence.make_record(
                run,
                protocol,
                method=method.name,
                code=method.code,
                parameters=method.parameters,
                tuning=method.tuning,
                common=common,
            )
        )
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
