"""Runs methods over recordings: every sequence of a dataset, or one stream, becomes one record a method.

A method is a focus measure and a search. It sees windows of the recording through a narrow view; truth,
cost and score stay with the referee, the room ``contest``. A stream without truth is searched all the same.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from saf_gen.benchmark.method_spec import (
    DEFAULT_CLOSED_LOOP_METHODS,
    DEFAULT_RECORDED_METHODS,
    Method,
    parse_method,
)
from saf_gen.benchmark.records import Record
from saf_gen.benchmark.results import Evaluation, FocusCurve, LensPath, SequenceFailure, SweepSummary
from saf_gen.benchmark.thumbnails import select_sequences_to_show
from saf_gen.benchmark.tracks.predictions import PredictionSet, read_predictions
from saf_gen.benchmark.tracks.recorded_track import check_no_lens_commands, run_recorded_sequence
from saf_gen.benchmark.tracks.sequence_tasks import SequenceTask, choose_region, list_sequence_tasks
from saf_gen.benchmark.view import RecordingView, WindowCounts
from saf_gen.core.region import REGIONS
from saf_gen.errors import BadInput, unknown
from saf_gen.measures import get_measure
from saf_gen.parts import Measure
from saf_gen.stream.stream_file import SpikeStream, open_stream

if TYPE_CHECKING:
    from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol

__all__ = [
    "Evaluation",
    "FocusCurve",
    "LensPath",
    "SequenceFailure",
    "SweepSummary",
    "evaluate",
    "score_blocks",
]

THUMBNAIL_SEQUENCES = 12
"""Recordings whose sweep is kept as small pictures, for people to look at."""
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
) -> Evaluation:
    """Run ``methods`` (default: DEFAULT_RECORDED_METHODS) over a dataset folder or one stream file.

    With ``protocol`` in the closed loop: each method moves the lens of a running camera. It needs the focal
    stacks beside the streams, and no renderer. Without, on the recordings as they are.

    ``predictions``: a file of answers made elsewhere (:mod:`saf_gen.benchmark.tracks.predictions`), judged
    beside the
    methods; of recordings only. Answers that are not of these streams are refused before anything runs.

    ``split`` and ``scene_motion`` (``static`` or ``dynamic``) leave out the other sequences.

    ``region`` is where measures look: ``target``, the box round the target where a stream has one, else
    the frame; ``frame``; or ``both``, every method at the target and once more, as ``METHOD@frame``, at the
    frame. A method that names its region looks there. ``progress`` is called with (steps done, steps in all,
    what was done).

    A sequence of a dataset that cannot be read, or is not the one its manifest names, becomes a failure,
    and the others go on; where none can keep the protocol it is BadInput, like a single stream that cannot be
    read, an unknown split, region or method.
    """
    if methods is None:
        methods = DEFAULT_RECORDED_METHODS if protocol is None else DEFAULT_CLOSED_LOOP_METHODS
    chosen: list[Method] = []
    for method in map(parse_method, methods):
        if method.name not in [other.name for other in chosen]:  # one method may be named in several ways
            chosen.append(method)
    if protocol is None:
        check_no_lens_commands(chosen)
    if region not in (*REGIONS, "both"):
        raise unknown("region", region, (*REGIONS, "both"))
    groups = _by_region(chosen, region)
    chosen = [method for group in groups.values() for method in group]
    path = Path(source)
    tasks = list_sequence_tasks(path, split, scene_motion)
    filmed = set(
        select_sequences_to_show(
            [((j.split, j.scene), (j.light, j.scene_motion)) for j in tasks], THUMBNAIL_SEQUENCES
        )
    )
    foreign = None if predictions is None else read_predictions(predictions)
    if foreign is not None:
        if protocol is not None:
            raise BadInput(f"predictions {str(predictions)!r} in the closed loop", allowed="--track recorded")
        if not path.is_dir():  # no manifest says what the one stream is
            with open_stream(path) as stream:
                tasks = [replace(tasks[0], content_sha256=stream.content_sha256, frames=stream.shape[0])]
        foreign.check_complete(tasks, beside=[method.name for method in chosen])
    records: list[Record] = []
    sweeps: list[SweepSummary] = []
    failures: list[SequenceFailure] = []
    paths: list[LensPath] = []
    for number, task in enumerate(tasks):

        def step(done: int, what: str, number: int = number, task: SequenceTask = task) -> None:
            if progress is not None:
                progress(number * len(chosen) + done, len(tasks) * len(chosen), f"{task.id} {what}".strip())

        try:
            found = _sequence(task, groups, protocol, foreign, step, film=number in filmed)
        except (BadInput, OSError) as error:
            if not path.is_dir():
                raise
            failures.append(SequenceFailure(task.id, str(error)))
            step(len(chosen), "failed")
        else:
            records += found.records
            sweeps += found.sweeps
            paths += found.lens_paths
    if failures and not records and protocol is not None:  # protocol that no sequence can keep
        raise BadInput(
            f"none of {len(tasks)} sequences can be evaluated, the first because: {failures[0].problem}",
            where=str(path),
        )
    return Evaluation(tuple(records), tuple(sweeps), tuple(failures), tuple(paths))


def _by_region(chosen: Sequence[Method], region: str) -> dict[str, list[Method]]:
    """The methods that look at each region, first the evaluation's own, even where none looks there."""
    usual = "target" if region == "both" else region
    every = {method.name: method for method in chosen}
    if region == "both":
        twins = (replace(m, name=f"{m.name}@frame", region="frame") for m in chosen if not m.region)
        every = {**{twin.name: twin for twin in twins}, **every}
    groups: dict[str, list[Method]] = {usual: [], **{looked: [] for looked in REGIONS}}
    for method in every.values():
        groups[method.region or usual].append(method)
    return {looked: group for looked, group in groups.items() if group or looked == usual}


def _sequence(
    task: SequenceTask,
    groups: Mapping[str, Sequence[Method]],
    protocol: "ClosedLoopProtocol | None",
    foreign: PredictionSet | None,
    step: Callable[[int, str], None],
    *,
    film: bool,
) -> Evaluation:
    """All methods on one sequence. PredictionSet, figures and the photon budget are of the first region."""
    usual, before = next(iter(groups)), 0
    records: list[Record] = []
    sweeps: list[SweepSummary] = []
    paths: list[LensPath] = []
    for looked, group in groups.items():

        def told(done: int, what: str, before: int = before) -> None:
            step(before + done, what)

        if protocol is None:
            mine = foreign if looked == usual else None
            some, sweep = run_recorded_sequence(
                task, group, looked, told, mine, light_in=usual, film=film and looked == usual
            )
            sweeps += [sweep] if looked == usual else []
        elif not group:
            continue
        else:
            from saf_gen.benchmark.tracks.closed_loop_track import (
                run_closed_loop_sequence,  # reads OpenEXR files
            )

            some, ways = run_closed_loop_sequence(task, group, looked, protocol, told, light_in=usual)
            paths += ways
        records += some
        before += len(group)
    return Evaluation(tuple(records), tuple(sweeps), (), tuple(paths))


def score_blocks(
    stream: SpikeStream, measure: str | Measure, *, window: int, region: str = "target"
) -> tuple[np.ndarray, np.ndarray]:
    """Scores of consecutive blocks of ``window`` frames; a shorter rest at the end is left out.

    Returns (first frame of each block, 0-based int64 (B,); score float64 (B,)). Raises BadInput for a
    window that is not 1 to the frames of the stream.
    """
    frames = stream.shape[0]
    if not (isinstance(window, int) and 1 <= window <= frames):
        raise BadInput(f"window {window}", allowed=f"1 to the stream's {frames} frames")
    if region not in REGIONS:
        raise unknown("region", region, REGIONS)
    counts = WindowCounts(stream, region=choose_region(stream, region)[0])
    part = get_measure(measure) if isinstance(measure, str) else measure
    view = RecordingView(counts, part)
    first = np.arange(0, frames - window + 1, window)
    return first, np.array([view.score(int(a), int(a) + window) for a in first])
