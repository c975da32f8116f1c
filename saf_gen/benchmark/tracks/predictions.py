"""Answers made elsewhere, in any language: one line of JSON per method and sequence, judged like our own.

    {"method": "my_net", "sequence": "camel-sudden-00", "frame": 8213.5, "frames_seen": 9000}

``frame`` is 0-based and may be fractional; null abstains. The lens was where the recording says it was. What
an answer cost is what its author says, as far as it can be true.
"""

import hashlib
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, Field

from saf_gen.benchmark.records import Count, Duration, Number
from saf_gen.benchmark.tracks.sequence_tasks import SequenceTask
from saf_gen.core.config.document import Document, FrozenModel, read_text, validate_document
from saf_gen.core.config.json_document import parse_json
from saf_gen.errors import BadInput, unknown

EXAMPLE = '{"method": "my_net", "sequence": "ID", "frame": 8213.5} in each line'
FRAMES_HINT = "an answer needs no frame after it: say how far the method looked, or leave frames_seen out"


def _check_method_name(name: str) -> str:
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.:=,+-]{0,79}", name):
        raise ValueError("1 to 80 of A-Z a-z 0-9 _ . : = , + -, a letter or digit first")
    return name


class Prediction(FrozenModel):
    """One answer; text that reads like a number, true and false are refused where a number belongs.

    ``frames_seen`` is how many frames from the beginning the method looked at, at least up to its answer; None means
    all. ``seconds`` is its computing time, ``trace`` its steps, ``note`` a line for the reader, and ``data``, where
    given, the stream's content_sha256, which is checked.
    """

    method: Annotated[str, AfterValidator(_check_method_name)]
    sequence: str
    frame: Number | None
    frames_seen: Annotated[Count, Field(ge=1)] | None = None
    seconds: Duration = 0.0
    trace: tuple[Number, ...] = ()
    note: str = Field(default="", max_length=200)
    data: str | None = None

    def describe_frames_fault(self, frames: int) -> str:
        """Return what is wrong with ``frames_seen`` for a recording of ``frames`` frames, '' if it fits."""
        if self.frames_seen is None or self.frames_seen <= frames:
            return ""
        return f"frames_seen is {self.frames_seen}, and {frames} frames were recorded"


class PredictionSet:
    """The answers of a file, by method and sequence; ``code`` is 12 digits of the file's sha256."""

    def __init__(self, path: Path, code: str, *, found: dict[str, dict[str, Prediction]]) -> None:
        self.path, self.code, self._found = path, code, found

    def only(self, sequence: str) -> "PredictionSet":
        """Return the answers on one sequence alone."""
        found = {name: {sequence: answers[sequence]} for name, answers in self._found.items()}
        return PredictionSet(self.path, self.code, found=found)

    def for_sequence(self, sequence: str) -> list[Prediction]:
        """Return what each method answered on a sequence, in the order of the file."""
        return [answers[sequence] for answers in self._found.values()]

    def check_complete(self, tasks: Sequence[SequenceTask], *, beside: Iterable[str] = ()) -> None:
        """Raise BadInput unless every method answers every one of these sequences and no other.

        The digest and length of a stream are compared where the task states them. ``beside`` names the methods that run
        here; a prediction must not bear the name of one.
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
            where = f"{self.path}, method {method}"
            for sequence, prediction in answers.items():
                if sequence not in sequences:
                    raise unknown("sequence", sequence, allowed=sequences, where=where)
                _check_stream(prediction, sequences[sequence], where=where)
            missing = [sequence for sequence in sequences if sequence not in answers]
            if missing:
                more = f" and {len(missing) - 3} more" if len(missing) > 3 else ""
                raise BadInput(
                    f"{method} does not answer {', '.join(missing[:3])}{more}",
                    where=str(self.path),
                    allowed=f"a line for each of {len(sequences)} sequences",
                    hint='abstain with "frame": null, or choose a split with --split',
                )


def _check_stream(prediction: Prediction, task: SequenceTask, *, where: str) -> None:
    """Raise BadInput for an answer made from another stream, or from more frames than were recorded."""
    if None not in (prediction.data, task.content_sha256) and prediction.data != task.content_sha256:
        raise BadInput(
            f"{task.id} was made from other data: {prediction.data:.12}",
            where=where,
            allowed=f"{task.content_sha256:.12}",
            hint="predict again on this dataset",
        )
    if task.frames is not None and (problem := prediction.describe_frames_fault(task.frames)):
        raise BadInput(f"{task.id}: {problem}", where=where, allowed=f"1 to {task.frames}, or null for all")


def read_method_predictions(path: str | Path) -> PredictionSet:
    """Read a file of predictions.

    Raises BadInput, with the line, for a file that cannot be read or is empty, a line that is not a
    prediction, and a method that answers a sequence twice.
    """
    path = Path(path)
    found: dict[str, dict[str, Prediction]] = {}
    for number, line in enumerate(read_text(path).split("\n"), start=1):  # notes may hold other ends of lines
        if not line.strip():
            continue
        document = parse_json(line, path, first_line=number)
        prediction = _parse_prediction(document)
        answers = found.setdefault(prediction.method, {})
        if prediction.sequence in answers:
            raise BadInput(
                f"{prediction.method} answers {prediction.sequence} twice",
                where=document.locate(),
                allowed="one answer per method and sequence",
            )
        answers[prediction.sequence] = prediction
    if not found:
        raise BadInput("the file holds no prediction", where=str(path), allowed=EXAMPLE)
    return PredictionSet(path, hashlib.sha256(path.read_bytes()).hexdigest()[:12], found=found)


def _parse_prediction(document: Document) -> Prediction:
    prediction = validate_document(Prediction, document)
    frame, seen = prediction.frame, prediction.frames_seen
    if frame is not None and seen is not None and frame > seen - 0.5:
        raise BadInput(
            f"frame is {frame:g}, with frames_seen {seen}",
            where=document.locate(),
            allowed=f"up to {seen - 0.5:.1f}, the end of the last frame seen",
            hint=FRAMES_HINT,
        )
    return prediction
