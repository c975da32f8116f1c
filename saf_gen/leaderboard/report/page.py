"""The page: one HTML file with its styles, script and pictures, which asks the network for nothing."""

import base64
import hashlib
from collections.abc import Sequence
from importlib.resources import files
from string import Template

from saf_gen import __version__
from saf_gen.benchmark.records import Record
from saf_gen.benchmark.results import SequenceFailure, SweepSummary
from saf_gen.leaderboard import LeaderboardRow, compose_notes, list_shown_columns, tabulate_by_axis
from saf_gen.leaderboard.figures import inline_svg
from saf_gen.leaderboard.report import html_tables
from saf_gen.leaderboard.report._html import embed_json, escape_html, format_code
from saf_gen.leaderboard.report.captions import FIGURE_CAPTIONS, MEASURES_CAPTION
from saf_gen.leaderboard.report.choose_figures import ReportFigure
from saf_gen.leaderboard.report.compact_records import MAX_TRACE_STEPS
from saf_gen.leaderboard.report.page_data import build_page_data
from saf_gen.leaderboard.report.sequence_viewer import format_plot, format_viewer
from saf_gen.leaderboard.report.worst_answers import describe_answer_count, format_answers

__all__ = ["build_page"]

SCRIPTS = ("tables.js", "board.js", "answers.js", "reels.js")


def build_page(
    rows: Sequence[LeaderboardRow],
    *,
    title: str,
    records: Sequence[Record],
    sweeps: Sequence[SweepSummary] = (),
    failures: Sequence[SequenceFailure] = (),
    report_figures: Sequence[ReportFigure] = (),
) -> str:
    """The page as HTML, readable without its script."""
    data, methods = {r.sequence: r.data for r in records}, {r.method: _code(r) for r in records}
    script = "\n".join(_asset(name) for name in SCRIPTS)
    scenes = list(dict.fromkeys(p.scene for p in report_figures if p.scene))
    ids = {scene: f"scene-{number}" for number, scene in enumerate(scenes, start=1)}
    conditions = html_tables.format_axis_tables(tabulate_by_axis(records, [row.method for row in rows]))
    against = _figures([p for p in report_figures if not p.scene])
    measures = html_tables.format_measure_table(sweeps)
    sections = [
        ("conditions", "By condition", f"{_said(conditions, 'columns')}{against}"),
        ("measures", "Curves of the measures", measures and f"<p>{MEASURES_CAPTION}</p>{measures}"),
    ]
    sections += [(ids[s], s, _figures([p for p in report_figures if p.scene == s])) for s in scenes]
    sections = [section for section in sections if section[2]]
    links = [("leaderboard", "Leaderboard"), *((i, name) for i, name, _ in sections)]
    links += [("columns", "What the columns mean"), ("data", "Data")]
    return Template(_asset("page.html")).substitute(
        title=escape_html(title),
        hash=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
        style=_asset("page.css"),
        script=script,
        data=embed_json(build_page_data(rows, records)),
        summary=escape_html(_summary(rows, records)),
        lead=html_tables.compose_headline(rows),
        failures=_failures(failures),
        links="".join(f'<a href="#{i}">{escape_html(name)}</a>' for i, name in links),
        board=html_tables.format_leaderboard(rows) if rows else "",
        notes=escape_html(" ".join(compose_notes(rows, records))) if rows else "",
        steps=MAX_TRACE_STEPS,
        counted=escape_html(describe_answer_count(len(records))),
        answers=format_answers(records),
        sections="\n".join(
            f'<section id="{i}"><h2>{escape_html(name)}</h2>{body}</section>' for i, name, body in sections
        ),
        meanings=html_tables.format_column_meanings(list_shown_columns(rows)),
        sequences=html_tables.format_digest_table(data, "sequence", "content_sha256"),
        methods=html_tables.format_digest_table(methods, "method", "code"),
        version=escape_html(__version__),
    )


def _code(record: Record) -> str:
    return f"{record.code}, constants of {record.tuning}" if record.tuning else record.code


def _asset(name: str) -> str:
    return (files("saf_gen.leaderboard.report") / "assets" / name).read_text(encoding="utf-8")


def _summary(rows: Sequence[LeaderboardRow], records: Sequence[Record]) -> str:
    places, sequences = len({r.scene for r in records}), len({r.sequence for r in records})
    tracks = {"recorded": "recorded sweeps", "closed_loop": "closed loop"}
    said = [
        f"{len(rows)} methods on {sequences} sequences of {places} {'scene' if places == 1 else 'scenes'}"
    ]
    said += sorted({tracks[r.track] + (f" ({r.terms})" if r.terms else "") for r in records})
    said += [f"region {name}" for name in sorted({r.region for r in records})]
    return ", ".join(said)


def _failures(failures: Sequence[SequenceFailure]) -> str:
    if not failures:
        return ""
    lines = "".join(f"<li>{format_code(f.sequence)}: {escape_html(f.problem)}</li>" for f in failures)
    return f'<div class="failures"><strong>Not read, and not in the table:</strong><ul>{lines}</ul></div>'


def _figures(report_figures: Sequence[ReportFigure]) -> str:
    """Kind by kind: a heading, what it shows, the figures beside each other."""
    parts = []
    for kind in (k for k in FIGURE_CAPTIONS if any(p.kind == k for p in report_figures)):
        heading, caption = FIGURE_CAPTIONS[kind]
        mine = [p for p in report_figures if p.kind == kind]
        said = " ".join([caption, *dict.fromkeys(p.omission for p in mine if p.omission)])
        figures = "".join(map(_figure, mine))
        parts.append(f'<h3>{escape_html(heading)}</h3><p class="soft">{escape_html(said)}</p>')
        parts.append(f'<div class="figures">{figures}</div>')
    return "".join(parts)


def _figure(picture: ReportFigure) -> str:
    plot = format_plot(inline_svg(picture.svg, label=escape_html(picture.label)), picture.viewer)
    viewer = "" if picture.viewer is None else format_viewer(picture.viewer, name=picture.name)
    return f'<figure id="{escape_html(picture.name)}">{viewer}{plot}</figure>'


def _said(text: str, kind: str) -> str:
    return f'<div class="{kind}">{text}</div>' if text else ""
