"""Tunes the constants of a method: judges every combination of the values to try, as evaluate does.

Constants are tuned on train; a split called test is for methods that are finished.
"""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from itertools import product
from math import inf, prod
from pathlib import Path
from typing import TYPE_CHECKING

from saf_gen import __version__
from saf_gen.benchmark.evaluate import evaluate
from saf_gen.benchmark.kept_sequences import KeptSequences
from saf_gen.benchmark.method_spec import parse_method, split_method_options, split_method_region
from saf_gen.benchmark.tuned_method import TunedMethod, TuningTrial
from saf_gen.core.files import file_name_as_text
from saf_gen.core.region import REGIONS
from saf_gen.errors import BadInput, SafGenError, unknown
from saf_gen.leaderboard import LeaderboardRow, rank_methods
from saf_gen.stream.manifest import read_manifest

if TYPE_CHECKING:
    from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol

MAX_COMBINATIONS = 1000
"""Most combinations in one run."""
ParameterGrid = Mapping[str, Sequence[str]]


def expand_tuning_grid(method: str, values: ParameterGrid) -> list[str]:
    """Return the method (a name, or ``@FILE`` of a tuned one) with every combination of the values, in order.

    ``values`` are by ``measure.KEY`` or ``search.KEY`` and replace the one in the method's name. Raises BadInput for
    another key, no value, more than MAX_COMBINATIONS combinations, or a key or value that the measure or the search
    refuses.
    """
    name, region = split_method_region(parse_method(method).name)  # the method itself must be right first
    halves = dict(zip(("measure", "search"), name.split("+"), strict=True))
    for key, choices in values.items():
        half, dot, option = key.partition(".")
        if half not in halves or not dot or not option:
            raise BadInput(f"--try {key!r}", allowed="measure.KEY=VALUE,... or search.KEY=VALUE,...")
        if not choices or not all(choices):
            raise BadInput(f"--try {key!r} has an empty value", allowed="values with commas between them")
    if not values:
        raise BadInput("nothing to try", allowed="--try search.window=50,100,200, and more of them")
    if (count := prod(len(choices) for choices in values.values())) > MAX_COMBINATIONS:
        raise BadInput(
            f"{count} combinations", allowed=f"at most {MAX_COMBINATIONS}", hint="try fewer values at a time"
        )
    specs = []
    for chosen in product(*values.values()):
        spec = dict(halves)
        for key, value in zip(values, chosen, strict=True):
            half, _, option = key.partition(".")
            spec[half] = _set_option(spec[half], option, value=value)
        specs.append("+".join(spec.values()) + (f"@{region}" if region else ""))
        parse_method(specs[-1])
    return specs


def tune_method(
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
    tell: Callable[[str], None] = lambda line: None,
) -> tuple[TunedMethod, tuple[LeaderboardRow, ...]]:
    """Find the best of ``expand_tuning_grid(method, values)`` on a split of a dataset.

    The best method has the largest success within one depth of focus, and among equals the smallest median error.

    Parameters
    ----------
    dataset : folder of the dataset.
    method, values : see expand_tuning_grid.
    split : any split but ``test``.
    region : where measures look: ``target`` or ``frame``.
    protocol : rules of the closed loop; None judges on the recordings.
    progress : called with the number of finished tasks, the number of all, and the current task.
    keep, cluster, tell : where the results of finished sequences are kept, what evaluates them, and what hears of it,
        as for evaluate.

    Returns
    -------
    The tuned method with all trials, best first, and the rows of their leaderboard in the same order.

    Raises
    ------
    BadInput : the split ``test``, an unknown split or region, or what expand_tuning_grid and evaluate refuse.
    SafGenError : a sequence cannot be read.
    """
    if split == "test":
        raise BadInput(
            "constants would be tuned on the split 'test'",
            allowed="train, or validation",
            hint="a test split is for methods that are finished",
        )
    if region not in REGIONS:
        raise unknown("region", region, allowed=REGIONS)
    specs = expand_tuning_grid(method, values)
    splits = {entry.split for entry in read_manifest(dataset).sequences}
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
        tell=tell,
    )
    if result.failures:
        raise SafGenError(f"{result.failures[0].sequence} could not be read: {result.failures[0].problem}")
    rows = sorted(rank_methods(result.records), key=_sort_key)
    data = list(dict.fromkeys(record.data for record in result.records))
    first = result.records[0]
    tuned = TunedMethod(
        method=rows[0].method,
        dataset=file_name_as_text(Path(dataset).resolve().name),
        split=split,
        track=first.track,
        terms=first.terms,
        region=region,
        sequences=len(data),
        data=hashlib.sha256(" ".join(data).encode()).hexdigest()[:12],
        version=__version__,
        trials=tuple(TuningTrial(row.method, row.success_1dof, row.median_error_dof) for row in rows),
    )
    return tuned, tuple(rows)


def _set_option(half: str, option: str, *, value: str) -> str:
    """Return a measure or search with this value of an option, in place of the one that it has."""
    name, tail = split_method_options(half)
    options = {item.partition("=")[0]: item for item in tail.split(",") if item}
    return f"{name}:{','.join({**options, option: f'{option}={value}'}.values())}"


def _sort_key(row: LeaderboardRow) -> tuple[float, float]:
    success = -1.0 if row.success_1dof is None else row.success_1dof
    return -success, inf if row.median_error_dof is None else row.median_error_dof
