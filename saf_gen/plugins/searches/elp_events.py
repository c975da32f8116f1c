"""Event Laplacian product of an event camera alone: its picture is the sum of its events since the sweep began."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.ndimage import convolve, median_filter

from saf_gen.errors import BadInput
from saf_gen.parts import Answer, View
from saf_gen.plugins.searches._windows import check_frame_count, check_numbers, check_windows_fit

GREY = 128.0
"""Mean of a picture, in levels of 0 to 255, as in ``elp``."""
LAPLACIAN = np.array([[0, 1, 0], [1, -4, 1], [0, 1, 0]], dtype=np.float64)


@dataclass(frozen=True)
class ElpEvents:
    """Follows the Event Laplacian Product of the events of a sweep, and stops once it has turned from plus to minus.

    This is ``elp`` for an event camera: E are the signed events of a window, rises less falls, as published. The
    product −Σ ∇²I·E/Σ|E|, its filter (``alpha``, ``past``, ``jump``) and its thresholds (``swing``, ``below``) are
    those of ``elp``. A name of its own keeps the digest of ``elp``, and with it the rows of older evaluations.

    The published picture I is a frame of the DAVIS346, or, for a camera of events alone, is made of the events of a
    shutter that opens. An event file has neither. I is here what the events say themselves: their signed sum per pixel
    since the sweep began, ``contrast`` each, in grey levels about a mean of 128. It is the change of the logarithm of
    the picture since then. A sweep begins far from the focus, where the Laplacian of the picture is small, so that the
    Laplacian of its change is nearly its own; a lamp that changes adds the same to all pixels, of which the Laplacian
    is 0. If the sweep begins near the focus, the sum lacks what was sharp from the beginning. The picture holds no
    event of the window itself.

    The search looks at events and takes no score, so it does not matter which measure precedes it. It abstains if the
    product does not turn. The answer is one window before the one in which it is below 0, as in ``elp``, and the
    trace holds the last frames of the two windows between which it turned, counted from 0.

    References
    ----------
    Bao, Gao, Li and Wang, "One-Step Event-Driven High-Speed Autofocus", CVPR 2025, arXiv:2503.01214. The picture of
    summed events is this project's.
    """

    window: int = 100
    contrast: float = 0.2
    alpha: float = 0.4
    past: int = 10
    jump: float = 5e4
    swing: float = 8.0
    below: float = 5.0

    causal: ClassVar[bool] = True
    polarities: ClassVar[bool] = True

    def __post_init__(self) -> None:
        for key in ("window", "past"):
            check_frame_count(key, getattr(self, key))
        check_numbers(self, {"contrast": 10, "alpha": 1, "jump": 1e9, "swing": 1e9, "below": 1e9})
        if not self.contrast:
            raise BadInput("contrast is 0", allowed="a difference of logarithms, above 0, at most 10")

    def __call__(self, view: View) -> Answer:
        """Return the answer for a sweep; raise BadInput if it is shorter than one block, or not of events."""
        check_windows_fit(view, "window", frames=self.window)
        total: np.ndarray = np.zeros(())
        raw: list[float] = []
        filtered: list[float] = []
        begins: list[int] = []
        for first in range(0, view.frames - self.window + 1, self.window):
            darker, brighter = view.polarities(first, first + self.window).astype(np.float64)
            events = brighter - darker
            if np.any(events) and np.any(total):
                raw.append(signed_product(total * self.contrast * GREY, events))
                near = raw[-self.past :]
                kept = len(raw) == 1 or abs(raw[-1] - sum(near) / len(near)) > self.jump
                filtered.append(raw[-1] if kept else self.alpha * raw[-1] + (1 - self.alpha) * filtered[-1])
                begins.append(first)
                if max(filtered) - min(filtered) > self.swing and min(filtered) < -self.below:
                    y = np.array(filtered)
                    turns = np.flatnonzero((y[:-1] > 0) & (y[1:] < 0))
                    if len(turns):
                        before, after = begins[turns[-1]], begins[turns[-1] + 1]
                        trace = (float(before + self.window - 1), float(after + self.window - 1))
                        return Answer(
                            after - self.window - 0.5, trace, f"stopped after {view.now} of {view.frames} frames"
                        )
            total = total + events
        return Answer(None, (), "no turn from plus to minus that stands out")


def signed_product(picture: np.ndarray, events: np.ndarray) -> float:
    """Return −Σ ∇²I·E/Σ|E| for a picture in grey levels and signed events, (row, col); 0.0 without events.

    As in ``elp``, the picture passes a 3 × 3 median, and borders are replicated for it and mirrored for the Laplacian.
    """
    if not (number := float(np.abs(events).sum())):
        return 0.0
    smooth = median_filter(picture, size=3, mode="nearest")
    return -float(np.vdot(convolve(smooth, LAPLACIAN, mode="mirror"), events)) / number
