"""The rectangle inside a target that moves: inside it at every moment that the lens sees near the focus."""

from dataclasses import replace

import numpy as np
import pytest

from saf_gen.optics import ImageDistanceDrive
from saf_gen.stack.focal_stack import StackSpec
from saf_gen.stack.time_resolved import PlaneSource, TimeResolvedStack
from saf_gen.stack.true_focus import find_inside, find_true_focus

FRAMES, STEP = 400, 20
AT = tuple(range(0, FRAMES + 1, STEP))
SWEEP = (np.arange(FRAMES) + 0.5) / FRAMES
DRIVE = ImageDistanceDrive(0.025, 2.0, (0.6, 0.42))
DEPTH = float(DRIVE.focus_depth(0.5))
SPEC = StackSpec("plane", "0" * 64, ("lamp",), DRIVE, 60, 150, 10e-6, 129, 16, 4)


def mask_at(n, *, columns=60):
    """40 rows and 60 columns that move by 2 columns from moment to moment."""
    mask = np.zeros((60, 150), bool)
    mask[10:50, 20 + 2 * n : 20 + 2 * n + columns] = True
    return mask


def inside(masks, position=SWEEP):
    """The rectangle, and the true focus, of a flat target with a mask per moment."""
    specs = tuple(replace(SPEC, time_s=at / 20_000, window=(0, 128)) for at in AT)
    depth = np.full((60, 150), DEPTH, np.float32)
    source = PlaneSource(
        TimeResolvedStack(AT, specs), lambda *which: np.empty(0), lambda j: (depth, masks[j]), "d", "llvm"
    )
    truth, _ = find_true_focus(source, position)
    return find_inside(source, truth, position=position), truth


def moments_near(truth, position=SWEEP):
    """Numbers of the moments whose pictures are mixed while the lens is within three depths of focus of the truth."""
    dof = truth.depth_of_focus[1] - truth.depth_of_focus[0]
    near = [t for t in range(FRAMES) if abs(position[t] - truth.track[t]) <= 3 * abs(dof)]
    return sorted({t // STEP + later for t in near for later in (0, 1)})


def test_it_is_what_the_moments_near_the_focus_have_in_common():
    found, truth = inside([mask_at(n) for n in range(len(AT))])
    used = moments_near(truth)
    assert 0 < used[0] < used[-1] < len(AT) - 1
    assert found == (slice(13, 47), slice(20 + 2 * used[-1] + 3, 20 + 2 * used[0] + 60 - 3))


def test_where_the_target_is_at_other_moments_does_not_count_and_at_these_it_does():
    still = [mask_at(9)] * len(AT)
    whole, truth = inside(still)
    used = moments_near(truth)
    assert whole == (slice(13, 47), slice(41, 95))
    away = [mask_at(9 if n in used else 40, columns=30) for n in range(len(AT))]
    assert inside(away)[0] == (slice(13, 47), slice(41, 65))
    for n in (used[0], used[-1]):
        assert inside([mask if k != n else mask_at(40, columns=30) for k, mask in enumerate(still)])[0] is None


@pytest.mark.parametrize("position", [SWEEP / 10, np.full(FRAMES, 0.95)], ids=["beyond its way", "at rest"])
def test_a_lens_that_is_never_near_the_focus_has_none(position):
    assert inside([mask_at(9)] * len(AT), position)[0] is None


def test_a_target_that_moves_too_far_in_that_time_has_none():
    assert inside([mask_at(n, columns=32) for n in range(len(AT))])[0] is None
