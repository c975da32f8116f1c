"""Grain: do recordings with the usual numbers of samples show the scene, or the noise of the renderer?

Grain is measured at best focus, a quarter of the travel away from it towards the farther end, and at both ends of the
travel, from pairs of renders with independent noise (:mod:`saf_gen.render.grain`). A scene at rest is rendered at all
positions at once, and a time slice at the two positions around the lens. The scene at rest is rendered with an eighth
of the usual samples. Its figures and the proposed numbers of samples assume that the variance of grain is inversely
proportional to the number of samples; evenly spread samples do better than that.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from saf_gen.authoring.checks.subject import SLOW_SAMPLES, SceneUnderTest
from saf_gen.camera import Sensor
from saf_gen.core.finding import Finding
from saf_gen.core.region import bounding_box
from saf_gen.render import make_renderer
from saf_gen.render.grain import TargetGrain, measure_slices, measure_still

BEST_FOCUS, QUARTER_AWAY = "best focus", "a quarter away"
QUARTER_TRAVEL = 0.25
STILL_SAMPLES, SLICE_SAMPLES, POSITIONS = 64, 16, 129  # as in the project's recipes
MAX_SLICE_RMS, MAX_SLICE_CONTRAST, MAX_STILL_CONTRAST = 0.04, 0.05, 0.01
"""Goals: relative rms noise in time slices, and noise over signal in the squared contrast of slices and stills."""
TRIED_SAMPLES = STILL_SAMPLES // 8
TRIED_POSITIONS = 33  # in a stack over the whole travel, their number has little effect on the grain at each position


def check_grain(subject: SceneUnderTest) -> Iterator[Finding]:
    """Compare the grain at the usual numbers of samples, at rest and in time slices, with the goals."""
    full_renderer = subject.renderer
    sensor = crop_sensor(subject.sensor, subject.depth_and_target.target)
    renderer = make_renderer(
        subject.scene, sensor, backend_name=full_renderer.backend_name, wavelength_m=full_renderer.wavelength_m
    )
    seen = renderer.trace_geometry()
    at = grain_positions(subject.true_focus)
    if renderer.is_slow:  # it renders position by position, so two positions have the same grain as in a full stack
        still_samples = slice_samples = SLOW_SAMPLES
        still = measure_slices(renderer, seen, at=at, positions=TRIED_POSITIONS, samples=still_samples)
    else:
        still_samples, slice_samples = TRIED_SAMPLES, SLICE_SAMPLES
        still = measure_still(renderer, seen, at=at, positions=TRIED_POSITIONS, samples=still_samples)
    name = subject.scene.id
    yield _compare_with_goals(name, still, samples=still_samples, usual=STILL_SAMPLES, moving=False)
    slices_per_s = subject.scene.card.slices_per_s
    if not (renderer.motions and slices_per_s):
        return
    moving = measure_slices(renderer, seen, at=at, positions=POSITIONS, samples=slice_samples, step_s=1 / slices_per_s)
    yield _compare_with_goals(name, moving, samples=slice_samples, usual=SLICE_SAMPLES, moving=True)


def _compare_with_goals(
    scene: str, found: Mapping[str, TargetGrain], *, samples: int, usual: int, moving: bool
) -> Finding:
    """Return the finding for ``usual`` samples, from grain that was measured with ``samples``."""
    fraction = samples / usual
    rms = found[BEST_FOCUS].box.rms.value * math.sqrt(fraction)
    what, key = ("time slices", "slice_samples") if moving else ("at rest", "samples")
    text = f"{what}, {usual} samples per pixel: noise of {rms:.2g} of the mean at best focus"
    figures = list(_figures_with_goals(found, fraction=fraction, moving=moving))
    if not figures:
        return Finding("grain", "ok", f"{text}; the target's box has no contrast to compare it with")
    over_goal, worst = max(figures)
    if over_goal <= 1:
        return Finding("grain", "ok", f"{text}, {worst}")
    enough = 2 ** math.ceil(math.log2(usual * over_goal))
    wanted = f"it takes about {enough} samples (render: {{per_scene: {{{scene}: {{{key}: {enough}}}}}}} in a recipe)"
    return Finding("grain", "warning", f"{text}, {worst}: {wanted}, or larger lamps")


def _figures_with_goals(
    found: Mapping[str, TargetGrain], *, fraction: float, moving: bool
) -> Iterator[tuple[float, str]]:
    """Yield, for each figure that has a goal, its variance divided by the goal's variance, and the figure in words.

    ``fraction`` is the number of samples in the measurement divided by the usual number. A contrast that noise hides
    gives no figure.
    """
    for position_name, grain in found.items():
        at = (
            f"at {position_name}"
            if position_name == BEST_FOCUS or position_name.startswith("position")
            else position_name
        )
        rms, contrast = grain.box.rms.value * math.sqrt(fraction), grain.box.noise_over_signal["contrast"]
        if moving and math.isfinite(rms):
            goal = MAX_SLICE_RMS
            yield (rms / goal) ** 2, f"{rms:.2g} {at} (goal {goal:g})"
        if math.isfinite(contrast.high) and not (moving and position_name == BEST_FOCUS):
            goal = MAX_SLICE_CONTRAST if moving else MAX_STILL_CONTRAST
            over = contrast.value * fraction
            yield over / goal, f"{over:.2g} of the signal's squared contrast {at} (goal {goal:g})"


def grain_positions(true_focus: float) -> dict[str, float]:
    """Return the positions (0 to 1) at which grain is measured, by name."""
    away = true_focus + QUARTER_TRAVEL if true_focus < 0.5 else true_focus - QUARTER_TRAVEL
    return {BEST_FOCUS: true_focus, QUARTER_AWAY: away, "position 0": 0.0, "position 1": 1.0}


def crop_sensor(sensor: Sensor, target: np.ndarray) -> Sensor:
    """Return the sensor cropped to a target, bool (row, col), by the same number of pixels on opposite sides.

    The optical axis remains in the middle of the sensor, so the remaining pixels see the same as before.
    """
    rows, columns = bounding_box(target)
    sizes = []
    for span, size in ((rows, sensor.rows), (columns, sensor.columns)):
        sizes.append(size - 2 * min(span.start, size - span.stop))
    return replace(sensor, rows=sizes[0], columns=sizes[1])
