"""Tuning of the constants of a method: the best of a grid, or of as many draws as every other method has.

Constants are tuned on the split train; the split test is reserved for finished methods. A method that was
tuned in many forms wins against one that was tuned in few: draws give every method the same number of trials, by the
same rule, from a random stream that only its name and the number of draws determine.
"""

import ast
import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import product
from math import inf, log10, prod
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from saf_gen import __version__
from saf_gen.benchmark.admission import admit_method
from saf_gen.benchmark.evaluate import evaluate
from saf_gen.benchmark.kept_sequences import KeptSequences
from saf_gen.benchmark.method_folder import ends_as_folder
from saf_gen.benchmark.method_spec import TunedMethod, TuningTrial, split_halves, split_options, split_region
from saf_gen.benchmark.records import Record
from saf_gen.core.files import name_as_text
from saf_gen.core.region import REGIONS
from saf_gen.core.seeds import make_generator
from saf_gen.errors import BadInput, SafGenError, unknown
from saf_gen.leaderboard import LeaderboardRow, rank_methods
from saf_gen.leaderboard.ranking import RULE, mean_over_scenes
from saf_gen.plugins.searches import REJECT
from saf_gen.stream.manifest import TEST_SPLIT, read_manifest
from saf_gen.stream.recordings import open_recording

if TYPE_CHECKING:
    from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol

MAX_TRIALS = 1000
"""Largest number of combinations or draws in one run."""
FRAMES = ("window", "dt", "control_period")
"""Options that are a number of frames in a window."""
SHORTEST_S, LONGEST_S = 0.0025, 0.025
"""Range of the windows that are drawn, in seconds."""
READOUT_HZ = 20_000.0
"""Frames per second of a spike camera."""
FACTOR = 3.0
"""Largest factor by which another number is drawn above or below its value."""
ATTEMPTS = 50
"""Draws for one trial, before a method is taken to have no further choice."""
Choices = Mapping[str, Sequence[str]]
"""Values to try, by ``measure.KEY`` or ``search.KEY``."""


def expand_grid(method: str, values: Choices) -> list[str]:
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
        If there are no values, a key begins with neither ``measure.`` nor ``search.``, there are more than MAX_TRIALS
        combinations, or the measure or the search refuses a key or a value.
    """
    halves, region = _split(method, values)
    if not values:
        raise BadInput(
            "there are no values to try",
            allowed="--try search.window=50,100,200, once or several times, or --trials 24",
        )
    if (count := prod(len(choices) for choices in values.values())) > MAX_TRIALS:
        raise BadInput(
            f"there are {count} combinations of values",
            allowed=f"at most {MAX_TRIALS}",
            hint="try fewer values at a time, or draw some of them with --trials 24",
        )
    specs = [
        _with_values(halves, region, chosen=dict(zip(values, chosen, strict=True)))
        for chosen in product(*values.values())
    ]
    for spec in specs:
        admit_method(spec)
    return specs


def draw_trials(
    method: str, trials: int, *, values: Choices | None = None, readout_hz: float = READOUT_HZ
) -> list[str]:
    """Return the names of a method as it is and with ``trials`` − 1 random choices of all its constants.

    Random choices find good values of the few constants that matter sooner than a grid [1]_. Each constant is drawn in
    half of the trials, and keeps its value in the others, so that a method with many constants is not always far from
    all of them. The rule is the same for all methods: a number of frames (``window``, ``dt``) is log-uniform in 2.5 to
    25 ms, which is 50…500 frames of a spike camera, another positive number log-uniform within a factor of 3 of its
    value, and a switch, such as the right to abstain (``reject``), is on or off. An option named in ``values`` takes
    one of these; other texts and zeros stay. What the method refuses is drawn again.

    Parameters
    ----------
    method : str
        Name of a method, or ``@FILE`` for a tuned one. Constants in its name are the centres of the draws.
    trials : int
        Number of trials, at least 2.
    values : mapping of str to sequence of str, optional
        Choices for single constants, as for expand_grid.
    readout_hz : float, default 20,000
        Frames per second of the recordings.

    Returns
    -------
    list of str
        Distinct names, the method as it is first. There are fewer than ``trials`` if the constants allow no more.

    Raises
    ------
    BadInput
        If the number of trials is out of range, or as for expand_grid.

    References
    ----------
    .. [1] Bergstra and Bengio, "Random Search for Hyper-Parameter Optimization", JMLR 13, 2012,
       jmlr.org/papers/v13/bergstra12a.html.
    """
    if not 2 <= trials <= MAX_TRIALS:
        raise BadInput(f"--trials is {trials}", allowed=f"2 to {MAX_TRIALS}")
    halves, region = _split(method, values or {})
    untuned = _with_values(halves, region, chosen={})
    stated = _stated_constants(untuned)
    own = {} if f"search.{REJECT}" in stated else {f"search.{REJECT}": ("false", "true")}
    values = {**own, **(values or {})}
    for key, choices in values.items():
        for choice in choices:
            admit_method(
                _with_values(halves, region, chosen={key: choice})
            )  # reports a wrong key or value, which no draw does
    drawable = [key for key, value in stated.items() if key not in values and _is_drawn(value)]
    rng = make_generator("tuning", untuned, trials)
    found = {untuned: None}
    for _ in range(trials - 1):
        for _ in range(ATTEMPTS):
            chosen = {key: _draw(rng, key, value=stated[key], readout_hz=readout_hz) for key in drawable}
            chosen |= {key: choices[int(rng.integers(len(choices)))] for key, choices in values.items()}
            kept = {key: value for key, value in chosen.items() if rng.integers(2)}
            spec = _with_values(halves, region, chosen=kept)
            if spec in found:
                continue
            try:
                admit_method(spec)
            except BadInput:
                continue
            found[spec] = None
            break
        else:
            break
    return list(found)


def _split(method: str, values: Choices) -> tuple[dict[str, str], str]:
    """Return the names of measure and search, and the region; raise BadInput if these or the keys are bad."""
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
    return halves, region


def _with_values(halves: Mapping[str, str], region: str, *, chosen: Mapping[str, str]) -> str:
    """Return the name of the method with options set to the chosen values, which replace earlier ones."""
    spec = dict(halves)
    for key, value in chosen.items():
        half, _, option = key.partition(".")
        name, tail = split_options(spec[half])
        options = {item.partition("=")[0]: item for item in tail.split(",") if item}
        spec[half] = f"{name}:{','.join({**options, option: f'{option}={value}'}.values())}"
    return "+".join(spec.values()) + (f"@{region}" if region else "")


def _stated_constants(method: str) -> dict[str, Any]:
    """Return the constants of a method with the values that it has, by ``measure.KEY`` or ``search.KEY``.

    Those of a measure are read from the text that records store, because code of others runs in another process.
    """
    admitted = admit_method(method)
    of_measure = _keywords(admitted.parameters.partition(" + ")[0])
    found = {f"measure.{key.rstrip('_')}": value for key, value in of_measure}
    return found | {f"search.{key.rstrip('_')}": value for key, value in admitted.search_options.items()}


def _keywords(text: str) -> Iterator[tuple[str, Any]]:
    """Yield the options in a text such as ``Argmax(window=100, refine='no')``; nothing for a text of another form."""
    try:
        tree = ast.parse(text, mode="eval")
    except SyntaxError:
        return
    for node in ast.walk(tree):
        if isinstance(node, ast.keyword) and node.arg and isinstance(node.value, ast.Constant):
            yield node.arg, node.value.value


def _is_drawn(value: Any) -> bool:
    return isinstance(value, bool) or (isinstance(value, int | float) and value > 0)


def _draw(rng: np.random.Generator, key: str, *, value: Any, readout_hz: float) -> str:
    if isinstance(value, bool):
        return str(bool(rng.integers(2))).lower()
    if key.partition(".")[2] in FRAMES:
        drawn = SHORTEST_S * readout_hz * (LONGEST_S / SHORTEST_S) ** rng.random()
    else:
        drawn = value * FACTOR ** rng.uniform(-1, 1)
    rounded = round(drawn, 1 - int(log10(drawn) // 1))  # two digits, as finer steps change little and read badly
    return str(max(round(rounded), 1) if isinstance(value, int) else rounded)


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
        by_method.setdefault(record.who.method, []).append(record)
    objectives = {name: find_objective(records) for name, records in by_method.items()}
    order = {name: number for number, name in enumerate(by_method)}

    def sort_key(row: LeaderboardRow) -> tuple[float, float, int]:
        objective, error = objectives[row.method], row.median_error_dof
        return inf if objective is None else -objective, inf if error is None else error, order[row.method]

    rows = sorted(rank_methods(result.records), key=sort_key)
    data = list(dict.fromkeys(record.what.data for record in result.records))
    first = result.records[0]
    tuned = TunedMethod(
        method=rows[0].method,
        dataset=name_as_text(Path(dataset).resolve().name),
        split=split,
        track=first.what.track,
        terms=first.what.terms,
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
    is_answered = record.judgement.status == "answered"
    return float(is_answered and record.success() is True) if record.answerable else -float(is_answered)


def _readout_hz(dataset: str | Path, split: str) -> float:
    """Return the frames per second of the first recording of a split that can be read; else of a spike camera."""
    for entry in read_manifest(dataset).sequences:
        if entry.split == split:
            with suppress(BadInput, OSError), open_recording(Path(dataset) / entry.file) as recording:
                return recording.readout_hz
    return READOUT_HZ
