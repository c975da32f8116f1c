"""The right to abstain, the same for every search: where ``peak_fit`` would find no focus, there is no answer."""

from dataclasses import dataclass, field
from math import isfinite
from typing import Any

import numpy as np

from saf_gen.parts import Answer, Search, View, cite_source, commands, wants_measures
from saf_gen.plugins.searches._score_curve import ScoreCurve
from saf_gen.plugins.searches.peak_fit import FALL, PeakFit


@dataclass(frozen=True)
class Rejecting:
    """A search that abstains where ``peak_fit`` does, by the same lines and with the method's own measure.

    If a search that estimates has an answer, ``peak_fit`` looks at the same sweep. If it abstains, because no bell has
    its top near the sweep and the curve does not fall by 3 % of its range on both sides of its largest value, the
    answer is withdrawn. So no method has a better rule to abstain than ``peak_fit``, and the rule costs each as much.
    On a recording of fewer frames than twice the steps of ``peak_fit``, the steps are two frames long.

    ``peak_fit`` cannot follow a lens that a search moves back and forth. The curve of a search that commands the lens
    is that of its own samples, by position, and must fall on both sides by as much.

    Parameters
    ----------
    search : Search
        The search that answers.
    rule : PeakFit
        The search that says whether there is a focus.
    """

    search: Search
    rule: PeakFit = field(default_factory=PeakFit)

    @property
    def source(self) -> str:
        """The source of the search, with a note on the rule, which is this project's."""
        return f"{cite_source(self.search)}; abstains as peak_fit does"

    @property
    def commands(self) -> bool:
        """Whether the search commands the lens."""
        return commands(self.search)

    @property
    def causal(self) -> bool:
        """Whether the search can stop before the sweep ends."""
        return bool(getattr(self.search, "causal", False))

    @property
    def measures(self) -> tuple[str, ...]:
        """The measures that the search and the rule use in addition to the method's."""
        rule = () if self.commands else wants_measures(self.rule)
        return tuple(dict.fromkeys((*wants_measures(self.search), *rule)))

    def __call__(self, view: View) -> Answer:
        """Return the answer of the search, or an abstention that keeps its trace; raise what the search raises."""
        samples = _Samples(view)
        answer = self.search(samples)
        if answer.frame is None and answer.position is None:
            return answer
        reason = self._no_peak(samples) if self.commands else self._no_focus(view)
        return Answer(None, answer.trace, f"rejected: {reason}") if reason else answer

    def _no_focus(self, view: View) -> str:
        """Return why the rule abstains on a sweep, or ''."""
        short = view.frames < 2 * self.rule.steps
        found = PeakFit(steps=max(view.frames // 2, 1))(view) if short else self.rule(view)
        return found.note if found.frame is None else ""

    def _no_peak(self, samples: "_Samples") -> str:
        """Return why the samples of a lens that was moved show no peak, or ''; one that nobody saw is not judged."""
        curve = ScoreCurve(0.0, len(samples.seen))
        for position, score in samples.seen:
            curve.add(position, score)
        unseen = not samples.seen or not np.isfinite(curve.frames).all()
        return "" if unseen or curve.is_peak(FALL) else "the samples have no two sides"


class _Samples:
    """A view that notes where the lens was, and the score, whenever a window is scored by the method's measure."""

    def __init__(self, view: View) -> None:
        self._view = view
        self.seen: list[tuple[float, float]] = []

    def __getattr__(self, name: str) -> Any:
        return getattr(self._view, name)

    def score(self, first: int, stop: int, measure: str | None = None) -> float:
        score = self._view.score(first, stop, measure)
        if measure is None and isfinite(score):
            self.seen.append((self._view.position((first + stop) // 2), score))
        return score
