"""Whose answers a table holds: the file beside an evaluation that says which rows were found again, and where.

A table may come from anybody. A row is *re-run here* once its method, from code that is at hand, has given every answer
again; *re-run elsewhere* where the file says that of another machine, or is not signed by this user; *differs* where an
answer is another one; and *claimed* where only the file says so. The signature is made with a secret of the user, so
that no folder of a stranger brings a row that was *re-run here*.
"""

import hashlib
import json
import socket
from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Literal

from pydantic import ConfigDict

from saf_gen.benchmark.records import Record, benchmark_record_to_json, pop_benchmark_record_format
from saf_gen.core.config.document import STRICT, read_text, validate_document
from saf_gen.core.config.json_document import format_checked_json, parse_checked_json
from saf_gen.core.cores import describe_machine
from saf_gen.core.files import write_text_atomically
from saf_gen.core.user_folder import is_signed_by_user, sign_as_user

VERIFICATION_FILE = "verification.json"
FORMAT = "saf-gen verification 1"
HERE, ELSEWHERE, DIFFERS, CLAIMED = "re-run here", "re-run elsewhere", "differs", "claimed"
COST_AND_MACHINE = frozenset({"seconds", "machine", "tuning", "note"})
"""Keys of a record that may differ between two runs of the same method."""
HINT = "run saf-gen leaderboard verify again"


@dataclass(frozen=True)
class RowVerdict:
    """Whether the answers of a method were found again; ``reason`` says why not, else ''.

    ``answers`` are 16 digits of a SHA-256 over the method's records, without cost and machine: the verdict is on these.
    """

    __pydantic_config__: ClassVar[ConfigDict] = STRICT

    method: str
    state: Literal["re-run here", "differs", "claimed"]
    reason: str
    answers: str


@dataclass(frozen=True)
class Verification:
    """The verdict on each row of an evaluation, and where it was found."""

    __pydantic_config__: ClassVar[ConfigDict] = STRICT

    verdicts: tuple[RowVerdict, ...]
    dataset: str
    host: str
    machine: str
    version: str
    signature: str = ""
    """Of the user who ran it, in hex; '' where there is none."""


def write_leaderboard_verification(folder: Path, verification: Verification) -> Path:
    """Write ``verification.json`` beside the records that it speaks of; return its path."""
    path = folder / VERIFICATION_FILE
    signature = sign_as_user(_signed_text(verification))
    signed = replace(verification, signature="" if signature is None else signature.hex())
    write_text_atomically(path, format_checked_json({"format": FORMAT, **asdict(signed)}, indent=1) + "\n")
    return path


def _signed_text(verification: Verification) -> bytes:
    return json.dumps(["verification", asdict(replace(verification, signature=""))], sort_keys=True).encode()


def read_leaderboard_row_states(run: Path, records: Iterable[Record]) -> dict[str, str]:
    """Return what the ``verification.json`` of an evaluation says of each of its rows; empty where there is none.

    A verdict on other answers than those of ``records`` does not count. Raises BadInput for a damaged file.
    """
    path = (run if run.is_dir() else run.parent) / VERIFICATION_FILE
    if not path.is_file():
        return {}
    document = parse_checked_json(read_text(path, hint=HINT), path, hint=HINT)
    pop_benchmark_record_format(document, FORMAT, what="verification", hint=HINT)
    verification = validate_document(Verification, document, hint=HINT)
    here = (verification.host, verification.machine) == (socket.gethostname(), describe_machine())
    here = here and _is_signed(verification)
    rows: dict[str, list[Record]] = {}
    for record in records:
        rows.setdefault(record.method, []).append(record)
    found = {verdict.method: verdict for verdict in verification.verdicts}
    return {
        method: found[method].state if here or found[method].state != HERE else ELSEWHERE
        for method, own in rows.items()
        if method in found and found[method].answers == digest_leaderboard_answers(own)
    }


def _is_signed(verification: Verification) -> bool:
    try:
        return is_signed_by_user(_signed_text(verification), bytes.fromhex(verification.signature))
    except ValueError:
        return False


def digest_leaderboard_answers(records: Iterable[Record]) -> str:
    """Return 16 digits of a SHA-256 over what records say of their answers, in any order of the sequences."""
    lines = sorted(json.dumps(_answer(record), ensure_ascii=False) for record in records)
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()[:16]


def _answer(record: Record) -> dict[str, Any]:
    return {key: value for key, value in benchmark_record_to_json(record).items() if key not in COST_AND_MACHINE}
