"""Ranking of methods by their answers on SAF's recordings, and its agreement with rankings on other data."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from saf_gen.benchmark.records import Record
from saf_gen.leaderboard.averages import mean_by_scene_for_ranking
from saf_gen.leaderboard.rank_agreement import RankAgreement, compare_ranked_scores

THEIRS, OURS = "SAF's protocol", "ours, same recordings"


@dataclass(frozen=True)
class SafAnswer:
    """The answer of a method on a recording, with frames counted from 1 as SAF's programs do; None for no answer."""

    method: str
    recording: str
    scene: str
    frames: int
    block: int
    truth: int
    printed: float | None
    blocks: int | None
    """Number of blocks between the answer and the truth, as the code of CEN (ICML 2026) counts them."""
    own: float | None
    """Answer by our protocol: the centre of a window, counted from 1; the search keeps its own options."""

    @property
    def error(self) -> float | None:
        """Printed frame minus the frame chosen by hand; None for no answer."""
        return None if self.printed is None else self.printed - self.truth

    @property
    def own_error(self) -> float | None:
        """Answer by our protocol minus the frame chosen by hand; None for no answer."""
        return None if self.own is None else self.own - self.truth

    def find_fraction_off(self, error: float | None) -> float:
        """Return an error in frames as a fraction of the recording, 0 to 1; None counts as the largest error."""
        off = max(self.truth - 1, self.frames - self.truth) if error is None else abs(error)
        return off / self.frames


@dataclass(frozen=True)
class SafRow:
    """Result of one method on all recordings.

    Attributes
    ----------
    rank, own_rank : int
        Rank by ``off``, under SAF's protocol, and by ``own_off``, under ours; 1 is the best.
    method : str
        Name of the method.
    off, own_off : float
        Mean absolute error over scenes, as a fraction of the recording, under SAF's protocol and under ours. A missing
        answer counts as the largest possible error.
    error_frames, own_error_frames : float or None
        Median absolute error of the answers, in frames; None if there is no answer.
    error_blocks : float or None
        Mean error of the answers in blocks, as the code of CEN computes it; None if there is no answer.
    within_block : float
        Fraction of recordings, 0 to 1, whose answer under SAF's protocol is at most one block from the truth.
    unanswered : int
        Number of recordings without an answer under SAF's protocol.
    beside : tuple of (float or None)
        Success within 1 depth of focus in each evaluation of other data; None if the evaluation lacks the method.
    """

    rank: int
    method: str
    off: float
    error_frames: float | None
    error_blocks: float | None
    within_block: float
    unanswered: int
    own_rank: int
    own_off: float
    own_error_frames: float | None
    beside: tuple[float | None, ...]


def rank_saf_answers(answers: Sequence[SafAnswer], runs: Mapping[str, Sequence[Record]]) -> tuple[SafRow, ...]:
    by_method: dict[str, list[SafAnswer]] = {}
    for answer in answers:
        by_method.setdefault(answer.method, []).append(answer)
    success = [_score_run(records) for records in runs.values()]
    rows = []
    for method, own in by_method.items():
        errors = [a.error for a in own if a.error is not None]
        blocks = [a.blocks for a in own if a.blocks is not None]
        own_errors = [a.own_error for a in own if a.own_error is not None]
        rows.append(
            SafRow(
                0,
                method,
                float(np.mean(list(_mean_by_scene(own, lambda a: a.find_fraction_off(a.error)).values()))),
                float(np.median(np.abs(errors))) if errors else None,
                float(np.mean(blocks)) if blocks else None,
                float(np.mean([a.error is not None and abs(a.error) <= a.block for a in own])),
                len(own) - len(errors),
                0,
                float(np.mean(list(_mean_by_scene(own, lambda a: a.find_fraction_off(a.own_error)).values()))),
                float(np.median(np.abs(own_errors))) if own_errors else None,
                tuple(_mean_of_scenes(scores, method) for scores in success),
            )
        )
    ranked = [
        replace(
            row,
            rank=1 + sum(other.off < row.off - 1e-9 for other in rows),
            own_rank=1 + sum(other.own_off < row.own_off - 1e-9 for other in rows),
        )
        for row in rows
    ]
    return tuple(sorted(ranked, key=lambda row: (row.rank, row.method)))


def _mean_by_scene(answers: Sequence[SafAnswer], value: Callable[[SafAnswer], float]) -> dict[str, float]:
    scenes: dict[str, list[float]] = {}
    for answer in answers:
        scenes.setdefault(answer.scene, []).append(value(answer))
    return {scene: float(np.mean(numbers)) for scene, numbers in scenes.items()}


def _mean_of_scenes(scores: Mapping[str, Mapping[str, float]], method: str) -> float | None:
    known = [own[method] for own in scores.values() if method in own]
    return float(np.mean(known)) if known else None


def _score_run(records: Sequence[Record]) -> dict[str, dict[str, float]]:
    """Return the success within 1 depth of focus, by scene and then by method."""
    scores: dict[str, dict[str, float]] = {}
    for method in dict.fromkeys(record.method for record in records):
        own = [record for record in records if record.method == method]
        for scene, mean in mean_by_scene_for_ranking(own, lambda r: r.success_1dof).items():
            scores.setdefault(scene, {})[method] = mean
    return scores


def compare_saf_rankings(
    answers: Sequence[SafAnswer], runs: Mapping[str, Sequence[Record]]
) -> tuple[RankAgreement, ...]:
    """Return the agreement of the rankings by SAF's protocol and by ours, and of each with every evaluation."""
    named = {
        THEIRS: _score_answers(answers, lambda a: -a.find_fraction_off(a.error)),
        OURS: _score_answers(answers, lambda a: -a.find_fraction_off(a.own_error)),
    }
    for run, records in runs.items():  # scenes of other data differ even if their names are the same
        named[run] = {f"{run}: {scene}": scores for scene, scores in _score_run(records).items()}
    ranked = list(named.items())
    pairs = [(first, second) for number, first in enumerate(ranked[:2]) for second in ranked[number + 1 :]]
    found = (compare_ranked_scores(first, second, condition="ranking") for first, second in pairs)
    return tuple(one for one in found if one is not None)


def _score_answers(answers: Sequence[SafAnswer], score: Callable[[SafAnswer], float]) -> dict[str, dict[str, float]]:
    scores: dict[str, dict[str, float]] = {}
    for method in dict.fromkeys(answer.method for answer in answers):
        own = [answer for answer in answers if answer.method == method]
        for scene, mean in _mean_by_scene(own, score).items():
            scores.setdefault(scene, {})[method] = mean
    return scores
