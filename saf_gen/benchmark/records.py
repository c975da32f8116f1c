"""What one method did on one sequence, as a line of ``records.jsonl``: written, and read back strictly.

A line names its format by number, so that a table is never made of lines whose meaning has changed. A record
that cannot be true is refused, too, because tables divide by its numbers and believe them.
"""

import math
import sys
from collections.abc import Iterable
from contextlib import closing
from dataclasses import dataclass, fields
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import ConfigDict, Field, WrapValidator

from saf_gen.benchmark.judgement import SUCCESS_LIMITS_DOF
from saf_gen.core.config.document import STRICT, Document, read_lines, validate_document
from saf_gen.core.config.json_document import format_checked_json, parse_checked_json
from saf_gen.core.files import write_atomically
from saf_gen.errors import BadInput

RECORDS_FILE = "records.jsonl"
READY = ".evaluation.ready"
"""The folder, inside that of an evaluation, in which a new one lies whole until its files have been moved."""
RECORD_FORMAT = "saf-gen record 7"
KEYS_SINCE = {
    "saf-gen record 6": ("benchmark",),
    "saf-gen record 5": ("benchmark", "sensor"),
    "saf-gen record 4": ("benchmark", "sensor", "grain_rms", "grain_of_curve"),
}
"""Keys that records of earlier formats do not have: they are then unknown."""
HINT = "run saf-gen evaluate again"

MAX_COUNT = 2**53
"""A float holds every whole number up to this one."""
MAX_SECONDS_OR_TRAVELS = 1e9
"""Upper limit of seconds and travels: above any that occur, and low enough that means stay finite."""
MAX_POSITION_OR_ERROR = 1e100
"""Upper limit of positions and errors in any unit: above any that occur, and low enough that means stay finite."""

Flag = Annotated[bool, Field(strict=True)]
Count = Annotated[int, Field(strict=True, ge=0, le=MAX_COUNT)]
Number = Annotated[float, Field(strict=True)]
Duration = Annotated[Number, Field(ge=0, le=MAX_SECONDS_OR_TRAVELS)]
Travel = Annotated[Number, Field(ge=0, le=MAX_SECONDS_OR_TRAVELS)]
Position = Annotated[Number, Field(ge=-MAX_POSITION_OR_ERROR, le=MAX_POSITION_OR_ERROR)]
Distance = Annotated[Number, Field(ge=0, le=MAX_POSITION_OR_ERROR)]
TraceValue = Annotated[Number, WrapValidator(lambda value, check: math.nan if value is None else check(value))]
"""A number, or NaN for a null in the file."""


@dataclass(frozen=True, slots=True)
class Record:
    """One method on one sequence. None means unknown or not applicable; positions are fractions of the travel."""

    __pydantic_config__: ClassVar[ConfigDict] = STRICT

    method: str
    """The method as ``MEASURE+SEARCH``, with options that differ from the defaults."""
    sequence: str
    """The sequence's name in its dataset, or that of the stream's file."""
    split: str | None
    """The split that it belongs to."""
    scene: str
    """The scene that it shows."""
    light: str | None
    """The light schedule."""
    status: Literal["answered", "abstained", "failed"]
    """``answered``, ``abstained`` or ``failed``."""
    position: Position | None
    """Where the lens stood at the answer; in the closed loop where it was at the end."""
    frame: Number | None
    """The frame of the answer, from 0, perhaps fractional; in the closed loop when the method was done, of an
    abstention too."""
    truth: Position | None
    """Best focus at the answer, as a position; without an answer that of the first crossing."""
    truth_frame: Position | None
    """The frame at which the lens crosses the truth nearest to the answer; without an answer the first crossing."""
    error: Position | None
    """Answer minus truth, in travels."""
    error_frames: Position | None
    """The same in frames."""
    error_dof: Position | None
    """The same in depths of focus."""
    blur_px: Distance | None
    """Blur of the target at the answer, pixels; under a microscope in the width that it resolves."""
    success_half_dof: Flag | None
    """Whether the answer lies within half a depth of focus, or an abstention was right by that limit."""
    success_1dof: Flag | None
    """The same for one depth of focus: this ranks."""
    success_2dof: Flag | None
    """The same for two depths of focus."""
    trace: tuple[TraceValue, ...]
    """Steps of the search in its own convention; ``egs_code`` and ``sgfs_code`` give frames counted from 1."""
    frames: Annotated[Count, Field(ge=1)]
    """Frames recorded; in the closed loop the budget."""
    frames_seen: Count
    """Frames up to the last one that the method looked at."""
    lens_travel: Travel | None
    """Distance that the lens moved while it was seen and then to the answer, in travels."""
    windows: Count
    """Windows that the search scored."""
    seconds: Duration
    """Seconds that search and measure computed; counting, reading and encoding spikes are not in it."""
    note: str
    """What the search wants a reader to know, or why the method failed."""
    region: str
    """Where the method looked: ``target`` or ``frame``."""
    data: str
    """content_sha256 of the stream; for a closed loop with time slices of its own, a digest of both."""
    code: str
    """Digest of the method's options and code: the files of measure and search and the private modules
    (``_name.py``) of the same folder that these import; comments, docstrings, formatting and location do not
    count."""
    track: Literal["recorded", "closed_loop"] = "recorded"
    """``recorded`` or ``closed_loop``."""
    terms: str = ""
    """The protocol of the closed loop: what moves the lens, the budget, the sweep."""
    variant: Count | None = None
    """Number of the member in the scene's family."""
    scene_motion: str | None = None
    """``static`` or ``dynamic``."""
    lens_motion: str | None = None
    """Kind of the lens's motion in the recording."""
    truth_first: Position | None = None
    """Best focus when the lens of the recording first meets it: the same for all methods."""
    focus_place: Annotated[Number, Field(ge=0, le=1)] | None = None
    """Where the focus lies, 0...1. Recorded track: the fraction of the recording at which the lens first
    meets it, or comes nearest. Closed loop: the position in the travel. None beyond 1 depth of focus."""
    focus_off_dof: Distance | None = None
    """How many depths of focus away the lens stays from the focus: in the recording, or in all its travel."""
    mean_rate: Travel | None = None
    """Counts per pixel and readout, where the evaluation looks, over the frames that a method may see."""
    light_ratio: Annotated[Number, Field(ge=1, le=MAX_SECONDS_OR_TRAVELS)] | None = None
    """Brightest over darkest gain; with several lights the largest, 1000 for a light that goes out."""
    time_to_focus_s: Duration | None = None
    """Recorded track: time until the method saw its last frame. Closed loop: time until the lens arrived for good."""
    reversals: Count | None = None
    """How often the lens changed its direction, where the method moved it."""
    parameters: str = ""
    """Measure and search with every option, defaults included."""
    tuning: str = ""
    """12 digits of the digest of the file of tuned constants that named the method."""
    machine: str = ""
    """Processor, cores and versions, on which ``seconds`` depend."""
    rig: str = ""
    """Version of the evaluator: how spikes are counted, captured and judged."""
    grain_rms: Travel | None = None
    """Noise that the renderer left in the recorded pictures, rms over the mean in the target's box, at best focus."""
    grain_of_curve: Travel | None = None
    """The largest energy of that noise along the recording over the range of the measure's focus curve: of the
    noise-free sharpness for ``sd`` and its kin, of their own energy for ``brenner``, ``tenengrad``,
    ``squared_gradient``, ``energy_of_laplacian`` and ``variance_of_laplacian``; None for other measures, and for
    methods that look at the frame."""
    sensor: str | None = None
    """The sensor that recorded, by name; six digits of a digest follow where its numbers are not those of that name.
    None for a recording that does not state its sensor."""
    benchmark: str | None = None
    """Name and digest of the frozen benchmark that the sequence belongs to; None where it belongs to none."""


def benchmark_record_to_json(record: Record) -> dict[str, Any]:
    """Return the record as plain JSON values: a number that is not finite is null, a tuple a list."""
    return {"format": RECORD_FORMAT, **{f.name: _to_plain(getattr(record, f.name)) for f in fields(record)}}


def format_benchmark_records(records: Iterable[Record]) -> str:
    """Return the lines of a ``records.jsonl``, each with a checksum of its own."""
    return "".join(map(_format_line, records))


def write_benchmark_records(path: str | Path, records: Iterable[Record]) -> None:
    """Write a ``records.jsonl``, whole or not at all, without ever holding its text in memory.

    Raises BadInput where it cannot be written.
    """
    with write_atomically(path) as part, part.open("w", encoding="utf-8") as file:
        file.writelines(map(_format_line, records))


def _format_line(record: Record) -> str:
    return format_checked_json(benchmark_record_to_json(record)) + "\n"


def read_records(source: str | Path) -> list[Record]:
    """Read the records of an evaluation.

    Parameters
    ----------
    source : the folder of an evaluation, or its ``records.jsonl``.

    Raises
    ------
    BadInput : with the line, where there are no records, or one is damaged, was written in another format,
        has a number out of its range, contradicts itself, or is not what was written.
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


def pop_benchmark_record_format(document: Document, expected: str, *, what: str, hint: str) -> None:
    """Remove the key ``format`` from a document; raise BadInput unless it says that this is a current ``what``."""
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
    if isinstance(document.data, dict) and (keys := KEYS_SINCE.get(str(document.data.get("format")))):
        document.data |= {"format": RECORD_FORMAT, **{key: document.data.get(key) for key in keys}}
    pop_benchmark_record_format(document, RECORD_FORMAT, what="record", hint=HINT)
    # Most texts stand in many records, and are then in memory once.
    document.data = {key: sys.intern(value) if type(value) is str else value for key, value in document.data.items()}
    record = validate_document(Record, document, hint=HINT)
    if len(document.data) < len(_KEYS):  # one that has a default in memory
        missing = next(key for key in _KEYS if key not in document.data)
        raise BadInput(f"the key {missing!r} is missing", where=document.locate(), hint=HINT)
    if fault := _find_contradiction(record):
        raise BadInput(
            f"the record contradicts itself: {fault[0]}", where=document.locate(), allowed=fault[1], hint=HINT
        )
    return record


_KEYS = [f.name for f in fields(Record)]


def _find_contradiction(r: Record) -> tuple[str, str] | None:
    """Return what in a record cannot be true at once, and what could be; None where all of it can.

    An answer is a success where its error is within the limit. An abstention is a success where no answer could have
    been, and has no error; where the truth is unknown there is no success or failure. The frame of a closed-loop record
    is when the method was done, for an abstention too. A focus that the lens stays away from has no location.
    """
    if r.frames_seen > r.frames:
        return f"frames_seen is {r.frames_seen} of {r.frames} frames", f"0 to {r.frames}"
    success = (r.success_half_dof, r.success_1dof, r.success_2dof)
    if len({s is None for s in success}) > 1:
        return "success is known within some limits and not within others", "all three, or null in all"
    if r.status != "answered":
        for name in ("position", "error", "error_frames", "error_dof", "blur_px", "time_to_focus_s"):
            if getattr(r, name) is not None:
                return f"{r.status}, with {name} {getattr(r, name):g}", "null where there is no answer"
    if r.status == "failed" and any(success):
        return "failed, with success", "false, or null where the truth is unknown"
    if r.status == "abstained" and any(far and not near for near, far in pairwise(success)):
        return "abstained, right within a larger limit and not within a smaller one", "the other way round"
    off = r.focus_off_dof
    if off is not None and off > SUCCESS_LIMITS_DOF[1] and r.focus_place is not None:
        return f"focus_place is {r.focus_place:g}, and the lens stays {off:g} DoF away", "null beyond 1 DoF"
    if r.track == "recorded" and r.status == "abstained" and off is not None and success[0] is not None:
        right = tuple(off > limit for limit in SUCCESS_LIMITS_DOF)
        if success != right:
            said = ", ".join(map(str, success))
            return f"abstained {off:g} DoF from the focus, and success {said}", ", ".join(map(str, right))
    if r.track == "recorded" and (r.frame is not None) != (r.status == "answered"):
        return f"{r.status}, with frame {r.frame}", "a frame where there is an answer, else null"
    if r.frame is not None and not -0.5 <= r.frame <= r.frames:
        return f"frame is {r.frame:g} of {r.frames} frames", f"-0.5 to {r.frames}"
    if r.error is not None and r.truth is None:
        return f"error is {r.error:g}, and there is no truth", "null where the truth is unknown"
    if r.error is None and (r.error_dof is not None or r.blur_px is not None):
        return "an error in depths of focus or a blur, and error is null", "null in all three"
    if r.error_dof is not None:
        right = tuple(abs(r.error_dof) <= limit for limit in SUCCESS_LIMITS_DOF)
        if success != right:
            said = ", ".join(map(str, success))
            return f"error_dof is {r.error_dof:g}, and success {said}", ", ".join(map(str, right))
    elif r.status == "answered" and any(success):
        return "a success, and error_dof is null", "success false or null where the error is unknown"
    return None


def _to_plain(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_to_plain(v) for v in value]
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value
