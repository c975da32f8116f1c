"""Answers of external programs in any language, which are judged like those of methods that run here.

A file has one line of JSON per method and sequence::

    {"method": "my_net", "sequence": "camel-sudden-00", "frame": 8213.5, "frames_seen": 9000}

``frame`` counts from 0 and may be fractional; null abstains. The lens positions are taken from the recording. The cost
of an answer is stated by its author; impossible numbers, such as more frames than were recorded, are refused.
"""

import hashlib
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, Field

from saf_gen.benchmark.records import Count, Duration, Number
from saf_gen.benchmark.tracks.tasks import SequenceTask
from saf_gen.core.config.document import MAX_LINE, Document, FrozenModel, read_text, validate_document
from saf_gen.core.config.json_document import parse_json
from saf_gen.errors import BadInput, unknown
from saf_gen.stream.manifest import ALL_SPLITS

EXAMPLE = '{"method": "my_net", "sequence": "ID", "frame": 8213.5} in each line'
MAX_BYTES = 1 << 27
"""Largest file, of more than half a million answers."""
FRAMES_HINT = "set frames_seen to the number of frames seen, at least up to the answer, or leave frames_seen out"
METHOD_NAME = r"[A-Za-z0-9][A-Za-z0-9_.:=,+-]{0,79}"
"""Regular expression for the names of policies and of methods that run elsewhere."""


def _check_method_name(name: str) -> str:
    if not re.fullmatch(METHOD_NAME, name):
        raise ValueError("1 to 80 of A-Z a-z 0-9 _ . : = , + -, a letter or digit first")
    return name


class Prediction(FrozenModel):
    """One answer of a method on a sequence.

    A number must be a JSON number; strings and booleans are refused.

    Attributes
    ----------
    method : str
        Name of the method.
    sequence : str
        Id of the sequence.
    frame : float or None
        Frame of the answer, counted from 0; None abstains.
    frames_seen : int, optional
        Number of frames from the beginning that the method looked at, at least up to its answer; None means all.
    seconds : float, optional
        Computing time in seconds.
    trace : tuple of float, optional
        Steps of the method.
    note : str, optional
        One line for the reader.
    data : str, optional
        content_sha256 of the stream, which is checked if given.
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
        """Return the fault of ``frames_seen`` for a recording of ``frames`` frames, or ''."""
        if self.frames_seen is None or self.frames_seen <= frames:
            return ""
        return f"frames_seen is {self.frames_seen}, but {frames} frames were recorded"


class PredictionSet:
    """The answers in a file by method and sequence; ``code`` is the first 12 digits of the file's SHA-256."""

    def __init__(self, path: Path, code: str, *, found: dict[str, dict[str, Prediction]]) -> None:
        self.path, self.code, self._found = path, code, found

    def only(self, sequence: str) -> "PredictionSet":
        """Return a set of the answers on one sequence."""
        found = {name: {sequence: answers[sequence]} for name, answers in self._found.items()}
        return PredictionSet(self.path, self.code, found=found)

    def for_sequence(self, sequence: str) -> list[Prediction]:
        """Return the answer of each method on a sequence, in the order of the file."""
        return [answers[sequence] for answers in self._found.values()]

    def check_complete(
        self,
        tasks: Sequence[SequenceTask],
        *,
        left_out: Mapping[str, str] | None = None,
        running_methods: Iterable[str] = (),
    ) -> None:
        """Check that every method answers each of these sequences and no other.

        Parameters
        ----------
        tasks : sequence of SequenceTask
            The sequences. If a task states the digest or the length of its stream, the answers are checked against it.
        left_out : mapping of str to str, optional
            The split of each sequence of the dataset that is not evaluated, for error messages.
        running_methods : iterable of str, optional
            Names of the methods that run here, which predictions must not use.

        Raises
        ------
        BadInput
            If an answer is missing, superfluous, made from another stream or from more frames than were recorded, or
            has the name of a method that runs here.
        """
        sequences = {task.id: task for task in tasks}
        for name in running_methods:
            if name in self._found:
                raise BadInput(
                    f"the name {name!r} belongs to a method that is evaluated too",
                    where=str(self.path),
                    hint="rename the method in the file",
                )
        for method, answers in self._found.items():
            where = f"{self.path}, method {method}"
            for sequence, prediction in answers.items():
                if split := (left_out or {}).get(sequence):
                    raise BadInput(
                        f"there is an answer on {sequence}, but its split {split!r} is not evaluated",
                        where=where,
                        allowed=f"answers on {', '.join(sorted({task.split for task in tasks if task.split}))}",
                        hint=f"choose a split with --split, or --split {ALL_SPLITS}",
                    )
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
    """Raise BadInput if an answer was made from another stream, or from more frames than were recorded."""
    if None not in (prediction.data, task.content_sha256) and prediction.data != task.content_sha256:
        raise BadInput(
            f"the prediction for {task.id} was made from other data: {prediction.data:.12}",
            where=where,
            allowed=f"{task.content_sha256:.12}",
            hint="predict again on this dataset",
        )
    if task.frames is not None and (problem := prediction.describe_frames_fault(task.frames)):
        raise BadInput(f"{task.id}: {problem}", where=where, allowed=f"1 to {task.frames}, or null for all")


def read_predictions(path: str | Path) -> PredictionSet:
    """Read a file of predictions.

    Parameters
    ----------
    path : str or Path
        File with one JSON object per line.

    Returns
    -------
    PredictionSet
        The answers.

    Raises
    ------
    BadInput
        If the file cannot be read or is empty, if a line is not a prediction, or if a method answers a sequence twice;
        the error gives the line.
    """
    path = Path(path)
    found: dict[str, dict[str, Prediction]] = {}
    text = read_text(path, max_bytes=MAX_BYTES)
    for number, line in enumerate(text.split("\n"), start=1):  # notes may contain other line separators
        if not line.strip():
            continue
        if len(line) > MAX_LINE:
            raise BadInput("the line is too long", where=f"{path}:{number}", allowed=f"at most {MAX_LINE:,} characters")
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
