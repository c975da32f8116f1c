"""Time slices: how much does interpolation between two slices differ from a render half way between them?

The error is the root mean square difference, over the target's bounding box, between the mean of two slices and a
render at the moment half way between them, divided by the mean of that render. The lens is focused on the target, and
all lights have gain 1. Two pairs of images with independent noise are rendered; the mean product of their differences
is free of noise. For steady motion, the error of interpolation is largest half way.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

import numpy as np

from saf_gen.authoring.checks._scene_finding import SceneFinding, scene_check_ok, scene_check_warning
from saf_gen.authoring.checks._scene_finding import scene_check_error as error_finding
from saf_gen.authoring.checks.scene_under_test import SceneUnderTest
from saf_gen.authoring.checks.target_motion import RECORDING_S
from saf_gen.core.region import bounding_box, region_shape
from saf_gen.scene.keyframes import motion_end_s
from saf_gen.scene.scene_folder import EDGE_POWER
from saf_gen.stack.time_resolved import slice_starts

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


def check_slices(subject: SceneUnderTest) -> Iterator[SceneFinding]:
    """Compare the error of interpolating between slices with the card's ``interpolation_error``."""
    card = subject.scene.card
    if not subject.renderer.motions or card.slices_per_s is None:
        return
    found = {time_s: error for time_s in _times(subject) if (error := _measure_mismatch(subject, time_s))}
    dark = [time_s for time_s, error in found.items() if np.isnan(error.mean_square)]
    if dark:
        finding = error_finding if len(dark) == len(found) else scene_check_warning
        yield finding(
            "slices",
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
        yield scene_check_warning("slices", f"{text}: write interpolation_error: {upper:g} on the card")
    elif error.rms(-SIGMAS) > stated:
        sufficient = card.slices_per_s * (error.rms() / stated) ** (1 / EDGE_POWER)
        yield scene_check_warning(
            "slices",
            f"{text}, the card says {stated:.2%}: write slices_per_s: {np.ceil(sufficient):.0f}, or "
            f"interpolation_error: {upper:g}",
        )
    else:
        yield scene_check_ok("slices", f"{text}, the card says {stated:.2%}")


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
    truth = subject.drive.true_focus(seen.depth[seen.target])
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
