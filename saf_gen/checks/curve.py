"""The noise-free sharpness curve: is the target's box sharpest where optics says?"""

from collections.abc import Iterator

import numpy as np

from saf_gen.checks._finding import Finding, error, ok, warning
from saf_gen.checks.trial import Trial
from saf_gen.focal_stack import FocalStack
from saf_gen.region import target_box

__all__ = ["check_curve", "sharpness_of"]

CLOSE, FAR = 0.5, 1.5  # depths of focus
RIVAL = 0.8  # of the peak
FLAT = 1.2  # peak over the lowest


def check_curve(trial: Trial) -> Iterator[Finding]:
    """How far from the truth the curve has its top, in depths of focus, and whether it has others."""
    focus, curve = trial.stack.spec.focus, sharpness_of(trial, trial.stack)
    if not curve.max() > 0:
        yield error("curve", "the target's box has no sharpness: nothing in it is bright, or all is alike")
        return
    half = trial.half_depth
    near, fine = trial.near[0].spec.focus, sharpness_of(trial, trial.near[0])
    top = float(focus[curve.argmax()])
    if near[0] - half <= top <= near[-1] + half and 0 < fine.argmax() < fine.size - 1:
        top = _summit(near, fine)
    off = abs(top - trial.truth) / (2 * half)
    text = f"sharpest at {top:.3f} of the travel, {off:.2g} depths of focus from the truth"
    contrast = curve.max() / curve.min()
    other = "something else in the target's box is sharper there: move it, or give the target more contrast"
    if off > FAR:
        yield error("curve", f"{text}: {other}")
    elif off > CLOSE:
        yield warning("curve", f"{text}: {other}")
    elif contrast < FLAT:
        yield warning(
            "curve", f"{text}, but only {contrast:.2f} times the lowest: more contrast, or a wider lens"
        )
    else:
        yield ok("curve", f"{text}; {contrast:.3g} times the lowest")
    rivals = [
        k
        for k in range(1, len(curve) - 1)
        if curve[k] > max(curve[k - 1], curve[k + 1]) and abs(focus[k] - trial.truth) > 2 * FAR * half
        if curve[k] > RIVAL * curve.max()
    ]
    if rivals:
        k = max(rivals, key=lambda k: curve[k])
        yield warning(
            "curve",
            f"a second top at {focus[k]:.3f} of the travel is {curve[k] / curve.max():.0%} as high: {other}",
        )


def sharpness_of(trial: Trial, stack: FocalStack) -> np.ndarray:
    """Variance over squared mean of the charge in the target's box, float64 (focus,), as streams store it.

    0 where the box is black.
    """
    rows, columns = target_box(stack.target)
    seen = trial.charge(stack)[:, rows, columns].astype(np.float64)
    square = seen.mean(axis=(1, 2)) ** 2
    return np.divide(seen.var(axis=(1, 2)), square, out=np.zeros_like(square), where=square > 0)


def _summit(focus: np.ndarray, curve: np.ndarray) -> float:
    """Where a parabola through the highest value and its neighbours has its top."""
    k = int(curve.argmax())
    below, at, above = curve[k - 1 : k + 2]
    bend = below - 2 * at + above
    return float(focus[k] + (focus[1] - focus[0]) * ((below - above) / (2 * bend) if bend < 0 else 0.0))
