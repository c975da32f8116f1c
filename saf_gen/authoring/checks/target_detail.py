"""Detail: is the target fine enough to show defocus, and not so fine that it is noise?

Two things are measured on the picture itself, so they hold for bitmaps, formulas and geometry alike.

Loss: the share of the target's variance, in brightness, that is gone when it is blurred over three pixels. A
surface whose detail is coarser than that loses next to nothing: its focus curve is flat on top, and nobody
finds the focus on it.

Noise: what two renders of the same picture do not share. Detail that is far finer than a pixel, or a
small bright lamp, costs samples.

Bitmaps have a third: the size of a texel against that of a pixel, from the texture coordinates of the
surface. A texel larger than a pixel is seen as such: the renderer goes smoothly from one to the next.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from saf_gen.authoring.checks._scene_finding import SceneFinding, error, ok, warning
from saf_gen.authoring.checks.scene_under_test import NEAR, SceneUnderTest
from saf_gen.stack.focal_stack import FocalStack

__all__ = ["TargetDetail", "check_detail", "measure_detail"]

BLUR = 3.0  # pixels
BLANK = 0.01  # contrast
FLAT, WEAK = 0.005, 0.03  # losses: nothing to find; little to find
USUAL = 256  # samples a pixel, as the full-size recipes have
NOISY = 0.1  # of the target's contrast
SIGNIFICANT = 4.0  # standard errors; the largest of a few neighbouring positions is taken
SMALLEST, LARGEST = 0.2, 1.0  # pixels a texel: finer ones alias


@dataclass(frozen=True)
class TargetDetail:
    """contrast: standard deviation over mean of the target at its truth, without noise. loss: share of its
    square that is gone aside. noise: standard deviation of one stack's noise over that of the target."""

    contrast: float
    blur_loss: float
    noise: float


def check_detail(subject: SceneUnderTest) -> Iterator[SceneFinding]:
    """Contrast and loss, texels against pixels, noise."""
    focus, (low, high) = subject.near_stacks[0].spec.focus, subject.depth_of_focus
    aside = min(BLUR * (high - low) / 2, max(subject.true_focus - focus[0], focus[-1] - subject.true_focus))
    blur = 2 * aside / (high - low)  # 3 pixels, or less where the travel ends before
    shown = measure_detail(*subject.near_stacks, subject.true_focus, aside)
    yield _contrast(subject, shown, blur)
    texels = (
        subject.renderer.texel_footprints(subject.true_focus, subject.depth_and_target.target)
        / subject.pixel_footprint_m
    )
    size = float(np.median(texels)) if texels.size else float("nan")
    if size > LARGEST:
        yield warning(
            "detail",
            f"a texel of the target is {size:.2g} pixels large: use a picture with {2 * size:.2g} times the "
            "texels along each side, or repeat it more often",
        )
    elif texels.size:
        yield ok("detail", f"a texel of the target is {size:.2g} pixels large")
    yield _noise(subject, shown, size)


def _contrast(subject: SceneUnderTest, shown: TargetDetail, blur: float) -> SceneFinding:
    pixel_mm = subject.pixel_footprint_m * 1e3
    text = f"contrast {shown.contrast:.2g}, of whose square a {blur:.2g} px blur takes {shown.blur_loss:.1%}"
    wanted = f"details of {pixel_mm:.3g} to {5 * pixel_mm:.3g} mm; a pixel sees {pixel_mm:.3g} mm"
    if not shown.contrast > BLANK:
        return error(
            "detail", f"the target shows next to nothing (contrast {shown.contrast:.2g}): give it {wanted}"
        )
    if not shown.blur_loss > FLAT:
        return error("detail", f"{text}: it shows no defocus, give it {wanted}")
    if shown.blur_loss < WEAK:
        return warning("detail", f"{text}: its focus curve is flat, give it {wanted}")
    return ok("detail", text)


def _noise(subject: SceneUnderTest, shown: TargetDetail, texel: float) -> SceneFinding:
    noise = shown.noise * np.sqrt(subject.near_stacks[0].spec.samples / USUAL)
    text = f"noise is {noise:.2g} of the contrast at {USUAL} samples a pixel"
    if not noise > NOISY:
        return ok("detail", text)
    why = (
        f"texels of {texel:.2g} pixels"
        if texel < SMALLEST
        else "detail far finer than a pixel, or small lamps"
    )
    needed = (
        f"render {USUAL * (noise / NOISY) ** 2:,.0f} samples" if np.isfinite(noise) else "give it contrast"
    )
    return warning("detail", f"{text} ({why}): make it coarser, the lamps larger, or {needed}")


def measure_detail(first: FocalStack, second: FocalStack, truth: float, aside: float) -> TargetDetail:
    """What two stacks whose noise is independent show of the target, at the truth and ``aside`` of it.

    The variance is their covariance over the target's pixels and the squared mean; the loss is that of the
    side where it is larger.
    """
    mask, focus = first.target, first.spec.focus
    a, b = (stack.radiance.sum(axis=0)[:, mask].astype(np.float64) for stack in (first, second))
    mean = (a.mean(axis=1) + b.mean(axis=1)) / 2
    if not mean.min() > 0:  # black
        return TargetDetail(0.0, 0.0, float("inf"))
    a_, b_ = (stack - stack.mean(axis=1, keepdims=True) for stack in (a, b))
    products = a_ * b_
    shared = products.mean(axis=1) / mean**2
    best = int(np.abs(focus - truth).argmin())
    beside = [p for p in (truth - aside, truth + aside) if focus[0] - 1e-9 <= p <= focus[-1] + 1e-9]
    lowest = min(float(np.interp(p, focus, shared)) for p in beside)
    peak = float(shared[max(best - NEAR // 4, 0) : best + NEAR // 4 + 1].max())
    uncertain = float(products[best].std()) / np.sqrt(products.shape[1]) / mean[best] ** 2
    if not peak > SIGNIFICANT * uncertain:  # what noise alone may show
        return TargetDetail(0.0, 0.0, float("inf"))
    own = ((a[best] - b[best]) ** 2).mean() / 2 / mean[best] ** 2
    return TargetDetail(np.sqrt(peak), 1 - lowest / peak, float(np.sqrt(own / peak)))
