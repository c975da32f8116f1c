"""Runs methods over recordings: every sequence of a dataset, or one stream, becomes one record a method.

A method is a focus measure and a search. It sees windows of the recording through a narrow view; truth,
cost and score stay with the referee here. A stream without truth is searched all the same.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from saf_gen import rig
from saf_gen.dataset import read_manifest
from saf_gen.errors import BadInput, unknown
from saf_gen.measures import get_measure
from saf_gen.methods import DEFAULT_METHODS, Method, parse_method
from saf_gen.parts import Answer, Measure, Search
from saf_gen.region import Region, target_box
from saf_gen.scores import Record, judge
from saf_gen.stream import SpikeStream, open_stream

__all__ = ["REGIONS", "Curve", "Evaluation", "Failure", "Sweep", "evaluate", "score_curve"]

REGIONS = ("target", "frame")
CURVE_BLOCKS = 200
Progress = Callable[[int, int, str], None]


@dataclass(frozen=True)
class Curve:
    """What argmax looked at: a measure's score of each block, and the frame it took."""

    measure: str
    frames: np.ndarray
    """(B,) centres of the blocks, frames."""
    scores: np.ndarray
    answer: float | None


@dataclass(frozen=True)
class Sweep:
    """One recording as a figure needs it: lens, light, truth and the focus curves."""

    sequence: str
    split: str | None
    scene: str
    light: str | None
    focus_position: np.ndarray | None
    frames: np.ndarray
    """(B,) centres of the blocks of ``rate``, frames."""
    rate: np.ndarray
    """(B,) mean counts in the region, spikes a pixel and readout."""
    truth: float
    depth_of_focus: tuple[float, float]
    truth_frame: float
    """When the lens first passes the truth."""
    curves: tuple[Curve, ...]
    track: np.ndarray | None = None
    """(T,) the truth over time, where it moves."""


@dataclass(frozen=True)
class Failure:
    """A sequence that could not be read, and why."""

    sequence: str
    problem: str


@dataclass(frozen=True)
class Evaluation:
    """All that came out: records (sequence by sequence, methods in the order given), sweeps, failures."""

    records: tuple[Record, ...]
    sweeps: tuple[Sweep, ...]
    failures: tuple[Failure, ...]


@dataclass(frozen=True)
class _Job:
    id: str
    split: str | None
    scene: str
    light: str | None
    path: Path
    content_sha256: str | None


def evaluate(
    source: str | Path,
    *,
    methods: Sequence[str] | None = None,
    split: str | None = None,
    region: str = "target",
    progress: Progress | None = None,
) -> Evaluation:
    """Run ``methods`` (default: DEFAULT_METHODS) over a dataset folder or one stream file.

    ``region`` is where measures look: ``target``, the box round the target where a stream has one, else
    the frame; or ``frame``. ``progress`` is called with (steps done, steps in all, what was done).

    A sequence of a dataset that cannot be read, or is not the one its manifest names, becomes a failure,
    and the others go on; a single stream that cannot be read is BadInput, like an unknown split, region or
    method.
    """
    chosen = [parse_method(spec) for spec in dict.fromkeys(DEFAULT_METHODS if methods is None else methods)]
    if region not in REGIONS:
        raise unknown("region", region, REGIONS)
    path = Path(source)
    jobs = _jobs(path, split)
    records: list[Record] = []
    sweeps: list[Sweep] = []
    failures: list[Failure] = []
    for number, job in enumerate(jobs):

        def step(done: int, what: str, number: int = number, job: _Job = job) -> None:
            if progress is not None:
                progress(number * len(chosen) + done, len(jobs) * len(chosen), f"{job.id} {what}".strip())

        try:
            some, sweep = _sequence(job, chosen, region, step)
        except (BadInput, OSError) as error:
            if not path.is_dir():
                raise
            failures.append(Failure(job.id, str(error)))
            step(len(chosen), "failed")
        else:
            records += some
            sweeps.append(sweep)
    return Evaluation(tuple(records), tuple(sweeps), tuple(failures))


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
    counts = rig.Counts(stream, region=_box(stream, region)[0])
    part = get_measure(measure) if isinstance(measure, str) else measure
    view = rig.Recording(counts, part)
    first = np.arange(0, frames - window + 1, window)
    return first, np.array([view.score(int(a), int(a) + window) for a in first])


def _jobs(path: Path, split: str | None) -> list[_Job]:
    if not path.is_dir():
        if not path.exists():
            raise BadInput(
                f"no dataset or stream at {str(path)!r}",
                allowed="a dataset folder or a stream file (.h5)",
                hint="make one with `saf-gen generate recipes/quickstart.yaml --out datasets/quickstart`",
            )
        if split is not None:
            raise BadInput(f"split {split!r} of the single stream {str(path)!r}", allowed="no split")
        return [_Job(path.stem, None, path.stem, None, path, None)]
    entries = read_manifest(path).sequences
    if not entries:
        raise BadInput(
            f"{path} holds no finished sequence", hint="run saf-gen generate with its recipe again"
        )
    if split is not None and split not in {entry.split for entry in entries}:
        raise unknown("split", split, {entry.split for entry in entries}, where=str(path))
    return [
        _Job(entry.id, entry.split, entry.scene, entry.light, path / entry.file, entry.content_sha256)
        for entry in entries
        if split is None or entry.split == split
    ]


def _box(stream: SpikeStream, region: str) -> tuple[Region | None, str]:
    target = stream.truth.target
    if region == "target" and target is not None and np.any(target):
        return target_box(target), "target"
    return None, "frame"


class _Watched:
    """A view that remembers what it was asked: the focus curves come from it at no cost."""

    def __init__(self, view: rig.Recording) -> None:
        self._view = view
        self.asked: dict[tuple[int, int], float] = {}

    @property
    def frames(self) -> int:
        return self._view.frames

    @property
    def now(self) -> int:
        return self._view.now

    @property
    def readout_hz(self) -> float:
        return self._view.readout_hz

    def score(self, first: int, stop: int) -> float:
        self.asked[first, stop] = score = self._view.score(first, stop)
        return score

    def position(self, frame: int) -> float:
        return self._view.position(frame)

    def move(self, to: float) -> None:
        self._view.move(to)


def _sequence(
    job: _Job, methods: Sequence[Method], region: str, step: Callable[[int, str], None]
) -> tuple[list[Record], Sweep]:
    records, curves = [], {}
    with open_stream(job.path) as stream:
        if job.content_sha256 is not None and stream.content_sha256 != job.content_sha256:
            raise BadInput(
                f"{job.path} is not the stream that the manifest names",
                hint="make the dataset again with `saf-gen generate`",
            )
        box, seen_region = _box(stream, region)
        counts = rig.Counts(stream, region=box)
        for done, method in enumerate(methods):
            recording = rig.Recording(counts, method.measure)
            watched = _Watched(recording)
            answer, problem = _answer(method.search, watched)
            records.append(_record(job, method, stream, recording, answer, problem, seen_region))
            if method.search_name == "argmax" and method.measure_name not in curves and not problem:
                curves[method.measure_name] = _curve(method.measure_name, watched.asked, answer.frame)
            step(done + 1, method.name)
        return records, _sweep(job, stream, counts, curves)


def _answer(search: Search, view: _Watched) -> tuple[Answer, str]:
    """The search's answer, or an empty one and why it failed: a broken method must not stop the others."""
    try:
        answer = search(view)
    except (BadInput, ArithmeticError, LookupError, TypeError, ValueError) as error:
        return Answer(None), f"{type(error).__name__}: {error}"
    if answer.frame is not None and not -0.5 <= answer.frame <= view.frames - 0.5:
        return Answer(None, answer.trace), f"answered frame {answer.frame}, which was not recorded"
    return answer, ""


def _record(
    job: _Job,
    method: Method,
    stream: SpikeStream,
    recording: rig.Recording,
    answer: Answer,
    problem: str,
    region: str,
) -> Record:
    truth = stream.truth
    verdict = judge(
        answer.frame,
        frames_seen=recording.frames_seen,
        focus_position=stream.focus_position,
        truth=truth.position,
        track=truth.track,
        truth_frame=truth.frame,
        ends=truth.depth_of_focus,
    )
    # A failure must not pass for the abstention that is right where the focus lies outside the travel.
    half, one, two = (s and not problem for s in verdict.success)
    return Record(
        method=method.name,
        sequence=job.id,
        split=job.split,
        scene=job.scene,
        light=job.light,
        status="failed" if problem else "abstained" if answer.frame is None else "answered",
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
        frames=recording.frames,
        frames_seen=recording.frames_seen,
        lens_travel=verdict.lens_travel,
        windows=recording.windows,
        seconds=recording.seconds,
        note=problem or answer.note,
        region=region,
        data=stream.content_sha256,
        code=method.code,
    )


def _curve(measure: str, asked: Mapping[tuple[int, int], float], answer: float | None) -> Curve:
    blocks = sorted(asked)
    return Curve(
        measure,
        np.array([(first + stop - 1) / 2 for first, stop in blocks]),
        np.array([asked[block] for block in blocks]),
        answer,
    )


def _mean(counts: np.ndarray) -> float:
    return float(np.mean(counts))


def _sweep(job: _Job, stream: SpikeStream, counts: rig.Counts, curves: Mapping[str, Curve]) -> Sweep:
    view = rig.Recording(counts, _mean)
    window = max(1, view.frames // CURVE_BLOCKS)
    first = np.arange(0, view.frames - window + 1, window)
    return Sweep(
        sequence=job.id,
        split=job.split,
        scene=job.scene,
        light=job.light,
        focus_position=stream.focus_position,
        frames=first + (window - 1) / 2,
        rate=np.array([view.score(int(a), int(a) + window) / window for a in first]),
        truth=stream.truth.position,
        depth_of_focus=stream.truth.depth_of_focus,
        truth_frame=stream.truth.frame,
        curves=tuple(curves.values()),
        track=stream.truth.track,
    )
