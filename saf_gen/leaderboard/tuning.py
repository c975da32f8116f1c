"""Tuning of the constants of a method, which evaluates every combination of the values to try.

Constants are tuned on the split train; the split test is reserved for finished methods.
"""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from itertools import product
from math import inf, prod
from pathlib import Path
from typing import TYPE_CHECKING

from saf_gen import __version__
from saf_gen.benchmark.admission import admit_method
from saf_gen.benchmark.evaluate import evaluate
from saf_gen.benchmark.kept_sequences import KeptSequences
from saf_gen.benchmark.method_folder import ends_as_folder
from saf_gen.benchmark.method_spec import TunedMethod, TuningTrial, split_halves, split_options, split_region
from saf_gen.core.files import name_as_text
from saf_gen.core.region import REGIONS
from saf_gen.errors import BadInput, SafGenError, unknown
from saf_gen.leaderboard import LeaderboardRow, rank_methods
from saf_gen.leaderboard.outcomes import RULE
from saf_gen.stream.manifest import TEST_SPLIT, read_manifest

if TYPE_CHECKING:
    from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol

MAX_COMBINATIONS = 1000
"""Largest number of combinations in one run."""
ParameterGrid = Mapping[str, Sequence[str]]


def expand_grid(method: str, values: ParameterGrid) -> list[str]:
    """Return the names of a method with every combination of the given values of its constants.

    Parameters
    ----------
    method : str
        Name of a method, or ``@FILE`` for a tuned one.
    values : mapping of str to sequence of str
        Values to try, by ``measure.KEY`` or ``search.KEY``. They replace values in the name of the method.

    Returns
    -------
    list of str
        One name for each combination, with the values of the last key varying fastest.

    Raises
    ------
    BadInput
        If there are no values, a key begins with neither ``measure.`` nor ``search.``, there are more than
        MAX_COMBINATIONS combinations, or the measure or the search refuses a key or a value.
    """
    name, region = split_region(admit_method(method).name)  # reports errors in the method itself first
    if ends_as_folder(name):
        raise BadInput(
            f"{name} is a method in a folder, whose options are in its card",
            allowed="MEASURE+SEARCH, such as my_method/model.py:Net+my_method/search.py:Walk",
        )
    halves = dict(zip(("measure", "search"), split_halves(name), strict=True))
    for key, choices in values.items():
        half, dot, option = key.partition(".")
        if half not in halves or not dot or not option:
            raise BadInput(f"--try is {key!r}", allowed="measure.KEY=VALUE,... or search.KEY=VALUE,...")
        if not choices or not all(choices):
            raise BadInput(f"--try {key!r} has an empty value", allowed="values separated by commas")
    if not values:
        raise BadInput("there are no values to try", allowed="--try search.window=50,100,200, once or several times")
    if (count := prod(len(choices) for choices in values.values())) > MAX_COMBINATIONS:
        raise BadInput(
            f"there are {count} combinations of values",
            allowed=f"at most {MAX_COMBINATIONS}",
            hint="try fewer values at a time",
        )
    specs = []
    for chosen in product(*values.values()):
        spec = dict(halves)
        for key, value in zip(values, chosen, strict=True):
            half, _, option = key.partition(".")
            spec[half] = _set_option(spec[half], option, value=value)
        specs.append("+".join(spec.values()) + (f"@{region}" if region else ""))
        admit_method(specs[-1])
    return specs


def tune(
    dataset: str | Path,
    method: str,
    *,
    values: ParameterGrid,
    split: str = "train",
    region: str = "target",
    protocol: "ClosedLoopProtocol | None" = None,
    progress: Callable[[int, int, str], None] | None = None,
    keep: KeptSequences | None = None,
    cluster: str | None = None,
    notify: Callable[[str], None] = lambda line: None,
) -> tuple[TunedMethod, tuple[LeaderboardRow, ...]]:
    """Find the best of ``expand_grid(method, values)`` on a split of a dataset.

    The best method has the largest answerable success within one depth of focus and, among equals, the fewest false
    answers, then the smallest median error.

    Parameters
    ----------
    dataset : str or Path
        Folder of the dataset.
    method : str
        Name of a method, or ``@FILE`` for a tuned one.
    values : mapping of str to sequence of str
        Values to try, as for expand_grid.
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
        If the split is ``test``, the split or region is unknown, or expand_grid or evaluate refuses its input.
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
    specs = expand_grid(method, values)
    splits = {entry.split for entry in read_manifest(dataset).sequences} - {TEST_SPLIT}
    if not splits:
        raise BadInput(
            f"{dataset} has no split to tune on", allowed="a dataset with another split than test, such as train"
        )
    if split not in splits:
        raise unknown("split", split, allowed=splits, where=str(dataset))
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
    rows = sorted(rank_methods(result.records), key=_sort_key)
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
        trials=tuple(TuningTrial(row.method, row.answerable_1dof, row.median_error_dof) for row in rows),
        ranked_by=RULE,
    )
    return tuned, tuple(rows)


def _set_option(half: str, option: str, *, value: str) -> str:
    """Return the name of a measure or search with an option set to ``value``, which replaces any earlier value."""
    name, tail = split_options(half)
    options = {item.partition("=")[0]: item for item in tail.split(",") if item}
    return f"{name}:{','.join({**options, option: f'{option}={value}'}.values())}"


def _sort_key(row: LeaderboardRow) -> tuple[float, int, float]:
    success = -1.0 if row.answerable_1dof is None else row.answerable_1dof
    return -success, row.false_answers or 0, inf if row.median_error_dof is None else row.median_error_dof
