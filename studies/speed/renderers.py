"""Compare renders with LLVM and with Mitsuba's scalar variant, both without waves and shared shading.

    python -m studies.speed.renderers usaf_target camel --repeats 8

Stacks of the two variants are never identical in bits, because they are estimates from different light paths. They
agree if Welch's t in every pixel behaves as for two estimates of the same picture: t² then has the mean ν/(ν−2) over
pixels, with ν degrees of freedom. For each position the script prints the rms difference of two stacks over the mean
picture, that of two LLVM stacks with different seeds, the difference of the mean brightness, and the mean t² with its
expected value.
"""

import argparse
import sys

import numpy as np

from saf_gen.render import backend, mitsuba_scene, one_pass, thin_lens
from saf_gen.render.render_setup import RenderSetup, SensorGrid
from saf_gen.scene.scene_folder import find_scene

GRID = SensorGrid(rows=40, columns=64, pitch_m=125e-6)
"""The field of view of vidar_400x250 with larger pixels."""
POSITIONS = 3


def render(name: str, variant: str, *, samples: int, seed: int) -> np.ndarray:
    """Return a focal stack of a scene under all its lights, float64 (position, row, column)."""
    scene = find_scene(name)
    backend.activate_backend(variant)
    lamps = [lamp for group in scene.card.lights.values() for lamp in group]
    lit, integrator = mitsuba_scene.load_lit_scene(mitsuba_scene.scene_dict(scene), tuple(lamps), max_depth=4)
    to_world = mitsuba_scene.camera_to_world(scene)
    setup = RenderSetup(lit, integrator, to_world, scene.build_drive(), GRID, scene.card.unit_m)
    renderer = one_pass if variant == "llvm" else thin_lens
    stack, _ = renderer.render_stack(setup, positions=POSITIONS, samples=samples, seed=seed)
    return stack.astype(np.float64)


def compare(name: str, *, samples: int, repeats: int) -> None:
    llvm = np.array([render(name, "llvm", samples=samples, seed=s) for s in range(repeats)])
    scalar = np.array([render(name, "scalar", samples=samples, seed=1000 + s) for s in range(repeats)])
    same = sum((a == b).all() for a, b in zip(llvm, scalar, strict=True))
    print_line(f"{name}, {samples} samples, {repeats} stacks of each, {same} the same bit for bit")
    for k in range(POSITIONS):
        a, b = llvm[:, k], scalar[:, k]
        mean = 0.5 * (a.mean() + b.mean())
        apart, seeds = (np.sqrt(((x - y) ** 2).mean()) / mean for x, y in ((a, b), (a, np.roll(a, 1, axis=0))))
        error = (a.var(axis=0, ddof=1) + b.var(axis=0, ddof=1)) / repeats
        known = error > 0
        difference = a.mean(axis=0) - b.mean(axis=0)
        t2 = (difference[known] ** 2 / error[known]).mean()
        freedom = 2 * repeats - 2
        rms = np.sqrt(max((difference**2).mean() - error.mean(), 0)) / mean
        print_line(
            f"  position {k / (POSITIONS - 1):g}: {apart:.2%} rms apart (two seeds of LLVM {seeds:.2%}), "
            f"mean brightness {difference.mean() / mean:+.3%}, "
            f"mean t² {t2:.3f} (of equals {freedom / (freedom - 2):.3f}), "
            f"beyond noise {rms:.2%} rms"
        )


def print_line(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", default=["usaf_target", "bottle"])
    parser.add_argument("--samples", type=int, default=64)
    parser.add_argument("--repeats", type=int, default=8)
    given = parser.parse_args()
    for scene in given.scenes:
        compare(scene, samples=given.samples, repeats=given.repeats)
