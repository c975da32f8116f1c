"""The page: one HTML file with its styles, script and pictures, which asks the network for nothing."""

import base64
import hashlib
from collections.abc import Sequence
from importlib.resources import files
from string import Template

from saf_gen import __version__
from saf_gen.contest.results import Failure, Sweep
from saf_gen.figures import inlined
from saf_gen.leaderboard import Row, by_axis, columns, notes
from saf_gen.records import Record
from saf_gen.report import board
from saf_gen.report._html import code, embedded, escaped
from saf_gen.report.answers import answers, counted
from saf_gen.report.captions import KINDS, MEASURES
from saf_gen.report.facts import STEPS
from saf_gen.report.pictures import Picture
from saf_gen.report.recount import brief
from saf_gen.report.reel import plot_markup, reel_markup

__all__ = ["page"]

SCRIPTS = ("tables.js", "board.js", "answers.js", "reels.js")


def page(
    rows: Sequence[Row],
    *,
    title: str,
    records: Sequence[Record],
    sweeps: Sequence[Sweep] = (),
    failures: Sequence[Failure] = (),
    pictures: Sequence[Picture] = (),
) -> str:
    """The page as HTML, readable without its script."""
    data, methods = {r.sequence: r.data for r in records}, {r.method: _code(r) for r in records}
    script = "\n".join(_asset(name) for name in SCRIPTS)
    scenes = list(dict.fromkeys(p.scene for p in pictures if p.scene))
    ids = {scene: f"scene-{number}" for number, scene in enumerate(scenes, start=1)}
    conditions = board.axis_tables(by_axis(records, [row.method for row in rows]))
    against = _figures([p for p in pictures if not p.scene])
    measures = board.measures(sweeps)
    sections = [
        ("conditions", "By condition", f"{_said(conditions, 'columns')}{against}"),
        ("measures", "Curves of the measures", measures and f"<p>{MEASURES}</p>{measures}"),
    ]
    sections += [(ids[s], s, _figures([p for p in pictures if p.scene == s])) for s in scenes]
    sections = [section for section in sections if section[2]]
    links = [("leaderboard", "Leaderboard"), *((i, name) for i, name, _ in sections)]
    links += [("columns", "What the columns mean"), ("data", "Data")]
    return Template(_asset("page.html")).substitute(
        title=escaped(title),
        hash=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
        style=_asset("page.css"),
        script=script,
        data=embedded(brief(rows, records)),
        summary=escaped(_summary(rows, records)),
        lead=board.lead(rows),
        failures=_failures(failures),
        links="".join(f'<a href="#{i}">{escaped(name)}</a>' for i, name in links),
        board=board.board(rows) if rows else "",
        notes=escaped(" ".join(notes(rows, records))) if rows else "",
        steps=STEPS,
        counted=escaped(counted(len(records))),
        answers=answers(records),
        sections="\n".join(
            f'<section id="{i}"><h2>{escaped(name)}</h2>{body}</section>' for i, name, body in sections
        ),
        meanings=board.meanings(columns(rows)),
        sequences=board.digests(data, "sequence", "content_sha256"),
        methods=board.digests(methods, "method", "code"),
        version=escaped(__version__),
    )


def _code(record: Record) -> str:
    return f"{record.code}, constants of {record.tuning}" if record.tuning else record.code


def _asset(name: str) -> str:
    return (files("saf_gen.report") / "assets" / name).read_text(encoding="utf-8")


def _summary(rows: Sequence[Row], records: Sequence[Record]) -> str:
    places, sequences = len({r.scene for r in records}), len({r.sequence for r in records})
    tracks = {"recorded": "recorded sweeps", "closed_loop": "closed loop"}
    said = [
        f"{len(rows)} methods on {sequences} sequences of {places} {'scene' if places == 1 else 'scenes'}"
    ]
    said += sorted({tracks[r.track] + (f" ({r.terms})" if r.terms else "") for r in records})
    said += [f"region {name}" for name in sorted({r.region for r in records})]
    return ", ".join(said)


def _failures(failures: Sequence[Failure]) -> str:
    if not failures:
        return ""
    lines = "".join(f"<li>{code(f.sequence)}: {escaped(f.problem)}</li>" for f in failures)
    return f'<div class="failures"><strong>Not read, and not in the table:</strong><ul>{lines}</ul></div>'


def _figures(pictures: Sequence[Picture]) -> str:
    """Kind by kind: a heading, what it shows, the figures beside each other."""
    parts = []
    for kind in (k for k in KINDS if any(p.kind == k for p in pictures)):
        heading, caption = KINDS[kind]
        mine = [p for p in pictures if p.kind == kind]
        said = " ".join([caption, *dict.fromkeys(p.beside for p in mine if p.beside)])
        figures = "".join(map(_figure, mine))
        parts.append(f'<h3>{escaped(heading)}</h3><p class="soft">{escaped(said)}</p>')
        parts.append(f'<div class="figures">{figures}</div>')
    return "".join(parts)


def _figure(picture: Picture) -> str:
    plot = plot_markup(inlined(picture.svg, label=escaped(picture.label)), picture.reel)
    reel = "" if picture.reel is None else reel_markup(picture.reel, name=picture.name)
    return f'<figure id="{escaped(picture.name)}">{reel}{plot}</figure>'


def _said(text: str, kind: str) -> str:
    return f'<div class="{kind}">{text}</div>' if text else ""
