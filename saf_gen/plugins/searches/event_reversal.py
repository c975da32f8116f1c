"""Reversal of signed events: what the events before the focus did to each pixel, those after it undo."""

from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar, NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter, gaussian_filter1d, uniform_filter1d

from saf_gen.parts import Answer, View
from saf_gen.plugins.searches._windows import check_frame_count

SIGMA = 1.4826
"""Standard deviation of a normal distribution, in median absolute deviations."""
PLACES = 200
"""Places along the passed range of the lens."""
MEAN, SMOOTHING = 4, 2.0
"""Places over which the pictures are averaged, and standard deviation of the smoothing of the score."""
FINE_PX = 2.0
"""Standard deviation of the blur that is subtracted from the pictures, in pixels."""
HOT, HOT_SIGMAS = 12.0, 6.0
"""A pixel is hot if its events, or its net events, are further from the median than 12, and than 6 standard deviations.
"""
MISMATCH, NET = 0.1, 2.0
"""Standard deviation of the ratio of a pixel's two thresholds, and of the net events that the scene leaves it with."""
CLIP_SIGMAS = 2.0
"""Largest value of a pixel in a picture, in standard deviations."""


@dataclass(frozen=True)
class EventReversal:
    """Answers with the lens position at which signed events have added up to the sharpest picture.

    A pixel that becomes brighter as the lens comes into focus sends rises before the focus and falls after it; one that
    becomes darker does the opposite. The recording is cut into ``steps`` equal steps, and the signed events of each,
    rises less falls, are put where the lens was; those of a lens that comes back count the other way. Their sums from
    one end of the passed range are the change of the picture since then, at each of 200 places. Two scores find the
    focus in them, each divided by its largest value, and the answer is the place of their largest sum:

    - Let A be the change since the one end, B that to the other, both without what a blur of 2 pixels leaves. The mean
      of −A·B over the pixels is (c − c0)·(c − c1) times the variance of the scene, where its contrast is c, and c0 and
      c1 at the ends. Noise, of which nothing is undone, adds nothing on average, unless it is taken back (below).
    - The picture less its median over all places, in which the scene is blurred, has the covariance of neighbours at
      one pixel less that at two. It is largest in focus, at an end of the range too, and noise that differs from pixel
      to pixel adds nothing. Values are limited to two standard deviations.

    A lamp that changes does the same to all pixels, and the mean over the pixels is subtracted from each step. A pixel
    whose thresholds differ adds up rises and falls that cancel elsewhere: its net events are taken back in proportion
    to the events of all, the more surely the more of both kinds it had. Hot pixels are left out.

    The search looks at events and takes no score, so it does not matter which measure precedes it. It looks at the
    entire sweep, and abstains if no event came. If lens positions are not recorded, frames are used in their place. The
    trace holds the answer alone, in frames from 0. In mains flicker it seldom finds the focus, and never in a sweep so
    slow that a pixel sends dozens of events of noise: it takes them for thresholds that differ.

    References
    ----------
    This project. Events are steps of the logarithm of light, so that signed sums of them are changes of the picture.
    Covariance of neighbours: as ``vollath_f4``.
    """

    steps: int = 1000

    causal: ClassVar[bool] = False
    polarities: ClassVar[bool] = True

    def __post_init__(self) -> None:
        check_frame_count("steps", self.steps)

    def __call__(self, view: View) -> Answer:
        """Return the answer for a recording; raise BadInput if it is not one of events."""
        edges = np.linspace(0, view.frames, min(self.steps, view.frames) + 1).astype(int)
        steps, totals = list[Step](), np.zeros(())  # falls, rises
        for first, stop in pairwise(edges.tolist()):
            block = view.polarities(first, stop).astype(np.int64)
            steps.append(Step((block[1] - block[0]).astype(np.int16), block.sum() / block[0].size))
            totals = totals + block
        if not totals.any():
            return Answer(None, (), "no events")
        at = np.array([view.position(min(edge, view.frames - 1)) for edge in edges.tolist()])
        at = at if np.isfinite(at).all() else edges.astype(float)
        pictures, places = _pictures(steps, totals, at=at)
        score = _unit(_undone(pictures)) + _unit(_sharpness(pictures))
        place = places[gaussian_filter1d(score, SMOOTHING, mode="nearest").argmax()]
        frame = min(max(float(edges[np.abs(at - place).argmin()]) - 0.5, 0.0), view.frames - 1.0)
        return Answer(frame, (frame,))


class Step(NamedTuple):
    """Signed events of a step, int16 (row, col), and its mean number of events per pixel."""

    signed: np.ndarray
    active: float


def _pictures(steps: list[Step], totals: np.ndarray, *, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the change of the picture since the low end of the passed range, in events, and the places.

    ``totals`` are the falls and rises of all steps, (2, row, col), ``at`` the lens positions at their edges, (T + 1,).
    The pictures are float32 (place, row, col), the places (place,).
    """
    low, high = at.min(), at.max()
    width = (high - low) / PLACES or 1.0
    index = np.clip(((at[1:] + at[:-1]) / 2 - low) / width, 0, PLACES - 1).astype(int)
    passes = np.maximum(np.round(np.bincount(index, np.abs(np.diff(at)) / width, minlength=PLACES)), 1)
    change, active = np.zeros((PLACES, *totals.shape[1:]), np.float32), np.zeros(PLACES)
    for step, place, way in zip(steps, index, np.sign(np.diff(at)), strict=True):
        change[place] += way * (step.signed - step.signed.mean())
        active[place] += way * step.active
    net = totals[1] - totals[0] - (totals[1] - totals[0]).mean()
    spread = MISMATCH * totals.min(axis=0)
    net *= spread**2 / (spread**2 + NET**2)
    change -= np.multiply.outer(active / sum(step.active for step in steps), net)
    change /= passes[:, None, None]
    change[:, _outliers(totals.sum(axis=0)) | _outliers(change.sum(axis=0))] = 0
    pictures = np.concatenate([np.zeros_like(change[:1]), change.cumsum(axis=0)])
    return uniform_filter1d(pictures, MEAN, axis=0, mode="nearest"), low + width * np.arange(PLACES + 1)


def _undone(pictures: np.ndarray) -> np.ndarray:
    """Return how much of the change up to each place is undone after it, (place,)."""
    fine = pictures - gaussian_filter(pictures, (0, FINE_PX, FINE_PX), mode="nearest")
    return ((fine - fine[0]) * (fine - fine[-1])).mean(axis=(1, 2))


def _sharpness(pictures: np.ndarray) -> np.ndarray:
    """Return the covariance of neighbours less that of next neighbours, of what differs from the median, (place,)."""
    own = pictures - np.median(pictures, axis=0)
    if most := CLIP_SIGMAS * SIGMA * float(np.median(np.abs(own))):
        own = np.clip(own, -most, most)
    own -= own.mean(axis=(1, 2), keepdims=True)

    def covariance(lag: int) -> np.ndarray:
        along = own[:, :, lag:] * own[:, :, :-lag], own[:, lag:] * own[:, :-lag]
        return sum((of.mean(axis=(1, 2)) for of in along if of.size), np.zeros(len(own)))

    return covariance(1) - covariance(2)


def _unit(score: np.ndarray) -> np.ndarray:
    """Return a score above its median, with a largest magnitude of 1."""
    score = score - np.median(score)
    return score / (np.abs(score).max() or 1.0)


def _outliers(values: np.ndarray) -> np.ndarray:
    """Return which values are further from the median than HOT and than HOT_SIGMAS."""
    off = np.abs(values - np.median(values))
    return off > max(HOT, HOT_SIGMAS * SIGMA * float(np.median(off)))
