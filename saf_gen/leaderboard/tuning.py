"""Tuning of the constants of a method: the best of a grid, or of as many draws as every other method has.

Constants are tuned on the split train; the split test is reserved for finished methods.
"""

import hashlib
from collections.abc import Callable, Sequence
from contextlib import suppress
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING

from saf_gen import __version__
from saf_gen.benchmark.evaluate import evaluate
from saf_gen.benchmark.kept_sequences import KeptSequences
from saf_gen.benchmark.method_spec import TunedMethod, TuningTrial
from saf_gen.benchmark.records import Record
from saf_gen.core.files import name_as_text
from saf_gen.core.region import REGIONS
from saf_gen.errors import BadInput, SafGenError, unknown
from saf_gen.leaderboard import LeaderboardRow, rank_methods
from saf_gen.leaderboard.outcomes import RULE, mean_over_scenes
from saf_gen.leaderboard.trials import READOUT_HZ, Choices, draw_trials, expand_grid
from saf_gen.stream.manifest import TEST_SPLIT, read_manifest
from saf_gen.stream.recordings import open_recording

if TYPE_CHECKING:
    from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol


def tune(
    dataset: str | Path,
    method: str,
    *,
    values: Choices | None = None,
    trials: int | None = None,
    split: str = "train",
    region: str = "target",
    protocol: "ClosedLoopProtocol | None" = None,
    progress: Callable[[int, int, str], None] | None = None,
    keep: KeptSequences | None = None,
    cluster: str | None = None,
    notify: Callable[[str], None] = lambda line: None,
) -> tuple[TunedMethod, tuple[LeaderboardRow, ...]]:
    """Find the best constants of a method on a split of a dataset.

    The candidates are those of ``draw_trials``, or of ``expand_grid`` without a number of trials. The best has the
    largest ``find_objective`` and, among equals, the smallest median error; among these, the first candidate, which is
    the method as it is if candidates are drawn.

    Parameters
    ----------
    dataset : str or Path
        Folder of the dataset.
    method : str
        Name of a method, or ``@FILE`` for a tuned one.
    values : mapping of str to sequence of str, optional
        Values to try, as for expand_grid, or to draw from, as for draw_trials.
    trials : int, optional
        Number of candidates to draw; by default, all combinations of ``values`` are tried.
    split : str, default "train"
        Any split except ``test``; ``all`` splits together cannot be chosen, because that would include it.
    region : str, default "target"
        Where measures look: ``target`` or ``frame``.
    protocol : ClosedLoopProtocol, optional
        Protocol of the closed loop; by default methods are evaluated on the recordings.
    progress : callable, optional
        Called with the number of finished tasks, the number of all tasks, and the current task.
    keep : KeptSequences, optional
        Store of the results of finished sequences, as for evaluate.
    cluster : str, optional
        Cluster that evaluates the sequences, as for evaluate.
    notify : callable, optional
        Called with lines of text for the user, as for evaluate.

    Returns
    -------
    tuned : TunedMethod
        The best method, with all trials, best first.
    rows : tuple of LeaderboardRow
        Rows of the trials, in the same order.

    Raises
    ------
    BadInput
        If the split is ``test``, the split or region is unknown, or what is called refuses its input.
    SafGenError
        If a sequence cannot be read.
    """
    if split == TEST_SPLIT:
        raise BadInput(
            "constants cannot be tuned on the split 'test'",
            allowed="train or validation",
            hint="keep the test split for finished methods",
        )
    if region not in REGIONS:
        raise unknown("region", region, allowed=REGIONS)
    splits = {entry.split for entry in read_manifest(dataset).sequences} - {TEST_SPLIT}
    if not splits:
        raise BadInput(
            f"{dataset} has no split to tune on", allowed="a dataset with another split than test, such as train"
        )
    if split not in splits:
        raise unknown("split", split, allowed=splits, where=str(dataset))
    if trials is None:
        specs = expand_grid(method, values or {})
    else:
        specs = draw_trials(method, trials, values=values, readout_hz=_readout_hz(dataset, split))
    result = evaluate(
        dataset,
        methods=specs,
        split=split,
        region=region,
        protocol=protocol,
        progress=progress,
        keep=keep,
        cluster=cluster,
        check=False,
        tell=notify,
    )
    if result.failures:
        raise SafGenError(f"{result.failures[0].sequence} could not be read: {result.failures[0].problem}")
    by_method: dict[str, list[Record]] = {}
    for record in result.records:
        by_method.setdefault(record.method, []).append(record)
    objectives = {name: find_objective(records) for name, records in by_method.items()}
    order = {name: number for number, name in enumerate(by_method)}

    def sort_key(row: LeaderboardRow) -> tuple[float, float, int]:
        objective, error = objectives[row.method], row.median_error_dof
        return inf if objective is None else -objective, inf if error is None else error, order[row.method]

    rows = sorted(rank_methods(result.records), key=sort_key)
    data = list(dict.fromkeys(record.data for record in result.records))
    first = result.records[0]
    tuned = TunedMethod(
        method=rows[0].method,
        dataset=name_as_text(Path(dataset).resolve().name),
        split=split,
        track=first.track,
        terms=first.terms,
        region=region,
        sequences=len(data),
        data=hashlib.sha256(" ".join(data).encode()).hexdigest()[:12],
        version=__version__,
        trials=tuple(
            TuningTrial(row.method, row.answerable_1dof, row.median_error_dof, objectives[row.method]) for row in rows
        ),
        ranked_by=RULE,
    )
    return tuned, tuple(rows)


def find_objective(records: Sequence[Record]) -> float | None:
    """Return what tuning maximises: the rate of right answers minus the rate of answers where there is none.

    A right answer is within one depth of focus. No answer is right where the lens never comes that near to the focus.
    Both rates refer to all recordings of a scene, so that such recordings count by their share in the data. The result
    is the mean over scenes, −1…1, or None if no truth is known.
    """
    return mean_over_scenes(records, _worth)


def _worth(record: Record) -> float | None:
    if record.answerable is None:
        return None
    is_answered = record.status == "answered"
    return float(is_answered and record.success_1dof is True) if record.answerable else -float(is_answered)


def _readout_hz(dataset: str | Path, split: str) -> float:
    """Return the frames per second of the first recording of a split that can be read; else of a spike camera."""
    for entry in read_manifest(dataset).sequences:
        if entry.split == split:
            with suppress(BadInput, OSError), open_recording(Path(dataset) / entry.file) as recording:
                return recording.readout_hz
    return READOUT_HZ
