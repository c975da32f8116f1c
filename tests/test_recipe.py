"""Recipes: what is right is read, what is wrong is told with its line."""

from pathlib import Path

import pytest

from saf_gen.errors import BadInput
from saf_gen.recipe import read_recipe

GOOD = """\
name: tiny
seed: 1
camera: {sensor: vidar_400x250, frames: 100, exposure: {mean_rate: 0.2}}
focus: {drive: image_distance, positions: 5}
render: {samples: 4}
lights:
  constant: {kind: constant}
  mixed: {lamp: {kind: ramp, from: 0.5, to: {uniform: [1, 2]}}}
splits:
  test: {scenes: [usaf_target], lights: [constant, mixed]}
"""


def read(tmp_path, text):
    path = tmp_path / "r.yaml"
    path.write_text(text)
    return read_recipe(path)


def test_a_recipe_is_read_whole(tmp_path):
    recipe = read(tmp_path, GOOD)
    assert recipe.camera.frames == 100
    assert recipe.splits["test"].lights == ("constant", "mixed")
    assert recipe.camera.noise.shot is None


@pytest.mark.parametrize("path", sorted(Path("recipes").glob("*.yaml")), ids=lambda p: p.name)
def test_every_recipe_of_the_project_is_right(path):
    assert read_recipe(path).name == path.stem


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("frames: 100", "frmes: 100", r"r.yaml:3: unknown key 'frmes' in camera; .*did you mean 'frames'\?"),
        ("seed: 1", "seed: -1", r"r.yaml:2: seed is -1; allowed: greater than or equal to 0"),
        ("frames: 100", "frames: 3", r"r.yaml:3: camera.frames is 3; allowed: greater than or equal to 16"),
        ("{mean_rate: 0.2}", "{mean_rate: 1.2}", r"r.yaml:3: camera.exposure is .*above 0 and below 1"),
        ("{mean_rate: 0.2}", "{}", r"either mean_rate: .* or absolute: true"),
        ("drive: image_distance", "drive: imagedistance", r"r.yaml:4: focus.drive is 'imagedistance'"),
        ("kind: constant", "kind: constnt", r"r.yaml:7: unknown light kind 'constnt'; .*mean 'constant'\?"),
        ("from: 0.5", "form: 0.5", r"r.yaml:8: unknown key of light 'ramp': 'form'; .*mean 'from'\?"),
        ("from: 0.5", "from: -0.5", r"r.yaml:8: from -0.5 to 1; allowed: gains of 0 or more"),
        ("[1, 2]", "[2, 1]", r"r.yaml:8: uniform is \[2, 1\]; allowed: \[low, high\] with low < high"),
        ("[constant, mixed]", "[constant, mixd]", r"r.yaml:10: unknown light 'mixd'; .*mean 'mixed'\?"),
        ("{lamp: {kind", "{lamp: {kin", r"r.yaml:8: light group 'lamp' has no kind"),
        ("name: tiny", "name: Tiny set", r"r.yaml:1: name is 'Tiny set'"),
        ("  mixed:", "  Mixed/up:", r"light 'Mixed/up' cannot be part of a file name"),
    ],
)
def test_a_wrong_recipe_is_told_in_one_line(tmp_path, old, new, told):
    assert old in GOOD
    with pytest.raises(BadInput, match=told) as caught:
        read(tmp_path, GOOD.replace(old, new))
    assert "\n" not in str(caught.value)


def test_a_scene_in_two_splits_is_refused(tmp_path):
    text = GOOD + "  train: {scenes: [usaf_target], lights: [constant]}\n"
    with pytest.raises(BadInput, match=r"r.yaml:11: scene 'usaf_target' stands in test and in train"):
        read(tmp_path, text)
