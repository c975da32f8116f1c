"""Records, each with the results of one method on one sequence; they are lines of ``records.jsonl``, read strictly.

Each line states the number of its format, so that a table never uses lines whose meaning has changed. A record that
contradicts itself is refused, too, because tables divide by its numbers and rely on them.
"""

import math
import sys
from collections.abc import Iterable, Mapping
from contextlib import closing
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, ClassVar, Final, Literal, get_args

import numpy as np
from pydantic import ConfigDict, Field, WrapValidator

from saf_gen.core.config.document import STRICT, Document, read_lines, validate_document
from saf_gen.core.config.json_document import format_checked_json, parse_checked_json
from saf_gen.core.files import atomic_file
from saf_gen.errors import BadInput, closest, some_of

RECORDS_FILE = "records.jsonl"
READY = ".evaluation.ready"
"""Folder, in the folder of an evaluation, that holds a complete new evaluation until its files have been moved."""
RECORD_FORMAT = "saf-gen record 10"
HINT = "run saf-gen evaluate again"
FAIR_FAILURES = ("BadInput", "the budget of ", "answered frame ", "frames_seen is ")
"""Beginnings of the notes of failures that are results: an input that a method refuses, a budget that it spends, and an
answer outside the recording."""

OVER_A_LIMIT = "over a limit: "
"""Beginning of the notes of runs that were ended at a limit of time or memory; another machine may end them elsewhere.
"""
MAX_COUNT = 2**53
"""Largest whole number up to which a float represents every whole number."""
MAX_SECONDS_OR_TRAVELS = 1e9
"""Upper limit of seconds and travels, above all values that occur, but low enough to keep means finite."""
MAX_POSITION_OR_ERROR = 1e100
"""Upper limit of positions and errors in any unit, above all values that occur, but low enough to keep means finite."""

Blank = Literal["no spikes", "all spikes"]
"""What makes a recording blank: every readout of every pixel is the same, so nobody can know the focus."""
NO_INSIDE: Final = "no inside region"
UNJUDGED = (*get_args(Blank), NO_INSIDE)
"""Obstacles at which no answer counts, and no success is known."""
Obstacle = Literal["no spikes", "all spikes", "no inside region", "lens at rest", "focus not reached"]
"""What keeps every method from the focus of a sequence."""
Stratum = Literal["one depth", "relief", "80 % and more", "60 to 80 %", "below 60 %"]
"""The geometry of the region where methods are judged: inside the target, whether it is one depth; in the target's box,
the share of its pixels that belong to the target."""
STRATA = get_args(Stratum)
Status = Literal["answered", "abstained", "failed"]
Track = Literal["recorded", "closed_loop"]
SUCCESS_LIMITS_DOF = (0.5, 1.0, 2.0)
"""Largest distances from the truth, in depths of focus, that count as a success."""

Count = Annotated[int, Field(strict=True, ge=0, le=MAX_COUNT)]
Number = Annotated[float, Field(strict=True)]
Duration = Annotated[Number, Field(ge=0, le=MAX_SECONDS_OR_TRAVELS)]
Travel = Annotated[Number, Field(ge=0, le=MAX_SECONDS_OR_TRAVELS)]
Position = Annotated[Number, Field(ge=-MAX_POSITION_OR_ERROR, le=MAX_POSITION_OR_ERROR)]
Distance = Annotated[Number, Field(ge=0, le=MAX_POSITION_OR_ERROR)]
TraceValue = Annotated[Number, WrapValidator(lambda value, check: math.nan if value is None else check(value))]
"""A number; null in the file is read as NaN."""


@dataclass(frozen=True, slots=True)
class Who:
    """A method, and where it ran."""

    __pydantic_config__: ClassVar[ConfigDict] = STRICT

    method: str
    """Name of the method, ``MEASURE+SEARCH``, with options that differ from the defaults."""
    code: str
    """Digest of the method's options and of the code of measure, search and the private modules (``_name.py``) that
    they import from the same folder, without comments, docstrings and formatting."""
    region: str
    """Region where the method looked: ``target``, ``inside``, ``frame``, ``shifted``, ``half``, ``double`` or
    ``centre``."""
    parameters: str = ""
    """Measure and search with every option, defaults included."""
    limits: str = ""
    """What the process of the method might use on a sequence, and the version of Landlock that shut it in, 0 for none,
    if it is not part of saf_gen; otherwise ''."""
    failed_check: str = ""
    """First check of ``saf-gen methods check`` that the measure or search fails, if it is not part of saf_gen; ''
    if there is none."""
    tuning: str = ""
    """First 12 digits of the SHA-256 of the tuned file that named the method (``@FILE``), or ''."""
    machine: str = ""
    """Processor, cores and versions, on which ``seconds`` depends."""


@dataclass(frozen=True, slots=True)
class What:
    """A sequence, and the conditions that all methods have on it."""

    __pydantic_config__: ClassVar[ConfigDict] = STRICT

    sequence: str
    """Name of the sequence in its dataset, or name of the stream file."""
    split: str | None
    """Split that the sequence belongs to."""
    scene: str
    """Scene that the sequence shows."""
    light: str | None
    """Light schedule of the sequence."""
    frames: Annotated[Count, Field(ge=1)]
    """Number of frames recorded; in the closed loop, the budget in frames."""
    data: str
    """content_sha256 of the stream; in a closed loop with other time slices than the recording, a digest of stream and
    slices."""
    track: Track = "recorded"
    """``recorded`` or ``closed_loop``."""
    terms: str = ""
    """Protocol of the closed loop: what moves the lens, the budget and the sweep."""
    rig: str = ""
    """Versions of the parts of the evaluator that count and capture spikes and judge answers."""
    benchmark: str | None = None
    """Name and digest of the frozen benchmark that the sequence belongs to, or None."""
    sensor: str | None = None
    """Name of the recording's sensor, followed by six digits of a digest if its numbers differ from those of the
    registered sensor of that name. None if the recording does not state its sensor."""
    scene_motion: str | None = None
    """``static`` or ``dynamic``."""
    lens_motion: str | None = None
    """Kind of the lens motion in the recording."""
    least_blur: Position | None = None
    """Position of the least blur minus that of the truth, the largest contrast, where a lens with aberrations has
    them more than 0.15 depths of focus apart; None otherwise."""
    focus_place: Annotated[Number, Field(ge=0, le=1)] | None = None
    """Location of the focus, 0...1. Recorded track: the fraction of the recording at which the lens first meets the
    focus, or comes nearest to it. Closed loop: the position in the travel. None if the lens does not come within 1
    depth of focus."""
    focus_off_dof: Distance | None = None
    """Smallest distance between lens and focus, in depths of focus: during the recording or, in the closed loop, in the
    entire travel."""
    mean_rate: Travel | None = None
    """Mean counts per pixel and readout in the region of the evaluation, over the frames that a method may see."""
    light_ratio: Annotated[Number, Field(ge=1, le=MAX_SECONDS_OR_TRAVELS)] | None = None
    """Largest gain of the light divided by its smallest; 1000 for a light that goes out. With several lights, the
    largest of their ratios."""
    obstacle: Obstacle | None = None
    """What keeps every method from the focus: ``no spikes`` or ``all spikes`` in the region of the evaluation, or ``no
    inside region`` for methods that look there, where no answer counts; ``lens at rest``; or ``focus not reached``,
    where the lens stays more than 1 depth of focus away and no answer is right. None if nothing does."""
    grain_rms: Travel | None = None
    """Noise that the renderer left in the recorded pictures at best focus: rms divided by mean, in the box around the
    target."""
    stratum: Stratum | None = None
    """Geometry of the region of the evaluation. Inside the target: ``one depth`` or ``relief``. In the target's box:
    ``80 % and more``, ``60 to 80 %`` or ``below 60 %``. None for other regions, or if the recording states no geometry.
    """


@dataclass(frozen=True, slots=True)
class Judgement:
    """What a method answered on a sequence, how far from the truth, and at what cost."""

    __pydantic_config__: ClassVar[ConfigDict] = STRICT

    status: Status
    """``answered``, ``abstained`` or ``failed``."""
    frames_seen: Count
    """Number of frames up to the last one that the method looked at."""
    position: Position | None = None
    """Lens position at the answer; in the closed loop, the lens position at the end."""
    frame: Number | None = None
    """Frame of the answer, counted from 0, possibly fractional; in the closed loop, the frame at which the method was
    done, even if it abstained."""
    truth: Position | None = None
    """Position of best focus at the answer, or at the first crossing if there is no answer; in the closed loop, at the
    end."""
    truth_frame: Position | None = None
    """Frame of the focus crossing nearest to the answer, or of the first crossing if there is no answer; None in the
    closed loop."""
    depth_of_focus: Distance | None = None
    """Distance between the near and far end of the depth of focus, in travels."""
    trace: tuple[TraceValue, ...] = ()
    """Steps of the search in its own convention; ``egs_code`` and ``sgfs_code`` give frames counted from 1."""
    note: str = ""
    """Note of the search to the reader, or why the method failed."""
    windows: Count = 0
    """Number of windows that the search scored or looked at."""
    seconds: Duration = 0.0
    """Computing time of search and measure, without counting, reading and encoding spikes, in seconds."""
    operations: Annotated[Number, Field(ge=0)] | None = None
    """Additions, multiplications and roots that measure and search declare, of all windows that were scored or looked
    at."""
    reference_rate: Annotated[Number, Field(gt=0)] | None = None
    """Operations per second of a reference measure (``tenengrad``) on the same region, on the machine that gave
    ``seconds``."""
    lens_travel: Travel | None = None
    """Distance that the lens moved during the frames seen and then to the answer, in travels."""
    reversals: Count | None = None
    """Number of times that the lens changed its direction, if the method moved it."""
    time_to_focus_s: Duration | None = None
    """Recorded track: time until the method saw its last frame. Closed loop: time until the lens arrived for good."""
    optimum: Position | None = None
    """Position at which the focus curve of the method's measure peaks without any noise, in constant light, in the box
    around the target, or inside the target for methods that look there; None if it is unknown."""
    sharpness_lost: Annotated[Number, Field(ge=0, le=1)] | None = None
    """What the target lost of its sharpness at the answer: 1 − S(answer)/S(best), with the noise-free SD, S, of
    ``/truth/sharpness``, or of ``/truth/sharpness_inside`` for methods that look inside the target. None if the
    recording holds none, if its positions are too far apart, or if the scene moves."""
    grain_of_curve: Travel | None = None
    """Largest energy of the renderer's noise along the recording, divided by the range of the measure's focus curve.
    The curve is the noise-free sharpness for ``sd`` and related measures, and the measure's own energy for
    ``brenner``, ``tenengrad``, ``squared_gradient``, ``energy_of_laplacian`` and ``variance_of_laplacian``; None for
    other measures, and for methods that look at the frame. Inside the target, it is that of the box."""

    @property
    def error(self) -> float | None:
        """Answer minus truth, in travels."""
        return None if self.position is None or self.truth is None else self.position - self.truth

    @property
    def error_dof(self) -> float | None:
        """Answer minus truth, in depths of focus: the error by which methods are judged."""
        return None if self.error is None or not self.depth_of_focus else self.error / self.depth_of_focus

    @property
    def error_frames(self) -> float | None:
        """Answer minus truth, in frames."""
        known = None not in (self.error, self.frame, self.truth_frame)
        return self.frame - self.truth_frame if known else None  # type: ignore[operator]

    @property
    def blur_px(self) -> float | None:
        """Blur of the target at the answer, in pixels, or in widths that the camera resolves if waves matter.

        The blur grows linearly with the distance from the truth and is one pixel at each end of the depth of focus.
        This is exact for a flat target and the ``image_distance`` and ``focal_length`` drives (c = 2R·|1 - v/v_o| and
        c = 2R·v·|1/u_o - 1/u|, both linear in the drive's coordinate), and holds to first order for the stage.
        """
        return None if self.error_dof is None else 2 * abs(self.error_dof)


@dataclass(frozen=True, slots=True)
class Record:
    """The result of one method on one sequence; None means unknown or not applicable, positions are fractions of the
    travel."""

    who: Who
    what: What
    judgement: Judgement

    def success(self, limit_dof: float = 1.0) -> bool | None:
        """Return whether the answer is within a limit of the truth, or an abstention is right by it; None if unknown.

        An abstention is right only if no answer could have been, that is, if no position that the lens took, or might
        have taken in the closed loop, is within the limit. A larger limit therefore makes more answers right and fewer
        abstentions right, and the success rate within a small limit can exceed the rate within a larger limit.
        """
        what, judgement = self.what, self.judgement
        truth, dof = judgement.truth, judgement.depth_of_focus
        if truth is None or not dof or what.obstacle in UNJUDGED:
            return None
        if judgement.status == "answered":
            return None if judgement.error_dof is None else abs(judgement.error_dof) <= limit_dof
        # The lens of a closed loop may go anywhere, but only when a run ends is it there in vain: a target that moves
        # may be within reach earlier. A recording has one course of the lens, all of which counts.
        off = what.focus_off_dof if what.track == "recorded" else max(0.0, -truth, truth - 1) / dof
        return None if off is None else judgement.status == "abstained" and off > limit_dof

    @property
    def success_least_blur(self) -> bool | None:
        """Whether the answer is within one depth of focus of the least blur; None unless that is far from the truth."""
        if self.what.least_blur is None or self.success() is None:
            return None
        error, dof = self.judgement.error, self.judgement.depth_of_focus
        return error is not None and abs(error - self.what.least_blur) <= (dof or 0.0)

    @property
    def answerable(self) -> bool | None:
        """Whether an answer could be within one depth of focus; None if the truth is unknown or the recording blank."""
        if self.success() is None:
            return None
        return self.what.focus_off_dof is None or self.what.focus_off_dof <= SUCCESS_LIMITS_DOF[1]

    @property
    def broke(self) -> bool:
        """Whether the method's own code broke: it raised an error that is not BadInput, or its answer is malformed."""
        return self.judgement.status == "failed" and not self.judgement.note.startswith(FAIR_FAILURES)


PARTS: tuple[type[Who | What | Judgement], ...] = (Who, What, Judgement)
"""The parts of a record; no two have a key in common."""
FOLLOWING = ("error", "error_dof")
"""Keys of a line for its readers, which follow from others."""


def record_to_json(record: Record) -> dict[str, Any]:
    """Return the line of a record in plain JSON types: numbers that are not finite become null, tuples lists."""
    parts = record.who, record.what, record.judgement
    plain = {f.name: getattr(part, f.name) for part in parts for f in fields(part)}
    plain |= {name: getattr(record.judgement, name) for name in FOLLOWING}
    return {"format": RECORD_FORMAT} | {name: _to_json_value(value) for name, value in plain.items()}


def format_records(records: Iterable[Record]) -> str:
    """Return the text of a ``records.jsonl``, in which each line has its own checksum."""
    return "".join(map(_format_line, records))


def write_records(path: str | Path, records: Iterable[Record]) -> None:
    """Write a ``records.jsonl``, completely or not at all, without holding its text in memory.

    Raises BadInput if the file cannot be written.
    """
    with atomic_file(path) as part, part.open("w", encoding="utf-8") as file:
        file.writelines(map(_format_line, records))


def _format_line(record: Record) -> str:
    return format_checked_json(record_to_json(record)) + "\n"


def read_records(source: str | Path) -> list[Record]:
    """Read the records of an evaluation.

    Parameters
    ----------
    source : str or Path
        Folder of an evaluation, or its ``records.jsonl``.

    Returns
    -------
    list of Record
        At least one record, in the order of the file.

    Raises
    ------
    BadInput
        If there are no records, or if a record is damaged, differs from what was written, has another format, contains
        a number that is out of range, or contradicts itself; the error then gives the line.
    """
    path = Path(source)
    if path.is_dir():
        moving = path / READY / RECORDS_FILE
        path = moving if moving.is_file() else path / RECORDS_FILE
    if not path.is_file():
        raise BadInput(
            f"there is no {RECORDS_FILE} at {str(source)!r}",
            allowed="the folder of an evaluation, or its records",
            hint="make it with saf-gen evaluate",
        )
    with closing(read_lines(path, hint=HINT)) as lines:
        records = [
            _parse_record(parse_checked_json(line, path, first_line=number, hint=HINT))
            for number, line in enumerate(lines, start=1)
        ]
    if not records:
        raise BadInput("the file holds no record", where=str(path), hint=HINT)
    return records


def pop_format(document: Document, expected: str, *, what: str, hint: str) -> None:
    """Remove the key ``format`` from a document; raise BadInput unless its value is the ``expected`` format."""
    data = document.data
    found = data.pop("format", "no format") if isinstance(data, dict) else data
    if found != expected:
        raise BadInput(
            f"this is not a {what} of this version: {found!r:.60}",
            where=document.locate(),
            allowed=f'"format": "{expected}"',
            hint=hint,
        )


def _parse_record(document: Document) -> Record:
    pop_format(document, RECORD_FORMAT, what="record", hint=HINT)
    # Most strings occur in many records; interning keeps each in memory once.
    data = {key: sys.intern(value) if type(value) is str else value for key, value in document.data.items()}
    for keys, other in ((data, _PART_OF), (_PART_OF, data)):
        if odd := next((key for key in keys if key not in other), ""):
            problem = f"the key {odd!r} is missing" if keys is _PART_OF else f"unknown key {odd!r}"
            near = closest(odd, list(_PART_OF)) if keys is data else ""
            raise BadInput(problem, where=document.locate(), allowed=some_of(_PART_OF, odd), nearest=near, hint=HINT)
    parts: list[Any] = []
    for part in PARTS:
        document.data = {key: value for key, value in data.items() if _PART_OF[key] is part}
        parts.append(validate_document(part, document, hint=HINT))
    record = Record(*parts)
    if fault := _find_contradiction(record, stated={key: data[key] for key in FOLLOWING}):
        raise BadInput(
            f"the record contradicts itself: {fault[0]}", where=document.locate(), allowed=fault[1], hint=HINT
        )
    return record


_PART_OF = {f.name: part for part in PARTS for f in fields(part)} | dict.fromkeys(FOLLOWING)
"""The part that has each key, None for a key that follows from others."""


def _find_contradiction(record: Record, *, stated: Mapping[str, Any]) -> tuple[str, str] | None:
    """Return a contradiction in a record and what would be allowed, or None if the record is consistent.

    ``stated`` has the values of FOLLOWING in the line. The frame of a closed-loop record is the frame at which the
    method was done, even if it abstained.
    """
    what, judgement, off = record.what, record.judgement, record.what.focus_off_dof
    status, frame, is_answered = judgement.status, judgement.frame, judgement.status == "answered"
    if judgement.frames_seen > what.frames:
        return f"frames_seen is {judgement.frames_seen} of {what.frames} frames", f"0 to {what.frames}"
    for name in () if is_answered else _NEED_AN_ANSWER:
        if getattr(judgement, name) is not None:
            return f"{status}, but {name} is {getattr(judgement, name):g}", "null if there is no answer"
    if what.obstacle in UNJUDGED and is_answered:
        return f"answered in a recording of {what.obstacle}", "no answer"
    if off is not None and off > SUCCESS_LIMITS_DOF[1] and what.focus_place is not None:
        return f"focus_place is {what.focus_place:g}, but the lens stays {off:g} DoF away", "null beyond 1 DoF"
    if what.track == "recorded" and (frame is not None) != is_answered:
        return f"{status}, but frame is {frame}", "a frame if there is an answer, otherwise null"
    if frame is not None and not -0.5 <= frame <= what.frames:
        return f"frame is {frame:g} of {what.frames} frames", f"-0.5 to {what.frames}"
    for name, value in stated.items():
        follows = _to_json_value(getattr(judgement, name))
        if value != follows:
            return f"{name} is {value}", f"{follows}, which follows from position, truth and depth_of_focus"
    return None


_NEED_AN_ANSWER = ("position", "time_to_focus_s", "sharpness_lost")


def _to_json_value(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_to_json_value(v) for v in value]
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value
