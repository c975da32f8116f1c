"""Records into a ranking, and the files that tell it.

Methods rank by success within one depth of focus. Success and cost are averaged over scenes (each scene's
light schedules first), so that a scene with many sequences weighs no more than another; errors are medians
over all sequences. Equal success shares a rank.
"""

import csv
import io
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from pathlib import Path
from typing import Any, Literal

import numpy as np

from saf_gen import __version__
from saf_gen.dataset import write_text
from saf_gen.errors import BadInput
from saf_gen.evaluate import Failure
from saf_gen.scores import Record, record_to_json

__all__ = ["Column", "Row", "columns", "markdown", "table", "write_files"]


_MINOR = frozenset(
    "success_half_dof success_2dof median_error_travel median_error_frames frames_seen seconds".split()  # noqa: SIM905
)


@dataclass(frozen=True)
class Row:
    """One method of the leaderboard. None is unknown: no sequence has the truth that it needs."""

    rank: int | None
    tied: tuple[str, ...]
    """The methods that share the rank."""
    method: str
    success_half_dof: float | None
    success_1dof: float | None
    success_2dof: float | None
    median_error_dof: float | None
    median_error_travel: float | None
    median_error_frames: float | None
    success_by_light: tuple[tuple[str, float | None], ...]
    abstained: int
    failed: int
    sequences: int
    frames_seen: float | None
    lens_travel: float | None
    seconds: float | None


@dataclass(frozen=True)
class Column:
    """How one number of a row is named, explained and printed."""

    name: str
    header: str
    meaning: str
    value: Callable[[Row], Any]
    text: Callable[[Row], str]
    justify: Literal["left", "right"] = "right"
    group: str = ""
    """What the columns of a group share, for a table with room for a second line of headers."""
    minor: bool = False
    """Left out where there is little room, as in a narrow terminal; never in a file."""


def table(records: Iterable[Record]) -> tuple[Row, ...]:
    """The leaderboard of these records, best first.

    Within a rank rows stand by median error in depths of focus, then by name. Methods without any
    success to judge come last, with no rank.

    Raises BadInput where records cannot be compared: a sequence with two data digests or two regions, a
    method with two versions of its code, a pair of method and sequence that is there twice or not at all.
    """
    by_method: dict[str, dict[str, Record]] = {}
    for record in records:
        mine = by_method.setdefault(record.method, {})
        if record.sequence in mine:
            raise BadInput(f"two records of {record.method} on {record.sequence}", allowed="one")
        mine[record.sequence] = record
    _comparable(by_method)
    lights = sorted({r.light for mine in by_method.values() for r in mine.values() if r.light is not None})
    rows = [_row(method, list(mine.values()), lights) for method, mine in by_method.items()]
    scores = [row.success_1dof for row in rows if row.success_1dof is not None]
    ranked = []
    for row in rows:
        own = row.success_1dof
        if own is None:
            ranked.append(row)
            continue
        # Success is an average of averages: equal fractions may differ in the last bit.
        rank = 1 + sum(other > own + 1e-9 for other in scores)
        tied = sorted(
            r.method
            for r in rows
            if r.method != row.method and r.success_1dof is not None and abs(r.success_1dof - own) <= 1e-9
        )
        ranked.append(replace(row, rank=rank, tied=tuple(tied)))
    last = float("inf")
    return tuple(
        sorted(
            ranked,
            key=lambda r: (
                last if r.rank is None else r.rank,
                last if r.median_error_dof is None else r.median_error_dof,
                r.method,
            ),
        )
    )


def columns(rows: Sequence[Row]) -> tuple[Column, ...]:
    """The columns of these rows, in order: one for each light schedule among them."""
    lights = [light for light, _ in rows[0].success_by_light] if rows else []
    dofs, by_light, errors, cost, none = "success", "≤1 DoF by light", "error", "cost", "no answer"
    return (
        Column("rank", "#", "Rank by success within 1 DoF; = marks a tie.", attrgetter("rank"), _rank),
        _column("method", "method", "", str, "Focus measure + search."),
        _column("success_half_dof", "≤½ DoF", dofs, _percent, "Share within ½ depth of focus: blur ≤ 1 px."),
        _column("success_1dof", "≤1 DoF", dofs, _percent, "Share within 1 DoF, blur ≤ 2 px: this ranks."),
        _column("success_2dof", "≤2 DoF", dofs, _percent, "Share within 2 DoF, blur ≤ 4 px."),
        _column(
            "median_error_dof", "err DoF", errors, _fixed(2), "Median |answer − truth| in depths of focus."
        ),
        _column(
            "median_error_travel", "err travel", errors, _fixed(4), "The same as a fraction of the travel."
        ),
        _column(
            "median_error_frames", "err frames", errors, _fixed(0), "The same in frames of the recording."
        ),
        *(_light(light, by_light) for light in lights),
        _column("abstained", "abst.", none, _count, "Sequences on which the search gave no answer."),
        _column(
            "failed", "failed", none, _count, "Sequences on which the method broke; the records say why."
        ),
        _column("frames_seen", "seen", cost, _percent, "Share of the recording that the method waited for."),
        _column("lens_travel", "lens", cost, _fixed(2), "Lens way in travels: as far as seen, then back."),
        _column("seconds", "s", cost, _fixed(3), "Time in the focus measure, seconds a sequence."),
    )


def markdown(rows: Sequence[Row]) -> str:
    """The table as GitHub-flavoured markdown."""
    shown = columns(rows)
    lines = [
        "| " + " | ".join(c.header for c in shown) + " |",
        "|" + "|".join("---" if c.justify == "left" else "---:" for c in shown) + "|",
    ]
    lines += ["| " + " | ".join(c.text(row).replace("|", "\\|") for c in shown) + " |" for row in rows]
    return "\n".join(lines) + "\n"


def write_files(
    folder: str | Path,
    *,
    rows: Sequence[Row],
    records: Sequence[Record],
    failures: Sequence[Failure] = (),
) -> list[Path]:
    """Write leaderboard.json, .csv and .md and records.jsonl into ``folder``; returns their paths.

    Each file is replaced at once, never seen half written; BadInput where that fails. None becomes null, or
    an empty field of the csv.
    """
    out = Path(folder)
    shown = columns(rows)
    document = {
        "format": "saf-gen leaderboard",
        "version": __version__,
        "ranked_by": "success_1dof",
        "columns": {c.name: c.meaning for c in shown},
        "rows": [{**{c.name: c.value(row) for c in shown}, "tied": list(row.tied)} for row in rows],
        "data": {r.sequence: r.data for r in records},
        "code": {r.method: r.code for r in records},
        "failures": [{"sequence": f.sequence, "problem": f.problem} for f in failures],
    }
    sheet = io.StringIO()
    writer = csv.writer(sheet, lineterminator="\n")
    writer.writerow([c.name for c in shown])
    writer.writerows([["" if (v := c.value(row)) is None else v for c in shown] for row in rows])
    lines = (json.dumps(record_to_json(r), ensure_ascii=False, allow_nan=False) + "\n" for r in records)
    texts = {
        "leaderboard.json": json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n",
        "leaderboard.csv": sheet.getvalue(),
        "leaderboard.md": "# Leaderboard\n\n" + markdown(rows) + "\n" + _legend(shown, failures),
        "records.jsonl": "".join(lines),
    }
    for name, text in texts.items():
        write_text(out / name, text)
    return [out / name for name in texts]


def _comparable(by_method: Mapping[str, Mapping[str, Record]]) -> None:
    everywhere = {sequence for mine in by_method.values() for sequence in mine}
    data: dict[str, tuple[str, str]] = {}
    for method, mine in by_method.items():
        if missing := sorted(everywhere - set(mine)):
            raise BadInput(
                f"{method} has no record of {missing[0]}"
                + (f" and {len(missing) - 1} more" * (len(missing) > 1)),
                allowed="the same sequences for every method",
                hint="run all methods in one `saf-gen evaluate`",
            )
        if len(versions := {r.code for r in mine.values()}) > 1:
            raise BadInput(
                f"records of {method} come from different code: {', '.join(sorted(versions))}",
                allowed="one version of a method in a table",
                hint="evaluate it again",
            )
        for sequence, record in mine.items():
            if data.setdefault(sequence, (record.data, record.region)) != (record.data, record.region):
                raise BadInput(
                    f"records of {sequence} come from different data or regions",
                    allowed="one content_sha256 and one region a sequence",
                    hint="evaluate all methods again",
                )


def _row(method: str, records: Sequence[Record], lights: Sequence[str]) -> Row:
    return Row(
        rank=None,
        tied=(),
        method=method,
        success_half_dof=_over_scenes(records, lambda r: r.success_half_dof),
        success_1dof=_over_scenes(records, lambda r: r.success_1dof),
        success_2dof=_over_scenes(records, lambda r: r.success_2dof),
        median_error_dof=_median(r.error_dof for r in records),
        median_error_travel=_median(r.error for r in records),
        median_error_frames=_median(r.error_frames for r in records),
        success_by_light=tuple(
            (light, _over_scenes([r for r in records if r.light == light], lambda r: r.success_1dof))
            for light in lights
        ),
        abstained=sum(r.status == "abstained" for r in records),
        failed=sum(r.status == "failed" for r in records),
        sequences=len(records),
        frames_seen=_over_scenes(records, lambda r: r.frames_seen / r.frames),
        lens_travel=_over_scenes(records, lambda r: r.lens_travel),
        seconds=_over_scenes(records, lambda r: r.seconds),
    )


def _over_scenes(records: Sequence[Record], value: Callable[[Record], float | None]) -> float | None:
    """Mean over scenes of the mean over lights of the mean over sequences; unknown values are left out."""
    scenes: dict[str, dict[str | None, list[float]]] = {}
    for record in records:
        if (number := value(record)) is not None:
            scenes.setdefault(record.scene, {}).setdefault(record.light, []).append(float(number))
    if not scenes:
        return None
    return float(np.mean([np.mean([np.mean(v) for v in lights.values()]) for lights in scenes.values()]))


def _median(errors: Iterable[float | None]) -> float | None:
    known = [abs(e) for e in errors if e is not None]
    return float(np.median(known)) if known else None


def _legend(shown: Sequence[Column], failures: Sequence[Failure]) -> str:
    lines = [
        "Success and cost are averaged over each scene's lights, then over scenes; errors are medians.",
        "",
        *(f"- **{c.header}**: {c.meaning}" for c in shown),
    ]
    if failures:
        lines += ["", "Not read:", "", *(f"- `{f.sequence}`: {f.problem}" for f in failures)]
    return "\n".join(lines) + "\n"


def _column(name: str, header: str, group: str, show: Callable[[Any], str], meaning: str) -> Column:
    value = attrgetter(name)

    def text(row: Row) -> str:
        held = value(row)
        return "–" if held is None else show(held)

    justify: Literal["left", "right"] = "left" if show is str else "right"
    return Column(name, header, meaning, value, text, justify, group, name in _MINOR)


def _light(light: str, group: str) -> Column:
    def value(row: Row) -> float | None:
        return dict(row.success_by_light).get(light)

    def text(row: Row) -> str:
        share = value(row)
        return "–" if share is None else _percent(share)

    meaning = f"Share within 1 DoF under the light {light}."
    return Column(f"success_1dof_{light}", light, meaning, value, text, group=group)


def _rank(row: Row) -> str:
    return "–" if row.rank is None else f"{row.rank}{'=' if row.tied else ''}"


def _percent(share: float) -> str:
    return f"{share:.0%}"


def _count(number: int) -> str:
    return str(number) if number else "–"


def _fixed(digits: int) -> Callable[[float], str]:
    return lambda number: f"{number:.{digits}f}"
