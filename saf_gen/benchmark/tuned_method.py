"""Tuned constants of a method, as a file: what was tried, on which data, and what came out best.

``@FILE`` stands for the method wherever a method is named, and every record that it makes cites the file by its digest.
"""

import hashlib
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import ClassVar

from pydantic import ConfigDict

from saf_gen.benchmark.records import Count, Number, pop_benchmark_record_format
from saf_gen.core.config.document import STRICT, read_text, validate_document
from saf_gen.core.config.json_document import format_checked_json, parse_checked_json

FORMAT = "saf-gen tuning 1"
HINT = "make it with saf-gen tune"


@dataclass(frozen=True)
class TuningTrial:
    """One choice of constants, its success within one depth of focus, and its median error."""

    __pydantic_config__: ClassVar[ConfigDict] = STRICT

    method: str
    success_1dof: Number | None
    median_error_dof: Number | None


@dataclass(frozen=True)
class TunedMethod:
    """The best of the trials, and how it was found.

    ``data``: 12 digits of a sha256 over the content_sha256 of the sequences, in their order.
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


def format_tuned_method(tuned: TunedMethod) -> str:
    """Return the text of the file."""
    return format_checked_json({"format": FORMAT, **asdict(tuned)}, indent=1) + "\n"


def read_tuned_method(path: str | Path) -> tuple[TunedMethod, str]:
    """Read a tuned file; return it and 12 digits of its sha256.

    Raises BadInput where it cannot be read, or was not made by `saf-gen tune` of this version.
    """
    path = Path(path)
    document = parse_checked_json(read_text(path, hint=HINT), path, hint=HINT)
    pop_benchmark_record_format(document, FORMAT, what="tuned method", hint=HINT)
    tuned = validate_document(TunedMethod, document, hint=HINT)
    return tuned, hashlib.sha256(path.read_bytes()).hexdigest()[:12]
