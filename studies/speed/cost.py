"""What the scenes cost to render, in seconds of processor time: the table from which plans and shards estimate.

Each scene is rendered in six runs in a process of its own, after a small one that compiles: at rest with few pixels,
with all pixels, and with more samples; moving, one slice, several, and several with more samples. Five costs that are
not negative are fitted to them. Seconds are those of all threads; other work on the machine makes them longer by a
tenth or two, as threads share caches.
"""

import argparse
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.optimize import nnls

from saf_gen.camera import Sensor, get_sensor
from saf_gen.core.files import write_text
from saf_gen.generate.cost import (
    PATHS_PER_SAMPLE,
    PLANE_S_PER_PIXEL,
    SLICE_RAY_US,
    SLICE_S,
    TABLE,
    SceneCost,
    scene_costs,
)
from saf_gen.scene.scene_folder import Scene, find_scene, scene_names
from saf_gen.stack.focal_stack import WAVES, StackSpec
from saf_gen.stack.time_resolved import SHADING_MOMENTS, slice_moments
from studies.speed.bench import fresh

POSITIONS = 17  # more than LAYERED_POSITIONS
SAMPLES, SLICE_SAMPLES = (2, 32), (2, 16)
SLICES = 3
COARSE = 4  # pixels of small pictures are so many times as wide
HEAD = """\
# What each scene costs to render, by `python -m studies.speed.cost --write`, in seconds of one core of about 2.8 GHz
# (saf_gen.generate.cost.SceneCost): default members, 400x250 pixels. Shards are cut by these figures.
"""


def measure(name: str) -> SceneCost | None:
    """Return the costs of a scene, of the default member of its family; None for a thin section, which has no rays."""
    scene, sensor, n = find_scene(name), get_sensor("vidar_400x250"), COARSE
    coarse = replace(sensor, rows=sensor.rows // n, columns=sensor.columns // n, pitch_m=sensor.pitch_m * n)
    per_s = scene.card.slices_per_s

    def still(grid: Sensor, samples: int) -> StackSpec:
        return StackSpec.from_scene(
            scene,
            grid,
            positions=POSITIONS,
            samples=samples,
            max_depth=6,
            time_s=scene.card.still_s if per_s else 0.0,
            wavelength_m=sensor.wavelength_m,
        )

    few, many = SAMPLES
    if still(sensor, few).estimator == WAVES:
        return None
    runs = [[still(coarse, few)], [still(sensor, few)], [still(sensor, many)]]
    _render(scene, runs[0])  # compiles
    if per_s:
        times = [scene.card.still_s + n / per_s for n in range(SLICES)]
        middle = (POSITIONS // 2, POSITIONS // 2 + 1)

        def slices(samples: int) -> list[StackSpec]:
            moments = zip(times, slice_moments(times), strict=True)
            return [replace(still(sensor, samples), time_s=t, window=middle, moments_s=m) for t, m in moments]

        few, many = SLICE_SAMPLES
        _render(scene, slices(few)[:1])  # compiles
        runs += [slices(few)[:1], slices(few), slices(many)]
    seconds = np.array([_render(scene, specs) for specs in runs])
    planes = [sum(len(s.groups) * s.rows * s.columns * s.rendered_count for s in specs) for specs in runs]
    rest = np.maximum(seconds - 2 * PLANE_S_PER_PIXEL * np.array(planes), 0)  # that figure is of two cores
    found, _ = nnls(np.array([_units(specs) for specs in runs]) / seconds[:, None], rest / seconds)
    load, moment, pixel, ray, slice_ray = found.tolist()
    return SceneCost(load, 1e6 * pixel, 1e6 * ray, *((moment, 1e6 * slice_ray) if per_s else ()))


def _units(specs: Sequence[StackSpec]) -> list[float]:
    """Return how often a run has each cost: loading, loading a moment, pixels, rays at rest, rays of slices."""
    first = specs[0]
    pixels = first.rows * first.columns
    rays = pixels * len(first.groups) * first.samples
    if first.window is None:
        return [1, 0, pixels, rays, 0]
    count = len(specs)
    return [1, count, pixels * count, 0, rays * (count + (SHADING_MOMENTS - 1) * PATHS_PER_SAMPLE)]


def _render(scene: Scene, specs: Sequence[StackSpec]) -> float:
    """Return the processor time of all threads that rendering and storing stacks takes (s)."""
    from saf_gen.render import render_missing

    with TemporaryDirectory() as root:
        begin = time.process_time()
        render_missing(scene, specs, root=Path(root), backend_name="llvm")
        return time.process_time() - begin


def table_text(costs: dict[str, SceneCost]) -> str:
    """Return the table as YAML, a line for each scene, without slices that were not measured."""
    unmeasured, lines = {"slice_s": SLICE_S, "slice_ray_us": SLICE_RAY_US}, list[str]()
    for name, cost in sorted(costs.items()):
        measured = (f"{key}: {value:.3g}" for key, value in vars(cost).items() if value != unmeasured.get(key))
        lines.append(f"{name}: {{{', '.join(measured)}}}\n")
    return HEAD + "".join(lines)


def main(argv: Sequence[str] | None = None) -> None:
    """Measure the scenes that the arguments name, or all; with --write, each is put into the table once it is done."""
    parser = argparse.ArgumentParser(prog="python -m studies.speed.cost", description=__doc__.splitlines()[0])
    parser.add_argument("--scene", action="append", default=[], help="scene to measure (default: all); repeatable")
    parser.add_argument("--write", action="store_true", help=f"write them into {TABLE.name}")
    given = parser.parse_args(argv)
    costs = dict(scene_costs())
    for name in given.scene or scene_names():
        if (found := fresh(measure, find_scene(name).id)) is None:
            continue
        print(f"{name}: {found}", flush=True)
        costs[name] = found
        if given.write:
            write_text(TABLE, table_text(costs))


if __name__ == "__main__":
    from studies.speed import cost  # the processes that measure find its functions by this name

    cost.main()
