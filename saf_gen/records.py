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
from pathlib import Path
from sys import float_info
from types import UnionType
from typing import Any, Literal, get_args, get_origin, get_type_hints

import numpy as np

from saf_gen.errors import BadInput, closest
from saf_gen.record_rules import RANGES, contradiction

__all__ = [
    "FILE",
    "FORMAT",
    "Record",
    "read_records",
    "record_from_json",
    "record_to_json",
    "records_to_text",
]

FILE = "records.jsonl"
FORMAT = "saf-gen record 3"


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
    return {"format": FORMAT, **{f.name: _plain(getattr(record, f.name)) for f in fields(record)}}


def records_to_text(records: Iterable[Record]) -> str:
    """The lines of a ``records.jsonl``."""
    return "".join(json.dumps(record_to_json(r), ensure_ascii=False, allow_nan=False) + "\n" for r in records)


def record_from_json(line: Any, *, where: str = "") -> Record:
    """What record_to_json wrote; a null in a trace is NaN.

    Raises BadInput for anything but a record of this format with every key of the right type, a number out of
    its range, and a record that contradicts itself.
    """
    if not isinstance(line, dict) or line.get("format") != FORMAT:
        held = line.get("format", "no format") if isinstance(line, dict) else line
        raise BadInput(
            f"is no record of this version: {reprlib.repr(held)}",
            where=where,
            allowed=f'"format": "{FORMAT}"',
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
        low, high = RANGES.get(key, (-math.inf, math.inf))
        if type(value) in (int, float) and not low <= value <= high:
            allowed = f"{low:g} or more" if value < low else f"{high:g} or less"
            raise BadInput(f"{key} is {reprlib.repr(value)}", where=where, allowed=allowed)
        held[key] = value
    record = Record(**held)
    if wrong := contradiction(record):
        raise BadInput(
            f"contradicts itself: {wrong[0]}",
            where=where,
            allowed=wrong[1],
            hint="run saf-gen evaluate again",
        )
    return record


def read_records(source: str | Path) -> list[Record]:
    """The records of an evaluation: its folder, or the file itself.

    Raises BadInput, with the line, where there is none, one is damaged, or none is in it.
    """
    path = Path(source)
    if path.is_dir():
        path /= FILE
    if not path.is_file():
        raise BadInput(
            f"there is no {FILE} at {str(source)!r}",
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
        records.append(record_from_json(line, where=where))
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
