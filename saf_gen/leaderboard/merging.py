"""Which records may stand in one table: those of the same data, the same code, the same rig and track."""

from collections.abc import Iterator, Mapping, Sequence

from saf_gen.benchmark.records import Record
from saf_gen.core.region import REGIONS
from saf_gen.errors import BadInput

__all__ = ["merge_records"]

REGION_SUFFIXES = tuple(f"@{region}" for region in REGIONS)
_AGAIN = "run saf-gen evaluate again"
_RULES = {
    "track": "one track in a table",
    "rig": "one version of the evaluator in a table",
    "data": "one content_sha256 a sequence",
    "region": "one region a sequence, but of methods that name theirs",
    "terms": "one budget and one lens drive for all methods of a sequence",
    "code": "one version of a method in a table",
}
_KNOWN = {
    "scene": "scene",
    "light": "light",
    "split": "split",
    "variant": "variant",
    "scene_motion": "scene motion",
    "lens_motion": "lens motion",
    "truth_first": "truth",
    "focus_place": "place of the focus",
    "focus_off_dof": "way to the focus",
    "mean_rate": "photon budget",
}
"""What a record tells of its sequence, and its name: tables weigh and sort by it."""


def merge_records(runs: Mapping[str, Sequence[Record]]) -> list[Record]:
    """The records of all runs, by name, as one list: sequences and methods in the order of the first to come.

    What two runs hold of one method and sequence is kept once, the first, where the answers are the same.

    Raises BadInput, naming both sides, for two tracks or versions of the rig; a sequence with two data
    digests, regions or terms, or of which two scenes, lights or other properties are told, as a stream on its
    own does not know them; a method with two versions of its code; a pair of method and sequence that is
    there twice with different answers, or twice in one run, or not at all.
    """
    held: dict[tuple[str, str], tuple[str, Record]] = {}
    said: dict[tuple[str, str], tuple[str, str]] = {}
    for run, records in runs.items():
        for record in records:
            for what, subject, value, side in _claims(record, run, alone=len(runs) == 1):
                first = said.setdefault((what, subject), (value, side))
                if first[0] != value:
                    raise _mixed(what, subject, first, (value, side))
            key = (record.sequence, record.method)
            if key in held:
                _same_answer(held[key], (run, record))
            held.setdefault(key, (run, record))
    methods = list(dict.fromkeys(method for _, method in held))
    sequences = list(dict.fromkeys(sequence for sequence, _ in held))
    for method in methods:
        if missing := [s for s in sequences if (s, method) not in held]:
            more = f" and {len(missing) - 1} more" if len(missing) > 1 else ""
            runs_of = dict.fromkeys(run for (_, other), (run, _) in held.items() if other == method and run)
            where = f" of {' and '.join(runs_of)}" if runs_of else ""
            raise BadInput(
                f"{method}{where} has no record of {missing[0]}{more}",
                allowed="the same sequences for every method",
                hint="run saf-gen evaluate for all methods on one dataset and split",
            )
    return [held[s, m][1] for s in sequences for m in methods]


def _claims(record: Record, run: str, *, alone: bool) -> Iterator[tuple[str, str, str, str]]:
    """(what, of what, value, who says so): in a single run records speak for themselves."""
    side = record.method if alone else run
    yield "track", "", record.track, side
    yield "rig", "", record.rig, side
    yield "terms", record.sequence, record.terms, side
    yield "data", record.sequence, record.data, side
    if not record.method.endswith(REGION_SUFFIXES):  # which looks there, whatever the others do
        yield "region", record.sequence, record.region, side
    for key, what in _KNOWN.items():
        value = getattr(record, key)
        yield what, record.sequence, "" if value is None else str(value), side
    yield "code", record.method, record.code, record.sequence if alone else run


def _mixed(what: str, subject: str, first: tuple[str, str], second: tuple[str, str]) -> BadInput:
    none = f"no {what}"
    of = f" of {subject}" if subject else ""
    return BadInput(
        f"the {what}{of} {'differ' if what == 'terms' else 'differs'}: "
        f"{first[0] or none:.60} in {first[1]}, {second[0] or none:.60} in {second[1]}",
        allowed=_RULES.get(what, f"one {what} a sequence"),
        hint=_AGAIN if what in _RULES else f"{_AGAIN}, on the dataset, not on its streams one by one",
    )


def _same_answer(one: tuple[str, Record], other: tuple[str, Record]) -> None:
    (run, record), (second_run, second) = one, other
    if run == second_run:
        raise BadInput(
            f"two records of {record.method} on {record.sequence}", where=run, allowed="one a sequence"
        )
    if (record.status, record.frame, record.position) != (second.status, second.frame, second.position):
        raise BadInput(
            f"{record.method} answers {record.sequence} otherwise in {run} than in {second_run}, "
            "with the same data and code",
            allowed="the same answer, or one of the two runs",
            hint=_AGAIN,
        )
