"""Map the bias of shared shading: the filtered estimator against 1,024 plain samples.

    python -m studies.speed.bias_maps [--out docs/pictures] [--references FOLDER] [--only fan-focus ...] [--small]

Each case is a scene at one position of its lens, on a crop of the sensor round the optical axis. Moving scenes are
rendered as time slices of 16 samples that share the shading of nine moments, at the time step of the card; scenes at
rest are rendered as complete stacks of 64 samples. The mean squared bias is the mean over pixels of the product of the
differences (filtered - plain) of two independent halves of all renders, in which the noise of both averages out: over
a crop, four times as many plain samples would change the rms by less than a hundredth of itself. The script prints the
root mean squared bias and noise over the mean, and the difference of means, for all pixels and for some kinds of
pixels, and writes bias.json and a map of each case. With --references, plain renders are stored in a folder and read
from there in later runs.
"""

import argparse
import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter, maximum_filter, minimum_filter

from saf_gen.camera import get_sensor
from saf_gen.render import one_pass
from saf_gen.render.scene_renderer import SceneRenderer
from saf_gen.scene.scene_folder import find_scene
from saf_gen.stack.time_resolved import SHADING_MOMENTS
from studies.drawing import panels, save

DOCS = Path(__file__).resolve().parents[2] / "docs" / "pictures"
POSITIONS = 129


@dataclass(frozen=True)
class Case:
    """A scene at one lens position."""

    scene: str
    away: float
    """Distance of the lens from best focus, as a fraction of the travel."""
    crop: tuple[int, int]
    """Rows and columns to render."""
    plain_depth: int = 6
    """Most segments of plain paths: more if paths pass through much glass, which shared shading does not count."""

    @property
    def name(self) -> str:
        """Name of the case on the command line and of its map."""
        return f"{self.scene}-{'quarter' if self.away else 'focus'}"


CASES = (
    Case("fan", 0.0, (170, 164)),
    Case("fan", 0.25, (170, 164)),
    Case("crossroad", 0.0, (172, 156)),
    Case("crossroad", 0.25, (172, 156)),
    Case("bookshelf", 0.0, (150, 220)),
    Case("speculars", 0.0, (230, 180)),
    Case("bottle", 0.0, (210, 150), plain_depth=32),
    Case("snowfall", 0.0, (170, 164)),
    Case("turntable", 0.0, (170, 164)),
)


@dataclass(frozen=True)
class Plan:
    """Numbers of renders and of samples per pixel."""

    plain: int = 4  # plain renders
    batch: int = 256  # samples of each plain render
    filtered: int = 4  # filtered renders
    slice_samples: int = 16
    still_samples: int = 64
    shrink: int = 1  # crops are smaller by this factor


SMALL = Plan(plain=2, batch=16, filtered=2, slice_samples=4, still_samples=4, shrink=8)


def render_case(case: Case, plan: Plan, *, references: Path | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return plain and filtered renders, float64 (run, row, col), and the depth map in metres, (row, col)."""
    sensor = get_sensor("vidar_400x250")
    rows, columns = (size // plan.shrink for size in case.crop)
    sensor = replace(sensor, rows=rows, columns=columns)
    made: dict[str, Any] = {"backend_name": "llvm", "wavelength_m": sensor.wavelength_m}
    renderer = SceneRenderer(find_scene(case.scene), sensor, **made)
    plain_renderer = SceneRenderer(find_scene(case.scene), sensor, max_depth=case.plain_depth, **made)
    seen = renderer.trace_geometry(allow_unseen_target=True)
    whole = SceneRenderer(find_scene(case.scene), get_sensor("vidar_400x250"), backend_name="llvm")
    told = whole.trace_geometry() if plan.shrink > 1 else seen
    truth = renderer.scene.build_drive().least_blur(told.depth[told.target])
    place = truth + (case.away if truth < 0.5 else -case.away)
    plane = min(round(place * (POSITIONS - 1)), POSITIONS - 2)
    window = plane, plane + 1
    plain = []
    for n in range(plan.plain):
        kept = references / f"{case.name.replace('-', '_')}_{n}.npy" if references else None
        if kept and kept.exists():
            plain.append(np.load(kept))
            continue
        options: dict[str, Any] = {"positions": POSITIONS, "samples": plan.batch, "seed": 1000 + n, "window": window}
        plain.append(one_pass.render_stack(plain_renderer.prepare(), **options)[0][0])
        if kept:
            kept.parent.mkdir(parents=True, exist_ok=True)
            np.save(kept, plain[-1])
    card, filtered = renderer.scene.card, []
    for run in range(plan.filtered):
        if renderer.motions and card.slices_per_s:
            stack = renderer.render_stack(
                seen,
                positions=POSITIONS,
                samples=plan.slice_samples,
                window=window,
                run=run,
                moments=SHADING_MOMENTS,
                step_s=1 / card.slices_per_s,
            )
            filtered.append(stack.radiance[:, 0].sum(axis=0, dtype=np.float64))
        else:
            stack = renderer.render_stack(seen, positions=POSITIONS, samples=plan.still_samples, run=run)
            filtered.append(stack.radiance[:, plane].sum(axis=0, dtype=np.float64))
    return np.array(plain, dtype=np.float64), np.array(filtered), seen.depth


@dataclass(frozen=True)
class Errors:
    """Errors of single filtered renders, relative to the mean of the plain renders."""

    bias: float
    """Rms of the bias; negative if noise hides it."""
    noise: float
    """Rms of the noise."""
    mean: float
    """Relative difference of the mean of all filtered renders."""
    share: float
    """Fraction of all pixels."""


def measure_errors(plain: np.ndarray, filtered: np.ndarray, mask: np.ndarray) -> Errors:
    """Return the errors of filtered renders (run, row, col) in the pixels of a mask; each kind needs two renders."""
    mean = plain.mean(axis=0)[mask].mean()
    (a, b), (c, d) = ((runs[::2].mean(axis=0), runs[1::2].mean(axis=0)) for runs in (filtered, plain))
    squared = (((a - c) * (b - d) + (a - d) * (b - c)) / 2)[mask].mean()
    return Errors(
        bias=float(np.sign(squared) * np.sqrt(np.abs(squared)) / mean),
        noise=float(np.sqrt(filtered.var(axis=0, ddof=1)[mask].mean()) / mean),
        mean=float(filtered.mean(axis=0)[mask].mean() / mean - 1),
        share=float(mask.mean()),
    )


def kinds_of_pixels(plain: np.ndarray, depth: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """Yield names and masks, bool (row, col), of kinds of pixels.

    The kinds are all pixels, outlines, the brightest and the darkest tenth outside outlines, and the rest.
    """
    picture = plain.mean(axis=0)
    outlines = maximum_filter(depth, 3) > 1.01 * minimum_filter(depth, 3)
    low, high = np.quantile(picture, (0.1, 0.9))
    yield "all", np.ones(picture.shape, dtype=bool)
    yield "outlines", outlines
    yield "bright", ~outlines & (picture > high)
    yield "dark", ~outlines & (picture < low)
    yield "rest", ~outlines & (picture >= low) & (picture <= high)


def draw(plain: np.ndarray, filtered: np.ndarray, path: Path, *, title: str, samples: int) -> None:
    """Draw the picture, and next to it the bias in per cent of the local mean."""
    picture = plain.mean(axis=0)
    local = np.maximum(gaussian_filter(picture, 4), 0.05 * picture.mean())
    bias = 100 * gaussian_filter(filtered.mean(axis=0) - picture, 0.7) / local
    figure, grid = panels(1, 2, width=6.75, height=0.5 + 3.1 * picture.shape[0] / picture.shape[1])
    grid[0, 0].imshow(np.clip(picture / np.quantile(picture, 0.98), 0, 1) ** 0.5, cmap="gray")
    grid[0, 0].set_title(f"{samples:,} plain samples")
    shown = grid[0, 1].imshow(bias, cmap="RdBu_r", vmin=-15, vmax=15)
    grid[0, 1].set_title(title)
    figure.colorbar(shown, ax=grid[0, 1], shrink=0.7, label="% of the mean round the pixel")
    for axes in grid.ravel():
        axes.set(xticks=[], yticks=[])
    save(figure, path)


def main(argv: list[str] | None = None, *, plan: Plan | None = None) -> None:
    """Measure, print and draw; tests pass another ``plan``."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=DOCS)
    parser.add_argument("--references", type=Path)
    parser.add_argument("--only", nargs="+", choices=[case.name for case in CASES])
    parser.add_argument("--small", action="store_true", help="use few samples, to test that the script runs")
    given = parser.parse_args(argv)
    plan = plan or (SMALL if given.small else Plan())
    given.out.mkdir(parents=True, exist_ok=True)
    kept = given.out / "bias.json"
    found = json.loads(kept.read_text()) if kept.exists() else {}
    for case in CASES:
        if given.only and case.name not in given.only:
            continue
        plain, filtered, depth = render_case(case, plan, references=given.references)
        found[case.name] = {}
        for kind, mask in kinds_of_pixels(plain, depth):
            if not mask.any():
                continue
            errors = measure_errors(plain, filtered, mask)
            found[case.name][kind] = vars(errors)
            figures = f"bias {errors.bias:7.2%}  noise {errors.noise:6.2%}  mean {errors.mean:+.2%}"
            print(f"{case.name:18} {kind:9} {errors.share:4.0%} of pixels: {figures}", flush=True)
        title, picture = f"bias of {case.name.replace('-', ', ')}", given.out / f"bias-{case.name}.png"
        draw(plain, filtered, picture, title=title, samples=plan.plain * plan.batch)
        kept.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
