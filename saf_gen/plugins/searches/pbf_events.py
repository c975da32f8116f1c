"""Mirrored polarities of an event camera: falls before the focus mirror rises after it, as the two are counted."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.parts import Answer, View
from saf_gen.plugins.searches._windows import check_frame_count, check_windows_fit


@dataclass(frozen=True)
class PbfEvents:
    """Answers with the centre about which the rates of rises and of falls of an event camera mirror each other best.

    It is ``pbf`` on events as they are: the rates of the two polarities, in events per pixel and block of ``window``
    frames, instead of the changes of a pixel's log counts. The centre t has the largest

        Σ_τ p(t − τ)·n(t + τ)

    of the rates p of rises and n of falls, both less their means, as the docstring of ``pbf`` derives; the published
    formula was not at hand. The means also take away the events of leaks, which are all rises.

    The search takes no score, so it does not matter which measure precedes it. It looks at the entire sweep, and
    abstains if it has no event of one polarity. The trace holds the answer alone, in frames from 0. Its file is not
    that of ``pbf``, so that the digest of that one's code, and the rows of older evaluations, stay as they are.

    References
    ----------
    Bao, Sun, Ma, Gu and Wang, "Improving Fast Auto-Focus with Event Polarity", Opt. Express 31, 2023,
    doi:10.1364/OE.489717, arXiv:2303.08611. Of the paper only the abstract was at hand.
    """

    window: int = 100

    causal: ClassVar[bool] = False
    polarities: ClassVar[bool] = True

    def __post_init__(self) -> None:
        check_frame_count("window", self.window)

    def __call__(self, view: View) -> Answer:
        """Return the answer for a recording of events; raise BadInput if it is shorter than one block."""
        check_windows_fit(view, "window", frames=self.window)
        firsts = range(0, view.frames - self.window + 1, self.window)
        falls, rises = np.array([view.polarities(first, first + self.window).mean(axis=(1, 2)) for first in firsts]).T
        if not (falls.any() and rises.any()):
            return Answer(None, (), "no events of both polarities")
        sums = np.convolve(rises - rises.mean(), falls - falls.mean())  # of all centres, in halves of a block
        frame = float(sums.argmax() / 2 * self.window + (self.window - 1) / 2)
        return Answer(frame, (frame,))
