"""Time slices of a scene have the same camera rays, so that the remaining noise does not flicker if nothing moves."""

from dataclasses import replace

import numpy as np
import pytest
from written_scenes import SENSOR_GRID, VARIANT, dispersion, needs_llvm

from saf_gen.render import render_missing
from saf_gen.scene.scene_folder import find_scene
from saf_gen.stack.focal_stack import StackSpec, StackStore
from saf_gen.stack.time_resolved import slice_moments

pytestmark = needs_llvm

TIMES = [n / 500 for n in range(13)]
SLICES = (9, 10, 11, 12)  # each gets its shading from nine moments, as in the middle of a recording


@pytest.fixture
def slices(test_scenes, tmp_path):
    """Return a function that renders slices of the static chequered plane: float64 (slice, row, col)."""

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
        render_missing(plane, specs, root=tmp_path, backend_name=VARIANT)
        light = [StackStore(tmp_path, spec).load().radiance.sum(axis=0)[0] for spec in specs]
        return np.array(light, dtype=np.float64)

    return render


@pytest.mark.slow
@pytest.mark.parametrize("estimator", ["plain", "filtered"])
def test_slices_of_a_static_scene_are_equal_if_the_same_paths_give_the_shading(slices, estimator):
    """They agree to two roundings of half floats, 2⁻¹¹ each; the noise of 16 samples is 10 % of a pixel."""
    found = slices(estimator, [(0.0,)] * len(TIMES))
    assert found == pytest.approx(np.broadcast_to(found[0], found.shape), rel=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize("estimator", ["plain", "filtered"])
def test_a_still_scene_shows_no_beat_with_its_slices(slices, estimator):
    """Half way between two slices SD is as large as at them, within 0.03 %; 16 samples, as in recipes.

    Noise that two slices do not share averages out half way: with separate camera rays this is 0.65 % of SD in plain
    slices and 0.09 % in filtered ones. Here one moment of nine is not shared, which leaves 0.004 %.
    """
    found = slices(estimator, slice_moments(TIMES))
    at, half_way = dispersion(found), dispersion((found[1:] + found[:-1]) / 2)
    assert half_way == pytest.approx((at[1:] + at[:-1]) / 2, rel=3e-4)
