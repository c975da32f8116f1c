"""Mirrored polarities: before the focus, events of one polarity mirror those of the other polarity after it."""

from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar

import numpy as np

from saf_gen.errors import BadInput
from saf_gen.parts import Answer, View
from saf_gen.plugins.searches._events import count_events
from saf_gen.plugins.searches._windows import check_frame_count, check_numbers, check_windows_fit


@dataclass(frozen=True)
class Pbf:
    """Answers with the centre about which the rates of brighter and of darker events mirror each other best.

    Blur is the same at equal distances before and behind the focus, so a pixel that becomes brighter at a distance
    before it becomes darker at the same distance behind it. The rates p and n of events of the two polarities therefore
    obey p(f − τ) = n(f + τ) at the focus f. The answer is the centre t with the largest

        Σ_τ p(t − τ)·n(t + τ)

    which is one convolution of the two sequences, hence the published speed. Both have their means subtracted first,
    because a constant rate of noise would otherwise pull the answer to the middle of the sweep. The published formula
    was not at hand: the symmetry of the *event polarity rates* is from the abstract, and the sum and the means are this
    project's.

    A spike camera has no events. Each pixel's events are the change of its log counts from one block of ``window``
    frames to the next, in multiples of ``contrast``, rounded towards 0. Rates are events per pixel and block.

    The search looks at counts and takes no score, so it does not matter which measure precedes it. It looks at the
    entire sweep, and abstains if it has no event of one polarity. The trace holds the answer alone, in frames from 0.

    References
    ----------
    Bao, Sun, Ma, Gu and Wang, "Improving Fast Auto-Focus with Event Polarity", Opt. Express 31, 2023,
    doi:10.1364/OE.489717, arXiv:2303.08611. Of the paper only the abstract was at hand.
    """

    window: int = 100
    contrast: float = 0.2

    causal: ClassVar[bool] = False

    def __post_init__(self) -> None:
        check_frame_count("window", self.window)
        check_numbers(self, {"contrast": 10})
        if not self.contrast:
            raise BadInput("contrast is 0", allowed="a difference of logarithms, above 0, at most 10")

    def __call__(self, view: View) -> Answer:
        """Return the answer for a recording; raise BadInput if it is shorter than one block."""
        check_windows_fit(view, "window", frames=self.window)
        firsts = range(0, view.frames - self.window + 1, self.window)
        blocks = (view.counts(first, first + self.window) for first in firsts)
        events = (count_events(before, after, contrast=self.contrast) for before, after in pairwise(blocks))
        rates = np.array([(np.maximum(e, 0).mean(), np.maximum(-e, 0).mean()) for e in events]).reshape(-1, 2).T
        if not rates.any(axis=1).all():
            return Answer(None, (), "no events of both polarities")
        frame = float(self.window - 0.5 + mirror_centre(*rates) * self.window)
        return Answer(frame, (frame,))


def mirror_centre(brighter: np.ndarray, darker: np.ndarray) -> float:
    """Return the index, in halves, about which two sequences (n,) mirror each other best."""
    sums = np.convolve(brighter - brighter.mean(), darker - darker.mean())
    return float(sums.argmax()) / 2
