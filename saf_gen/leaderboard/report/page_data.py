"""What the page's script needs to count again for some of the sequences, and to show a record.

The rule is that of the leaderboard: means over each scene's lights and then over scenes, medians of errors,
counts. ``board.js`` follows it; a test in a browser holds both together.
"""

from collections.abc import Callable, Sequence
from typing import Any

from saf_gen.benchmark.records import Record
from saf_gen.leaderboard import AXES, Column, LeaderboardRow, list_shown_columns
from saf_gen.leaderboard.report.compact_records import compact_records, round_finite

__all__ = ["AGGREGATION_RULES", "build_page_data"]

Value = Callable[[Record], float | None]
RECORD_VALUES: dict[str, Value] = {
    "half": lambda r: r.success_half_dof,
    "one": lambda r: r.success_1dof,
    "two": lambda r: r.success_2dof,
    "dof": lambda r: r.error_dof,
    "travel": lambda r: r.error,
    "frames": lambda r: r.error_frames,
    "blur": lambda r: r.blur_px,
    "abstained": lambda r: r.status == "abstained",
    "failed": lambda r: r.status == "failed",
    "seen": lambda r: r.frames_seen / r.frames,
    "way": lambda r: r.lens_travel,
    "turns": lambda r: r.reversals,
    "until": lambda r: r.time_to_focus_s,
    "windows": lambda r: r.windows,
    "seconds": lambda r: r.seconds,
    "position": lambda r: r.position,
    "truth": lambda r: r.truth,
}
"""What is told of each record, numbers all; a condition that holds is 1."""
AGGREGATION_RULES: dict[str, tuple[str, str, int]] = {
    "success_half_dof": ("mean", "half", -1),
    "success_1dof": ("mean", "one", -1),
    "success_2dof": ("mean", "two", -1),
    "median_error_dof": ("median", "dof", 2),
    "median_error_travel": ("median", "travel", 4),
    "median_error_frames": ("median", "frames", 0),
    "median_blur_px": ("median", "blur", 1),
    "abstained": ("count", "abstained", 0),
    "failed": ("count", "failed", 0),
    "frames_seen": ("mean", "seen", -1),
    "lens_travel": ("mean", "way", 2),
    "reversals": ("mean", "turns", 1),
    "time_to_focus_s": ("mean", "until", 3),
    "windows": ("mean", "windows", 0),
    "seconds": ("mean", "seconds", 3),
}
"""By column: how records become a number, which of RECORD_VALUES, and its digits; -1 are whole per cent.

A column that is not here, as an interval, has no number of some of the sequences.
"""
LIGHT = "success_1dof_"


def build_page_data(rows: Sequence[LeaderboardRow], records: Sequence[Record]) -> dict[str, Any]:
    """All of it as JSON knows it; a record's line in records.jsonl is its place here, from 1."""
    methods = [row.method for row in rows]
    sequences = {r.sequence: r for r in records}
    names = list(sequences)
    place, number = {m: i for i, m in enumerate(methods)}, {s: i for i, s in enumerate(names)}
    return {
        "methods": methods,
        "sequences": names,
        "scene": [r.scene for r in sequences.values()],
        "light": [r.light for r in sequences.values()],
        "axes": _axes(list(sequences.values())),
        "columns": [_rule(c) for c in list_shown_columns(rows)],
        "method": [place[r.method] for r in records],
        "sequence": [number[r.sequence] for r in records],
        "status": [r.status for r in records],
        "note": {i: r.note for i, r in enumerate(records) if r.note},
        "facts": compact_records(records, methods),
        "values": {name: [round_finite(value(r)) for r in records] for name, value in RECORD_VALUES.items()},
    }


def _axes(sequences: Sequence[Record]) -> list[dict[str, Any]]:
    """What sequences can be chosen by: the bins of each axis that has several, and each sequence's own."""
    split = ("split", "Split", lambda r: r.split, ())
    found = []
    for name, title, bin_of, order in (split, *((a.name, a.title, a.bin_of, a.order) for a in AXES)):
        held = [bin_of(r) for r in sequences]
        known = [b for b in order if b in held] or sorted({b for b in held if b is not None})
        if len(known) > 1:
            of = [None if b is None else known.index(b) for b in held]
            found.append({"name": name, "title": title, "bins": known, "of": of})
    return found


def _rule(column: Column) -> dict[str, Any] | None:
    light = column.name.removeprefix(LIGHT)
    of_light = column.is_fraction and light != column.name
    name = "success_1dof" if of_light else column.name
    if name not in AGGREGATION_RULES:
        return None
    rule, value, digits = AGGREGATION_RULES[name]
    out: dict[str, Any] = {"rule": rule, "value": value, "digits": digits}
    if of_light:
        out["light"] = light
    return out
