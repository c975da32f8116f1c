"""Measure how time and memory grow with focus positions, samples, frames, pixels and sequences.

    python -m studies.speed.growth [--out studies/speed/pictures] [--only positions]... [--small]

Every point is measured in a fresh process, so that its peak memory is not that of another point. The script writes
growth.json and growth.png, with time above and peak memory below, both axes logarithmic, and the exponent of the last
three points in each title. The full size takes about eight minutes on two cores and needs LLVM; --small takes half a
minute.
"""

import argparse
import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from saf_gen.benchmark.evaluate import evaluate
from saf_gen.camera import get_sensor
from saf_gen.cli.doctor import describe_machine
from saf_gen.generate.recipe import read_recipe
from saf_gen.generate.resolve import resolve_recipe
from saf_gen.generate.run import generate
from studies.drawing import BLUE, ORANGE, log_log, panels, save, slope, wide
from studies.speed import stack, synthetic
from studies.speed.bench import fresh, peak_gib, timed

HERE = Path(__file__).resolve().parent
CURVES = ("positions", "samples", "frames", "pixels", "sequences")
Measured = tuple[float, float]
"""Seconds, and peak memory in GiB."""


@dataclass(frozen=True)
class Plan:
    """Sizes along each curve, and the sizes that stay fixed along the others."""

    sensor: str = "vidar_400x250"
    positions: tuple[int, ...] = (17, 33, 65, 129, 257, 513, 1025)
    samples: tuple[int, ...] = (16, 64, 256, 1024)
    frames: tuple[int, ...] = (2_000, 6_000, 20_000, 60_000, 200_000)
    arrays: tuple[tuple[int, int], ...] = ((63, 100), (125, 200), (250, 400), (500, 800), (1000, 1000))
    sequences: tuple[int, ...] = (1, 2, 4, 8, 16)
    usual_positions: int = 129
    usual_samples: int = 256
    few_frames: int = 4_000
    recipe: str = str(HERE.parents[1] / "recipes" / "quickstart.yaml")


SMALL = Plan(
    positions=(3, 5, 9),
    samples=(1, 2, 4),
    frames=(400, 800, 1600),
    arrays=((16, 32), (32, 64), (64, 128)),
    sequences=(1, 2),
    usual_positions=5,
    usual_samples=2,
    few_frames=400,
)


def render(sensor: str, positions: int, samples: int) -> Measured:
    """Render a focal stack in one pass, after a first run that compiles."""
    setup, _ = stack.set_up_scene(sensor)
    stack.render_one_pass(setup, positions, samples=samples)
    _, took = timed(stack.render_one_pass, setup, positions, samples=samples)
    return took, peak_gib()


def record(sensor: str, shape: tuple[int, int], positions: int, frames: int) -> Measured:
    """Encode a sequence with all noise and store it, with the charge of all positions in memory."""
    camera = replace(get_sensor(sensor), rows=shape[0], columns=shape[1])
    charge = synthetic.sweep_charge(camera, positions)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "sequence.h5"
        synthetic.record_sweep(path, camera, charge=charge, frames=16)  # compiles
        _, took = timed(synthetic.record_sweep, path, camera, charge=charge, frames=frames)
    return took, peak_gib()


def dataset(recipe: str, stacks: str, sequences: int) -> Measured:
    """Generate and evaluate a dataset whose stacks exist; the peak memory is that of the largest process."""
    with TemporaryDirectory() as temporary:
        folder = Path(temporary) / "dataset"
        shutil.copytree(stacks, folder / "stacks")
        _, took = timed(_make_dataset, recipe, sequences, folder=folder)
    return took, peak_gib()


def _make_dataset(recipe: str, sequences: int, *, folder: Path) -> None:
    """Generate and evaluate ``sequences`` sequences of a recipe's first scene under its first light."""
    data = read_recipe(recipe).model_dump(mode="json")
    split = next(iter(data["splits"].values()))
    data["splits"] = {"test": {"scenes": split["scenes"][:1], "lights": split["lights"][:1], "repeats": sequences}}
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "recipe.yaml"
    path.write_text(json.dumps(data))  # JSON is YAML
    result = generate(resolve_recipe(path), folder)
    for error in result.failed.values():
        raise error
    evaluate(folder)


Point = tuple[int, Callable[..., Measured], tuple[Any, ...]]
"""Size along a curve, the function that measures it, and its arguments."""


def points(curve: str, plan: Plan, *, stacks: Path) -> list[Point]:
    """Return all points of a curve; the stacks of the datasets are rendered once, into ``stacks``."""
    usual = plan.usual_positions
    if curve == "positions":
        return [(n, render, (plan.sensor, n, plan.usual_samples)) for n in plan.positions]
    if curve == "samples":
        return [(n, render, (plan.sensor, usual, n)) for n in plan.samples]
    if curve == "frames":
        camera = get_sensor(plan.sensor)
        return [(n, record, (plan.sensor, (camera.rows, camera.columns), usual, n)) for n in plan.frames]
    if curve == "pixels":
        return [(h * w, record, (plan.sensor, (h, w), usual, plan.few_frames)) for h, w in plan.arrays]
    _make_dataset(plan.recipe, 1, folder=stacks.parent)
    return [(n, dataset, (plan.recipe, str(stacks), n)) for n in plan.sequences]


def measure(plan: Plan, curves: list[str], *, call: Callable[..., Measured]) -> dict[str, Any]:
    """Return the curves as written to growth.json; ``call`` calls a function, by default in a fresh process."""
    found: dict[str, Any] = {}
    with TemporaryDirectory() as temporary:
        for curve in curves:
            sizes, took, peaks = list[float](), list[float](), list[float]()
            for size, function, given in points(curve, plan, stacks=Path(temporary) / "dataset" / "stacks"):
                seconds, gib = call(function, *given)
                print(f"{curve} {size}: {seconds:.3g} s, {gib:.3g} GiB", flush=True)
                sizes, took, peaks = [*sizes, size], [*took, seconds], [*peaks, gib]
            found[curve] = {"size": sizes, "seconds": took, "peak_gib": peaks}
            found[curve] |= {"slope_seconds": slope(sizes, took), "slope_peak_gib": slope(sizes, peaks)}
    return found


def draw(found: dict[str, Any], path: Path) -> None:
    """Draw a column for each curve, with time above and peak memory below."""
    figure, grid = panels(2, len(found), width=1.85 * len(found), height=4.8)
    figure.suptitle("Growth of time and memory with the size of the work; slope: the exponent at the end", fontsize=11)
    for column, (curve, data) in enumerate(found.items()):
        for row, (key, unit, colour) in enumerate(
            (("seconds", "time (s)", BLUE), ("peak_gib", "peak memory (GiB)", ORANGE))
        ):
            axes = grid[row, column]
            log_log(axes, data["size"], y=data[key], colour=colour)
            axes.set_title(f"slope {data[f'slope_{key}']:.2f}")
            wide(axes, data[key])
            if column == 0:
                axes.set_ylabel(unit)
            if row == 1:
                axes.set_xlabel(curve)
    save(figure, path)


def main(argv: list[str] | None = None, *, plan: Plan | None = None, call: Callable[..., Measured] = fresh) -> None:
    """Measure and write; tests pass another ``plan``, and a ``call`` that stays in their process."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=HERE / "pictures")
    parser.add_argument("--only", action="append", choices=CURVES, help="measure only this curve; may be repeated")
    parser.add_argument("--small", action="store_true", help="use small sizes, to test that the script runs")
    given = parser.parse_args(argv)
    chosen = plan or (SMALL if given.small else Plan())
    curves = given.only or list(CURVES)
    found = measure(chosen, curves, call=call)
    given.out.mkdir(parents=True, exist_ok=True)
    text = json.dumps({"machine": describe_machine()[0], "curves": found}, indent=1, ensure_ascii=False)
    (given.out / "growth.json").write_text(text + "\n")
    draw(found, given.out / "growth.png")


if __name__ == "__main__":
    main()
