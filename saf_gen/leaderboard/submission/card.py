"""The card of a submission, ``submission.yaml``: who submits what, and what the authors confirm."""

import re
from pathlib import Path
from typing import Literal

from saf_gen.core.config.document import FrozenModel, validate_document
from saf_gen.core.config.yaml_document import read_yaml
from saf_gen.core.files import write_text
from saf_gen.errors import BadInput

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
    """Method as MEASURE+SEARCH, each a registered name or ``file.py:Class`` of a file in the folder; or empty."""
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
