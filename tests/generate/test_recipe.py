"""Recipes: correct ones are read, wrong ones are refused with the line number."""

import math
from pathlib import Path
from typing import get_args

import pytest
from refusals import assert_says, refusal

from saf_gen.generate.recipe import FocusSettings, read_recipe
from saf_gen.generate.resolve import resolve_recipe
from saf_gen.optics import DRIVES

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


def test_a_recipe_can_ask_for_every_drive_there_is():
    choices, _none = get_args(FocusSettings.model_fields["drive"].annotation)
    assert get_args(choices) == tuple(DRIVES)


def test_a_recipe_is_read(tmp_path):
    recipe = read(tmp_path, GOOD)
    assert recipe.camera.frames == 100
    assert recipe.splits["test"].lights == ("constant", "mixed")
    assert recipe.camera.noise.shot is None


@pytest.mark.parametrize("path", sorted(Path("recipes").glob("*.yaml")), ids=lambda p: p.name)
def test_every_recipe_of_the_project_is_right(path):
    assert read_recipe(path).name == path.stem
    assert resolve_recipe(path).sequences


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("frames: 100", "frmes: 100", "r.yaml:3 | 'frmes' | mean 'frames"),
        ("seed: 1", "seed: -1", "r.yaml:2 | seed is -1 | greater than or equal to 0"),
        ("frames: 100", "frames: 3", "r.yaml:3 | camera.frames is 3 | greater than or equal to 16"),
        ("{mean_rate: 0.2}", "{mean_rate: 1.2}", "r.yaml:3 | camera.exposure is | above 0 and below 1"),
        ("{mean_rate: 0.2}", "{}", "either mean_rate | or absolute: true"),
        ("drive: image_distance", "drive: imagedistance", "r.yaml:4 | focus.drive is 'imagedistance'"),
        ("kind: constant", "kind: constnt", "r.yaml:7 | 'constnt' | mean 'constant"),
        ("from: 0.5", "form: 0.5", "r.yaml:8 | 'ramp' | 'form' | mean 'from"),
        ("from: 0.5", "from: -0.5", "r.yaml:8 | from -0.5 to 1 | 0 or more"),
        ("[1, 2]", "[2, 1]", "r.yaml:8 | uniform is [2, 1] | [low, high] with low < high"),
        ("[constant, mixed]", "[constant, mixd]", "r.yaml:10 | 'mixd' | mean 'mixed"),
        ("{lamp: {kind", "{lamp: {kin", "r.yaml:8 | light group 'lamp' has no kind"),
        (
            "[constant, mixed]",
            "[constant, constant]",
            "r.yaml:10 | splits.test.lights is ['constant', 'constant'] | each name once",
        ),
        ("[usaf_target]", "[camel, camel]", "r.yaml:10 | splits.test.scenes is | each name once"),
        (
            "lights: [constant, mixed]",
            "lights: [constant], scene_motion: [static, static]",
            "r.yaml:10 | splits.test.scene_motion is | each name once",
        ),
        (
            "lights: [constant, mixed]",
            "lights: [constant], at_rest: [fan]",
            "r.yaml:10 | unknown scene of test in at_rest: 'fan' | allowed: usaf_target",
        ),
        (
            "lights: [constant, mixed]",
            "lights: [constant], scene_motion: [dynamic], at_rest: [usaf_target]",
            "r.yaml:10 | splits.test is | scene_motion: [static, dynamic] if scenes are at_rest",
        ),
        ("[1, 2]}", "[1, .inf]}", "r.yaml:8 | uniform is [1, inf] | finite numbers"),
        (
            "{kind: constant}",
            "{choice: [{kind: constant}, {choice: [{kind: constant}]}]}",
            "r.yaml:7 | a choice holds the range",
        ),
        ("name: tiny", "name: Tiny set", "r.yaml:1 | name is 'Tiny set'"),
        ("  mixed:", "  Mixed/up:", "'Mixed/up'"),
    ],
)
def test_a_wrong_recipe_is_refused_in_one_line(tmp_path, old, new, message):
    assert old in GOOD
    assert_says(refusal(read, tmp_path, GOOD.replace(old, new)), message)


@pytest.mark.parametrize(
    ("motion", "message"),
    [
        ("sweep", "r.yaml:4 | focus.motion is 'sweep' | a lens motion | such as {kind: sweep}"),
        ("{from: 0.1}", "r.yaml:4 | motion has no kind | from_csv, hand, hold, steps, sweep, sweep_"),
        ("{kind: swep}", "r.yaml:4 | 'swep' | mean 'sweep"),
        ("{kind: sweep, form: 0.1}", "r.yaml:4 | 'sweep' | 'form' | mean 'from"),
        ("{kind: sweep, to: 1.5}", "r.yaml:4 | to is 1.5 | 0 to 1"),
        ("{kind: sweep, to: {uniform: [0.5, 1.5]}}", "r.yaml:4 | to is 1.5 | 0 to 1"),
        ("{kind: sweep, to: {uniform: [0.5, 0.5]}}", "r.yaml:4 | uniform is [0.5, 0.5] | low < high"),
        ("{choice: [{kind: sweep}, {kind: hold}]}", "r.yaml:4 | lens motion 'hold' | missing"),
        ("{choice: [sweep]}", "r.yaml:4 | motion is 'sweep' | {kind: ...,"),
        ("{kind: from_csv, file: lns.csv}", "r.yaml:4 | 'lns.csv' | mean 'lens.csv"),
        ("{kind: from_csv, file: ../lens.csv}", "r.yaml:4 | '../lens.csv' | outside"),
        ("{kind: from_csv, file: lens.csv}", "lens.csv:3 | time_s goes from 0 to 0 | a column that rises"),
    ],
)
def test_a_wrong_lens_motion_is_refused_in_one_line(tmp_path, motion, message):
    (tmp_path / "lens.csv").write_text("time_s,position\n0,0\n0,1\n")
    assert_says(refusal(read, tmp_path, GOOD.replace("positions: 5", f"positions: 5, motion: {motion}")), message)


@pytest.mark.parametrize(
    ("motion", "message"),
    [
        ("{kind: steps, count: {uniform: [2, 9]}, natural_hz: 900, damping: 1}", "count is | a whole number"),
        ("{kind: sweep_and_return, dwell_s: 1}", "dwell_s is 1 in a recording of 0.005 s"),
        ("{kind: hand}", "bandwidth_hz is 5 in a recording of 0.005 s | at least 400"),
        ("{kind: from_csv, file: lens.csv}", "lens.csv | time_s goes from 0 to 0.001"),
    ],
)
def test_a_motion_that_does_not_fit_the_recording_is_refused_before_anything_is_made(tmp_path, motion, message):
    (tmp_path / "lens.csv").write_text("time_s,position\n0,0\n0.001,1\n")
    path = tmp_path / "r.yaml"
    path.write_text(GOOD.replace("positions: 5", f"positions: 5, motion: {motion}"))
    error = refusal(resolve_recipe, path)
    assert_says(error, message)
    assert (error.where, error.problem.split(": ")[0]) == (str(path), "the lens motion of usaf_target-constant-00")


def test_a_scene_in_two_splits_is_refused(tmp_path):
    text = GOOD + "  train: {scenes: [usaf_target], lights: [constant]}\n"
    assert_says(refusal(read, tmp_path, text), "r.yaml:11: scene 'usaf_target'")


@pytest.mark.parametrize(
    ("params", "message"),
    [
        ("{made: 2024-05-01}", "r.yaml:11 | scene_params.usaf_target.made is the date 2024-05-01"),
        ("{ink: .nan}", "r.yaml:11 | scene_params.usaf_target.ink is nan | a finite number"),
        ("{ink: {uniform: [0, .inf]}}", "r.yaml:11 | uniform is [0, inf]"),
        ("{ink: {choice: [{uniform: [0, 1]}, 1]}}", "r.yaml:11 | a choice holds the range"),
        ("{ink: {unifrm: [0, 1]}}", "r.yaml:11 | mean 'uniform"),
    ],
)
def test_a_parameter_that_no_file_could_store_is_refused_with_its_line(tmp_path, params, message):
    assert_says(refusal(read, tmp_path, GOOD + f"scene_params: {{usaf_target: {params}}}\n"), message)


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("lfet", 'r.yaml | scene_params.two_planes.near_side is \'lfet\' | "left", "right" | mean \'left'),
        ("{choice: [left, rihgt]}", "near_side is {'choice' | mean 'right"),
    ],
)
def test_a_value_that_is_not_in_the_card_s_choice_is_refused_before_anything_is_made(tmp_path, value, message):
    path = tmp_path / "r.yaml"
    text = GOOD.replace("[usaf_target]", "[two_planes]")
    path.write_text(f"{text}scene_params: {{two_planes: {{near_side: {value}}}}}\n")
    assert_says(refusal(resolve_recipe, path), message)


@pytest.mark.parametrize("light", ["{kind: constant, level: 1.0e+39}", "{kind: constant, offset: 1.0e+300}"])
def test_a_gain_that_cannot_be_recorded_is_refused_before_anything_is_made(tmp_path, light):
    path = tmp_path / "r.yaml"
    path.write_text(GOOD.replace("{kind: constant}", light))
    assert_says(refusal(resolve_recipe, path), "light 'constant' on usaf_target: the gain of | is too large")


def test_a_gain_is_checked_over_the_complete_recording(tmp_path):
    """The fourth of five steps has a gain beyond float32; the first sixteen readouts are all in the first step."""
    path = tmp_path / "r.yaml"
    late = "{kind: steps, every_s: 0.001, levels: [1, 1, 1, 1.0e+39, 1]}"
    path.write_text(GOOD.replace("{kind: constant}", late))
    assert_says(refusal(resolve_recipe, path), "light 'constant' on usaf_target: | too large")


@pytest.mark.parametrize(("value", "seconds"), [("false", 0), ("true", math.inf), ("0.3", 0.3), ("1", 1), ("1.0", 1)])
def test_whole_slices_cover_the_stated_seconds(tmp_path, value, seconds):
    text = GOOD.replace("render: {samples: 4}", f"render: {{samples: 4, whole_slices: {value}}}")
    assert read(tmp_path, text).render.all_positions_s == seconds


@pytest.mark.parametrize("value", ["0", "-0.3", "sometimes", ".inf"])
def test_whole_slices_for_no_time_is_refused(tmp_path, value):
    text = GOOD.replace("render: {samples: 4}", f"render: {{samples: 4, whole_slices: {value}}}")
    assert_says(refusal(read, tmp_path, text), "render.whole_slices is | seconds above 0")


def test_a_lens_that_diffraction_keeps_in_focus_is_refused_before_anything_is_rendered(tmp_path):
    path = tmp_path / "r.yaml"
    path.write_text(GOOD.replace("{mean_rate: 0.2}", "{mean_rate: 0.2, f_number: 64}"))
    message = "r.yaml | scene usaf_target: | 555 nm | 0.547 mm | 7.48 times the travel | diffraction: false"
    assert_says(refusal(resolve_recipe, path), message)
    path.write_text(path.read_text().replace("samples: 4", "samples: 4, diffraction: false"))
    assert resolve_recipe(path).sequences


@pytest.mark.parametrize(
    ("key", "wavelength_m"), [("", 555e-9), (", diffraction: true", 555e-9), (", diffraction: false", 0)]
)
def test_stacks_have_the_sensors_waves_unless_they_are_switched_off(tmp_path, key, wavelength_m):
    path = tmp_path / "r.yaml"
    path.write_text(GOOD.replace("samples: 4", f"samples: 4{key}"))
    resolved = resolve_recipe(path)
    specs = {spec for sequence in resolved.sequences for spec in sequence.time_stack.specs}
    assert {spec.wavelength_m for spec in specs} == {wavelength_m}
    geometric = resolved.without_diffraction()
    assert {s.time_stack.specs[0].wavelength_m for s in geometric.sequences + geometric.all_sequences} == {0.0}
    assert geometric.recipe.render.diffraction is False
