"""Time slices: how far is the straight line between two of them from a render half way?

The error is the root mean square, over the box round the target, of the difference between the two slices
mixed half and half and a render at the moment between them, over the mean of that render; the lens focused on
the target, all lights at gain 1. Two pairs of pictures are rendered, their noise independent: the mean
product of their differences holds no noise. Half way a straight line is farthest from what moves steadily.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

import numpy as np

from saf_gen.authoring.checks._scene_finding import SceneFinding, error, ok, warning
from saf_gen.authoring.checks.scene_under_test import SceneUnderTest
from saf_gen.authoring.checks.target_motion import last_motion_s
from saf_gen.core.region import Region, target_bounding_box
from saf_gen.stack.time_resolved import time_slice_frames

__all__ = ["SliceMismatch", "check_slices", "measure_slice_mismatch"]

PATHS, SLOW_PATHS = 1 << 19, 1 << 15  # of a picture
FEWEST, MOST = 8, 256  # a pixel
SIGMAS = 3.0  # by which a figure lies above what the card says, to be told
EDGE = 1.5  # the error of an edge grows as the way between two slices to this power
LEAST = 0.001  # a smaller error is hardly worth a render


@dataclass(frozen=True)
class SliceMismatch:
    """square: the mean squared error over the squared mean, without noise (it may fall below 0).
    standard_error: its standard error. Both are NaN where the picture is black: it has no mean to compare
    with."""

    mean_square: float
    standard_error: float

    def rms(self, sigmas: float = 0.0) -> float:
        """The error, or that of so many standard errors more."""
        return float(np.sqrt(max(self.mean_square + sigmas * self.standard_error, 0.0)))

    @classmethod
    def from_pairs(cls, *pairs: tuple[np.ndarray, np.ndarray]) -> Self:
        """From two pairs of pictures (row, col), mixed and between, noise independent from pair to pair."""
        first, second = (mixed.astype(np.float64) - between for mixed, between in pairs)
        mean = float(np.mean([between for _, between in pairs]))
        if not mean > 0:
            return cls(float("nan"), float("nan"))
        square = float((first * second).mean()) / mean**2
        # With noise of variance s² over a difference e a pixel's product has the variance 2e²s² + s⁴.
        noise = ((first + second) / 2 * (first - second)) ** 2
        return cls(square, float(np.sqrt(noise.mean() / noise.size)) / mean**2)


def check_slices(subject: SceneUnderTest) -> Iterator[SceneFinding]:
    """The error of going from slice to slice, against the card's ``interpolation_error``."""
    card = subject.scene.card
    if not subject.renderer.motions or card.slices_per_s is None:
        return
    found = {
        time_s: mixed for time_s in _times(subject) if (mixed := measure_slice_mismatch(subject, time_s))
    }
    dark = [time_s for time_s, mixed in found.items() if np.isnan(mixed.mean_square)]
    if dark:
        told = error if len(dark) == len(found) else warning
        yield told(
            "slices",
            f"no light comes from the target's box at {dark[0]:.3g} s, and slices have nothing to be "
            "compared with: turn a lamp to it, or give the scene light from all sides",
        )
    found = {time_s: mixed for time_s, mixed in found.items() if time_s not in dark}
    if not found:
        return  # told here, or check_motion has told that the target is never there
    worst = max(found, key=lambda time_s: found[time_s].mean_square)
    mixed = found[worst]
    text = f"between two time slices the picture is {mixed.rms():.2%} off (rms, at {worst:.3g} s)"
    said = card.interpolation_error
    upper = _rounded_up(mixed.rms(SIGMAS))
    if said is None:
        yield warning("slices", f"{text}: write interpolation_error: {upper:g} on the card")
    elif mixed.rms(-SIGMAS) > said:
        enough = card.slices_per_s * (mixed.rms() / said) ** (1 / EDGE)
        yield warning(
            "slices",
            f"{text}, the card says {said:.2%}: write slices_per_s: {np.ceil(enough):.0f}, or "
            f"interpolation_error: {upper:g}",
        )
    else:
        yield ok("slices", f"{text}, the card says {said:.2%}")


def measure_slice_mismatch(subject: SceneUnderTest, time_s: float) -> SliceMismatch | None:
    """The error between the two slices round a moment; None where the target is out of sight or reach."""
    hz, renderer = subject.sensor.readout_hz, subject.renderer
    step = time_slice_frames(1, readout_hz=hz, slices_per_s=subject.scene.card.slices_per_s or hz)[
        1
    ]  # frames, as recipes have it
    last = max(int(last_motion_s(subject) * hz) // step, 1)
    before = min(int(time_s * hz) // step, last - 1) * step / hz
    between, after = before + step / 2 / hz, before + step / hz
    seen = renderer.trace_depth_and_target(time_s=between, allow_unseen_target=True)
    if not seen.target.any():
        return None
    truth = subject.drive.true_focus(seen.depth[seen.target])
    if not 0 <= truth <= 1:
        return None
    box = target_bounding_box(seen.target)
    samples = _samples(box, subject.renderer.is_slow)

    def picture(at_s: float, run: int) -> np.ndarray:
        return renderer.render_region(truth, samples=samples, region=box, time_s=at_s, run=run)

    first, second = (
        ((picture(before, run) + picture(after, run)) / 2, picture(between, run)) for run in (1, 2)
    )
    return SliceMismatch.from_pairs(first, second)


def _samples(box: Region, slow: bool) -> int:
    """A pixel: many in a small box, few in a large one."""
    pixels = (box[0].stop - box[0].start) * (box[1].stop - box[1].start)
    return min(max((SLOW_PATHS if slow else PATHS) // pixels, FEWEST), MOST)


def _times(subject: SceneUnderTest) -> list[float]:
    """The first moment, the one at which the scene stands where it stands still, the last."""
    last = last_motion_s(subject)
    return sorted({0.0, min(max(subject.scene.card.still_s, 0.0), last), last})


def _rounded_up(error: float) -> float:
    """To two digits."""
    error = max(error, LEAST)
    unit = 10.0 ** (np.floor(np.log10(error)) - 1)
    return float(f"{np.ceil(error / unit - 1e-9) * unit:.6g}")
