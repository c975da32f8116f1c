"""Measure how the error of a focal stack falls with samples and time: one pass against Mitsuba's thin lens.

    python -m studies.speed.error [--out studies/speed/pictures] [--scene usaf_target] [--small]

The error is the root mean square over pixels of the difference from a thin-lens reference of 2,048 samples with other
seeds, after subtraction of the noise of the reference, as a fraction of the mean radiance, averaged over five
positions. The time is that of the complete stack; for the thin lens it is the mean time of the renders at the five
positions times the number of positions. The script writes error.json and error.png. The full size takes about five
minutes on two cores and needs LLVM.
"""

import argparse
import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from saf_gen.cli.doctor import describe_machine
from studies.drawing import BLUE, GREY, ORANGE, log_log, panels, save, slope
from studies.speed import stack
from studies.speed.bench import timed

HERE = Path(__file__).resolve().parent


@dataclass(frozen=True)
class Plan:
    """Sizes of the renders: by default 129 positions and 4 to 256 samples per pixel."""

    sensor: str = "vidar_400x250"
    positions: int = 129
    samples: tuple[int, ...] = (4, 8, 16, 32, 64, 128, 256)
    reference: int = 2048
    batch: int = 256


SMALL = Plan(positions=9, samples=(4, 8, 16), reference=64, batch=16)


def measure(plan: Plan, scene: str) -> dict[str, Any]:
    """Return the error and time of both renderers at every number of samples, as written to error.json."""
    setup, variant = stack.set_up_scene(plan.sensor, scene)
    positions = stack.nearest_positions(plan.positions)
    references = []
    for position in positions:
        references.append(stack.render_reference(setup, position, samples=plan.reference, batch=plan.batch)[0])
        print(f"reference at {position:.2f}: noise {100 * _relative_noise(references[-1]):.3g} %", flush=True)
    found: dict[str, Any] = {"scene": scene, "variant": variant, "positions": plan.positions, "places": positions}
    found |= {"reference_samples": plan.reference, "samples": list(plan.samples)}
    renderers = {"one_pass": _one_pass, "thin_lens": _thin_lens}
    for name, render in renderers.items():
        rows = [render(setup, plan, samples=samples, at=positions) for samples in plan.samples]
        errors = [
            [reference.relative_rms_error(image) for reference, image in zip(references, images, strict=True)]
            for images, _ in rows
        ]
        peak = np.array([np.quantile(r.radiance, 0.999) / r.radiance.mean() for r in references])
        found[name] = {
            "seconds": [took for _, took in rows],
            "error": [float(np.mean(e)) for e in errors],
            "psnr_db": [float(np.mean(20 * np.log10(peak / np.array(e)))) for e in errors],
            "error_at_places": errors,
        }
        for samples, took, error in zip(plan.samples, found[name]["seconds"], found[name]["error"], strict=True):
            print(f"{name}, {samples} samples: {took:.3g} s, error {100 * error:.3g} %", flush=True)
    found["slope_of_error"] = {name: slope(found["samples"], found[name]["error"]) for name in renderers}
    found["less_error_at_equal_time_db"] = _at_equal_time(found["one_pass"], found["thin_lens"])
    return found


def _relative_noise(reference: stack.Reference) -> float:
    return math.sqrt(reference.noise) / float(reference.radiance.mean())


def _one_pass(setup: Any, plan: Plan, *, samples: int, at: list[float]) -> tuple[list[np.ndarray], float]:
    """Return the images at these positions and the time of the stack, measured after a first run that compiles."""
    stack.render_one_pass(setup, plan.positions, samples=samples)
    whole, took = timed(stack.render_one_pass, setup, plan.positions, samples=samples)
    return [whole[round(position * (plan.positions - 1))] for position in at], took


def _thin_lens(setup: Any, plan: Plan, *, samples: int, at: list[float]) -> tuple[list[np.ndarray], float]:
    stack.render_thin_lens(setup, at[0], samples=samples, seed=0)
    render = stack.render_thin_lens
    rendered = [timed(render, setup, position, samples=samples, seed=0) for position in at]
    return [image for image, _ in rendered], plan.positions * float(np.mean([took for _, took in rendered]))


def _at_equal_time(ours: dict[str, Any], theirs: dict[str, Any]) -> dict[str, float]:
    """Return by how many decibels our error is below theirs, by time in seconds.

    Their error is interpolated between its points on logarithmic axes; times outside these points are left out.
    """
    times, errors = np.log(theirs["seconds"]), np.log(theirs["error"])
    order = np.argsort(times)
    return {
        f"{took:.3g}": float(20 * (np.interp(np.log(took), times[order], errors[order]) / math.log(10)))
        - 20 * math.log10(error)
        for took, error in zip(ours["seconds"], ours["error"], strict=True)
        if min(theirs["seconds"]) <= took <= max(theirs["seconds"])
    }


def draw(found: dict[str, Any], path: Path) -> None:
    """Draw the error against samples, and against the time of the complete stack."""
    figure, grid = panels(1, 2, width=9, height=3.8)
    for name, label, colour in (("thin_lens", "thin lens", ORANGE), ("one_pass", "one pass", BLUE)):
        percent = [100 * e for e in found[name]["error"]]
        label = f"{label}, slope {found['slope_of_error'][name]:.2f}"
        log_log(grid[0, 0], found["samples"], y=percent, colour=colour, label=label)
        log_log(grid[0, 1], found[name]["seconds"], y=percent, colour=colour)
    grid[0, 0].set(xlabel="samples per pixel", ylabel="error (% of mean radiance)", title="at equal samples")
    grid[0, 0].legend(frameon=False)
    grid[0, 1].set(xlabel=f"time of {found['positions']} positions (s)", title="at equal time")
    for n, took, error in zip(found["samples"], found["one_pass"]["seconds"], found["one_pass"]["error"], strict=True):
        if n in (found["samples"][0], found["samples"][-1]):
            grid[0, 1].annotate(f" {n}", (took, 100 * error), color=GREY)
    save(figure, path)


def main(argv: list[str] | None = None, *, plan: Plan | None = None) -> None:
    """Measure and write; tests pass another ``plan``."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=HERE / "pictures")
    parser.add_argument("--scene", default=stack.SCENE)
    parser.add_argument("--small", action="store_true", help="use few samples, to test that the script runs")
    given = parser.parse_args(argv)
    found = measure(plan or (SMALL if given.small else Plan()), given.scene)
    given.out.mkdir(parents=True, exist_ok=True)
    text = json.dumps({"machine": describe_machine()[0], **found}, indent=1, ensure_ascii=False)
    (given.out / "error.json").write_text(text + "\n")
    draw(found, given.out / "error.png")


if __name__ == "__main__":
    main()
