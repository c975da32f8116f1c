"""Time slices of a scene have the same camera rays: what noise is left does not flicker where nothing moves."""

from dataclasses import replace

import numpy as np
import pytest
from written_scenes import SENSOR_GRID, VARIANT, dispersion, needs_llvm

from saf_gen.render import render_missing_stacks
from saf_gen.scene.scene_folder import find_scene
from saf_gen.stack.focal_stack import StackSpec, StackStore
from saf_gen.stack.time_resolved import moments_that_shade_stack_slices

pytestmark = needs_llvm

TIMES = [n / 500 for n in range(13)]

SLICES = (9, 10, 11, 12)  # each is told its shading by nine moments, as in a recording that has begun


@pytest.fixture
def slices(test_scenes, tmp_path):
    """Gives a function that renders slices of the chequered plane, which stands still: float64 (slice, row, col)."""

    def render(estimator, moments_s):
        plane = find_scene("plane")
        specs = [
            replace(
                StackSpec.from_scene(
                    plane, SENSOR_GRID, positions=9, samples=16, max_depth=3, time_s=TIMES[n], wavelength_m=0.0,
                    window=(1, 2), estimator=estimator,
                ),
                moments_s=moments_s[n],
            )
            for n in SLICES
        ]  # fmt: skip
        render_missing_stacks(plane, specs, root=tmp_path, backend_name=VARIANT)
        light = [StackStore(tmp_path, spec).load().radiance.sum(axis=0)[0] for spec in specs]
        return np.array(light, dtype=np.float64)

    return render


@pytest.mark.parametrize("estimator", ["plain", "filtered"])
def test_slices_of_what_stands_still_are_the_same_where_shading_is_told_by_the_same_paths(slices, estimator):
    """To the last digits of half floats, two roundings of 2⁻¹¹; the noise of 16 samples is 10 % of a pixel."""
    found = slices(estimator, [(0.0,)] * len(TIMES))
    assert found == pytest.approx(np.broadcast_to(found[0], found.shape), rel=2e-3)


@pytest.mark.parametrize("estimator", ["plain", "filtered"])
def test_a_still_scene_shows_no_beat_with_its_slices(slices, estimator):
    """Half way between two slices SD is as large as at them, within 0.03 %; 16 samples, as in recipes.

    Noise that two slices do not share averages out half way: of camera rays of their own, 0.65 % of SD in plain slices
    and 0.09 % in filtered ones. The one moment of nine that these do not share leaves 0.004 %.
    """
    found = slices(estimator, moments_that_shade_stack_slices(TIMES))
    at, half_way = dispersion(found), dispersion((found[1:] + found[:-1]) / 2)
    assert half_way == pytest.approx((at[1:] + at[:-1]) / 2, rel=3e-4)
