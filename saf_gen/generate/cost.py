"""What a stack costs to render, in seconds of two cores of 2.8 GHz with LLVM.

Shards are cut by the ratios of these costs, so the rates are never replaced by those of the machine at hand: all shards
must be run by one version of saf_gen. What a scene costs was measured once and stands in a table beside this module.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from statistics import median

from saf_gen.core.config.yaml_document import read_yaml
from saf_gen.optics.partial_coherence import samples_per_pixel
from saf_gen.stack.focal_stack import PICTURES, WAVES, StackSpec
from saf_gen.stack.second_render import count_slices_to_repeat, second_render
from saf_gen.stack.time_resolved import TimeResolvedStack

TABLE = Path(__file__).with_name("scene_costs.yaml")
CORES = 2
PLAIN_RAY_US = 0.8
"""Processor time of a light path that is traced and splatted alone."""
SLICE_S, SLICE_RAY_US = 0.6, 2.5
"""``slice_s`` and ``slice_ray_us`` of a scene that was not measured moving: the means of 985 slices
of other scenes. By scene, a ray took from 0.4 (fabric) to 1.1 (crossroad, rain_window) of that."""
WAVES_PER_S = 1.2e6
"""Samples of a thin section's picture at which the waves of a condenser are summed per second."""
PLANE_S_PER_PIXEL = 8e-8  # to sum and store a pixel at a focus position
PICTURE_S = 0.1  # to read and decode a photographed picture
PATHS_PER_SAMPLE = 0.25  # that shade the slices after a moment
PIXEL_FRAMES_PER_S = 0.7e9  # that one worker encodes, stores and verifies


@dataclass(frozen=True)
class SceneCost:
    """Processor time that a scene takes, in seconds or microseconds of one core.

    Attributes
    ----------
    load_s : float
        To load the scene, once for a stack or for a run of time slices.
    pixel_us : float
        Per pixel, for depth, target and shading, whatever the samples.
    ray_us : float
        Per pixel, sample and light group, at rest.
    slice_s, slice_ray_us : float
        To show the scene at another moment, and as ``ray_us``, in a time slice. It is less than at rest, because slices
        share the light paths of the moments before them.
    """

    load_s: float
    pixel_us: float
    ray_us: float
    slice_s: float = SLICE_S
    slice_ray_us: float = SLICE_RAY_US


@cache
def scene_costs() -> Mapping[str, SceneCost]:
    """Return the costs of the scenes that were measured, by name; the studies measure them."""
    return {name: SceneCost(**cost) for name, cost in read_yaml(TABLE).data.items()}


@cache
def _cost_of(scene: str) -> SceneCost:
    """Return the cost of a scene; if it was not measured, the medians of those that were at rest."""
    costs = scene_costs()
    return costs.get(scene) or SceneCost(
        *(median(vars(cost)[key] for cost in costs.values()) for key in ("load_s", "pixel_us", "ray_us"))
    )


def render_seconds(spec: StackSpec) -> float:
    """Return the approximate time to render a stack (s), or a time slice, without what comes before the first one."""
    pixels = spec.rows * spec.columns
    if spec.estimator == WAVES:
        waves = pixels * samples_per_pixel(spec.in_focus.imaging)
        return len(spec.groups) * spec.rendered_count * waves / WAVES_PER_S
    if spec.estimator == PICTURES:
        return spec.rendered_count * (PICTURE_S + pixels * PLANE_S_PER_PIXEL)
    cost = _cost_of(spec.scene)
    load_s = cost.load_s if spec.window is None else cost.slice_s
    planes = len(spec.groups) * spec.rendered_count * pixels * PLANE_S_PER_PIXEL
    rays = len(spec.groups) * pixels * spec.samples
    return (load_s + 1e-6 * (pixels * cost.pixel_us + rays * _ray_us(cost, spec))) / CORES + planes


def _ray_us(cost: SceneCost, spec: StackSpec) -> float:
    if spec.estimator == "plain":
        return PLAIN_RAY_US
    return cost.ray_us if spec.window is None else cost.slice_ray_us


def start_seconds(spec: StackSpec) -> float:
    """Return the time before a run of slices (s): to load the scene, and for the light paths of the moments before it.

    The first slice of a recording repeats its own moment. It is 0 for a stack of a scene at rest.
    """
    if spec.window is None:
        return 0.0
    cost = _cost_of(spec.scene)
    others = len({*spec.moments_s} - {spec.time_s})
    paths = max(len(spec.moments_s) - 1, 0) * spec.rows * spec.columns * spec.samples * PATHS_PER_SAMPLE
    rays_s = 1e-6 * len(spec.groups) * paths * _ray_us(cost, spec)
    return (cost.load_s + others * cost.slice_s + rays_s) / CORES


def load_seconds(spec: StackSpec) -> float:
    """Return the time to show the scene of a time slice once more (s)."""
    return _cost_of(spec.scene).slice_s / CORES


def grain_seconds(stack: TimeResolvedStack) -> float:
    """Return the time of the second render of a stack, or of a few slices that do not follow each other (s)."""
    if stack.specs[-1].estimator in (WAVES, PICTURES):
        return 0.0  # nothing is random, or can be repeated
    count = len(stack.specs)
    again = second_render(stack.specs[-1], slices=count)
    loaded_s = 0.0 if again.window is None else _cost_of(again.scene).load_s / CORES
    once = render_seconds(again) + start_seconds(again) - loaded_s
    return loaded_s + count_slices_to_repeat(count) * once
