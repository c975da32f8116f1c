"""Grain: do recordings with the usual numbers of samples show the scene, or the noise of the renderer?

Grain is measured from pairs of renders with independent noise: see :mod:`saf_gen.authoring.scene_grain`. The scene at
rest is rendered with an eighth of the usual samples. Its figures and the proposed numbers of samples assume that the
variance of grain is inversely proportional to the number of samples; evenly spread samples do better than that.
"""

import math
from collections.abc import Iterator, Mapping

from saf_gen.authoring import scene_grain
from saf_gen.authoring.checks._scene_finding import SceneFinding, scene_check_ok, scene_check_warning
from saf_gen.authoring.checks.scene_under_test import SLOW_SAMPLES, SceneUnderTest
from saf_gen.authoring.scene_grain import BEST_FOCUS, PositionGrain
from saf_gen.render.scene_renderer import SceneRenderer

SAMPLES = scene_grain.STILL_SAMPLES // 8
POSITIONS = 33  # in a stack over the whole travel, their number has little effect on the grain at each position


def check_grain(subject: SceneUnderTest) -> Iterator[SceneFinding]:
    """Compare the grain at the usual numbers of samples, at rest and in time slices, with the goals."""
    full_renderer = subject.renderer
    sensor = scene_grain.crop_sensor(subject.sensor, subject.depth_and_target.target)
    renderer = SceneRenderer(
        subject.scene, sensor, backend_name=full_renderer.backend_name, wavelength_m=full_renderer.wavelength_m
    )
    seen = renderer.trace_geometry()
    measured_positions = scene_grain.grain_positions(subject.true_focus)
    if renderer.is_slow:  # it renders position by position, so two positions have the same grain as in a full stack
        still_samples = slice_samples = SLOW_SAMPLES
        still = scene_grain.measure_slices(
            renderer, seen, measured_positions=measured_positions, positions=POSITIONS, samples=still_samples
        )
    else:
        still_samples, slice_samples = SAMPLES, scene_grain.SLICE_SAMPLES
        still = scene_grain.measure_still(
            renderer, seen, measured_positions=measured_positions, positions=POSITIONS, samples=still_samples
        )
    yield _compare_with_goals(still, samples=still_samples, usual=scene_grain.STILL_SAMPLES, moving=False)
    slices_per_s = subject.scene.card.slices_per_s
    if not (renderer.motions and slices_per_s):
        return
    moving = scene_grain.measure_slices(
        renderer,
        seen,
        measured_positions=measured_positions,
        positions=scene_grain.POSITIONS,
        samples=slice_samples,
        step_s=1 / slices_per_s,
    )
    yield _compare_with_goals(moving, samples=slice_samples, usual=scene_grain.SLICE_SAMPLES, moving=True)


def _compare_with_goals(found: Mapping[str, PositionGrain], *, samples: int, usual: int, moving: bool) -> SceneFinding:
    """Return the finding for ``usual`` samples, from grain that was measured with ``samples``."""
    fraction = samples / usual
    rms = found[BEST_FOCUS].box.rms.value * math.sqrt(fraction)
    what, key = ("time slices", "slice_samples") if moving else ("at rest", "samples")
    text = f"{what}, {usual} samples per pixel: noise of {rms:.2g} of the mean at best focus"
    figures = list(_figures_with_goals(found, fraction=fraction, moving=moving))
    if not figures:
        return scene_check_ok("grain", f"{text}; the target's box has no contrast to compare it with")
    over_goal, worst = max(figures)
    if over_goal <= 1:
        return scene_check_ok("grain", f"{text}, {worst}")
    enough = 2 ** math.ceil(math.log2(usual * over_goal))
    return scene_check_warning("grain", f"{text}, {worst}: use {key}: {enough} in a recipe, or larger lamps")


def _figures_with_goals(
    found: Mapping[str, PositionGrain], *, fraction: float, moving: bool
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
            goal = scene_grain.MAX_SLICE_RMS
            yield (rms / goal) ** 2, f"{rms:.2g} {at} (goal {goal:g})"
        if math.isfinite(contrast.high) and not (moving and position_name == BEST_FOCUS):
            goal = scene_grain.MAX_SLICE_CONTRAST if moving else scene_grain.MAX_STILL_CONTRAST
            over = contrast.value * fraction
            yield over / goal, f"{over:.2g} of the signal's squared contrast {at} (goal {goal:g})"
