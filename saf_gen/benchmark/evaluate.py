"""Runs methods over recordings: every sequence of a dataset, or one stream, gives one record per method.

A method is a focus measure and a search. It sees windows of the recording through a narrow view; truth, cost
and score stay with the evaluator, in the folder ``tracks``. A stream without truth is searched all the same.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from saf_gen.benchmark.assessed_curves import assess_curves
from saf_gen.benchmark.curve_quality import AssessedCurve
from saf_gen.benchmark.kept_sequences import KeptSequences
from saf_gen.benchmark.method_spec import DEFAULT_CLOSED_LOOP_METHODS, DEFAULT_RECORDED_METHODS, Method, parse_method
from saf_gen.benchmark.plugin_description import describe_methods
from saf_gen.benchmark.records import Record
from saf_gen.benchmark.results import Evaluation, LensPath, SequenceFailure, SweepSummary
from saf_gen.benchmark.thumbnails import select_sequences_to_show
from saf_gen.benchmark.tracks.predictions import PredictionSet, read_method_predictions
from saf_gen.benchmark.tracks.recorded_track import check_no_lens_commands, run_recorded_sequence
from saf_gen.benchmark.tracks.sequence_tasks import SequenceTask, list_sequence_tasks
from saf_gen.benchmark.view import RecordingView, WindowCounts
from saf_gen.core.region import REGIONS
from saf_gen.errors import BadInput, unknown
from saf_gen.measures import get_measure
from saf_gen.parts import Measure
from saf_gen.stream.measure_input import choose_method_region
from saf_gen.stream.stream_file import SpikeStream, open_stream

if TYPE_CHECKING:
    from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol

DRAWN_SEQUENCES = 48
"""Most sequences whose sweeps are kept, to be drawn; of more, some of every scene are."""
THUMBNAIL_SEQUENCES = 12
"""Sequences whose sweep is kept as small pictures, for people to look at."""
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
) -> Evaluation:
    """Run methods over a dataset or one stream, and judge their answers.

    Parameters
    ----------
    source : a dataset folder or a stream file.
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

    Returns
    -------
    The records, and what figures need. A sequence of a dataset that cannot be read, or is not the one that
    the manifest names, becomes a failure, and the others go on.

    Raises
    ------
    BadInput : for an unknown split, scene motion, region or method; for predictions that do not fit the sequences,
        before anything runs; for a single stream that cannot be read; and where no sequence can keep the protocol.
    """
    path = Path(source)
    if methods is None and predictions is not None:
        methods = ()
    elif methods is None:
        methods = DEFAULT_RECORDED_METHODS if protocol is None else DEFAULT_CLOSED_LOOP_METHODS
    chosen: dict[str, Method] = {}
    for method in map(parse_method, methods):
        chosen.setdefault(method.name, method)  # one method may be named in several ways
    if protocol is None:
        check_no_lens_commands(list(chosen.values()))
    groups = _group_by_region(chosen, region)
    count = sum(len(group) for group in groups.values())
    tasks = list_sequence_tasks(path, split=split, scene_motion=scene_motion)
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
    drawn = set(select_sequences_to_show(conditions, DRAWN_SEQUENCES))
    shown = set(select_sequences_to_show(conditions, THUMBNAIL_SEQUENCES))
    kept = keep if keep is not None and path.is_dir() else KeptSequences()
    kept.begin(groups, protocol=protocol, predictions=prediction_set, stacks=path / "stacks")
    records: list[Record] = []
    sweeps: list[SweepSummary] = []
    failures: list[SequenceFailure] = []
    lens_paths: list[LensPath] = []
    curves: list[AssessedCurve] = []
    with kept:
        for number, task in enumerate(tasks):

            def step(done: int, what: str, number: int = number, task: SequenceTask = task) -> None:
                if progress is not None:
                    progress(number * count + done, len(tasks) * count, f"{task.id} {what}".strip())

            pictures = number in shown
            before = kept.take(task, with_thumbnails=pictures)
            try:
                part = before or _evaluate_sequence(
                    task, groups, protocol=protocol, predictions=prediction_set, step=step, with_thumbnails=pictures
                )
            except (BadInput, OSError, MemoryError) as error:
                if not path.is_dir():
                    raise
                problem = "memory ran out" if isinstance(error, MemoryError) else str(error)
                failures.append(SequenceFailure(task.id, problem))
                step(count, "failed")
            else:
                if before is None:
                    kept.keep(task, part, with_thumbnails=pictures)
                else:
                    step(count, "had been evaluated")
                records += part.records
                curves += assess_curves(part.sweeps)
                if number in drawn:
                    sweeps += part.sweeps
                    lens_paths += part.lens_paths
    if failures and not records and protocol is not None:  # a protocol that no sequence can keep
        raise BadInput(
            f"none of {len(tasks)} sequences can be evaluated, the first because: {failures[0].problem}",
            where=str(path),
        )
    return Evaluation(
        records=tuple(records),
        sweeps=tuple(sweeps),
        failures=tuple(failures),
        lens_paths=tuple(lens_paths),
        plugins=describe_methods(chosen.values()),
        curves=tuple(curves),
    )


def _group_by_region(methods: Mapping[str, Method], region: str) -> dict[str, list[Method]]:
    """Return the methods that look at each region; the evaluation's own region comes first, even if empty."""
    if region not in (*REGIONS, "both"):
        raise unknown("region", region, allowed=(*REGIONS, "both"))
    usual = "target" if region == "both" else region
    if region == "both":
        at_frame = [replace(m, name=f"{m.name}@frame", region="frame") for m in methods.values() if not m.region]
        methods = {**{method.name: method for method in at_frame}, **methods}
    groups: dict[str, list[Method]] = {usual: [], **{name: [] for name in REGIONS}}
    for method in methods.values():
        groups[method.region or usual].append(method)
    return {name: group for name, group in groups.items() if group or name == usual}


def _evaluate_sequence(
    task: SequenceTask,
    groups: Mapping[str, Sequence[Method]],
    *,
    protocol: "ClosedLoopProtocol | None",
    predictions: PredictionSet | None,
    step: Callable[[int, str], None],
    with_thumbnails: bool,
) -> Evaluation:
    """Run all methods on one sequence; predictions, figures and mean counts belong to the first region."""
    usual, before = next(iter(groups)), 0
    records: list[Record] = []
    sweeps: list[SweepSummary] = []
    lens_paths: list[LensPath] = []
    for region, group in groups.items():

        def group_step(done: int, what: str, before: int = before) -> None:
            step(before + done, what)

        if protocol is None:
            group_records, sweep = run_recorded_sequence(
                task,
                group,
                region=region,
                rate_region=usual,
                step=group_step,
                predictions=predictions if region == usual else None,
                with_thumbnails=with_thumbnails and region == usual,
            )
            sweeps += [sweep] if region == usual else []
        elif not group:
            continue
        else:
            # Imported late, because it loads what reads OpenEXR files.
            from saf_gen.benchmark.tracks.closed_loop_track import run_closed_loop_sequence

            group_records, group_paths = run_closed_loop_sequence(
                task, group, region=region, rate_region=usual, protocol=protocol, step=group_step
            )
            lens_paths += group_paths
        records += group_records
        before += len(group)
    return Evaluation(tuple(records), tuple(sweeps), (), tuple(lens_paths))


def score_blocks(
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
    counts = WindowCounts(stream, choose_method_region(stream, region)[0])
    view = RecordingView(counts, get_measure(measure) if isinstance(measure, str) else measure)
    first = np.arange(0, frames - window + 1, window)
    return first, np.array([view.score(a, a + window) for a in first.tolist()])
