"""Every key of every record for the page, in little: what is the same for many records is told once.

A page that holds the lines of records.jsonl as they are grows by a kilobyte and more a record, eight
megabytes for sixty methods on 132 sequences; told so it grows by a tenth of that.
"""

import math
from collections.abc import Sequence
from dataclasses import fields
from typing import Any

from saf_gen.benchmark.records import RECORD_FORMAT, Record

__all__ = ["MAX_TRACE_STEPS", "PAGE_VALUE_NAMES", "compact_records", "round_finite"]

MAX_TRACE_STEPS = 24
"""Of a trace; of a longer one the page has the number of steps alone."""
KNOWN = ("method", "sequence", "status", "note")
PAGE_VALUE_NAMES = {
    "position": "position",
    "truth": "truth",
    "error": "travel",
    "error_frames": "frames",
    "error_dof": "dof",
    "blur_px": "blur",
    "success_half_dof": "half",
    "success_1dof": "one",
    "success_2dof": "two",
    "lens_travel": "way",
    "windows": "windows",
    "seconds": "seconds",
    "time_to_focus_s": "until",
    "reversals": "turns",
}
"""Keys whose numbers the page has already, for its tables, and their names there."""


def compact_records(records: Sequence[Record], methods: Sequence[str]) -> dict[str, dict[str, Any]]:
    """By key of a record, in the order of the file: where its value is found.

    ``by`` is ``known`` (the page has it under this name), ``value`` (under the name ``held``; a ``flag`` is 0
    or 1 there), ``all`` (``held`` itself), ``sequence`` (``held`` by sequence, in the order in which they
    first come), ``method`` (by method, in the order of ``methods``), or ``record``.
    """
    sequences = list(dict.fromkeys(r.sequence for r in records))
    found: dict[str, dict[str, Any]] = {"format": {"by": "all", "held": RECORD_FORMAT}}
    for name in (f.name for f in fields(Record)):
        if name in KNOWN:
            found[name] = {"by": "known"}
        elif name in PAGE_VALUE_NAMES:
            flag = {"flag": True} if name.startswith("success") else {}
            found[name] = {"by": "value", "held": PAGE_VALUE_NAMES[name], **flag}
        else:
            held = [_plain(getattr(record, name)) for record in records]
            found[name] = _told(held, records, sequences, methods)
    return found


def round_finite(value: float | None) -> float | None:
    """Nine digits: more than are shown, half as long; None where it is not finite."""
    if value is None or not math.isfinite(value):
        return None
    return int(value) if float(value).is_integer() else float(f"{float(value):.9g}")


def _told(
    held: Sequence[Any], records: Sequence[Record], sequences: Sequence[str], methods: Sequence[str]
) -> dict[str, Any]:
    if held and all(value == held[0] for value in held):
        return {"by": "all", "held": held[0]}
    for by, names in (("sequence", sequences), ("method", methods)):
        of: dict[str, Any] = {}
        if all(of.setdefault(getattr(r, by), v) == v for r, v in zip(records, held, strict=True)):
            return {"by": by, "held": [of[name] for name in names]}
    return {"by": "record", "held": held}


def _plain(value: Any) -> Any:
    if isinstance(value, tuple):
        return [round_finite(v) for v in value] if len(value) <= MAX_TRACE_STEPS else len(value)
    return round_finite(value) if isinstance(value, float) else value
