"""Checks of a submission: what is missing, and what does not fit together. No code of the folder is run."""

import ast
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Literal

from saf_gen.benchmark.method_spec import split_method_options, split_method_region
from saf_gen.benchmark.records import RECORDS_FILE, Record, read_records
from saf_gen.benchmark.tracks.predictions import read_method_predictions
from saf_gen.benchmark.tracks.sequence_tasks import list_sequences_to_evaluate
from saf_gen.benchmark.tuned_method import read_tuned_method
from saf_gen.core.config.document import check_plain_file
from saf_gen.core.config.registry import names
from saf_gen.errors import BadInput, unknown
from saf_gen.leaderboard.submission.card import SubmissionCard, read_submission
from saf_gen.leaderboard.verification import DIFFERS, HERE, read_leaderboard_row_states
from saf_gen.stream.manifest import read_manifest

EVALUATION = "evaluation"
JUDGED_SPLIT = "test"
MAX_METHOD_BYTES = 1 << 22


@dataclass(frozen=True)
class SubmissionFinding:
    """One line of one check: its level, and what was found or what to do."""

    check: str
    level: Literal["ok", "warning", "error"]
    text: str


def check_submission(folder: Path, *, dataset: Path | None = None) -> Iterator[SubmissionFinding]:
    """Yield what each check found; a submission is complete where none is an error.

    With ``dataset`` the answers are held against its sequences. Raises BadInput for a card that cannot be read, and
    where ``dataset`` holds no sequence of the split.
    """
    card = read_submission(folder)
    yield from _check_card(card)
    if dataset is not None:
        yield from _check_dataset(card, dataset)
    yield from _check_what_is_handed_in(card, folder)
    yield from _check_constants(card, folder)
    yield from _check_answers(card, folder, dataset=dataset)
    missing = [name.replace("_", " ") for name, stated in card.statements if not stated]
    if missing:
        yield SubmissionFinding("statements", "error", f"not vouched for: {'; '.join(missing)}")
    else:
        yield SubmissionFinding("statements", "ok", "all three are vouched for")


def _check_card(card: SubmissionCard) -> Iterator[SubmissionFinding]:
    for key in ("title", "authors", "licence", "date"):
        if not getattr(card, key):
            yield SubmissionFinding(key, "error", "empty: fill it in")
    if card.date:
        try:
            date.fromisoformat(card.date)
            yield SubmissionFinding("date", "ok", card.date)
        except ValueError:
            yield SubmissionFinding("date", "error", f"{card.date!r} is no day; allowed: a day as 2026-11-22")
    if card.licence and not re.fullmatch(r"[A-Za-z0-9.+-]+( (AND|OR|WITH) [A-Za-z0-9.+-]+)*", card.licence):
        yield SubmissionFinding("licence", "error", f"{card.licence!r} is no SPDX name, such as Apache-2.0")


def _check_dataset(card: SubmissionCard, dataset: Path) -> Iterator[SubmissionFinding]:
    name = read_manifest(dataset).name if dataset.is_dir() else dataset.stem
    if name != card.dataset:
        yield SubmissionFinding("dataset", "error", f"the card names {card.dataset}, and {dataset} is {name}")


def _check_what_is_handed_in(card: SubmissionCard, folder: Path) -> Iterator[SubmissionFinding]:
    if bool(card.method) == bool(card.predictions):
        both = "method and predictions are both given" if card.method else "neither method nor predictions is given"
        yield SubmissionFinding("method", "error", f"{both}: name one of the two")
    elif card.predictions:
        try:
            read_method_predictions(_file_of(folder, card.predictions))
            yield SubmissionFinding("predictions", "ok", f"{card.predictions} is read; its row will be a claim")
        except BadInput as error:
            yield SubmissionFinding("predictions", "error", str(error))
    else:
        try:
            _check_method(card.method, folder)
            yield SubmissionFinding("method", "ok", f"{card.method}; run its checks: saf-gen methods check")
        except BadInput as error:
            yield SubmissionFinding("method", "error", str(error))


def _check_method(method: str, folder: Path) -> None:
    """Raise BadInput unless both halves of a method are registered, or stand in a file of the folder."""
    halves = split_method_region(method)[0].split("+")
    if len(halves) != 2:
        raise BadInput(f"method {method!r}", allowed="MEASURE+SEARCH, such as method.py:Mine+argmax")
    for half, kind in zip(halves, ("measures", "searches"), strict=True):
        name = split_method_options(half)[0]
        file, _, member = name.rpartition(":")
        if not file:
            if name not in names(kind):
                raise unknown(kind.removesuffix("s"), name, allowed=names(kind))
        elif not file.endswith(".py"):
            raise BadInput(f"{name!r} is code outside the folder", allowed="a file of the folder, as method.py:Mine")
        else:
            _check_member(_file_of(folder, file), member, has_forms=kind == "measures")


def _check_member(file: Path, member: str, *, has_forms: bool) -> None:
    """Raise BadInput unless a Python file defines this class or function; the file is read, not run.

    A measure has forms beside its own name, with ``_n``, ``_tfi`` or both at the end.
    """
    check_plain_file(file, most=MAX_METHOD_BYTES)
    try:
        body = ast.parse(file.read_bytes()).body
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise BadInput(f"{file} is not Python: {error}") from error
    defined = [one.name for one in body if isinstance(one, ast.ClassDef | ast.FunctionDef)]
    forms = {member, member.removesuffix("_tfi"), member.removesuffix("_tfi").removesuffix("_n")}
    if not (forms if has_forms else {member}) & set(defined):
        raise unknown(f"class or function of {file}:", member, allowed=defined)


def _file_of(folder: Path, name: str) -> Path:
    """Return a file of the folder; raise BadInput where there is none, or where it lies outside."""
    file = (folder / name).resolve()
    if not file.is_relative_to(folder.resolve()):
        raise BadInput(f"{name} lies outside of {folder}", hint="copy it into the folder")
    if not file.is_file():
        raise BadInput(f"{name} is not in {folder}", hint="copy it into the folder")
    return file


def _check_constants(card: SubmissionCard, folder: Path) -> Iterator[SubmissionFinding]:
    if not card.constants:
        return
    try:
        tuned = read_tuned_method(_file_of(folder, card.constants))[0]
    except BadInput as error:
        yield SubmissionFinding("constants", "error", str(error))
        return
    if tuned.split == JUDGED_SPLIT:
        yield SubmissionFinding("constants", "error", f"tuned on the split {tuned.split}: tune on train or validation")
    else:
        tried = f"{len(tuned.trials)} trials on the split {tuned.split} of {tuned.dataset}"
        yield SubmissionFinding("constants", "ok", f"{tried} gave {tuned.method}")


def _check_answers(card: SubmissionCard, folder: Path, *, dataset: Path | None) -> Iterator[SubmissionFinding]:
    data = dataset or "DATASET"
    again = f"run saf-gen evaluate {data} --split {JUDGED_SPLIT} --out {folder / EVALUATION} with your method"
    tasks = None if dataset is None else {t.id for t in list_sequences_to_evaluate(dataset, split=JUDGED_SPLIT)}
    if not (folder / EVALUATION / RECORDS_FILE).is_file():
        yield SubmissionFinding("answers", "error", f"there is no {EVALUATION}/{RECORDS_FILE}: {again}")
        return
    try:
        every = read_records(folder / EVALUATION)
    except BadInput as error:
        yield SubmissionFinding("answers", "error", str(error))
        return
    own = select_records_of_submission(every, card)
    if not own:
        rows = ", ".join(sorted({record.method for record in every}))
        yield SubmissionFinding("answers", "error", f"no row is of {card.method or card.name}, but of {rows}")
        return
    yield from _check_records(own, card, tasks=tasks)
    state = read_leaderboard_row_states(folder / EVALUATION, every).get(own[0].method)
    if state == DIFFERS:
        yield SubmissionFinding("verified", "error", f"answers differ when they are run again: {again}")
    elif state == HERE or card.predictions:
        yield SubmissionFinding("verified", "ok", state or "answers of another program stay a claim")
    else:
        how = f"saf-gen leaderboard verify {folder / EVALUATION} --on {data}"
        named = f" --method {folder / card.method}" if ".py:" in card.method else ""
        yield SubmissionFinding("verified", "warning", f"{state or 'nobody has run it again'}: {how}{named}")


def _check_records(own: list[Record], card: SubmissionCard, *, tasks: set[str] | None) -> Iterator[SubmissionFinding]:
    sequences = {record.sequence for record in own}
    if any(record.track != card.track for record in own):
        yield SubmissionFinding("answers", "error", f"they are of the track {own[0].track}, not {card.track}")
    elif tasks is not None and sequences != tasks:
        odd = sorted(sequences ^ tasks)
        yield SubmissionFinding(
            "answers", "error", f"{len(sequences)} sequences, and {len(tasks)} in the dataset: {odd[0]} is in one alone"
        )
    else:
        right = sum(record.success_1dof is True for record in own)
        complete = "all of the split" if tasks is not None else "hold them against the dataset with --on"
        yield SubmissionFinding(
            "answers", "ok", f"{len(sequences)} sequences ({complete}), {right} within 1 depth of focus"
        )


def select_records_of_submission(records: Iterable[Record], card: SubmissionCard) -> list[Record]:
    """Return the records of the submission's row: its file may have been named by a longer path."""
    name = card.name if card.predictions else card.method
    own = [record for record in records if record.method == name or record.method.endswith(f"/{name}")]
    return [record for record in own if record.method == own[0].method]
