"""Verification of a table: the file next to an evaluation that states which rows were reproduced, and where.

A table may come from anybody. A row is *re-run here* if its method, run again from code on this machine, gave a record
of each sequence of the split, and the row has exactly these records, except for time and machine; *re-run elsewhere* if
the file states that for another machine or is not signed by this user; *differs* if a record is different or missing;
and *claimed* if it was not or could not be run again. The signature is made with a secret of the user, so an untrusted
folder cannot contain a row that counts as *re-run here*.
"""

import hashlib
import json
import socket
from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Literal

from pydantic import ConfigDict

from saf_gen.benchmark.records import Record, pop_format, record_to_json
from saf_gen.core.config.document import STRICT, read_text, validate_document
from saf_gen.core.config.json_document import format_checked_json, parse_checked_json
from saf_gen.core.cores import describe_machine
from saf_gen.core.files import write_text
from saf_gen.core.user_folder import is_signed, sign_as_user
from saf_gen.leaderboard.ranking import group_by

VERIFICATION_FILE = "verification.json"
FORMAT = "saf-gen verification 1"
RERUN_HERE, RERUN_ELSEWHERE, DIFFERS, CLAIMED = "re-run here", "re-run elsewhere", "differs", "claimed"
TIME_AND_MACHINE = frozenset({"seconds", "machine", "reference_rate"})
"""Keys of a record whose values may differ between two runs of the same method; all others are compared."""
PROVES = (
    "this code, with the digest in the records, gave these answers again from counts and lens positions; not proved: "
    "that it had never seen the answers (rank on a split drawn after the method), or that it read nothing else here "
    "(read it, or verify in a container)"
)
"""What a row that is re-run here proves, and what not."""
HINT = "run saf-gen leaderboard verify again"


@dataclass(frozen=True)
class RowVerdict:
    """Verdict on one method: whether running it again gave the same answers.

    Attributes
    ----------
    method : str
        Name of the method in the evaluation.
    state : str
        ``re-run here``, ``differs`` or ``claimed``.
    reason : str
        Why the answers were not reproduced; '' if they were.
    answers : str
        First 16 hexadecimal digits of a SHA-256 of the method's records without time and machine. The verdict holds
        only for these answers.
    """

    __pydantic_config__: ClassVar[ConfigDict] = STRICT

    method: str
    state: Literal["re-run here", "differs", "claimed"]
    reason: str
    answers: str


@dataclass(frozen=True)
class Verification:
    """The verdict on each row of an evaluation, and the machine on which it was reached."""

    __pydantic_config__: ClassVar[ConfigDict] = STRICT

    verdicts: tuple[RowVerdict, ...]
    dataset: str
    host: str
    machine: str
    version: str
    signature: str = ""
    """Signature of the user who ran the verification, in hexadecimal digits; '' if there is no signature."""


def write_verification(folder: Path, verification: Verification) -> Path:
    """Sign the verification, write it as ``verification.json`` next to its records, and return the path."""
    path = folder / VERIFICATION_FILE
    signature = sign_as_user(_signed_text(verification))
    signed = replace(verification, signature="" if signature is None else signature.hex())
    write_text(path, format_checked_json({"format": FORMAT, **asdict(signed)}, indent=1) + "\n")
    return path


def _signed_text(verification: Verification) -> bytes:
    return json.dumps(["verification", asdict(replace(verification, signature=""))], sort_keys=True).encode()


def read_row_states(run: Path, records: Iterable[Record]) -> dict[str, str]:
    """Return the state of each row according to the ``verification.json`` of an evaluation.

    Verdicts on answers other than those in ``records`` are ignored, and ``re-run here`` becomes ``re-run elsewhere`` if
    the file comes from another machine or is not signed by this user.

    Parameters
    ----------
    run : Path
        Folder of the evaluation, or a file in it.
    records : iterable of Record
        Records of the evaluation.

    Returns
    -------
    dict of str to str
        State by method; empty if there is no such file.

    Raises
    ------
    BadInput
        If the file is damaged.
    """
    path = (run if run.is_dir() else run.parent) / VERIFICATION_FILE
    if not path.is_file():
        return {}
    document = parse_checked_json(read_text(path, hint=HINT), path, hint=HINT)
    pop_format(document, FORMAT, what="verification", hint=HINT)
    verification = validate_document(Verification, document, hint=HINT)
    is_here = (verification.host, verification.machine) == (socket.gethostname(), describe_machine())
    is_here = is_here and _is_signed(verification)
    found = {verdict.method: verdict for verdict in verification.verdicts}
    return {
        method: found[method].state if is_here or found[method].state != RERUN_HERE else RERUN_ELSEWHERE
        for method, group in group_by(records, "who.method").items()
        if method in found and found[method].answers == digest_answers(group)
    }


def _is_signed(verification: Verification) -> bool:
    try:
        return is_signed(_signed_text(verification), bytes.fromhex(verification.signature))
    except ValueError:
        return False


def digest_answers(records: Iterable[Record]) -> str:
    """Return the first 16 hexadecimal digits of a SHA-256 of the records without time and machine.

    The digest does not depend on the order of the records.
    """
    lines = sorted(json.dumps(to_comparable(record), ensure_ascii=False) for record in records)
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()[:16]


def to_comparable(record: Record) -> dict[str, Any]:
    """Return the record in plain JSON types, with null in place of the values of TIME_AND_MACHINE.

    The version of Landlock is a matter of the machine, too.
    """
    record = replace(record, who=replace(record.who, limits=record.who.limits.partition(", Landlock ")[0]))
    return {key: None if key in TIME_AND_MACHINE else value for key, value in record_to_json(record).items()}
