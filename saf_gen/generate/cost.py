"""What a stack costs to render, in seconds of two cores of 2.8 GHz with LLVM.

Shards are cut by the ratios of these costs, so the rates are never replaced by those of the machine at hand: all shards
must be run by one version of saf_gen.
"""

from saf_gen.optics.partial_coherence import samples_per_pixel
from saf_gen.stack.focal_stack import WAVES, StackSpec
from saf_gen.stack.second_render import count_slices_to_repeat, second_render
from saf_gen.stack.time_resolved import TimeResolvedStack

PATHS_PER_S = 2.5e6  # plain light paths that both cores together trace and splat
FILTERED_TIME = 3.1
"""Time of a filtered sample divided by the time of a plain sample: the mean of the 985 test slices of saf_bench-v2.

By scene it is 1.3 (fabric), 1.6 to 2 (two_depths, gears), 2.7 to 3.5 (cardiac_muscle, crossroad, rain_window), and 11
for a target that is seen through a glass bottle."""
WAVES_PER_S = 1.2e6
"""Samples of a thin section's picture at which the waves of a condenser are summed per second."""
LOAD_S = 0.3  # for a scene under one light group
PLANE_S_PER_PIXEL = 8e-8  # to sum and store a pixel at a focus position
PATHS_PER_SAMPLE = 0.25  # that shade the slices after a moment
PIXEL_FRAMES_PER_S = 0.7e9  # that one worker encodes, stores and verifies


def render_seconds(spec: StackSpec) -> float:
    """Return the approximate time to render a stack (s)."""
    pixels = spec.rows * spec.columns
    if spec.estimator == WAVES:
        waves = pixels * samples_per_pixel(spec.in_focus.imaging)
        return len(spec.groups) * spec.rendered_count * waves / WAVES_PER_S
    sample = (FILTERED_TIME if spec.estimator == "filtered" else 1.0) / PATHS_PER_S
    planes = spec.rendered_count * PLANE_S_PER_PIXEL
    return len(spec.groups) * (LOAD_S + pixels * (spec.samples * sample + planes))


def start_seconds(spec: StackSpec) -> float:
    """Return the time of the light paths of the moments before a slice (s); the first slice repeats its own moment."""
    others = len({*spec.moments_s} - {spec.time_s})
    paths = max(len(spec.moments_s) - 1, 0) * spec.rows * spec.columns * spec.samples * PATHS_PER_SAMPLE
    return len(spec.groups) * (others * LOAD_S + paths / PATHS_PER_S)


def grain_seconds(stack: TimeResolvedStack) -> float:
    """Return the time of the second render of a stack, or of a few slices that do not follow each other (s)."""
    if stack.specs[-1].estimator == WAVES:
        return 0.0  # nothing is random
    count = len(stack.moments)
    again = second_render(stack.specs[-1], slices=count)
    return count_slices_to_repeat(count) * (render_seconds(again) + start_seconds(again))
