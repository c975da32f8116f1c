"""Checks of a thin section, which is not expected to be sharpest, or to show anything, where it is in focus."""

from collections.abc import Iterator

import numpy as np

from saf_gen.authoring.checks.pictures import MIN_CONTRAST, MIN_RISE, target_sharpness
from saf_gen.authoring.checks.subject import SceneUnderTest
from saf_gen.core.finding import Finding

AWAY = 1.0  # half depths of focus between a peak of contrast and the focus, beyond which methods will miss the focus


def check_section(subject: SceneUnderTest) -> Iterator[Finding]:
    """Check how much contrast the section has, in focus and at its largest on either side."""
    truth, half = subject.true_focus, subject.half_depth_of_focus
    stacks = (subject.stack, subject.near_stacks[0])
    focus = np.concatenate([stack.spec.focus for stack in stacks])
    contrast = np.sqrt(np.concatenate([target_sharpness(subject, stack) for stack in stacks]))
    order = focus.argsort(kind="stable")
    focus, contrast = focus[order], contrast[order]
    here = float(contrast[np.abs(focus - truth).argmin()])
    peaks = [
        int(np.flatnonzero(side)[contrast[side].argmax()]) for side in (focus < truth, focus > truth) if side.any()
    ]
    beside = " and ".join(f"{contrast[k]:.2g} at {(focus[k] - truth) / half:+.1f}" for k in peaks)
    text = f"contrast {here:.2g} in focus, at most {beside} half depths of focus"
    best = max(peaks, key=lambda k: contrast[k])
    if not contrast.max() > MIN_CONTRAST:
        yield Finding(
            "section", "error", f"{text}: too little, give it more path or absorption, or the condenser less aperture"
        )
    elif contrast.max() ** 2 < MIN_RISE * contrast.min() ** 2:
        yield Finding("section", "warning", f"{text}: all positions look alike, give it finer detail")
    elif contrast[best] > here and abs(focus[best] - truth) > AWAY * half:
        yield Finding("section", "ok", f"{text}: methods that seek the largest contrast will miss the focus")
    else:
        yield Finding("section", "ok", text)
