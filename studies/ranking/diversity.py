"""Whether the members of a grammar of scenes are as diverse as scenes made by hand, by features that know no method.

    python -m studies.ranking.diversity --beside RECIPE --out FOLDER [--recipe NAME] [--split NAME] [--dataset FOLDER]

Each member of the recipe's grammar, and each scene of the test split of ``--beside``, is rendered at rest with few
samples, unless the focal stack of a generated dataset shows it; what is measured is kept in FOLDER, and a run that is
stopped goes on there. The features, in the box around the target and without noise of the sensor:

- ``slope``: exponent of the power spectrum at best focus, from 0.03 to 0.35 cycles a pixel (power ~ frequency^slope);
- ``contrast``: SD divided by mean at best focus;
- ``depth``: depths of the target's pixels from the 2nd to the 98th percentile, in half depths of focus;
- ``counts``: mean counts of a pixel in 100 readouts, by the exposure of the recipe;
- ``peak``: squared contrast at its largest over the travel, divided by its smallest.
"""

import argparse
import csv
import json
import resource
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from saf_gen.authoring.checks.subject import SceneUnderTest
from saf_gen.core.region import bounding_box
from saf_gen.generate.resolve import ResolvedSequence, resolve_recipe
from saf_gen.stack.focal_stack import FocalStack, StackStore

FEATURES = ("slope", "contrast", "depth", "counts", "peak")
WINDOW = 100  # readouts
BAND = (0.03, 0.35)  # cycles a pixel
POSITIONS, SAMPLES = 49, 16
MIDDLE = (2, 98)  # percentiles of the members between which a scene made by hand should lie


@dataclass(frozen=True)
class Row:
    """What is measured of one scene, and its picture at best focus, float32 (row, col)."""

    name: str
    features: dict[str, float]
    cpu_s: float
    picture: np.ndarray


def measure(sequence: ResolvedSequence, stacks: Path | None = None) -> Row:
    """Return the features of the scene of a sequence, at rest, with all its lamps on.

    The scene is rendered, unless ``stacks``, the folder of a dataset's stacks, holds it.
    """
    begun = _cpu_s()
    stack = _find_stack(sequence, stacks)
    criterion, depth, target = stack.spec.in_focus, stack.depth, stack.target
    focus = criterion.true_focus(depth, target)
    box = bounding_box(target)
    pictures = stack.radiance.sum(axis=0, dtype=np.float64)
    inside = pictures[(slice(None), *box)]
    squared = inside.var(axis=(1, 2)) / inside.mean(axis=(1, 2)) ** 2
    at = int(np.abs(stack.spec.focus - focus).argmin())
    low, high = criterion.depth_of_focus(depth, target)
    ends = stack.spec.drive.best_position(np.percentile(depth[target], MIDDLE))
    rate = sequence.planned.mean_rate or np.nan
    features = {
        "slope": spectral_slope(inside[at]),
        "contrast": float(np.sqrt(squared[at])),
        "depth": float(abs(ends[1] - ends[0]) / ((high - low) / 2)),
        "counts": float(WINDOW * rate * inside[at].mean() / pictures[at][target].mean()),
        "peak": float(squared.max() / squared.min()),
    }
    return Row(sequence.planned.id, features, _cpu_s() - begun, pictures[at].astype(np.float32))


def _find_stack(sequence: ResolvedSequence, stacks: Path | None) -> FocalStack:
    """Return the stack of a sequence of a still scene: that of a dataset, or one with few samples and positions."""
    if stacks is not None and (stored := StackStore(stacks, sequence.time_stack.specs[0])).has_all_pictures():
        return stored.load().without_margin()
    subject = SceneUnderTest(sequence.scene, sequence.sensor)
    seen = subject.depth_and_target
    return subject.renderer.render_stack(seen, positions=POSITIONS, samples=SAMPLES, as_one_group=True)


def spectral_slope(picture: np.ndarray) -> float:
    """Return the exponent of the power spectrum of a picture, float (row, col), fitted in BAND over equal octaves."""
    window = np.outer(*(np.hanning(n + 2)[1:-1] for n in picture.shape))
    mean = (picture * window).sum() / window.sum()
    power = np.abs(np.fft.fft2((picture - mean) * window)) ** 2
    frequency = np.hypot(*np.meshgrid(*(np.fft.fftfreq(n) for n in picture.shape), indexing="ij"))
    edges = np.geomspace(*BAND, 8)
    means = [
        (frequency[ring].mean(), power[ring].mean())
        for a, b in pairwise(edges)
        if (ring := (frequency >= a) & (frequency < b)).any()
    ]
    logs = np.log([m for m in means if m[1] > 0])
    return float(np.polyfit(logs[:, 0], logs[:, 1], 1)[0]) if len(logs) > 1 else np.nan


def one_each(sequences: Sequence[ResolvedSequence]) -> Iterator[ResolvedSequence]:
    """Yield the first sequence of each member at rest, which all lights share."""
    met = set()
    for one in sequences:
        key = (one.planned.split, one.planned.scene, json.dumps(one.planned.params, sort_keys=True))
        if one.planned.scene_motion == "static" and key not in met:
            met.add(key)
            yield one


def measure_all(sequences: Sequence[ResolvedSequence], kept: Path, *, stacks: Path | None = None) -> list[Row]:
    """Return the rows of all scenes; those that ``kept`` holds are read."""
    kept.mkdir(parents=True, exist_ok=True)
    rows = []
    for one in sequences:
        file = kept / f"{one.planned.split}-{one.planned.id}.npz"
        if not file.exists():
            row = measure(one, stacks)
            np.savez_compressed(file, picture=row.picture, cpu_s=row.cpu_s, **row.features)
            print(one.planned.id, {k: round(v, 3) for k, v in row.features.items()}, f"{row.cpu_s:.1f} s", flush=True)
        with np.load(file) as held:
            features = {name: float(held[name]) for name in FEATURES}
            rows.append(Row(one.planned.id, features, float(held["cpu_s"]), held["picture"]))
    return rows


def report(members: Sequence[Row], scenes: Sequence[Row]) -> str:
    """Return a Markdown table of the features of members, and of where each scene made by hand lies among them."""
    values = {name: np.array([row.features[name] for row in members]) for name in FEATURES}
    lines = ["| feature | 2 % | 25 % | median | 75 % | 98 % |", "|---" * 6 + "|"]
    for name, one in values.items():
        cells = " | ".join(f"{x:.3g}" for x in np.percentile(one, (2, 25, 50, 75, 98)))
        lines.append(f"| {name} | {cells} |")
    lines += ["", "| scene | " + " | ".join(FEATURES) + " | outside |", "|---" * (len(FEATURES) + 2) + "|"]
    for row in scenes:
        outside = []
        for name in FEATURES:
            low, high = np.percentile(values[name], MIDDLE)
            if not low <= row.features[name] <= high:
                outside.append(name)
        cells = " | ".join(f"{row.features[name]:.3g}" for name in FEATURES)
        lines.append(f"| `{row.name}` | {cells} | {', '.join(outside) or '–'} |")
    seconds = np.array([row.cpu_s for row in members])
    lines.append(
        f"\n{len(members)} members, measured in {np.median(seconds):.1f} CPU s each, at most {seconds.max():.1f}."
    )
    return "\n".join(lines)


def draw_sheet(rows: Sequence[Row], file: Path, *, across: int = 10) -> None:
    """Write the pictures at best focus of some members, each from black to its 99.5th percentile, gamma 2.2."""
    down = -(-len(rows) // across)
    figure, axes = plt.subplots(down, across, figsize=(1.6 * across, 1.75 * down), squeeze=False)
    for axis in axes.flat:
        axis.axis("off")
    for axis, row in zip(axes.flat, rows, strict=False):
        axis.imshow(
            (row.picture / np.percentile(row.picture, 99.5)).clip(0, 1) ** (1 / 2.2), cmap="gray", vmin=0, vmax=1
        )
        axis.set_title(row.name.removeprefix("assorted_moving-"), fontsize=5)
    figure.tight_layout(pad=0.2)
    figure.savefig(file, dpi=110)
    plt.close(figure)


def _cpu_s() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def main(given: Sequence[str] | None = None) -> None:
    """Measure members and scenes made by hand, and write report.md, features.csv and sheet.png."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--recipe", default="saf_bench")
    parser.add_argument("--split", help="split of the recipe (default: all)")
    parser.add_argument("--beside", required=True, help="recipe with a split test of scenes made by hand")
    parser.add_argument("--dataset", type=Path, help="folder of the recipe's dataset, whose focal stacks are read")
    parser.add_argument("--members", type=int, help="measure only so many members, evenly over the splits")
    parser.add_argument("--sheet", type=int, default=60)
    asked = parser.parse_args(given)
    scenes = measure_all(list(one_each(resolve_recipe(asked.beside, split="test").sequences)), asked.out / "scenes")
    found = list(one_each(resolve_recipe(asked.recipe, split=asked.split).sequences))
    chosen = found[:: max(len(found) // (asked.members or len(found)), 1)]
    stacks = asked.dataset / "stacks" if asked.dataset else None
    members = measure_all(chosen, asked.out / "members", stacks=stacks)
    text = report(members, scenes)
    (asked.out / "report.md").write_text(text + "\n", encoding="utf-8")
    with (asked.out / "features.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["scene", *FEATURES, "cpu_s"])
        writer.writerows([r.name, *(r.features[name] for name in FEATURES), r.cpu_s] for r in [*members, *scenes])
    draw_sheet(members[:: max(len(members) // asked.sheet, 1)][: asked.sheet], asked.out / "sheet.png")
    print(text)


if __name__ == "__main__":
    main()
