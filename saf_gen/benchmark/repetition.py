"""The pairs of a method and a sequence that ``saf-gen evaluate --failed`` repeats, and the rows that it keeps.

A row is kept if a new run would give it again: its method has the same code, options and limits, the recording, the
region and the evaluator are the same, and the method read nothing that its code does not cover.
"""

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from saf_gen.benchmark.method_spec import Method
from saf_gen.benchmark.records import READ_LATE, Record, read_records
from saf_gen.benchmark.results import Evaluation
from saf_gen.benchmark.sequence_evaluation import MethodGroups
from saf_gen.benchmark.tracks.tasks import SequenceTask
from saf_gen.benchmark.versions import evaluator_version
from saf_gen.errors import BadInput
from saf_gen.stream.measure_input import choose_region
from saf_gen.stream.stream_file import open_stream

HINT = "repeat the options of the evaluation, or leave out --failed"


@dataclass(frozen=True)
class Repetition:
    """The rows of an evaluation that stay, by sequence and method, and the numbers of those that are made again."""

    kept: Mapping[tuple[str, str], Record]
    failed: int
    """Pairs that failed, and pairs of sequences that could not be read."""
    outdated: int
    """Other pairs that a new run might answer otherwise."""

    def missing(self, task: SequenceTask, groups: MethodGroups) -> MethodGroups:
        """Return the methods by region that are run on a sequence."""
        return {
            region: [method for method in group if (task.id, method.name) not in self.kept]
            for region, group in groups.items()
        }

    def complete(self, task: SequenceTask, part: Evaluation, *, groups: MethodGroups) -> Evaluation:
        """Return the evaluation of a sequence with the rows that stay, in the order of a new run."""
        rows = {record.method: record for record in part.records}
        names = [method.name for group in groups.values() for method in group]
        records = tuple(rows.get(name) or self.kept[task.id, name] for name in names)
        return replace(part, records=records)


def plan_repetition(folder: Path, tasks: Sequence[SequenceTask], *, groups: MethodGroups) -> Repetition:
    """Return what is kept of the evaluation in a folder, and what is made again.

    Raises BadInput if there are no records, or if they are of other methods, sequences or conditions.
    """
    records = read_records(folder)
    if records[0].track != "recorded":
        raise BadInput("--failed repeats pairs of the recorded track", where=str(folder), hint="leave out --failed")
    methods = {method.name: (region, method) for region, group in groups.items() for method in group}
    earlier = {(record.sequence, record.method): record for record in records}
    _check_same("methods", earlier={record.method for record in records}, now=set(methods), folder=folder)
    sequences = {record.sequence for record in records} | _unread_sequences(folder)
    _check_same("sequences", earlier=sequences, now={task.id for task in tasks}, folder=folder)
    kept = {}
    for task in tasks:
        for name, record in _sound_rows(task, methods, earlier=earlier).items():
            kept[task.id, name] = record
    pairs = len(tasks) * len(methods)
    failed = pairs - sum(record.status != "failed" for record in records)
    return Repetition(kept, failed, pairs - failed - len(kept))


def _sound_rows(
    task: SequenceTask, methods: Mapping[str, tuple[str, Method]], *, earlier: Mapping[tuple[str, str], Record]
) -> dict[str, Record]:
    """Return the rows of a sequence that a new run would give again, by method; none if it cannot be read now."""
    rig, sound = evaluator_version("recorded"), dict[str, Record]()
    try:
        with open_stream(task.path) as stream:
            data = stream.content_sha256
            regions = {region: choose_region(stream, region)[1] for region, _ in methods.values()}
    except BadInput:
        return {}
    for name, (region, method) in methods.items():
        record = earlier.get((task.id, name))
        if (
            record is not None
            and record.status != "failed"
            and all(getattr(record, key) == value for key, value in method.record_fields.items())
            and (record.data, record.region, record.rig) == (data, regions[region], rig)
            and READ_LATE not in record.note
        ):
            sound[name] = record
    return sound


def _unread_sequences(folder: Path) -> set[str]:
    """Return the sequences that the evaluation could not read."""
    with suppress(OSError, ValueError, LookupError, TypeError):  # another program may have changed the file
        document = json.loads((folder / "leaderboard.json").read_text(encoding="utf-8"))
        return {str(failure["sequence"]) for failure in document["failures"]}
    return set()


def _check_same(what: str, *, earlier: set[str], now: set[str], folder: Path) -> None:
    for names, where in ((earlier - now, "only in the evaluation"), (now - earlier, "not in the evaluation")):
        if names:
            more = f" and {len(names) - 1} more" if len(names) > 1 else ""
            raise BadInput(
                f"--failed is given for other {what}: {min(names)}{more} is {where}", where=str(folder), hint=HINT
            )
