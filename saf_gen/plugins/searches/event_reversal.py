"""Reversal of signed events: what the events before the focus did to each pixel, those after it undo."""

from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar

import numpy as np
from scipy.ndimage import gaussian_filter1d, uniform_filter1d

from saf_gen.errors import BadInput
from saf_gen.parts import Answer, View
from saf_gen.plugins.searches._windows import check_frame_count, check_numbers

SIGMA = 1.4826
"""Standard deviation of a normal distribution, in median absolute deviations."""
HOT, HOT_SIGMAS = 12.0, 6.0
"""A pixel is hot if its net events are further from the median than 12 events, and than 6 standard deviations."""
JUMP, JUMP_SIGMAS = 0.1, 8.0
"""The lamp jumps in a step if the mean over pixels is further from its median than 0.1 event, and 8 deviations."""
SETTLING_S = 0.005
"""Time after a jump in which dark pixels still follow it, in seconds; it is left out with the jump."""
SMOOTHING_S = 0.005
"""Standard deviation of the smoothing of the score, in seconds."""


@dataclass(frozen=True)
class EventReversal:
    """Answers with the moment about which the signed events of each pixel reverse most.

    A pixel that becomes brighter as the lens comes into focus sends rises before the focus and falls after it; one that
    becomes darker does the opposite. Let A be the signed events of a pixel before a moment, rises less falls, and B
    those after it. The mean of −A·B over the pixels is (c − c0)·(c − c1) times the variance of the scene, where its
    contrast is c at that moment, c0 at the beginning and c1 at the end. It is largest in focus, and noise, of which
    nothing is undone, adds nothing on average. The recording is cut into ``steps`` equal steps, and A and B are whole
    steps.

    A lamp that changes does the same to all pixels: the mean over the pixels is subtracted from each step, and steps in
    which it jumps are left out, as are hot pixels. Pixels do not follow a lamp equally. Where the sum of these means
    varies about its moving mean over twice ``window_s`` seconds by more than ``drift`` events (standard deviation), A
    and B therefore reach ``window_s`` from the moment; otherwise they reach to the ends of the sweep.

    The search looks at events and takes no score, so it does not matter which measure precedes it. It looks at the
    entire sweep, and abstains if no event is undone. The trace holds the answer alone, in frames from 0. Under
    clouds and in mains flicker it seldom finds the focus.

    References
    ----------
    This project. Events are steps of the logarithm of light, so that signed sums of them are changes of the picture.
    """

    steps: int = 500
    window_s: float = 0.15
    drift: float = 0.2

    causal: ClassVar[bool] = False
    polarities: ClassVar[bool] = True

    def __post_init__(self) -> None:
        check_numbers(self, {"window_s": 1e4, "drift": 1e9})
        if not self.window_s:
            raise BadInput("window_s is 0", allowed="seconds, above 0, at most 10000")
        check_frame_count("steps", self.steps)

    def __call__(self, view: View) -> Answer:
        """Return the answer for a recording; raise BadInput if it is not one of events."""
        edges = np.linspace(0, view.frames, min(self.steps, view.frames) + 1).astype(int).tolist()
        blocks = (view.polarities(first, stop).astype(np.float32) for first, stop in pairwise(edges))
        steps = np.array([np.diff(block, axis=0).ravel() for block in blocks])  # rises less falls, (step, pixel)
        steps = steps[:, ~_outliers(steps.sum(axis=0), HOT, sigmas=HOT_SIGMAS)]
        count, per_s = len(steps), len(steps) * view.readout_hz / view.frames
        common = steps.mean(axis=1)
        jumps = np.convolve(_outliers(common, JUMP, sigmas=JUMP_SIGMAS), np.ones(round(SETTLING_S * per_s) + 1))[:count]
        reach, lamp = max(round(self.window_s * per_s), 1), common.cumsum()
        if (lamp - uniform_filter1d(lamp, 2 * reach + 1, mode="nearest")).std() <= self.drift:
            reach = count
        steps = (steps - common[:, None]) * (jumps[:, None] == 0)
        sums = np.concatenate([np.zeros_like(steps[:1]), steps.cumsum(axis=0)])
        score = np.zeros(count + 1)
        for t in range(1, count):
            before, after = sums[t] - sums[max(t - reach, 0)], sums[min(t + reach, count)] - sums[t]
            score[t] = -float(before @ after)
        score = gaussian_filter1d(score, SMOOTHING_S * per_s)
        if score.max() <= 0:
            return Answer(None, (), "no event is undone by a later one")
        frame = edges[score.argmax()] - 0.5
        return Answer(frame, (frame,))


def _outliers(values: np.ndarray, least: float, *, sigmas: float) -> np.ndarray:
    """Return which values are further from the median than ``least`` and than ``sigmas`` standard deviations."""
    off = np.abs(values - np.median(values))
    return off > max(least, sigmas * SIGMA * np.median(off))
