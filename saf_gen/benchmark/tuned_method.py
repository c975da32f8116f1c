"""Files of tuned methods, which state the constants that were tried, the data, and the best constants.

``@FILE`` can be used wherever a method is named. Every record of a tuned method cites its file by digest.
"""

import hashlib
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import ClassVar

from pydantic import ConfigDict

from saf_gen.benchmark.records import Count, Number, pop_format
from saf_gen.core.config.document import STRICT, read_text, validate_document
from saf_gen.core.config.json_document import format_checked_json, parse_checked_json

FORMAT = "saf-gen tuning 1"
HINT = "make it with saf-gen tune"


@dataclass(frozen=True)
class TuningTrial:
    """One choice of constants, with its success rate within one depth of focus and its median error."""

    __pydantic_config__: ClassVar[ConfigDict] = STRICT

    method: str
    success_1dof: Number | None
    median_error_dof: Number | None


@dataclass(frozen=True)
class TunedMethod:
    """The best of the tuning trials, and how it was found.

    ``data`` is the first 12 digits of a SHA-256 over the content_sha256 of the sequences, in their order.
    """

    __pydantic_config__: ClassVar[ConfigDict] = STRICT

    method: str
    dataset: str
    split: str
    track: str
    terms: str
    region: str
    sequences: Count
    data: str
    version: str
    trials: tuple[TuningTrial, ...]


def format_tuned(tuned: TunedMethod) -> str:
    """Return the text of the file of a tuned method."""
    return format_checked_json({"format": FORMAT, **asdict(tuned)}, indent=1) + "\n"


def read_tuned(path: str | Path) -> tuple[TunedMethod, str]:
    """Read a tuned file, and return its contents and the first 12 digits of its SHA-256.

    Raises BadInput if the file cannot be read, or was not made by ``saf-gen tune`` of this version.
    """
    path = Path(path)
    document = parse_checked_json(read_text(path, hint=HINT), path, hint=HINT)
    pop_format(document, FORMAT, what="tuned method", hint=HINT)
    tuned = validate_document(TunedMethod, document, hint=HINT)
    return tuned, hashlib.sha256(path.read_bytes()).hexdigest()[:12]
