"""The page of all submissions, as HTML and Markdown: rankings, cards, and whether answers were reproduced."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote, urlsplit

from saf_gen import __version__
from saf_gen.core.files import write_text
from saf_gen.core.plain_text import escape_all_text, escape_markdown
from saf_gen.errors import escape_controls
from saf_gen.leaderboard.columns import ESSENTIAL, Column, list_shown_leaderboard_columns
from saf_gen.leaderboard.report.page_tables import PageCell, PageColumn, PageRow, PageTable
from saf_gen.leaderboard.report.page_templates import hash_report_script, load_report_templates, read_report_asset
from saf_gen.leaderboard.rows import LeaderboardRow
from saf_gen.leaderboard.submission import ListedSubmission, SubmissionList, SubmissionTable
from saf_gen.leaderboard.submission.card import CARD_FILE, SubmissionCard
from saf_gen.leaderboard.table_formats import format_leaderboard_count, format_ranking_grid

PAGE, MARKDOWN = "index.html", "submissions.md"
STATE_MEANINGS = {
    "re-run here": "this user ran the method again on this machine, and it gave every answer again",
    "re-run elsewhere": "a verification from another machine or user says that the method gave every answer again",
    "differs": "the method was run again, and at least one answer was different",
    "claimed": "nobody has run the method again, another program made the answers, or they changed after a re-run",
    "no answers": "no answers can be read",
}


@dataclass(frozen=True)
class SubmissionCardOnPage:
    """The part of the page about one submission."""

    id: str
    name: str
    title: str
    facts: Sequence[tuple[str, str]]
    card: str
    """Address of its card, relative to the page."""
    url: str
    """Web address that the card names; '' if there is none or it is not safe to follow."""
    state: str
    to_do: Sequence[str]


def write_submissions_page(folder: Path, listed: SubmissionList, *, source: Path) -> list[Path]:
    """Write ``index.html`` and ``submissions.md`` into ``folder`` and return their paths.

    ``source`` is the folder of the submissions; the pages link to their cards. Raises BadInput if a file cannot be
    written.
    """
    addresses = {one.name: _link(folder, source / one.name / CARD_FILE) for one in listed.submissions}
    texts = {
        PAGE: _build_page(listed, title=source.resolve().name, addresses=addresses),
        MARKDOWN: _format_markdown(listed, title=source.resolve().name, addresses=addresses),
    }
    for name, text in texts.items():
        write_text(folder / name, text)
    return [folder / name for name in texts]


def _link(folder: Path, file: Path) -> str:
    """Return the address of a file relative to a page in ``folder``."""
    path = Path(os.path.relpath(file.resolve(), folder.resolve()))
    return quote(path.as_posix(), errors="surrogateescape")


def _build_page(listed: SubmissionList, *, title: str, addresses: dict[str, str]) -> str:
    script = read_report_asset("tables.js")
    cards = [
        _describe(submission, number=number, address=addresses[submission.name])
        for number, submission in enumerate(listed.submissions, start=1)
    ]
    ids = {submission.name: card.id for submission, card in zip(listed.submissions, cards, strict=True)}
    states = {submission.state for submission in listed.submissions}
    return (
        load_report_templates()
        .get_template("submissions.html")
        .render(
            title=escape_controls(title),
            summary=_summarise(listed),
            script=script,
            script_hash=hash_report_script(script),
            style=read_report_asset("page.css"),
            tables=[(_head(table), _tabulate(table, ids)) for table in listed.tables],
            cards=cards,
            problems=escape_all_text(listed.problems),
            meanings=[(state, meaning) for state, meaning in STATE_MEANINGS.items() if state in states],
            version=__version__,
        )
    )


def _summarise(listed: SubmissionList) -> str:
    """Return the number of submissions, and of those in each state, as text."""
    states = [one.state for one in listed.submissions]
    counted = [f"{states.count(state)} {state}" for state in STATE_MEANINGS if state in states]
    return f"{format_leaderboard_count(len(states), 'submission')}: {', '.join(counted)}" if states else "none"


def _head(table: SubmissionTable) -> str:
    track = {"recorded": "recorded sweeps", "closed_loop": "closed loop"}[table.track]
    sequences = format_leaderboard_count(table.sequences, "sequence")
    scenes = format_leaderboard_count(table.scenes, "scene")
    return escape_controls(f"{table.dataset}, {track}: {sequences} of {scenes}")


def _list_columns(table: SubmissionTable) -> list[Column]:
    """Return the leaderboard columns of a table of submissions: rank, success within 1 DoF, then others."""
    shown = list_shown_leaderboard_columns(table.rows)
    return [c for c in shown if (c.detail == ESSENTIAL and c.key != "method") or c.key == "time_to_focus_s"]


def _tabulate(table: SubmissionTable, ids: dict[str, str]) -> PageTable:
    """Return a table of submissions, the most important columns first, with links from names to their cards."""
    rank, success, *others = _list_columns(table)
    return PageTable(
        _head(table),
        [
            PageColumn(rank.header, rank.meaning),
            PageColumn("submission", kind="name"),
            PageColumn(success.header, success.meaning, "main"),
            PageColumn("row", "Whether a repeated run gave the same answers.", "text"),
            PageColumn("date", "Date of the submission, as stated in its card.", "text"),
            *(PageColumn(column.header, column.meaning) for column in others),
            *(PageColumn(name, kind="note") for name in ("title", "authors", "licence", "constants")),
        ],
        [
            [
                PageRow(
                    [
                        PageCell(rank.format_value(row)),
                        PageCell(escape_controls(one.name), link=f"#{ids[one.name]}"),
                        _make_success_cell(row, success),
                        *(PageCell(escape_controls(text or "–")) for text in (one.state, one.card.date)),
                        *(PageCell(column.format_value(row)) for column in others),
                        *(PageCell(escape_controls(text or "–")) for text in _list_statements(one.card)),
                    ],
                    "first" if row.rank == 1 else "level" if row.level_with_best else "",
                )
                for row, one in zip(table.rows, table.submissions, strict=True)
            ]
        ],
    )


def _make_success_cell(row: LeaderboardRow, column: Column) -> PageCell:
    low, high = row.success_1dof_low, row.success_1dof_high
    return PageCell(column.format_value(row), row.success_1dof, None if low is None or high is None else (low, high))


def _list_statements(card: SubmissionCard) -> tuple[str, ...]:
    return card.title, ", ".join(card.authors), card.licence, card.constants


def _describe(submission: ListedSubmission, *, number: int, address: str) -> SubmissionCardOnPage:
    card = submission.card
    found = {finding.check: finding.text for finding in submission.findings if finding.level == "ok"}
    facts = {
        "authors": ", ".join(card.authors),
        "date": card.date,
        "licence": card.licence,
        "dataset": f"{card.dataset}, split test, {card.track.replace('_', ' ')}",
        "method": card.method or (f"answers of another program: {card.predictions}" if card.predictions else ""),
        "constants": f"{card.constants}: {found.get('constants', 'see below')}" if card.constants else "none tuned",
        "answers": _count_answers(submission),
    }
    plain = [(key, escape_controls(text or "not stated")) for key, text in facts.items()]
    return SubmissionCardOnPage(
        f"submission-{number}",
        escape_controls(submission.name),
        escape_controls(card.title or "without a title"),
        plain,
        address,
        card.url if _is_of_web(card.url) else "",
        submission.state,
        [escape_controls(text) for text in submission.to_do],
    )


def _count_answers(submission: ListedSubmission) -> str:
    answered = sum(record.status == "answered" for record in submission.records)
    sequences = format_leaderboard_count(len(submission.records), "sequence")
    return f"to {answered} of {sequences}" if submission.records else "none that can be read"


def _is_of_web(url: str) -> bool:
    """Return whether an untrusted address is safe to follow: http or https, without control characters."""
    try:
        parts = urlsplit(url)
    except ValueError:
        return False
    return parts.scheme in ("http", "https") and bool(parts.netloc) and escape_controls(url) == url


def _format_markdown(listed: SubmissionList, *, title: str, addresses: dict[str, str]) -> str:
    parts = [f"# Submissions: {escape_markdown(title)}\n", f"{_summarise(listed)}.\n"]
    for table in listed.tables:
        parts += [f"## {escape_markdown(_head(table))}\n", _format_table(table, addresses)]
    if listed.unanswered:
        rows = [_format_facts(one, addresses) for one in listed.unanswered]
        headers = ["submission", "title", "authors", "date", "licence", "constants", "row", "to do"]
        parts += ["## Without answers\n", format_ranking_grid(headers, rows, is_left=[True] * len(headers))]
    if listed.problems:
        lines = (f"- {escape_markdown(name)}: {escape_markdown(problem)}\n" for name, problem in listed.problems)
        parts += ["## Not shown\n", "".join(lines)]
    meanings = (f"- *{state}*: {meaning}\n" for state, meaning in STATE_MEANINGS.items())
    return "\n".join([*parts, "## Rows\n", "".join(meanings)])


def _format_table(table: SubmissionTable, addresses: dict[str, str]) -> str:
    rank, *others = _list_columns(table)
    headers = [rank.header, "submission", "title", "authors", "date", "licence"]
    headers += [*(column.header for column in others), "constants", "row", "to do"]
    body = []
    for row, one in zip(table.rows, table.submissions, strict=True):
        name, title, authors, date, licence, *end = _format_facts(one, addresses)
        scores = [escape_markdown(column.format_value(row)) for column in others]
        body.append([escape_markdown(rank.format_value(row)), name, title, authors, date, licence, *scores, *end])
    left = {"submission", "title", "authors", "date", "licence", "constants", "row", "to do"}
    return format_ranking_grid(list(map(escape_markdown, headers)), body, is_left=[h in left for h in headers])


def _format_facts(one: ListedSubmission, addresses: dict[str, str]) -> list[str]:
    """Return the Markdown cells of a submission: its name as a link, its card, and the number of its errors."""
    card = one.card
    facts = (card.title, ", ".join(card.authors), card.date, card.licence, card.constants, one.state)
    to_do = str(len(one.to_do)) if one.to_do else ""
    return [
        f"[{escape_markdown(one.name)}]({addresses[one.name]})",
        *(escape_markdown(text) or "–" for text in (*facts, to_do)),
    ]
