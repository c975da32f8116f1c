"""Grain: do recordings with the usual numbers of samples show the scene, or the renderer's noise?

Grain is measured from pairs of renders with independent noise, see :mod:`saf_gen.authoring.scene_grain`. The scene at
rest is rendered with an eighth of the usual samples; that grain falls as one over the samples is the law by which both
its figures and the proposed numbers of samples are computed; samples that are spread evenly do better than the law.
"""

import math
from collections.abc import Iterator, Mapping

from saf_gen.authoring import scene_grain
from saf_gen.authoring.checks._scene_finding import SceneFinding, scene_check_ok, scene_check_warning
from saf_gen.authoring.checks.scene_under_test import SLOW_SAMPLES, SceneUnderTest
from saf_gen.authoring.scene_grain import BEST_FOCUS, PlaceGrain
from saf_gen.render.scene_renderer import SceneRenderer

SAMPLES = scene_grain.STILL_SAMPLES // 8
POSITIONS = 33  # in a stack over the whole travel, the number of positions hardly matters to the grain of one


def check_scene_grain(subject: SceneUnderTest) -> Iterator[SceneFinding]:
    """Check the grain at the usual samples, at rest and in time slices, against the goals."""
    whole = subject.renderer
    sensor = scene_grain.crop_sensor_for_scene_grain(subject.sensor, subject.depth_and_target.target)
    renderer = SceneRenderer(subject.scene, sensor, backend_name=whole.backend_name, wavelength_m=whole.wavelength_m)
    seen = renderer.trace_depth_and_target()
    places = scene_grain.list_scene_grain_places(subject.true_focus)
    if renderer.is_slow:  # it renders position by position: two of them have the grain of a whole stack
        still_samples = slice_samples = SLOW_SAMPLES
        still = scene_grain.measure_scene_grain_of_slices(
            renderer, seen, places=places, positions=POSITIONS, samples=still_samples
        )
    else:
        still_samples, slice_samples = SAMPLES, scene_grain.SLICE_SAMPLES
        still = scene_grain.measure_still_scene_grain(
            renderer, seen, places=places, positions=POSITIONS, samples=still_samples
        )
    yield _compare_with_goals(still, samples=still_samples, usual=scene_grain.STILL_SAMPLES, moving=False)
    slices_per_s = subject.scene.card.slices_per_s
    if not (renderer.motions and slices_per_s):
        return
    moving = scene_grain.measure_scene_grain_of_slices(
        renderer, seen, places=places, positions=scene_grain.POSITIONS, samples=slice_samples, step_s=1 / slices_per_s
    )
    yield _compare_with_goals(moving, samples=slice_samples, usual=scene_grain.SLICE_SAMPLES, moving=True)


def _compare_with_goals(found: Mapping[str, PlaceGrain], *, samples: int, usual: int, moving: bool) -> SceneFinding:
    """Return the finding on grain that was measured with ``samples``, at ``usual`` samples."""
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
    return scene_check_warning("grain", f"{text}, {worst}: {key}: {enough} in a recipe would do, or larger lamps")


def _figures_with_goals(
    found: Mapping[str, PlaceGrain], *, fraction: float, moving: bool
) -> Iterator[tuple[float, str]]:
    """Yield the variance of each figure over its goal's, and the figure in words.

    ``fraction`` is that of the samples measured with to the usual ones. A contrast that noise hides has no figure.
    """
    for place, grain in found.items():
        at = f"at {place}" if place == BEST_FOCUS or place.startswith("position") else place
        rms, contrast = grain.box.rms.value * math.sqrt(fraction), grain.box.noise_over_signal["contrast"]
        if moving and math.isfinite(rms):
            goal = scene_grain.MAX_SLICE_RMS
            yield (rms / goal) ** 2, f"{rms:.2g} {at} (goal {goal:g})"
        if math.isfinite(contrast.high) and not (moving and place == BEST_FOCUS):
            goal = scene_grain.MAX_SLICE_CONTRAST if moving else scene_grain.MAX_STILL_CONTRAST
            over = contrast.value * fraction
            yield over / goal, f"{over:.2g} of the signal's squared contrast {at} (goal {goal:g})"
