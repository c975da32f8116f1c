"""The noise-free sharpness curve: is the target's bounding box sharpest at the true focus?"""

from collections.abc import Iterator

import numpy as np

from saf_gen.authoring.checks._scene_finding import SceneFinding, scene_check_error, scene_check_ok, scene_check_warning
from saf_gen.authoring.checks.scene_under_test import SceneUnderTest
from saf_gen.core.region import bounding_box
from saf_gen.stack.focal_stack import FocalStack

CLOSE, FAR = 0.5, 1.5  # depths of focus
MIN_RIVAL = 0.8  # of the peak
MIN_CONTRAST = 1.2  # the peak divided by the lowest value


def check_curve(subject: SceneUnderTest) -> Iterator[SceneFinding]:
    """Check how far the peak is from the true focus, in depths of focus, and whether there are other peaks."""
    focus, curve = subject.stack.spec.focus, _target_sharpness(subject, subject.stack)
    if not curve.max() > 0:
        yield scene_check_error("curve", "the target's box has no sharpness: it is dark or uniform")
        return
    half = subject.half_depth_of_focus
    near, fine = subject.near_stacks[0].spec.focus, _target_sharpness(subject, subject.near_stacks[0])
    top = float(focus[curve.argmax()])
    if near[0] - half <= top <= near[-1] + half and 0 < fine.argmax() < fine.size - 1:
        top = _parabola_peak(near, fine)
    off = abs(top - subject.true_focus) / (2 * half)
    text = f"sharpest at {top:.3f} of the travel, {off:.2g} depths of focus from the true focus"
    contrast = curve.max() / curve.min()
    other = "something else in the target's box is sharper there: move it, or give the target more contrast"
    if off > FAR:
        yield scene_check_error("curve", f"{text}: {other}")
    elif off > CLOSE:
        yield scene_check_warning("curve", f"{text}: {other}")
    elif contrast < MIN_CONTRAST:
        yield scene_check_warning(
            "curve", f"{text}; the peak is only {contrast:.2f} times the lowest value: add contrast, or open the lens"
        )
    else:
        yield scene_check_ok("curve", f"{text}; the peak is {contrast:.3g} times the lowest value")
    rivals = [
        k
        for k in range(1, len(curve) - 1)
        if curve[k] > max(curve[k - 1], curve[k + 1]) and abs(focus[k] - subject.true_focus) > 2 * FAR * half
        if curve[k] > MIN_RIVAL * curve.max()
    ]
    if rivals:
        k = max(rivals, key=lambda k: curve[k])
        yield scene_check_warning(
            "curve", f"a second peak at {focus[k]:.3f} of the travel is {curve[k] / curve.max():.0%} as high: {other}"
        )


def _target_sharpness(subject: SceneUnderTest, stack: FocalStack) -> np.ndarray:
    """Return the variance of the charge in the target's box, divided by its squared mean, float64 (focus,).

    The ``sharpness`` of a stream has the same definition. The value is 0 if the box is black.
    """
    rows, columns = bounding_box(stack.target)
    seen = subject.collected_charge(stack)[:, rows, columns].astype(np.float64)
    square = seen.mean(axis=(1, 2)) ** 2
    return np.divide(seen.var(axis=(1, 2)), square, out=np.zeros_like(square), where=square > 0)


def _parabola_peak(focus: np.ndarray, curve: np.ndarray) -> float:
    """Return the position of the peak of a parabola through the highest value and its neighbours."""
    k = int(curve.argmax())
    below, at, above = curve[k - 1 : k + 2]
    bend = below - 2 * at + above
    return float(focus[k] + (focus[1] - focus[0]) * ((below - above) / (2 * bend) if bend < 0 else 0.0))
