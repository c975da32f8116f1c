"""Runs methods over recordings: every sequence of a dataset, or one stream, gives one record per method.

A method is a focus measure and a search. It sees windows of the recording through a narrow view; truth, cost
and score stay with the evaluator, in the folder ``tracks``. A stream without truth is searched all the same.
"""

from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from saf_gen.benchmark.kept_sequences import KeptSequences
from saf_gen.benchmark.method_spec import DEFAULT_CLOSED_LOOP_METHODS, DEFAULT_RECORDED_METHODS
from saf_gen.benchmark.plugin_description import describe_plugins_of_methods
from saf_gen.benchmark.results import Drawn, Evaluation, SequenceFailure
from saf_gen.benchmark.sequence_evaluation import (
    EvaluateJob,
    MethodGroups,
    NamedMethods,
    evaluate_sequence,
    group_methods_by_region,
    parse_methods,
)
from saf_gen.benchmark.thumbnails import select_evaluated_to_show
from saf_gen.benchmark.tracks.predictions import PredictionSet, read_method_predictions
from saf_gen.benchmark.tracks.recorded_track import check_method_leaves_lens
from saf_gen.benchmark.tracks.sequence_tasks import SequenceTask, list_sequences_to_evaluate
from saf_gen.benchmark.view import RecordingView, WindowCounts
from saf_gen.core.execution import Cluster, SchedulerLost, run_jobs
from saf_gen.core.object_store import StorePath, find_path
from saf_gen.core.region import REGIONS
from saf_gen.errors import BadInput, SafGenError, unknown
from saf_gen.parts import Measure
from saf_gen.plugins.measures import get_measure
from saf_gen.stream.measure_input import choose_stream_region
from saf_gen.stream.stream_file import SpikeStream, open_stream

if TYPE_CHECKING:
    from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol

DRAWN_SEQUENCES = 48
"""Most sequences whose sweeps are kept, to be drawn; of more, some of every scene are."""
THUMBNAIL_SEQUENCES = 12
"""Sequences whose sweep is kept as small pictures, for people to look at."""
ProgressCallback = Callable[[int, int, str], None]


def evaluate(
    source: str | Path | StorePath,
    *,
    methods: Sequence[str] | None = None,
    split: str | None = None,
    scene_motion: str | None = None,
    region: str = "target",
    protocol: "ClosedLoopProtocol | None" = None,
    predictions: str | Path | None = None,
    progress: ProgressCallback | None = None,
    keep: KeptSequences | None = None,
    cluster: str | None = None,
    draw: bool = True,
    tell: Callable[[str], None] = lambda line: None,
) -> Evaluation:
    """Run methods over a dataset or one stream, and judge their answers.

    Parameters
    ----------
    source : a dataset folder or a stream file, on a disk or in an object store.
    methods : names of methods; None means DEFAULT_RECORDED_METHODS, or DEFAULT_CLOSED_LOOP_METHODS with a protocol, or
        no method where there are predictions.
    split, scene_motion : leave out the other sequences; scene_motion is ``static`` or ``dynamic``.
    region : where measures look. ``target`` is the box round the target where a stream has one, else the
        frame; ``frame`` is the frame; ``both`` runs every method at the target and once more, as
        ``METHOD@frame``, at the frame. A method that names its region looks there.
    protocol : None evaluates the recordings as they are. With a protocol each method moves the lens of a
        running camera, in the closed loop; that needs the focal stacks beside the streams, but no renderer.
    predictions : a file of answers made elsewhere (:mod:`saf_gen.benchmark.tracks.predictions`), judged
        beside the methods that are named; recorded track only.
    progress : called with (steps done, steps in all, what was done).
    keep : where the results of finished sequences of a dataset are kept, for the same call after a stop.
    cluster : address of a Dask scheduler whose workers evaluate the sequences; they must see the dataset, and the files
        that methods name, under the same path, and have the same versions.
    draw : whether the sweeps and pictures that a page draws are returned, too.
    tell : is called with a line for people: a sequence that is evaluated again since a worker died, a cluster without
        workers.

    Returns
    -------
    The records, and what figures need. A sequence of a dataset that cannot be read, or is not the one that
    the manifest names, becomes a failure, and the others go on.

    Raises
    ------
    BadInput : for an unknown split, scene motion, region or method; for predictions that do not fit the sequences,
        before anything runs; for a single stream that cannot be read; where no sequence can keep the protocol; and
        for a worker that cannot be used.
    SafGenError : where the scheduler of the cluster is lost.
    """
    path = find_path(source)
    if methods is None and predictions is not None:
        methods = ()
    elif methods is None:
        methods = DEFAULT_RECORDED_METHODS if protocol is None else DEFAULT_CLOSED_LOOP_METHODS
    if isinstance(path, StorePath) and (protocol is not None or cluster is not None):
        what = "the closed loop" if protocol is not None else "--cluster"
        raise BadInput(f"{what} on a dataset in an object store", where=str(path), hint="copy it to a disk first")
    chosen = parse_methods(methods)
    if protocol is None:
        check_method_leaves_lens(list(chosen.values()))
    groups = group_methods_by_region(chosen, region)
    count = sum(len(group) for group in groups.values())
    tasks = list_sequences_to_evaluate(path, split=split, scene_motion=scene_motion)
    prediction_set = None
    if predictions is not None:
        if protocol is not None:
            raise BadInput(f"predictions {str(predictions)!r} in the closed loop", allowed="--track recorded")
        prediction_set = read_method_predictions(predictions)
        if not path.is_dir():  # no manifest describes a single stream
            with open_stream(path) as stream:
                tasks = [replace(tasks[0], content_sha256=stream.content_sha256, frames=stream.shape[0])]
        prediction_set.check_complete(tasks, beside=[method.name for group in groups.values() for method in group])
    conditions = [((task.split, task.scene), (task.light, task.scene_motion)) for task in tasks]
    drawn: dict[int, Drawn] = {}
    if draw:
        drawn |= dict.fromkeys(select_evaluated_to_show(conditions, DRAWN_SEQUENCES), "sweep")
        drawn |= dict.fromkeys(select_evaluated_to_show(conditions, THUMBNAIL_SEQUENCES), "pictures")
    kept = keep if keep is not None and path.is_dir() else KeptSequences()
    kept.begin(groups, protocol=protocol, predictions=prediction_set, stacks=path / "stacks")
    parts: dict[int, Evaluation] = {}
    failures: dict[int, SequenceFailure] = {}

    def step(done: int, what: str) -> None:
        if progress is not None:
            progress((len(parts) + len(failures)) * count + done, len(tasks) * count, what)

    run: Callable[..., Generator[EndedSequence]] = _run_here
    if cluster is not None:
        named = NamedMethods.of(methods, region, groups=groups)
        run = partial(_run_on_cluster, cluster=Cluster(cluster, Path(str(path))), methods=named, tell=tell)
    ended = run(tasks, groups, drawn=drawn, kept=kept, protocol=protocol, predictions=prediction_set, step=step)
    try:
        with kept, closing(ended):
            for number, part, error in ended:
                if part is not None:
                    parts[number] = part
                elif path.is_dir():
                    problem = "memory ran out" if isinstance(error, MemoryError) else str(error)
                    failures[number] = SequenceFailure(tasks[number].id, problem)
                elif error is not None:
                    raise error
    except SchedulerLost as lost:
        raise SafGenError(
            f"{lost}; {len(parts)} of {len(tasks)} sequences are evaluated{' and kept' if keep else ''}; start a "
            "scheduler and run the same command again to go on"
        ) from lost
    if failures and not parts and protocol is not None:  # a protocol that no sequence can keep
        raise BadInput(
            f"none of {len(tasks)} sequences can be evaluated, the first because: {failures[min(failures)].problem}",
            where=str(path),
        )
    in_order = [parts[number] for number in sorted(parts)]
    return Evaluation(
        records=tuple(record for part in in_order for record in part.records),
        sweeps=tuple(sweep for part in in_order for sweep in part.sweeps),
        failures=tuple(failures[number] for number in sorted(failures)),
        lens_paths=tuple(lens_path for part in in_order for lens_path in part.lens_paths),
        plugins=describe_plugins_of_methods(chosen.values()),
        curves=tuple(curve for part in in_order for curve in part.curves),
    )


EndedSequence = tuple[int, Evaluation | None, Exception | None]
"""The number of a sequence, and what came of it: its evaluation, or its error."""


def _run_here(
    tasks: Sequence[SequenceTask],
    groups: MethodGroups,
    *,
    drawn: Mapping[int, Drawn],
    kept: KeptSequences,
    protocol: "ClosedLoopProtocol | None",
    predictions: PredictionSet | None,
    step: Callable[[int, str], None],
) -> Generator[EndedSequence]:
    """Evaluate sequences one after the other."""
    count = sum(map(len, groups.values()))
    for number, task in enumerate(tasks):
        draw = drawn.get(number, "")
        part = kept.take(task, draw=draw)
        if part is None:
            try:
                part = evaluate_sequence(
                    task,
                    groups,
                    protocol=protocol,
                    predictions=predictions,
                    step=lambda done, what, task=task: step(done, f"{task.id} {what}".strip()),  # type: ignore[misc]
                    draw=draw,
                )
            except (BadInput, OSError, MemoryError) as error:
                step(count, f"{task.id} failed")
                yield number, None, error
                continue
            kept.keep(task, part, draw=draw)
        else:
            step(count, f"{task.id} had been evaluated")
        yield number, part, None


def _run_on_cluster(
    tasks: Sequence[SequenceTask],
    groups: MethodGroups,
    *,
    cluster: Cluster,
    methods: NamedMethods,
    tell: Callable[[str], None],
    drawn: Mapping[int, Drawn],
    kept: KeptSequences,
    protocol: "ClosedLoopProtocol | None",
    predictions: PredictionSet | None,
    step: Callable[[int, str], None],
) -> Generator[EndedSequence]:
    """Evaluate sequences on the workers of a cluster, in any order; each worker makes the methods by their names."""
    jobs, count = [], sum(map(len, groups.values()))
    for number, task in enumerate(tasks):
        part = kept.take(task, draw=drawn.get(number, ""))
        if part is not None:
            step(count, f"{task.id} had been evaluated")
            yield number, part, None
            continue
        task = replace(task, path=task.path.resolve())
        answers = None if predictions is None else predictions.only(task.id)
        jobs.append(EvaluateJob(number, task, methods, protocol, answers, drawn.get(number, "")))
    for job, part, error in run_jobs(jobs, workers=1, report=lambda name, done: None, cluster=cluster, tell=tell):
        if part is not None:
            kept.keep(tasks[job.number], part, draw=job.draw)
        step(count, f"{job.task.id} {'failed' if error else ''}".strip())
        yield job.number, part, error


def score_evaluated_blocks(
    stream: SpikeStream, measure: str | Measure, *, window: int, region: str = "target"
) -> tuple[np.ndarray, np.ndarray]:
    """Return the scores of consecutive blocks of frames; a shorter rest at the end is left out.

    ``window`` is the frames per block, 1 to those of the stream; ``region`` is ``target``, the box round the target
    where the stream has one, or ``frame``. Returns the first frame of each block, from 0, int64 (B,), and the scores,
    float64 (B,). Raises BadInput for a window out of its range, and for an unknown region or measure.
    """
    frames = stream.shape[0]
    if not (isinstance(window, int) and 1 <= window <= frames):
        raise BadInput(f"window {window}", allowed=f"1 to the stream's {frames} frames")
    if region not in REGIONS:
        raise unknown("region", region, allowed=REGIONS)
    counts = WindowCounts(stream, choose_stream_region(stream, region)[0])
    view = RecordingView(counts, get_measure(measure) if isinstance(measure, str) else measure)
    first = np.arange(0, frames - window + 1, window)
    return first, np.array([view.score(a, a + window) for a in first.tolist()])
