"""What one method did on one sequence, as a line of ``records.jsonl``: written, and read back strictly.

A line tells its format by number, so that a table is never made of lines whose meaning has changed. What
cannot be true of a method is refused, too: tables divide by it and believe it.
"""

import json
import math
import reprlib
from collections.abc import Iterable
from dataclasses import dataclass, fields
from functools import cache
from itertools import pairwise
from pathlib import Path
from sys import float_info
from types import UnionType
from typing import Any, Literal, get_args, get_origin, get_type_hints

import numpy as np

from saf_gen.benchmark.judgement import SUCCESS_LIMITS_DOF
from saf_gen.errors import BadInput, closest

__all__ = [
    "FIELD_RANGES",
    "MAX_COUNT",
    "MAX_SECONDS_OR_TRAVELS",
    "RECORDS_FILE",
    "RECORD_FORMAT",
    "Record",
    "find_contradiction",
    "format_records",
    "parse_record",
    "read_records",
    "record_to_json",
]

RECORDS_FILE = "records.jsonl"
RECORD_FORMAT = "saf-gen record 4"


MAX_COUNT = 2**53
"""Of whole numbers: a float holds each of them up to here."""
MAX_SECONDS_OR_TRAVELS = 1e9
"""Seconds or travels: more than there will be, and means of it are finite."""
MAX_POSITION_OR_ERROR = 1e100
"""Positions and errors, in any unit: the same."""
FIELD_RANGES = {
    "frames": (1, MAX_COUNT),
    "frames_seen": (0, MAX_COUNT),
    "windows": (0, MAX_COUNT),
    "variant": (0, MAX_COUNT),
    "reversals": (0, MAX_COUNT),
    "seconds": (0, MAX_SECONDS_OR_TRAVELS),
    "time_to_focus_s": (0, MAX_SECONDS_OR_TRAVELS),
    "lens_travel": (0, MAX_SECONDS_OR_TRAVELS),
    "mean_rate": (0, MAX_SECONDS_OR_TRAVELS),
    "light_ratio": (1, MAX_SECONDS_OR_TRAVELS),
    "blur_px": (0, MAX_POSITION_OR_ERROR),
    "focus_place": (0, 1),
    "focus_off_dof": (0, MAX_POSITION_OR_ERROR),
    **dict.fromkeys(
        ("position", "truth", "truth_first", "truth_frame"), (-MAX_POSITION_OR_ERROR, MAX_POSITION_OR_ERROR)
    ),
    **dict.fromkeys(("error", "error_frames", "error_dof"), (-MAX_POSITION_OR_ERROR, MAX_POSITION_OR_ERROR)),
}
"""The least and the most that a number of a record can be, where it is known."""


@dataclass(frozen=True)
class Record:
    """One method on one sequence. None is unknown or not there; positions are fractions of the travel."""

    method: str
    sequence: str
    split: str | None
    scene: str
    light: str | None
    status: Literal["answered", "abstained", "failed"]
    position: float | None
    frame: float | None
    truth: float | None
    truth_frame: float | None
    error: float | None
    error_frames: float | None
    error_dof: float | None
    blur_px: float | None
    success_half_dof: bool | None
    success_1dof: bool | None
    success_2dof: bool | None
    trace: tuple[float, ...]
    frames: int
    frames_seen: int
    lens_travel: float | None
    windows: int
    seconds: float
    note: str
    region: str
    data: str
    """content_sha256 of the stream; where a closed loop has time slices of its own, digest of both."""
    code: str
    """Method.code."""
    track: Literal["recorded", "closed_loop"] = "recorded"
    terms: str = ""
    """Of the closed loop: what moves the lens, the budget, the sweep."""
    variant: int | None = None
    """Which member of the scene's family."""
    scene_motion: str | None = None
    """``static`` or ``dynamic``."""
    lens_motion: str | None = None
    """Kind of the lens's motion in the recording."""
    truth_first: float | None = None
    """Best focus when the lens of the recording first meets it: the same for all methods."""
    focus_place: float | None = None
    """Where the focus lies, 0...1. Recorded: the share of the recording at which the lens first meets it, or
    comes nearest. Live: the place in the travel. None where neither comes within 1 depth of focus."""
    focus_off_dof: float | None = None
    """How far from the focus, in depths of focus, the lens stays in the recording; live, the whole travel."""
    mean_rate: float | None = None
    """Counts a pixel and readout, where the evaluation looks, over the frames that a method may see."""
    light_ratio: float | None = None
    """scores.light_ratio of the recording."""
    time_to_focus_s: float | None = None
    """Recorded: until all was seen that the answer needs, without the way to it. Live: until in place."""
    reversals: int | None = None
    """How often the lens turned round, where the method moved it."""
    parameters: str = ""
    """Measure and search with every option, those by default too."""
    tuning: str = ""
    """12 digits of the file of tuned constants that the method was named by."""
    machine: str = ""
    """host.describe(): ``seconds`` of two machines do not compare."""
    rig: str = ""
    """12 digits over the sources of the track's rig: contest.rig_code."""


def record_to_json(record: Record) -> dict[str, Any]:
    """The record as JSON knows it: a number that is not finite is null, a tuple a list."""
    return {"format": RECORD_FORMAT, **{f.name: _plain(getattr(record, f.name)) for f in fields(record)}}


def format_records(records: Iterable[Record]) -> str:
    """The lines of a ``records.jsonl``."""
    return "".join(json.dumps(record_to_json(r), ensure_ascii=False, allow_nan=False) + "\n" for r in records)


def parse_record(line: Any, *, where: str = "") -> Record:
    """What record_to_json wrote; a null in a trace is NaN.

    Raises BadInput for anything but a record of this format with every key of the right type, a number out of
    its range, and a record that contradicts itself.
    """
    if not isinstance(line, dict) or line.get("format") != RECORD_FORMAT:
        held = line.get("format", "no format") if isinstance(line, dict) else line
        raise BadInput(
            f"is no record of this version: {reprlib.repr(held)}",
            where=where,
            allowed=f'"format": "{RECORD_FORMAT}"',
            hint="run saf-gen evaluate again",
        )
    known = _kinds()
    for key in line:
        if key not in known and key != "format":
            raise BadInput(f"unknown key {key!r:.40}", where=where, nearest=closest(key, known))
    held = {}
    for key, kind in known.items():
        if key not in line:
            raise BadInput(f"{key} is missing", where=where, hint="run saf-gen evaluate again")
        value = line[key]
        if get_origin(kind) is tuple and isinstance(value, list):
            value = tuple(math.nan if v is None else float(v) if _is(v, float) else v for v in value)
        if not _is(value, kind):
            raise BadInput(f"{key} is {reprlib.repr(value)}", where=where, allowed=_in_words(kind))
        low, high = FIELD_RANGES.get(key, (-math.inf, math.inf))
        if type(value) in (int, float) and not low <= value <= high:
            allowed = f"{low:g} or more" if value < low else f"{high:g} or less"
            raise BadInput(f"{key} is {reprlib.repr(value)}", where=where, allowed=allowed)
        held[key] = value
    record = Record(**held)
    if wrong := find_contradiction(record):
        raise BadInput(
            f"contradicts itself: {wrong[0]}",
            where=where,
            allowed=wrong[1],
            hint="run saf-gen evaluate again",
        )
    return record


def find_contradiction(r: Record) -> tuple[str, str] | None:
    """What in a record cannot be true at once, and what could; None where all can.

    An answer is a success where its error is within the limit. An abstention is one where no answer could
    have been, and has no error; where the truth is unknown there is neither. A frame of the closed loop
    is when the method was done, of an abstention too. A focus that the lens stays away from lies nowhere.
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


def read_records(source: str | Path) -> list[Record]:
    """The records of an evaluation: its folder, or the file itself.

    Raises BadInput, with the line, where there is none, one is damaged, or none is in it.
    """
    path = Path(source)
    if path.is_dir():
        path /= RECORDS_FILE
    if not path.is_file():
        raise BadInput(
            f"there is no {RECORDS_FILE} at {str(source)!r}",
            allowed="the folder of an evaluation, or its records",
            hint="make it with saf-gen evaluate",
        )
    try:
        lines = path.read_bytes().decode("utf-8").split("\n")  # a note may hold what splitlines would cut at
    except (OSError, UnicodeDecodeError) as error:
        raise BadInput(f"cannot be read: {error}", where=str(path)) from error
    records = []
    for number, text in enumerate(lines if lines[-1] else lines[:-1], start=1):
        where = f"{path}:{number}"
        try:
            line = json.loads(text)
        except (ValueError, RecursionError) as error:  # the latter of lists in lists in lists
            raise BadInput(
                f"is no JSON: {text!r:.40}", where=where, hint="run saf-gen evaluate again"
            ) from error
        records.append(parse_record(line, where=where))
    if not records:
        raise BadInput("holds no record", where=str(path), hint="run saf-gen evaluate again")
    return records


@cache
def _kinds() -> dict[str, Any]:
    return {f.name: get_type_hints(Record)[f.name] for f in fields(Record)}


def _is(value: Any, kind: Any) -> bool:
    """Whether a value from JSON is of a field's type; a whole number will do for a float, never a bool."""
    if isinstance(kind, UnionType):
        return any(_is(value, one) for one in get_args(kind))
    if get_origin(kind) is Literal:
        return value in get_args(kind)
    if get_origin(kind) is tuple:
        return isinstance(value, tuple) and all(isinstance(v, float) for v in value)
    if kind is float:
        return type(value) in (int, float) and -float_info.max <= value <= float_info.max
    return type(value) is kind


def _in_words(kind: Any) -> str:
    if isinstance(kind, UnionType):
        return " or ".join(_in_words(one) for one in get_args(kind))
    if get_origin(kind) is Literal:
        return " or ".join(map(str, get_args(kind)))
    names = {str: "text", int: "a whole number", float: "a finite number", bool: "true or false"}
    return names.get(kind, "null" if kind is type(None) else "a list of numbers")


def _plain(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_plain(v) for v in value]
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value
