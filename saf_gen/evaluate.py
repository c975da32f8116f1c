"""Runs methods over recordings: every sequence of a dataset, or one stream, becomes one record a method.

A method is a focus measure and a search. It sees windows of the recording through a narrow view; truth,
cost and score stay with the referee, the room ``contest``. A stream without truth is searched all the same.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from saf_gen import rig
from saf_gen.contest.jobs import Job, box_of, jobs_of
from saf_gen.contest.predictions import Predictions, read_predictions
from saf_gen.contest.recorded import check_estimate, recorded_sequence
from saf_gen.contest.results import Curve, Evaluation, Failure, LensPath, Sweep
from saf_gen.errors import BadInput, unknown
from saf_gen.measures import get_measure
from saf_gen.methods import DEFAULT_LIVE_METHODS, DEFAULT_METHODS, Method, parse_method
from saf_gen.parts import Measure
from saf_gen.records import Record
from saf_gen.region import REGIONS
from saf_gen.rig.thumbnails import covering
from saf_gen.stream import SpikeStream, open_stream

if TYPE_CHECKING:
    from saf_gen.contest.terms import Terms

__all__ = ["Curve", "Evaluation", "Failure", "LensPath", "Sweep", "evaluate", "score_curve"]

FILMS = 12
"""Recordings whose sweep is kept as small pictures, for people to look at."""
Progress = Callable[[int, int, str], None]


def evaluate(
    source: str | Path,
    *,
    methods: Sequence[str] | None = None,
    split: str | None = None,
    scene_motion: str | None = None,
    region: str = "target",
    terms: "Terms | None" = None,
    predictions: str | Path | None = None,
    progress: Progress | None = None,
) -> Evaluation:
    """Run ``methods`` (default: DEFAULT_METHODS) over a dataset folder or one stream file.

    With ``terms`` in the closed loop: each method moves the lens of a running camera. It needs the focal
    stacks beside the streams, and no renderer. Without, on the recordings as they are.

    ``predictions``: a file of answers made elsewhere (:mod:`saf_gen.contest.predictions`), judged beside the
    methods; of recordings only. Answers that are not of these streams are refused before anything runs.

    ``split`` and ``scene_motion`` (``static`` or ``dynamic``) leave out the other sequences.

    ``region`` is where measures look: ``target``, the box round the target where a stream has one, else
    the frame; ``frame``; or ``both``, every method at the target and once more, as ``METHOD@frame``, at the
    frame. A method that names its region looks there. ``progress`` is called with (steps done, steps in all,
    what was done).

    A sequence of a dataset that cannot be read, or is not the one its manifest names, becomes a failure,
    and the others go on; where none can keep the terms it is BadInput, like a single stream that cannot be
    read, an unknown split, region or method.
    """
    if methods is None:
        methods = DEFAULT_METHODS if terms is None else DEFAULT_LIVE_METHODS
    chosen: list[Method] = []
    for method in map(parse_method, methods):
        if method.name not in [other.name for other in chosen]:  # one method may be named in several ways
            chosen.append(method)
    if terms is None:
        check_estimate(chosen)
    if region not in (*REGIONS, "both"):
        raise unknown("region", region, (*REGIONS, "both"))
    groups = _by_region(chosen, region)
    chosen = [method for group in groups.values() for method in group]
    path = Path(source)
    jobs = jobs_of(path, split, scene_motion)
    filmed = set(covering([((j.split, j.scene), (j.light, j.scene_motion)) for j in jobs], FILMS))
    foreign = None if predictions is None else read_predictions(predictions)
    if foreign is not None:
        if terms is not None:
            raise BadInput(f"predictions {str(predictions)!r} in the closed loop", allowed="--track recorded")
        if not path.is_dir():  # no manifest says what the one stream is
            with open_stream(path) as stream:
                jobs = [replace(jobs[0], content_sha256=stream.content_sha256, frames=stream.shape[0])]
        foreign.check(jobs, beside=[method.name for method in chosen])
    records: list[Record] = []
    sweeps: list[Sweep] = []
    failures: list[Failure] = []
    paths: list[LensPath] = []
    for number, job in enumerate(jobs):

        def step(done: int, what: str, number: int = number, job: Job = job) -> None:
            if progress is not None:
                progress(number * len(chosen) + done, len(jobs) * len(chosen), f"{job.id} {what}".strip())

        try:
            found = _sequence(job, groups, terms, foreign, step, film=number in filmed)
        except (BadInput, OSError) as error:
            if not path.is_dir():
                raise
            failures.append(Failure(job.id, str(error)))
            step(len(chosen), "failed")
        else:
            records += found.records
            sweeps += found.sweeps
            paths += found.paths
    if failures and not records and terms is not None:  # terms that no sequence can keep
        raise BadInput(
            f"none of {len(jobs)} sequences can be evaluated, the first because: {failures[0].problem}",
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
    job: Job,
    groups: Mapping[str, Sequence[Method]],
    terms: "Terms | None",
    foreign: Predictions | None,
    step: Callable[[int, str], None],
    *,
    film: bool,
) -> Evaluation:
    """All methods on one sequence. Predictions, figures and the photon budget are of the first region."""
    usual, before = next(iter(groups)), 0
    records: list[Record] = []
    sweeps: list[Sweep] = []
    paths: list[LensPath] = []
    for looked, group in groups.items():

        def told(done: int, what: str, before: int = before) -> None:
            step(before + done, what)

        if terms is None:
            mine = foreign if looked == usual else None
            some, sweep = recorded_sequence(
                job, group, looked, told, mine, light_in=usual, film=film and looked == usual
            )
            sweeps += [sweep] if looked == usual else []
        elif not group:
            continue
        else:
            from saf_gen.contest.closed_loop import live_sequence  # reads OpenEXR files

            some, ways = live_sequence(job, group, looked, terms, told, light_in=usual)
            paths += ways
        records += some
        before += len(group)
    return Evaluation(tuple(records), tuple(sweeps), (), tuple(paths))


def score_curve(
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
    counts = rig.Counts(stream, region=box_of(stream, region)[0])
    part = get_measure(measure) if isinstance(measure, str) else measure
    view = rig.Recording(counts, part)
    first = np.arange(0, frames - window + 1, window)
    return first, np.array([view.score(int(a), int(a) + window) for a in first])
