"""Run methods on every sequence of a dataset, or on one stream, and return one record per method and sequence.

A method is a focus measure and a search. It sees windows of the recording through a restricted view; the truth, the
cost and the judgement stay with the evaluator, in the folder ``tracks``. Streams without truth are searched, too.
"""

from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from saf_gen.benchmark.admission import admit_measure, describe_undeclared
from saf_gen.benchmark.guests.host import Limits
from saf_gen.benchmark.kept_sequences import KeptSequences
from saf_gen.benchmark.method_spec import BASELINES, DEFAULT_CLOSED_LOOP_METHODS, DEFAULT_RECORDED_METHODS, Method
from saf_gen.benchmark.plugin_description import describe_plugins
from saf_gen.benchmark.records import NO_INSIDE
from saf_gen.benchmark.results import Drawn, Evaluation, SequenceFailure
from saf_gen.benchmark.sequence_evaluation import (
    EvaluateJob,
    MethodGroups,
    NamedMethods,
    by_region,
    evaluate_sequence,
    parse_methods,
)
from saf_gen.benchmark.suitability import keep_those_that_suit, measure_misfit
from saf_gen.benchmark.thumbnails import select_to_show
from saf_gen.benchmark.tracks.predictions import PredictionSet, read_predictions
from saf_gen.benchmark.tracks.recorded import check_leaves_lens
from saf_gen.benchmark.tracks.tasks import SequenceTask, select_sequences_to_evaluate
from saf_gen.benchmark.view.recording import RecordingView, WindowCounts
from saf_gen.core.execution import Cluster, SchedulerLost, run_jobs
from saf_gen.core.plain_text import plural
from saf_gen.core.region import MIN_SIDE, REGIONS
from saf_gen.core.user_code import named_user_code
from saf_gen.errors import BadInput, SafGenError, unknown
from saf_gen.parts import Measure
from saf_gen.stream.measure_input import choose_region
from saf_gen.stream.recordings import Recording
from saf_gen.stream.stream_file import open_stream

if TYPE_CHECKING:
    from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol

DRAWN_SEQUENCES = 48
"""Maximum number of sequences whose sweeps are kept for drawing; select_to_show chooses them."""
THUMBNAIL_SEQUENCES = 12
"""Maximum number of sequences of which small pictures are kept, too."""
ProgressCallback = Callable[[int, int, str], None]


def evaluate(
    source: str | Path,
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
    limits: Limits | None = None,
    check: bool = True,
    tell: Callable[[str], None] = lambda line: None,
) -> Evaluation:
    """Run methods on a dataset or on one stream, and judge their answers.

    Parameters
    ----------
    source : str or Path
        Dataset folder or stream file.
    methods : sequence of str, optional
        Names of methods; ``baselines`` stands for DEFAULT_CLOSED_LOOP_METHODS if there is a protocol, and for
        DEFAULT_RECORDED_METHODS otherwise. The default is no method if there are predictions, and else the baselines.
    split : str, optional
        Evaluate the sequences of this split, or of ``all`` splits together. The default is ``test``, or the only split
        of the dataset.
    scene_motion : str, optional
        Evaluate only the sequences with this scene motion, ``static`` or ``dynamic``.
    region : str, default 'target'
        Where measures look: ``target`` is the box around the target, or the whole frame if a stream has no target;
        ``inside`` is the largest rectangle inside the target, and a sequence without one is judged for no method that
        looks there; ``frame`` is the whole frame; ``shifted`` (sideways by half its width), ``half`` and ``double``
        (its size) are other boxes about the target, and ``centre`` is the middle half of the frame; ``both`` runs every
        method at the target and again, as ``METHOD@frame``, on the frame. A method whose name includes a region looks
        there instead.
    protocol : ClosedLoopProtocol, optional
        Conditions of the closed loop, in which each method moves the lens of a running camera. The closed loop needs
        the focal stacks next to the streams, but no renderer. By default the recordings are evaluated as they are.
    predictions : str or Path, optional
        File of answers that were made elsewhere (see :mod:`saf_gen.benchmark.tracks.predictions`). They are judged
        together with the methods; only the recorded track accepts them.
    progress : callable, optional
        Called with (steps done, total number of steps, what was done).
    keep : KeptSequences, optional
        Store of the results of finished sequences of a dataset, from which the same call continues after a stop.
    cluster : str, optional
        Address of a Dask scheduler whose workers evaluate the sequences. The workers must have the same versions, and
        must see the dataset, and the files that methods name, under the same paths.
    draw : bool, default True
        Whether to return the sweeps and pictures that a page draws.
    limits : Limits, optional
        What a method that is not part of saf_gen may use on a sequence; such a method runs in a process of its own,
        and whatever it does, only its own runs fail.
    check : bool, default True
        Whether measures and searches that are not part of saf_gen are checked once, as by ``saf-gen methods check``;
        their records name the first check that they fail. This takes a second or two for each.
    tell : callable, optional
        Called with a line for the user if a sequence is evaluated again because a worker died, or if the cluster has
        no workers.

    Returns
    -------
    Evaluation
        The records, and the data for charts. A sequence of a dataset becomes a failure if its stream cannot be read or
        is not the stream that the manifest names; the other sequences are evaluated.

    Raises
    ------
    BadInput
        If a split, scene motion, region or method is unknown; if no split is given for a dataset with several splits,
        none of them called ``test``; if a measure assumes another camera's noise;
        if a method commands the lens and there is no protocol; if predictions do not fit the sequences, which is
        checked before anything runs, or come with a protocol; if a single stream cannot be read; if the protocol suits
        no sequence; if no sequence has the region ``inside``; or if a worker cannot be used.
    SafGenError
        If the scheduler of the cluster is lost.
    """
    path = Path(source)
    if methods is None:
        methods = (BASELINES,) if predictions is None else ()
    asked = parse_methods([name for name in methods if name != BASELINES], limits)
    baselines = DEFAULT_RECORDED_METHODS if protocol is None else DEFAULT_CLOSED_LOOP_METHODS
    methods = [name for given in methods for name in (baselines if given == BASELINES else (given,))]
    chosen = parse_methods(methods, limits)
    if protocol is None:
        check_leaves_lens(list(chosen.values()))
    selection = select_sequences_to_evaluate(path, split=split, scene_motion=scene_motion)
    tasks = selection.tasks
    chosen = keep_those_that_suit(chosen, tasks, asked=asked, tell=tell)
    groups = by_region(chosen, region)
    count = max(1, sum(len(group) for group in groups.values()))  # predictions alone are one step, too
    prediction_set = None
    if predictions is not None:
        if protocol is not None:
            raise BadInput(
                f"predictions {str(predictions)!r} cannot be judged in the closed loop", allowed="--track recorded"
            )
        prediction_set = read_predictions(predictions)
        if not path.is_dir():  # no manifest describes a single stream
            with open_stream(path) as stream:
                tasks = [replace(tasks[0], content_sha256=stream.content_sha256, frames=stream.shape[0])]
        prediction_set.check_complete(
            tasks,
            left_out=selection.left_out,
            running_methods=[method.name for group in groups.values() for method in group],
        )
    if protocol is not None:
        # Imported late because this loads the reader of OpenEXR files.
        from saf_gen.benchmark.tracks.rehearsal import describe_short_budget

        if tasks and (line := describe_short_budget(str(tasks[0].path), chosen.values(), protocol=protocol)):
            tell(line)
        for line in describe_undeclared(chosen.values()) if protocol.operations_per_s else ():
            tell(line)
    conditions = [((task.split, task.scene), (task.light, task.scene_motion)) for task in tasks]
    drawn: dict[int, Drawn] = {}
    if draw:
        drawn |= dict.fromkeys(select_to_show(conditions, DRAWN_SEQUENCES), "sweep")
        drawn |= dict.fromkeys(select_to_show(conditions, THUMBNAIL_SEQUENCES), "pictures")
    failed = _check_guests(chosen.values()) if check else {}
    store = keep if keep is not None and path.is_dir() else KeptSequences()
    store.begin(groups, protocol=protocol, predictions=prediction_set, stacks=path / "stacks")
    parts: dict[int, Evaluation] = {}
    failures: dict[int, SequenceFailure] = {}

    def step(done: int, what: str) -> None:
        if progress is not None:
            progress((len(parts) + len(failures)) * count + done, len(tasks) * count, what)

    run: Callable[..., Generator[EndedSequence]] = _run_locally
    if cluster is not None:
        named = NamedMethods.of(methods, region, groups=groups, limits=limits or Limits())
        run = partial(_run_on_cluster, cluster=Cluster(cluster, Path(str(path))), methods=named, notify=tell)
    ended = run(tasks, groups, drawn=drawn, store=store, protocol=protocol, predictions=prediction_set, step=step)
    try:
        with store, closing(ended):
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
            f"{lost}; {len(parts)} of {plural(len(tasks), 'sequence')} evaluated{' and kept' if keep else ''}; start "
            "a scheduler and run the same command again to continue"
        ) from lost
    if failures and not parts and protocol is not None:  # the protocol suits no sequence
        raise BadInput(
            f"none of {plural(len(tasks), 'sequence')} can be evaluated; the first failed: "
            f"{failures[min(failures)].problem}",
            where=str(path),
        )
    in_order = [parts[number] for number in sorted(parts)]
    if parts and all(record.what.obstacle == NO_INSIDE for part in in_order for record in part.records):
        raise BadInput(
            f"none of {plural(len(parts), 'sequence')} has a region 'inside'",
            where=str(path),
            allowed=f"a target in which a rectangle of {MIN_SIDE} × {MIN_SIDE} pixels fits, away from its edge",
            hint="use another region, such as target",
        )
    return Evaluation(
        records=tuple(
            replace(record, who=replace(record.who, failed_check=failed[record.who.code]))
            if record.who.code in failed
            else record
            for part in in_order
            for record in part.records
        ),
        sweeps=tuple(sweep for part in in_order for sweep in part.sweeps),
        failures=tuple(failures[number] for number in sorted(failures)),
        lens_paths=tuple(lens_path for part in in_order for lens_path in part.lens_paths),
        plugins=describe_plugins(chosen.values()),
        curves=tuple(curve for part in in_order for curve in part.curves),
    )


def _check_guests(methods: Iterable[Method]) -> dict[str, str]:
    """Return the first check that a method fails, by its code digest, for those that fail one."""
    guests = {method.code: method for method in methods if method.guest is not None}
    if not guests:
        return {}
    from saf_gen.benchmark.checking import first_failed_check

    failed = {code: first_failed_check(method) for code, method in guests.items()}
    return {code: check for code, check in failed.items() if check}


EndedSequence = tuple[int, Evaluation | None, Exception | None]
"""The number of a sequence, and its evaluation or its error."""


def _run_locally(
    tasks: Sequence[SequenceTask],
    groups: MethodGroups,
    *,
    drawn: Mapping[int, Drawn],
    store: KeptSequences,
    protocol: "ClosedLoopProtocol | None",
    predictions: PredictionSet | None,
    step: Callable[[int, str], None],
) -> Generator[EndedSequence]:
    """Evaluate the sequences one after the other in this process."""
    count = max(1, sum(map(len, groups.values())))
    for number, task in enumerate(tasks):
        draw = drawn.get(number, "")
        part = store.reuse(task, draw=draw)
        if part is None:
            try:
                part = evaluate_sequence(
                    task,
                    groups,
                    protocol=protocol,
                    predictions=predictions,
                    # The last step is left for when the answers are kept.
                    step=lambda done, what, task=task: step(  # type: ignore[misc]
                        min(done, count - 1), f"{task.id} {what}".strip()
                    ),
                    draw=draw,
                )
            except (BadInput, OSError, MemoryError) as error:
                step(count, f"{task.id} failed")
                yield number, None, error
                continue
            store.keep(task, part, draw=draw)
            step(count, task.id)
        else:
            step(count, f"{task.id} was already evaluated")
        yield number, part, None


def _run_on_cluster(
    tasks: Sequence[SequenceTask],
    groups: MethodGroups,
    *,
    cluster: Cluster,
    methods: NamedMethods,
    notify: Callable[[str], None],
    drawn: Mapping[int, Drawn],
    store: KeptSequences,
    protocol: "ClosedLoopProtocol | None",
    predictions: PredictionSet | None,
    step: Callable[[int, str], None],
) -> Generator[EndedSequence]:
    """Evaluate the sequences on the workers of a cluster, in any order; each worker builds the methods from names."""
    jobs, count = [], max(1, sum(map(len, groups.values())))
    for number, task in enumerate(tasks):
        part = store.reuse(task, draw=drawn.get(number, ""))
        if part is not None:
            step(count, f"{task.id} was already evaluated")
            yield number, part, None
            continue
        task = replace(task, path=task.path.resolve())
        answers = None if predictions is None else predictions.only(task.id)
        jobs.append(EvaluateJob(number, task, methods, protocol, answers, drawn.get(number, "")))
    for job, part, error in run_jobs(jobs, workers=1, report=lambda name, done: None, cluster=cluster, notify=notify):
        if part is not None:
            store.keep(tasks[job.number], part, draw=job.draw)
        step(count, f"{job.task.id} {'failed' if error else ''}".strip())
        yield job.number, part, error


def score_blocks(
    stream: Recording, measure: str | Measure, *, window: int, region: str = "target"
) -> tuple[np.ndarray, np.ndarray]:
    """Return the scores of consecutive blocks of frames; a shorter block at the end is left out.

    Parameters
    ----------
    stream : SpikeStream, EventRecording or FrameFile
        Open recording.
    measure : str or Measure
        Focus measure, or its name; one that is not part of saf_gen is then called in a process of its own, because no
        other way keeps a measure that ends or holds its process from doing so to the caller's.
    window : int
        Frames per block, 1 to the number of frames in the recording.
    region : str, default 'target'
        One of REGIONS, such as ``target`` (the box around the target, or the whole frame if the stream has no target).

    Returns
    -------
    first : ndarray of int64, shape (B,)
        First frame of each block, counted from 0.
    scores : ndarray of float64, shape (B,)
        Score of each block.

    Raises
    ------
    BadInput
        If the window is out of range, if the region or the measure is unknown, if the stream has no such region, if the
        measure needs spikes and the
        recording holds something else, or if the measure fails.
    """
    frames = stream.shape[0]
    if not (isinstance(window, int) and 1 <= window <= frames):
        raise BadInput(f"the window is {window!r}", allowed=f"1 to {frames}, the number of frames in the stream")
    if region not in REGIONS:
        raise unknown("region", region, allowed=REGIONS)
    if misfit := measure_misfit(measure, stream.counted, form=stream.form):
        raise misfit
    counts = WindowCounts(stream, choose_region(stream, region)[0])
    view = RecordingView(counts, admit_measure(measure) if isinstance(measure, str) else measure)
    first = np.arange(0, frames - window + 1, window)
    with named_user_code(measure, "focus measure"):
        return first, np.array([view.score(a, a + window) for a in first.tolist()])
