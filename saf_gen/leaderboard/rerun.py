"""Repetition of an evaluation: its methods are run again on the dataset, and every answer is compared."""

import math
import socket
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from saf_gen import __version__
from saf_gen.benchmark.admission import admit_method
from saf_gen.benchmark.evaluate import ProgressCallback, evaluate
from saf_gen.benchmark.method_spec import Method, split_region
from saf_gen.benchmark.records import KEYS_WHERE_KNOWN, OVER_A_LIMIT, Record, read_records
from saf_gen.core.config.registry import refuse_code
from saf_gen.core.cores import describe_machine
from saf_gen.core.plain_text import plural
from saf_gen.errors import BadInput
from saf_gen.leaderboard.outcomes import group_by
from saf_gen.leaderboard.verification import COST_AND_MACHINE, RowVerdict, Verification, digest_answers
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
    protocol: "ClosedLoopProtocol | None" = None,
    progress: ProgressCallback | None = None,
) -> Verification:
    """Rerun the methods of an evaluation whose code is available, and compare all answers.

    Parameters
    ----------
    folder : Path
        Folder of the evaluation; nothing is written to it.
    source : Path
        Dataset, or stream, from which the evaluation was made.
    methods : sequence of str, optional
        Methods in files that the user trusts, such as ``file.py:Class+argmax``. They are matched to rows by the digest
        of their code.
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
        If the records cannot be read, the dataset cannot be evaluated, or no row was made by the code of one of
        ``methods``.
    """
    rows = group_by(read_records(folder), "method")
    trusted = {method.code: method for method in map(admit_method, methods)}
    for method in trusted.values():
        if method.code not in {group[0].code for group in rows.values()}:
            raise BadInput(
                f"no row of {folder} was made by the code of {method.name!r}", hint="see its leaderboard.json"
            )
    runs: dict[str, Method] = {}
    reasons: dict[str, str] = {}
    for label, group in rows.items():
        if ended := [record for record in group if record.note.startswith(OVER_A_LIMIT)]:
            runs_ended = f"{len(ended)} of {plural(len(group), 'run')} ended at a limit ({ended[0].limits})"
            reasons[label] = f"not comparable: {runs_ended}"
            continue
        found = _find_method(label, group[0].code, trusted=trusted, where=str(folder))
        if isinstance(found, Method):
            runs[label] = found
        else:
            reasons[label] = found
    if runs:
        every = [record for group in rows.values() for record in group]
        regions = {record.region for record in every if "@" not in record.method}
        result = evaluate(
            source,
            methods=[method.name for method in runs.values()],
            split=_only(record.split for record in every) or ALL_SPLITS,
            scene_motion=_only(record.scene_motion for record in every),
            region=_only(regions - {"frame"}) or ("frame" if regions == {"frame"} else "target"),
            protocol=protocol,
            progress=progress,
            check=False,
        )
        again = {(record.method, record.sequence): record for record in result.records}
        unread = {failure.sequence: failure.problem for failure in result.failures}
        for label, method in runs.items():
            reasons[label] = _compare(
                rows[label], {s: r for (m, s), r in again.items() if m == method.name}, unread=unread
            )
    verdicts = (
        RowVerdict(label, _state(reasons[label], was_run=label in runs), reasons[label], digest_answers(group))
        for label, group in rows.items()
    )
    return Verification(tuple(verdicts), source.resolve().name, socket.gethostname(), describe_machine(), __version__)


def _find_method(label: str, code: str, *, trusted: Mapping[str, Method], where: str) -> Method | str:
    """Return the given or registered method with this code digest, or the reason why there is no such method."""
    if code in trusted:
        region = split_region(label)[1]
        return admit_method(f"{split_region(trusted[code].name)[0]}@{region}") if region else trusted[code]
    try:
        with refuse_code(where):
            method = admit_method(label)
    except BadInput as error:
        return f"no method on this machine can reproduce this row: {error.problem}"
    return method if method.code == code else f"its code differs: here {method.code}, in the row {code}"


def _only(values: Iterable[str | None]) -> str | None:
    """Return the common value of all, or None if they differ."""
    distinct = set(values)
    return distinct.pop() if len(distinct) == 1 else None


def _state(reason: str, *, was_run: bool) -> Literal["re-run here", "differs", "claimed"]:
    if not was_run:
        return "claimed"
    return "differs" if reason else "re-run here"


def _compare(records: Sequence[Record], again: Mapping[str, Record], *, unread: Mapping[str, str]) -> str:
    """Return a description of the first difference and the number of sequences that differ, or '' if none does."""
    differing = []
    for record in records:
        if record.sequence in unread:
            differing.append(f"{record.sequence} cannot be read: {unread[record.sequence]}")
        elif record.sequence not in again:
            differing.append(f"{record.sequence} is not in the dataset")
        else:
            other = replace(again[record.sequence], method=record.method)
            keys = (
                f.name
                for f in fields(Record)
                # An older record lacks the keys that follow from its answer and are left out where they are unknown.
                if not (f.name in COST_AND_MACHINE or (f.name in KEYS_WHERE_KNOWN and getattr(record, f.name) is None))
            )
            unequal = [key for key in keys if not _is_same(getattr(record, key), getattr(other, key))]
            if unequal:
                key = "data" if "data" in unequal else unequal[0]
                says, gives = getattr(record, key), getattr(other, key)
                differing.append(f"{record.sequence}: {key} is {says!r:.40}, but {gives!r:.40} when run again")
    more = f" ({len(differing)} of {plural(len(records), 'sequence')})" if differing else ""
    return f"{differing[0]}{more}" if differing else ""


def _is_same(one: object, other: object) -> bool:
    if isinstance(one, float) and isinstance(other, float):
        return math.isclose(one, other, rel_tol=TOLERANCE, abs_tol=TOLERANCE) or (one != one and other != other)
    if isinstance(one, tuple) and isinstance(other, tuple):
        return len(one) == len(other) and all(map(_is_same, one, other))
    return one == other
