"""Checks of rendered pictures: light on the target, its detail, its sharpness along the travel, and time slices.

**Detail.** Blur loss and noise are measured on the rendered image, so they apply to bitmaps, formulas and geometry
alike. The blur loss is the fraction of the variance of the target's brightness that a blur of three pixels removes. A
surface with only coarse detail loses almost nothing; its focus curve is flat at the top, and no method finds the focus
on it. The noise is the difference between two renders of the same image. Detail much finer than a pixel, or a small
bright lamp, needs many samples. For bitmaps, the size of a texel is compared with that of a pixel by the texture
coordinates of the surface. Texels larger than a pixel are visible, because the renderer interpolates between texels.

**Time slices.** The error is the root mean square difference, over the target's bounding box, between the mean of two
slices and a render at the moment half way between them, divided by the mean of that render. The lens is focused on the
target, and all lights have gain 1. Two pairs of images with independent noise are rendered; the mean product of their
differences is free of noise. For steady motion, the error of interpolation is largest half way.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

import numpy as np

from saf_gen.authoring.checks.geometry import RECORDING_S
from saf_gen.authoring.checks.subject import NEAR, SceneUnderTest
from saf_gen.camera.exposure import firing_rate
from saf_gen.core.config.ranges import is_range
from saf_gen.core.finding import Finding
from saf_gen.core.region import bounding_box, region_shape
from saf_gen.scene.keyframes import motion_end_s
from saf_gen.scene.scene_folder import EDGE_POWER
from saf_gen.stack.focal_stack import FocalStack
from saf_gen.stack.noise_free import COUNTS, score_picture
from saf_gen.stack.time_resolved import slice_starts

LUMENS_PER_WATT = 683.0
"""Luminous efficacy of light of 555 nm, by the definition of the candela. All light is assumed to have the wavelength
at which the sensors convert it to electrons, so that lux and electrons correspond."""
TOLERANCE, FAMILY_TOLERANCE = 0.1, 0.3  # of the card's value, which is a mean for a family
DARKEST, BRIGHTEST = 0.1, 2e5  # lux: the light of the full moon, and more than the light of the sun at noon
MAX_DARK_FRACTION = 0.05


def check_exposure(subject: SceneUnderTest) -> Iterator[Finding]:
    """Compare the illuminance of the target by each light group with the card, and look for dark pixels."""
    card = subject.scene.card
    lux = {
        group: LUMENS_PER_WATT
        * subject.renderer.estimate_irradiance(
            group, position=subject.true_focus, target=subject.depth_and_target.target
        )[0]
        for group in card.lights
    }
    for group, value in lux.items():
        if not value > 0:
            yield Finding(
                "exposure", "error", f"light group {group!r} does not reach the target: move its lamps, or remove it"
            )
    written = "illuminance_lux: {" + ", ".join(f"{g}: {float(f'{v:.3g}'):g}" for g, v in lux.items()) + "}"
    tolerance = FAMILY_TOLERANCE if any(is_range(value) for value in card.params.values()) else TOLERANCE
    wrong = [g for g, stated in card.illuminance_lux.items() if abs(lux[g] - stated) > tolerance * stated]
    total = sum(lux.values())
    if wrong:
        yield Finding(
            "exposure",
            "warning",
            f"the target receives {lux[wrong[0]]:,.3g} lux from {wrong[0]!r}, the card says "
            f"{card.illuminance_lux[wrong[0]]:,g}: write {written}",
        )
    elif not DARKEST <= total <= BRIGHTEST:
        yield Finding(
            "exposure",
            "warning",
            f"a total of {total:,.3g} lux is implausible (moonlight 0.1, sun 100,000): change the lamps",
        )
    else:
        hint = "as the card says" if card.illuminance_lux else "add this to the card for schedules in lux"
        yield Finding("exposure", "ok", f"{written}, {hint}")
    yield _check_absolute_exposure(subject)


def _check_absolute_exposure(subject: SceneUnderTest) -> Finding:
    stack = subject.near_stacks[0]
    best = int(np.abs(stack.spec.focus - subject.true_focus).argmin())
    charge = subject.collected_charge(stack)[best][stack.target]
    dark = float(np.mean(charge <= 0))
    rate = float(np.mean(firing_rate(charge + subject.sensor.mean_dark_e, subject.sensor)))
    text = f"with absolute exposure the target fires {rate:.3g} spikes per readout"
    if dark > MAX_DARK_FRACTION:
        return Finding(
            "exposure", "warning", f"{dark:.0%} of the target is completely dark: light it from another side"
        )
    if rate > 0.9:
        text += ": almost saturated, use mean_rate in recipes"
    return Finding("exposure", "ok", text)


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


def check_detail(subject: SceneUnderTest) -> Iterator[Finding]:
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
        yield Finding(
            "detail",
            "warning",
            f"a texel of the target covers {size:.2g} pixels: use an image with {2 * size:.2g} times the "
            "texels along each side, or repeat it more often",
        )
    elif texels.size:
        yield Finding("detail", "ok", f"a texel of the target covers {size:.2g} pixels")
    yield _check_noise(subject, detail, texel=size)


def _check_contrast(subject: SceneUnderTest, detail: TargetDetail, *, blur: float) -> Finding:
    pixel_mm = subject.pixel_footprint_m * 1e3
    lost = max(detail.blur_loss, 0.0)  # below 0 if what is beside an even target blurs into it
    loss = f"a blur of {blur:.2g} pixels removes {lost:.1%} of its square"
    text = f"contrast {detail.contrast:.2g}, {loss}"
    wanted = f"details of {pixel_mm:.3g} to {5 * pixel_mm:.3g} mm; a pixel sees {pixel_mm:.3g} mm"
    if not detail.contrast > MIN_CONTRAST:
        return Finding(
            "detail", "error", f"the target has almost no contrast ({detail.contrast:.2g}): give it {wanted}"
        )
    if not detail.blur_loss > MIN_LOSS:
        return Finding("detail", "error", f"{text}: it shows no defocus, give it {wanted}")
    if detail.blur_loss < WEAK_LOSS:
        return Finding("detail", "warning", f"{text}: its focus curve is flat, give it {wanted}")
    return Finding("detail", "ok", text)


def _check_noise(subject: SceneUnderTest, detail: TargetDetail, *, texel: float) -> Finding:
    noise = detail.noise * np.sqrt(subject.near_stacks[0].spec.samples / USUAL_SAMPLES)
    text = f"noise is {noise:.2g} of the contrast at {USUAL_SAMPLES} samples per pixel"
    if not noise > MAX_NOISE:
        return Finding("detail", "ok", text)
    small = texel < MIN_TEXEL
    cause = f"texels of {texel:.2g} pixels" if small else "detail much finer than a pixel, or small lamps"
    samples = USUAL_SAMPLES * (noise / MAX_NOISE) ** 2
    remedy = f"render {samples:,.0f} samples" if np.isfinite(noise) else "give it contrast"
    return Finding("detail", "warning", f"{text} ({cause}): use coarser detail or larger lamps, or {remedy}")


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


OTHERS = ("octave_structure", "structure_calibrated", "tenengrad")
EXACT, CLOSE, FAR = 0.15, 0.5, 1.5  # depths of focus
MIN_RIVAL = 0.8  # of the peak
MIN_RISE = 1.2  # the peak divided by the lowest value


def check_curve(subject: SceneUnderTest) -> Iterator[Finding]:
    """Check how far the peak is from the true focus, in depths of focus, and whether there are other peaks."""
    focus, curve = subject.stack.spec.focus, target_sharpness(subject, subject.stack)
    if not curve.max() > 0:
        yield Finding("curve", "error", "the target's box has no sharpness: it is dark or uniform")
        return
    half = subject.half_depth_of_focus
    near, fine = subject.near_stacks[0].spec.focus, [target_sharpness(subject, s) for s in subject.near_stacks]
    top = float(focus[curve.argmax()])
    if near[0] - half <= top <= near[-1] + half and all(0 < one.argmax() < one.size - 1 for one in fine):
        top = float(np.mean([_parabola_peak(near, one) for one in fine]))  # half the variance of one
    off = abs(top - subject.true_focus) / (2 * half)
    text = f"sharpest at {top:.3f} of the travel, {off:.2g} depths of focus from the true focus"
    if off <= CLOSE and (others := _peaks_of_others(subject)):
        shown = (f"{name} {abs(peak - subject.true_focus) / (2 * half):.2g}" for name, peak in others.items())
        text += f" by sd ({', '.join(shown)})"
    contrast = curve.max() / curve.min()
    other = "something else in the target's box is sharper there: move it, or give the target more contrast"
    if off > FAR:
        yield Finding("curve", "error", f"{text}: {other}")
    elif off > CLOSE:
        yield Finding("curve", "warning", f"{text}: {other}")
    elif off > EXACT:
        yield Finding(
            "curve",
            "warning",
            f"{text}, which weighs all pixels of the target alike: parts of it at other depths have more contrast; "
            "flatten the target or spread its contrast, or compare methods by the error from their own optimum in the "
            "records",
        )
    elif contrast < MIN_RISE:
        yield Finding(
            "curve",
            "warning",
            f"{text}; the peak is only {contrast:.2f} times the lowest value: add contrast, or open the lens",
        )
    else:
        yield Finding("curve", "ok", f"{text}; the peak is {contrast:.3g} times the lowest value")
    rivals = [
        k
        for k in range(1, len(curve) - 1)
        if curve[k] > max(curve[k - 1], curve[k + 1]) and abs(focus[k] - subject.true_focus) > 2 * FAR * half
        if curve[k] > MIN_RIVAL * curve.max()
    ]
    if rivals:
        k = max(rivals, key=lambda k: curve[k])
        yield Finding(
            "curve",
            "warning",
            f"a second peak at {focus[k]:.3f} of the travel is {curve[k] / curve.max():.0%} as high: {other}",
        )


def target_sharpness(subject: SceneUnderTest, stack: FocalStack) -> np.ndarray:
    """Return the variance of the charge in the target's box, divided by its squared mean, float64 (focus,).

    The ``sharpness`` of a stream has the same definition. The value is 0 if the box is black.
    """
    rows, columns = bounding_box(stack.target)
    seen = subject.collected_charge(stack)[:, rows, columns].astype(np.float64)
    square = seen.mean(axis=(1, 2)) ** 2
    return np.divide(seen.var(axis=(1, 2)), square, out=np.zeros_like(square), where=square > 0)


def _peaks_of_others(subject: SceneUnderTest) -> dict[str, float]:
    """Return where good measures of other kinds than ``sd`` peak near the true focus, if two stacks agree on it."""
    found = {}
    focus, half = subject.near_stacks[0].spec.focus, subject.half_depth_of_focus
    boxes = [(slice(None), *bounding_box(stack.target)) for stack in subject.near_stacks]
    charges = [subject.collected_charge(s)[box] for s, box in zip(subject.near_stacks, boxes, strict=True)]
    for name in OTHERS:
        curves = [
            np.array([score_picture(name, image * (COUNTS / charge.mean())) for image in charge]) for charge in charges
        ]
        if all(0 < one.argmax() < one.size - 1 for one in curves):
            peaks = [_parabola_peak(focus, one) for one in curves]
            if abs(peaks[0] - peaks[1]) < 2 * EXACT * half:
                found[name] = float(np.mean(peaks))
    return found


def _parabola_peak(focus: np.ndarray, curve: np.ndarray) -> float:
    """Return the position of the peak of a parabola through the highest value and its neighbours."""
    k = int(curve.argmax())
    below, at, above = curve[k - 1 : k + 2]
    bend = below - 2 * at + above
    return float(focus[k] + (focus[1] - focus[0]) * ((below - above) / (2 * bend) if bend < 0 else 0.0))


PATHS, SLOW_PATHS = 1 << 19, 1 << 15  # per image
MIN_SAMPLES, MAX_SAMPLES = 8, 256  # per pixel
SIGMAS = 3.0  # standard errors by which a measured error must exceed the error that the card states
MIN_ERROR = 0.001  # smallest error that is proposed for a card; a smaller one is not worth the rendering


@dataclass(frozen=True)
class SliceMismatch:
    """The error of the interpolation between two slices.

    Both attributes are NaN for black images, which have no mean to compare with.

    Attributes
    ----------
    mean_square : float
        Mean squared error divided by the squared mean, without noise; by chance it may be negative.
    standard_error : float
        Standard error of ``mean_square``.
    """

    mean_square: float
    standard_error: float

    def rms(self, sigmas: float = 0.0) -> float:
        """Return the rms error relative to the mean; ``sigmas`` standard errors are added to the mean squared error."""
        return float(np.sqrt(max(self.mean_square + sigmas * self.standard_error, 0.0)))

    @classmethod
    def from_pairs(cls, *pairs: tuple[np.ndarray, np.ndarray]) -> Self:
        """Return the error from two pairs (interpolated, rendered) of images (row, col) with independent noise."""
        first, second = (interpolated.astype(np.float64) - between for interpolated, between in pairs)
        mean = float(np.mean([between for _, between in pairs]))
        if not mean > 0:
            return cls(float("nan"), float("nan"))
        square = float((first * second).mean()) / mean**2
        # If a difference e has noise of variance s², the product at a pixel has the variance 2e²s² + s⁴.
        noise = ((first + second) / 2 * (first - second)) ** 2
        return cls(square, float(np.sqrt(noise.mean() / noise.size)) / mean**2)


def check_slices(subject: SceneUnderTest) -> Iterator[Finding]:
    """Compare the error of interpolating between slices with the card's ``interpolation_error``."""
    card = subject.scene.card
    if not subject.renderer.motions or card.slices_per_s is None:
        return
    found = {time_s: error for time_s in _times(subject) if (error := _measure_mismatch(subject, time_s))}
    dark = [time_s for time_s, error in found.items() if np.isnan(error.mean_square)]
    if dark:
        yield Finding(
            "slices",
            "error" if len(dark) == len(found) else "warning",
            f"the target's box is black at {dark[0]:.3g} s, so slices cannot be compared: turn a lamp to it, "
            "or give the scene light from all sides",
        )
    found = {time_s: error for time_s, error in found.items() if time_s not in dark}
    if not found:
        return  # this check or check_motion has reported the reason
    worst = max(found, key=lambda time_s: found[time_s].mean_square)
    error = found[worst]
    text = f"half way between two time slices the error is {error.rms():.2%} (rms, at {worst:.3g} s)"
    stated = card.interpolation_error
    upper = _round_up(error.rms(SIGMAS))
    if stated is None:
        yield Finding("slices", "warning", f"{text}: write interpolation_error: {upper:g} on the card")
    elif error.rms(-SIGMAS) > stated:
        sufficient = card.slices_per_s * (error.rms() / stated) ** (1 / EDGE_POWER)
        yield Finding(
            "slices",
            "warning",
            f"{text}, the card says {stated:.2%}: write slices_per_s: {np.ceil(sufficient):.0f}, or "
            f"interpolation_error: {upper:g}",
        )
    else:
        yield Finding("slices", "ok", f"{text}, the card says {stated:.2%}")


def _measure_mismatch(subject: SceneUnderTest, time_s: float) -> SliceMismatch | None:
    """Return the error between the two slices around a moment; None if the target is not in the frame or in reach."""
    hz, renderer = subject.sensor.readout_hz, subject.renderer
    slices_per_s = subject.scene.card.slices_per_s or hz
    step = slice_starts(1, readout_hz=hz, slices_per_s=slices_per_s)[1]  # frames, as in a recipe
    last = max(int(motion_end_s(renderer.motions, recording_s=RECORDING_S) * hz) // step, 1)
    before = min(int(time_s * hz) // step, last - 1) * step / hz
    between, after = before + step / 2 / hz, before + step / hz
    seen = renderer.trace_geometry(time_s=between, allow_unseen_target=True)
    if not seen.target.any():
        return None
    truth = subject.in_focus.true_focus(seen.depth, seen.target)
    if not 0 <= truth <= 1:
        return None
    box = bounding_box(seen.target)
    paths = SLOW_PATHS if renderer.is_slow else PATHS
    samples = min(max(paths // math.prod(region_shape(box)), MIN_SAMPLES), MAX_SAMPLES)

    def render(at_s: float, run: int) -> np.ndarray:
        return renderer.render_region(truth, samples=samples, region=box, time_s=at_s, run=run)

    first, second = (((render(before, run) + render(after, run)) / 2, render(between, run)) for run in (1, 2))
    return SliceMismatch.from_pairs(first, second)


def _times(subject: SceneUnderTest) -> list[float]:
    """Return the first moment, the moment at which the scene is shown at rest, and the last moment, in seconds."""
    last = motion_end_s(subject.renderer.motions, recording_s=RECORDING_S)
    return sorted({0.0, min(max(subject.scene.card.still_s, 0.0), last), last})


def _round_up(error: float) -> float:
    """Return an error rounded up to two significant digits."""
    error = max(error, MIN_ERROR)
    unit = 10.0 ** (np.floor(np.log10(error)) - 1)
    return float(f"{np.ceil(error / unit - 1e-9) * unit:.6g}")
