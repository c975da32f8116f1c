"""Answers made elsewhere, in any language: a line of JSON a method and sequence, judged like our own.

    {"method": "my_net", "sequence": "camel-sudden-00", "frame": 8213.5, "frames_seen": 9000}

``frame`` is 0-based and may be fractional; null abstains. The lens was where the recording says it was. What
an answer cost is what its author says; it is held to what can be true.
"""

import hashlib
import json
import reprlib
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from pydantic import ConfigDict, Field, ValidationError

from saf_gen.benchmark.records import MAX_COUNT, MAX_SECONDS_OR_TRAVELS
from saf_gen.benchmark.tracks.sequence_tasks import SequenceTask
from saf_gen.core.config.document import FrozenModel
from saf_gen.errors import BadInput, closest, unknown

__all__ = ["Prediction", "PredictionSet", "read_predictions"]


class Prediction(FrozenModel):
    """One answer. Numbers are numbers: text that reads like one, or true, is none.

    ``frames_seen``: the recording as far as the method looked at it, all of it where not given; it ends with
    the answer's frame or later. ``seconds`` its computing; ``trace`` its steps; ``note`` a line for the
    reader; ``data`` the stream's content_sha256, which is then checked.
    """

    model_config = ConfigDict(strict=True)

    method: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.:=,+-]*$", max_length=80)
    sequence: str
    frame: float | None
    frames_seen: int | None = Field(default=None, ge=1, le=MAX_COUNT)
    seconds: float = Field(default=0.0, ge=0, le=MAX_SECONDS_OR_TRAVELS)
    trace: tuple[float, ...] = ()
    note: str = Field(default="", max_length=200)
    data: str | None = None

    def describe_frames_fault(self, frames: int) -> str:
        """What is wrong with ``frames_seen`` in a recording of so many frames; '' where nothing is."""
        if self.frames_seen is None or self.frames_seen <= frames:
            return ""
        return f"frames_seen is {self.frames_seen}, and {frames} frames were recorded"


class PredictionSet:
    """The answers of a file, by method and sequence. ``code`` is 12 digits of the file's sha256."""

    def __init__(self, path: Path, code: str, found: dict[str, dict[str, Prediction]]) -> None:
        self.path, self.code, self._found = path, code, found

    @property
    def methods(self) -> tuple[str, ...]:
        """The methods, in the order of the file."""
        return tuple(self._found)

    def for_sequence(self, sequence: str) -> list[Prediction]:
        """What each method answered on a sequence."""
        return [answers[sequence] for answers in self._found.values()]

    def check_complete(self, tasks: Sequence[SequenceTask], *, beside: Iterable[str] = ()) -> None:
        """Raises BadInput unless every method answers every one of these sequences, as it is, and no other.

        What a task does not know of its stream, digest or length, is not compared. ``beside``: names of
        methods that run too, which must be others.
        """
        sequences = {task.id: task for task in tasks}
        for name in beside:
            if name in self._found:
                raise BadInput(
                    f"the method {name!r} is also one that runs here",
                    where=str(self.path),
                    hint="give yours another name",
                )
        for method, answers in self._found.items():
            for sequence, prediction in answers.items():
                where = f"{self.path}, method {method}"
                if sequence not in sequences:
                    raise unknown("sequence", sequence, allowed=sequences, where=where)
                _check_made_of(prediction, sequences[sequence], where)
            lacking = [s for s in sequences if s not in answers]
            if lacking:
                more = f" and {len(lacking) - 3} more" if len(lacking) > 3 else ""
                raise BadInput(
                    f"{method} does not answer {', '.join(lacking[:3])}{more}",
                    where=str(self.path),
                    allowed=f"a line for each of {len(sequences)} sequences",
                    hint='abstain with "frame": null, or choose a split with --split',
                )


def _check_made_of(prediction: Prediction, task: SequenceTask, where: str) -> None:
    """Raises BadInput for an answer made from another stream, or from more frames than were recorded."""
    if None not in (prediction.data, task.content_sha256) and prediction.data != task.content_sha256:
        raise BadInput(
            f"{task.id} was made from other data: {prediction.data:.12}",
            where=where,
            allowed=f"{task.content_sha256:.12}",
            hint="predict again on this dataset",
        )
    if task.frames is not None and (problem := prediction.describe_frames_fault(task.frames)):
        raise BadInput(f"{task.id}: {problem}", where=where, allowed=f"1 to {task.frames}, or null for all")


def read_predictions(path: str | Path) -> PredictionSet:
    """Read a file of predictions.

    Raises BadInput, with the line, for a file that is not there, a line that is no prediction, and a method
    that answers a sequence twice.
    """
    path = Path(path)
    try:
        raw = path.read_bytes()
        lines = raw.decode("utf-8").split("\n")  # a note may hold what splitlines would cut at
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
    return PredictionSet(path, hashlib.sha256(raw).hexdigest()[:12], found)


_EXAMPLE = '{"method": "my_net", "sequence": "ID", "frame": 8213.5} a line'


def _parsed(text: str, where: str) -> Prediction:
    try:
        line: Any = json.loads(text)
    except (ValueError, RecursionError):
        line = None
    if not isinstance(line, dict):
        raise BadInput(f"is no JSON object: {text!r:.40}", where=where, allowed=_EXAMPLE)
    known = Prediction.model_fields
    for key in line:
        if key not in known:
            raise unknown("key", key, allowed=known, where=where)
    for key in ("method", "sequence", "frame"):
        if key not in line:
            raise BadInput(f"{key} is missing", where=where, allowed=_EXAMPLE)
    if isinstance(line.get("trace"), list):
        line["trace"] = tuple(line["trace"])
    try:
        prediction = Prediction.model_validate(line)
    except ValidationError as error:
        first = error.errors()[0]
        raise BadInput(
            f"{first['loc'][0]} is {reprlib.repr(first['input'])}",
            where=where,
            allowed=first["msg"].removeprefix("Input should be ").removeprefix("String should "),
        ) from error
    frame, seen = prediction.frame, prediction.frames_seen
    if frame is not None and seen is not None and frame > seen - 0.5:
        raise BadInput(
            f"frame is {frame:g}, with frames_seen {seen}",
            where=where,
            allowed=f"up to {seen - 0.5:.1f}, the end of the last frame seen",
            hint="an answer needs no frame after it: say how far the method looked, or leave frames_seen out",
        )
    return prediction
