"""Submissions: the card ``submission.yaml`` with the statements of the authors, and checks for missing parts.

No code in the folder of a submission is run.
"""

import ast
import re
from collections.abc import Iterable, Iterator
from datetime import date
from pathlib import Path
from typing import Literal

from saf_gen.benchmark.method_folder import ends_as_folder
from saf_gen.benchmark.method_spec import read_folder, read_tuned, split_halves, split_options, split_region
from saf_gen.benchmark.records import RECORDS_FILE, Record, read_records
from saf_gen.benchmark.tracks.predictions import read_predictions
from saf_gen.benchmark.tracks.tasks import select_sequences_to_evaluate
from saf_gen.core.config.document import FrozenModel, check_plain_file, validate_document
from saf_gen.core.config.registry import names
from saf_gen.core.config.yaml_document import read_yaml
from saf_gen.core.files import write_text
from saf_gen.core.finding import Finding
from saf_gen.core.plain_text import plural
from saf_gen.errors import BadInput, unknown
from saf_gen.leaderboard.outcomes import right_within
from saf_gen.leaderboard.verification import DIFFERS, RERUN_HERE, read_row_states
from saf_gen.stream.manifest import TEST_SPLIT, read_manifest

CARD_FILE = "submission.yaml"
_TEMPLATE = Path(__file__).with_name("submission.yaml.in")


class Statements(FrozenModel):
    """Statements that the authors confirm, because the folder alone cannot prove them."""

    no_test_data_in_training: bool
    """Neither training nor tuning has seen the split ``test``."""
    test_was_run_once: bool
    """Nothing was chosen by results on the split ``test``."""
    answers_use_no_truth: bool
    """The method read neither the truth nor the provenance of a stream."""


class SubmissionCard(FrozenModel):
    """The card of a submission; a text left empty counts as missing, which the checks report."""

    name: str
    """Name of the method in the table."""
    title: str
    """Description of the method, in one line."""
    authors: tuple[str, ...]
    """Names of persons or groups."""
    licence: str
    """SPDX name of the licence of the files in the folder."""
    date: str
    """Date of the submission, YYYY-MM-DD."""
    url: str = ""
    """Address of a paper or a repository."""
    dataset: str
    """Recipe of the dataset whose split ``test`` was evaluated."""
    track: Literal["recorded", "closed_loop"]
    """``recorded`` if the method answered on recordings, ``closed_loop`` if it moved the lens."""
    method: str = ""
    """Method as MEASURE+SEARCH, each a registered name or ``file.py:Class`` of a file in the folder; or the name of a
    folder with a card in it, with a slash at the end; or empty."""
    predictions: str = ""
    """File of answers that another program computed; or empty."""
    constants: str = ""
    """File that ``saf-gen tune`` wrote; or empty."""
    statements: Statements


def create_submission(folder: Path) -> Path:
    """Write a card for a new submission, with one line per key and the name of its folder, and return its path.

    Raises BadInput if the folder already has a card, or if its name cannot be the name of a submission.
    """
    name = folder.resolve().name
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,79}", name):
        raise BadInput(f"a submission cannot be called {name!r}", allowed="letters, digits, _ . -, at most 80")
    path = folder / CARD_FILE
    if path.exists():
        raise BadInput(f"{path} exists already", hint="edit it, or choose another folder")
    write_text(path, _TEMPLATE.read_text(encoding="utf-8").replace("NAME", name, 1))
    return path


def read_submission(folder: Path) -> SubmissionCard:
    """Return the card of a submission; raise BadInput, with the line, if it is missing or not valid."""
    if not (folder / CARD_FILE).is_file():
        raise BadInput(f"there is no {CARD_FILE} in {folder}", hint=f"write one: saf-gen submit new {folder}")
    return validate_document(SubmissionCard, read_yaml(folder / CARD_FILE))


EVALUATION = "evaluation"
MAX_METHOD_BYTES = 1 << 22


def check_submission(folder: Path, *, dataset: Path | None = None) -> Iterator[Finding]:
    """Check a submission and yield the findings; the submission is complete if none of them is an error.

    Parameters
    ----------
    folder : Path
        Folder of the submission.
    dataset : Path, optional
        Dataset whose sequences the answers must cover; by default this is not checked.

    Yields
    ------
    Finding
        One or more for each check.

    Raises
    ------
    BadInput
        If the card cannot be read, or ``dataset`` has no sequence of the split ``test``.
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
        yield Finding("statements", "error", f"not confirmed: {'; '.join(missing)}")
    else:
        yield Finding("statements", "ok", "all three are confirmed")


def _check_card(card: SubmissionCard) -> Iterator[Finding]:
    for key in ("title", "authors", "licence", "date"):
        if not getattr(card, key):
            yield Finding(key, "error", "empty: fill it in")
    if card.date:
        try:
            date.fromisoformat(card.date)
            yield Finding("date", "ok", card.date)
        except ValueError:
            yield Finding("date", "error", f"{card.date!r} is not a date; allowed: a date such as 2026-11-22")
    if card.licence and not re.fullmatch(r"[A-Za-z0-9.+-]+( (AND|OR|WITH) [A-Za-z0-9.+-]+)*", card.licence):
        yield Finding("licence", "error", f"{card.licence!r} is not an SPDX name such as Apache-2.0")


def _check_dataset(card: SubmissionCard, dataset: Path) -> Iterator[Finding]:
    name = read_manifest(dataset).name if dataset.is_dir() else dataset.stem
    if name != card.dataset:
        yield Finding("dataset", "error", f"the card names {card.dataset}, but {dataset} is {name}")


def _check_what_is_handed_in(card: SubmissionCard, folder: Path) -> Iterator[Finding]:
    if bool(card.method) == bool(card.predictions):
        both = "method and predictions are both given" if card.method else "neither method nor predictions is given"
        yield Finding("method", "error", f"{both}: name one of the two")
    elif card.predictions:
        try:
            read_predictions(_file_of(folder, card.predictions))
            yield Finding("predictions", "ok", f"{card.predictions} can be read; its row will be a claim")
        except BadInput as error:
            yield Finding("predictions", "error", str(error))
    else:
        try:
            _check_method(card.method, folder)
            yield Finding("method", "ok", f"{card.method}; run its checks: saf-gen methods check")
        except BadInput as error:
            yield Finding("method", "error", str(error))


def _check_method(method: str, folder: Path) -> None:
    """Raise BadInput unless both parts of a method are registered or defined in a file of the folder.

    The method may also be a folder with a card, in this folder.
    """
    if ends_as_folder(method):
        inside = folder / method
        if not inside.resolve().is_relative_to(folder.resolve()):
            raise BadInput(f"{method} is outside {folder}", hint="copy it into the folder")
        for (name, _), kind in zip(read_folder(inside).halves, ("measures", "searches"), strict=True):
            file, _, member = name.rpartition(":")
            if file:
                _check_member(Path(file), member, has_forms=kind == "measures")
            elif name not in names(kind):
                raise unknown(kind.removesuffix("s"), name, allowed=names(kind))
        return
    halves = split_halves(split_region(method)[0])
    if len(halves) != 2:
        raise BadInput(f"the method is {method!r}", allowed="MEASURE+SEARCH, such as method.py:Mine+argmax")
    for half, kind in zip(halves, ("measures", "searches"), strict=True):
        name = split_options(half)[0]
        file, _, member = name.rpartition(":")
        if not file:
            if name not in names(kind):
                raise unknown(kind.removesuffix("s"), name, allowed=names(kind))
        elif not file.endswith(".py"):
            raise BadInput(f"{name!r} is code outside the folder", allowed="a file in it, such as method.py:Mine")
        else:
            _check_member(_file_of(folder, file), member, has_forms=kind == "measures")


def _check_member(file: Path, member: str, *, has_forms: bool) -> None:
    """Raise BadInput unless a Python file defines this class or function; the file is parsed, not run.

    If ``has_forms``, the name may end in ``_n``, ``_tfi`` or both, which are further forms of a measure.
    """
    check_plain_file(file, max_bytes=MAX_METHOD_BYTES)
    try:
        body = ast.parse(file.read_bytes()).body
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise BadInput(f"{file} is not Python: {error}") from error
    defined = [one.name for one in body if isinstance(one, ast.ClassDef | ast.FunctionDef)]
    forms = {member, member.removesuffix("_tfi"), member.removesuffix("_tfi").removesuffix("_n")}
    if not (forms if has_forms else {member}) & set(defined):
        raise unknown(f"class or function of {file}:", member, allowed=defined)


def _file_of(folder: Path, name: str) -> Path:
    """Return the path of a file in the folder; raise BadInput if it does not exist or is outside the folder."""
    file = (folder / name).resolve()
    if not file.is_relative_to(folder.resolve()):
        raise BadInput(f"{name} is outside {folder}", hint="copy it into the folder")
    if not file.is_file():
        raise BadInput(f"{name} is not in {folder}", hint="copy it into the folder")
    return file


def _check_constants(card: SubmissionCard, folder: Path) -> Iterator[Finding]:
    if not card.constants:
        return
    try:
        tuned = read_tuned(_file_of(folder, card.constants))[0]
    except BadInput as error:
        yield Finding("constants", "error", str(error))
        return
    if tuned.split == TEST_SPLIT:
        yield Finding("constants", "error", f"tuned on the split {tuned.split}: tune on train or validation")
    else:
        tried = f"{plural(len(tuned.trials), 'trial')} on the split {tuned.split} of {tuned.dataset}"
        yield Finding("constants", "ok", f"{tried} gave {tuned.method}")


def _check_answers(card: SubmissionCard, folder: Path, *, dataset: Path | None) -> Iterator[Finding]:
    data = dataset or "DATASET"
    again = f"run saf-gen evaluate {data} --split {TEST_SPLIT} --out {folder / EVALUATION} with your method"
    tasks = None if dataset is None else {t.id for t in select_sequences_to_evaluate(dataset, split=TEST_SPLIT).tasks}
    if not (folder / EVALUATION / RECORDS_FILE).is_file():
        yield Finding("answers", "error", f"there is no {EVALUATION}/{RECORDS_FILE}: {again}")
        return
    try:
        every = read_records(folder / EVALUATION)
    except BadInput as error:
        yield Finding("answers", "error", str(error))
        return
    group = records_of(every, card)
    if not group:
        rows = ", ".join(sorted({record.method for record in every}))
        yield Finding("answers", "error", f"there is no row of {card.method or card.name}, only of {rows}")
        return
    yield from _check_records(group, card, tasks=tasks)
    state = read_row_states(folder / EVALUATION, every).get(group[0].method)
    if state == DIFFERS:
        yield Finding("verified", "error", f"answers differ when the method is run again: {again}")
    elif state == RERUN_HERE or card.predictions:
        yield Finding("verified", "ok", state or "answers of another program stay a claim")
    else:
        is_code = ".py:" in card.method or ends_as_folder(card.method)
        how = f"saf-gen leaderboard verify {folder / EVALUATION} --on {data}"
        named = f" --method {folder}/{card.method}" if is_code else ""
        yield Finding("verified", "warning", f"{state or 'nobody has run it again'}: {how}{named}")


def _check_records(group: list[Record], card: SubmissionCard, *, tasks: set[str] | None) -> Iterator[Finding]:
    sequences = {record.sequence for record in group}
    if any(record.track != card.track for record in group):
        yield Finding("answers", "error", f"their track is {group[0].track}, not {card.track}")
    elif tasks is not None and sequences != tasks:
        odd = sorted(sequences ^ tasks)
        yield Finding(
            "answers",
            "error",
            f"{plural(len(sequences), 'sequence')}, but {len(tasks)} in the dataset: {odd[0]} is not in both",
        )
    else:
        right, has_answer = right_within(), [record for record in group if record.answerable]
        complete = "all of the split" if tasks is not None else "compare them with the dataset: --on DATASET"
        within = f"{sum(map(bool, map(right, has_answer)))} of {len(has_answer)} that have an answer"
        false = sum(record.answerable is False and record.status == "answered" for record in group)
        text = f"{plural(len(sequences), 'sequence')} ({complete}), {within} within 1 depth of focus"
        yield Finding("answers", "ok", f"{text}, {plural(false, 'false answer')}")


def records_of(records: Iterable[Record], card: SubmissionCard) -> list[Record]:
    """Return the records of the submission's method.

    If its name begins with the path of a file, the records may have a longer path than the card.
    """
    name = card.name if card.predictions else card.method
    group = [record for record in records if record.method == name or record.method.endswith(f"/{name}")]
    return [record for record in group if record.method == group[0].method]
