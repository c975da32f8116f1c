"""``submission.yaml``: who hands in what, and vouches for what."""

import re
from pathlib import Path
from typing import Literal

from saf_gen.core.config.document import FrozenModel, validate_document
from saf_gen.core.config.yaml_document import read_yaml
from saf_gen.core.files import write_text_atomically
from saf_gen.errors import BadInput

CARD_FILE = "submission.yaml"
_TEMPLATE = Path(__file__).with_name("submission.yaml.in")


class Statements(FrozenModel):
    """What an author vouches for; nobody can check it from the folder alone."""

    no_test_data_in_training: bool
    """Neither training nor tuning has seen the split ``test``."""
    test_was_run_once: bool
    """Nothing was chosen by results on it."""
    answers_use_no_truth: bool
    """Neither truth nor provenance of a stream was read."""


class SubmissionCard(FrozenModel):
    """The card of a submission; text that is left empty is missing, which the checks say."""

    name: str
    """The method's name in the table."""
    title: str
    """One line: what the method does."""
    authors: tuple[str, ...]
    """Names of persons or groups."""
    licence: str
    """Of the files in the folder, an SPDX name."""
    date: str
    """Of the submission, YYYY-MM-DD."""
    url: str = ""
    """A paper or a repository."""
    dataset: str
    """The recipe whose split ``test`` was judged."""
    track: Literal["recorded", "closed_loop"]
    """Whether answers are to recordings, or the method moved the lens."""
    method: str = ""
    """MEASURE+SEARCH, registered or as ``file.py:Class`` of a file in the folder; or empty."""
    predictions: str = ""
    """File of answers that another program computed; or empty."""
    constants: str = ""
    """File that ``saf-gen tune`` wrote; or empty."""
    statements: Statements


def create_submission(folder: Path) -> Path:
    """Write the card of a new submission, named like its folder, with a line for each key; return its path.

    Raises BadInput for a folder that has one already, and for a name that no table could show.
    """
    name = folder.resolve().name
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,79}", name):
        raise BadInput(f"a submission cannot be called {name!r}", allowed="letters, digits, _ . -, at most 80")
    path = folder / CARD_FILE
    if path.exists():
        raise BadInput(f"{path} is there already", hint="choose another folder, or edit it")
    write_text_atomically(path, _TEMPLATE.read_text(encoding="utf-8").replace("NAME", name, 1))
    return path


def read_submission(folder: Path) -> SubmissionCard:
    """Read the card of a submission; raises BadInput, with the line, for what does not fit."""
    if not (folder / CARD_FILE).is_file():
        raise BadInput(f"there is no {CARD_FILE} in {folder}", hint=f"write one: saf-gen submit new {folder}")
    return validate_document(SubmissionCard, read_yaml(folder / CARD_FILE))
