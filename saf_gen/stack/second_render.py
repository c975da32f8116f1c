"""Which stored stacks are rendered a second time to measure their grain, and with how many samples."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from saf_gen.stack.focal_stack import PICTURES, WAVES, StackSpec, StackStore

# Samples of a stack divided by the samples of its second render. A second render of 8 samples takes 16 to 19 % of the
# processor time of a stack of 64. Noise falls faster than 1/samples, so noise over signal in C² comes out too large by
# a factor of 1.2 (usaf_target) to 1.5 (low_texture). A second render of 4 samples takes 10 to 12 %, and the factor is
# 1.3 to 2.1. Both scatter by 2 to 3 %.
STILL_DIVISOR, SLICE_DIVISOR = 8, 2
MAX_SLICES, SLICE_STRIDE = 6, 12  # per recording: at most this many time slices, and at most one in this many


def stacks_to_repeat(specs: Sequence[StackSpec], root: Path) -> list[StackSpec]:
    """Return the stored stacks whose grain is measured; for a moving scene, a few slices that see the target.

    Depth and target of all of them must be stored; otherwise BadInput is raised.
    """
    seen = []
    for spec in specs if specs[0].estimator not in (PICTURES, WAVES) else ():  # without grain, or not to be repeated
        depth, target = StackStore(root, spec).load_geometry()
        if target.any():
            seen.append((spec, abs(float(spec.focus.mean()) - spec.in_focus.true_focus(depth, target))))
    if not seen:
        return []
    chosen = {round(n) for n in np.linspace(0, len(seen) - 1, _count_evenly(len(seen)) + 2)[1:-1]}
    chosen.add(min(range(len(seen)), key=lambda n: seen[n][1]))
    return [seen[n][0] for n in sorted(chosen)]


def count_slices_to_repeat(slices: int) -> int:
    """Return the largest number of stacks whose grain is measured, if there are ``slices``: 1 for a still scene."""
    return min(_count_evenly(slices) + 1, slices)


def _count_evenly(slices: int) -> int:
    return min(MAX_SLICES, max(slices // SLICE_STRIDE, 1))


def second_render(spec: StackSpec, *, slices: int) -> StackSpec:
    """Return the stack that is rendered to measure the grain of one of ``slices`` stacks.

    It has fewer samples, but at least 1, and never as many, because its paths would then have the same seeds.
    """
    fewer = max(spec.samples // (SLICE_DIVISOR if slices > 1 else STILL_DIVISOR), 1)
    return replace(spec, samples=fewer if fewer != spec.samples else spec.samples + 1)
