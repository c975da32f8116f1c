"""Records, each with the results of one method on one sequence; they are lines of ``records.jsonl``, read strictly.

Each line states the number of its format, so that a table never uses lines whose meaning has changed. A record that
contradicts itself is refused, too, because tables divide by its numbers and rely on them.
"""

import math
import sys
from collections.abc import Iterable
from contextlib import closing
from dataclasses import dataclass, fields
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, get_args

import numpy as np
from pydantic import ConfigDict, Field, WrapValidator

from saf_gen.benchmark.judgement import SUCCESS_LIMITS_DOF
from saf_gen.core.config.document import STRICT, Document, read_lines, validate_document
from saf_gen.core.config.json_document import format_checked_json, parse_checked_json
from saf_gen.core.files import atomic_file
from saf_gen.errors import BadInput

RECORDS_FILE = "records.jsonl"
READY = ".evaluation.ready"
"""Folder, in the folder of an evaluation, that holds a complete new evaluation until its files have been moved."""
RECORD_FORMAT = "saf-gen record 8"
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
BLANK = get_args(Blank)
Obstacle = Literal["no spikes", "all spikes", "lens at rest", "focus not reached"]
"""What keeps every method from the focus of a sequence."""

Flag = Annotated[bool, Field(strict=True)]
Count = Annotated[int, Field(strict=True, ge=0, le=MAX_COUNT)]
Number = Annotated[float, Field(strict=True)]
Duration = Annotated[Number, Field(ge=0, le=MAX_SECONDS_OR_TRAVELS)]
Travel = Annotated[Number, Field(ge=0, le=MAX_SECONDS_OR_TRAVELS)]
Position = Annotated[Number, Field(ge=-MAX_POSITION_OR_ERROR, le=MAX_POSITION_OR_ERROR)]
Distance = Annotated[Number, Field(ge=0, le=MAX_POSITION_OR_ERROR)]
TraceValue = Annotated[Number, WrapValidator(lambda value, check: math.nan if value is None else check(value))]
"""A number; null in the file is read as NaN."""


@dataclass(frozen=True, slots=True)
class Record:
    """The result of one method on one sequence.

    None means unknown or not applicable. Positions are fractions of the travel.
    """

    __pydantic_config__: ClassVar[ConfigDict] = STRICT

    method: str
    """Name of the method, ``MEASURE+SEARCH``, with options that differ from the defaults."""
    sequence: str
    """Name of the sequence in its dataset, or name of the stream file."""
    split: str | None
    """Split that the sequence belongs to."""
    scene: str
    """Scene that the sequence shows."""
    light: str | None
    """Light schedule of the sequence."""
    status: Literal["answered", "abstained", "failed"]
    """``answered``, ``abstained`` or ``failed``."""
    position: Position | None
    """Lens position at the answer; in the closed loop, the lens position at the end."""
    frame: Number | None
    """Frame of the answer, counted from 0, possibly fractional; in the closed loop, the frame at which the method was
    done, even if it abstained."""
    truth: Position | None
    """Position of best focus at the answer, or at the first crossing if there is no answer."""
    truth_frame: Position | None
    """Frame of the focus crossing nearest to the answer, or of the first crossing if there is no answer."""
    error: Position | None
    """Answer minus truth, in travels."""
    error_frames: Position | None
    """Answer minus truth, in frames."""
    error_dof: Position | None
    """Answer minus truth, in depths of focus."""
    blur_px: Distance | None
    """Blur of the target at the answer, in pixels, or in widths that the camera resolves if waves matter."""
    success_half_dof: Flag | None
    """Whether the answer is within half a depth of focus of the truth, or an abstention is right by this limit."""
    success_1dof: Flag | None
    """Success within one depth of focus."""
    success_2dof: Flag | None
    """Success within two depths of focus."""
    trace: tuple[TraceValue, ...]
    """Steps of the search in its own convention; ``egs_code`` and ``sgfs_code`` give frames counted from 1."""
    frames: Annotated[Count, Field(ge=1)]
    """Number of frames recorded; in the closed loop, the budget in frames."""
    frames_seen: Count
    """Number of frames up to the last one that the method looked at."""
    lens_travel: Travel | None
    """Distance that the lens moved during the frames seen and then to the answer, in travels."""
    windows: Count
    """Number of windows that the search scored or looked at."""
    seconds: Duration
    """Computing time of search and measure, in seconds; counting, reading and encoding spikes are not included."""
    note: str
    """Note of the search to the reader, or why the method failed."""
    region: str
    """Region where the method looked: ``target``, ``frame``, ``shifted``, ``half``, ``double`` or ``centre``."""
    data: str
    """content_sha256 of the stream, all of which was read and compared before any method ran; in a closed loop with
    other time slices than the recording, a digest of stream and slices."""
    code: str
    """Digest of the method's options and code. The code is in the files of measure and search, and in the private
    modules (``_name.py``) that they import from the same folder; comments, docstrings, formatting and location are
    ignored."""
    track: Literal["recorded", "closed_loop"] = "recorded"
    """``recorded`` or ``closed_loop``."""
    terms: str = ""
    """Protocol of the closed loop: what moves the lens, the budget and the sweep."""
    variant: Count | None = None
    """Number of the member in the scene's family."""
    scene_motion: str | None = None
    """``static`` or ``dynamic``."""
    lens_motion: str | None = None
    """Kind of the lens motion in the recording."""
    truth_first: Position | None = None
    """Best focus when the lens of the recording first meets it; equal for all methods."""
    focus_place: Annotated[Number, Field(ge=0, le=1)] | None = None
    """Location of the focus, 0...1. Recorded track: the fraction of the recording at which the lens first meets the
    focus, or comes nearest to it. Closed loop: the position in the travel. None if the lens does not come within 1
    depth of focus."""
    focus_off_dof: Distance | None = None
    """Smallest distance between lens and focus, in depths of focus: during the recording or, in the closed loop, in the
    entire travel."""
    mean_rate: Travel | None = None
    """Mean counts per pixel and readout in the region of the evaluation, over the frames that a method may see."""
    obstacle: Obstacle | None = None
    """What keeps every method from the focus: ``no spikes`` or ``all spikes`` in the region of the evaluation, where no
    answer counts and no success is known; ``lens at rest``; or ``focus not reached``, where the lens stays more than 1
    depth of focus away and no answer is right. None if nothing does."""
    light_ratio: Annotated[Number, Field(ge=1, le=MAX_SECONDS_OR_TRAVELS)] | None = None
    """Largest gain of the light divided by its smallest; 1000 for a light that goes out. With several lights, the
    largest of their ratios."""
    time_to_focus_s: Duration | None = None
    """Recorded track: time until the method saw its last frame. Closed loop: time until the lens arrived for good."""
    reversals: Count | None = None
    """Number of times that the lens changed its direction, if the method moved it."""
    parameters: str = ""
    """Measure and search with every option, defaults included."""
    limits: str = ""
    """What the process of the method might use on a sequence, and the version of Landlock that shut it in, 0 for none,
    if it is not part of saf_gen; otherwise ''."""
    failed_check: str = ""
    """First check of ``saf-gen methods check`` that the measure or search fails, if it is not part of saf_gen; the key
    is missing if there is none."""
    tuning: str = ""
    """First 12 digits of the SHA-256 of the tuned file that named the method (``@FILE``), or ''."""
    machine: str = ""
    """Processor, cores and versions, on which ``seconds`` depends."""
    rig: str = ""
    """Versions of the parts of the evaluator that count and capture spikes and judge answers."""
    grain_rms: Travel | None = None
    """Noise that the renderer left in the recorded pictures at best focus: rms divided by mean, in the box around the
    target."""
    grain_of_curve: Travel | None = None
    """Largest energy of the renderer's noise along the recording, divided by the range of the measure's focus curve.
    The curve is the noise-free sharpness for ``sd`` and related measures, and the measure's own energy for
    ``brenner``, ``tenengrad``, ``squared_gradient``, ``energy_of_laplacian`` and ``variance_of_laplacian``; None for
    other measures, and for methods that look at the frame."""
    sensor: str | None = None
    """Name of the recording's sensor, followed by six digits of a digest if its numbers differ from those of the
    registered sensor of that name. None if the recording does not state its sensor."""
    benchmark: str | None = None
    """Name and digest of the frozen benchmark that the sequence belongs to; None if it belongs to no benchmark."""

    optimum: Position | None = None
    """Position at which the focus curve of the method's measure peaks without any noise, in constant light, in the box
    around the target. For ``sd`` and related measures at rest it follows from the noise-free sharpness in the
    recording; for others, and for ``sd`` on recordings of moving scenes, the recording may state it. The key is missing
    if it is unknown."""
    error_optimum_dof: Position | None = None
    """Answer minus ``optimum``, in depths of focus: the error that the truth, which weighs all pixels of the target
    alike, does not explain. The key is missing if it is unknown."""
    success_least_blur: Flag | None = None
    """Success within one depth of focus if the least blur were the truth, where a lens with aberrations has its least
    blur more than 0.15 depths of focus from the truth, its largest contrast. The key is missing otherwise."""
    in_focus: Flag | None = None
    """Whether something of the target's middle 80 % of pixels is in focus at the answer, for a tilted or deep target,
    of which something is over more than 1.3 depths of focus. The key is missing otherwise."""

    sharpness_lost: Annotated[Number, Field(ge=0, le=1)] | None = None
    """What the target lost of its sharpness at the answer: 1 − S(answer)/S(best), with the noise-free SD, S, that the
    recording holds for each rendered position (``/truth/sharpness``). The key is missing if the recording holds none,
    if its positions are too far apart, or if the scene moves."""

    operations: Annotated[Number, Field(ge=0)] | None = None
    """Additions, multiplications and roots that measure and search declare, of all windows that were scored or looked
    at. The key is missing in records from before they were counted."""
    reference_rate: Annotated[Number, Field(gt=0)] | None = None
    """Operations per second of a reference measure (``tenengrad``) on the same region, on the machine that gave
    ``seconds``. The key is missing if ``operations`` is."""

    @property
    def answerable(self) -> bool | None:
        """Whether an answer could be within one depth of focus; None if the truth is unknown or the recording blank."""
        if self.success_1dof is None:
            return None
        return self.focus_off_dof is None or self.focus_off_dof <= SUCCESS_LIMITS_DOF[1]

    @property
    def broke(self) -> bool:
        """Whether the method's own code broke: it raised an error that is not BadInput, or its answer is malformed."""
        return self.status == "failed" and not self.note.startswith(FAIR_FAILURES)


KEYS_WHERE_KNOWN = (
    *("failed_check", "optimum", "error_optimum_dof", "success_least_blur"),
    *("in_focus", "sharpness_lost", "operations", "reference_rate"),
)
"""Keys that a line has only if they are known, so that lines from before there were such keys are read as well."""


def record_to_json(record: Record) -> dict[str, Any]:
    """Return the record in plain JSON types: numbers that are not finite become null, and tuples become lists."""
    plain = {f.name: _to_json_value(getattr(record, f.name)) for f in fields(record)}
    for key in KEYS_WHERE_KNOWN:
        if plain[key] in (None, ""):
            del plain[key]
    return {"format": RECORD_FORMAT, **plain}


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
    document.data = {key: sys.intern(value) if type(value) is str else value for key, value in document.data.items()}
    record = validate_document(Record, document, hint=HINT)
    if missing := next((key for key in _KEYS if key not in document.data), ""):  # one with a default passes validation
        raise BadInput(f"the key {missing!r} is missing", where=document.locate(), hint=HINT)
    if fault := _find_contradiction(record):
        raise BadInput(
            f"the record contradicts itself: {fault[0]}", where=document.locate(), allowed=fault[1], hint=HINT
        )
    return record


_KEYS = [f.name for f in fields(Record) if f.name not in KEYS_WHERE_KNOWN]


def _find_contradiction(r: Record) -> tuple[str, str] | None:
    """Return a contradiction in a record and what would be allowed, or None if the record is consistent.

    An answer is a success if its error is within the limit. An abstention is a success if no answer could have been
    one, and has no error. If the truth is unknown, success is null. The frame of a closed-loop record is the frame at
    which the method was done, even if it abstained. ``focus_place`` is null if the lens stays more than 1 DoF away from
    the focus.
    """
    if r.frames_seen > r.frames:
        return f"frames_seen is {r.frames_seen} of {r.frames} frames", f"0 to {r.frames}"
    success = (r.success_half_dof, r.success_1dof, r.success_2dof)
    if len({s is None for s in success}) > 1:
        return "success is known within some limits and not within others", "all three, or null in all"
    if r.status != "answered":
        for name in _NEED_AN_ANSWER:
            if getattr(r, name) is not None:
                return f"{r.status}, but {name} is {getattr(r, name):g}", "null if there is no answer"
    if r.obstacle in BLANK and (r.status == "answered" or success[0] is not None):
        return f"{r.status} with success {success[0]} in a recording of {r.obstacle}", "no answer and success null"
    if r.status == "failed" and any(success):
        return "failed, but success is true", "false, or null if the truth is unknown"
    if r.status == "abstained" and any(far and not near for near, far in pairwise(success)):
        return "abstained, right within a larger limit but wrong within a smaller one", "right within the smaller, too"
    off = r.focus_off_dof
    if off is not None and off > SUCCESS_LIMITS_DOF[1] and r.focus_place is not None:
        return f"focus_place is {r.focus_place:g}, but the lens stays {off:g} DoF away", "null beyond 1 DoF"
    if r.track == "recorded" and r.status == "abstained" and off is not None and success[0] is not None:
        right = tuple(off > limit for limit in SUCCESS_LIMITS_DOF)
        if success != right:
            shown = ", ".join(map(str, success))
            return f"abstained {off:g} DoF from the focus, but success is {shown}", ", ".join(map(str, right))
    if r.track == "recorded" and (r.frame is not None) != (r.status == "answered"):
        return f"{r.status}, but frame is {r.frame}", "a frame if there is an answer, otherwise null"
    if r.frame is not None and not -0.5 <= r.frame <= r.frames:
        return f"frame is {r.frame:g} of {r.frames} frames", f"-0.5 to {r.frames}"
    if r.error is not None and r.truth is None:
        return f"error is {r.error:g}, but truth is null", "null if the truth is unknown"
    if r.error is None and (r.error_dof is not None or r.blur_px is not None):
        return "error_dof or blur_px is given, but error is null", "null in all three"
    if r.error_dof is not None:
        right = tuple(abs(r.error_dof) <= limit for limit in SUCCESS_LIMITS_DOF)
        if success != right:
            shown = ", ".join(map(str, success))
            return f"error_dof is {r.error_dof:g}, but success is {shown}", ", ".join(map(str, right))
    elif r.status == "answered" and any(success):
        return "success is true, but error_dof is null", "success false or null if the error is unknown"
    if r.success_least_blur is not None and r.success_1dof is None:
        return "success_least_blur is known, and success_1dof is not", "known in both"
    if r.success_least_blur and r.status == "failed":
        return "failed, but success_least_blur is true", "false, or null if the truth is unknown"
    return None


_NEED_AN_ANSWER = (
    *("position", "error", "error_frames", "error_dof"),
    *("blur_px", "time_to_focus_s", "error_optimum_dof", "sharpness_lost"),
)


def _to_json_value(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_to_json_value(v) for v in value]
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value
