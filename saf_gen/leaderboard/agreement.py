"""The answer of a recording without a truth: where most focus measures agree.

A score that grows with the light has its peak where the lamp is brightest, so only measures whose score does not are
asked. Each has one vote, whatever the number of searches with it: the answer of ``argmax``, which looks at the whole
recording, or else of its first method that answered. The answer of all is the vote with the most votes near it, and not
the median, which lies between two depths where nothing is sharp.

The share of the votes near the answer says how far to trust it. Of 440 recordings of saf_bench whose lens comes to the
focus, it was at least 90 % on 175, of whose answers 86 % are within one depth of focus; 70 to 90 % on 131 (70 % right),
50 to 70 % on 113 (42 %), and below on 21 (24 %). Of 40 whose lens does not, it was 70 % on none.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from shlex import quote

from saf_gen.benchmark.method_spec import measure_and_search, split_options
from saf_gen.benchmark.records import Record, read_records
from saf_gen.core.config.registry import FORM_SUFFIXES, is_builtin_name
from saf_gen.core.plain_text import plural
from saf_gen.core.table import percent
from saf_gen.errors import BadInput, some_of
from saf_gen.leaderboard.ranking import group_by
from saf_gen.plugins.measures import get_measure

EVALUATION = "evaluation"
"""Name of the folder of an evaluation, in that of the dataset, or after the name of a recording."""
NEAR = 0.04
"""Distance within which votes agree, as a fraction of the travel, or of the frames where the lens is unknown."""
FAR = 0.15
"""Distance of the truth from where measures agree, as a fraction of the travel, beyond which one of them is doubted."""
MIN_SHARE = 0.7
"""Share of the votes below which the measures disagree."""
MIN_VOTES = 3
"""Smallest number of measures of which an agreement means anything."""
_ARGMAX = re.compile(r"argmax(?![^:@])")


@dataclass(frozen=True)
class Place:
    """A place in a recording, and the measures whose votes are near it."""

    frame: float
    position: float | None
    """Position of the lens, as a fraction of the travel; None if it is unknown."""
    measures: tuple[str, ...]

    def __str__(self) -> str:
        return f"frame {self.frame:,.0f}" + ("" if self.position is None else f", position {self.position:.3f}")


@dataclass(frozen=True)
class Agreement:
    """The answer of all measures on one recording without a truth."""

    sequence: str
    asked: tuple[str, ...]
    """Measures that have a vote, whether they answered or not."""
    places: tuple[Place, ...]
    """The answer; where the measures disagree, also the place that most of the others chose. Empty if there is none."""

    @property
    def share(self) -> float:
        """Share of the votes that are near the answer."""
        return len(self.places[0].measures) / len(self.asked) if self.places else 0.0

    @property
    def agrees(self) -> bool:
        """Whether so many votes are near the answer that it can be trusted."""
        return self.share >= MIN_SHARE

    def describe(self) -> str:
        """Return the answer in one or two sentences."""
        if not self.places:
            return f"No answer: none of {plural(len(self.asked), 'measure')} found a focus in {self.sequence}."
        first, *others = self.places
        votes = f"{len(first.measures)} of {plural(len(self.asked), 'measure')}"
        if self.agrees:
            agreeing = f"{votes} agree ({percent(self.share)}): {some_of(first.measures)}"
            return f"{self.sequence} is sharpest at {first}: {agreeing}."
        rest = f", {len(others[0].measures)} on {others[0]}" if others else ""
        return (
            f"The measures disagree on {self.sequence}: {votes} ({percent(self.share)}) agree on {first}{rest}. The "
            "light leads some of them, or the scene has several depths."
        )


def find_agreements(records: Iterable[Record]) -> list[Agreement]:
    """Return the agreement on each recording without a truth for which enough measures have a vote."""
    by_sequence = group_by(filter(lacks_truth, records), "what.sequence")
    return [one for one in map(agree, by_sequence.values()) if len(one.asked) >= MIN_VOTES]


def lacks_truth(record: Record) -> bool:
    """Return whether a record is of a recording whose true focus nobody stated."""
    return record.what.track == "recorded" and record.judgement.truth is None


def contradicts_truth(records: Sequence[Record]) -> list[str]:
    """Return a sentence, in a list, if the measures agree on a place far from the stated truth of a recording."""
    judgement = records[0].judgement
    if judgement.truth is None or records[0].what.track != "recorded":
        return []
    answer = agree(records)
    place = answer.places[0] if len(answer.asked) >= MIN_VOTES and answer.agrees else None
    if place is None or place.position is None or abs(place.position - judgement.truth) <= FAR:
        return []
    return [
        f"The stated focus, {judgement.truth:.3f}, is far from position {place.position:.3f}, where "
        f"{len(place.measures)} of {plural(len(answer.asked), 'measure')} agree. Compare both: saf-gen view RECORDING "
        "--at truth, and --at answer. If the second is sharp, the log of the lens may be reversed."
    ]


def follows_light(measure: str) -> bool:
    """Return whether a measure is part of saf_gen, and its score grows with the light."""
    return _is_builtin(measure) and get_measure(split_options(measure)[0]).degree > 0


def read_agreement(recording: Path, content_sha256: str) -> Agreement:
    """Return the agreement on a recording from the evaluation beside it: its own, or that of its dataset.

    Raises BadInput if there is none with records of this content, or if no answer follows from them.
    """
    folders = [recording.with_name(f"{recording.stem}-{EVALUATION}")]
    folders += [folder / EVALUATION for folder in recording.absolute().parents[:2]]
    there = [folder for folder in folders if folder.is_dir()]
    for folder in there:
        if records := [r for r in read_records(folder) if r.what.data == content_sha256 and r.what.track == "recorded"]:
            agreement = agree(records)
            if len(agreement.asked) < MIN_VOTES:
                problem = f"{plural(len(agreement.asked), 'measure')} of saf_gen that follow no light have answers"
                raise BadInput(problem, where=str(folder), allowed=f"{MIN_VOTES} and more", hint="add -m baselines")
            if not agreement.places:
                raise BadInput(agreement.describe().rstrip("."), where=str(folder))
            return agreement
    problem = f"{there[0]} is of another content" if there else f"no evaluation of {recording} lies beside it"
    raise BadInput(problem, hint=f"run saf-gen evaluate {quote(str(recording))}")


def agree(records: Sequence[Record]) -> Agreement:
    """Return the agreement of the measures on one recording, from the records of all methods on it."""
    votes = _collect_votes(records)
    known = {} if records[0].what.obstacle else {name: vote for name, vote in votes.items() if vote is not None}
    places = [_densest_place(known)] if known else []
    first = Agreement(records[0].what.sequence, tuple(votes), tuple(places))
    others = {name: vote for name, vote in known.items() if name not in places[0].measures}
    return first if first.agrees or not others else replace(first, places=(*places, _densest_place(others)))


def _collect_votes(records: Sequence[Record]) -> dict[str, Record | None]:
    """Return the record by which each measure votes, None for a measure that gave no answer."""
    votes: dict[str, Record | None] = {}
    for record in sorted(records, key=lambda r: not _ARGMAX.match(measure_and_search(r.who.method)[1])):
        measure = measure_and_search(record.who.method)[0]
        if (measure in votes or (_is_builtin(measure) and not follows_light(measure))) and votes.get(measure) is None:
            votes[measure] = record if record.judgement.frame is not None else None
    return votes


def _is_builtin(measure: str) -> bool:
    """Return whether a measure is part of saf_gen; a record must not decide whose code is run."""
    bare = split_options(measure)[0]
    while bare.endswith(FORM_SUFFIXES) and not is_builtin_name("measures", bare):
        bare = bare[: bare.rindex("_")]
    return is_builtin_name("measures", bare)


def _densest_place(votes: Mapping[str, Record]) -> Place:
    """Return the vote that has the most votes near it and, of several, the one with the nearest."""
    at = {name: _coordinate(record) for name, record in votes.items()}
    near = {name: [other for other in at if abs(at[other] - at[name]) <= NEAR] for name in at}
    best = min(near, key=lambda name: (-len(near[name]), sum(abs(at[other] - at[name]) for other in near[name])))
    judgement = votes[best].judgement
    return Place(judgement.frame or 0.0, judgement.position, tuple(near[best]))


def _coordinate(record: Record) -> float:
    position, frame = record.judgement.position, record.judgement.frame or 0.0
    return frame / record.what.frames if position is None else position
