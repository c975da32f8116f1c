"""Merging of records into one table, which requires the same data, code, track and evaluator version."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from saf_gen.benchmark.records import Record
from saf_gen.core.region import REGIONS
from saf_gen.errors import BadInput

REGION_SUFFIXES = tuple(f"@{region}" for region in REGIONS)
_HINT = "run saf-gen evaluate again"
_RULES = {
    "track": "one track per table",
    "evaluator version": "one version of the evaluator per table",
    "data digest": "one content_sha256 per sequence",
    "region": "one region per sequence, except for methods whose names state a region",
    "protocol": "one budget and one lens drive for all methods of a sequence",
    "code digest": "one version of a method per table",
}
_SEQUENCE_KEYS = {
    "scene": "scene",
    "light": "light",
    "split": "split",
    "scene_motion": "scene motion",
    "lens_motion": "lens motion",
    "focus_place": "focus position",
    "focus_off_dof": "distance to the focus",
    "mean_rate": "photon budget",
    "sensor": "sensor",
    "stratum": "stratum",
}
"""Keys of a record that describe its sequence, with their names in messages. Tables weight and sort by these keys."""


def merge_records(runs: Mapping[str, Sequence[Record]]) -> list[Record]:
    """Return the records of all runs as one list, with sequences and methods in order of first appearance.

    If several runs hold the same method on the same sequence, the first record is kept.

    Parameters
    ----------
    runs : mapping of str to sequence of Record
        Records of each run, by its name. If there is a single run, error messages name methods instead of runs.

    Returns
    -------
    list of Record
        One record for each pair of a sequence and a method, sequence by sequence.

    Raises
    ------
    BadInput
        If two runs differ in the splits that they ranked; if two runs or methods differ in track, evaluator version,
        protocol, data, region or code, or in properties of a sequence; if a method lacks a sequence; if two runs give
        different answers for the same method and sequence; or if a run holds two records of one method on one sequence.
        The message names both sides.
    """
    _check_same_splits(runs)
    runs = name_sensors(runs)
    first_records: dict[tuple[str, str], tuple[str, Record]] = {}
    first_claims: dict[tuple[str, str], tuple[str, str]] = {}
    for run, records in runs.items():
        for record in records:
            for what, subject, value, side in _claims(record, run, is_only_run=len(runs) == 1):
                first = first_claims.setdefault((what, subject), (value, side))
                if first[0] != value:
                    raise _difference(what, subject, first=first, second=(value, side))
            key = (record.what.sequence, record.who.method)
            if key in first_records:
                _check_same_answer(first_records[key], (run, record))
            first_records.setdefault(key, (run, record))
    methods = list(dict.fromkeys(method for _, method in first_records))
    sequences = list(dict.fromkeys(sequence for sequence, _ in first_records))
    for method in methods:
        if missing := [s for s in sequences if (s, method) not in first_records]:
            more = f" and {len(missing) - 1} more" if len(missing) > 1 else ""
            runs_of = dict.fromkeys(run for (_, other), (run, _) in first_records.items() if other == method and run)
            where = f" of {' and '.join(runs_of)}" if runs_of else ""
            raise BadInput(
                f"{method}{where} has no record of {missing[0]}{more}",
                allowed="the same sequences for every method",
                hint="run saf-gen evaluate for all methods on one dataset and split",
            )
    return [first_records[s, m][1] for s in sequences for m in methods]


def _check_same_splits(runs: Mapping[str, Sequence[Record]]) -> None:
    """Raise BadInput if two runs ranked different splits; streams that were evaluated one by one belong to none."""
    ranked = {
        run: tuple(dict.fromkeys(r.what.split for r in records if r.what.split is not None))
        for run, records in runs.items()
    }
    named = [(run, splits) for run, splits in ranked.items() if splits]
    for run, splits in named[1:]:
        if set(splits) != set(named[0][1]):
            sides = (f"{' and '.join(some):.60} in {one}" for one, some in (named[0], (run, splits)))
            raise BadInput(
                f"the splits differ: {', '.join(sides)}",
                allowed="the same splits in all evaluations",
                hint=f"{_HINT}, with --split",
            )


def name_sensors(runs: Mapping[str, Sequence[Record]]) -> Mapping[str, Sequence[Record]]:
    """Return the runs with ``@SENSOR`` appended to the names of sequences if two sensors recorded the same sequence.

    This happens with two datasets of one recipe that differ only in the sensor. Records of earlier versions do not
    state their sensor; it is then taken from another record of the same data. If no record states it, the record is
    returned unchanged.
    """
    sensors = {
        (r.what.sequence, r.what.data): r.what.sensor
        for group in runs.values()
        for r in group
        if r.what.sensor is not None
    }
    if not sensors:
        return runs
    bare = {name: name.removesuffix(f"@{sensor}") for (name, _), sensor in sensors.items()}
    both = {(bare[name], sensor) for (name, _), sensor in sensors.items()}
    differ = len(both) > len({name for name, _ in both})

    def name_sensor(record: Record) -> Record:
        sensor = sensors.get((record.what.sequence, record.what.data))
        if sensor is None:
            return record
        name = f"{bare[record.what.sequence]}@{sensor}" if differ else record.what.sequence
        same = name == record.what.sequence and sensor == record.what.sensor
        return record if same else replace(record, what=replace(record.what, sequence=name, sensor=sensor))

    return {run: [name_sensor(record) for record in group] for run, group in runs.items()}


def _claims(record: Record, run: str, *, is_only_run: bool) -> Iterator[tuple[str, str, str, str]]:
    """Yield (property, subject, value, source) for each property in which records must agree.

    Error messages name the source: the run or, if there is only one run, the method (for a code digest, the sequence).
    """
    side = record.who.method if is_only_run else run
    yield "track", "", record.what.track, side
    yield "evaluator version", "", record.what.rig, side
    yield "protocol", record.what.sequence, record.what.terms, side
    yield "data digest", record.what.sequence, record.what.data, side
    if not record.who.method.endswith(REGION_SUFFIXES):
        yield "region", record.what.sequence, record.who.region, side
    for key, name in _SEQUENCE_KEYS.items():
        value = getattr(record.what, key)
        yield name, record.what.sequence, "" if value is None else str(value), side
    yield "code digest", record.who.method, record.who.code, record.what.sequence if is_only_run else run


def _difference(what: str, subject: str, *, first: tuple[str, str], second: tuple[str, str]) -> BadInput:
    of = f" of {subject}" if subject else ""
    sides = (f"{value or f'no {what}':.60} in {side}" for value, side in (first, second))
    return BadInput(
        f"the {what}{of} differs: {', '.join(sides)}",
        allowed=_RULES.get(what, f"one {what} per sequence"),
        hint=_HINT if what in _RULES else f"{_HINT}, on the dataset, not on its streams one by one",
    )


def _check_same_answer(one: tuple[str, Record], other: tuple[str, Record]) -> None:
    (run, record), (second_run, second) = one, other
    if run == second_run:
        raise BadInput(
            f"two records of {record.who.method} on {record.what.sequence}", where=run, allowed="one per sequence"
        )
    answers = [(x.status, x.frame, x.position) for x in (record.judgement, second.judgement)]
    if answers[0] != answers[1]:
        raise BadInput(
            f"the answer of {record.who.method} on {record.what.sequence} differs between {run} and {second_run}, "
            "with the same data and code",
            allowed="the same answer, or one of the two runs",
            hint=_HINT,
        )
