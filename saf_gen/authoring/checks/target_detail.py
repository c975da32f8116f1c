"""Detail: is the target's detail fine enough to show defocus, and not so fine that it is noise?

Blur loss and noise are measured on the rendered image, so they apply to bitmaps, formulas and geometry alike. The blur
loss is the fraction of the variance of the target's brightness that a blur of three pixels removes. A surface with only
coarse detail loses almost nothing; its focus curve is flat at the top, and no method finds the focus on it. The noise
is the difference between two renders of the same image. Detail much finer than a pixel, or a small bright lamp, needs
many samples.

For bitmaps, the size of a texel is compared with that of a pixel by the texture coordinates of the surface. Texels
larger than a pixel are visible, because the renderer interpolates between texels.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from saf_gen.authoring.checks._scene_finding import SceneFinding, scene_check_error, scene_check_ok, scene_check_warning
from saf_gen.authoring.checks.scene_under_test import NEAR, SceneUnderTest
from saf_gen.stack.focal_stack import FocalStack

BLUR = 3.0  # pixels
MIN_CONTRAST = 0.01
MIN_LOSS, WEAK_LOSS = 0.005, 0.03  # of the variance; below these, the focus cannot be found, or only just
USUAL_SAMPLES = 64  # per pixel, as in the full-size recipes
MAX_NOISE = 0.1  # of the target's contrast
SIGNIFICANT = 4.0  # standard errors; many, because the largest of a few neighbouring positions is used
MIN_TEXEL, MAX_TEXEL = 0.2, 1.0  # pixels per texel; smaller texels alias


@dataclass(frozen=True)
class TargetDetail:
    """The detail that a target shows.

    Attributes
    ----------
    contrast : float
        Standard deviation of the target at its true focus, divided by its mean, without noise.
    blur_loss : float
        Fraction of the squared contrast that is lost out of focus.
    noise : float
        Standard deviation of the noise of one stack, divided by that of the target.
    """

    contrast: float
    blur_loss: float
    noise: float


def check_detail(subject: SceneUnderTest) -> Iterator[SceneFinding]:
    """Check the contrast and blur loss of the target, the size of its texels, and its noise."""
    focus, (low, high) = subject.near_stacks[0].spec.focus, subject.depth_of_focus
    offset = min(BLUR * (high - low) / 2, max(subject.true_focus - focus[0], focus[-1] - subject.true_focus))
    blur = 2 * offset / (high - low)  # 3 pixels, or fewer if the stack ends before
    detail = _measure_detail(*subject.near_stacks, truth=subject.true_focus, offset=offset)
    yield _check_contrast(subject, detail, blur=blur)
    texels = (
        subject.renderer.texel_footprints(subject.true_focus, subject.depth_and_target.target)
        / subject.pixel_footprint_m
    )
    size = float(np.median(texels)) if texels.size else float("nan")
    if size > MAX_TEXEL:
        yield scene_check_warning(
            "detail",
            f"a texel of the target covers {size:.2g} pixels: use an image with {2 * size:.2g} times the "
            "texels along each side, or repeat it more often",
        )
    elif texels.size:
        yield scene_check_ok("detail", f"a texel of the target covers {size:.2g} pixels")
    yield _check_noise(subject, detail, texel=size)


def _check_contrast(subject: SceneUnderTest, detail: TargetDetail, *, blur: float) -> SceneFinding:
    pixel_mm = subject.pixel_footprint_m * 1e3
    loss = f"a blur of {blur:.2g} pixels removes {detail.blur_loss:.1%} of its square"
    text = f"contrast {detail.contrast:.2g}, {loss}"
    wanted = f"details of {pixel_mm:.3g} to {5 * pixel_mm:.3g} mm; a pixel sees {pixel_mm:.3g} mm"
    if not detail.contrast > MIN_CONTRAST:
        return scene_check_error(
            "detail", f"the target has almost no contrast ({detail.contrast:.2g}): give it {wanted}"
        )
    if not detail.blur_loss > MIN_LOSS:
        return scene_check_error("detail", f"{text}: it shows no defocus, give it {wanted}")
    if detail.blur_loss < WEAK_LOSS:
        return scene_check_warning("detail", f"{text}: its focus curve is flat, give it {wanted}")
    return scene_check_ok("detail", text)


def _check_noise(subject: SceneUnderTest, detail: TargetDetail, *, texel: float) -> SceneFinding:
    noise = detail.noise * np.sqrt(subject.near_stacks[0].spec.samples / USUAL_SAMPLES)
    text = f"noise is {noise:.2g} of the contrast at {USUAL_SAMPLES} samples per pixel"
    if not noise > MAX_NOISE:
        return scene_check_ok("detail", text)
    small = texel < MIN_TEXEL
    cause = f"texels of {texel:.2g} pixels" if small else "detail much finer than a pixel, or small lamps"
    samples = USUAL_SAMPLES * (noise / MAX_NOISE) ** 2
    remedy = f"render {samples:,.0f} samples" if np.isfinite(noise) else "give it contrast"
    return scene_check_warning("detail", f"{text} ({cause}): use coarser detail or larger lamps, or {remedy}")


def _measure_detail(first: FocalStack, second: FocalStack, *, truth: float, offset: float) -> TargetDetail:
    """Return the target's detail, from two stacks with independent noise.

    The squared contrast is the covariance of both stacks over the target's pixels, divided by the squared mean. It is
    compared at the true focus and, on either side, ``offset`` (a fraction of the travel) away from it; the larger loss
    counts.
    """
    mask, focus = first.target, first.spec.focus
    a, b = (stack.radiance.sum(axis=0)[:, mask].astype(np.float64) for stack in (first, second))
    mean = (a.mean(axis=1) + b.mean(axis=1)) / 2
    if not mean.min() > 0:  # black
        return TargetDetail(0.0, 0.0, float("inf"))
    a_, b_ = (stack - stack.mean(axis=1, keepdims=True) for stack in (a, b))
    products = a_ * b_
    covariance = products.mean(axis=1) / mean**2
    best = int(np.abs(focus - truth).argmin())
    sides = [p for p in (truth - offset, truth + offset) if focus[0] - 1e-9 <= p <= focus[-1] + 1e-9]
    lowest = min(float(np.interp(p, focus, covariance)) for p in sides)
    peak = float(covariance[max(best - NEAR // 4, 0) : best + NEAR // 4 + 1].max())
    uncertain = float(products[best].std()) / np.sqrt(products.shape[1]) / mean[best] ** 2
    if not peak > SIGNIFICANT * uncertain:  # noise alone may reach this contrast
        return TargetDetail(0.0, 0.0, float("inf"))
    stack_noise = ((a[best] - b[best]) ** 2).mean() / 2 / mean[best] ** 2
    return TargetDetail(np.sqrt(peak), 1 - lowest / peak, float(np.sqrt(stack_noise / peak)))
