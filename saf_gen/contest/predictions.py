"""Answers made elsewhere, in any language: a line of JSON a method and sequence, judged like our own.

    {"method": "my_net", "sequence": "camel-sudden-00", "frame": 8213.5, "frames_seen": 9000}

``frame`` is 0-based and may be fractional; null abstains. The lens was where the recording says it was.
"""

import hashlib
import json
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Any

from pydantic import Field, ValidationError

from saf_gen.documents import Frozen
from saf_gen.errors import BadInput, closest, unknown

__all__ = ["Prediction", "Predictions", "read_predictions"]


class Prediction(Frozen):
    """One answer.

    ``frames_seen``: the recording as far as the method looked at it, all of it where not given; ``seconds``
    its computing; ``trace`` its steps; ``note`` a line for the reader; ``data`` the stream's content_sha256,
    which is then checked.
    """

    method: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.:=,+-]*$", max_length=80)
    sequence: str
    frame: float | None
    frames_seen: int | None = Field(default=None, ge=1)
    seconds: float = Field(default=0.0, ge=0)
    trace: tuple[float, ...] = ()
    note: str = Field(default="", max_length=200)
    data: str | None = None


class Predictions:
    """The answers of a file, by method and sequence. ``code`` is 12 digits of the file's sha256."""

    def __init__(self, path: Path, code: str, found: dict[str, dict[str, Prediction]]) -> None:
        self.path, self.code, self._found = path, code, found

    @property
    def methods(self) -> tuple[str, ...]:
        """The methods, in the order of the file."""
        return tuple(self._found)

    def of(self, sequence: str) -> list[Prediction]:
        """What each method answered on a sequence."""
        return [answers[sequence] for answers in self._found.values()]

    def check(self, sequences: Collection[str], *, beside: Iterable[str] = ()) -> None:
        """Raises BadInput unless every method answers every one of these sequences, and no other.

        ``beside``: names of methods that run too, which must be others.
        """
        for name in beside:
            if name in self._found:
                raise BadInput(
                    f"the method {name!r} is also one that runs here",
                    where=str(self.path),
                    hint="give yours another name",
                )
        for method, answers in self._found.items():
            for sequence in answers:
                if sequence not in sequences:
                    raise unknown("sequence", sequence, sequences, where=f"{self.path}, method {method}")
            lacking = [s for s in sequences if s not in answers]
            if lacking:
                more = f" and {len(lacking) - 3} more" if len(lacking) > 3 else ""
                raise BadInput(
                    f"{method} does not answer {', '.join(lacking[:3])}{more}",
                    where=str(self.path),
                    allowed=f"a line for each of {len(sequences)} sequences",
                    hint='abstain with "frame": null, or choose a split with --split',
                )


def read_predictions(path: str | Path) -> Predictions:
    """Read a file of predictions.

    Raises BadInput, with the line, for a file that is not there, a line that is no prediction, and a method
    that answers a sequence twice.
    """
    path = Path(path)
    try:
        raw = path.read_bytes()
        lines = raw.decode("utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        near = closest(path.name, [p.name for p in path.parent.glob("*.jsonl")])
        raise BadInput(f"{path} cannot be read: {error}", nearest=near) from error
    found: dict[str, dict[str, Prediction]] = {}
    for number, text in enumerate(lines, start=1):
        if not text.strip():
            continue
        where = f"{path}:{number}"
        prediction = _parsed(text, where)
        answers = found.setdefault(prediction.method, {})
        if prediction.sequence in answers:
            raise BadInput(
                f"{prediction.method} answers {prediction.sequence} twice", where=where, allowed="once"
            )
        answers[prediction.sequence] = prediction
    if not found:
        raise BadInput("holds no prediction", where=str(path), allowed=_EXAMPLE)
    return Predictions(path, hashlib.sha256(raw).hexdigest()[:12], found)


_EXAMPLE = '{"method": "my_net", "sequence": "ID", "frame": 8213.5} a line'


def _parsed(text: str, where: str) -> Prediction:
    try:
        line: Any = json.loads(text)
    except ValueError:
        line = None
    if not isinstance(line, dict):
        raise BadInput(f"is no JSON object: {text!r:.40}", where=where, allowed=_EXAMPLE)
    known = Prediction.model_fields
    for key in line:
        if key not in known:
            raise unknown("key", key, known, where=where)
    for key in ("method", "sequence", "frame"):
        if key not in line:
            raise BadInput(f"{key} is missing", where=where, allowed=_EXAMPLE)
    try:
        return Prediction.model_validate(line, strict=False)
    except ValidationError as error:
        first = error.errors()[0]
        raise BadInput(
            f"{first['loc'][0]} is {first['input']!r:.40}",
            where=where,
            allowed=first["msg"].removeprefix("Input should be ").removeprefix("String should "),
        ) from error
