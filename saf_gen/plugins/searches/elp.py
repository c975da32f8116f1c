"""Event Laplacian product: a sweep stops when the product of events and a Laplacian turns from plus to minus."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.ndimage import convolve, median_filter

from saf_gen.errors import BadInput
from saf_gen.parts import Answer, View
from saf_gen.plugins.searches._events import count_events
from saf_gen.plugins.searches._windows import check_frame_count, check_numbers, check_windows_fit

GREY = 128.0
"""Mean of a picture, in levels of 0 to 255, as a camera with automatic exposure would set it."""
LAPLACIAN = np.array([[0, 1, 0], [1, -4, 1], [0, 1, 0]], dtype=np.float64)


@dataclass(frozen=True)
class Elp:
    """Follows the Event Laplacian Product of a sweep, and stops once it has clearly turned from plus to minus.

    While a blurred picture gets sharp, its intensity I grows where its Laplacian is below 0, because blur obeys
    the equation of heat. The Event Laplacian Product of the events E in a window,

        ELP = −Σ ∇²I·E / Σ|E|

    is therefore above 0 on the way to the focus, and below 0 after it. As in the released code, I is a picture from
    before the events, after a 3 × 3 median, ∇² is the 3 × 3 kernel with −4 in the middle, and borders are replicated
    for the median and mirrored for the Laplacian. A value that differs from the mean of the last ``past`` values by
    more than ``jump`` is kept; another is replaced by ``alpha`` times itself plus (1 − ``alpha``) times the last
    filtered value. The search stops once the filtered values span more than ``swing``, and one is below −``below``.
    The answer is one window before the events of the first value below 0 after the last one above 0. The constants are
    those that the released code has for DAVIS346, a camera with events and pictures.

    A spike camera has neither events nor pictures, so both are made of spikes. Each pixel's events are the change of
    its log counts from one block of ``window`` frames to the next, in multiples of ``contrast``, rounded towards 0.
    The picture is the counts of the ``picture`` frames before both, which share no spike with them, so that counting
    noise does not bias the product. It is scaled to a mean grey level of 128 and not rounded, because the constants are
    grey levels of exposed pictures. The published windows of 1 ms count too few spikes, and the published picture may
    be older. The correction of motion is left out.

    The search looks at counts and takes no score, so it does not matter which measure precedes it. It abstains if the
    product does not turn. The trace holds the last frames of both windows between which it turned, counted from 0.

    References
    ----------
    Bao, Gao, Li and Wang, "One-Step Event-Driven High-Speed Autofocus", CVPR 2025, arXiv:2503.01214, with its released
    code, YuHanBaozju/ELP. Of the paper only the abstract and summaries were at hand.
    """

    window: int = 100
    picture: int = 300
    contrast: float = 0.2
    alpha: float = 0.4
    past: int = 10
    jump: float = 5e4
    swing: float = 8.0
    below: float = 5.0

    causal: ClassVar[bool] = True

    def __post_init__(self) -> None:
        for key in ("window", "picture", "past"):
            check_frame_count(key, getattr(self, key))
        check_numbers(self, {"contrast": 10, "alpha": 1, "jump": 1e9, "swing": 1e9, "below": 1e9})
        if not self.contrast:
            raise BadInput("contrast is 0", allowed="a difference of logarithms, above 0, at most 10")

    def __call__(self, view: View) -> Answer:
        """Return the answer for a sweep; raise BadInput if it is shorter than one block."""
        check_windows_fit(view, "window", frames=self.window)
        raw: list[float] = []
        filtered: list[float] = []
        begins: list[int] = []  # frame at which the earlier of the two blocks begins
        for first in range(self.picture, view.frames - 2 * self.window + 1, self.window):
            middle, stop = first + self.window, first + 2 * self.window
            picture = view.counts(first - self.picture, first)
            events = count_events(view.counts(first, middle), view.counts(middle, stop), contrast=self.contrast)
            if not events.any():
                continue
            raw.append(laplacian_product(picture, events))
            filtered.append(self._filter(raw, filtered[-1] if filtered else raw[0]))
            begins.append(first)
            if max(filtered) - min(filtered) > self.swing and min(filtered) < -self.below:
                y = np.array(filtered)
                turns = np.flatnonzero((y[:-1] > 0) & (y[1:] < 0))
                if len(turns):
                    before, after = begins[turns[-1]], begins[turns[-1] + 1]
                    trace = (float(before + 2 * self.window - 1), float(after + 2 * self.window - 1))
                    note = f"stopped after {view.now} of {view.frames} frames"
                    return Answer(after - self.window / 2 - 0.5, trace, note)  # events are from centre to centre
        return Answer(None, (), "no turn from plus to minus that stands out")

    def _filter(self, raw: list[float], last: float) -> float:
        """Return the filtered form of the last of the values ``raw``; ``last`` is the filtered value before it."""
        near = raw[-self.past :]
        if abs(raw[-1] - sum(near) / len(near)) > self.jump:
            return raw[-1]
        return self.alpha * raw[-1] + (1 - self.alpha) * last


def laplacian_product(picture: np.ndarray, events: np.ndarray) -> float:
    """Return −Σ ∇²I·E/Σ|E| for counts and events, (row, col); 0.0 if the picture is dark or there is no event.

    The result is in grey levels of a picture with a mean of 128 levels.
    """
    mean, number = float(picture.mean()), float(np.abs(events).sum())
    if not (mean and number):
        return 0.0
    smooth = median_filter(picture * (GREY / mean), size=3, mode="nearest")
    return -float(np.vdot(convolve(smooth, LAPLACIAN, mode="mirror"), events)) / number
