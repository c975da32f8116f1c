"""Repetition of an evaluation: its methods are run again on the dataset, and every record is compared."""

import math
import socket
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from saf_gen import __version__
from saf_gen.benchmark.admission import admit_method
from saf_gen.benchmark.evaluate import ProgressCallback, evaluate
from saf_gen.benchmark.guests.host import Limits
from saf_gen.benchmark.method_spec import Method, split_region
from saf_gen.benchmark.records import OVER_A_LIMIT, RECORDS_FILE, Record, read_records
from saf_gen.core.config.json_document import read_json
from saf_gen.core.config.registry import refuse_code
from saf_gen.core.cores import describe_machine
from saf_gen.core.plain_text import plural
from saf_gen.errors import BadInput
from saf_gen.leaderboard.merging import merge_records
from saf_gen.leaderboard.ranking import group_by
from saf_gen.leaderboard.results import describe_records
from saf_gen.leaderboard.verification import RowVerdict, Verification, digest_answers, to_comparable
from saf_gen.stream.manifest import ALL_SPLITS

if TYPE_CHECKING:
    from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol

TOLERANCE = 1e-9
"""Relative and absolute difference up to which two numbers count as equal; processors round sums differently."""


def verify(
    folder: Path,
    source: Path,
    *,
    methods: Sequence[str] = (),
    scene_motion: str | None = None,
    protocol: "ClosedLoopProtocol | None" = None,
    progress: ProgressCallback | None = None,
) -> Verification:
    """Rerun the methods of an evaluation whose code is available, and compare all records but for time and machine.

    A row is reproduced if it has one record of each sequence of the split, and no other.

    Parameters
    ----------
    folder : Path
        Folder of the evaluation; nothing is written to it.
    source : Path
        Dataset, or stream, from which the evaluation was made.
    methods : sequence of str, optional
        Methods in files that the user trusts, such as ``file.py:Class+argmax`` or ``@FILE``. They are matched to rows
        by the digest of their code.
    scene_motion : str, optional
        Scene motion of the sequences that were evaluated; by default any.
    protocol : ClosedLoopProtocol, optional
        Protocol of a closed-loop evaluation.
    progress : callable, optional
        Called with the number of steps done, the number of all steps, and a description of the last step.

    Returns
    -------
    Verification
        The verdict on each row, not signed.

    Raises
    ------
    BadInput
        If the records cannot be read or make no table, the dataset cannot be evaluated, or no row was made by the code
        of one of ``methods``.
    """
    records = read_records(folder)
    merge_records({str(folder): records})  # refuses missing and double records, among others
    rows = group_by(records, "who.method")
    trusted = {method.code: method for method in map(admit_method, methods)}
    for method in trusted.values():
        if method.code not in {group[0].who.code for group in rows.values()}:
            raise BadInput(
                f"no row of {folder} was made by the code of {method.name!r}", hint="see its leaderboard.json"
            )
    runs: dict[str, Method] = {}
    reasons: dict[str, str] = {}
    for label, group in rows.items():
        if ended := [record for record in group if record.judgement.note.startswith(OVER_A_LIMIT)]:
            runs_ended = f"{len(ended)} of {plural(len(group), 'run')} ended at a limit ({ended[0].who.limits})"
            reasons[label] = f"not comparable: {runs_ended}"
            continue
        found = _find_method(group[0], trusted=trusted, where=str(folder))
        if isinstance(found, Method):
            runs[label] = found
        else:
            reasons[label] = found
    if runs:
        header = _compare_header(folder, records)
        split = _only(record.what.split for record in records) or ALL_SPLITS
        regions = {record.who.region for record in records if "@" not in record.who.method}
        limits = _only(rows[label][0].who.limits for label, method in runs.items() if method.guest is not None)
        result = evaluate(
            source,
            methods=[method.name for method in runs.values()],
            split=split,
            scene_motion=scene_motion,
            region=_only(regions - {"frame"}) or ("frame" if regions == {"frame"} else "target"),
            protocol=protocol,
            progress=progress,
            limits=Limits.parse(limits) if limits else None,
        )
        again = {(record.who.method, record.what.sequence): record for record in result.records}
        unread = {failure.sequence: failure.problem for failure in result.failures}
        for label, method in runs.items():
            row = {
                sequence: replace(record, who=replace(record.who, method=label, tuning=method.tuning))
                for (name, sequence), record in again.items()
                if name == method.name
            }
            reasons[label] = _compare(rows[label], row, unread=unread, split=split) or header
    verdicts = (
        RowVerdict(label, _state(reasons[label], was_run=label in runs), reasons[label], digest_answers(group))
        for label, group in rows.items()
    )
    return Verification(tuple(verdicts), source.resolve().name, socket.gethostname(), describe_machine(), __version__)


def _find_method(row: Record, *, trusted: Mapping[str, Method], where: str) -> Method | str:
    """Return the given or registered method with the code of a row, or the reason why there is no such method."""
    if given := trusted.get(row.who.code):
        region = split_region(row.who.method)[1]
        named = admit_method(f"{split_region(given.name)[0]}@{region}") if region else given
        return replace(named, tuning=given.tuning)
    if row.who.tuning:
        return f"its constants are of the tuned file {row.who.tuning}: name it with --method @FILE"
    try:
        with refuse_code(where):
            method = admit_method(row.who.method)
    except BadInput as error:
        return f"no method on this machine can reproduce this row: {error.problem}"
    return method if method.code == row.who.code else f"its code differs: here {method.code}, in the row {row.who.code}"


def _only(values: Iterable[str | None]) -> str | None:
    """Return the common value of all, or None if they differ."""
    distinct = set(values)
    return distinct.pop() if len(distinct) == 1 else None


def _state(reason: str, *, was_run: bool) -> Literal["re-run here", "differs", "claimed"]:
    if not was_run:
        return "claimed"
    return "differs" if reason else "re-run here"


def _compare(records: Sequence[Record], again: Mapping[str, Record], *, unread: Mapping[str, str], split: str) -> str:
    """Return a description of the first difference and the number of sequences that differ, or '' if none does."""
    row = {record.what.sequence: to_comparable(record) for record in records}
    differing = []
    for name in {**again, **unread, **row}:
        if name in unread:
            differing.append(f"{name} cannot be evaluated: {unread[name]}")
        elif name not in again:
            differing.append(f"{name} is not in split {split}")
        elif name not in row:
            differing.append(f"no record of {name}")
        elif unequal := _compare_record(row[name], to_comparable(again[name])):
            differing.append(f"{name}: {unequal}")
    every = plural(len({**again, **unread, **row}), "sequence")
    return f"{differing[0]} ({len(differing)} of {every})" if differing else ""


def _compare_record(says: Mapping[str, Any], gives: Mapping[str, Any]) -> str:
    """Return a description of the first key that differs, the data before all others, or '' if none does."""
    for key in ("data", *says, *gives):
        if (key in says, key in gives) != (True, True) or not _is_same(says[key], gives[key]):
            values = (f"{values[key]!r:.40}" if key in values else "missing" for values in (says, gives))
            return f"{key} is {', but '.join(values)} when run again"
    return ""


def _compare_header(folder: Path, records: Sequence[Record]) -> str:
    """Return in what leaderboard.json contradicts the records beside it, or ''; also '' if there is no such file."""
    path = (folder if folder.is_dir() else folder.parent) / "leaderboard.json"
    if not path.is_file():
        return ""
    document, header = read_json(path).data, describe_records(records)
    says = _flatten(header)
    stated = _flatten({key: document.get(key) for key in header}) if isinstance(document, dict) else {}
    odd = next((key for key in {**says, **stated} if says.get(key) != stated.get(key)), "")
    return f"{path.name} and {RECORDS_FILE} differ in {odd}" if odd else ""


def _flatten(header: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values by key, or by key and name where a key has values by name."""
    flat: dict[str, Any] = {}
    for key, value in header.items():
        flat |= {f"{key} of {name}": one for name, one in value.items()} if isinstance(value, dict) else {key: value}
    return flat


def _is_same(one: object, other: object) -> bool:
    if isinstance(one, float) and isinstance(other, float):
        return math.isclose(one, other, rel_tol=TOLERANCE, abs_tol=TOLERANCE)
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(_is_same, one, other))
    return one == other
