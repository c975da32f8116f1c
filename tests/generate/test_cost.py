"""What a stack costs by the plan."""

from dataclasses import replace

import pytest
import yaml

from saf_gen.camera import get_sensor
from saf_gen.generate.cost import SceneCost, grain_seconds, render_seconds, scene_costs, start_seconds
from saf_gen.scene.scene_folder import find_scene, scene_names
from saf_gen.stack.focal_stack import StackSpec
from saf_gen.stack.time_resolved import TimeResolvedStack
from studies.speed.cost import table_text


def spec_of(scene, **changes):
    asked = {"positions": 17, "samples": 16, "max_depth": 6, "time_s": 0.0, "wavelength_m": 0.0, **changes}
    return StackSpec.from_scene(find_scene(scene), get_sensor("vidar_400x250"), **asked)


@pytest.mark.slow
def test_measured_scenes_cost_what_the_table_says_and_others_lie_among_them():
    costs = {name: render_seconds(replace(spec_of(name), groups=("lamp",))) for name in scene_costs()}
    assert max(costs.values()) > 1.5 * min(costs.values())
    unknown = render_seconds(replace(spec_of("usaf_target", groups=["lamp"]), scene="of_a_user"))
    assert min(costs.values()) < unknown < max(costs.values())


def test_cost_grows_with_samples_pixels_and_groups_and_plain_paths_are_cheaper():
    one = spec_of("usaf_target", groups=["lamp"])
    base = render_seconds(one)
    for dearer in ({"samples": 64}, {"rows": 1000}, {"groups": ("lamp", "room")}, {"positions": 513}):
        assert render_seconds(replace(one, **dearer)) > 1.2 * base
    assert render_seconds(replace(one, estimator="plain")) < base
    assert start_seconds(one) == 0
    assert 0 < grain_seconds(TimeResolvedStack((0,), (one,))) < base


def test_a_run_of_slices_pays_for_the_moments_before_it():
    first = replace(spec_of("fan"), window=(8, 9), moments_s=(0.0,) * 9)
    later = replace(first, time_s=0.1, moments_s=tuple(n / 80 for n in range(9)))
    assert start_seconds(later) > start_seconds(first) > 0


def test_the_table_of_costs_names_scenes_and_is_written_as_it_is_read():
    assert set(scene_costs()) <= set(scene_names())
    text = table_text(dict(scene_costs()))
    for name, cost in scene_costs().items():
        line = next(line for line in text.splitlines() if line.startswith(f"{name}:"))
        assert f"ray_us: {cost.ray_us:.3g}" in line


def test_the_table_can_be_read_where_a_cost_is_zero_and_slices_were_not_measured():
    costs = {"a": SceneCost(1.5, 0.0, 3.0, 0.0, 2.0), "b": SceneCost(0.0, 2.0, 0.0)}
    assert {name: SceneCost(**cost) for name, cost in yaml.safe_load(table_text(costs)).items()} == costs
    assert "slice" not in table_text(costs).splitlines()[-1]
