"""Ranking of all submissions in a folder; those that answered the same sequences share a table.

No code of a submission is run.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from saf_gen.benchmark.records import RECORDS_FILE, Record, read_records
from saf_gen.core.finding import Finding
from saf_gen.errors import BadInput
from saf_gen.leaderboard.merging import describe_ranked_data
from saf_gen.leaderboard.rows import LeaderboardRow, rank_methods
from saf_gen.leaderboard.submission.card import CARD_FILE, SubmissionCard, read_submission
from saf_gen.leaderboard.submission.checks import EVALUATION, check_submission, select_records_of_submission
from saf_gen.leaderboard.verification import CLAIMED, read_leaderboard_row_states

NO_ANSWERS = "no answers"


@dataclass(frozen=True)
class ListedSubmission:
    """A submission with its findings and answers.

    Attributes
    ----------
    name : str
        Name of its folder.
    card : SubmissionCard
        Its card.
    findings : tuple of Finding
        Findings of the checks.
    state : str
        ``re-run here``, ``re-run elsewhere``, ``differs`` or ``claimed``, or ``no answers`` if no answers can be read.
    records : tuple of Record
        Its answers, with the name of the folder as the method.
    """

    name: str
    card: SubmissionCard
    findings: tuple[Finding, ...]
    state: str
    records: tuple[Record, ...]

    @property
    def to_do(self) -> list[str]:
        """Errors that the checks found, each with the name of the check."""
        return [f"{finding.check}: {finding.text}" for finding in self.findings if finding.level == "error"]


@dataclass(frozen=True)
class SubmissionTable:
    """Submissions that can be compared, best first; ``rows`` and ``submissions`` have the same order."""

    dataset: str
    track: str
    sequences: int
    scenes: int
    rows: tuple[LeaderboardRow, ...]
    submissions: tuple[ListedSubmission, ...]


@dataclass(frozen=True)
class SubmissionList:
    """The tables, the submissions without answers, and the folders whose cards cannot be read, with the reasons."""

    tables: tuple[SubmissionTable, ...]
    unanswered: tuple[ListedSubmission, ...]
    problems: tuple[tuple[str, str], ...]

    @property
    def submissions(self) -> tuple[ListedSubmission, ...]:
        """Every submission, in the order of the tables."""
        return (*(one for table in self.tables for one in table.submissions), *self.unanswered)


def list_submissions(folder: Path) -> SubmissionList:
    """Read and rank the submissions in the subfolders of a folder.

    Raises BadInput if no subfolder holds a submission.
    """
    found, problems = [], []
    for path in sorted(folder.iterdir()) if folder.is_dir() else ():
        if (path / CARD_FILE).is_file():
            try:
                found.append(_read(path))
            except BadInput as error:
                problems.append((path.name, str(error)))
    if not found and not problems:
        raise BadInput(
            f"{folder} holds no submission",
            allowed=f"folders with a {CARD_FILE}",
            hint="saf-gen submit new FOLDER/NAME",
        )
    groups: dict[object, list[ListedSubmission]] = {}
    for submission in found:
        if submission.records:
            groups.setdefault(describe_ranked_data(submission.records), []).append(submission)
    tables = sorted((_tabulate(group) for group in groups.values()), key=lambda t: (t.dataset, t.track, -len(t.rows)))
    return SubmissionList(tuple(tables), tuple(one for one in found if not one.records), tuple(problems))


def _read(folder: Path) -> ListedSubmission:
    card = read_submission(folder)
    findings = tuple(check_submission(folder))
    state, own = NO_ANSWERS, []
    if (folder / EVALUATION / RECORDS_FILE).is_file():
        try:
            every = read_records(folder / EVALUATION)
            own = select_records_of_submission(every, card)
            states = read_leaderboard_row_states(folder / EVALUATION, every)
            state = states.get(own[0].method, CLAIMED) if own else NO_ANSWERS
        except BadInput:
            own, state = [], NO_ANSWERS  # the findings name the reason
    records = tuple(replace(record, method=folder.name) for record in own)
    return ListedSubmission(folder.name, card, findings, state, records)


def _tabulate(group: Sequence[ListedSubmission]) -> SubmissionTable:
    by_name = {submission.name: submission for submission in group}
    rows = rank_methods([record for submission in group for record in submission.records])
    records = group[0].records
    return SubmissionTable(
        group[0].card.dataset,
        records[0].track,
        len({record.sequence for record in records}),
        len({record.scene for record in records}),
        tuple(replace(row, verified=by_name[row.method].state) for row in rows),
        tuple(by_name[row.method] for row in rows),
    )
