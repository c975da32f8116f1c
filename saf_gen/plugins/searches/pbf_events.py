"""Mirrored polarities of an event camera: before the focus, one polarity mirrors the other one after it."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.parts import Answer, View
from saf_gen.plugins.searches._windows import check_frame_count, check_windows_fit


@dataclass(frozen=True)
class PbfEvents:
    """Answers with the centre about which the rates of brighter and of darker events mirror each other best.

    This is ``pbf`` for an event camera, as it was published: the rates of the two polarities are those of the events
    themselves, per pixel and block of ``window`` frames, not of differences of spike counts. A name of its own keeps
    the digest of ``pbf``, and with it the rows of older evaluations. The answer is the centre t with the largest
    Σ_τ p(t − τ)·n(t + τ), with the means subtracted, as ``pbf`` says; the sum and the means are this project's.

    Published lamps are constant. Where the light rises or falls, one polarity follows the lamp and not the lens, and
    nothing here tells the two apart.

    The search looks at events and takes no score, so it does not matter which measure precedes it. It looks at the
    entire sweep, and abstains if one polarity has no event. The trace holds the answer alone, in frames from 0.

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
        """Return the answer for a recording; raise BadInput if it is shorter than one block, or not of events."""
        check_windows_fit(view, "window", frames=self.window)
        firsts = range(0, view.frames - self.window + 1, self.window)
        rates = np.array([view.polarities(first, first + self.window).mean(axis=(1, 2)) for first in firsts])
        darker, brighter = rates.T
        if not (darker.any() and brighter.any()):
            return Answer(None, (), "no events of both polarities")
        sums = np.convolve(brighter - brighter.mean(), darker - darker.mean())
        frame = float((self.window - 1) / 2 + sums.argmax() / 2 * self.window)
        return Answer(frame, (frame,))
